//! What was looked at, as the places where it differs from a guess.

use super::bits::{Reader, Writer};
use super::{of_cm, to_cm};
use crate::{Error, Looked};

/// What a cell is expected to be: a constant plus cells before it, modulo 2.
struct Guess {
    constant: u8,
    /// Distances to the cells before it.
    before: &'static [[usize; 3]],
}

const fn guess(constant: u8, before: &'static [[usize; 3]]) -> Guess {
    Guess { constant, before }
}

/// Unseen; seen; as the one before, the one of the row before, of the layer before; as two of those
/// and the one before both say.
const GUESSES: [Guess; 8] = [
    guess(0, &[]),
    guess(1, &[]),
    guess(0, &[[1, 0, 0]]),
    guess(0, &[[0, 1, 0]]),
    guess(0, &[[0, 0, 1]]),
    guess(0, &[[1, 0, 0], [0, 1, 0], [1, 1, 0]]),
    guess(0, &[[1, 0, 0], [0, 0, 1], [1, 0, 1]]),
    guess(0, &[[0, 1, 0], [0, 0, 1], [0, 1, 1]]),
];

impl Guess {
    /// The bit of a cell, given those before it.
    fn of(&self, bits: &[u8], at: usize, size: [usize; 3]) -> u8 {
        let cell = [at % size[0], at / size[0] % size[1], at / (size[0] * size[1])];
        let bit = |d: &[usize; 3]| {
            let inside = (0..3).all(|k| cell[k] >= d[k]);
            let there = inside.then(|| at - (d[2] * size[1] + d[1]) * size[0] - d[0]);
            there.map_or(0, |t| bits[t / 8] >> (t % 8) & 1)
        };
        self.before.iter().fold(self.constant, |sum, d| sum ^ bit(d))
    }
}

/// Shortest frame, in bytes, that may hold so many cells.
pub(super) fn least_bytes(size: [u32; 3]) -> u64 {
    size.iter().fold(1_u64, |a, &s| a.saturating_mul(u64::from(s))).div_ceil(64)
}

fn wide(size: [u32; 3]) -> [usize; 3] {
    size.map(|s| s as usize)
}

/// Distances between cells that are not as guessed, each the cells behind the one before.
fn gaps<'a>(bits: &'a [u8], size: [usize; 3], guess: &'a Guess) -> impl Iterator<Item = u64> + Clone + 'a {
    let mut next = 0;
    let surprise = move |at: &usize| bits[at / 8] >> (at % 8) & 1 != guess.of(bits, *at, size);
    (0..size.iter().product()).filter(surprise).map(move |at: usize| {
        let gap = (at - next) as u64;
        next = at + 1;
        gap
    })
}

pub(super) fn put(w: &mut Writer<'_>, l: &Looked) {
    w.number(to_cm(l.cell()).max(1) as u64);
    let (first, size) = l.span();
    w.signed((0..3).map(|k| to_cm(l.origin()[k])));
    w.signed(first.into_iter().map(i64::from));
    w.column(size.into_iter().map(u64::from));
    let surprises = |guess: &Guess| gaps(l.bits(), wide(size), guess).count();
    // The first of equals.
    let Some((k, guess)) = GUESSES.iter().enumerate().min_by_key(|(_, g)| surprises(g)) else { return };
    let gaps = gaps(l.bits(), wide(size), guess);
    w.bits(k as u64, 3);
    w.number(gaps.clone().count() as u64);
    w.column(gaps);
}

/// A column of three.
fn three<T: Copy + Default>(mut column: impl Iterator<Item = T>) -> [T; 3] {
    [(); 3].map(|()| column.next().unwrap_or_default())
}

/// The cells, for which so many bytes of the frame are left.
pub(super) fn read(r: &mut Reader<'_>, bytes: usize) -> Result<Looked, Error> {
    let cell = of_cm(i64::from(r.u32()?));
    let origin = three(r.signed(3)?);
    if let Some(o) = origin.iter().find(|o| o.unsigned_abs() > 100_000_000) {
        return Err(r.bad(format!("origin {o} cm, want at most 1e6 m")));
    }
    let first = three(r.signed(3)?);
    let sides = three(r.column(3, u64::from(u32::MAX))?).map(|s| s as u32);
    let mut low = [0_i32; 3];
    for k in 0..3 {
        low[k] = i32::try_from(first[k]).map_err(|_| r.bad("a cell beyond 32 bits"))?;
    }
    if least_bytes(sides) > bytes as u64 {
        return Err(r.bad(format!("a box of {sides:?} cells where {bytes} bytes are left for it")));
    }
    let size = wide(sides);
    let cells: usize = size.iter().product();
    let guess = &GUESSES[r.bits(3)? as usize];
    let count = r.number()?;
    let Some(count) = usize::try_from(count).ok().filter(|&c| c <= cells) else {
        return Err(r.bad(format!("{count} surprises in {cells} cells")));
    };
    let gaps = r.column(count, cells as u64)?;
    let mut bits = vec![0_u8; cells.div_ceil(8)];
    let mut at = 0;
    for gap in gaps.map(Some).chain([None]) {
        let surprise = gap.map_or(cells, |g| at + g as usize);
        if surprise > cells || gap.is_some() && surprise == cells {
            return Err(r.bad("a surprise outside the box"));
        }
        while at <= surprise && at < cells {
            let bit = guess.of(&bits, at, size) ^ u8::from(at == surprise);
            bits[at / 8] |= bit << (at % 8);
            at += 1;
        }
    }
    Looked::from_bits(cell, origin.map(of_cm), low, sides, bits).map_err(|e| r.bad(e.to_string()))
}
