//! How an object lies on the ground.

use crate::Error;
use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4};
use std::f64::consts::FRAC_1_SQRT_2 as FRAC_1_SQRT_2_64;

/// The octagon on the ground that holds an object: what a change of frame goes by. It stands along the object's own
/// directions, so that a turned object is held tighter than by its axis-aligned box.
///
/// Line `k` has its outward normal at `yaw + k π/4`; `reach[k]` is its distance from the box's centroid, negative
/// where the centroid lies outside. The rectangle between the lines of even `k` gives the sides.
///
/// ```
/// use graph_align::Footprint;
/// let table = Footprint::rectangle([1.6, 0.8], 0.3);
/// assert_eq!(table.sides(), [1.6, 0.8]);
/// assert!((table.support(0.3) - 0.8).abs() < 1e-6); // half of the first side
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Angle from x to the first side, radians, 0 to a quarter turn.
    pub yaw: f32,
    /// Distances of the eight lines from the centroid, metres.
    pub reach: [f32; 8],
}

impl Footprint {
    /// A rectangle about the centroid: side lengths in metres, the first at `yaw` from x.
    #[must_use]
    pub fn rectangle(sides: [f32; 2], yaw: f32) -> Self {
        let [l, w] = sides.map(|s| s / 2.0);
        let corner = (l + w) * FRAC_1_SQRT_2;
        Self { yaw, reach: [l, corner, w, corner, l, corner, w, corner] }
    }

    /// Sides of the rectangle between the lines of even numbers, metres.
    #[must_use]
    pub fn sides(&self) -> [f32; 2] {
        [self.reach[0] + self.reach[4], self.reach[2] + self.reach[6]]
    }

    /// Middle of that rectangle as seen from the centroid, along x and y, metres.
    #[must_use]
    pub fn middle(&self) -> [f32; 2] {
        let off = [self.reach[0] - self.reach[4], self.reach[2] - self.reach[6]].map(|d| d / 2.0);
        let (sin, cos) = self.yaw.sin_cos();
        [off[0] * cos - off[1] * sin, off[0] * sin + off[1] * cos]
    }

    /// Farthest that the octagon reaches in a direction, radians from x: from the centroid, metres.
    #[must_use]
    pub fn support(&self, direction: f32) -> f32 {
        let (k, past) = lines(direction - self.yaw, FRAC_PI_4);
        corner(self.reach[k % 8], past, self.reach[(k + 1) % 8], FRAC_PI_4 - past)
    }

    /// What it takes up in a direction and the opposite one, `[from, to]`, where the centroid stands at `at`.
    pub(crate) fn span(&self, angle: f32, at: f32) -> [f32; 2] {
        [at - self.support(angle + 2.0 * FRAC_PI_2), at + self.support(angle)]
    }

    /// Its numbers are finite, below a bound, and no line lies behind the one across.
    pub(crate) fn check(&self, most: f32) -> Result<(), Error> {
        let wrong = |what: String| Err(Error::value("footprint", what));
        if self.reach.iter().any(|r| !r.is_finite() || r.abs() > most) {
            return wrong(format!("reaches {:?}, want finite numbers below {most} m", self.reach));
        }
        if (0..4).any(|k| self.reach[k] + self.reach[k + 4] < 0.0) {
            return wrong(format!(
                "reaches {:?}, want two that are opposite to have a sum of at least 0",
                self.reach
            ));
        }
        if !(0.0..=FRAC_PI_2).contains(&self.yaw) {
            return wrong(format!("yaw {}, want 0 to a quarter turn", self.yaw));
        }
        Ok(())
    }

    /// After a turn about the centroid.
    pub(crate) fn turned(&self, turn: f32) -> Self {
        let quarters = ((self.yaw + turn) / FRAC_PI_2).floor();
        let yaw = (self.yaw + turn - quarters * FRAC_PI_2).clamp(0.0, FRAC_PI_2);
        let first = 2 * quarters.rem_euclid(4.0) as usize;
        Self { yaw, reach: std::array::from_fn(|k| self.reach[(k + 8 - first) % 8]) }
    }

    /// From a centroid that lies elsewhere by `(x, y)`.
    pub(crate) fn seen_from(&self, x: f32, y: f32) -> Self {
        let reach = std::array::from_fn(|k| {
            let (sin, cos) = self.angle(k).sin_cos();
            self.reach[k] - x * cos - y * sin
        });
        Self { reach, ..*self }.settled()
    }

    /// Direction of a line's normal.
    pub(crate) fn angle(&self, k: usize) -> f32 {
        self.yaw + k as f32 * FRAC_PI_4
    }

    /// With no line behind the one across, where rounding put one.
    pub(crate) fn settled(mut self) -> Self {
        for k in 0..4 {
            self.reach[k + 4] = self.reach[k + 4].max(-self.reach[k]);
        }
        self
    }

    /// How far the octagon and an axis-aligned box of half sides `half` about the centroid reach together along x, y,
    /// -x and -y after a turn: to the corner of the two lines next to the direction, whichever of the two they
    /// belong to. Neither alone is tight: the box is only along its own axes, the octagon along the object's.
    pub(crate) fn with_box(&self, half: [f32; 2], turn: f32) -> [f32; 4] {
        let (own, past) = lines(-turn - self.yaw, FRAC_PI_4);
        let (axis, beyond) = lines(-turn, FRAC_PI_2);
        let (left, lacking) = (FRAC_PI_4 - past, FRAC_PI_2 - beyond);
        std::array::from_fn(|k| {
            let (a, b) = (self.reach[(own + 2 * k) % 8], self.reach[(own + 2 * k + 1) % 8]);
            let (c, d) = (half[(axis + k) % 2], half[(axis + k + 1) % 2]);
            let (from, u) = if past < beyond { (a, past) } else { (c, beyond) };
            let (to, v) = if left < lacking { (b, left) } else { (d, lacking) };
            corner(from, u, to, v).min(corner(a, past, b, left)).min(corner(c, beyond, d, lacking))
        })
    }
}

/// Steps of a quarter turn in frames.
pub(crate) const YAW_STEPS: f32 = 1023.0;

/// A footprint as it travels, lengths in whole centimetres: what is next to nothing for a rectangle about the centroid
/// takes next to no room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Grid {
    /// In [`YAW_STEPS`].
    pub yaw: u64,
    /// Lengths of the two sides.
    pub sides: [u64; 2],
    /// How far the reaches of lines 0 and 2 exceed half of their side, rounded up.
    pub off: [i64; 2],
    /// How far lines 1, 3, 5 and 7 cut into the corners of the rectangle.
    pub cuts: [u64; 4],
}

impl Grid {
    /// A footprint on the grid.
    pub(crate) fn of(f: &Footprint) -> Self {
        let cm = |k: usize| (f64::from(f.reach[k]) * 100.0).round() as i64;
        let even = [cm(0), cm(2), cm(4), cm(6)];
        let most = corners(even);
        let mut odd = [cm(1), cm(3), cm(5), cm(7)];
        for k in 0..2 {
            odd[k] = odd[k].min(most[k]).max(-most[k + 2]);
            odd[k + 2] = odd[k + 2].min(most[k + 2]).max(-odd[k]);
        }
        let sides = [0, 1].map(|k| even[k] + even[k + 2]);
        Self {
            yaw: (f.yaw / FRAC_PI_2 * YAW_STEPS).round() as u64,
            sides: sides.map(i64::unsigned_abs),
            off: std::array::from_fn(|k| even[k] - (sides[k] + 1) / 2),
            cuts: std::array::from_fn(|k| (most[k] - odd[k]).unsigned_abs()),
        }
    }

    /// The footprint; lines that lie behind those across are not refused here.
    pub(crate) fn footprint(&self) -> Footprint {
        let sides = self.sides.map(|s| s as i64);
        let first = [0, 1].map(|k| self.off[k].saturating_add((sides[k] + 1) / 2));
        let even = [first[0], first[1], sides[0].saturating_sub(first[0]), sides[1].saturating_sub(first[1])];
        let most = corners(even);
        let m = |cm: i64| (cm as f64 / 100.0) as f32;
        let reach = std::array::from_fn(|k| match k % 2 {
            0 => m(even[k / 2]),
            _ => m(most[k / 2].saturating_sub_unsigned(self.cuts[k / 2])),
        });
        Footprint { yaw: (self.yaw as f32 / YAW_STEPS * FRAC_PI_2).min(FRAC_PI_2), reach }
    }
}

/// Reaches of the lines 1, 3, 5 and 7 that go through the corners of a rectangle, centimetres.
fn corners(even: [i64; 4]) -> [i64; 4] {
    std::array::from_fn(|k| ((even[k] as f64 + even[(k + 1) % 4] as f64) * FRAC_1_SQRT_2_64).round() as i64)
}

/// The line at or before an angle, of those `step` apart, and how far past it the angle is.
fn lines(angle: f32, step: f32) -> (usize, f32) {
    let at = angle.rem_euclid(4.0 * FRAC_PI_2) / step;
    let k = at.floor();
    (k as usize, (at - k).clamp(0.0, 1.0) * step)
}

/// How far the corner of two lines reaches in a direction `u` past the normal of the first and `v` before that of the
/// second, radians: `(a sin v + b sin u) / sin (u + v)`.
fn corner(a: f32, u: f32, b: f32, v: f32) -> f32 {
    if u + v < 1e-4 {
        return a.min(b);
    }
    if u == 0.0 {
        return a;
    }
    (a * v.sin() + b * u.sin()) / (u + v).sin()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Box3;
    use nalgebra::{Isometry3, Vector3};

    /// Points, and the box with the octagon that holds them exactly.
    fn held(points: &[[f32; 2]], yaw: f32) -> Box3 {
        let reach = |angle: f32| {
            let (sin, cos) = angle.sin_cos();
            points.iter().map(|p| p[0] * cos + p[1] * sin).fold(f32::MIN, f32::max)
        };
        let [e, n, w, s] = [0.0, 1.0, 2.0, 3.0].map(|k| reach(k * FRAC_PI_2));
        let centre = [(e - w) / 2.0, (n - s) / 2.0];
        let f = Footprint { yaw, reach: std::array::from_fn(|k| reach(yaw + k as f32 * FRAC_PI_4)) };
        let f = f.seen_from(centre[0], centre[1]);
        let b = Box3::new([centre[0], centre[1], 0.5], [e + w, n + s, 1.0]).and_then(|b| b.with_footprint(f));
        b.expect("a box")
    }

    fn points(seed: u32) -> Vec<[f32; 2]> {
        let mut state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        (0..7).map(|_| [3.0 * next(), next()]).collect()
    }

    #[test]
    fn a_turned_box_holds_the_turned_points_and_hardly_more() {
        for seed in 0..200 {
            let p = points(seed);
            let b = held(&p, (seed as f32 * 0.37) % FRAC_PI_2);
            for turn in [-2.9_f32, -1.1, -0.2, 0.0, 0.05, 0.4, 0.785, 1.3, FRAC_PI_2, 2.2, 3.1] {
                let t = Isometry3::new(Vector3::new(1.0, -2.0, 0.0), Vector3::z() * turn);
                let (is, (sin, cos)) = (b.transformed(&t), turn.sin_cos());
                let turned: Vec<_> =
                    p.iter().map(|[x, y]| [x * cos - y * sin + 1.0, x * sin + y * cos - 2.0]).collect();
                let want = held(&turned, 0.0);
                for k in 0..2 {
                    let (more, less) = (is.max()[k] - want.max()[k], want.min()[k] - is.min()[k]);
                    assert!(more > -1e-4 && less > -1e-4, "seed {seed} turn {turn}: {is:?} {want:?}");
                    // An octagon's corner stands out of what it holds by at most this much of its size.
                    let size = want.extent().x.hypot(want.extent().y);
                    assert!(more.max(less) < 0.21 * size, "seed {seed} turn {turn}: {more} {less} of {size}");
                }
            }
        }
    }

    #[test]
    fn a_shift_and_a_turn_by_quarters_lose_nothing() {
        for seed in 0..50 {
            let b = held(&points(seed), 0.3);
            for quarters in 0..4 {
                let t = Isometry3::new(
                    Vector3::new(0.5, 4.0, -1.0),
                    Vector3::z() * (quarters as f32 * FRAC_PI_2),
                );
                let back = b.transformed(&t).transformed(&t.inverse());
                assert!((back.extent() - b.extent()).norm() < 1e-4 && back.distance(&b) < 1e-4);
                let (f, g) = (b.footprint().expect("one"), back.footprint().expect("one"));
                assert!(f.reach.iter().zip(g.reach).all(|(a, b)| (a - b).abs() < 1e-4), "{f:?} {g:?}");
            }
        }
    }

    #[test]
    fn the_grid_is_within_a_centimetre_and_rests() {
        for seed in 0..200 {
            let f = held(&points(seed), (seed as f32 * 0.37) % FRAC_PI_2).footprint().expect("one");
            let grid = Grid::of(&f);
            let g = grid.footprint();
            assert!(g.check(10.0).is_ok(), "{g:?}");
            assert_eq!(Grid::of(&g), grid);
            let off = f.reach.iter().zip(g.reach).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off < 0.0151, "seed {seed}: {off}");
        }
        let table = Grid::of(&Footprint::rectangle([1.6, 0.8], 0.0));
        assert_eq!(table, Grid { yaw: 0, sides: [160, 80], off: [0; 2], cuts: [0; 4] });
    }

    #[test]
    fn its_middle_goes_with_the_object() {
        for seed in 0..50 {
            let b = held(&points(seed), 0.9);
            let t = Isometry3::new(Vector3::new(0.5, 4.0, -1.0), Vector3::z() * 0.77);
            assert!((t * b.middle() - b.transformed(&t).middle()).norm() < 1e-4, "seed {seed}");
        }
    }
}
