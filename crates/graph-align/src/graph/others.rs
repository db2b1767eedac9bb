//! The classes that a node may have beside its own.

use super::Node;
use crate::LabelId;

/// Classes and their probabilities, at most [`Node::MAX_OTHERS`], in 12 bytes.
///
/// ```
/// use graph_align::{LabelId, Others};
/// let others: Others = [(LabelId(4), 0.3), (LabelId(1), 0.2)].into_iter().collect();
/// assert_eq!(others.iter().next(), Some((LabelId(4), 0.3)));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Others {
    labels: [LabelId; Node::MAX_OTHERS],
    /// Places that are not used have no number for a probability.
    scores: [f32; Node::MAX_OTHERS],
}

impl Default for Others {
    fn default() -> Self {
        Self { labels: [LabelId(0); Node::MAX_OTHERS], scores: [f32::NAN; Node::MAX_OTHERS] }
    }
}

impl Others {
    /// The classes and their probabilities, in order.
    pub fn iter(&self) -> impl Iterator<Item = (LabelId, f32)> + Clone + use<> {
        self.labels.into_iter().zip(self.scores).take_while(|o| !o.1.is_nan())
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.iter().count()
    }

    /// True without any.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl FromIterator<(LabelId, f32)> for Others {
    /// Of the first [`Node::MAX_OTHERS`], up to one whose probability is no number.
    fn from_iter<I: IntoIterator<Item = (LabelId, f32)>>(items: I) -> Self {
        let mut out = Self::default();
        let slots = out.labels.iter_mut().zip(&mut out.scores);
        for ((label, score), item) in slots.zip(items) {
            (*label, *score) = item;
        }
        out
    }
}

impl PartialEq for Others {
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}
