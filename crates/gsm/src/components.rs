//! Regions of a frame: connected pixels that are no edges, grown back into the edges between them.
//!
//! Rows are taken as bits, 64 pixels a word, and components as runs of pixels, so that the inside of a surface costs
//! next to nothing.

use crate::frame::{BAND, DOWN, EDGE, Frame, NO_PLANE, RIGHT};
use crate::grow::Growth;
use crate::lanes::{LANES, wide};
use rayon::prelude::*;

/// Writes `label` and `region_size`: 4-connected components of non-edge pixels over unbroken links, numbered from 1
/// in raster order of their first pixel; components of fewer than `min_pixels` are dropped; then labels grow
/// over unbroken links into edge pixels, nearest first.
pub(crate) fn regions(frame: &mut Frame, min_pixels: u32) {
    let mut runs = std::mem::take(&mut frame.runs);
    runs.bits.read(frame.width, &frame.edge, &frame.links);
    runs.unite();
    runs.number(frame, min_pixels);
    runs.hold();
    runs.growth.run(&runs.bits, &runs.held, &mut frame.label, &mut frame.region_size);
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

/// Rows of a frame as bits, 64 pixels a word, the first lowest; bits beyond the row are zero.
#[derive(Debug, Default)]
pub(crate) struct Bits {
    pub(crate) width: usize,
    /// Words per row.
    pub(crate) words: usize,
    /// Pixels that are no edges; pixels that have a plane; unbroken links to the right and down.
    pub(crate) open: Vec<u64>,
    pub(crate) plane: Vec<u64>,
    pub(crate) right: Vec<u64>,
    pub(crate) down: Vec<u64>,
}

impl Bits {
    /// Packs the planes `edge` and `links` of a frame.
    pub(crate) fn read(&mut self, width: usize, edge: &[u8], links: &[u8]) {
        let words = width.div_ceil(64);
        (self.width, self.words) = (width, words);
        for plane in [&mut self.open, &mut self.plane, &mut self.right, &mut self.down] {
            plane.resize(words * (edge.len() / width), 0);
        }
        let (n, band) = (BAND * width, BAND * words);
        let kinds = (self.open.par_chunks_mut(band), self.plane.par_chunks_mut(band));
        let ways = (self.right.par_chunks_mut(band), self.down.par_chunks_mut(band));
        (edge.par_chunks(n), links.par_chunks(n), kinds, ways).into_par_iter().for_each(
            |(edge, links, (open, plane), (right, down))| {
                wide(
                    #[inline(always)]
                    || {
                        let bytes = edge.chunks_exact(width).zip(links.chunks_exact(width));
                        let kinds = open.chunks_exact_mut(words).zip(plane.chunks_exact_mut(words));
                        let ways = right.chunks_exact_mut(words).zip(down.chunks_exact_mut(words));
                        for ((edge, links), ((open, plane), (right, down))) in bytes.zip(kinds.zip(ways)) {
                            pack(edge, EDGE, open, true);
                            pack(edge, NO_PLANE, plane, true);
                            pack(links, RIGHT, right, false);
                            pack(links, DOWN, down, false);
                        }
                    },
                );
            },
        );
    }
}

/// Workspace: the runs of every row.
#[derive(Debug, Default)]
pub(crate) struct Runs {
    bits: Bits,
    runs: Vec<Run>,
    /// First run of every row, and their number.
    rows: Vec<u32>,
    /// Labelled pixels, as bits.
    held: Vec<u64>,
    growth: Growth,
}

impl Runs {
    /// Lists the runs of every row and unites those that are linked downwards.
    fn unite(&mut self) {
        self.runs.clear();
        self.rows.clear();
        self.rows.push(0);
        let n = self.bits.words;
        for y in 0..self.bits.open.len() / n {
            let row = y * n..(y + 1) * n;
            let above = self.rows.len().saturating_sub(2);
            let first = self.runs.len();
            list(&self.bits.open[row.clone()], &self.bits.right[row], &mut self.runs);
            self.rows.push(self.runs.len() as u32);
            if y > 0 {
                self.join(y, self.rows[above] as usize, first);
            }
        }
    }

    /// Unites the runs of row `y`, from number `b` on, with those of the row above, from `a` on.
    fn join(&mut self, y: usize, mut a: usize, mut b: usize) {
        let Bits { words: n, open, right, down, .. } = &self.bits;
        // Whether the last pixel of the word before is joined down, and to its right in both rows.
        let mut carry = 0;
        for k in 0..*n {
            let (i, j) = (y * n + k, (y - 1) * n + k);
            let down = down[j] & open[i] & open[j];
            let ladder = down & right[i] & right[j];
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

    /// Marks the labelled pixels.
    fn hold(&mut self) {
        self.held.clear();
        self.held.resize(self.bits.open.len(), 0);
        for (row, held) in self.rows.windows(2).zip(self.held.chunks_exact_mut(self.bits.words)) {
            for run in self.runs[row[0] as usize..row[1] as usize].iter().filter(|r| r.count != 0) {
                set(held, run.start, run.end);
            }
        }
    }
}

/// One bit of each byte as the bits of words, the first lowest; `invert` takes zeros for ones.
#[inline(always)]
fn pack(bytes: &[u8], bit: u8, words: &mut [u64], invert: bool) {
    let shift = bit.trailing_zeros();
    let low = 0x0101_0101_0101_0101u64;
    let flip = if invert { low } else { 0 };
    for (word, bytes) in words.iter_mut().zip(bytes.chunks(64)) {
        *word = 0;
        for (k, eight) in bytes.chunks(LANES).enumerate() {
            let mut padded = [if invert { bit } else { 0 }; LANES];
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
            let mut runs = Runs::default();
            runs.bits.read(w, &frame.edge, &frame.links);
            runs.unite();
            runs.number(&mut frame, min);
            prop_assert_eq!(&frame.label, &flood(&frame, min));
        }
    }
}
