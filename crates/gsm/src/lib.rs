//! Incremental geometric segmentation of depth frames into surfels and segments.
