//! SceneGraphFusion network (SGFN) inference on the CPU.
