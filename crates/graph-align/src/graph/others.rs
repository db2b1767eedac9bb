//! The classes that a node may have beside its own.

use super::Node;
use crate::LabelId;
use std::ops::{Deref, DerefMut};

/// Classes and their probabilities, at most [`Node::MAX_OTHERS`]: a slice of pairs that needs no memory of its
/// own.
///
/// ```
/// use graph_align::{LabelId, Others};
/// let others: Others = [(LabelId(4), 0.3), (LabelId(1), 0.2)].into_iter().collect();
/// assert_eq!(others.first(), Some(&(LabelId(4), 0.3)));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Others {
    /// Places that are not used have no number for a probability.
    list: [(LabelId, f32); Node::MAX_OTHERS],
}

impl Default for Others {
    fn default() -> Self {
        Self { list: [(LabelId(0), f32::NAN); Node::MAX_OTHERS] }
    }
}

impl Others {
    fn count(&self) -> usize {
        self.list.iter().take_while(|o| !o.1.is_nan()).count()
    }
}

impl FromIterator<(LabelId, f32)> for Others {
    /// Of the first [`Node::MAX_OTHERS`], up to one whose probability is no number.
    fn from_iter<I: IntoIterator<Item = (LabelId, f32)>>(items: I) -> Self {
        let mut out = Self::default();
        for (slot, item) in out.list.iter_mut().zip(items) {
            *slot = item;
        }
        out
    }
}

impl Deref for Others {
    type Target = [(LabelId, f32)];

    fn deref(&self) -> &Self::Target {
        &self.list[..self.count()]
    }
}

impl DerefMut for Others {
    fn deref_mut(&mut self) -> &mut Self::Target {
        let n = self.count();
        &mut self.list[..n]
    }
}

impl PartialEq for Others {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<'a> IntoIterator for &'a Others {
    type Item = &'a (LabelId, f32);
    type IntoIter = std::slice::Iter<'a, (LabelId, f32)>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}
