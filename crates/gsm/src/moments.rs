//! Exact running moments of a point set, in integers, so that adding and removing in any order is reversible.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

/// Unit of the integer coordinates: 0.1 mm.
pub const UNIT: f64 = 1e-4;

/// Count, sums and outer products of points in units of 0.1 mm about an origin that the owner keeps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Moments {
    count: i64,
    sum: [i64; 3],
    /// xx, xy, xz, yy, yz, zz.
    outer: [i128; 6],
}

impl Moments {
    /// Adds a point.
    pub fn add(&mut self, q: [i32; 3]) {
        self.change(q, 1);
    }

    /// Removes a point that was added before.
    pub fn remove(&mut self, q: [i32; 3]) {
        self.change(q, -1);
    }

    fn change(&mut self, q: [i32; 3], sign: i64) {
        let [x, y, z] = q.map(i64::from);
        self.count += sign;
        for (s, v) in self.sum.iter_mut().zip([x, y, z]) {
            *s += sign * v;
        }
        for (o, v) in self.outer.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *o += i128::from(sign * v);
        }
    }

    /// Number of points.
    pub fn count(&self) -> u64 {
        self.count.max(0) as u64
    }

    /// Mean in metres about the origin, zero for no points.
    pub fn mean(&self) -> Point3<f64> {
        let n = self.count.max(1) as f64;
        Point3::from(Vector3::from(self.sum.map(|s| s as f64 / n * UNIT)))
    }

    /// Covariance in m² (divided by n), zero for no points.
    pub fn covariance(&self) -> Matrix3<f64> {
        let n = i128::from(self.count.max(1));
        let s = self.sum.map(i128::from);
        // n Σab − Σa Σb is exact in integers.
        let c = |k: usize, a: usize, b: usize| {
            (n * self.outer[k] - s[a] * s[b]) as f64 / (n * n) as f64 * (UNIT * UNIT)
        };
        let (xx, xy, xz, yy, yz, zz) =
            (c(0, 0, 0), c(1, 0, 1), c(2, 0, 2), c(3, 1, 1), c(4, 1, 2), c(5, 2, 2));
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// Direction of least spread and the root mean square distance to the plane through the mean, metres.
    pub fn plane(&self) -> (Vector3<f64>, f64) {
        let eigen = SymmetricEigen::new(self.covariance());
        let k = eigen.eigenvalues.imin();
        (eigen.eigenvectors.column(k).into_owned(), eigen.eigenvalues[k].max(0.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn equals_the_direct_sums_and_undoes_itself(
            points in prop::collection::vec(prop::array::uniform3(-2_000_000i32..2_000_000), 1..60),
            extra in prop::collection::vec(prop::array::uniform3(i32::MIN / 2..i32::MAX / 2), 0..30),
        ) {
            let mut m = Moments::default();
            points.iter().for_each(|&p| m.add(p));
            let before = m;
            extra.iter().for_each(|&p| m.add(p));
            extra.iter().rev().for_each(|&p| m.remove(p));
            prop_assert_eq!(before, m);
            let n = points.len() as f64;
            let metres: Vec<Vector3<f64>> =
                points.iter().map(|p| Vector3::from(p.map(f64::from)) * UNIT).collect();
            let mean = metres.iter().sum::<Vector3<f64>>() / n;
            let cov = metres.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix3<f64>>() / n;
            prop_assert!((m.mean().coords - mean).norm() < 1e-9);
            prop_assert!((m.covariance() - cov).norm() < 1e-6);
        }
    }
}
