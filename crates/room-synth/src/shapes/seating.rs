//! Chairs, stools, armchairs, sofas, benches.

use super::{Family, Shape, lerp};
use crate::mesh::Mesh;

/// Height of a chair's seat.
pub(super) fn seat_height(s: &Shape) -> f32 {
    (s.size[2] * lerp(0.48, 0.6, s.style[0])).min(s.size[2] - 0.05)
}

/// Arm width, back depth, seat height of a sofa or armchair.
pub(super) fn sofa_parts(s: &Shape) -> [f32; 3] {
    let [w, d, h] = s.size;
    let arm = (lerp(0.04, 0.13, s.style[0]) * w.min(1.6)).max(0.04);
    [arm, d * lerp(0.16, 0.3, s.style[1]), h * lerp(0.42, 0.58, s.style[2])]
}

pub(super) fn build(s: &Shape, m: &mut Mesh) {
    match s.family {
        Family::ChairLegs => chair_legs(s, m),
        Family::ChairSled => chair_sled(s, m),
        Family::ChairOffice => chair_office(s, m),
        Family::ChairShell => chair_shell(s, m),
        Family::Armchair | Family::Sofa => sofa(s, m),
        Family::SofaCorner => sofa_corner(s, m),
        Family::StoolRound => stool_round(s, m),
        Family::Bench => bench(s, m),
        Family::Ottoman => ottoman(s, m),
        _ => stool(s, m),
    }
}

/// Four legs at the corners of a rectangle.
pub(super) fn legs(m: &mut Mesh, w: f32, d: f32, height: f32, thick: f32) {
    for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        m.block(x * (w - thick) / 2.0, y * (d - thick) / 2.0, 0.0, [thick, thick, height]);
    }
}

fn backrest(s: &Shape, m: &mut Mesh, from: f32) {
    let [w, d, h] = s.size;
    let y = -d / 2.0 + 0.02;
    if s.style[2] < 0.5 {
        m.block(0.0, y, from, [w * 0.94, 0.035, h - from]);
        return;
    }
    let post = 0.035;
    for x in [-1.0, 1.0] {
        m.block(x * (w - post) / 2.0, y, from, [post, post, h - from]);
    }
    let slats = 2 + (s.style[3] * 3.0) as u32;
    for k in 0..slats {
        let z = lerp(from + 0.08, h - 0.07, k as f32 / (slats - 1) as f32);
        m.block(0.0, y, z, [w - 2.0 * post, 0.02, 0.06]);
    }
}

fn chair_legs(s: &Shape, m: &mut Mesh) {
    let [w, d, _] = s.size;
    let seat = seat_height(s);
    legs(m, w * 0.96, d * 0.96, seat - 0.04, lerp(0.025, 0.05, s.style[1]));
    m.block(0.0, 0.0, seat - 0.045, [w, d, 0.045]);
    backrest(s, m, seat);
}

fn chair_sled(s: &Shape, m: &mut Mesh) {
    let [w, d, _] = s.size;
    let (seat, t) = (seat_height(s), 0.03);
    for x in [-1.0, 1.0] {
        let x = x * (w - t) / 2.0;
        m.block(x, 0.0, 0.0, [t, d, t]);
        m.block(x, d / 2.0 - t, t, [t, t, seat - t]);
    }
    m.block(0.0, 0.0, seat - 0.05, [w, d * 0.95, 0.05]);
    backrest(s, m, seat);
    if s.style[1] > 0.55 {
        for x in [-1.0, 1.0] {
            m.block(x * (w - t) / 2.0, 0.02, seat + 0.18, [t, d * 0.8, 0.03]);
            m.block(x * (w - t) / 2.0, d * 0.35, seat, [t, t, 0.2]);
        }
    }
}

fn chair_office(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    let seat = h * lerp(0.44, 0.54, s.style[0]);
    let reach = w.min(d) / 2.0;
    for k in 0..5 {
        let (sin, cos) = (std::f32::consts::TAU * k as f32 / 5.0).sin_cos();
        let (x, y) = (cos * reach * 0.5, sin * reach * 0.5);
        m.block(x, y, 0.05, [0.05 + reach * cos.abs() * 0.9, 0.05 + reach * sin.abs() * 0.9, 0.04]);
        m.block(2.0 * x, 2.0 * y, 0.0, [0.05, 0.05, 0.06]);
    }
    m.lathe(0.0, 0.0, &[(0.03, 0.08), (0.03, seat - 0.07)], 8);
    m.cushion([0.0, 0.02, seat - 0.04], [w * 0.46, d * 0.44, 0.05], 4.0, 6);
    m.cushion([0.0, -d * 0.42, (seat + 0.12 + h) / 2.0], [w * 0.42, 0.045, (h - seat - 0.12) / 2.0], 4.0, 6);
    m.block(0.0, -d * 0.42, seat - 0.05, [0.06, 0.03, 0.2]);
    if s.style[1] > 0.4 {
        for x in [-1.0, 1.0] {
            m.block(x * (w / 2.0 - 0.03), 0.0, seat + 0.17, [0.06, d * 0.5, 0.03]);
            m.block(x * (w / 2.0 - 0.03), 0.0, seat - 0.06, [0.03, 0.05, 0.24]);
        }
    }
}

fn chair_shell(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    let seat = seat_height(s);
    legs(m, w * 0.8, d * 0.8, seat - 0.02, 0.025);
    m.sheet(6, 8, |u, v| {
        let x = (u - 0.5) * w;
        let bowl = 0.25 * (2.0 * u - 1.0) * (2.0 * u - 1.0);
        let (y, z) = if v < 0.5 {
            (d / 2.0 - 2.0 * v * d * 0.88, seat + bowl * 0.1 + 0.02 * (1.0 - 2.0 * v))
        } else {
            (-d * 0.38 - (2.0 * v - 1.0) * d * 0.12 + bowl * 0.2, seat + (2.0 * v - 1.0) * (h - seat))
        };
        [x * (1.0 - 0.15 * v), y, z]
    });
    m.block(0.0, 0.0, seat - 0.03, [w * 0.7, d * 0.7, 0.03]);
}

fn sofa(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    let [arm, back, seat] = sofa_parts(s);
    let foot = lerp(0.0, 0.12, s.style[3]);
    if foot > 0.03 {
        legs(m, w, d, foot, 0.05);
    }
    m.cuboid([-w / 2.0, -d / 2.0, foot], [w / 2.0, d / 2.0, seat - 0.12]);
    let inner = w - 2.0 * arm;
    let places = (inner / 0.75).round().max(1.0);
    let each = inner / places;
    for k in 0..places as u32 {
        let x = -inner / 2.0 + each * (k as f32 + 0.5);
        m.cushion([x, back / 2.0, seat - 0.08], [each * 0.49, (d - back) / 2.0, 0.08], 5.0, 6);
        m.cushion(
            [x, -d / 2.0 + back * 0.7, (seat + h) / 2.0],
            [each * 0.48, back * 0.35, (h - seat) / 2.0],
            5.0,
            6,
        );
    }
    m.cuboid([-w / 2.0, -d / 2.0, foot], [w / 2.0, -d / 2.0 + back * 0.5, h * 0.96]);
    let arm_top = lerp(seat + 0.05, h * 0.9, s.style[2] * 0.8);
    for x in [-1.0, 1.0] {
        m.block(x * (w - arm) / 2.0, 0.0, foot, [arm, d, arm_top - foot]);
    }
}

fn sofa_corner(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    let [arm, back, seat] = sofa_parts(s);
    let long = d.min(back + 0.6).max(0.6);
    m.cuboid([-w / 2.0, -d / 2.0, 0.03], [w / 2.0, -d / 2.0 + long, seat]);
    m.cuboid([w / 2.0 - 0.8_f32.min(w / 2.0), -d / 2.0, 0.03], [w / 2.0, d / 2.0, seat - 0.01]);
    m.cuboid([-w / 2.0, -d / 2.0, 0.03], [w / 2.0, -d / 2.0 + back.min(0.25), h]);
    m.cuboid([-w / 2.0, -d / 2.0, 0.03], [-w / 2.0 + arm, -d / 2.0 + long, lerp(seat, h, 0.6)]);
    m.cuboid([w / 2.0 - arm, -d / 2.0, 0.03], [w / 2.0, d / 2.0 - 0.4, h * 0.95]);
}

fn stool(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    legs(m, w, d, h - 0.04, lerp(0.03, 0.05, s.style[0]));
    m.block(0.0, 0.0, h - 0.05, [w, d, 0.05]);
    if s.style[1] > 0.4 {
        let z = h * lerp(0.2, 0.5, s.style[2]);
        m.block(0.0, d / 2.0 - 0.02, z, [w * 0.9, 0.02, 0.03]);
        m.block(0.0, 0.02 - d / 2.0, z, [w * 0.9, 0.02, 0.03]);
    }
}

fn stool_round(s: &Shape, m: &mut Mesh) {
    let [w, _, h] = s.size;
    let r = w / 2.0;
    m.lathe(0.0, 0.0, &[(r * 0.9, h - 0.07), (r, h - 0.03), (r * 0.9, h)], 16);
    if s.style[0] > 0.5 {
        m.lathe(0.0, 0.0, &[(r * 0.8, 0.0), (0.04, 0.03), (0.03, h - 0.06)], 12);
    } else {
        legs(m, w * 0.7, w * 0.7, h - 0.05, 0.03);
    }
}

fn bench(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    m.block(0.0, 0.0, h - 0.06, [w, d, 0.06]);
    if s.style[0] > 0.5 {
        legs(m, w * 0.95, d * 0.9, h - 0.05, 0.05);
    } else {
        for x in [-1.0, 1.0] {
            m.block(x * w * 0.42, 0.0, 0.0, [0.05, d * 0.9, h - 0.05]);
        }
    }
}

fn ottoman(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    m.block(0.0, 0.0, 0.04, [w * 0.96, d * 0.96, h * 0.7]);
    m.cushion([0.0, 0.0, h * 0.75], [w / 2.0, d / 2.0, h * 0.25], 5.0, 8);
    legs(m, w * 0.8, d * 0.8, 0.06, 0.05);
}
