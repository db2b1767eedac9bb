//! What belongs to walls: windows, doors, frames, blinds, heaters, panels.

use super::{Family, Shape, lerp};
use crate::mesh::Mesh;

pub(super) fn build(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    match s.family {
        Family::Window => window(s, m),
        Family::Door => {
            m.block(0.0, 0.0, 0.0, [w, d * 0.45, h]);
            if s.style[0] > 0.45 {
                for z in [0.1, 0.55] {
                    m.block(0.0, d * 0.2, h * z, [w * 0.7, d * 0.12, h * 0.35]);
                    m.block(0.0, -d * 0.2, h * z, [w * 0.7, d * 0.12, h * 0.35]);
                }
            }
            for y in [-1.0, 1.0] {
                m.block(w * 0.4, y * d * 0.4, h * 0.48, [0.12, d * 0.2, 0.03]);
            }
        }
        Family::DoorFrame => {
            let bar = lerp(0.06, 0.12, s.style[0]);
            for x in [-1.0, 1.0] {
                m.block(x * (w - bar) / 2.0, 0.0, 0.0, [bar, d, h]);
            }
            m.block(0.0, 0.0, h - bar, [w, d, bar]);
        }
        Family::Blinds => {
            let n = (h / 0.09).round().clamp(4.0, 24.0) as u32;
            for k in 0..n {
                let z = h * (k as f32 + 0.5) / n as f32;
                m.sheet(1, 1, |u, v| [(u - 0.5) * w, (v - 0.5) * d, z + (v - 0.5) * h / n as f32 * 0.95]);
            }
            m.block(0.0, 0.0, h - 0.05, [w, d, 0.05]);
        }
        Family::Sill => m.block(0.0, 0.0, 0.0, [w, d, h]),
        Family::Ribs => {
            let n = (w / lerp(0.05, 0.1, s.style[1])).round().clamp(4.0, 20.0) as u32;
            for k in 0..n {
                let x = -w / 2.0 + w * (k as f32 + 0.5) / n as f32;
                m.block(x, 0.0, 0.0, [w / n as f32 * 0.7, d, h]);
            }
            for z in [0.06, 0.9] {
                m.block(0.0, 0.0, h * z, [w, d * 0.6, h * 0.08]);
            }
            if s.style[0] > 0.5 {
                m.block(0.0, 0.0, h - 0.02, [w, d, 0.02]);
            }
        }
        Family::Pipe => {
            m.lathe(0.0, 0.0, &[(w / 2.0, 0.0), (w / 2.0, h)], 8);
        }
        _ => {
            // A flat panel with a frame standing out: picture, mirror, board.
            let bar = (lerp(0.0, 0.12, s.style[0]) * w.min(h)).max(0.008);
            m.block(0.0, -d * 0.25, 0.0, [w, d * 0.5, h]);
            if s.style[1] > 0.3 {
                m.block(0.0, d * 0.25, 0.0, [w, d * 0.5, bar]);
                m.block(0.0, d * 0.25, h - bar, [w, d * 0.5, bar]);
                for x in [-1.0, 1.0] {
                    m.block(x * (w - bar) / 2.0, d * 0.25, 0.0, [bar, d * 0.5, h]);
                }
            }
        }
    }
}

fn window(s: &Shape, m: &mut Mesh) {
    let [w, d, h] = s.size;
    let bar = lerp(0.05, 0.1, s.style[0]);
    let panes = (w / lerp(0.5, 1.1, s.style[1])).round().clamp(1.0, 4.0) as u32;
    for k in 0..=panes {
        let x = -w / 2.0 + bar / 2.0 + (w - bar) * k as f32 / panes as f32;
        m.block(x, 0.0, 0.0, [bar, d, h]);
    }
    for z in [0.0, h - bar] {
        m.block(0.0, 0.0, z, [w, d, bar]);
    }
    if s.style[2] > 0.6 {
        m.block(0.0, 0.0, h * 0.62, [w, d * 0.8, bar * 0.8]);
    }
    m.block(0.0, -d * 0.3, bar, [w - bar, d * 0.1, h - 2.0 * bar]);
}
