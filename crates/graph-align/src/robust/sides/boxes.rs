//! Boxes of one graph, as they lie along the walls.

use super::worth::Sides;
use crate::LabelId;
use crate::robust::index::Item;
use nalgebra::Vector3;
use std::f32::consts::FRAC_PI_2;

/// How far off the walls a box counts as along them, radians.
pub(super) const ALONG: f32 = 0.2;
/// Boxes lower than this are flat: their height is where they were seen, metres.
const FLAT: f32 = 0.2;
/// Boxes of one graph beyond which nothing is tried: this is for rooms, not for buildings.
const MOST_BOXES: usize = 64;

/// Boxes of one graph, in an order of content.
pub(super) struct Boxes {
    pub items: Vec<Item>,
    /// Sides, height and direction of each on the ground.
    feet: Vec<([f32; 3], f32)>,
    pub middle: Vector3<f32>,
    /// The direction of the walls.
    pub turn: f32,
}

impl Boxes {
    /// None where too few footprints are known, or far too many.
    pub(super) fn of(items: impl Iterator<Item = Item>, fewest: usize) -> Option<Self> {
        let known = items.filter(|i| i.bounds.footprint().is_some());
        let mut items: Vec<Item> = known.take(MOST_BOXES + 1).collect();
        if !(fewest..=MOST_BOXES).contains(&items.len()) {
            return None;
        }
        items.sort_by(Item::order);
        let foot = |i: &Item| {
            let f = i.bounds.footprint()?;
            let [l, w] = f.sides();
            Some(([l, w, i.bounds.extent().z], f.yaw))
        };
        let feet: Vec<_> = items.iter().filter_map(foot).collect();
        let sum = items.iter().fold(Vector3::<f64>::zeros(), |s, i| s + i.p.coords.cast::<f64>());
        let middle = (sum / items.len() as f64).cast::<f32>();
        // Directions agree up to quarter turns: four times the angle is what is averaged.
        let (mut sin, mut cos) = (0.0, 0.0);
        for ([l, w, h], yaw) in &feet {
            let weight = oblong(*l, *w) * l.max(*w) * h.max(0.1);
            let (s, c) = (4.0 * yaw).sin_cos();
            (sin, cos) = (sin + weight * s, cos + weight * c);
        }
        Some(Self { items, feet, middle, turn: sin.atan2(cos) / 4.0 })
    }

    /// How many they are, and how large: the same in any frame.
    pub(super) fn amount(&self) -> (usize, f32) {
        (self.items.len(), self.feet.iter().map(|(sides, _)| sides.iter().sum::<f32>()).sum())
    }

    /// The mirror image in x.
    pub(super) fn mirrored(&self) -> Self {
        let items = self.items.iter().map(|i| Item { p: [-i.p.x, i.p.y, i.p.z].into(), ..*i }).collect();
        let feet = self.feet.iter().map(|(sides, yaw)| (*sides, -yaw)).collect();
        let middle = Vector3::new(-self.middle.x, self.middle.y, self.middle.z);
        Self { items, feet, middle, turn: -self.turn }
    }

    /// As seen from the middle, turned.
    pub(super) fn turned(&self, turn: f32, structure: &[LabelId]) -> Vec<Slab> {
        let (sin, cos) = turn.sin_cos();
        let slab = |(item, &([l, w, h], yaw)): (&Item, &([f32; 3], f32))| {
            let d = item.p.coords - self.middle;
            let quarters = ((yaw + turn) / FRAC_PI_2).round();
            let off = yaw + turn - quarters * FRAC_PI_2;
            let [l, w] = if quarters.rem_euclid(2.0) == 0.0 { [l, w] } else { [w, l] };
            let (s, c) = if off.abs() > ALONG { off.abs().sin_cos() } else { (0.0, 1.0) };
            let sides = [l * c + w * s, l * s + w * c, h].map(|v| v.max(0.03));
            Slab {
                centre: [cos * d.x - sin * d.y, sin * d.x + cos * d.y, d.z],
                half: sides.map(|v| v / 2.0),
                length: sides.map(Sides::class),
                structure: structure.contains(&item.label),
                off,
                oblong: oblong(l, w),
            }
        };
        self.items.iter().zip(&self.feet).map(slab).collect()
    }
}

/// How far from a square, 0 to 1.
fn oblong(l: f32, w: f32) -> f32 {
    (l - w).abs() / (l + w).max(1e-3)
}

/// A box along the axes of a frame that lies along the walls.
#[derive(Clone, Copy)]
pub(super) struct Slab {
    pub centre: [f32; 3],
    pub half: [f32; 3],
    /// Classes of its lengths, see [`Sides`].
    pub length: [u8; 3],
    pub structure: bool,
    /// Its own direction against the axes, radians.
    pub off: f32,
    pub oblong: f32,
}

impl Slab {
    pub(super) fn is_flat(&self) -> bool {
        self.half[2] < FLAT / 2.0 && self.half[0].min(self.half[1]) > FLAT / 2.0
    }
}
