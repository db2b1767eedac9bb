//! Label sets: which raw 3RScan labels and which predicates a benchmark counts.
//!
//! Names cross files and crate borders, indices never do. The order of [`LabelSet::classes`] and
//! [`LabelSet::predicates`] is that of the SGFN networks' outputs.

use std::sync::LazyLock;

/// The 20 classes, in network order.
const L20: [&str; 20] = [
    "bathtub",
    "bed",
    "bookshelf",
    "cabinet",
    "chair",
    "counter",
    "curtain",
    "desk",
    "door",
    "floor",
    "otherfurniture",
    "picture",
    "refridgerator",
    "shower curtain",
    "sink",
    "sofa",
    "table",
    "toilet",
    "wall",
    "window",
];

/// The seven support relations that l20 scores, in network order.
const SUPPORT: [&str; 7] =
    ["attached to", "build in", "connected to", "hanging on", "part of", "standing on", "supported by"];

/// The 26 predicates of the 3DSSG subset, in network order.
const PREDICATES: [&str; 26] = [
    "attached to",
    "behind",
    "belonging to",
    "bigger than",
    "build in",
    "close by",
    "connected to",
    "cover",
    "front",
    "hanging in",
    "hanging on",
    "higher than",
    "inside",
    "leaning against",
    "left",
    "lower than",
    "lying in",
    "lying on",
    "part of",
    "right",
    "same as",
    "same symmetry as",
    "smaller than",
    "standing in",
    "standing on",
    "supported by",
];

/// Index in `relationships.json` = index here; 0 is `none`. The list of the file has 41 lines, of
/// which these are the first 27.
pub const RELATIONSHIP_IDS: [&str; 27] = [
    "none",
    "supported by",
    "left",
    "right",
    "front",
    "behind",
    "close by",
    "inside",
    "bigger than",
    "smaller than",
    "higher than",
    "lower than",
    "same symmetry as",
    "same as",
    "attached to",
    "standing on",
    "lying on",
    "hanging on",
    "connected to",
    "leaning against",
    "part of",
    "belonging to",
    "build in",
    "standing in",
    "cover",
    "lying in",
    "hanging in",
];

static L20_OF_RAW: LazyLock<Vec<(&str, &str)>> = LazyLock::new(|| {
    let mut rows: Vec<_> = include_str!("l20.tsv")
        .lines()
        .filter(|l| !l.starts_with('#'))
        .filter_map(|l| l.split_once('\t'))
        .collect();
    rows.sort_unstable();
    rows
});

static L160: LazyLock<Vec<&str>> =
    LazyLock::new(|| include_str!("l160.txt").lines().filter(|l| !l.starts_with('#')).collect());

/// A set of object classes and predicates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LabelSet {
    /// 20 ScanNet classes, 7 support predicates.
    L20,
    /// 160 raw labels, 26 predicates.
    L160,
}

impl LabelSet {
    /// `l20` or `l160`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::L20 => "l20",
            Self::L160 => "l160",
        }
    }

    /// The set of that name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        [Self::L20, Self::L160].into_iter().find(|s| s.name() == name)
    }

    /// Class names in network order.
    #[must_use]
    pub fn classes(self) -> &'static [&'static str] {
        match self {
            Self::L20 => &L20,
            Self::L160 => &L160,
        }
    }

    /// Scored predicates in network order.
    #[must_use]
    pub fn predicates(self) -> &'static [&'static str] {
        match self {
            Self::L20 => &SUPPORT,
            Self::L160 => &PREDICATES,
        }
    }

    /// The class of a raw 3RScan label, `None` for clutter.
    ///
    /// ```
    /// use scan3r::LabelSet;
    /// assert_eq!(LabelSet::L20.class_of("armchair"), Some("chair"));
    /// assert_eq!(LabelSet::L20.class_of("pillow"), None);
    /// assert_eq!(LabelSet::L160.class_of("pillow"), Some("pillow"));
    /// ```
    #[must_use]
    pub fn class_of(self, raw: &str) -> Option<&'static str> {
        match self {
            Self::L20 => L20_OF_RAW.binary_search_by(|(k, _)| (*k).cmp(raw)).ok().map(|i| L20_OF_RAW[i].1),
            Self::L160 => L160.binary_search(&raw).ok().map(|i| L160[i]),
        }
    }
}
