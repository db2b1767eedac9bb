//! Edges: concave creases and steps between the smoothed surfaces on the two sides of a pixel.

use crate::Params;
use crate::frame::{Frame, dot, sub};
use crate::noise::Window;

/// Writes `edge`. A pixel is an edge when it has no normal, when a link to one of its four neighbours is broken,
/// or when the points on both sides of it, along row or column at the window's reach, form a concave crease
/// (`(N₂ − N₁)·(P₂ − P₁) < 0`, after Stein et al. 2014) or a step.
pub(crate) fn edges(frame: &mut Frame, params: &Params) {
    let (w, h) = (frame.width, frame.height);
    let crease = params.concave_angle.cos();
    let mut edge = std::mem::take(&mut frame.edge);
    for y in 0..h {
        for x in 0..w {
            let i = y * w + x;
            let [l, r, u, d] = frame.arms[i];
            if l.min(r).min(u).min(d) == 0 || frame.smooth[i] == 0.0 {
                edge[i] = 1;
                continue;
            }
            let Window { reach, smooth, .. } = frame.noise.window(frame.z[i], frame.gain[i]);
            let k = l.min(r).min(reach) as usize;
            let m = u.min(d).min(reach) as usize;
            let step = params.step_sigmas * smooth;
            let hit = creased(frame, crease, step, [i - k, i + k], [x - k, x + k], [y, y])
                || creased(frame, crease, step, [i - m * w, i + m * w], [x, x], [y - m, y + m]);
            edge[i] = u8::from(hit);
        }
    }
    frame.edge = edge;
}

/// Whether the surface bends inwards or steps between two pixels, given by index, column and row.
#[inline(always)]
fn creased(frame: &Frame, crease: f32, step: f32, i: [usize; 2], x: [usize; 2], y: [usize; 2]) -> bool {
    let [n1, n2] = i.map(|i| frame.normal[i]);
    let [z1, z2] = i.map(|i| frame.smooth[i]);
    if z1 == 0.0 || z2 == 0.0 {
        return false;
    }
    let point = |z: f32, k: usize| [z * frame.ray_x[x[k]], z * frame.ray_y[y[k]], z];
    let across = sub(point(z2, 1), point(z1, 0));
    if dot(n1, n2) < crease {
        return dot(sub(n2, n1), across) < 0.0;
    }
    let mean = [n1[0] + n2[0], n1[1] + n2[1], n1[2] + n2[2]];
    let height = 0.5 * dot(mean, across).abs();
    // height > step + |across| / 20, without the root.
    let excess = height - step;
    excess > 0.0 && 400.0 * excess * excess > dot(across, across)
}
