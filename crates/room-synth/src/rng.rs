//! Random streams: one root seed, split by purpose and index, so that no draw shifts another's.

use rand::{Rng as _, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A stream of draws. Every draw is plain arithmetic on the words of `ChaCha8`.
#[derive(Clone, Debug)]
pub(crate) struct Draw(ChaCha8Rng);

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The 64-bit name of a stream: stable, and different for different purposes or indices.
pub(crate) fn key(root: u64, purpose: &str, indices: &[u64]) -> u64 {
    let mut h = mix(root ^ 0x9e37_79b9_7f4a_7c15);
    for byte in purpose.bytes() {
        h = (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    }
    h = mix(h ^ purpose.len() as u64);
    for &i in indices {
        h = mix(h.rotate_left(23) ^ mix(i.wrapping_add(0x9e37_79b9_7f4a_7c15)));
    }
    h
}

impl Draw {
    /// The stream of a purpose and indices under a root seed.
    pub(crate) fn new(root: u64, purpose: &str, indices: &[u64]) -> Self {
        let k = key(root, purpose, indices);
        let mut seed = [0_u8; 32];
        for (i, chunk) in seed.chunks_exact_mut(8).enumerate() {
            chunk.copy_from_slice(
                &mix(k.wrapping_add(0x9e37_79b9_7f4a_7c15_u64.wrapping_mul(i as u64 + 1))).to_le_bytes(),
            );
        }
        Self(ChaCha8Rng::from_seed(seed))
    }

    pub(crate) fn word(&mut self) -> u64 {
        self.0.next_u64()
    }

    pub(crate) fn fill(&mut self, bytes: &mut [u8]) {
        self.0.fill_bytes(bytes);
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f32 {
        (self.0.next_u32() >> 8) as f32 / 16_777_216.0
    }

    pub(crate) fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    pub(crate) fn chance(&mut self, p: f32) -> bool {
        self.unit() < p
    }

    /// Uniform in 0..n; 0 for n = 0.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        ((u64::from(self.0.next_u32()) * n as u64) >> 32) as usize
    }

    /// Standard normal, as the sum of twelve uniforms (tails end at 6).
    pub(crate) fn normal(&mut self) -> f32 {
        (0..12).map(|_| self.unit()).sum::<f32>() - 6.0
    }

    /// A count with the given mean, at most 40.
    pub(crate) fn poisson(&mut self, mean: f32) -> usize {
        let limit = (-mean.max(0.0)).exp();
        let mut product = self.unit();
        let mut n = 0;
        while product > limit && n < 40 {
            product *= self.unit();
            n += 1;
        }
        n
    }

    /// An index drawn by weight.
    pub(crate) fn weighted(&mut self, weights: impl Iterator<Item = f32> + Clone) -> usize {
        let mut left = self.unit() * weights.clone().sum::<f32>();
        let mut last = 0;
        for (i, w) in weights.enumerate() {
            last = i;
            left -= w;
            if left < 0.0 {
                break;
            }
        }
        last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_by_purpose_and_index_and_are_stable() {
        let keys = [
            key(1, "room", &[0]),
            key(1, "room", &[1]),
            key(1, "rooms", &[0]),
            key(2, "room", &[0]),
            key(1, "room", &[0, 0]),
        ];
        for (i, a) in keys.iter().enumerate() {
            for b in &keys[i + 1..] {
                assert_ne!(a, b);
            }
        }
        assert_eq!(Draw::new(7, "x", &[3]).word(), Draw::new(7, "x", &[3]).word());
    }

    #[test]
    fn normal_has_unit_variance_and_poisson_its_mean() {
        let mut d = Draw::new(1, "test", &[]);
        let xs: Vec<f32> = (0..20_000).map(|_| d.normal()).collect();
        let mean = xs.iter().sum::<f32>() / 20_000.0;
        let var = xs.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (var - 1.0).abs() < 0.04, "{mean} {var}");
        let p = (0..20_000).map(|_| d.poisson(2.5)).sum::<usize>() as f32 / 20_000.0;
        assert!((p - 2.5).abs() < 0.06, "{p}");
    }
}
