//! Sides of boxes that two views may both have seen.

use std::f32::consts::TAU;

/// Noise of a side that was seen, metres.
pub(crate) const NOISE: f32 = 0.04;
/// Share of the sides that both saw, of boxes of no length; the length at which it is half of that, metres.
const SHARE: f32 = 0.8;
const LONG: f32 = 1.0;
/// How far a side that was cut off lies from where it is, metres, and by how much of the length more.
const CUT: [f32; 2] = [0.1, 0.3];

/// The distance d of two sides that would be one: `a N(d; s) + (1 - a) exp(-|d| / l) / 2l`, for a side that both saw,
/// or one that an image or another object cut off.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    share: f32,
    reach: f32,
}

impl Seen {
    /// Sides of boxes so long in their direction, metres.
    pub(crate) fn of(length: f32) -> Self {
        Self { share: SHARE / (1.0 + length / LONG), reach: CUT[0] + CUT[1] * length }
    }

    fn both(self, d: f32, noise: f32) -> f32 {
        self.share * (-0.5 * (d / noise).powi(2)).exp() / (noise * TAU.sqrt())
    }

    fn cut(self, d: f32) -> f32 {
        (1.0 - self.share) * (-d.abs() / self.reach).exp() / (2.0 * self.reach)
    }

    /// Density of the distance.
    pub(crate) fn density(self, d: f32) -> f32 {
        self.both(d, NOISE) + self.cut(d)
    }

    /// The chance that both saw the side, if what was seen is off by `noise`.
    pub(crate) fn chance(self, d: f32, noise: f32) -> f32 {
        let both = self.both(d, noise);
        both / (both + self.cut(d))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_sums_to_one() {
        for length in [0.1, 0.7, 3.0] {
            let seen = Seen::of(length);
            let sum: f32 = (-20_000..20_000).map(|k| seen.density(k as f32 * 1e-3) * 1e-3).sum();
            assert!((sum - 1.0).abs() < 0.01, "{length}: {sum}");
            assert!(seen.chance(0.0, NOISE) > 0.6 && seen.chance(0.5, NOISE) < 1e-6);
        }
    }
}
