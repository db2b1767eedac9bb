//! What there is: label, shapes, sizes, where it goes, how often it moves.

use crate::relations::Contact;
use crate::shapes::Family::{self, *};

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

const SEATS: &[&str] = &["sofa", "couch", "armchair", "bed", "bench"];
const SOFAS: &[&str] = &["sofa", "couch", "armchair"];
const TABLES: &[&str] = &["table", "dining table", "desk"];
const TOPS: &[&str] = &[
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
const BOARDS: &[&str] = &["shelf", "rack", "bookshelf"];
const FURNITURE: &[&str] = &["desk", "table", "cabinet", "commode", "sofa", "bed", "wardrobe", "counter"];
const LIE: Contact = Contact::LyingOn;
const STAND: Contact = Contact::StandingOn;
const HANG: Contact = Contact::HangingOn;
const ATTACH: Contact = Contact::AttachedTo;

const fn kind(
    label: &'static str,
    shapes: &'static [(Family, [f32; 3])],
    places: &'static [(f32, Place)],
    change: [f32; 3],
    albedo: f32,
) -> Kind {
    Kind { label, shapes, spread: 0.3, floor: STAND, places, change, albedo }
}

const fn lying(mut k: Kind) -> Kind {
    k.floor = LIE;
    k
}

const fn spread(mut k: Kind, spread: f32) -> Kind {
    k.spread = spread;
    k
}

const CHAIRS: &[(Family, [f32; 3])] = &[
    (ChairLegs, [0.46, 0.5, 0.85]),
    (ChairSled, [0.55, 0.56, 0.82]),
    (ChairOffice, [0.62, 0.62, 0.9]),
    (ChairShell, [0.52, 0.54, 0.78]),
];
const SOFA_SHAPES: &[(Family, [f32; 3])] =
    &[(Sofa, [1.8, 0.9, 0.8]), (SofaCorner, [2.2, 1.5, 0.78]), (Sofa, [1.4, 0.82, 0.82])];
const SMALL_TABLES: &[(Family, [f32; 3])] = &[
    (Table, [0.95, 0.6, 0.43]),
    (TableRound, [0.75, 0.75, 0.46]),
    (TableShelf, [1.0, 0.58, 0.44]),
    (Block, [0.8, 0.6, 0.38]),
];
const HEAPS: &[(Family, [f32; 3])] = &[
    (Heap, [0.3, 0.28, 0.25]),
    (Block, [0.28, 0.22, 0.2]),
    (Bottle, [0.1, 0.1, 0.27]),
    (Tower, [0.25, 0.3, 0.4]),
];
const CABINET_SHAPES: &[(Family, [f32; 3])] = &[
    (Cabinet, [0.95, 0.5, 1.0]),
    (CabinetLegs, [0.9, 0.45, 0.9]),
    (Drawers, [0.7, 0.48, 0.95]),
    (Cabinet, [0.9, 0.5, 1.75]),
];

/// All labels but those of the building itself, sorted by name.
pub(crate) static KINDS: &[Kind] = &[
    kind(
        "armchair",
        &[(Armchair, [0.78, 0.8, 0.84]), (Armchair, [0.66, 0.7, 0.95]), (ChairSled, [0.66, 0.7, 0.88])],
        &[(0.5, Place::Free), (0.3, Place::Before(SOFAS)), (0.4, Place::Back)],
        [0.58, 0.013, 0.0],
        0.5,
    ),
    kind(
        "backpack",
        &[(Backpack, [0.33, 0.24, 0.45])],
        &[(0.65, Place::Free), (0.2, Place::On(&["chair", "armchair", "bed"], LIE)), (0.15, Place::Back)],
        [0.24, 0.099, 0.03],
        0.3,
    ),
    kind(
        "bag",
        &[(Bag, [0.36, 0.2, 0.38]), (Bag, [0.3, 0.28, 0.3]), (Heap, [0.35, 0.25, 0.25])],
        &[
            (0.5, Place::Free),
            (0.12, Place::Lean),
            (0.2, Place::On(TOPS, LIE)),
            (0.1, Place::Back),
            (0.08, Place::On(&["chair", "bed"], STAND)),
        ],
        [0.09, 0.062, 0.03],
        0.4,
    ),
    kind(
        "basket",
        &[(Basket, [0.4, 0.34, 0.34]), (Basket, [0.3, 0.3, 0.22]), (OpenBox, [0.38, 0.28, 0.25])],
        &[
            (0.45, Place::Back),
            (0.2, Place::In(BOARDS, Contact::StandingIn)),
            (0.25, Place::On(TOPS, STAND)),
            (0.1, Place::Beside(FURNITURE)),
        ],
        [0.126, 0.038, 0.0],
        0.5,
    ),
    kind(
        "bath cabinet",
        &[(Cabinet, [0.6, 0.42, 0.65]), (Drawers, [0.45, 0.36, 0.8]), (CabinetLegs, [0.55, 0.4, 0.75])],
        &[(0.75, Place::Back), (0.25, Place::Wall(1.4, 1.7, ATTACH))],
        [0.15, 0.0, 0.0],
        0.85,
    ),
    kind(
        "bathtub",
        &[(Bathtub, [1.5, 0.75, 0.52]), (Bathtub, [1.25, 0.8, 0.5])],
        &[(1.0, Place::Back)],
        [0.0, 0.0, 0.0],
        0.85,
    ),
    kind(
        "bed",
        &[(Bed, [1.5, 2.0, 0.95]), (BedBox, [1.1, 2.0, 0.75]), (BedFrame, [1.6, 2.05, 1.0])],
        &[(1.0, Place::Back)],
        [0.25, 0.0, 0.0],
        0.7,
    ),
    kind(
        "bench",
        &[(Bench, [1.1, 0.4, 0.46]), (Bench, [0.8, 0.42, 0.5]), (Ottoman, [0.9, 0.5, 0.45])],
        &[(0.5, Place::Back), (0.3, Place::Around(TABLES)), (0.2, Place::Before(&["bed"]))],
        [0.24, 0.011, 0.0],
        0.5,
    ),
    kind(
        "bin",
        &[(Bin, [0.3, 0.3, 0.45])],
        &[(0.6, Place::Back), (0.4, Place::Beside(FURNITURE))],
        [0.4, 0.03, 0.0],
        0.4,
    ),
    lying(kind(
        "blanket",
        &[(Blanket, [1.2, 1.0, 0.14]), (Blanket, [0.8, 0.6, 0.12]), (Pillow, [0.5, 0.4, 0.15])],
        &[(0.65, Place::On(&["bed"], LIE)), (0.3, Place::On(SOFAS, LIE)), (0.05, Place::Free)],
        [0.0, 0.025, 0.22],
        0.6,
    )),
    kind(
        "bookshelf",
        &[(Shelf, [1.0, 0.35, 1.75]), (ShelfBoards, [0.8, 0.34, 1.6])],
        &[(1.0, Place::Back)],
        [0.04, 0.0, 0.0],
        0.55,
    ),
    kind(
        "bottle",
        &[(Bottle, [0.09, 0.09, 0.28])],
        &[(0.7, Place::On(TOPS, STAND)), (0.15, Place::In(BOARDS, STAND)), (0.15, Place::Back)],
        [0.0, 0.03, 0.0],
        0.3,
    ),
    kind(
        "box",
        &[
            (Block, [0.42, 0.32, 0.3]),
            (OpenBox, [0.4, 0.32, 0.28]),
            (Block, [0.28, 0.22, 0.15]),
            (Block, [0.5, 0.4, 0.45]),
        ],
        &[
            (0.33, Place::Back),
            (0.12, Place::Free),
            (0.08, Place::Beside(FURNITURE)),
            (0.2, Place::In(BOARDS, Contact::StandingIn)),
            (0.1, Place::On(&["box"], STAND)),
            (0.2, Place::On(TOPS, STAND)),
            (0.06, Place::On(&["wardrobe", "cabinet", "shelf"], LIE)),
            (0.03, Place::Lean),
        ],
        [0.074, 0.037, 0.0],
        0.6,
    ),
    kind(
        "bucket",
        &[(Bin, [0.3, 0.3, 0.3]), (Pot, [0.28, 0.28, 0.26])],
        &[(0.8, Place::Back), (0.2, Place::On(TOPS, STAND))],
        [0.19, 0.0, 0.0],
        0.5,
    ),
    kind(
        "cabinet",
        CABINET_SHAPES,
        &[(0.88, Place::Back), (0.12, Place::Wall(1.5, 1.9, ATTACH))],
        [0.044, 0.005, 0.0],
        0.6,
    ),
    kind(
        "chair",
        CHAIRS,
        &[(0.62, Place::Around(TABLES)), (0.2, Place::Back), (0.18, Place::Free)],
        [0.475, 0.0255, 0.0],
        0.5,
    ),
    lying(kind(
        "clothes",
        &[(Clothes, [0.5, 0.4, 0.18]), (Hanging, [0.45, 0.15, 0.75]), (Hanging, [0.4, 0.2, 0.6])],
        &[
            (0.3, Place::Wall(1.2, 1.6, HANG)),
            (0.2, Place::Free),
            (0.3, Place::On(&["chair", "bed", "armchair", "sofa"], LIE)),
            (0.1, Place::In(BOARDS, Contact::LyingIn)),
            (0.1, Place::On(TOPS, LIE)),
        ],
        [0.014, 0.029, 0.16],
        0.5,
    )),
    kind(
        "clothes dryer",
        &[(Dryer, [0.95, 0.6, 0.9])],
        &[(0.6, Place::Free), (0.4, Place::Back)],
        [0.29, 0.0, 0.0],
        0.7,
    ),
    lying(kind(
        "clutter",
        &[(Heap, [0.6, 0.4, 0.3]), (Clothes, [0.6, 0.5, 0.25])],
        &[(0.45, Place::Back), (0.4, Place::On(TOPS, LIE)), (0.15, Place::Free)],
        [0.0, 0.01, 0.02],
        0.5,
    )),
    kind(
        "coffee table",
        SMALL_TABLES,
        &[(0.75, Place::Before(SOFAS)), (0.25, Place::Free)],
        [0.53, 0.0, 0.0],
        0.5,
    ),
    kind(
        "commode",
        &[(Drawers, [0.85, 0.45, 0.85]), (CabinetLegs, [0.9, 0.42, 0.75]), (Cabinet, [0.9, 0.42, 0.9])],
        &[(1.0, Place::Back)],
        [0.175, 0.019, 0.0],
        0.6,
    ),
    kind("couch", SOFA_SHAPES, &[(0.85, Place::Back), (0.15, Place::Free)], [0.4, 0.0, 0.0], 0.5),
    kind(
        "couch table",
        SMALL_TABLES,
        &[(0.8, Place::Before(SOFAS)), (0.2, Place::Free)],
        [0.38, 0.0, 0.0],
        0.5,
    ),
    kind(
        "counter",
        &[(Counter, [1.6, 0.6, 0.9]), (Counter, [1.2, 0.5, 1.0])],
        &[(0.7, Place::Back), (0.3, Place::Free)],
        [0.0, 0.0, 0.0],
        0.55,
    ),
    kind("cupboard", CABINET_SHAPES, &[(1.0, Place::Back)], [0.02, 0.0, 0.0], 0.6),
    lying(kind(
        "cushion",
        &[(Pillow, [0.42, 0.4, 0.14])],
        &[(0.7, Place::On(SOFAS, LIE)), (0.2, Place::On(&["chair", "bench"], LIE)), (0.1, Place::Free)],
        [0.24, 0.024, 0.03],
        0.6,
    )),
    kind(
        "decoration",
        &[(Vase, [0.18, 0.18, 0.3]), (Toy, [0.22, 0.2, 0.3]), (Panel, [0.3, 0.04, 0.35])],
        &[
            (0.25, Place::Wall(1.3, 1.8, HANG)),
            (0.45, Place::On(TOPS, STAND)),
            (0.2, Place::In(BOARDS, STAND)),
            (0.1, Place::Back),
        ],
        [0.0, 0.01, 0.0],
        0.6,
    ),
    kind(
        "desk",
        &[(DeskDrawers, [1.35, 0.68, 0.75]), (TablePanel, [1.4, 0.7, 0.74]), (Table, [1.3, 0.68, 0.74])],
        &[(0.85, Place::Back), (0.15, Place::Free)],
        [0.145, 0.0, 0.0],
        0.55,
    ),
    kind(
        "dining chair",
        CHAIRS,
        &[(0.85, Place::Around(TABLES)), (0.15, Place::Free)],
        [0.26, 0.055, 0.0],
        0.5,
    ),
    kind(
        "dining table",
        &[(Table, [1.5, 0.88, 0.74]), (TablePanel, [1.5, 0.85, 0.74])],
        &[(0.8, Place::Free), (0.2, Place::Back)],
        [0.42, 0.0, 0.0],
        0.5,
    ),
    kind(
        "frame",
        &[(Panel, [0.4, 0.03, 0.5]), (Panel, [0.25, 0.06, 0.25])],
        &[
            (0.45, Place::Wall(1.3, 1.8, HANG)),
            (0.35, Place::On(TOPS, STAND)),
            (0.2, Place::In(BOARDS, Contact::StandingIn)),
        ],
        [0.0, 0.014, 0.0],
        0.6,
    ),
    kind(
        "heater",
        &[(Ribs, [0.95, 0.12, 0.6]), (Block, [0.9, 0.12, 0.55])],
        &[(0.65, Place::Wall(0.42, 0.55, Contact::ConnectedTo)), (0.35, Place::Back)],
        [0.0, 0.0, 0.0],
        0.85,
    ),
    spread(
        kind(
            "item",
            HEAPS,
            &[
                (0.22, Place::Back),
                (0.06, Place::Free),
                (0.04, Place::Lean),
                (0.43, Place::On(TOPS, LIE)),
                (0.15, Place::In(BOARDS, STAND)),
                (0.1, Place::Wall(1.2, 1.8, ATTACH)),
            ],
            [0.013, 0.05, 0.0],
            0.5,
        ),
        0.35,
    ),
    kind(
        "kitchen appliance",
        &[(Microwave, [0.45, 0.34, 0.28]), (Kettle, [0.2, 0.17, 0.26]), (Heap, [0.25, 0.22, 0.3])],
        &[
            (0.85, Place::On(&["kitchen counter", "counter", "kitchen cabinet"], STAND)),
            (0.15, Place::On(TOPS, STAND)),
        ],
        [0.0, 0.034, 0.0],
        0.4,
    ),
    kind(
        "lamp",
        &[
            (FloorLamp, [0.36, 0.36, 1.5]),
            (TableLamp, [0.26, 0.26, 0.45]),
            (Pendant, [0.36, 0.36, 0.7]),
            (Disc, [0.3, 0.3, 0.14]),
        ],
        &[(1.0, Place::Free)],
        [0.021, 0.008, 0.0],
        0.75,
    ),
    kind(
        "laptop",
        &[(Screen, [0.35, 0.26, 0.25])],
        &[(1.0, Place::On(TABLES, STAND))],
        [0.05, 0.06, 0.0],
        0.25,
    ),
    kind(
        "light",
        &[(Disc, [0.4, 0.4, 0.1]), (Pendant, [0.3, 0.3, 0.5]), (Disc, [0.9, 0.2, 0.1])],
        &[(1.0, Place::Ceiling)],
        [0.0, 0.004, 0.0],
        0.85,
    ),
    kind(
        "microwave",
        &[(Microwave, [0.48, 0.37, 0.3])],
        &[
            (0.8, Place::On(&["kitchen counter", "counter", "kitchen cabinet"], STAND)),
            (0.2, Place::On(TOPS, STAND)),
        ],
        [0.167, 0.0, 0.0],
        0.3,
    ),
    kind(
        "mirror",
        &[(Panel, [0.6, 0.04, 0.9]), (Panel, [0.5, 0.05, 1.5])],
        &[(0.75, Place::Wall(1.35, 1.6, ATTACH)), (0.25, Place::Back)],
        [0.0, 0.021, 0.0],
        0.12,
    ),
    kind(
        "monitor",
        &[(Screen, [0.52, 0.2, 0.42])],
        &[(1.0, Place::On(TABLES, STAND))],
        [0.0, 0.061, 0.0],
        0.22,
    ),
    kind(
        "nightstand",
        &[(Drawers, [0.48, 0.4, 0.52]), (CabinetLegs, [0.45, 0.4, 0.55]), (TableShelf, [0.45, 0.4, 0.52])],
        &[(0.9, Place::Beside(&["bed"])), (0.1, Place::Back)],
        [0.216, 0.009, 0.0],
        0.6,
    ),
    spread(
        kind(
            "object",
            HEAPS,
            &[
                (0.3, Place::Back),
                (0.1, Place::Free),
                (0.35, Place::On(TOPS, LIE)),
                (0.17, Place::In(BOARDS, Contact::StandingIn)),
                (0.08, Place::Wall(1.2, 1.8, ATTACH)),
            ],
            [0.018, 0.029, 0.0],
            0.5,
        ),
        0.35,
    ),
    kind(
        "ottoman",
        &[(Ottoman, [0.6, 0.55, 0.42])],
        &[(0.6, Place::Before(SOFAS)), (0.4, Place::Free)],
        [0.45, 0.0, 0.0],
        0.5,
    ),
    kind(
        "pc",
        &[(Tower, [0.2, 0.45, 0.42])],
        &[(0.6, Place::Beside(&["desk", "table"])), (0.2, Place::Back), (0.2, Place::On(TABLES, STAND))],
        [0.0, 0.0, 0.0],
        0.2,
    ),
    spread(
        kind(
            "picture",
            &[(Panel, [0.55, 0.035, 0.5]), (Panel, [0.4, 0.05, 0.6]), (Panel, [1.0, 0.05, 0.85])],
            &[
                (0.82, Place::Wall(1.25, 1.8, HANG)),
                (0.08, Place::On(TOPS, STAND)),
                (0.05, Place::In(BOARDS, Contact::StandingIn)),
                (0.05, Place::Lean),
            ],
            [0.0, 0.019, 0.0],
            0.5,
        ),
        0.4,
    ),
    lying(kind(
        "pillow",
        &[(Pillow, [0.5, 0.42, 0.16]), (Pillow, [0.65, 0.5, 0.15])],
        &[
            (0.45, Place::On(&["bed"], LIE)),
            (0.42, Place::On(SOFAS, LIE)),
            (0.08, Place::On(SEATS, LIE)),
            (0.05, Place::Free),
        ],
        [0.096, 0.042, 0.065],
        0.75,
    )),
    kind(
        "plant",
        &[(Plant, [0.5, 0.5, 0.85]), (Plant, [0.28, 0.28, 0.36]), (Flowers, [0.3, 0.3, 0.4])],
        &[
            (0.42, Place::Back),
            (0.36, Place::On(TOPS, STAND)),
            (0.12, Place::In(BOARDS, STAND)),
            (0.05, Place::Wall(1.5, 2.0, ATTACH)),
            (0.05, Place::Free),
        ],
        [0.028, 0.019, 0.04],
        0.45,
    ),
    kind("plate", &[(Plate, [0.24, 0.24, 0.05])], &[(1.0, Place::On(TOPS, LIE))], [0.0, 0.02, 0.0], 0.8),
    kind(
        "rack",
        &[(Rack, [0.7, 0.35, 0.9]), (ShelfLadder, [0.6, 0.35, 1.1])],
        &[(0.8, Place::Back), (0.2, Place::Wall(1.2, 1.7, ATTACH))],
        [0.074, 0.012, 0.0],
        0.5,
    ),
    kind(
        "radiator",
        &[(Ribs, [1.0, 0.12, 0.6])],
        &[(0.75, Place::Wall(0.42, 0.55, Contact::ConnectedTo)), (0.25, Place::Back)],
        [0.0, 0.0, 0.0],
        0.85,
    ),
    kind(
        "refrigerator",
        &[(Fridge, [0.62, 0.65, 1.6]), (Fridge, [0.58, 0.6, 0.95])],
        &[(1.0, Place::Back)],
        [0.068, 0.0, 0.0],
        0.75,
    ),
    kind(
        "shelf",
        &[
            (Shelf, [0.95, 0.38, 1.5]),
            (ShelfBoards, [0.9, 0.35, 1.1]),
            (ShelfLadder, [0.8, 0.36, 1.6]),
            (Shelf, [0.85, 0.3, 0.6]),
        ],
        &[(1.0, Place::Back)],
        [0.041, 0.006, 0.0],
        0.55,
    ),
    kind(
        "shoes",
        &[(Shoes, [0.26, 0.29, 0.13])],
        &[(0.7, Place::Back), (0.2, Place::Free), (0.1, Place::In(BOARDS, STAND))],
        [0.0, 0.09, 0.0],
        0.35,
    ),
    kind(
        "showcase",
        &[(Cabinet, [0.9, 0.42, 1.6]), (Shelf, [0.9, 0.42, 1.5])],
        &[(1.0, Place::Back)],
        [0.06, 0.0, 0.0],
        0.35,
    ),
    kind("shower", &[(Shower, [0.9, 0.9, 2.0])], &[(1.0, Place::Back)], [0.0, 0.0, 0.0], 0.35),
    kind(
        "side table",
        SMALL_TABLES,
        &[(0.6, Place::Beside(SOFAS)), (0.4, Place::Free)],
        [0.25, 0.0, 0.0],
        0.5,
    ),
    kind(
        "sink",
        &[(Pedestal, [0.58, 0.46, 0.85]), (Basin, [0.55, 0.42, 0.22])],
        &[(1.0, Place::Back)],
        [0.0, 0.004, 0.0],
        0.85,
    ),
    kind("sofa", SOFA_SHAPES, &[(0.85, Place::Back), (0.15, Place::Free)], [0.22, 0.0, 0.0], 0.5),
    kind(
        "stand",
        &[(Table, [0.6, 0.42, 0.65]), (TableShelf, [0.65, 0.4, 0.7]), (Rack, [0.55, 0.35, 0.8])],
        &[(0.8, Place::Back), (0.2, Place::Beside(FURNITURE))],
        [0.1, 0.022, 0.0],
        0.5,
    ),
    kind(
        "stool",
        &[(Stool, [0.4, 0.38, 0.48]), (StoolRound, [0.37, 0.37, 0.5]), (StoolRound, [0.38, 0.38, 0.68])],
        &[
            (0.4, Place::Around(&["table", "desk", "counter", "kitchen counter"])),
            (0.35, Place::Free),
            (0.25, Place::Back),
        ],
        [0.39, 0.03, 0.0],
        0.5,
    ),
    kind(
        "suitcase",
        &[(Suitcase, [0.42, 0.26, 0.6])],
        &[(0.7, Place::Back), (0.15, Place::Free), (0.15, Place::On(&["wardrobe"], LIE))],
        [0.28, 0.02, 0.0],
        0.3,
    ),
    kind(
        "table",
        &[
            (Table, [1.2, 0.75, 0.73]),
            (TableRound, [0.9, 0.9, 0.73]),
            (TablePanel, [1.3, 0.75, 0.73]),
            (Table, [0.7, 0.6, 0.55]),
        ],
        &[(0.6, Place::Free), (0.4, Place::Back)],
        [0.285, 0.015, 0.0],
        0.55,
    ),
    kind("toilet", &[(Toilet, [0.4, 0.66, 0.78])], &[(1.0, Place::Back)], [0.05, 0.03, 0.0], 0.85),
    kind(
        "towel",
        &[(Hanging, [0.42, 0.1, 0.65]), (Clothes, [0.4, 0.3, 0.12]), (Hanging, [0.5, 0.12, 0.5])],
        &[
            (0.65, Place::Wall(1.1, 1.5, HANG)),
            (0.2, Place::On(&["bath cabinet", "washing machine", "bathtub", "counter"], LIE)),
            (0.15, Place::In(BOARDS, Contact::LyingIn)),
        ],
        [0.077, 0.06, 0.09],
        0.7,
    ),
    kind(
        "trash can",
        &[(Bin, [0.3, 0.3, 0.38]), (Bin, [0.38, 0.36, 0.58])],
        &[(0.6, Place::Back), (0.4, Place::Beside(FURNITURE))],
        [0.293, 0.037, 0.0],
        0.4,
    ),
    kind(
        "tv",
        &[(FlatScreen, [0.95, 0.14, 0.58]), (Screen, [0.9, 0.22, 0.62])],
        &[
            (0.65, Place::On(&["tv stand", "commode", "table", "cabinet"], STAND)),
            (0.35, Place::Wall(1.2, 1.6, HANG)),
        ],
        [0.11, 0.016, 0.0],
        0.18,
    ),
    kind(
        "tv stand",
        &[(CabinetLegs, [1.2, 0.42, 0.5]), (Table, [1.1, 0.42, 0.5]), (ShelfBoards, [1.2, 0.4, 0.48])],
        &[(1.0, Place::Back)],
        [0.22, 0.0, 0.0],
        0.5,
    ),
    kind(
        "vase",
        &[(Vase, [0.18, 0.18, 0.32]), (Flowers, [0.26, 0.26, 0.4])],
        &[(0.85, Place::On(TOPS, STAND)), (0.15, Place::Back)],
        [0.0, 0.04, 0.0],
        0.6,
    ),
    kind(
        "wardrobe",
        &[(Cabinet, [1.35, 0.6, 2.0]), (Cabinet, [0.95, 0.58, 1.9])],
        &[(1.0, Place::Back)],
        [0.049, 0.0, 0.0],
        0.65,
    ),
    kind("washing machine", &[(Washer, [0.6, 0.58, 0.85])], &[(1.0, Place::Back)], [0.09, 0.0, 0.0], 0.85),
];

/// The row of a label.
pub(crate) fn find(label: &str) -> Option<&'static Kind> {
    KINDS.binary_search_by(|k| k.label.cmp(label)).ok().map(|i| &KINDS[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_sorted_known_to_3dssg_and_hosts_exist() {
        assert!(KINDS.windows(2).all(|w| w[0].label < w[1].label));
        for k in KINDS {
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
