//! Cabinets, shelves, kitchen furniture and appliances.

use super::seating::legs;
use super::{Family, Shape, Surface, lerp};
use crate::mesh::Mesh;
use crate::rng::Draw;

pub(super) fn build(s: &Shape, m: &mut Mesh, draw: &mut Draw) {
    let [w, d, h] = s.size;
    match s.family {
        Family::Cabinet => {
            body(s, m, 0.0);
            let columns = (w / lerp(0.35, 0.6, s.style[0])).round().clamp(1.0, 6.0) as u32;
            fronts(s, m, columns, if s.style[1] > 0.7 { 2 } else { 1 }, 0.05);
        }
        Family::CabinetLegs => {
            let foot = h * lerp(0.08, 0.25, s.style[2]);
            body(s, m, foot);
            legs(m, w * 0.95, d * 0.9, foot, 0.04);
            fronts(s, m, (w / 0.5).round().clamp(1.0, 4.0) as u32, 1, foot);
        }
        Family::Drawers => {
            body(s, m, 0.0);
            let rows = (h / lerp(0.17, 0.3, s.style[0])).round().clamp(2.0, 6.0) as u32;
            fronts(s, m, if w > 1.1 { 2 } else { 1 }, rows, 0.04);
        }
        Family::Shelf | Family::ShelfBoards | Family::ShelfLadder => shelf(s, m),
        Family::WallBoard => {
            m.block(0.0, 0.0, h - 0.03, [w, d, 0.03]);
            for x in [-0.35, 0.35] {
                m.block(x * w, -d * 0.2, 0.0, [0.03, d * 0.6, h - 0.02]);
            }
        }
        Family::Fridge => {
            body(s, m, 0.03);
            let split = h * lerp(0.3, 0.7, s.style[0]);
            m.block(0.0, d / 2.0 - 0.025, 0.05, [w, 0.05, split - 0.06]);
            m.block(0.0, d / 2.0 - 0.025, split, [w, 0.05, h - split]);
            m.block(w * 0.42, d / 2.0 + 0.02, split + 0.03, [0.02, 0.03, (h - split) * 0.5]);
        }
        Family::Oven | Family::Microwave => {
            body(s, m, 0.0);
            m.block(-w * 0.06, d / 2.0 - 0.01, h * 0.12, [w * 0.7, 0.02, h * 0.62]);
            m.block(-w * 0.06, d / 2.0 + 0.02, h * 0.78, [w * 0.6, 0.03, 0.02]);
        }
        Family::Washer => {
            body(s, m, 0.0);
            m.block(0.0, d / 2.0 - 0.01, h * 0.84, [w * 0.95, 0.02, h * 0.12]);
            disc_front(m, h * 0.45, w.min(h) * lerp(0.22, 0.34, s.style[0]), d / 2.0);
        }
        Family::Stove => {
            m.block(0.0, 0.0, 0.0, [w, d, h * 0.6]);
            for (x, y) in [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)] {
                m.lathe(x * w, y * d, &[(w * 0.17, h * 0.5), (w * 0.17, h)], 10);
            }
        }
        Family::Counter => {
            m.block(0.0, 0.0, 0.0, [w, d, h]);
            if s.style[0] > 0.6 {
                m.block(0.0, -d / 2.0 + 0.01, h * 0.5, [w, 0.02, h * 0.5]);
            }
        }
        Family::Hood => {
            m.lathe(0.0, 0.0, &[(0.7, 0.0), (0.7, 0.1), (0.25, 0.35), (0.25, 1.0)], 4);
        }
        Family::Books => {
            let n = (w / 0.05).round().clamp(2.0, 14.0) as u32;
            for k in 0..n {
                let x = -w / 2.0 + w * (k as f32 + 0.5) / n as f32;
                m.block(
                    x,
                    0.0,
                    0.0,
                    [w / n as f32 * 0.9, d * draw.range(0.7, 1.0), h * draw.range(0.65, 1.0)],
                );
            }
        }
        _ => m.block(0.0, 0.0, 0.0, s.size),
    }
}

/// The carcass, leaving 2 cm for the fronts.
fn body(s: &Shape, m: &mut Mesh, from: f32) {
    let [w, d, h] = s.size;
    m.cuboid([-w / 2.0, -d / 2.0, from], [w / 2.0, d / 2.0 - 0.02, h]);
}

/// Doors or drawers with gaps, and handles.
fn fronts(s: &Shape, m: &mut Mesh, columns: u32, rows: u32, from: f32) {
    let [w, d, h] = s.size;
    let gap = lerp(0.006, 0.015, s.style[3]);
    let (cw, rh) = (w / columns as f32, (h - from) / rows as f32);
    for c in 0..columns {
        for r in 0..rows {
            let x = -w / 2.0 + cw * (c as f32 + 0.5);
            let z = from + rh * r as f32;
            m.block(x, d / 2.0 - 0.012, z + gap, [cw - 2.0 * gap, 0.02, rh - 2.0 * gap]);
            if s.style[2] > 0.35 {
                let wide = rows > 1;
                let size = if wide { [cw * 0.3, 0.025, 0.015] } else { [0.015, 0.025, rh.min(0.9) * 0.2] };
                let x = if wide { x } else { x + cw * if c % 2 == 0 { 0.4 } else { -0.4 } };
                m.block(x, d / 2.0 + 0.008, z + rh * 0.6, size);
            }
        }
    }
}

/// Number of boards of a shelf, the lowest and the highest included.
fn board_count(s: &Shape) -> u32 {
    ((s.size[2] / lerp(0.28, 0.42, s.style[0])).round() as u32 + 1).clamp(2, 8)
}

fn board_heights(s: &Shape) -> Vec<f32> {
    let n = board_count(s);
    let low = if s.size[2] < 0.5 { 0.0 } else { lerp(0.02, 0.1, s.style[1]) };
    (0..n).map(|k| low + (s.size[2] - 0.025 - low) * k as f32 / (n - 1) as f32).collect()
}

fn shelf(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    let t = 0.02;
    for z in board_heights(s) {
        m.block(0.0, 0.0, z, [w, d, 0.025]);
    }
    match s.family {
        Family::Shelf => {
            for x in [-1.0, 1.0] {
                m.block(x * (w - t) / 2.0, 0.0, 0.0, [t, d, h]);
            }
            m.block(0.0, -d / 2.0 + 0.005, 0.0, [w, 0.01, h]);
            if w > 1.0 {
                m.block(0.0, 0.0, 0.0, [t, d * 0.98, h]);
            }
        }
        Family::ShelfBoards => {
            for x in [-1.0, 1.0] {
                m.block(x * (w - t) / 2.0, 0.0, 0.0, [t, d, h]);
            }
        }
        _ => legs(m, w, d, h, 0.03),
    }
}

/// The boards as places for things.
pub(super) fn boards(s: &Shape) -> Vec<Surface> {
    let z = board_heights(s);
    z.iter()
        .enumerate()
        .map(|(k, &b)| {
            let last = k + 1 == z.len();
            Surface {
                z: b + 0.025,
                centre: [0.0, 0.0],
                size: [s.size[0] - 0.06, (s.size[1] - 0.03).max(0.03)],
                clearance: z.get(k + 1).map_or(0.4, |n| n - b - 0.035),
                inside: !last,
            }
        })
        .collect()
}

/// A round door on the front.
fn disc_front(m: &mut Mesh, z: f32, r: f32, y: f32) {
    let ring = |k: u32| {
        let (s, c) = (std::f32::consts::TAU * k as f32 / 14.0).sin_cos();
        [r * c, y + 0.02, z + r * s]
    };
    for k in 0..14 {
        m.quad([[0.0, y + 0.035, z], ring(k + 1), ring(k), [0.0, y + 0.035, z]]);
    }
}
