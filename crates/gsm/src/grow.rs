//! Growth of regions into the pixels between them.

use crate::components::Bits;

/// Workspace: rows as bits, 64 pixels a word. A round looks at the words beside those that the last one changed.
#[derive(Debug, Default)]
pub(crate) struct Growth {
    /// Pixels that a label may grow into; those that got theirs in the last round.
    bare: Vec<u64>,
    front: Vec<u64>,
    /// Words that are to be looked at; the round in which each was listed last.
    near: Vec<u32>,
    listed: Vec<u32>,
    /// Words in which pixels got a label, and these.
    found: Vec<(u32, u64)>,
}

impl Growth {
    /// Labels spread from the pixels `held`, one pixel a round in all four directions, over unbroken links into pixels
    /// that have a plane; where several arrive at once, the first of the pixels above, left, right, below wins.
    /// `size` counts the pixels of each label.
    pub(crate) fn run(&mut self, bits: &Bits, held: &[u64], label: &mut [u32], size: &mut [u32]) {
        self.front.clear();
        self.front.extend_from_slice(held);
        self.bare.clear();
        self.bare.extend(bits.plane.iter().zip(held).map(|(plane, held)| plane & !held));
        self.listed.clear();
        self.listed.resize(held.len(), 0);
        self.near.clear();
        self.near.extend(0..held.len() as u32);
        for round in 1.. {
            self.found.clear();
            for &i in &self.near {
                let (i, bare) = (i as usize, self.bare[i as usize]);
                if bare != 0 {
                    let reached = self.reach(bits, i).map(|r| r & bare);
                    self.bare[i] = bare & !hand(bits, i, reached, label, size);
                    if self.bare[i] != bare {
                        self.found.push((i as u32, bare & !self.bare[i]));
                    }
                }
            }
            if self.found.is_empty() {
                return;
            }
            self.step(bits.words, round);
        }
    }

    /// What the front reaches in word `i` from above, left, right and below. No link leads out of the image, nor from
    /// the end of a row to the next.
    #[inline(always)]
    fn reach(&self, bits: &Bits, i: usize) -> [u64; 4] {
        let (front, n) = (&self.front[..], bits.words);
        let above = if i >= n { front[i - n] & bits.down[i - n] } else { 0 };
        let before = if i > 0 { (front[i - 1] & bits.right[i - 1]) >> 63 } else { 0 };
        let after = front.get(i + 1).map_or(0, |f| f << 63);
        let below = front.get(i + n).map_or(0, |f| f & bits.down[i]);
        [above, (front[i] & bits.right[i]) << 1 | before, (front[i] >> 1 | after) & bits.right[i], below]
    }

    /// Makes what was found the front, and lists the words beside it.
    fn step(&mut self, words: usize, round: u32) {
        if round == 1 {
            self.front.fill(0);
        } else {
            // All words of the old front were looked at.
            self.near.iter().for_each(|&i| self.front[i as usize] = 0);
        }
        self.near.clear();
        for &(i, bits) in &self.found {
            let i = i as usize;
            self.front[i] = bits;
            for j in [i.wrapping_sub(words), i.wrapping_sub(1), i, i + 1, i + words] {
                if self.listed.get(j).is_some_and(|&r| r != round) {
                    self.listed[j] = round;
                    self.near.push(j as u32);
                }
            }
        }
    }
}

/// Gives the pixels of word `i` that were `reached` from above, left, right and below their neighbour's label; returns
/// them.
#[inline(always)]
fn hand(bits: &Bits, i: usize, reached: [u64; 4], label: &mut [u32], size: &mut [u32]) -> u64 {
    let (row, column, w) = (i / bits.words, i % bits.words, bits.width);
    let first = row * w + 64 * column;
    // Pixels side by side mostly get one label: they are counted together.
    let (mut taken, mut last, mut count) = (0, 0, 0);
    for (reached, [back, ahead]) in reached.into_iter().zip([[w, 0], [1, 0], [0, 1], [0, w]]) {
        let mut rest = reached & !taken;
        taken |= reached;
        while rest != 0 {
            let j = first + rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let own = label[j + ahead - back];
            label[j] = own;
            if own != last {
                size[last as usize] += count;
                (last, count) = (own, 0);
            }
            count += 1;
        }
    }
    size[last as usize] += count;
    size[0] -= taken.count_ones();
    taken
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{DOWN, RIGHT};
    use proptest::prelude::*;

    /// The same, pixel by pixel.
    fn brute(w: usize, links: &[u8], plane: &[bool], label: &mut [u32]) {
        loop {
            let before = label.to_vec();
            for i in (0..label.len()).filter(|&i| before[i] == 0 && plane[i]) {
                let from = [
                    (i >= w && links[i - w] & DOWN != 0).then(|| i - w),
                    (i >= 1 && links[i - 1] & RIGHT != 0).then(|| i - 1),
                    (links[i] & RIGHT != 0).then_some(i + 1),
                    (links[i] & DOWN != 0).then_some(i + w),
                ];
                label[i] = from.into_iter().flatten().map(|j| before[j]).find(|&l| l != 0).unwrap_or(0);
            }
            if before == label {
                return;
            }
        }
    }

    proptest! {
        #[test]
        fn growth_equals_brute_force(
            w in 1usize..200, h in 1usize..24, cells in prop::collection::vec((0u8..16, 0u32..40), 4800),
        ) {
            let n = w * h;
            let edge: Vec<u8> = cells[..n].iter().map(|c| if c.0 == 15 { 3 } else { 1 }).collect();
            let links: Vec<u8> = (0..n)
                .map(|i| {
                    let right = if i % w + 1 < w && cells[i].0 & 3 != 0 { RIGHT } else { 0 };
                    right | if i + w < n && cells[i].0 & 5 != 0 { DOWN } else { 0 }
                })
                .collect();
            // One pixel in twenty is held, by one of two labels.
            let mut label: Vec<u32> = cells[..n].iter().map(|c| if c.1 < 2 { c.1 + 1 } else { 0 }).collect();
            let mut bits = Bits::default();
            bits.read(w, &edge, &links);
            let mut held = vec![0; bits.plane.len()];
            for i in (0..n).filter(|&i| label[i] != 0) {
                held[i / w * bits.words + i % w / 64] |= 1 << (i % w % 64);
            }
            let count = |label: &[u32]| (0..3).map(|l| label.iter().filter(|&&k| k == l).count() as u32).collect();
            let mut size: Vec<u32> = count(&label);
            let mut want = label.clone();
            Growth::default().run(&bits, &held, &mut label, &mut size);
            brute(w, &links, &edge.iter().map(|&e| e & 2 == 0).collect::<Vec<_>>(), &mut want);
            prop_assert_eq!(&size, &count(&label));
            prop_assert_eq!(label, want);
        }
    }
}
