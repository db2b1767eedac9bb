//! Numbers as bits: columns that are each written the cheapest of a few ways.

use crate::Error;

/// Parameter of numbers that stand alone.
const ALONE: u32 = 7;

/// Writes bits, lowest first.
#[derive(Debug, Default)]
pub(super) struct Writer {
    bytes: Vec<u8>,
    /// Bits used of the last byte, 0 = all.
    used: u32,
}

impl Writer {
    pub(super) fn new(bytes: Vec<u8>) -> Self {
        Self { bytes, used: 0 }
    }

    /// The bytes, with zero bits to the end of the last one.
    pub(super) fn finish(self) -> Vec<u8> {
        self.bytes
    }

    /// The `n` lowest bits of `v`, `n` <= 64.
    pub(super) fn bits(&mut self, mut v: u64, mut n: u32) {
        while n > 0 {
            if self.used == 0 {
                self.bytes.push(0);
            }
            let take = n.min(8 - self.used);
            let part = (v & ((1 << take) - 1)) as u8;
            if let Some(last) = self.bytes.last_mut() {
                *last |= part << self.used;
            }
            self.used = (self.used + take) % 8;
            v = if take < 64 { v >> take } else { 0 };
            n -= take;
        }
    }

    /// Exp-Golomb of order `k`: with q = ⌊v / 2^k⌋ + 1 of b bits, b - 1 zeros, a one, the b - 1 lower
    /// bits of q, the k lower bits of v.
    pub(super) fn golomb(&mut self, v: u64, k: u32) {
        let q = u128::from(v >> k) + 1;
        let below = q.ilog2();
        self.bits(0, below);
        self.bits(1, 1);
        self.bits(q as u64 & mask(below), below);
        self.bits(v, k);
    }

    /// A number that stands alone.
    pub(super) fn number(&mut self, v: u64) {
        self.golomb(v, ALONE);
    }

    /// As many numbers as the reader knows to expect.
    pub(super) fn column(&mut self, values: &[u64]) {
        let Some(way) = Way::best(values) else { return };
        self.bits(u64::from(way.golomb), 1);
        self.bits(u64::from(way.k), 6);
        for &v in values {
            if way.golomb { self.golomb(v, way.k) } else { self.bits(v, way.k) }
        }
    }

    /// Signed numbers: above their smallest, or as differences to the one before.
    pub(super) fn signed(&mut self, values: &[i64]) {
        let Some(&least) = values.iter().min() else { return };
        let above: Vec<u64> = values.iter().map(|v| v.wrapping_sub(least) as u64).collect();
        let mut before = 0;
        let steps: Vec<u64> =
            values.iter().map(|&v| zigzag(v.wrapping_sub(std::mem::replace(&mut before, v)))).collect();
        let cost = |c: &[u64]| Way::best(c).map_or(0, |w| w.cost);
        let steppy = cost(&steps) < cost(&above) + u64::from(length(zigzag(least), ALONE));
        self.bits(u64::from(steppy), 1);
        if steppy {
            self.column(&steps);
        } else {
            self.number(zigzag(least));
            self.column(&above);
        }
    }
}

fn mask(n: u32) -> u64 {
    if n < 64 { (1 << n) - 1 } else { u64::MAX }
}

fn zigzag(v: i64) -> u64 {
    (v.wrapping_shl(1) ^ (v >> 63)) as u64
}

fn unzigzag(v: u64) -> i64 {
    (v >> 1) as i64 ^ -((v & 1) as i64)
}

/// Bits of a Golomb number.
fn length(v: u64, k: u32) -> u32 {
    2 * (u128::from(v >> k) + 1).ilog2() + 1 + k
}

/// How a column is written: `k` bits each, or Exp-Golomb of order `k`.
struct Way {
    golomb: bool,
    k: u32,
    cost: u64,
}

impl Way {
    /// The cheapest; of equals fixed bits, then the smaller order. None for nothing.
    fn best(values: &[u64]) -> Option<Self> {
        let &most = values.iter().max()?;
        let width = most.checked_ilog2().map_or(0, |b| b + 1);
        let fixed = Self { golomb: false, k: width, cost: u64::from(width) * values.len() as u64 };
        let golomb = (0..width.max(1)).map(|k| Self {
            golomb: true,
            k,
            cost: values.iter().map(|&v| u64::from(length(v, k))).sum(),
        });
        std::iter::once(fixed).filter(|f| f.k < 64).chain(golomb).min_by_key(|w| w.cost)
    }
}

/// Reads what [`Writer`] wrote.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// From byte `at` of a frame.
    pub(super) fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at: at * 8 }
    }

    pub(super) fn bad(&self, problem: impl Into<String>) -> Error {
        Error::format(format!("byte {}", self.at / 8), problem)
    }

    pub(super) fn bits(&mut self, n: u32) -> Result<u64, Error> {
        if n as usize > self.bytes.len() * 8 - self.at {
            return Err(self.bad("the frame ends early"));
        }
        let (mut v, mut done) = (0, 0);
        while done < n {
            let take = (n - done).min(8 - self.at as u32 % 8);
            let part = u64::from(self.bytes[self.at / 8] >> (self.at % 8)) & mask(take);
            v |= part << done;
            done += take;
            self.at += take as usize;
        }
        Ok(v)
    }

    fn golomb(&mut self, k: u32) -> Result<u64, Error> {
        let mut below = 0;
        while self.bits(1)? == 0 {
            below += 1;
            if below > 64 {
                return Err(self.bad("a number beyond 64 bits"));
            }
        }
        let q = (1_u128 << below | u128::from(self.bits(below)?)) - 1;
        let v = q << k | u128::from(self.bits(k)?);
        u64::try_from(v).map_err(|_| self.bad("a number beyond 64 bits"))
    }

    pub(super) fn number(&mut self) -> Result<u64, Error> {
        self.golomb(ALONE)
    }

    pub(super) fn u32(&mut self) -> Result<u32, Error> {
        let v = self.number()?;
        u32::try_from(v).map_err(|_| self.bad(format!("{v}, want at most 32 bits")))
    }

    /// `n` numbers of at most `most`.
    pub(super) fn column(&mut self, n: usize, most: u64) -> Result<Vec<u64>, Error> {
        if n == 0 {
            return Ok(Vec::new());
        }
        let golomb = self.bits(1)? == 1;
        let k = self.bits(6)? as u32;
        let mut out = Vec::with_capacity(n);
        for _ in 0..n {
            let v = if golomb { self.golomb(k)? } else { self.bits(k)? };
            if v > most {
                return Err(self.bad(format!("{v}, want at most {most}")));
            }
            out.push(v);
        }
        Ok(out)
    }

    pub(super) fn signed(&mut self, n: usize) -> Result<Vec<i64>, Error> {
        if n == 0 {
            return Ok(Vec::new());
        }
        let steppy = self.bits(1)? == 1;
        let least = if steppy { 0 } else { unzigzag(self.number()?) };
        let mut last = 0_i64;
        let column = self.column(n, u64::MAX)?;
        let of = |v: u64| {
            let next = if steppy {
                last.checked_add(unzigzag(v))
            } else {
                i64::try_from(v).ok().and_then(|v| least.checked_add(v))
            };
            last = next?;
            next
        };
        column.into_iter().map(of).collect::<Option<_>>().ok_or_else(|| self.bad("a number beyond 64 bits"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_come_back(
            columns in prop::collection::vec(prop::collection::vec(any::<(u64, u32)>(), 0..20), 0..5),
            signed in prop::collection::vec(-1_i64 << 40..1 << 40, 0..20),
        ) {
            // Numbers of any length, not only long ones.
            let columns: Vec<Vec<u64>> =
                columns.into_iter().map(|c| c.into_iter().map(|(v, s)| v >> (s % 64)).collect()).collect();
            let mut w = Writer::default();
            for c in &columns {
                w.column(c);
                c.iter().for_each(|&v| w.number(v));
            }
            w.signed(&signed);
            let bytes = w.finish();
            let mut r = Reader::new(&bytes, 0);
            for c in &columns {
                prop_assert_eq!(&r.column(c.len(), u64::MAX).unwrap(), c);
                for v in c {
                    prop_assert_eq!(r.number().unwrap(), *v);
                }
            }
            prop_assert_eq!(r.signed(signed.len()).unwrap(), signed);
            prop_assert!(r.at.div_ceil(8) == bytes.len());
        }

        /// No way of writing is cheaper than the one chosen, and none as cheap as a list of bits.
        #[test]
        fn a_column_takes_the_bits_it_says(values in prop::collection::vec(0_u64..5000, 1..40)) {
            let way = Way::best(&values).unwrap();
            let mut w = Writer::default();
            w.column(&values);
            prop_assert_eq!(w.finish().len() as u64, (7 + way.cost).div_ceil(8));
            let most = values.iter().max().unwrap();
            prop_assert!(way.cost <= values.len() as u64 * u64::from(64 - most.leading_zeros()));
        }
    }
}
