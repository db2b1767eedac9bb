//! Numbers as bits: columns that are each written the cheapest of a few ways.

use crate::Error;

/// Parameter of numbers that stand alone.
const ALONE: u32 = 7;

/// Writes bits, lowest first; or compares what it would write with what is there.
#[derive(Debug, Default)]
pub(super) struct Writer<'a> {
    /// What was written; nothing where it is compared.
    bytes: Vec<u8>,
    /// What it should be, and the first byte that is not.
    against: Option<&'a [u8]>,
    differs: Option<usize>,
    /// Whole bytes so far.
    len: usize,
    /// The byte that is not whole, and its used bits.
    last: u8,
    used: u32,
}

impl<'a> Writer<'a> {
    /// Compares with these bytes.
    pub(super) fn against(bytes: &'a [u8]) -> Self {
        Self { against: Some(bytes), ..Self::default() }
    }

    /// The bytes, with zero bits to the end of the last one.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.fill(0);
        self.bytes
    }

    /// Zero bits to the end of the last byte, and zero bytes to a length.
    pub(super) fn fill(&mut self, least: usize) {
        if self.used > 0 {
            self.byte(self.last);
            (self.last, self.used) = (0, 0);
        }
        while self.len < least {
            self.byte(0);
        }
    }

    /// There is one way to write what was compared.
    pub(super) fn same(mut self) -> Result<(), Error> {
        self.fill(0);
        let ends = self.against.is_some_and(|a| a.len() != self.len).then_some(self.len);
        match self.differs.or(ends) {
            None => Ok(()),
            Some(at) => Err(Error::format(format!("byte {at}"), "not as an encoder writes it")),
        }
    }

    fn byte(&mut self, byte: u8) {
        match self.against {
            None => self.bytes.push(byte),
            Some(a) => {
                if a.get(self.len) != Some(&byte) {
                    self.differs.get_or_insert(self.len);
                }
            }
        }
        self.len += 1;
    }

    /// The `n` lowest bits of `v`, `n` <= 64.
    pub(super) fn bits(&mut self, mut v: u64, mut n: u32) {
        while n > 0 {
            let take = n.min(8 - self.used);
            self.last |= ((v & mask(take)) as u8) << self.used;
            self.used += take;
            if self.used == 8 {
                self.byte(self.last);
                (self.last, self.used) = (0, 0);
            }
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
    pub(super) fn column(&mut self, values: impl Iterator<Item = u64> + Clone) {
        let mut costs = Costs::default();
        values.clone().for_each(|v| costs.add(v));
        self.column_as(values, costs.best());
    }

    fn column_as(&mut self, values: impl Iterator<Item = u64>, way: Option<Way>) {
        let Some(way) = way else { return };
        self.bits(u64::from(way.golomb), 1);
        self.bits(u64::from(way.k), 6);
        for v in values {
            if way.golomb { self.golomb(v, way.k) } else { self.bits(v, way.k) }
        }
    }

    /// Signed numbers: above their smallest, or as differences to the one before.
    pub(super) fn signed(&mut self, values: impl Iterator<Item = i64> + Clone) {
        let Some(least) = values.clone().min() else { return };
        let above = values.clone().map(|v| v.wrapping_sub(least) as u64);
        let mut before = 0;
        let steps = values.map(move |v| zigzag(v.wrapping_sub(std::mem::replace(&mut before, v))));
        let (mut flat, mut steep) = (Costs::default(), Costs::default());
        above.clone().for_each(|v| flat.add(v));
        steps.clone().for_each(|v| steep.add(v));
        let (flat, steep) = (flat.best(), steep.best());
        let cost = |w: &Option<Way>| w.as_ref().map_or(0, |w| w.cost);
        let steppy = cost(&steep) < cost(&flat) + u64::from(length(zigzag(least), ALONE));
        self.bits(u64::from(steppy), 1);
        if steppy {
            self.column_as(steps, steep);
        } else {
            self.number(zigzag(least));
            self.column_as(above, flat);
        }
    }
}

fn mask(n: u32) -> u64 {
    if n < 64 { (1 << n) - 1 } else { u64::MAX }
}

pub(super) fn zigzag(v: i64) -> u64 {
    (v.wrapping_shl(1) ^ (v >> 63)) as u64
}

pub(super) fn unzigzag(v: u64) -> i64 {
    (v >> 1) as i64 ^ -((v & 1) as i64)
}

/// Bits of a Golomb number.
fn length(v: u64, k: u32) -> u32 {
    2 * (u128::from(v >> k) + 1).ilog2() + 1 + k
}

/// What every way to write a column would cost.
struct Costs {
    count: u64,
    most: u64,
    /// By order, bits beyond 1 + k for each number.
    golomb: [u64; 64],
}

impl Default for Costs {
    fn default() -> Self {
        Self { count: 0, most: 0, golomb: [0; 64] }
    }
}

impl Costs {
    fn add(&mut self, v: u64) {
        self.count += 1;
        self.most = self.most.max(v);
        for (k, cost) in (0..width(v)).zip(&mut self.golomb) {
            *cost += u64::from(length(v, k) - 1 - k);
        }
    }

    /// The cheapest; of equals fixed bits, then the smaller order. None for nothing.
    fn best(&self) -> Option<Way> {
        if self.count == 0 {
            return None;
        }
        let width = width(self.most);
        let fixed = Way { golomb: false, k: width, cost: u64::from(width) * self.count };
        let golomb = (0..width.max(1)).zip(&self.golomb);
        let golomb = golomb.map(|(k, c)| Way { golomb: true, k, cost: c + u64::from(1 + k) * self.count });
        std::iter::once(fixed).filter(|f| f.k < 64).chain(golomb).min_by_key(|w| w.cost)
    }
}

/// Bits of a number.
fn width(v: u64) -> u32 {
    v.checked_ilog2().map_or(0, |b| b + 1)
}

/// How a column is written: `k` bits each, or Exp-Golomb of order `k`.
struct Way {
    golomb: bool,
    k: u32,
    cost: u64,
}

/// Reads what [`Writer`] wrote.
#[derive(Clone, Copy)]
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

    /// `n` numbers of at most `most`: looked through here, and read again where they are used, so that a column
    /// takes no memory.
    pub(super) fn column(&mut self, n: usize, most: u64) -> Result<Column<'a>, Error> {
        let mut column = Column { from: *self, golomb: false, k: 0, left: n };
        if n > 0 {
            column.golomb = self.bits(1)? == 1;
            column.k = self.bits(6)? as u32;
            column.from = *self;
        }
        for _ in 0..n {
            let v = column.read(self)?;
            if v > most {
                return Err(self.bad(format!("{v}, want at most {most}")));
            }
        }
        Ok(column)
    }

    pub(super) fn signed(&mut self, n: usize) -> Result<Signed<'a>, Error> {
        let steppy = n > 0 && self.bits(1)? == 1;
        let least = if n == 0 || steppy { 0 } else { unzigzag(self.number()?) };
        let signed = Signed { column: self.column(n, u64::MAX)?, steppy, last: least };
        if signed.clone().count() < n {
            return Err(self.bad("a number beyond 64 bits"));
        }
        Ok(signed)
    }
}

/// Numbers that were looked through.
#[derive(Clone)]
pub(super) struct Column<'a> {
    from: Reader<'a>,
    golomb: bool,
    k: u32,
    left: usize,
}

impl Column<'_> {
    fn read(&self, r: &mut Reader<'_>) -> Result<u64, Error> {
        if self.golomb { r.golomb(self.k) } else { r.bits(self.k) }
    }
}

impl Iterator for Column<'_> {
    type Item = u64;

    fn next(&mut self) -> Option<u64> {
        self.left = self.left.checked_sub(1)?;
        let mut r = self.from;
        let v = self.read(&mut r).ok();
        self.from = r;
        v
    }
}

/// Signed numbers that were looked through; it ends early where one would be beyond 64 bits.
#[derive(Clone)]
pub(super) struct Signed<'a> {
    column: Column<'a>,
    steppy: bool,
    /// The number before, or the smallest.
    last: i64,
}

impl Iterator for Signed<'_> {
    type Item = i64;

    fn next(&mut self) -> Option<i64> {
        let v = self.column.next()?;
        if self.steppy {
            self.last = self.last.checked_add(unzigzag(v))?;
            Some(self.last)
        } else {
            i64::try_from(v).ok().and_then(|v| self.last.checked_add(v))
        }
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
                w.column(c.iter().copied());
                c.iter().for_each(|&v| w.number(v));
            }
            w.signed(signed.iter().copied());
            let bytes = w.finish();
            let mut same = Writer::against(&bytes);
            for c in &columns {
                same.column(c.iter().copied());
                c.iter().for_each(|&v| same.number(v));
            }
            same.signed(signed.iter().copied());
            prop_assert!(same.same().is_ok());
            let mut r = Reader::new(&bytes, 0);
            for c in &columns {
                prop_assert_eq!(&r.column(c.len(), u64::MAX).unwrap().collect::<Vec<_>>(), c);
                for v in c {
                    prop_assert_eq!(r.number().unwrap(), *v);
                }
            }
            prop_assert_eq!(r.signed(signed.len()).unwrap().collect::<Vec<_>>(), signed);
            prop_assert!(r.at.div_ceil(8) == bytes.len());
        }

        /// No way of writing is cheaper than the one chosen, and none as cheap as a list of bits.
        #[test]
        fn a_column_takes_the_bits_it_says(values in prop::collection::vec(0_u64..5000, 1..40)) {
            let mut costs = Costs::default();
            values.iter().for_each(|&v| costs.add(v));
            let way = costs.best().unwrap();
            for k in 0..14 {
                prop_assert!(way.cost <= values.iter().map(|&v| u64::from(length(v, k))).sum());
            }
            let mut w = Writer::default();
            w.column(values.iter().copied());
            prop_assert_eq!(w.finish().len() as u64, (7 + way.cost).div_ceil(8));
            let most = values.iter().max().unwrap();
            prop_assert!(way.cost <= values.len() as u64 * u64::from(64 - most.leading_zeros()));
        }
    }
}
