//! Seeded mutation fuzzing, in process: `fuzz wire|align [--minutes M] [--seed N]`.
//!
//! An input is a string of bytes. `wire` decodes it, as it is or as a delta; `align` reads two graphs off it, aligns and
//! merges them. Inputs that show a new behaviour (answers and counts by powers of two, places of errors) are kept and
//! mutated. This is coverage of behaviours, not of code: it needs no instrumented build.

#![allow(clippy::print_stdout, reason = "an example speaks")]

use graph_align::robust::align_counted;
use graph_align::{
    Box3, Edge, Error, Footprint, Index, Key, LabelId, Looked, Node, NodeId, Observation, Outcome, Params,
    PredicateId, Query, SceneGraph, Vocabulary, update, wire,
};
use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::time::{Duration, Instant};

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

fn names() -> Result<Vocabulary, Error> {
    let labels = ["wall", "floor", "chair", "table", "lamp", "none"];
    Vocabulary::new(labels, ["standing on", "attached to", "close by"])
}

/// Reads values off an input; zeros after its end.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn byte(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    /// Mostly steps of a grid, so that centres and sizes repeat; sometimes far away.
    fn metres(&mut self) -> f32 {
        match self.byte() {
            255 => 9.9e5 - f32::from(self.byte()),
            b => f32::from(b) * 0.05 - 6.0,
        }
    }

    fn graph(&mut self) -> SceneGraph {
        let mut g = SceneGraph::default();
        let n = self.byte() % 48;
        for k in 0..u64::from(n) {
            let centroid = [self.metres(), self.metres(), self.metres() / 4.0];
            let extent = [0; 3].map(|_| f32::from(self.byte()) * 0.02);
            let Ok(mut b) = Box3::new(centroid, extent) else { continue };
            let turn = self.byte();
            if turn > 127 {
                let f = Footprint { sides: [extent[0], extent[1]], yaw: f32::from(turn - 128) / 81.0 };
                b = b.with_footprint(f).unwrap_or(b);
            }
            let mut node = Node::new(NodeId(k * 3), LabelId(u16::from(self.byte() % 6)), b);
            node.score = f32::from(self.byte() % 128) / 127.0;
            node.sightings = u32::from(self.byte() % 4);
            if self.byte() > 127 {
                node.others = vec![(LabelId(u16::from(self.byte() % 6)), 0.25)];
            }
            g.insert_node(node);
        }
        for _ in 0..self.byte() % 64 {
            let mut end = || NodeId(u64::from(self.byte()) % u64::from(n.max(1)) * 3);
            let (s, t) = (end(), end());
            // Ends that are not there make no edge.
            let _ = g.insert_edge(Edge { s, t, p: PredicateId(u16::from(self.byte() % 3)), score: 0.5 });
        }
        g
    }

    fn looked(&mut self) -> Option<Looked> {
        let n = self.byte() % 32;
        let cells: Vec<[i32; 3]> = (0..n).map(|_| [0; 3].map(|_| i32::from(self.byte()) / 16 - 8)).collect();
        Looked::new(0.5, [self.metres(), 0.0, 0.0], &cells).ok().filter(|_| n > 0)
    }

    fn observation(&mut self) -> Observation {
        let key = Key { start_ds: 0, agent: 0, epoch: 0, seq: u32::from(self.byte()) };
        Observation {
            key,
            end_ds: 9,
            frame: 0,
            graph: self.graph().quantised(),
            looked: self.looked().map(|l| l.quantised()),
        }
    }
}

fn log(n: usize) -> u64 {
    n.checked_ilog2().map_or(0, |l| u64::from(l) + 1)
}

/// Frames: what decodes encodes to the same bytes. A frame is an input that starts with the magic;
/// other inputs are read as observations, written, read back, and kept as frames.
fn wire_run(input: &[u8], names: &Vocabulary) -> Result<(BTreeSet<u64>, Option<Vec<u8>>), String> {
    let say = |e: Error| e.to_string();
    let mut seen = BTreeSet::new();
    if !input.starts_with(wire::MAGIC) {
        let mut r = Reader(input);
        let (base, o) = (r.observation(), r.observation());
        let whole = wire::encode(&o, names).map_err(say)?;
        if wire::decode(&whole, names).map_err(say)? != o {
            return Err("a frame that reads back as something else".into());
        }
        let delta = wire::encode_delta(&base, &o, names).map_err(say)?;
        if wire::decode_delta(&delta, &base, names).map_err(say)? != o {
            return Err("a delta that reads back as something else".into());
        }
        seen.insert(1000 + log(whole.len()) * 40 + log(delta.len()));
        return Ok((seen, Some(whole)));
    }
    match wire::decode(input, names) {
        Ok(o) => {
            if wire::encode(&o, names).map_err(say)? != input {
                return Err("two frames of one observation".into());
            }
            seen.insert(2000 + log(o.graph.len()) * 40 + log(o.graph.edges().len()));
        }
        // Which complaint, without its numbers.
        Err(e) => {
            let words = e.to_string();
            let hash = words.bytes().filter(u8::is_ascii_alphabetic);
            seen.insert(hash.fold(5, |h: u64, b| h.wrapping_mul(31).wrapping_add(u64::from(b))));
        }
    }
    Ok((seen, None))
}

/// Alignment and merge: finite, one-to-one, within the budget, edges alive.
fn align_run(input: &[u8]) -> Result<BTreeSet<u64>, String> {
    let mut r = Reader(input);
    let mut params = Params::default();
    params.robust.structure = vec![LabelId(0), LabelId(1)];
    params.robust.unnamed = Some(LabelId(5));
    params.robust.budget = [20_000_000, 100_000, 50][usize::from(r.byte()) % 3];
    let (reference, graph, looked) = (r.graph(), r.graph(), r.looked());
    let query = Query { looked: looked.as_ref(), ..Query::new(&graph) };
    let index = Index::of(&reference, &params.robust);
    let (outcome, work) = align_counted(&index, &query, &params.robust);
    if work > params.robust.budget {
        return Err(format!("work {work} of {}", params.robust.budget));
    }
    let answer = match &outcome {
        Outcome::Match(m) => {
            let partners: BTreeMap<_, _> = m.pairs.iter().map(|&(q, r)| (r, q)).collect();
            let t = m.reference_from_query.translation.vector;
            if partners.len() != m.pairs.len() || !m.score.is_finite() || !t.iter().all(|v| v.is_finite()) {
                return Err(format!("a match that is none: {m:?}"));
            }
            log(m.pairs.len()) * 8 + log(m.removed.len())
        }
        Outcome::Ambiguous { candidates } => 100 + log(candidates.len()),
        Outcome::NoMatch { why } => 200 + why.word().len() as u64,
    };
    let merged = update(&reference, &query, &outcome, &params);
    if merged.edges().any(|e| merged.node(e.s).is_none() || merged.node(e.t).is_none()) {
        return Err("an edge without an end".into());
    }
    Ok(BTreeSet::from([
        answer,
        300 + log(work as usize),
        400 + log(merged.len()),
        500 + log(merged.edges().len()),
    ]))
}

fn mutate(corpus: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut input = corpus[random.below(corpus.len())].clone();
    for _ in 0..=random.below(4) {
        let at = random.below(input.len());
        match random.below(5) {
            0 => input[at] = random.next() as u8,
            1 => input[at] ^= 1 << random.below(8),
            2 if input.len() < 4000 => {
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
    let (Some(target @ ("wire" | "align")), Ok(names)) = (args.first().map(String::as_str), names()) else {
        println!("want a target: wire or align");
        return ExitCode::FAILURE;
    };
    let end = Instant::now() + Duration::from_secs_f64(60.0 * minutes.clamp(0.0, 10_000.0));
    let mut random = Random(seed as u64);
    let mut corpus: Vec<Vec<u8>> = (0..8).map(|_| (0..900).map(|_| random.next() as u8).collect()).collect();
    let (mut seen, mut executions) = (BTreeSet::new(), 0_u64);
    while Instant::now() < end {
        let input = mutate(&corpus, &mut random);
        executions += 1;
        let run = || match target {
            "wire" => wire_run(&input, &names),
            _ => align_run(&input).map(|s| (s, None)),
        };
        match catch_unwind(AssertUnwindSafe(run)) {
            Ok(Ok((found, frame))) => {
                let before = seen.len();
                seen.extend(found);
                if seen.len() > before {
                    corpus.extend(frame);
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
        "{target}: {executions} executions, {} behaviours, {} inputs kept, no failure",
        seen.len(),
        corpus.len()
    );
    ExitCode::SUCCESS
}
