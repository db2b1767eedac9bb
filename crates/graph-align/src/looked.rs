//! Where a robot has looked: the evidence without which nothing may be called removed.

use crate::Error;
use nalgebra::Point3;

/// Most cells of the box around all seen cells.
const MAX_CELLS: u64 = 1 << 26;

/// A set of cubic cells that were seen (free space, surfaces, and a cell behind them), as bits over
/// the box around them. Nothing follows from a cell that is not in the set.
#[derive(Clone, Debug, PartialEq)]
pub struct Looked {
    cell: f32,
    origin: Point3<f32>,
    /// Smallest cell of the box, and its size in cells; tight.
    first: [i32; 3],
    size: [u32; 3],
    /// x fastest, lowest bit first.
    bits: Vec<u8>,
}

impl Looked {
    /// Cell (i, j, k) spans origin + cell * (i..i+1, j..j+1, k..k+1), metres.
    ///
    /// # Errors
    /// A cell size that is not positive, an origin that is not finite, cells farther apart than 2^26
    /// cells can span.
    pub fn new(cell: f32, origin: [f32; 3], cells: &[[i32; 3]]) -> Result<Self, Error> {
        if !(cell.is_finite() && cell > 0.0) {
            return Err(Error::value("cell", format!("{cell}, want a positive number of metres")));
        }
        if origin.iter().any(|c| !c.is_finite()) {
            return Err(Error::value("origin", "not finite"));
        }
        let edge = |k: usize, pick: fn(i32, i32) -> i32| cells.iter().map(|c| c[k]).reduce(pick).unwrap_or(0);
        let first = [0, 1, 2].map(|k| edge(k, i32::min));
        let size = [0, 1, 2].map(|k| {
            if cells.is_empty() { 0 } else { (i64::from(edge(k, i32::max)) - i64::from(first[k]) + 1) as u64 }
        });
        let all = size.iter().try_fold(1_u64, |a, &s| a.checked_mul(s)).filter(|&a| a <= MAX_CELLS);
        let Some(all) = all else {
            return Err(Error::value("cells", "the box around them holds more than 2^26 cells"));
        };
        let mut out = Self {
            cell,
            origin: origin.into(),
            first,
            size: size.map(|s| s as u32),
            bits: vec![0; all.div_ceil(8) as usize],
        };
        for c in cells {
            if let Some(at) = out.at(c) {
                out.bits[at / 8] |= 1 << (at % 8);
            }
        }
        Ok(out)
    }

    /// From the bits of [`Self::bits`].
    ///
    /// # Errors
    /// As [`Self::new`]; bits that do not fill the box, or a box that is larger than its cells need.
    pub fn from_bits(
        cell: f32,
        origin: [f32; 3],
        first: [i32; 3],
        size: [u32; 3],
        bits: Vec<u8>,
    ) -> Result<Self, Error> {
        let empty = Self::new(cell, origin, &[])?;
        let all =
            size.iter().try_fold(1_u64, |a, &s| a.checked_mul(u64::from(s))).filter(|&a| a <= MAX_CELLS);
        let last = (0..3).all(|k| first[k].checked_add_unsigned(size[k].saturating_sub(1)).is_some());
        let (Some(all), true) = (all, last) else {
            return Err(Error::value("cells", "a box of more than 2^26 cells, or beyond 32 bits"));
        };
        if all == 0 && (size != [0; 3] || first != [0; 3]) || bits.len() as u64 != all.div_ceil(8) {
            return Err(Error::value("cells", format!("{} bytes for {all} cells", bits.len())));
        }
        let out = Self { first, size, bits, ..empty };
        let padding = out.bits.last().is_some_and(|b| !all.is_multiple_of(8) && b >> (all % 8) != 0);
        let (mut low, mut high) = (size, [0_u32; 3]);
        for c in out.cells() {
            for k in 0..3 {
                let d = (i64::from(c[k]) - i64::from(first[k])) as u32;
                (low[k], high[k]) = (low[k].min(d), high[k].max(d + 1));
            }
        }
        if padding || all > 0 && (low != [0; 3] || high != size) {
            return Err(Error::value("cells", "the box is not the tight one around its cells"));
        }
        Ok(out)
    }

    fn at(&self, c: &[i32; 3]) -> Option<usize> {
        let mut at = 0;
        for k in (0..3).rev() {
            let d = u32::try_from(i64::from(c[k]) - i64::from(self.first[k])).ok()?;
            if d >= self.size[k] {
                return None;
            }
            at = at * self.size[k] as usize + d as usize;
        }
        Some(at)
    }

    /// Whether the cell that holds this point was seen.
    #[must_use]
    pub fn contains(&self, p: &Point3<f32>) -> bool {
        let c = [0, 1, 2].map(|k| ((p[k] - self.origin[k]) / self.cell).floor() as i32);
        self.at(&c).is_some_and(|at| self.bits[at / 8] >> (at % 8) & 1 == 1)
    }

    /// Middle and radius of a ball around all seen cells.
    pub(crate) fn ball(&self) -> (Point3<f32>, f32) {
        let side = |k: usize| self.size[k] as f32 * self.cell;
        let low = |k: usize| self.origin[k] + self.first[k] as f32 * self.cell;
        let middle = [0, 1, 2].map(|k| low(k) + side(k) / 2.0);
        (middle.into(), side(0).hypot(side(1)).hypot(side(2)) / 2.0)
    }

    /// Side of a cell, metres.
    #[must_use]
    pub fn cell(&self) -> f32 {
        self.cell
    }

    /// Corner of cell (0, 0, 0).
    #[must_use]
    pub fn origin(&self) -> Point3<f32> {
        self.origin
    }

    /// Smallest cell of the box around all seen cells, and its size in cells.
    #[must_use]
    pub fn span(&self) -> ([i32; 3], [u32; 3]) {
        (self.first, self.size)
    }

    /// One bit per cell of the box, x fastest, lowest bit first.
    #[must_use]
    pub fn bits(&self) -> &[u8] {
        &self.bits
    }

    /// Seen cells, z slowest.
    pub fn cells(&self) -> impl Iterator<Item = [i32; 3]> + '_ {
        let [nx, ny, _] = self.size.map(|s| s as usize);
        (0..self.bits.len() * 8).filter(|at| self.bits[at / 8] >> (at % 8) & 1 == 1).map(move |at| {
            let d = [at % nx.max(1), at / nx.max(1) % ny.max(1), at / (nx * ny).max(1)];
            [0, 1, 2].map(|k| self.first[k] + d[k] as i32)
        })
    }

    /// The set as it travels: its origin in whole centimetres.
    #[must_use]
    pub fn quantised(&self) -> Self {
        let cm = |v: f32| ((f64::from(v) * 100.0).round() / 100.0) as f32;
        Self { origin: self.origin.map(cm), cell: cm(self.cell).max(0.01), ..self.clone() }
    }
}
