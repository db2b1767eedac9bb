//! Edges: concave creases and steps between the smoothed surfaces on the two sides of a pixel.

use crate::Params;
use crate::frame::{DOWN, Frame, RIGHT, dot, sub};

/// Writes `edge`. A pixel is an edge when it has no normal, when a link to one of its four neighbours is broken,
/// or when the points at half a window on both sides of it, along row or column, form a concave crease
/// (`(N₂ − N₁)·(P₂ − P₁) < 0`, after Stein et al. 2014) or a step.
pub(crate) fn edges(frame: &mut Frame, params: &Params) {
    let (w, h) = (frame.width, frame.height);
    let crease = params.concave_angle.cos();
    for y in 0..h {
        for x in 0..w {
            let i = y * w + x;
            let whole = x > 0
                && y > 0
                && frame.links[i] & (RIGHT | DOWN) == (RIGHT | DOWN)
                && frame.links[i - 1] & RIGHT != 0
                && frame.links[i - w] & DOWN != 0;
            if !whole || frame.normal[i] == [0.0; 3] {
                frame.edge[i] = 1;
                continue;
            }
            let [l, r, u, d] = frame.arms[i];
            let reach = (frame.noise.radius(frame.z[i]) / 2 + 1).max(1);
            let k = l.min(r).min(reach) as usize;
            let m = u.min(d).min(reach) as usize;
            let hit = creased(frame, params, crease, i, (x - k, y), (x + k, y))
                || creased(frame, params, crease, i, (x, y - m), (x, y + m));
            frame.edge[i] = u8::from(hit);
        }
    }
}

#[inline]
fn creased(
    frame: &Frame,
    params: &Params,
    crease: f32,
    centre: usize,
    (x1, y1): (usize, usize),
    (x2, y2): (usize, usize),
) -> bool {
    let (n1, n2) = (frame.normal[y1 * frame.width + x1], frame.normal[y2 * frame.width + x2]);
    if n1 == [0.0; 3] || n2 == [0.0; 3] {
        return false;
    }
    let across = sub(frame.point(x2, y2), frame.point(x1, y1));
    let cos = dot(n1, n2);
    if cos < crease {
        return dot(sub(n2, n1), across) < 0.0;
    }
    let mean = [n1[0] + n2[0], n1[1] + n2[1], n1[2] + n2[2]];
    let step = 0.5 * dot(mean, across).abs();
    let n = f32::from(2 * frame.noise.radius(frame.z[centre]) + 1);
    let sigma = frame.noise.sigma(frame.z[centre]);
    let length = dot(across, across).sqrt();
    step > params.step_sigmas * sigma / n.sqrt() + 0.05 * length
}
