//! Eight pixels of a row at a time, in plain arrays that the compiler turns into vector registers.

/// Pixels that are worked together.
pub(crate) const LANES: usize = 8;
pub(crate) type Lanes = [f32; LANES];

/// Runs a kernel compiled for the widest vectors this processor has. No fused multiply-add is ever used, so that
/// every processor gives the same bits.
#[inline(always)]
pub(crate) fn wide<R>(kernel: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(kernel)
}

/// The eight values from `i` on; zeros beyond the end.
#[inline(always)]
pub(crate) fn load(plane: &[f32], i: usize) -> Lanes {
    if let Some(whole) = plane.get(i..i + LANES).and_then(|s| s.first_chunk()) {
        return *whole;
    }
    let mut part = [0.0; LANES];
    part.iter_mut().zip(plane.iter().skip(i)).for_each(|(p, v)| *p = *v);
    part
}

/// Stores eight values from `i` on, as far as there is room.
#[inline(always)]
pub(crate) fn store(plane: &mut [f32], i: usize, values: Lanes) {
    if let Some(whole) = plane.get_mut(i..i + LANES).and_then(|s| s.first_chunk_mut()) {
        *whole = values;
    } else {
        plane.iter_mut().skip(i).zip(values).for_each(|(p, v)| *p = v);
    }
}

/// Eight bytes from `i` on as one word, the first lowest; 0 when there are not so many.
#[inline(always)]
pub(crate) fn word(plane: &[u8], i: usize) -> u64 {
    plane.get(i..i + LANES).and_then(|s| s.first_chunk()).map_or(0, |b| u64::from_le_bytes(*b))
}

/// The byte that those of the eight of a word are for which `care` has ones, if they are equal.
#[inline(always)]
pub(crate) fn same(word: u64, care: u64) -> Option<usize> {
    let byte = word >> (care.trailing_zeros() & 56) & 0xff;
    ((word ^ byte.wrapping_mul(EACH)) & care == 0).then_some(byte as usize)
}

/// The lowest byte of a word for which `care` has ones, and all of those that are equal to it.
#[inline(always)]
pub(crate) fn first(word: u64, care: u64) -> (usize, u64) {
    let byte = word >> (care.trailing_zeros() & 56) & 0xff;
    (byte as usize, care & !some(word ^ byte.wrapping_mul(EACH)))
}

/// All ones in the bytes that are not zero.
#[inline(always)]
pub(crate) fn some(word: u64) -> u64 {
    const LOW: u64 = 0x7f * EACH;
    let high = (((word & LOW) + LOW) | word) & !LOW;
    (high >> 7).wrapping_mul(0xff)
}

const EACH: u64 = 0x0101_0101_0101_0101;

/// The whole part of a number from 0 to 2^23, without the checks of a cast: in the last bits of its sum with 2^23.
#[inline(always)]
pub(crate) fn whole(v: f32) -> u32 {
    (v.trunc() + 8_388_608.0).to_bits() & 0x007f_ffff
}
