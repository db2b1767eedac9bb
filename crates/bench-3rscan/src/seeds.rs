//! One root seed per run, split by purpose and index, so that one more agent or room does not
//! shift anybody else's draws.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A generator for one purpose: FNV-1a over root, purpose and indices seeds it.
#[must_use]
pub fn stream(root: u64, purpose: &str, indices: &[u64]) -> ChaCha8Rng {
    let mut h = 0xcbf2_9ce4_8422_2325_u64;
    let words = indices.iter().flat_map(|i| i.to_le_bytes());
    for b in root.to_le_bytes().into_iter().chain(purpose.bytes()).chain([0]).chain(words) {
        h = (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3);
    }
    ChaCha8Rng::seed_from_u64(h)
}

/// Uniform in 0..1.
pub fn unit(rng: &mut ChaCha8Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// Standard normal (Box and Muller).
pub fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v) = (1.0 - unit(rng), unit(rng));
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Fisher-Yates.
pub fn shuffle<T>(items: &mut [T], rng: &mut ChaCha8Rng) {
    for i in (1..items.len()).rev() {
        items.swap(i, (rng.next_u64() % (i as u64 + 1)) as usize);
    }
}
