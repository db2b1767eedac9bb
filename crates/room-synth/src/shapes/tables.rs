//! Tables and desks.

use super::seating::legs;
use super::{Family, Shape, lerp};
use crate::mesh::Mesh;

pub(super) fn build(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    let top = lerp(0.02, 0.05, s.style[0]);
    if s.family == Family::TableRound {
        return round(s, m, top);
    }
    m.block(0.0, 0.0, h - top, [w, d, top]);
    let leg = lerp(0.035, 0.08, s.style[1]);
    match s.family {
        Family::TablePanel => {
            for x in [-1.0, 1.0] {
                m.block(x * (w / 2.0 - leg), 0.0, 0.0, [leg * 0.6, d * 0.92, h - top]);
            }
            m.block(0.0, -d * lerp(0.1, 0.45, s.style[2]), h * 0.5, [w - 2.0 * leg, 0.02, h * 0.5 - top]);
        }
        Family::TableShelf => {
            legs(m, w * 0.97, d * 0.97, h - top, leg);
            m.block(0.0, 0.0, h * lerp(0.2, 0.45, s.style[2]), [w * 0.93, d * 0.93, 0.025]);
        }
        Family::DeskDrawers => {
            let width = (w * lerp(0.25, 0.38, s.style[2])).min(0.5);
            let side = if s.style[3] > 0.5 { 1.0 } else { -1.0 };
            let x = side * (w - width) / 2.0;
            m.block(x, 0.0, 0.03, [width, d * 0.94, h - top - 0.03]);
            for k in 0..3 {
                let z = 0.06 + (h - top - 0.06) * k as f32 / 3.0;
                m.block(x, d * 0.47, z + 0.01, [width * 0.92, 0.03, (h - top) / 3.0 - 0.03]);
            }
            for y in [-1.0, 1.0] {
                m.block(-side * (w - leg) / 2.0, y * (d - leg) / 2.0, 0.0, [leg, leg, h - top]);
            }
            m.block(-side * width / 2.0, -d * 0.46, h * 0.55, [w - width, 0.02, h * 0.4]);
        }
        _ => {
            legs(m, w * lerp(0.8, 1.0, s.style[2]), d * lerp(0.8, 1.0, s.style[2]), h - top, leg);
            if s.style[3] > 0.4 {
                let apron = 0.07_f32.min(h * 0.2);
                for y in [-1.0, 1.0] {
                    m.block(0.0, y * d * 0.4, h - top - apron, [w * 0.8, 0.02, apron]);
                }
            }
        }
    }
}

fn round(s: &Shape, m: &mut Mesh, top: f32) {
    let [w, _, h] = s.size;
    let r = w / 2.0;
    m.lathe(0.0, 0.0, &[(r, h - top), (r, h)], 20);
    if s.style[1] > 0.5 {
        m.lathe(0.0, 0.0, &[(r * 0.55, 0.0), (r * 0.5, 0.03), (0.05, 0.07), (0.05, h - top)], 12);
    } else {
        legs(m, w * 0.66, w * 0.66, h - top, lerp(0.03, 0.06, s.style[2]));
    }
}
