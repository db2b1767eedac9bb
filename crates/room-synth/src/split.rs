//! Train, validation and test rooms: other seeds, and other shapes.

use crate::rng::Draw;

/// Which part of the generated world: disjoint seed streams and disjoint ranges of every shape
/// parameter.
///
/// A shape parameter is a position in [0, 1), cut into [`SLOTS`] equal slots. Sixteen
/// belong to training, four to validation and four to test, interleaved. A size that a
/// test chair has, no training chair of that shape has; a training table may well have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Split {
    /// For fitting weights.
    Train,
    /// For choosing among fitted weights.
    Validation,
    /// For the benchmark.
    Test,
}

/// Number of slots of a shape parameter.
pub const SLOTS: usize = 24;

impl Split {
    /// `train`, `validation` or `test`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
        }
    }

    /// The split of that name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        [Self::Train, Self::Validation, Self::Test].into_iter().find(|s| s.name() == name)
    }

    /// The split that owns a position of a shape parameter.
    #[must_use]
    pub fn owner(position: f32) -> Self {
        let slot = (position.clamp(0.0, 0.999_999) * SLOTS as f32) as usize;
        [Self::Validation, Self::Test].into_iter().find(|s| s.slots().contains(&slot)).unwrap_or(Self::Train)
    }

    /// Its slots. All three sets have the mean 11.5 and about the variance of all slots (47.9).
    fn slots(self) -> &'static [usize] {
        match self {
            Self::Train => &[0, 1, 4, 5, 6, 9, 10, 11, 12, 13, 14, 17, 18, 19, 22, 23],
            Self::Validation => &[3, 7, 16, 20],
            Self::Test => &[2, 8, 15, 21],
        }
    }

    /// A position owned by this split.
    pub(crate) fn position(self, draw: &mut Draw) -> f32 {
        let slots = self.slots();
        let slot = slots[draw.below(slots.len())];
        // A margin keeps rounding from moving a value across the border of its slot.
        (slot as f32 + draw.range(0.02, 0.98)) / SLOTS as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_belong_to_their_split_and_cover_the_range() {
        let mut draw = Draw::new(3, "split", &[]);
        for split in [Split::Train, Split::Validation, Split::Test] {
            let xs: Vec<f32> = (0..2000).map(|_| split.position(&mut draw)).collect();
            assert!(xs.iter().all(|&x| Split::owner(x) == split));
            assert!(xs.iter().any(|&x| x < 0.25) && xs.iter().any(|&x| x > 0.75));
            let mean = xs.iter().sum::<f32>() / 2000.0;
            assert!((mean - 0.5).abs() < 0.02, "{mean}");
        }
    }
}
