//! What it says of two boxes that their sides lie so far apart, and their classes are these.

use crate::LabelId;
use crate::robust::index::Item;
use crate::seen::Seen;

/// `ln f` of the distance of two sides by steps of 1 / 128 m, for the lengths 0.1, 0.2, ... 3.2 m.
pub(super) struct Sides(Vec<[f32; 257]>);

impl Sides {
    pub(super) fn new() -> Self {
        let table = |class: i32| {
            let seen = Seen::of(0.1 * 2f32.powi(class));
            std::array::from_fn(|k| seen.density(k as f32 / 128.0).ln())
        };
        Self((0..6).map(table).collect())
    }

    /// Class of a length.
    pub(super) fn class(length: f32) -> u8 {
        (length / 0.1).log2().round().clamp(0.0, 5.0) as u8
    }

    /// Of boxes of a class of lengths whose sides are `d` apart.
    #[inline]
    pub(super) fn ln_density(&self, class: u8, d: f32) -> f32 {
        self.0[usize::from(class)][((d.abs() * 128.0) as usize).min(256)]
    }
}

/// `ln` of `sum p_q(c) p_r(c) / pi(c)` for every pair, row by row of the reference; shares pi are those of both graphs.
pub(super) fn classes(reference: &[Item], query: &[Item]) -> Vec<f32> {
    let mut mass: Vec<(LabelId, f32)> = Vec::new();
    for item in reference.iter().chain(query) {
        for c in item.classes() {
            let p = item.named_probability(c).unwrap_or(0.0);
            match mass.iter_mut().find(|m| m.0 == c) {
                Some(m) => m.1 += p,
                None => mass.push((c, p)),
            }
        }
    }
    mass.sort_by_key(|m| m.0);
    let kinds = (mass.len() as f32).max(10.0);
    let total: f32 = mass.iter().map(|m| m.1).sum::<f32>() + kinds;
    let share = |c: LabelId| {
        let m = mass.binary_search_by_key(&c, |m| m.0).map_or(0.0, |k| mass[k].1);
        (m + 1.0) / total
    };
    let ratio = |r: &Item, q: &Item| {
        let (other_r, other_q) = (r.other_probability(kinds), q.other_probability(kinds));
        let of = |c| {
            r.named_probability(c).unwrap_or(other_r) * q.named_probability(c).unwrap_or(other_q) / share(c)
        };
        let both = r.classes().chain(q.classes().filter(|&c| r.named_probability(c).is_none()));
        both.map(of).sum::<f32>().max(1e-3).ln()
    };
    reference.iter().flat_map(|r| query.iter().map(move |q| (r, q))).map(|(r, q)| ratio(r, q)).collect()
}
