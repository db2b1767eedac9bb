//! Aligns two graph files: `cargo run -p graph-align --example align_files -- QUERY.json REFERENCE.json`

#![allow(clippy::print_stdout, reason = "an example prints")]

use graph_align::json::{GraphFile, pairs_line};
use graph_align::{Outcome, PaperParams, Params, Query, Vocabulary, align, update};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut files = std::env::args().skip(1);
    let (Some(query), Some(reference)) = (files.next(), files.next()) else {
        return Err("want QUERY.json REFERENCE.json".into());
    };
    let mut vocabulary = Vocabulary::default();
    let query = GraphFile::parse(&std::fs::read_to_string(query)?)?.to_graph(&mut vocabulary)?;
    let reference = GraphFile::parse(&std::fs::read_to_string(reference)?)?.to_graph(&mut vocabulary)?;
    // The files have frames of their own: the transform is fitted on the mapped nodes.
    let paper = PaperParams::reading("fit").ok_or("no such reading")?;
    let params = Params { paper, seed: 1, ..Params::default() };
    let ask = Query::new(&query);
    let outcome = align(&reference, &ask, &params);
    match &outcome {
        Outcome::Match(m) => println!("match, score {}: {}", m.score, pairs_line(m)),
        Outcome::Ambiguous { candidates } => println!("ambiguous: {} places", candidates.len()),
        Outcome::NoMatch { why } => println!("no match: {}", why.word()),
    }
    println!("{} nodes after the merge", update(&reference, &ask, &outcome, &params).len());
    Ok(())
}
