//! Which neighbouring pixels lie on one continuous surface.

use crate::frame::{DOWN, Frame, RIGHT};

/// Writes `links`: the link of two neighbours is broken by invalid depth or by a jump that neither side's own
/// slope explains. On a plane inverse depth is linear over the image, so second differences see noise only.
pub(crate) fn links(frame: &mut Frame) {
    let (w, h) = (frame.width, frame.height);
    let steepest = 5.0 * frame.spacing;
    let none = vec![0f32; w];
    let row = |y: usize| if y < h { &frame.inverse[y * w..(y + 1) * w] } else { &none[..] };
    for y in 0..h {
        let (above, own, below, next) =
            (if y > 0 { row(y - 1) } else { &none }, row(y), row(y + 1), row(y + 2));
        let slack = &frame.slack[y * w..(y + 1) * w];
        let bits = &mut frame.links[y * w..(y + 1) * w];
        for ((((bit, &slack), &a), &b), (&c, &d)) in
            bits.iter_mut().zip(slack).zip(above).zip(own).zip(below.iter().zip(next))
        {
            *bit = if joined([a, b, c, d], slack, steepest) { DOWN } else { 0 };
        }
        let inner = own.windows(4).zip(&slack[1..]);
        for (bit, (v, &slack)) in bits[1.min(w)..].iter_mut().zip(inner) {
            *bit |= if joined([v[0], v[1], v[2], v[3]], slack, steepest) { RIGHT } else { 0 };
        }
        // The first and the last but one have no neighbour on one side.
        for x in [0, w.saturating_sub(2)] {
            if x + 1 < w {
                let before = if x > 0 { own[x - 1] } else { 0.0 };
                let after = if x + 2 < w { own[x + 2] } else { 0.0 };
                bits[x] |=
                    if joined([before, own[x], own[x + 1], after], slack[x], steepest) { RIGHT } else { 0 };
            }
        }
    }
}

/// Whether the middle two of four consecutive inverse depths (0 = invalid) are joined; `slack` is the sigma of the
/// second.
#[inline(always)]
fn joined([a, b, c, d]: [f32; 4], slack: f32, steepest: f32) -> bool {
    let step = c - b;
    let left = if a > 0.0 { b - a } else { 0.0 };
    let right = if d > 0.0 { d - c } else { 0.0 };
    let bend = (step - left).abs().min((step - right).abs());
    // Steeper than about 78 degrees in one pixel is a jump whatever surrounds it: flying pixels make ramps.
    (b > 0.0)
        & (c > 0.0)
        & (step.abs() <= 4.0 * slack + steepest * b)
        & (bend <= 6.0 * slack + 0.3 * left.abs().min(right.abs()))
}
