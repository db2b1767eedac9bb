//! Aggregated figures of real rooms, for comparison. Training side only.
//!
//! Source: `graphs_train.json` (1,178 training scans of 3DSSG_subset, splits united) and
//! `changes_train.json` (793 training rescans of `3RScan.json`); numbers of rescans: validation
//! rooms in `3RScan.json`.

/// Instances per class of l20 and without one, in 30,479.
pub(crate) const L20: [(&str, f64); 21] = [
    ("none", 14205.0),
    ("wall", 4936.0),
    ("chair", 2353.0),
    ("cabinet", 1279.0),
    ("otherfurniture", 1243.0),
    ("floor", 1191.0),
    ("table", 1077.0),
    ("window", 760.0),
    ("door", 742.0),
    ("curtain", 646.0),
    ("picture", 421.0),
    ("sink", 315.0),
    ("sofa", 287.0),
    ("desk", 251.0),
    ("bed", 226.0),
    ("counter", 219.0),
    ("toilet", 128.0),
    ("refridgerator", 72.0),
    ("bathtub", 54.0),
    ("shower curtain", 44.0),
    ("bookshelf", 30.0),
];

/// Relations per predicate, in 81,190.
pub(crate) const PREDICATES: [(&str, f64); 25] = [
    ("close by", 12484.0),
    ("right", 12016.0),
    ("left", 12016.0),
    ("standing on", 9992.0),
    ("attached to", 7518.0),
    ("front", 6766.0),
    ("behind", 6766.0),
    ("same as", 2562.0),
    ("lying on", 2024.0),
    ("lower than", 1831.0),
    ("higher than", 1831.0),
    ("hanging on", 1205.0),
    ("bigger than", 923.0),
    ("smaller than", 923.0),
    ("supported by", 821.0),
    ("same symmetry as", 256.0),
    ("standing in", 245.0),
    ("build in", 240.0),
    ("connected to", 193.0),
    ("leaning against", 191.0),
    ("belonging to", 171.0),
    ("lying in", 96.0),
    ("part of", 66.0),
    ("cover", 45.0),
    ("hanging in", 9.0),
];

/// Instances by the number of `standing on`, `lying on`, `supported by` steps below them.
pub(crate) const CHAINS: [f64; 5] = [17670.0, 10487.0, 2227.0, 91.0, 4.0];

/// Moves per rescan by label.
pub(crate) const MOVE_RATES: [(&str, f64); 22] = [
    ("armchair", 0.5844),
    ("bag", 0.0923),
    ("bed", 0.2468),
    ("bench", 0.24),
    ("box", 0.0743),
    ("cabinet", 0.0437),
    ("chair", 0.4749),
    ("coffee table", 0.5357),
    ("commode", 0.175),
    ("couch", 0.4038),
    ("curtain", 0.0),
    ("cushion", 0.24),
    ("desk", 0.1453),
    ("door", 0.0933),
    ("nightstand", 0.2162),
    ("pillow", 0.0958),
    ("shelf", 0.0408),
    ("sofa", 0.2215),
    ("stool", 0.39),
    ("table", 0.2847),
    ("trash can", 0.293),
    ("wardrobe", 0.0491),
];
