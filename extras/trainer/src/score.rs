//! Recall per output over graphs of each kind.

use candle_core::{Result, Tensor};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Hits and targets per output.
#[derive(Clone, Default)]
pub struct Tally {
    counts: BTreeMap<i64, (u64, u64)>,
}

impl Tally {
    pub fn add(&mut self, logits: &Tensor, targets: &[i64]) -> Result<()> {
        if targets.is_empty() {
            return Ok(());
        }
        let best = logits.argmax(1)?.to_vec1::<u32>()?;
        for (b, &t) in best.iter().zip(targets).filter(|(_, t)| **t >= 0) {
            let c = self.counts.entry(t).or_default();
            c.1 += 1;
            c.0 += u64::from(i64::from(*b) == t);
        }
        Ok(())
    }

    /// Share of right answers, and mean of the recalls, percent; without output `skip`.
    pub fn rates(&self, skip: Option<i64>) -> (f64, f64) {
        let kept: Vec<_> = self.counts.iter().filter(|(k, _)| Some(**k) != skip).map(|(_, c)| *c).collect();
        let (hits, all) = kept.iter().fold((0, 0), |a, c| (a.0 + c.0, a.1 + c.1));
        let mean = kept.iter().map(|c| c.0 as f64 / c.1 as f64).sum::<f64>() / kept.len().max(1) as f64;
        (100.0 * hits as f64 / all.max(1) as f64, 100.0 * mean)
    }

    pub fn table(&self, names: &[String]) -> String {
        let mut out = String::new();
        for (k, (hit, of)) in &self.counts {
            let _ = writeln!(out, "| {} | {of} | {:.1} |", names[*k as usize], 100.0 * *hit as f64 / *of as f64);
        }
        out
    }
}
