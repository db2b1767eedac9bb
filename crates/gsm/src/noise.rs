//! Sensor model: every tolerance of the crate is a multiple of `sigma`.

use crate::lanes::whole;

/// The kind of depth sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Profile {
    /// Structured light (Kinect v1 and kin): error and quantisation grow with the square of the range.
    #[default]
    Structured,
    /// Time of flight of a phone or tablet: error proportional to range.
    TofPhone,
    /// Rendered depth: only the millimetre quantisation of the files.
    Ideal,
}

/// Standard deviation of one depth pixel as a function of range and incidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseModel {
    /// The kind of sensor.
    pub profile: Profile,
    /// Multiplies sigma (1 = the profile as published).
    pub scale: f32,
}

impl Default for NoiseModel {
    fn default() -> Self {
        Self { profile: Profile::Structured, scale: 1.0 }
    }
}

impl NoiseModel {
    /// The model of a profile at scale 1.
    pub fn of(profile: Profile) -> Self {
        Self { profile, scale: 1.0 }
    }

    /// Axial standard deviation in metres of one pixel at depth `z` (metres), seen frontally.
    ///
    /// Structured: `0.0012 + 0.0019 (z − 0.4)²` (Nguyen, Izadi, Lovell, 3DIMPVT 2012, equation 2).
    /// Time of flight: `0.002 + 0.006 z`. Ideal: `0.0005`, a millimetre of quantisation.
    pub fn sigma(&self, z: f32) -> f32 {
        let s = match self.profile {
            Profile::Structured => 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4),
            Profile::TofPhone => 0.002 + 0.006 * z,
            Profile::Ideal => 0.0005,
        };
        s * self.scale
    }

    /// Whether the errors of neighbouring pixels and of successive frames are independent, so that averages over
    /// windows and over frames fall as white noise does: true for time of flight. Structured light errs in patterns
    /// that stay, and rendered depth has nothing to average.
    pub fn is_independent(&self) -> bool {
        self.profile == Profile::TofPhone
    }

    /// Like [`sigma`](Self::sigma) at incidence `cos` = |normal · viewing ray|: the axial error of a slanted
    /// surface grows as `1/cos`, limited to four times.
    pub fn sigma_at(&self, z: f32, cos: f32) -> f32 {
        self.sigma(z) / cos.clamp(0.25, 1.0)
    }
}

/// `sigma` and window radius over range for one working resolution, in centimetre bins.
#[derive(Debug, Clone, Default)]
pub(crate) struct NoiseTable {
    rows: Vec<Row>,
    pub(crate) independent: bool,
}

/// Constants of one range bin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    /// Standard deviation of a working pixel, metres.
    pub(crate) sigma: f32,
    /// Wanted side of the window, pixels.
    side: f32,
    /// Window of a pixel without prediction.
    pub(crate) window: Window,
}

impl Row {
    /// Side of the window, pixels, and standard deviation, of a pixel without prediction: where prediction lowers the
    /// one by a factor, the other falls with its root.
    #[inline(always)]
    pub(crate) fn wanted(&self) -> (f32, f32) {
        (self.side, self.sigma)
    }
}

/// The window over which a pixel's plane is fitted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Window {
    /// Half of it, pixels.
    pub(crate) radius: u8,
    /// Distance at which the two sides of an edge are compared, pixels.
    pub(crate) reach: u8,
    /// Standard deviation after smoothing, metres.
    pub(crate) smooth: f32,
}

impl Window {
    /// The window of side `n` for pixels of standard deviation `sigma`. Independent errors fall with the side of the
    /// window, and steps between whole windows are told from noise; others fall with the root of it only, and are
    /// compared at half a window.
    #[inline(always)]
    pub(crate) fn new(n: f32, sigma: f32, independent: bool) -> Self {
        let r = ((n - 1.0) * 0.5).ceil().clamp(f32::from(RADIUS_MIN), f32::from(RADIUS_MAX));
        let (radius, side) = (r as u8, 2.0 * r + 1.0);
        if independent {
            Self { radius, reach: radius + 1, smooth: sigma / side }
        } else {
            Self { radius, reach: radius / 2 + 1, smooth: sigma / side.sqrt() }
        }
    }
}

/// Half-windows are within these bounds, pixels.
pub(crate) const RADIUS_MIN: u8 = 2;
pub(crate) const RADIUS_MAX: u8 = 9;

impl NoiseTable {
    /// Tabulates the model for pixels that are blocks of `factor`² sensor pixels and `spacing`·z metres wide.
    ///
    /// Averaging a block divides sigma by `factor^0.5`, halfway between white and fully correlated noise.
    /// The window of `n = 2r + 1` pixels gives a slope error of `sigma √12 / (spacing z n²)`, which is brought
    /// to `slope` (radians).
    pub(crate) fn new(model: &NoiseModel, factor: u32, spacing: f32, slope: f32, max_depth: f32) -> Self {
        let bins = (max_depth * 100.0).ceil() as usize + 2;
        let independent = model.is_independent();
        let mut table = Self { rows: Vec::with_capacity(bins), independent };
        for i in 0..bins {
            let z = (i as f32 + 0.5) * 0.01;
            let sigma = model.sigma(z) / (factor as f32).sqrt();
            let n = (sigma * 12f32.sqrt() / (spacing * z * slope)).sqrt();
            table.rows.push(Row { sigma, side: n, window: Window::new(n, sigma, independent) });
        }
        table
    }

    /// The row of a depth; the last one beyond the table.
    #[inline]
    pub(crate) fn row(&self, z: f32) -> Row {
        // The cast saturates.
        self.at((z * 100.0) as u32)
    }

    /// Number of the row of a depth from 0 to 10 km.
    #[inline(always)]
    pub(crate) fn bin(z: f32) -> u32 {
        whole(z * 100.0)
    }

    /// A row by its number; the last one beyond the table.
    #[inline(always)]
    pub(crate) fn at(&self, bin: u32) -> Row {
        // `fit` fills the table before any kernel runs.
        self.rows[(bin as usize).min(self.rows.len() - 1)]
    }

    #[inline]
    pub(crate) fn sigma(&self, z: f32) -> f32 {
        self.row(z).sigma
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sigma_grows_with_range_and_incidence() {
        for profile in [Profile::Structured, Profile::TofPhone] {
            let m = NoiseModel::of(profile);
            for i in 5..40 {
                let z = i as f32 * 0.1;
                assert!(m.sigma(z + 0.1) > m.sigma(z));
                assert!(m.sigma_at(z, 0.5) > m.sigma_at(z, 1.0));
                assert_eq!(m.sigma_at(z, 0.0), 4.0 * m.sigma(z));
            }
        }
        assert!((NoiseModel::default().sigma(2.4) - 0.0088).abs() < 1e-6);
    }

    #[test]
    fn windows_grow_until_the_slope_error_is_met() {
        let m = NoiseModel::of(Profile::TofPhone);
        let t = NoiseTable::new(&m, 1, 1.0 / 178.0, 0.05, 5.0);
        let window = |z, gain: f32| {
            let (side, sigma) = t.row(z).wanted();
            Window::new(side * gain.sqrt(), sigma * gain, true)
        };
        let radius = |z| window(z, 1.0).radius;
        assert!(radius(1.0) >= RADIUS_MIN && radius(4.0) <= RADIUS_MAX);
        assert!(window(2.0, 0.3).radius < radius(2.0) && window(2.0, 0.3).smooth < window(2.0, 1.0).smooth);
        let n = 2.0 * f32::from(radius(2.0)) + 1.0;
        assert!(m.sigma(2.0) * 12f32.sqrt() / (2.0 / 178.0 * n * n) <= 0.051);
    }
}
