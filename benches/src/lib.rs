//! Criterion benches; run them with `cargo bench -p benches`.
