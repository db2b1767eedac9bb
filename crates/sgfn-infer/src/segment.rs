//! Points of a segment to network input: normalised points and the 11-number descriptor.

use crate::Error;

/// Extents and radii below this are taken for this, metres. The authors' code takes ln 0 and 0/0 on
/// flat segments, and the result poisons the neighbours; a millimetre is below any sensor's noise.
pub const MIN_EXTENT: f32 = 1e-3;

/// What the network knows of a segment's place and size, metres, world frame: mean 3, standard
/// deviation (n - 1) 3, axis-aligned extent 3, volume, longest extent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Descriptor(pub [f32; 11]);

impl Descriptor {
    /// From points (`channels` numbers each, xyz first), summed in f64.
    #[must_use]
    pub fn of_points(points: &[f32], channels: usize) -> Self {
        let n = (points.len() / channels).max(1) as f64;
        let mut d = [0.0_f32; 11];
        let (mut volume, mut longest) = (1.0_f64, 0.0_f64);
        for axis in 0..3 {
            let values = || points.iter().skip(axis).step_by(channels).map(|&v| f64::from(v));
            let mean = values().sum::<f64>() / n;
            let var = values().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0).max(1.0);
            let (lo, hi) =
                values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            let extent = (hi - lo).max(f64::from(MIN_EXTENT));
            d[axis] = mean as f32;
            d[3 + axis] = var.sqrt() as f32;
            d[6 + axis] = extent as f32;
            volume *= extent;
            longest = longest.max(extent);
        }
        d[9] = volume as f32;
        d[10] = longest as f32;
        Self(d)
    }

    /// [std 3, extent 3, ln volume, ln longest]: the part that joins the node feature.
    #[must_use]
    pub fn spatial(&self) -> [f32; 8] {
        let d = &self.0;
        [d[3], d[4], d[5], d[6], d[7], d[8], d[9].ln(), d[10].ln()]
    }

    /// The edge encoder's input: a - b for mean and std, ln(a / b) for the rest.
    #[must_use]
    pub fn relative(a: &Self, b: &Self) -> [f32; 11] {
        std::array::from_fn(|k| if k < 6 { a.0[k] - b.0[k] } else { (a.0[k] / b.0[k]).ln() })
    }
}

/// One node: normalised points and descriptor.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Point by point: xyz centred and divided by the largest radius, other channels as given.
    pub(crate) points: Vec<f32>,
    pub(crate) channels: usize,
    /// Place and size.
    pub descriptor: Descriptor,
}

impl Segment {
    /// From sampled points, `channels` numbers each (3: xyz; 6: xyz, normal; 9: xyz, rgb in -1..1,
    /// normal), metres, world frame.
    ///
    /// # Errors
    /// No point, a length that is no multiple of `channels`, numbers that are not finite.
    pub fn new(points: &[f32], channels: usize) -> Result<Self, Error> {
        if channels < 3 || points.is_empty() || !points.len().is_multiple_of(channels) {
            return Err(Error::input(
                "points",
                format!("{} numbers, want whole points of {channels} channels (xyz first)", points.len()),
            ));
        }
        if let Some(i) = points.iter().position(|v| !v.is_finite()) {
            return Err(Error::input("points", format!("number {i} is {}, want finite numbers", points[i])));
        }
        let descriptor = Descriptor::of_points(points, channels);
        let mut points = points.to_vec();
        let mean = &descriptor.0[..3];
        let mut radius = 0.0_f32;
        for p in points.chunks_exact_mut(channels) {
            for (v, m) in p[..3].iter_mut().zip(mean) {
                *v -= m;
            }
            radius = radius.max((p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt());
        }
        let scale = 1.0 / radius.max(MIN_EXTENT);
        for p in points.chunks_exact_mut(channels) {
            p[..3].iter_mut().for_each(|v| *v *= scale);
        }
        Ok(Self { points, channels, descriptor })
    }

    /// Point by point, as the network sees them.
    #[must_use]
    pub fn normalised_points(&self) -> &[f32] {
        &self.points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_and_single_points_stay_finite() {
        for points in [vec![1.0, 2.0, 3.0], vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5, 0.0, 0.0]] {
            let s = Segment::new(&points, 3).expect("valid");
            assert!(s.descriptor.spatial().iter().chain(&s.points).all(|v| v.is_finite()));
            assert!(s.descriptor.0[8] == MIN_EXTENT);
        }
        assert!(Segment::new(&[], 3).is_err() && Segment::new(&[1.0; 4], 3).is_err());
        assert!(Segment::new(&[f32::NAN, 0.0, 0.0], 3).is_err());
    }

    #[test]
    fn a_cube_has_its_own_numbers() {
        let mut p = Vec::new();
        for i in 0..8 {
            p.extend([(i & 1) as f32 * 2.0, ((i >> 1) & 1) as f32 * 2.0, (i >> 2) as f32 * 2.0]);
        }
        let d = Descriptor::of_points(&p, 3).0;
        assert_eq!(&d[..3], &[1.0; 3]);
        assert!((d[3] - (8.0_f32 / 7.0).sqrt()).abs() < 1e-6);
        assert_eq!((d[9], d[10]), (8.0, 2.0));
    }
}
