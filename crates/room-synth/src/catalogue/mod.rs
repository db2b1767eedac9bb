//! What there is: label, shapes, sizes, where it goes, how often it moves.

mod furniture;
mod things;

use crate::relations::Contact;
use crate::shapes::Family::{self, *};
use furniture::FURNITURE_KINDS;
use things::THING_KINDS;

/// Where an object can go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Place {
    /// On the floor, its back to a wall.
    Back,
    /// On the floor, anywhere.
    Free,
    /// On the floor round a host, facing it.
    Around(&'static [&'static str]),
    /// On the floor beside a host.
    Beside(&'static [&'static str]),
    /// In front of a host, at some distance.
    Before(&'static [&'static str]),
    /// On top of a host.
    On(&'static [&'static str], Contact),
    /// Between the boards of a host.
    In(&'static [&'static str], Contact),
    /// At a wall, the middle of its height between two heights.
    Wall(f32, f32, Contact),
    /// On the floor, tilted against a wall.
    Lean,
    /// Under the ceiling.
    Ceiling,
}

/// One label.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kind {
    pub(crate) label: &'static str,
    /// Shapes with their mean width, depth, height in metres.
    pub(crate) shapes: &'static [(Family, [f32; 3])],
    /// Standard deviation of the logarithm of each extent.
    pub(crate) spread: f32,
    /// Contact with the floor where it stands on the floor.
    pub(crate) floor: Contact,
    pub(crate) places: &'static [(f32, Place)],
    /// Probabilities per rescan: moved, removed, deformed.
    pub(crate) change: [f32; 3],
    /// Share of the light that comes back (1 white plaster, 0.1 black glass).
    pub(crate) albedo: f32,
}

pub(super) const SEATS: &[&str] = &["sofa", "couch", "armchair", "bed", "bench"];
pub(super) const SOFAS: &[&str] = &["sofa", "couch", "armchair"];
pub(super) const TABLES: &[&str] = &["table", "dining table", "desk"];
pub(super) const TOPS: &[&str] = &[
    "table",
    "desk",
    "commode",
    "cabinet",
    "nightstand",
    "windowsill",
    "counter",
    "kitchen counter",
    "coffee table",
    "tv stand",
    "side table",
    "couch table",
    "dining table",
    "bath cabinet",
    "washing machine",
    "bench",
    "stool",
];
pub(super) const BOARDS: &[&str] = &["shelf", "rack", "bookshelf"];
pub(super) const FURNITURE: &[&str] =
    &["desk", "table", "cabinet", "commode", "sofa", "bed", "wardrobe", "counter"];
pub(super) const LIE: Contact = Contact::LyingOn;
pub(super) const STAND: Contact = Contact::StandingOn;
pub(super) const HANG: Contact = Contact::HangingOn;
pub(super) const ATTACH: Contact = Contact::AttachedTo;

pub(super) const fn kind(
    label: &'static str,
    shapes: &'static [(Family, [f32; 3])],
    places: &'static [(f32, Place)],
    change: [f32; 3],
    albedo: f32,
) -> Kind {
    Kind { label, shapes, spread: 0.3, floor: STAND, places, change, albedo }
}

pub(super) const fn lying(mut k: Kind) -> Kind {
    k.floor = LIE;
    k
}

pub(super) const fn spread(mut k: Kind, spread: f32) -> Kind {
    k.spread = spread;
    k
}

pub(super) const CHAIRS: &[(Family, [f32; 3])] = &[
    (ChairLegs, [0.46, 0.5, 0.85]),
    (ChairSled, [0.55, 0.56, 0.82]),
    (ChairOffice, [0.62, 0.62, 0.9]),
    (ChairShell, [0.52, 0.54, 0.78]),
];
pub(super) const SOFA_SHAPES: &[(Family, [f32; 3])] =
    &[(Sofa, [1.8, 0.9, 0.8]), (SofaCorner, [2.2, 1.5, 0.78]), (Sofa, [1.4, 0.82, 0.82])];
pub(super) const SMALL_TABLES: &[(Family, [f32; 3])] = &[
    (Table, [0.95, 0.6, 0.43]),
    (TableRound, [0.75, 0.75, 0.46]),
    (TableShelf, [1.0, 0.58, 0.44]),
    (Block, [0.8, 0.6, 0.38]),
];
pub(super) const HEAPS: &[(Family, [f32; 3])] = &[
    (Heap, [0.3, 0.28, 0.25]),
    (Block, [0.28, 0.22, 0.2]),
    (Bottle, [0.1, 0.1, 0.27]),
    (Tower, [0.25, 0.3, 0.4]),
];
pub(super) const CABINET_SHAPES: &[(Family, [f32; 3])] = &[
    (Cabinet, [0.95, 0.5, 1.0]),
    (CabinetLegs, [0.9, 0.45, 0.9]),
    (Drawers, [0.7, 0.48, 0.95]),
    (Cabinet, [0.9, 0.5, 1.75]),
];

/// The row of a label.
pub(crate) fn find(label: &str) -> Option<&'static Kind> {
    [FURNITURE_KINDS, THING_KINDS]
        .iter()
        .find_map(|t| t.binary_search_by(|k| k.label.cmp(label)).ok().map(|i| &t[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_sorted_known_to_3dssg_and_hosts_exist() {
        for t in [FURNITURE_KINDS, THING_KINDS] {
            assert!(t.windows(2).all(|w| w[0].label < w[1].label));
        }
        for k in FURNITURE_KINDS.iter().chain(THING_KINDS) {
            assert!(scan3r::LabelSet::L160.class_of(k.label).is_some(), "{}", k.label);
            for (_, place) in k.places {
                if let Place::On(hosts, _)
                | Place::In(hosts, _)
                | Place::Around(hosts)
                | Place::Beside(hosts) = place
                {
                    for h in *hosts {
                        let built = ["windowsill", "kitchen counter", "kitchen cabinet"];
                        assert!(find(h).is_some() || built.contains(h), "{} on {h}", k.label);
                    }
                }
            }
        }
    }
}
