//! Solves alignment cases with a comparator: `cargo run -r -p benches --bin peers -- CASES OUT.json spectral|clique`.

use benches::peers::{Solver, align};
use graph_align::json::Case;
use graph_align::{Query, Vocabulary};
use std::path::PathBuf;
use std::time::Instant;

#[allow(clippy::disallowed_methods, reason = "a bench reads the clock")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(dir), Some(out), Some(solver)) = (args.next(), args.next(), args.next()) else {
        return Err("want CASES OUT.json spectral|clique".into());
    };
    let solver = if solver == "clique" { Solver::Clique } else { Solver::Spectral };
    let mut files: Vec<PathBuf> = std::fs::read_dir(PathBuf::from(dir).join("cases"))?
        .map(|e| Ok(e?.path()))
        .collect::<std::io::Result<_>>()?;
    files.sort();
    let mut answers = Vec::new();
    for path in files {
        let mut names = Vocabulary::default();
        let case = Case::parse(&std::fs::read_to_string(path)?, &mut names)?;
        let query = Query { gravity_aligned: case.gravity_aligned, ..Query::new(&case.query) };
        let start = Instant::now();
        let outcome = align(&case.reference, &query, &names, solver);
        answers.push(case.answer(&outcome, start.elapsed().as_secs_f64() * 1e3));
    }
    std::fs::write(out, serde_json::to_vec(&answers)?)?;
    Ok(())
}
