//! Training-free alignment and merge of 3D semantic scene graphs.
