//! Bathroom fixtures.

use super::{Family, Shape, lerp};
use crate::mesh::Mesh;

pub(super) fn build(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    match s.family {
        Family::Toilet => toilet(s, m),
        Family::Bathtub => hollow(m, s.size, 0.07, lerp(0.1, 0.25, s.style[0]), s.style[1] > 0.5),
        Family::Basin => {
            hollow(m, [w, d, h * 0.7], 0.04, h * 0.15, s.style[0] > 0.5);
            m.block(0.0, -d * 0.42, h * 0.6, [0.03, 0.03, h * 0.4]);
            m.block(0.0, -d * 0.3, h * 0.92, [0.025, d * 0.25, h * 0.08]);
        }
        Family::Pedestal => {
            let mut basin = Mesh::default();
            hollow(&mut basin, [w, d, 0.2], 0.05, 0.05, s.style[0] > 0.5);
            for p in &mut basin.points {
                p.z += h - 0.2;
            }
            m.append(&basin);
            m.lathe(0.0, -d * 0.15, &[(0.12, 0.0), (0.09, 0.1), (0.09, h - 0.2)], 10);
        }
        _ => {
            m.block(0.0, 0.0, 0.0, [w, d, 0.08]);
            for x in [-1.0, 1.0] {
                m.block(x * (w / 2.0 - 0.015), d / 2.0 - 0.015, 0.08, [0.03, 0.03, h - 0.08]);
            }
            m.block(w / 2.0 - 0.01, 0.0, 0.08, [0.012, d, h - 0.08]);
            m.block(0.0, -d / 2.0 + 0.03, h * 0.35, [0.04, 0.04, h * 0.55]);
        }
    }
}

fn toilet(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    let rim = h * lerp(0.48, 0.58, s.style[0]);
    let bowl = d * lerp(0.55, 0.68, s.style[1]);
    let y = d / 2.0 - bowl / 2.0;
    let mut part = Mesh::default();
    part.lathe(
        0.0,
        0.0,
        &[(0.5, 0.0), (0.55, 0.15), (0.7, 0.5), (1.0, 0.85), (1.0, 1.0), (0.75, 1.0), (0.5, 0.7)],
        16,
    );
    for p in &mut part.points {
        *p = nalgebra::Point3::new(p.x * w * 0.46, y + p.y * bowl / 2.0, p.z * rim);
    }
    m.append(&part);
    let tank = d - bowl + 0.04;
    if s.style[2] > 0.3 {
        m.block(0.0, -d / 2.0 + tank / 2.0, rim * 0.9, [w, tank, h - rim * 0.9]);
        m.block(0.0, -d / 2.0 + tank / 2.0, 0.0, [w * 0.5, tank, rim * 0.9]);
    } else {
        m.block(0.0, -d / 2.0 + tank / 2.0, 0.0, [w, tank, h]);
    }
    if s.style[3] > 0.6 {
        m.block(0.0, y - bowl * 0.45, rim, [w * 0.8, 0.04, (h - rim) * 0.95]);
    } else {
        m.cushion([0.0, y, rim + 0.01], [w * 0.48, bowl / 2.0, 0.02], 3.0, 8);
    }
}

/// A tub: outer box, inner hollow with a floor at `floor`.
fn hollow(m: &mut Mesh, size: [f32; 3], rim: f32, floor: f32, oval: bool) {
    let [w, d, h] = size;
    let n = if oval { 20 } else { 4 };
    let at = |k: u32, a: f32, b: f32, z: f32| {
        let t = std::f32::consts::TAU * (k as f32 + 0.5) / n as f32;
        let (s, c) = t.sin_cos();
        let (s, c) = if oval { (s, c) } else { (s.signum(), c.signum()) };
        [a / 2.0 * c, b / 2.0 * s, z]
    };
    let (iw, id) = (w - 2.0 * rim, d - 2.0 * rim);
    let (fw, fd) = (iw * 0.85, id * 0.85);
    for k in 0..n {
        let j = k + 1;
        m.quad([at(k, w, d, 0.0), at(j, w, d, 0.0), at(j, w, d, h), at(k, w, d, h)]);
        m.quad([at(k, w, d, h), at(j, w, d, h), at(j, iw, id, h), at(k, iw, id, h)]);
        m.quad([at(k, iw, id, h), at(j, iw, id, h), at(j, fw, fd, floor), at(k, fw, fd, floor)]);
        m.quad([[0.0, 0.0, floor], at(k, fw, fd, floor), at(j, fw, fd, floor), [0.0, 0.0, floor]]);
        m.quad([[0.0, 0.0, 0.0], at(j, w, d, 0.0), at(k, w, d, 0.0), [0.0, 0.0, 0.0]]);
    }
}
