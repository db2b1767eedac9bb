//! Lamps, plants, screens, bags, vessels and other small things.

use super::seating::legs;
use super::{Family, Shape, lerp};
use crate::mesh::Mesh;
use crate::rng::Draw;

/// Height of the middle board of a rack.
pub(super) fn rack_board(s: &Shape) -> f32 {
    s.size[2] * lerp(0.3, 0.5, s.style[1]) + 0.02
}

pub(super) fn build(s: &Shape, m: &mut Mesh, draw: &mut Draw) {
    match s.family {
        Family::FloorLamp | Family::TableLamp | Family::Pendant | Family::Disc => lamp(s, m),
        Family::Plant | Family::Flowers => plant(s, m, draw),
        Family::Screen | Family::FlatScreen | Family::Tower | Family::Printer => device(s, m),
        Family::Bag | Family::Backpack | Family::Suitcase | Family::OpenBox => luggage(s, m, draw),
        Family::Rack | Family::Dryer | Family::Ladder => bars(s, m),
        _ => vessel(s, m, draw),
    }
}

fn lamp(s: &Shape, m: &mut Mesh) {
    let [w, _, h] = s.size;
    let r = w / 2.0;
    match s.family {
        Family::FloorLamp | Family::TableLamp => {
            let shade = h * if s.family == Family::FloorLamp {
                lerp(0.14, 0.25, s.style[0])
            } else {
                lerp(0.35, 0.5, s.style[0])
            };
            m.lathe(0.0, 0.0, &[(r * 0.7, 0.0), (r * 0.7, 0.02), (0.02, 0.04), (0.015, h - shade)], 12);
            m.lathe(0.0, 0.0, &[(r, h - shade), (r * lerp(0.5, 1.0, s.style[1]), h)], 14);
        }
        Family::Pendant => {
            let shade = h * lerp(0.3, 0.6, s.style[0]);
            m.lathe(
                0.0,
                0.0,
                &[(r, 0.0), (r * 0.8, shade * 0.5), (r * lerp(0.1, 0.6, s.style[1]), shade)],
                14,
            );
            m.lathe(0.0, 0.0, &[(0.012, shade), (0.012, h)], 6);
        }
        _ => {
            if s.style[2] > 0.5 {
                m.block(0.0, 0.0, 0.0, s.size);
            } else {
                m.lathe(0.0, 0.0, &[(r * 0.6, 0.0), (r, h * 0.6), (r * 0.9, h)], 14);
            }
        }
    }
}

fn plant(s: &Shape, m: &mut Mesh, draw: &mut Draw) {
    let [w, d, h] = s.size;
    let pot = h * lerp(0.2, 0.4, s.style[0]);
    let pr = w.min(d) * lerp(0.2, 0.35, s.style[1]);
    if s.family == Family::Flowers {
        m.lathe(0.0, 0.0, &[(pr * 0.6, 0.0), (pr * 0.9, pot * 0.5), (pr * 0.5, pot)], 10);
    } else {
        m.lathe(0.0, 0.0, &[(pr * 0.75, 0.0), (pr, pot)], 10);
    }
    let leaves = 10 + (s.style[2] * 16.0) as usize;
    for _ in 0..leaves {
        let (sin, cos) = (draw.unit() * std::f32::consts::TAU).sin_cos();
        let (reach, rise) = (draw.range(0.4, 1.0) * w / 2.0, draw.range(0.35, 1.0));
        let width = draw.range(0.1, 0.22) * w;
        m.sheet(1, 3, |u, v| {
            let out = reach * v;
            let side = (u - 0.5) * width * (v * (1.0 - v) * 4.0 + 0.08);
            let z = pot + (h - pot) * rise * (1.5 * v - 0.5 * v * v);
            [cos * out - sin * side, sin * out + cos * side, z]
        });
    }
    if s.style[3] > 0.5 {
        m.cushion([0.0, 0.0, pot + (h - pot) * 0.5], [w * 0.25, d * 0.25, (h - pot) * 0.35], 2.0, 7);
    }
}

fn device(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    match s.family {
        Family::Screen => {
            let foot = h * lerp(0.12, 0.3, s.style[0]);
            m.block(0.0, 0.0, 0.0, [w * 0.4, d, 0.015]);
            m.block(0.0, -d * 0.1, 0.0, [w * 0.08, 0.03, foot + 0.05]);
            m.block(0.0, 0.0, foot, [w, lerp(0.03, 0.06, s.style[1]), h - foot]);
        }
        Family::FlatScreen => {
            m.block(0.0, 0.0, 0.0, [w, d * 0.5, h]);
            m.block(0.0, -d * 0.3, h * 0.25, [w * 0.5, d * 0.4, h * 0.5]);
        }
        Family::Tower => {
            m.block(0.0, 0.0, 0.0, [w, d * 0.96, h]);
            m.block(0.0, d * 0.48, h * 0.55, [w * 0.9, d * 0.04, h * 0.35]);
        }
        _ => {
            m.block(0.0, 0.0, 0.0, [w, d, h * 0.6]);
            m.block(0.0, -d * 0.1, h * 0.6, [w * 0.9, d * 0.7, h * 0.4]);
            m.block(0.0, d * 0.45, h * 0.3, [w * 0.6, d * 0.2, 0.02]);
        }
    }
}

fn luggage(s: &Shape, m: &mut Mesh, draw: &mut Draw) {
    let [w, d, h] = s.size;
    match s.family {
        Family::Bag => {
            let k = lerp(0.5, 0.85, s.style[0]);
            m.cushion(
                [0.0, 0.0, h * k / 2.0],
                [w / 2.0, d / 2.0, h * k / 2.0],
                lerp(2.2, 4.0, s.style[1]),
                8,
            );
            let lean = draw.range(-0.2, 0.2) * d;
            m.sheet(6, 1, |u, v| {
                let t = std::f32::consts::PI * u;
                [w * 0.28 * t.cos(), lean + (v - 0.5) * 0.03, h * k * 0.85 + (h - h * k * 0.85) * t.sin()]
            });
        }
        Family::Backpack => {
            m.cushion([0.0, -d * 0.1, h * 0.5], [w / 2.0, d * 0.4, h / 2.0], 3.5, 9);
            m.cushion([0.0, d * 0.3, h * 0.35], [w * 0.36, d * 0.2, h * 0.26], 3.5, 7);
        }
        Family::Suitcase => {
            m.cushion([0.0, 0.0, h * 0.45], [w / 2.0, d / 2.0, h * 0.42], 7.0, 8);
            for x in [-0.25, 0.25] {
                m.block(x * w, -d * 0.3, h * 0.8, [0.02, 0.02, h * 0.2]);
            }
            m.block(0.0, -d * 0.3, h - 0.02, [w * 0.55, 0.03, 0.02]);
            legs(m, w * 0.9, d * 0.9, 0.05, 0.04);
        }
        _ => {
            let t = 0.012;
            m.block(0.0, 0.0, 0.0, [w, d, t]);
            for x in [-1.0, 1.0] {
                m.block(x * (w - t) / 2.0, 0.0, t, [t, d, h - t]);
                m.block(0.0, x * (d - t) / 2.0, t, [w - 2.0 * t, t, h - t]);
            }
            m.block(0.0, 0.0, t, [w * 0.8, d * 0.8, h * lerp(0.2, 0.7, s.style[0])]);
        }
    }
}

fn vessel(s: &Shape, m: &mut Mesh, draw: &mut Draw) {
    let [w, d, h] = s.size;
    let r = 0.5;
    let part: &[(f32, f32)] = match s.family {
        Family::Bin => &[(r * 0.78, 0.0), (r, 1.0), (r * 0.92, 1.0), (r * 0.72, 0.06)],
        Family::Basket => &[(r * 0.85, 0.0), (r, 0.55), (r * 0.93, 1.0), (r * 0.86, 0.98), (r * 0.8, 0.2)],
        Family::Bottle => &[(r, 0.0), (r, 0.6), (r * 0.3, 0.78), (r * 0.3, 1.0)],
        Family::Plate => &[(r * 0.5, 0.0), (r, 1.0), (r * 0.95, 1.0), (r * 0.5, 0.3)],
        Family::Vase => &[(r * 0.5, 0.0), (r, 0.35), (r * 0.4, 0.8), (r * 0.6, 1.0)],
        Family::Pot => &[(r * 0.9, 0.0), (r, 0.75), (r * 0.9, 0.85), (r * 0.15, 0.92), (r * 0.12, 1.0)],
        _ => &[(r * 0.9, 0.0), (r, 0.2), (r * 0.7, 0.8), (r * 0.3, 1.0)],
    };
    if s.family == Family::Shoes {
        for x in [-1.0, 1.0] {
            let y = draw.range(-0.1, 0.1) * d;
            m.cushion([x * w * 0.27, y, h * 0.3], [w * 0.2, d * 0.42, h * 0.3], 2.6, 6);
            m.cushion([x * w * 0.27, y - d * 0.25, h * 0.6], [w * 0.17, d * 0.17, h * 0.4], 2.6, 6);
        }
        return;
    }
    let square = s.style[3] > 0.62 && matches!(s.family, Family::Bin | Family::Basket);
    let mut body = Mesh::default();
    body.lathe(0.0, 0.0, part, if square { 4 } else { 14 });
    if square {
        body = body.transformed(&nalgebra::Isometry3::rotation(
            nalgebra::Vector3::z() * std::f32::consts::FRAC_PI_4,
        ));
    }
    for p in &mut body.points {
        *p = nalgebra::Point3::new(p.x * w, p.y * d, p.z * h);
    }
    m.append(&body);
    if s.family == Family::Kettle {
        m.block(w * 0.45, 0.0, h * 0.3, [w * 0.15, 0.02, h * 0.5]);
    }
}

fn bars(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    let t = 0.025;
    match s.family {
        Family::Rack => {
            legs(m, w, d, h, t);
            m.block(0.0, 0.0, rack_board(s) - 0.02, [w * 0.96, d * 0.96, 0.02]);
            m.block(0.0, 0.0, h - t, [w, t, t]);
            for x in [-1.0, 1.0] {
                m.block(x * (w - t) / 2.0, 0.0, h - t, [t, d, t]);
            }
        }
        Family::Dryer => {
            for x in [-1.0, 1.0] {
                m.block(x * w * 0.3, 0.0, 0.0, [t, d, t]);
                m.block(x * w * 0.3, d * 0.3, 0.0, [t, t, h * 0.97]);
                m.block(x * w * 0.3, -d * 0.3, 0.0, [t, t, h * 0.97]);
            }
            let n = 5 + (s.style[0] * 5.0) as u32;
            for k in 0..n {
                m.block(0.0, -d / 2.0 + d * (k as f32 + 0.5) / n as f32, h - 0.02, [w, 0.012, 0.012]);
            }
        }
        _ => {
            for x in [-1.0, 1.0] {
                m.block(x * (w - t) / 2.0, 0.0, 0.0, [t * 1.5, d, h]);
            }
            let n = (h / 0.28).round().clamp(2.0, 9.0) as u32;
            for k in 0..n {
                m.block(0.0, 0.0, h * (k as f32 + 0.5) / n as f32, [w, d * 0.8, 0.03]);
            }
        }
    }
}
