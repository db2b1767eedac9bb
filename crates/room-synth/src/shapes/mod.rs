//! Parametric shapes: what a chair of some size and style looks like.
//!
//! Every shape fills a box whose base is centred on the origin: x to the right, y to the front
//! (the back, which may stand at a wall, is at -depth/2), z up from 0 to the height.

mod bath;
mod openings;
mod seating;
mod small;
mod soft;
mod storage;
mod tables;

use crate::mesh::Mesh;
use crate::rng::Draw;

/// A way to build an object. Several labels share families, and several families share a label.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs, reason = "the names say it")]
pub enum Family {
    Block,
    ChairLegs,
    ChairSled,
    ChairOffice,
    ChairShell,
    Stool,
    StoolRound,
    Armchair,
    Sofa,
    SofaCorner,
    Bench,
    Bed,
    BedBox,
    BedFrame,
    Ottoman,
    Table,
    TableRound,
    TablePanel,
    TableShelf,
    DeskDrawers,
    Cabinet,
    CabinetLegs,
    Drawers,
    Shelf,
    ShelfBoards,
    ShelfLadder,
    WallBoard,
    Fridge,
    Oven,
    Washer,
    Stove,
    Counter,
    Hood,
    Microwave,
    Toilet,
    Bathtub,
    Basin,
    Pedestal,
    Shower,
    Window,
    Door,
    DoorFrame,
    Blinds,
    Curtain,
    Sill,
    Ribs,
    Panel,
    FloorLamp,
    TableLamp,
    Pendant,
    Disc,
    Plant,
    Flowers,
    Vase,
    Screen,
    FlatScreen,
    Tower,
    Pillow,
    Blanket,
    Hanging,
    Clothes,
    Bag,
    Backpack,
    Bin,
    Basket,
    Bottle,
    Plate,
    Pot,
    Shoes,
    Suitcase,
    Toy,
    Rack,
    Dryer,
    Heap,
    Books,
    Printer,
    OpenBox,
    Kettle,
    Ladder,
    Pipe,
}

/// A flat place that other things can stand or lie on, in the frame of the shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Height, metres.
    pub z: f32,
    /// Centre.
    pub centre: [f32; 2],
    /// Full size along x and y.
    pub size: [f32; 2],
    /// Free height above.
    pub clearance: f32,
    /// Between boards rather than on top.
    pub inside: bool,
}

/// A shape with all its parameters: the same value builds the same mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// How it is built.
    pub family: Family,
    /// Width, depth, height of its box, metres.
    pub size: [f32; 3],
    /// Proportions, each in [0, 1).
    pub style: [f32; 4],
    /// Seed of irregular detail (leaves, folds).
    pub detail: u64,
}

/// `low` to `high` by a style parameter.
fn lerp(low: f32, high: f32, t: f32) -> f32 {
    low + (high - low) * t
}

impl Shape {
    /// The mesh in the shape's own frame. It fills `size`.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        let mut m = Mesh::default();
        let mut draw = Draw::new(self.detail, "detail", &[]);
        self.build(&mut m, &mut draw);
        m.fit(self.size)
    }

    fn build(&self, m: &mut Mesh, draw: &mut Draw) {
        use Family as F;
        match self.family {
            F::Block => m.block(0.0, 0.0, 0.0, self.size),
            F::ChairLegs
            | F::ChairSled
            | F::ChairOffice
            | F::ChairShell
            | F::Stool
            | F::StoolRound
            | F::Armchair
            | F::Sofa
            | F::SofaCorner
            | F::Bench
            | F::Ottoman => seating::build(self, m),
            F::Bed | F::BedBox | F::BedFrame => soft::bed(self, m),
            F::Pillow | F::Blanket | F::Hanging | F::Clothes | F::Curtain | F::Heap | F::Toy => {
                soft::build(self, m, draw)
            }
            F::Table | F::TableRound | F::TablePanel | F::TableShelf | F::DeskDrawers => {
                tables::build(self, m)
            }
            F::Cabinet
            | F::CabinetLegs
            | F::Drawers
            | F::Shelf
            | F::ShelfBoards
            | F::ShelfLadder
            | F::WallBoard
            | F::Fridge
            | F::Oven
            | F::Washer
            | F::Stove
            | F::Counter
            | F::Hood
            | F::Microwave
            | F::Books => {
                storage::build(self, m, draw);
            }
            F::Toilet | F::Bathtub | F::Basin | F::Pedestal | F::Shower => bath::build(self, m),
            F::Window | F::Door | F::DoorFrame | F::Blinds | F::Sill | F::Ribs | F::Panel | F::Pipe => {
                openings::build(self, m)
            }
            _ => small::build(self, m, draw),
        }
    }

    /// Where other things can stand or lie.
    #[must_use]
    pub fn surfaces(&self) -> Vec<Surface> {
        use Family as F;
        let [w, d, h] = self.size;
        let s = self.style;
        let top = |z: f32, inset: f32| Surface {
            z,
            centre: [0.0, 0.0],
            size: [(w - inset).max(0.02), (d - inset).max(0.02)],
            clearance: 1.2,
            inside: false,
        };
        match self.family {
            F::Armchair | F::Sofa => {
                let [arm, back, seat] = seating::sofa_parts(self);
                vec![Surface { centre: [0.0, back / 2.0], size: [w - 2.0 * arm, d - back], ..top(seat, 0.0) }]
            }
            F::SofaCorner => {
                let [arm, back, seat] = seating::sofa_parts(self);
                vec![Surface {
                    centre: [0.0, back - d / 2.0 + 0.3],
                    size: [w - 2.0 * arm, 0.6],
                    ..top(seat, 0.0)
                }]
            }
            F::ChairLegs | F::ChairSled | F::ChairShell => {
                vec![Surface {
                    centre: [0.0, 0.03],
                    size: [w * 0.8, d * 0.75],
                    ..top(seating::seat_height(self), 0.0)
                }]
            }
            F::Bed | F::BedBox | F::BedFrame => {
                let z = soft::mattress_top(self);
                vec![Surface { size: [w * 0.9, d * 0.88], ..top(z, 0.0) }]
            }
            F::Shelf | F::ShelfBoards | F::ShelfLadder => storage::boards(self),
            F::Basin => Vec::new(),
            F::Washer
            | F::Drawers
            | F::Cabinet
            | F::CabinetLegs
            | F::Table
            | F::TablePanel
            | F::TableShelf
            | F::DeskDrawers
            | F::Block
            | F::Bench
            | F::Counter
            | F::Sill
            | F::WallBoard
            | F::Stool
            | F::Fridge
            | F::Microwave
            | F::Ottoman
            | F::Oven => vec![top(h, 0.04)],
            F::TableRound | F::StoolRound => vec![top(h, 0.3 * w.min(d))],
            F::Ribs if s[0] > 0.5 => vec![top(h, 0.02)],
            F::Rack => vec![Surface { clearance: 0.3, inside: true, ..top(small::rack_board(self), 0.06) }],
            _ => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every family, listed through the order of the enum.
    const ALL: [Family; 14] = [
        Family::Block,
        Family::ChairLegs,
        Family::ChairOffice,
        Family::Sofa,
        Family::Bed,
        Family::TableRound,
        Family::Cabinet,
        Family::Shelf,
        Family::Toilet,
        Family::Window,
        Family::Curtain,
        Family::Plant,
        Family::Rack,
        Family::Dryer,
    ];

    #[test]
    fn shapes_fill_their_box_and_surfaces_lie_inside_it() {
        for family in ALL {
            for k in 0..4 {
                let style = [0.1, 0.4, 0.6, 0.9].map(|s: f32| (s + 0.23 * k as f32).fract());
                let shape = Shape { family, size: [0.9, 0.6, 0.8], style, detail: k };
                let (lo, hi) = shape.mesh().bounds().unwrap();
                assert!((lo - nalgebra::Point3::new(-0.45, -0.3, 0.0)).norm() < 1e-4, "{family:?} {lo}");
                assert!((hi - nalgebra::Point3::new(0.45, 0.3, 0.8)).norm() < 1e-4, "{family:?} {hi}");
                for s in shape.surfaces() {
                    assert!(s.z <= 0.8001 && s.z > 0.0, "{family:?} {s:?}");
                    assert!(
                        s.centre[0].abs() + s.size[0] / 2.0 <= 0.4501
                            && s.centre[1].abs() + s.size[1] / 2.0 <= 0.3501,
                        "{family:?} {s:?}"
                    );
                }
            }
        }
    }
}
