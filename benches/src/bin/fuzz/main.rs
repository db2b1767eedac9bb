//! Seeded mutation fuzzing, in process: `cargo xtask fuzz gsm|wire|align [--minutes M] [--seed N]`.
//!
//! An input is a string of bytes. Inputs that show a new behaviour (answers, events and counts by powers of two, kinds
//! of errors) are kept and mutated. This is coverage of behaviours, not of code: it needs no instrumented build.

#![allow(clippy::print_stdout, reason = "a program speaks")]

mod graph;
mod gsm;

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Longest input that is made longer, bytes.
const LONGEST: usize = 4000;

/// What an input showed.
#[derive(Default)]
struct Shown {
    behaviours: BTreeSet<u64>,
    /// An input of another form that was found on the way.
    found: Option<Vec<u8>>,
}

/// Runs an input, or says what is wrong.
type Target = fn(&[u8]) -> Result<Shown, String>;

struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Reads values off an input; zeros after its end.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn byte(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }
}

/// A number by its power of two.
fn log(n: u64) -> u64 {
    n.checked_ilog2().map_or(0, |l| u64::from(l) + 1)
}

fn mutate(corpus: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut input = corpus[random.below(corpus.len())].clone();
    for _ in 0..=random.below(5) {
        let at = random.below(input.len());
        match random.below(5) {
            0 => input[at] = random.next() as u8,
            1 => input[at] ^= 1 << random.below(8),
            2 if input.len() < LONGEST => {
                let other = &corpus[random.below(corpus.len())];
                let from = random.below(other.len());
                input.splice(at..at, other[from..(from + 30).min(other.len())].iter().copied());
            }
            3 if input.len() > 40 => drop(input.drain(at..(at + 8).min(input.len()))),
            _ => input[at] = 255,
        }
    }
    input
}

#[allow(clippy::disallowed_methods, reason = "the time budget of a fuzzer")]
fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let value = |name: &str| args.iter().position(|a| a == name).and_then(|i| args.get(i + 1)?.parse().ok());
    let (minutes, seed): (f64, f64) = (value("--minutes").unwrap_or(1.0), value("--seed").unwrap_or(1.0));
    let name = args.first().map(String::as_str).unwrap_or_default();
    let target: Target = match name {
        "gsm" => gsm::run,
        "wire" => graph::wire,
        "align" => graph::align,
        _ => {
            println!("want a target: gsm, wire or align");
            return ExitCode::FAILURE;
        }
    };
    let end = Instant::now() + Duration::from_secs_f64(60.0 * minutes.clamp(0.0, 10_000.0));
    let mut random = Random(seed as u64);
    let mut corpus: Vec<Vec<u8>> = (0..8).map(|_| (0..600).map(|_| random.next() as u8).collect()).collect();
    let (mut seen, mut executions) = (BTreeSet::new(), 0_u64);
    while Instant::now() < end {
        let input = mutate(&corpus, &mut random);
        executions += 1;
        match catch_unwind(AssertUnwindSafe(|| target(&input))) {
            Ok(Ok(shown)) => {
                let before = seen.len();
                seen.extend(shown.behaviours);
                if seen.len() > before {
                    corpus.extend(shown.found);
                    corpus.push(input);
                }
            }
            bad => {
                let what = bad.map_or_else(|_| "panic".to_owned(), |r| r.err().unwrap_or_default());
                println!("{what}\ninput {input:?}");
                return ExitCode::FAILURE;
            }
        }
    }
    println!(
        "{name}: {executions} executions, {} behaviours, {} inputs kept, no failure",
        seen.len(),
        corpus.len()
    );
    ExitCode::SUCCESS
}
