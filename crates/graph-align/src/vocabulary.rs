//! Names of classes and predicates, and the numbers that stand for them inside.

use crate::Error;
use std::collections::BTreeMap;

/// A class; its name is in the [`Vocabulary`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LabelId(pub u16);

/// A predicate; its name is in the [`Vocabulary`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PredicateId(pub u16);

/// Names in the order in which they were first used. Graphs that meet must share one vocabulary.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Vocabulary {
    labels: Names,
    predicates: Names,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Names {
    list: Vec<String>,
    index: BTreeMap<String, u16>,
}

impl Names {
    fn id(&mut self, name: &str, field: &'static str) -> Result<u16, Error> {
        if let Some(&id) = self.index.get(name) {
            return Ok(id);
        }
        let id = u16::try_from(self.list.len())
            .map_err(|_| Error::value(field, "more than 65,536 different names"))?;
        self.list.push(name.to_owned());
        self.index.insert(name.to_owned(), id);
        Ok(id)
    }
}

impl Vocabulary {
    /// A vocabulary with these names, in this order.
    ///
    /// # Errors
    /// More than 65,536 names.
    pub fn new<'a>(
        labels: impl IntoIterator<Item = &'a str>,
        predicates: impl IntoIterator<Item = &'a str>,
    ) -> Result<Self, Error> {
        let mut v = Self::default();
        for l in labels {
            v.label(l)?;
        }
        for p in predicates {
            v.predicate(p)?;
        }
        Ok(v)
    }

    /// The class of that name, added where it is new.
    ///
    /// # Errors
    /// More than 65,536 names.
    pub fn label(&mut self, name: &str) -> Result<LabelId, Error> {
        self.labels.id(name, "label").map(LabelId)
    }

    /// The predicate of that name, added where it is new.
    ///
    /// # Errors
    /// More than 65,536 names.
    pub fn predicate(&mut self, name: &str) -> Result<PredicateId, Error> {
        self.predicates.id(name, "predicate").map(PredicateId)
    }

    /// The class of that name, if it is known.
    #[must_use]
    pub fn find_label(&self, name: &str) -> Option<LabelId> {
        self.labels.index.get(name).copied().map(LabelId)
    }

    /// The predicate of that name, if it is known.
    #[must_use]
    pub fn find_predicate(&self, name: &str) -> Option<PredicateId> {
        self.predicates.index.get(name).copied().map(PredicateId)
    }

    /// A class's name; `?` for an id of another vocabulary.
    #[must_use]
    pub fn label_name(&self, id: LabelId) -> &str {
        self.labels.list.get(usize::from(id.0)).map_or("?", String::as_str)
    }

    /// A predicate's name; `?` for an id of another vocabulary.
    #[must_use]
    pub fn predicate_name(&self, id: PredicateId) -> &str {
        self.predicates.list.get(usize::from(id.0)).map_or("?", String::as_str)
    }

    /// Numbers of classes and of predicates.
    #[must_use]
    pub fn len(&self) -> (usize, usize) {
        (self.labels.list.len(), self.predicates.list.len())
    }

    /// True without any name.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == (0, 0)
    }

    /// A 32-bit FNV-1a hash of all names in order: frames carry it, so that graphs of different
    /// vocabularies are never mixed.
    #[must_use]
    pub fn fingerprint(&self) -> u32 {
        let mut h = 0x811c_9dc5_u32;
        let lists = [&self.labels.list, &self.predicates.list];
        for b in lists.iter().flat_map(|l| l.iter().flat_map(|n| n.bytes().chain([0])).chain([1])) {
            h = (h ^ u32::from(b)).wrapping_mul(0x0100_0193);
        }
        h
    }
}
