//! The command line of MA3DSG.
fn main() {}
