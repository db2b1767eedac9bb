//! Prints the statistics of generated rooms beside those of real ones.
//!
//! `cargo run --release -p room-synth --example stats -- [rooms 200] [seed 1] [split train] [visits 20]`

#![allow(clippy::print_stdout, clippy::disallowed_methods, reason = "an example prints and measures")]

use room_synth::stats::{size_tree, stats};
use room_synth::{Split, World, WorldParams};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, default: usize| args.get(k).map_or(Ok(default), |a| a.parse());
    let (rooms, seed, visits) = (number(0, 200)?, number(1, 1)? as u64, number(3, 20)?);
    let split = Split::parse(args.get(2).map_or("train", String::as_str))
        .ok_or("split is train, validation or test")?;
    let start = Instant::now();
    let world = World::new(split, seed, rooms, &WorldParams::default());
    println!(
        "{rooms} {} rooms, seed {seed}: furnished in {:.2} s",
        split.name(),
        start.elapsed().as_secs_f64()
    );
    let figures = stats(&world, visits)?;
    println!("{figures}");
    let test =
        World::new(Split::Test, seed, rooms, &WorldParams { rescans: false, ..WorldParams::default() });
    let tree = size_tree(&world, &test);
    println!(
        "tree on box sizes, {} rooms to test rooms: accuracy {:.1} % ({:.1} % without wall and floor), class mean {:.1} %; with none {:.1} %, {:.1} %",
        split.name(),
        100.0 * tree.accuracy,
        100.0 * tree.furniture,
        100.0 * tree.class_mean,
        100.0 * tree.with_none[0],
        100.0 * tree.with_none[1]
    );
    for (class, recall, n) in &tree.per_class {
        print!("{class} {:.0} % of {n}; ", 100.0 * recall);
    }
    println!("\n{} figures outside their bars", figures.misses().len());
    for miss in figures.misses() {
        println!("  {}: {:.3}", miss.name, miss.generated);
    }
    Ok(())
}
