//! Which neighbouring pixels lie on one continuous surface.

use crate::frame::{BAND, DOWN, Frame, RIGHT};
use crate::lanes::wide;
use rayon::prelude::*;

/// Writes `links`: the link of two neighbours is broken by invalid depth or by a jump that neither side's own
/// slope explains. On a plane inverse depth is linear over the image, so second differences see noise only.
pub(crate) fn links(frame: &mut Frame) {
    let Frame { width, height, inverse, slack, links, spacing, .. } = frame;
    let (w, h, steepest) = (*width, *height, 5.0 * *spacing);
    let none = vec![0f32; w];
    let row = |y: usize| if y < h { &inverse[y * w..(y + 1) * w] } else { &none[..] };
    (slack.par_chunks(BAND * w), links.par_chunks_mut(BAND * w)).into_par_iter().enumerate().for_each(
        |(b, (slack, links))| {
            for (y, (slack, bits)) in slack.chunks_exact(w).zip(links.chunks_exact_mut(w)).enumerate() {
                let y = b * BAND + y;
                let above = if y > 0 { row(y - 1) } else { &none };
                let rows = [above, row(y), row(y + 1), row(y + 2)];
                wide(
                    #[inline(always)]
                    || {
                        join_down(rows, slack, steepest, bits);
                        join_right(rows[1], slack, steepest, bits);
                    },
                );
            }
        },
    );
}

/// Sets the links of a row, the second of four, to the one below.
#[inline(always)]
fn join_down([above, own, below, next]: [&[f32]; 4], slack: &[f32], steepest: f32, bits: &mut [u8]) {
    for ((((bit, &slack), &a), &b), (&c, &d)) in
        bits.iter_mut().zip(slack).zip(above).zip(own).zip(below.iter().zip(next))
    {
        *bit = if joined([a, b, c, d], slack, steepest) { DOWN } else { 0 };
    }
}

/// Adds the links of a row to the right.
#[inline(always)]
fn join_right(own: &[f32], slack: &[f32], steepest: f32, bits: &mut [u8]) {
    let w = own.len();
    if w > 3 {
        let four = own.iter().zip(&own[1..]).zip(own[2..].iter().zip(&own[3..]));
        for ((bit, &slack), ((&a, &b), (&c, &d))) in bits[1..].iter_mut().zip(&slack[1..]).zip(four) {
            *bit |= if joined([a, b, c, d], slack, steepest) { RIGHT } else { 0 };
        }
    }
    // The first and the last but one have no neighbour on one side.
    for x in [0, w.saturating_sub(2)] {
        if x + 1 < w {
            let before = if x > 0 { own[x - 1] } else { 0.0 };
            let after = if x + 2 < w { own[x + 2] } else { 0.0 };
            let four = [before, own[x], own[x + 1], after];
            bits[x] |= if joined(four, slack[x], steepest) { RIGHT } else { 0 };
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
