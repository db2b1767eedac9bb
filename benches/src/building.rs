//! Furnished buildings as boxes: rooms on a grid, each with walls, a floor and some thirty objects.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A seeded source of numbers.
pub struct Dice(ChaCha8Rng);

impl Dice {
    /// Equal seeds give equal numbers.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Uniform in `lo..hi`.
    pub fn within(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normal with mean 0.
    pub fn normal(&mut self, sigma: f64) -> f64 {
        let (u, v) = (self.within(1e-12, 1.0), self.within(0.0, std::f64::consts::TAU));
        sigma * (-2.0 * u.ln()).sqrt() * v.cos()
    }

    /// True with probability `p`.
    pub fn chance(&mut self, p: f64) -> bool {
        self.within(0.0, 1.0) < p
    }

    /// Uniform in `0..n`.
    pub fn below(&mut self, n: usize) -> usize {
        self.within(0.0, n as f64) as usize
    }

    /// Any order.
    pub fn shuffle<T>(&mut self, list: &mut [T]) {
        for k in (1..list.len()).rev() {
            list.swap(k, self.below(k + 1));
        }
    }
}

/// What holds an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Support {
    /// Nothing: floors.
    None,
    /// It stands or lies on another object.
    On(usize),
    /// It hangs on or is built into another object.
    At(usize),
}

/// One object: an upright box that may be turned about the vertical.
#[derive(Clone, Debug)]
pub struct Object {
    /// Class.
    pub label: &'static str,
    /// The box's own frame in the building.
    pub pose: Isometry3<f64>,
    /// Side lengths in its own frame.
    pub size: Vector3<f64>,
    /// What holds it.
    pub support: Support,
    /// Number of its room.
    pub room: usize,
}

impl Object {
    /// Walls and floors.
    #[must_use]
    pub fn is_structure(&self) -> bool {
        matches!(self.label, "wall" | "floor")
    }
}

/// The classes, walls and floors first.
pub const LABELS: [&str; 20] = [
    "wall",
    "floor",
    "otherfurniture",
    "cabinet",
    "chair",
    "window",
    "picture",
    "table",
    "door",
    "curtain",
    "bookshelf",
    "desk",
    "sofa",
    "sink",
    "counter",
    "bed",
    "refridgerator",
    "toilet",
    "bathtub",
    "shower curtain",
];

/// The predicates: resting, then hanging.
pub const PREDICATES: [&str; 7] =
    ["standing on", "supported by", "attached to", "hanging on", "connected to", "part of", "build in"];

#[derive(Clone, Copy)]
enum Place {
    Floor,
    Wall(f64),
    Top,
}

/// (label, length, width, height, log spread, place).
type Kind = (&'static str, f64, f64, f64, f64, Place);

const KINDS: [Kind; 19] = [
    ("otherfurniture", 0.4, 0.35, 0.5, 0.4, Place::Floor),
    ("otherfurniture", 0.25, 0.2, 0.25, 0.35, Place::Top),
    ("cabinet", 0.9, 0.5, 1.1, 0.3, Place::Floor),
    ("chair", 0.55, 0.55, 0.9, 0.15, Place::Floor),
    ("window", 1.2, 0.15, 1.2, 0.25, Place::Wall(1.5)),
    ("picture", 0.5, 0.05, 0.5, 0.35, Place::Wall(1.6)),
    ("table", 1.2, 0.7, 0.7, 0.25, Place::Floor),
    ("door", 0.9, 0.1, 2.0, 0.06, Place::Wall(1.0)),
    ("curtain", 0.6, 0.2, 1.9, 0.25, Place::Wall(1.3)),
    ("bookshelf", 0.9, 0.35, 1.7, 0.25, Place::Floor),
    ("desk", 1.4, 0.7, 0.75, 0.15, Place::Floor),
    ("sofa", 1.8, 0.9, 0.8, 0.2, Place::Floor),
    ("sink", 0.5, 0.4, 0.25, 0.15, Place::Top),
    ("counter", 1.8, 0.6, 0.9, 0.2, Place::Floor),
    ("bed", 2.0, 1.4, 0.6, 0.15, Place::Floor),
    ("refridgerator", 0.6, 0.65, 1.6, 0.15, Place::Floor),
    ("toilet", 0.4, 0.6, 0.75, 0.08, Place::Floor),
    ("bathtub", 1.7, 0.75, 0.6, 0.08, Place::Floor),
    ("shower curtain", 0.8, 0.2, 1.8, 0.15, Place::Wall(1.1)),
];

/// How often each kind occurs in each type of room: living, bed, kitchen, bath, office.
const FURNITURE: [[f64; 19]; 5] = [
    [4.0, 3.0, 2.0, 3.0, 1.6, 2.2, 1.6, 1.0, 1.6, 1.2, 0.2, 1.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [4.0, 2.5, 2.5, 1.2, 1.4, 1.4, 0.8, 1.0, 1.4, 0.8, 0.6, 0.1, 0.0, 0.0, 1.1, 0.0, 0.0, 0.0, 0.0],
    [4.0, 4.0, 4.5, 2.5, 1.2, 0.8, 1.0, 1.0, 0.4, 0.3, 0.0, 0.0, 1.0, 1.6, 0.0, 1.0, 0.0, 0.0, 0.0],
    [3.5, 3.5, 1.8, 0.2, 0.7, 0.4, 0.1, 1.0, 0.2, 0.1, 0.0, 0.0, 1.1, 0.3, 0.0, 0.0, 1.0, 0.7, 0.5],
    [5.0, 3.0, 2.5, 4.5, 1.8, 1.2, 1.2, 1.2, 0.8, 2.2, 2.6, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
];

/// The plan of a room.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Index into living, bed, kitchen, bath, office.
    pub kind: usize,
    /// Length and width, metres.
    pub size: [f64; 2],
}

impl Plan {
    /// Any room.
    pub fn any(dice: &mut Dice) -> Self {
        let kind = dice.below(5);
        let scale = if kind == 3 { 0.65 } else { 1.0 };
        Self { kind, size: [dice.within(3.6, 6.2) * scale, dice.within(3.0, 5.0) * scale] }
    }
}

fn upright(x: f64, y: f64, z: f64, yaw: f64) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    Isometry3::from_parts(Translation3::new(x, y, z), turn)
}

/// A yaw and a shift.
#[must_use]
pub fn yaw_shift(yaw: f64, shift: [f64; 3]) -> Isometry3<f64> {
    upright(shift[0], shift[1], shift[2], yaw)
}

/// A furnished room about the origin; its walls and floor come first.
pub fn room(dice: &mut Dice, plan: &Plan, number: usize, density: f64) -> Vec<Object> {
    let [l, w] = plan.size;
    let h = dice.within(2.4, 2.8);
    let mut out = shell(l, w, h, number);
    for (kind, &mean) in KINDS.iter().zip(&FURNITURE[plan.kind]) {
        let n = (mean * density * dice.within(0.5, 1.5) + dice.within(0.0, 1.0)).floor() as usize;
        for _ in 0..n {
            if let Some(o) = furnish(dice, kind, plan, number, &out) {
                out.push(o);
            }
        }
    }
    out
}

/// Floor and four walls.
#[must_use]
pub fn shell(l: f64, w: f64, h: f64, number: usize) -> Vec<Object> {
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut out = vec![Object {
        label: "floor",
        pose: upright(0.0, 0.0, 0.0, 0.0),
        size: Vector3::new(l, w, 0.06),
        support: Support::None,
        room: number,
    }];
    for (x, y, yaw, length) in [
        (0.0, -w / 2.0, 0.0, l),
        (l / 2.0, 0.0, quarter, w),
        (0.0, w / 2.0, 0.0, l),
        (-l / 2.0, 0.0, quarter, w),
    ] {
        let size = Vector3::new(length, 0.1, h);
        out.push(Object {
            label: "wall",
            pose: upright(x, y, h / 2.0, yaw),
            size,
            support: Support::At(0),
            room: number,
        });
    }
    out
}

fn furnish(dice: &mut Dice, kind: &Kind, plan: &Plan, room: usize, there: &[Object]) -> Option<Object> {
    let &(label, l, w, h, spread, place) = kind;
    let mut scaled = |v: f64| v * dice.normal(spread).clamp(-1.0, 1.0).exp();
    let size = Vector3::new(scaled(l), scaled(w), scaled(h));
    let quarter = std::f64::consts::FRAC_PI_2;
    for _ in 0..30 {
        let (pose, support) = match place {
            Place::Floor => {
                let turned = dice.below(4) as f64 * quarter;
                let yaw = if matches!(label, "chair" | "otherfurniture") {
                    dice.within(0.0, std::f64::consts::TAU)
                } else {
                    turned
                };
                let reach = size.xy().norm() / 2.0 * 0.8;
                let (x, y) = (plan.size[0] / 2.0 - reach, plan.size[1] / 2.0 - reach);
                let p = (dice.within(-x.max(0.1), x.max(0.1)), dice.within(-y.max(0.1), y.max(0.1)));
                (upright(p.0, p.1, size.z / 2.0, yaw), Support::On(0))
            }
            Place::Wall(z) => {
                let k = 1 + dice.below(4);
                let along = (there[k].size.x - size.x).max(0.0) / 2.0;
                let z = if label == "door" { size.z / 2.0 } else { z + dice.normal(0.12) };
                let inner = there[k].pose * Point3::new(dice.within(-along - 0.01, along), 0.0, 0.0);
                (upright(inner.x, inner.y, z, there[k].pose.rotation.euler_angles().2), Support::At(k))
            }
            Place::Top => {
                let tops: Vec<usize> = (0..there.len())
                    .filter(|&k| matches!(there[k].label, "table" | "desk" | "cabinet" | "counter"))
                    .collect();
                let &k = tops.get(dice.below(tops.len().max(1)))?;
                let o = &there[k];
                let local = Point3::new(
                    dice.within(-0.35, 0.35) * o.size.x,
                    dice.within(-0.35, 0.35) * o.size.y,
                    (o.size.z + size.z) / 2.0,
                );
                let at = o.pose * local;
                (upright(at.x, at.y, at.z, dice.within(0.0, std::f64::consts::TAU)), Support::On(k))
            }
        };
        let clear = |o: &Object| {
            let d = o.pose.translation.vector - pose.translation.vector;
            let need = match place {
                Place::Floor => 0.35 * (o.size.xy().norm() + size.xy().norm()),
                Place::Wall(_) => 0.45 * (o.size.x + size.x),
                Place::Top => 0.3,
            };
            let other = matches!(place, Place::Floor) && !matches!(o.support, Support::On(0));
            o.is_structure() || other || d.xy().norm() > need.min(1.2)
        };
        if there.iter().all(clear) {
            return Some(Object { label, pose, size, support, room });
        }
    }
    None
}

/// Moves objects; supports become numbers of the longer list.
pub fn place(into: &mut Vec<Object>, mut room: Vec<Object>, pose: &Isometry3<f64>, number: usize) {
    let base = into.len();
    for o in &mut room {
        o.pose = pose * o.pose;
        o.room = number;
        o.support = match o.support {
            Support::None => Support::None,
            Support::On(k) => Support::On(k + base),
            Support::At(k) => Support::At(k + base),
        };
    }
    into.append(&mut room);
}

/// The place of room `k` of `n` on a grid, with a yaw of its own.
pub fn site(dice: &mut Dice, k: usize, n: usize) -> Isometry3<f64> {
    let side = (n as f64).sqrt().ceil() as usize;
    let pitch = 8.5;
    let yaw = dice.below(4) as f64 * std::f64::consts::FRAC_PI_2 + dice.normal(0.03);
    yaw_shift(yaw, [(k % side) as f64 * pitch, (k / side) as f64 * pitch, 0.0])
}

/// A building of `n` rooms.
#[must_use]
pub fn building(dice: &mut Dice, n: usize) -> Vec<Object> {
    let mut out = Vec::new();
    for k in 0..n {
        let plan = Plan::any(dice);
        let furnished = room(dice, &plan, k, 1.0);
        let at = site(dice, k, n);
        place(&mut out, furnished, &at, k);
    }
    out
}
