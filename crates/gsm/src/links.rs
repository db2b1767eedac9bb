//! Which neighbouring pixels lie on one continuous surface.

use crate::frame::{DOWN, Frame, RIGHT};

/// Writes `links`: the link of two neighbours is broken by invalid depth or by a jump that neither side's own
/// slope explains. On a plane inverse depth is linear over the image, so second differences see noise only.
pub(crate) fn links(frame: &mut Frame) {
    let (w, h) = (frame.width, frame.height);
    for y in 0..h {
        let row = &frame.inverse[y * w..(y + 1) * w];
        for x in 0..w {
            let i = y * w + x;
            let mut bits = 0;
            if x + 1 < w {
                let before = if x > 0 { row[x - 1] } else { 0.0 };
                let after = if x + 2 < w { row[x + 2] } else { 0.0 };
                if joined(frame, [before, row[x], row[x + 1], after]) {
                    bits |= RIGHT;
                }
            }
            if y + 1 < h {
                let before = if y > 0 { frame.inverse[i - w] } else { 0.0 };
                let after = if y + 2 < h { frame.inverse[i + 2 * w] } else { 0.0 };
                if joined(frame, [before, frame.inverse[i], frame.inverse[i + w], after]) {
                    bits |= DOWN;
                }
            }
            frame.links[i] = bits;
        }
    }
}

/// Whether the middle two of four consecutive inverse depths (0 = invalid) are joined.
#[inline]
fn joined(frame: &Frame, [a, b, c, d]: [f32; 4]) -> bool {
    if b == 0.0 || c == 0.0 {
        return false;
    }
    let step = c - b;
    let z = 1.0 / b;
    let sigma = frame.noise.sigma(z) * b * b;
    // Steeper than about 78 degrees in one pixel is a jump whatever surrounds it: flying pixels make ramps.
    if step.abs() > 4.0 * sigma + 5.0 * frame.spacing * b {
        return false;
    }
    let left = if a > 0.0 { b - a } else { 0.0 };
    let right = if d > 0.0 { d - c } else { 0.0 };
    let bend = (step - left).abs().min((step - right).abs());
    bend <= 6.0 * sigma + 0.3 * left.abs().min(right.abs())
}
