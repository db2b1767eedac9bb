//! Inputs for the criterion benches (`cargo bench -p benches`) and for tuning: furnished buildings as
//! graphs, and alignment cases with truth.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a package of benches")]

pub mod building;
pub mod cases;
pub mod peers;
pub mod visits;
