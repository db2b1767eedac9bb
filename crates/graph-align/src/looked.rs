//! Where a robot has looked: the evidence without which nothing may be called removed.

use crate::Error;
use nalgebra::Point3;

/// A set of cubic cells that were seen (free space, surfaces, and a cell behind them). Nothing
/// follows from a cell that is not in the set.
#[derive(Clone, Debug, PartialEq)]
pub struct Looked {
    cell: f32,
    origin: Point3<f32>,
    /// Sorted, without repetition.
    cells: Vec<[i32; 3]>,
}

impl Looked {
    /// Cell (i, j, k) spans origin + cell * (i..i+1, j..j+1, k..k+1), metres.
    ///
    /// # Errors
    /// A cell size that is not positive, an origin that is not finite.
    pub fn new(cell: f32, origin: [f32; 3], mut cells: Vec<[i32; 3]>) -> Result<Self, Error> {
        if !(cell.is_finite() && cell > 0.0) {
            return Err(Error::value("cell", format!("{cell}, want a positive number of metres")));
        }
        if origin.iter().any(|c| !c.is_finite()) {
            return Err(Error::value("origin", "not finite"));
        }
        cells.sort_unstable();
        cells.dedup();
        Ok(Self { cell, origin: origin.into(), cells })
    }

    /// Whether the cell that holds this point was seen.
    #[must_use]
    pub fn contains(&self, p: &Point3<f32>) -> bool {
        let c = [0, 1, 2].map(|k| ((p[k] - self.origin[k]) / self.cell).floor() as i32);
        self.cells.binary_search(&c).is_ok()
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

    /// Seen cells, sorted.
    #[must_use]
    pub fn cells(&self) -> &[[i32; 3]] {
        &self.cells
    }
}
