//! Beds and what is made of cloth.

use super::seating::legs;
use super::{Family, Shape, lerp};
use crate::mesh::Mesh;
use crate::rng::Draw;

/// Height of the mattress.
pub(super) fn mattress_top(s: &Shape) -> f32 {
    (s.size[2] * lerp(0.45, 0.62, s.style[0])).clamp(0.2, 0.72).min(s.size[2])
}

pub(super) fn bed(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    let top = mattress_top(s);
    m.cushion([0.0, 0.0, top - 0.11], [w * 0.49, d * 0.48, 0.11], 8.0, 8);
    m.block(0.0, -d / 2.0 + 0.03, 0.0, [w, 0.06, h]);
    match s.family {
        Family::BedBox => m.block(0.0, 0.0, 0.02, [w * 0.98, d, top - 0.14]),
        Family::BedFrame => {
            legs(m, w, d, top - 0.15, 0.06);
            m.block(0.0, 0.0, top - 0.22, [w, d, 0.07]);
            m.block(0.0, d / 2.0 - 0.02, top - 0.2, [w, 0.04, lerp(0.2, 0.4, s.style[1]).min(h - top + 0.2)]);
        }
        _ => {
            m.block(0.0, 0.0, lerp(0.08, 0.2, s.style[2]).min(top * 0.4), [w, d, top * 0.35]);
            legs(m, w * 0.9, d * 0.9, 0.2_f32.min(top * 0.4), 0.07);
        }
    }
}

pub(super) fn build(s: &Shape, m: &mut Mesh, draw: &mut Draw) {
    let [w, d, h] = s.size;
    match s.family {
        Family::Pillow => {
            m.cushion([0.0; 3], [w / 2.0, d / 2.0, h / 2.0], lerp(2.6, 5.0, s.style[0]), 8);
            // Pinched corners and a dent tell cloth from wood.
            let (dent, at) = (draw.range(0.0, 0.3), draw.range(-0.3, 0.3));
            for p in &mut m.points {
                let x = 2.0 * p.x / w;
                if p.z > 0.0 {
                    p.z *= 1.0 - dent * (1.0 - (x - at).abs()).max(0.0);
                }
            }
        }
        Family::Blanket => {
            let (a, b) = (draw.range(4.0, 9.0), draw.range(3.0, 8.0));
            let (p, q) = (draw.range(0.0, 6.0), draw.range(0.0, 6.0));
            let z = move |u: f32, v: f32| {
                let edge = (u.min(1.0 - u).min(v.min(1.0 - v)) * 6.0).min(1.0);
                edge * h * (0.6 + 0.2 * (a * u + p).sin() + 0.2 * (b * v + q).sin())
            };
            m.sheet(12, 12, |u, v| [(u - 0.5) * w, (v - 0.5) * d, z(u, v)]);
        }
        Family::Curtain => {
            let folds = (w / lerp(0.1, 0.22, s.style[0])).round().clamp(2.0, 18.0);
            let phase = draw.range(0.0, 6.0);
            let sway = draw.range(-0.4, 0.4);
            m.sheet((folds as u32) * 4, 6, |u, v| {
                let wave = (folds * std::f32::consts::TAU * u + phase + sway * v).sin();
                [(u - 0.5) * w * (1.0 - 0.1 * v * (1.0 - v)), 0.5 * d * wave * (1.0 - 0.3 * v), v * h]
            });
        }
        Family::Hanging => {
            let (a, p) = (draw.range(4.0, 10.0), draw.range(0.0, 6.0));
            m.sheet(8, 8, |u, v| [(u - 0.5) * w, -d * 0.3 + 0.2 * d * (a * u + p).sin() * (1.0 - v), v * h]);
            m.sheet(8, 5, |u, v| {
                [(u - 0.5) * w * 0.95, d * 0.3 + 0.2 * d * (a * u + p).sin() * (1.0 - v), h * (0.4 + 0.6 * v)]
            });
            m.block(0.0, 0.0, h * 0.97, [w, d * 0.6, h * 0.03]);
        }
        Family::Clothes => {
            let mut blob = Mesh::default();
            blob.cushion([0.0, 0.0, h * 0.45], [w / 2.0, d / 2.0, h * 0.5], 2.2, 9);
            let (a, b, p) =
                (draw.range(6.0, 14.0) / w, draw.range(6.0, 14.0) / d.max(0.05), draw.range(0.0, 6.0));
            for q in &mut blob.points {
                let k = 1.0 + 0.16 * (a * q.x + p).sin() + 0.16 * (b * q.y - p).sin();
                q.x *= k;
                q.z = (q.z * k).max(0.0);
            }
            m.append(&blob);
        }
        Family::Toy => {
            m.cushion([0.0, 0.0, h * 0.3], [w * 0.4, d * 0.4, h * 0.3], 2.0, 8);
            m.cushion([0.0, d * 0.05, h * 0.76], [w * 0.27, d * 0.3, h * 0.24], 2.0, 8);
            for x in [-1.0, 1.0] {
                m.cushion([x * w * 0.35, d * 0.25, h * 0.12], [w * 0.15, d * 0.25, h * 0.1], 2.0, 5);
                m.cushion([x * w * 0.4, d * 0.1, h * 0.45], [w * 0.1, d * 0.2, h * 0.1], 2.0, 5);
            }
        }
        _ => heap(s, m, draw),
    }
}

/// A heap of small boxes and blobs: clutter, item, object.
fn heap(s: &Shape, m: &mut Mesh, draw: &mut Draw) {
    let [w, d, h] = s.size;
    let n = 1 + (s.style[0] * 4.0) as usize;
    for k in 0..n {
        let size = [w * draw.range(0.3, 0.9), d * draw.range(0.3, 0.9), h * draw.range(0.3, 1.0)];
        let x = draw.range(-0.5, 0.5) * (w - size[0]);
        let y = draw.range(-0.5, 0.5) * (d - size[1]);
        match (s.style[1] * 3.0) as usize + k {
            0 | 3 => m.block(x, y, 0.0, size),
            1 | 4 => m.lathe(
                x,
                y,
                &[(size[0] * 0.45, 0.0), (size[0] * 0.5, size[2] * 0.8), (size[0] * 0.2, size[2])],
                10,
            ),
            _ => m.cushion([x, y, size[2] / 2.0], [size[0] / 2.0, size[1] / 2.0, size[2] / 2.0], 3.0, 6),
        }
    }
}
