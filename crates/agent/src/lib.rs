//! One robot: depth frames to a local 3D semantic scene graph.
