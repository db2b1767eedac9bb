//! Regions of a frame: connected pixels that are no edges, grown back into the edges between them.
//!
//! Rows are taken as bits, 64 pixels a word, and components as runs of pixels, so that the inside of a surface costs
//! next to nothing.

use crate::frame::{BAND, DOWN, Frame, RIGHT};
use crate::lanes::{LANES, wide};
use rayon::prelude::*;

/// Writes `label` and `region_size`: 4-connected components of non-edge pixels over unbroken links, numbered from 1
/// in raster order of their first pixel; components of fewer than `min_pixels` are dropped; then labels grow
/// over unbroken links into edge pixels, nearest first.
pub(crate) fn regions(frame: &mut Frame, min_pixels: u32) {
    let mut runs = std::mem::take(&mut frame.runs);
    runs.read(frame);
    runs.unite();
    runs.number(frame, min_pixels);
    let seeds = runs.seed(frame);
    grow(frame, &mut runs, seeds);
    frame.runs = runs;
}

/// Consecutive linked pixels of a row that are no edges: columns `start..=end`.
#[derive(Debug, Clone, Copy)]
struct Run {
    start: u32,
    end: u32,
    /// An earlier run of the same component, or itself.
    parent: u32,
    /// Pixels of the component (where it is its own parent), then its label.
    count: u32,
}

/// Workspace: rows as bits, and their runs.
#[derive(Debug, Default)]
pub(crate) struct Runs {
    /// Words per row.
    words: usize,
    /// Pixels that are no edges; unbroken links to the right and down.
    open: Vec<u64>,
    right: Vec<u64>,
    down: Vec<u64>,
    /// Labelled pixels.
    held: Vec<u64>,
    runs: Vec<Run>,
    /// Open links to the four neighbours, and pixels that a label may grow into.
    ways: Vec<u8>,
    bare: Vec<u8>,
    /// First run of every row, and their number.
    rows: Vec<u32>,
}

impl Runs {
    /// Writes where growth may go: the unbroken links of every pixel to its four neighbours, and the pixels without
    /// a label that have a plane.
    fn open_ways(&mut self, frame: &Frame) {
        let (w, links, band) = (frame.width, &frame.links[..], BAND * frame.width);
        self.ways.resize(links.len(), 0);
        self.bare.resize(links.len(), 0);
        let input = (frame.label.par_chunks(band), frame.smooth.par_chunks(band));
        (input, self.ways.par_chunks_mut(band), self.bare.par_chunks_mut(band))
            .into_par_iter()
            .enumerate()
            .for_each(|(b, ((label, smooth), ways, bare))| {
                wide(
                    #[inline(always)]
                    || {
                        let at = b * band;
                        ways.copy_from_slice(&links[at..at + ways.len()]);
                        // The last pixel of a row has no link to its right.
                        let from = at.max(1);
                        for (way, link) in ways[from - at..].iter_mut().zip(&links[from - 1..]) {
                            *way |= (link & RIGHT) * (LEFT / RIGHT);
                        }
                        let from = at.max(w);
                        for (way, link) in
                            ways[(from - at).min(label.len())..].iter_mut().zip(&links[from - w..])
                        {
                            *way |= (link & DOWN) * (UP / DOWN);
                        }
                        for ((bare, &label), &smooth) in bare.iter_mut().zip(label).zip(smooth) {
                            *bare = u8::from((label == 0) & (smooth > 0.0));
                        }
                    },
                );
            });
    }

    /// Packs `edge` and `links` into bits.
    fn read(&mut self, frame: &Frame) {
        self.words = frame.width.div_ceil(64);
        for plane in [&mut self.open, &mut self.right, &mut self.down] {
            plane.resize(self.words * frame.height, 0);
        }
        let band = BAND * self.words;
        let planes =
            (self.open.par_chunks_mut(band), self.right.par_chunks_mut(band), self.down.par_chunks_mut(band));
        let (w, n) = (frame.width, BAND * frame.width);
        (frame.edge.par_chunks(n), frame.links.par_chunks(n), planes).into_par_iter().for_each(
            |(edge, links, (open, right, down))| {
                wide(
                    #[inline(always)]
                    || {
                        let rows = edge.chunks_exact(w).zip(links.chunks_exact(w));
                        let bits = open.chunks_exact_mut(self.words).zip(right.chunks_exact_mut(self.words));
                        for ((edge, links), ((open, right), down)) in
                            rows.zip(bits.zip(down.chunks_exact_mut(self.words)))
                        {
                            pack(edge, 0, open, true);
                            pack(links, RIGHT.trailing_zeros(), right, false);
                            pack(links, DOWN.trailing_zeros(), down, false);
                        }
                    },
                );
            },
        );
    }

    /// Lists the runs of every row and unites those that are linked downwards.
    fn unite(&mut self) {
        self.runs.clear();
        self.rows.clear();
        self.rows.push(0);
        let n = self.words;
        for y in 0..self.open.len() / n {
            let row = y * n..(y + 1) * n;
            let above = self.rows.len().saturating_sub(2);
            let first = self.runs.len();
            list(&self.open[row.clone()], &self.right[row], &mut self.runs);
            self.rows.push(self.runs.len() as u32);
            if y > 0 {
                self.join(y, self.rows[above] as usize, first);
            }
        }
    }

    /// Unites the runs of row `y`, from number `b` on, with those of the row above, from `a` on.
    fn join(&mut self, y: usize, mut a: usize, mut b: usize) {
        let n = self.words;
        // Whether the last pixel of the word before is joined down, and to its right in both rows.
        let mut carry = 0;
        for k in 0..n {
            let (i, j) = (y * n + k, (y - 1) * n + k);
            let open = self.open[i] & self.open[j];
            let down = self.down[j] & open;
            let ladder = down & self.right[i] & self.right[j];
            // A pair whose left neighbours are joined alike, and to it, adds nothing.
            let mut news = down & !(ladder << 1 | carry);
            carry = ladder >> 63;
            while news != 0 {
                let x = (64 * k) as u32 + news.trailing_zeros();
                news &= news - 1;
                while self.runs[a].end < x {
                    a += 1;
                }
                while self.runs[b].end < x {
                    b += 1;
                }
                let (p, q) = (root(&mut self.runs, a as u32), root(&mut self.runs, b as u32));
                self.runs[p.max(q) as usize].parent = p.min(q);
            }
        }
    }

    /// Numbers the components and writes `label` and `region_size`.
    fn number(&mut self, frame: &mut Frame, min_pixels: u32) {
        for i in 0..self.runs.len() {
            let r = root(&mut self.runs, i as u32);
            let Run { start, end, .. } = self.runs[i];
            self.runs[i].parent = r;
            self.runs[r as usize].count += end - start + 1;
        }
        let size = &mut frame.region_size;
        size.clear();
        size.push(0);
        for i in 0..self.runs.len() {
            let Run { parent, count, .. } = self.runs[i];
            self.runs[i].count = if parent as usize != i {
                self.runs[parent as usize].count
            } else if count >= min_pixels {
                size.push(count);
                size.len() as u32 - 1
            } else {
                0
            };
        }
        size[0] = frame.edge.len() as u32 - size[1..].iter().sum::<u32>();
        let Self { runs, rows, .. } = self;
        let band = BAND * frame.width;
        frame.label.par_chunks_mut(band).enumerate().for_each(|(b, label)| {
            label.fill(0);
            for (y, label) in label.chunks_exact_mut(frame.width).enumerate() {
                let y = b * BAND + y;
                for run in &runs[rows[y] as usize..rows[y + 1] as usize] {
                    if run.count != 0 {
                        label[run.start as usize..=run.end as usize].fill(run.count);
                    }
                }
            }
        });
    }

    /// Queues the labelled pixels that are linked to one without a label, in raster order; returns their number.
    fn seed(&mut self, frame: &mut Frame) -> usize {
        self.held.clear();
        self.held.resize(self.open.len(), 0);
        let n = self.words;
        for (row, held) in self.rows.windows(2).zip(self.held.chunks_exact_mut(n)) {
            for run in self.runs[row[0] as usize..row[1] as usize].iter().filter(|r| r.count != 0) {
                set(held, run.start, run.end);
            }
        }
        // Room for every pixel, and for one that is looked at in vain.
        frame.queue.resize(frame.label.len() + 1, 0);
        let mut queued = 0;
        let (held, right, down) = (&self.held, &self.right, &self.down);
        let last = held.len() - n;
        for i in 0..held.len() {
            let (column, own) = (i % n, held[i]);
            let after = if column + 1 < n { held[i + 1] } else { 0 };
            let before = if column > 0 { !held[i - 1] & right[i - 1] } else { 0 };
            let bare_right = !(own >> 1 | after << 63) & right[i];
            let bare_left = (!own & right[i]) << 1 | before >> 63;
            let bare_down = if i < last { !held[i + n] & down[i] } else { 0 };
            let bare_up = if i >= n { !held[i - n] & down[i - n] } else { 0 };
            let mut seeds = own & (bare_right | bare_left | bare_down | bare_up);
            while seeds != 0 {
                let x = 64 * column + seeds.trailing_zeros() as usize;
                seeds &= seeds - 1;
                frame.queue[queued] = (i / n * frame.width + x) as u32;
                queued += 1;
            }
        }
        queued
    }
}

/// One bit (`shift`) of each byte as the bits of words, the first lowest; `invert` takes zeros for ones.
#[inline(always)]
fn pack(bytes: &[u8], shift: u32, words: &mut [u64], invert: bool) {
    let low = 0x0101_0101_0101_0101u64;
    let flip = if invert { low } else { 0 };
    for (word, bytes) in words.iter_mut().zip(bytes.chunks(64)) {
        *word = 0;
        for (k, eight) in bytes.chunks(LANES).enumerate() {
            let mut padded = [u8::from(invert) << shift; LANES];
            padded[..eight.len()].copy_from_slice(eight);
            let ones = (u64::from_le_bytes(padded) >> shift & low) ^ flip;
            // The product gathers the eight lowest bits in the top byte.
            *word |= (ones.wrapping_mul(0x0102_0408_1020_4080) >> 56) << (8 * k);
        }
    }
}

/// Appends the runs of a row.
fn list(open: &[u64], right: &[u64], runs: &mut Vec<Run>) {
    let mut carry = 0;
    let mut last = runs.len();
    for (k, &own) in open.iter().enumerate() {
        let next = open.get(k + 1).map_or(0, |w| w << 63);
        let joined = own & right[k] & (own >> 1 | next);
        let (mut starts, mut ends) = (own & !(joined << 1 | carry), own & !joined);
        carry = joined >> 63;
        while starts != 0 {
            let (start, i) = ((64 * k) as u32 + starts.trailing_zeros(), runs.len() as u32);
            starts &= starts - 1;
            runs.push(Run { start, end: start, parent: i, count: 0 });
        }
        while ends != 0 {
            runs[last].end = (64 * k) as u32 + ends.trailing_zeros();
            ends &= ends - 1;
            last += 1;
        }
    }
}

/// Sets the bits `start..=end` of a row.
fn set(row: &mut [u64], start: u32, end: u32) {
    for (k, word) in row.iter_mut().enumerate().take(end as usize / 64 + 1).skip(start as usize / 64) {
        let first = start.saturating_sub(64 * k as u32).min(63);
        let last = (end - 64 * k as u32).min(63);
        *word |= !0 << first & !0 >> (63 - last);
    }
}

/// Root of run `i`, halving the path.
fn root(runs: &mut [Run], mut i: u32) -> u32 {
    while runs[i as usize].parent != i {
        let up = runs[runs[i as usize].parent as usize].parent;
        runs[i as usize].parent = up;
        i = up;
    }
    i
}

/// Bits of [`Runs::ways`] beside [`RIGHT`] and [`DOWN`].
const LEFT: u8 = 4;
const UP: u8 = 8;

/// Breadth-first growth from the first `seeds` pixels of the queue; a pixel takes the label that reaches it first, ties
/// in raster order. Without branches: whether a neighbour is open is anybody's guess.
fn grow(frame: &mut Frame, runs: &mut Runs, seeds: usize) {
    runs.open_ways(frame);
    let (w, ways, bare) = (frame.width, &runs.ways[..], &mut runs.bare[..]);
    let (label, size) = (&mut frame.label[..], &mut frame.region_size[..]);
    let queue = &mut frame.queue[..];
    let (mut next, mut end) = (0, seeds);
    while next < end {
        let i = queue[next] as usize;
        next += 1;
        let (way, own, before) = (ways[i], label[i], end);
        // No way leads out of the image; where there is none, the pixel itself is looked at, which is not bare.
        for (bit, to) in [(UP, i.wrapping_sub(w)), (LEFT, i.wrapping_sub(1)), (RIGHT, i + 1), (DOWN, i + w)] {
            let j = if way & bit != 0 { to } else { i };
            let open = bare[j];
            bare[j] = 0;
            label[j] = if open != 0 { own } else { label[j] };
            queue[end] = j as u32;
            end += usize::from(open);
        }
        size[own as usize] += (end - before) as u32;
    }
    size[0] -= (end - seeds) as u32;
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Labels by flood fill, growth not included: the same numbering by another algorithm.
    fn flood(frame: &Frame, min: u32) -> Vec<u32> {
        let (w, n) = (frame.width, frame.edge.len());
        let mut label = vec![0; n];
        let mut next = 0;
        let mut done = vec![false; n];
        for start in 0..n {
            if done[start] || frame.edge[start] != 0 {
                continue;
            }
            let (mut stack, mut part) = (vec![start], vec![]);
            done[start] = true;
            while let Some(i) = stack.pop() {
                part.push(i);
                let mut around = vec![];
                if frame.links[i] & RIGHT != 0 {
                    around.push(i + 1);
                }
                if frame.links[i] & DOWN != 0 {
                    around.push(i + w);
                }
                if i >= 1 && frame.links[i - 1] & RIGHT != 0 {
                    around.push(i - 1);
                }
                if i >= w && frame.links[i - w] & DOWN != 0 {
                    around.push(i - w);
                }
                for j in around {
                    if !done[j] && frame.edge[j] == 0 {
                        done[j] = true;
                        stack.push(j);
                    }
                }
            }
            if part.len() as u32 >= min {
                next += 1;
                part.iter().for_each(|&i| label[i] = next);
            }
        }
        label
    }

    proptest! {
        #[test]
        fn components_equal_a_flood_fill(
            w in 1usize..200, h in 1usize..24, min in 1u32..6, bits in prop::collection::vec(0u8..16, 4800),
        ) {
            let n = w * h;
            let mut frame = Frame { width: w, height: h, ..Frame::default() };
            frame.edge = bits[..n].iter().map(|b| u8::from(b & 12 == 12)).collect();
            frame.links = (0..n)
                .map(|i| {
                    let right = if i % w + 1 < w && bits[i] & 3 != 0 { RIGHT } else { 0 };
                    right | if i + w < n && bits[i] & 5 != 0 { DOWN } else { 0 }
                })
                .collect();
            frame.label = vec![0; n];
            frame.smooth = vec![1.0; n];
            let mut runs = Runs::default();
            runs.read(&frame);
            runs.unite();
            runs.number(&mut frame, min);
            prop_assert_eq!(&frame.label, &flood(&frame, min));
            let before = frame.label.clone();
            let queued = runs.seed(&mut frame);
            let seeds: Vec<u32> = (0..n)
                .filter(|&i| {
                    let bare = |on: bool, j: usize| on && frame.label[j] == 0;
                    frame.label[i] != 0
                        && (bare(frame.links[i] & RIGHT != 0, i + 1)
                            || bare(frame.links[i] & DOWN != 0, i + w)
                            || i > 0 && bare(frame.links[i - 1] & RIGHT != 0, i - 1)
                            || i >= w && bare(frame.links[i - w] & DOWN != 0, i - w))
                })
                .map(|i| i as u32)
                .collect();
            prop_assert_eq!(&frame.queue[..queued], &seeds);
            grow(&mut frame, &mut runs, queued);
            let mut sizes = vec![0; frame.region_size.len()];
            for (i, &l) in frame.label.iter().enumerate() {
                prop_assert!(before[i] == 0 || before[i] == l);
                sizes[l as usize] += 1;
            }
            prop_assert_eq!(&sizes, &frame.region_size);
        }
    }
}
