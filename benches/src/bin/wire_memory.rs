//! What decoding a frame asks of memory: `cargo run -r -p benches --bin wire_memory -- FILE.bin`, FILE.bin under `wire/`
//! of a bench run.

#![allow(clippy::print_stdout, reason = "a program speaks")]

use graph_align::{Error, Vocabulary, wire};
use peak_alloc::PeakAlloc;
use scan3r::LabelSet;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Bytes at the peak of decoding beyond those before it, and those that the observation holds.
fn decode(frame: &[u8], names: &Vocabulary) -> Result<(usize, usize), Error> {
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let o = wire::decode(frame, names)?;
    let (peak, held) = (MEMORY.peak_usage() - before, MEMORY.current_usage() - before);
    drop(o);
    Ok((peak, held))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("want FILE.bin")?;
    let set = LabelSet::L20;
    let names =
        Vocabulary::new(set.classes().iter().copied().chain(["none"]), set.predicates().iter().copied())?;
    let file = std::fs::read(path)?;
    let (mut bytes, mut peaks, mut holds, mut worst) = (0, 0, 0, 0.0_f64);
    for frame in wire::split(&file)? {
        let (peak, held) = decode(frame, &names)?;
        bytes += frame.len();
        peaks += peak;
        holds += held;
        worst = worst.max(peak as f64 / frame.len() as f64);
    }
    let ratio = |a: usize, b: usize| a as f64 / b as f64;
    println!(
        "frames of the file: {bytes} bytes, peak {:.1} times, held {:.1} times, worst peak {worst:.1} times",
        ratio(peaks, bytes),
        ratio(holds, bytes)
    );
    Ok(())
}
