//! The sensor's noise, measured on its first frames.
//!
//! On a plane inverse depth is linear along a row, so the second difference `e = q₋ − 2 q₀ + q₊` of inverse depths
//! holds noise only: for independent errors of depth `σ`, `e z² ~ σ √6`. Its median absolute value is robust against
//! edges. Sensors that quantise (disparity of structured light) show themselves in the gaps between the depths that
//! occur at all: a gap of disparity steps grows with the square of the range, that of a file in millimetres does not.

use crate::{DepthView, NoiseModel, Profile};

/// Range bins of half a metre, from 0.5 to 4.5 m.
const BINS: usize = 8;
/// Second differences in a bin before it counts.
const ENOUGH: usize = 300;

/// Collects the evidence of some frames.
#[derive(Debug, Clone, Default)]
pub struct NoiseMeter {
    /// |e| z² by range.
    bends: [Vec<f32>; BINS],
    /// Whole millimetres that occur as depths, a bit each.
    seen: Vec<u64>,
    frames: u32,
}

/// What was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The profile that fits best, scaled to the measured noise where that can be seen in single frames.
    pub model: NoiseModel,
    /// Standard deviation of neighbouring pixels against each other, in the middle of a range, metres; the median
    /// over ranges of measured to modelled is the scale.
    pub ratio: f32,
    /// Typical gap between the depths that occur around 2.5 m, metres.
    pub step: f32,
    /// Frames that were looked at.
    pub frames: u32,
}

impl NoiseMeter {
    /// Looks at a frame.
    pub fn add(&mut self, view: &DepthView<'_>) {
        let width = view.intrinsics.width() as usize;
        if view.depth.len() != width * view.intrinsics.height() as usize {
            return;
        }
        self.frames += 1;
        self.seen.resize(160, 0);
        for row in view.depth.chunks_exact(width) {
            for &z in row.iter().filter(|z| **z > 0.0 && **z < 10.0) {
                let mm = (z * 1000.0).round() as usize;
                self.seen[(mm / 64).min(159)] |= 1 << (mm % 64);
            }
            for v in row.windows(3) {
                let z = v[1];
                let flat = v.iter().all(|&d| d > 0.3 && (d - z).abs() < 0.05 * z);
                let bin = (z - 0.5) / 0.5;
                if flat && bin >= 0.0 && (bin as usize) < BINS {
                    let bend = (1.0 / v[0] - 2.0 / z + 1.0 / v[2]).abs() * z * z;
                    let list = &mut self.bends[bin as usize];
                    if list.len() < 200_000 {
                        list.push(bend);
                    }
                }
            }
        }
    }

    /// The noise of the frames so far; `None` when too little was seen.
    pub fn measured(&self) -> Option<Measured> {
        let step = self.step(2000, 3000).or_else(|| self.step(1000, 2000).map(|s| s * 2.8))?;
        // Median |x| of a normal variable is 0.6745 sigma.
        let sigmas: Vec<(f32, f32)> = self
            .bends
            .iter()
            .enumerate()
            .filter(|(_, b)| b.len() >= ENOUGH)
            .map(|(k, b)| {
                let mut sorted = b.clone();
                let middle = sorted.len() / 2;
                let median = *sorted.select_nth_unstable_by(middle, f32::total_cmp).1;
                (0.75 + 0.5 * k as f32, median / (0.6745 * 6f32.sqrt()))
            })
            .collect();
        if sigmas.is_empty() {
            return None;
        }
        let ratio = |profile: Profile| {
            let mut all: Vec<f32> =
                sigmas.iter().map(|&(z, s)| s / NoiseModel::of(profile).sigma(z)).collect();
            all.sort_by(f32::total_cmp);
            all[all.len() / 2]
        };
        // Disparity steps of the first Kinect are 11 mm at 2 m; files have steps of 1 mm.
        let profile = if step > 0.004 {
            Profile::Structured
        } else if ratio(Profile::TofPhone) > 0.2 {
            Profile::TofPhone
        } else {
            Profile::Ideal
        };
        // Errors that neighbours share do not show in their differences: only independent ones are scaled.
        let scale = if profile == Profile::TofPhone { ratio(profile).clamp(0.25, 4.0) } else { 1.0 };
        Some(Measured {
            model: NoiseModel { profile, scale },
            ratio: ratio(profile),
            step,
            frames: self.frames,
        })
    }

    /// Mean gap between the millimetres that occur in a range, metres; `None` when few occur.
    fn step(&self, from: usize, to: usize) -> Option<f32> {
        let occurs = |mm: &usize| self.seen.get(mm / 64).is_some_and(|w| w >> (mm % 64) & 1 == 1);
        let all: Vec<usize> = (from..to).filter(occurs).collect();
        let (first, last) = (all.first()?, all.last()?);
        (all.len() >= 20).then(|| (last - first) as f32 / (all.len() - 1) as f32 * 1e-3)
    }
}
