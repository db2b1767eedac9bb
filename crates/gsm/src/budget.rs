//! The working resolution that a time budget permits.

/// Chooses [`Params::max_pixels`](crate::Params::max_pixels) from the times that frames took. The crate reads no
/// clock: the caller measures, and hands the choice to [`Map::set_max_pixels`](crate::Map::set_max_pixels).
///
/// Halving both sides of the image divides its cost by something up to four. The scale goes down when the median of
/// the last frames is over the budget, and up only when four and a half times the median is within it, so that it
/// does not swing.
#[derive(Debug, Clone)]
pub struct Budget {
    secs: f64,
    largest: u32,
    pixels: u32,
    recent: Vec<f64>,
}

/// Frames that are measured at a scale before it changes.
const FRAMES: usize = 9;
/// Least working pixels.
const LEAST: u32 = 1200;

impl Budget {
    /// A budget of `secs` per frame for images of up to `largest` pixels, beginning with `pixels`.
    pub fn new(secs: f64, largest: u32, pixels: u32) -> Self {
        Self { secs, largest, pixels: pixels.clamp(LEAST.min(largest), largest), recent: Vec::new() }
    }

    /// Takes in the time of a frame; returns the number of working pixels for the next one.
    pub fn spent(&mut self, secs: f64) -> u32 {
        self.recent.push(secs);
        if self.recent.len() == FRAMES {
            self.recent.sort_by(f64::total_cmp);
            let median = self.recent[FRAMES / 2];
            self.recent.clear();
            if median > self.secs {
                self.pixels = (self.pixels / 4).max(LEAST.min(self.largest));
            } else if 4.5 * median <= self.secs {
                self.pixels = self.pixels.saturating_mul(4).min(self.largest);
            }
        }
        self.pixels
    }

    /// The number of working pixels chosen.
    pub fn pixels(&self) -> u32 {
        self.pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// For a machine whose cost is a fixed part and a part per pixel, the scale settles on the largest one that
        /// is within the budget, or within a step below it, and stays.
        #[test]
        fn settles_within_the_budget(fixed in 0.0..0.002f64, per_pixel in 1e-9..1e-6f64, secs in 0.0021..0.05f64) {
            let cost = |pixels: u32| fixed + per_pixel * f64::from(pixels);
            let mut budget = Budget::new(secs, 307_200, 40_000);
            let mut last = budget.pixels();
            for _ in 0..200 {
                last = budget.spent(cost(last));
            }
            let settled = last;
            for _ in 0..100 {
                last = budget.spent(cost(last));
                prop_assert_eq!(last, settled);
            }
            prop_assert!(cost(settled) <= secs || settled == LEAST);
            prop_assert!(settled == 307_200 || 4.5 * cost(settled) > secs);
        }
    }
}
