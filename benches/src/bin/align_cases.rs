//! Writes alignment cases with truth: `cargo run -r -p benches --bin align_cases -- DIR SEED PER_KIND`.

use benches::cases::{KINDS, make};
use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let mut args = std::env::args().skip(1);
    let dir = PathBuf::from(args.next().ok_or_else(|| std::io::Error::other("want DIR SEED PER_KIND"))?);
    let seed = args.next().and_then(|s| s.parse().ok()).unwrap_or(1);
    let per_kind = args.next().and_then(|s| s.parse().ok()).unwrap_or(6);
    for sub in ["cases", "truth"] {
        std::fs::create_dir_all(dir.join(sub))?;
    }
    for kind in KINDS {
        for k in 0..per_kind {
            let c = make(kind, seed, k);
            std::fs::write(dir.join("cases").join(format!("{}.json", c.id)), serde_json::to_vec(&c.case)?)?;
            std::fs::write(dir.join("truth").join(format!("{}.json", c.id)), serde_json::to_vec(&c.truth)?)?;
        }
    }
    Ok(())
}
