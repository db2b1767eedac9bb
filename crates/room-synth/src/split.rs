//! Train, validation and test rooms: other seeds, and other shapes.

use crate::rng::Draw;

/// Which part of the generated world: disjoint seed streams and disjoint ranges of every shape
/// parameter.
///
/// A shape parameter is a position in [0, 1), cut into [`SLOTS`] equal slots. Of every six
/// neighbouring slots four belong to training, one to validation and one to test. A size that a
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
        match (position.clamp(0.0, 0.999_999) * SLOTS as f32) as usize % 6 {
            2 => Self::Validation,
            5 => Self::Test,
            _ => Self::Train,
        }
    }

    /// A position owned by this split.
    pub(crate) fn position(self, draw: &mut Draw) -> f32 {
        let slots: &[usize] = match self {
            Self::Train => &[0, 1, 3, 4],
            Self::Validation => &[2],
            Self::Test => &[5],
        };
        let slot = 6 * draw.below(SLOTS / 6) + slots[draw.below(slots.len())];
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
            assert!((mean - 0.5).abs() < 0.08, "{mean}");
        }
    }
}
