//! Sensor model: every tolerance of the crate is a multiple of `sigma`.

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
}

/// Constants of one range bin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    /// Standard deviation of a working pixel, metres.
    pub(crate) sigma: f32,
    /// The same after the mean over a window's side.
    pub(crate) smooth: f32,
    /// Half-window, pixels.
    pub(crate) radius: u8,
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
        let mut table = Self { rows: Vec::with_capacity(bins) };
        for i in 0..bins {
            let z = (i as f32 + 0.5) * 0.01;
            let sigma = model.sigma(z) / (factor as f32).sqrt();
            let n = (sigma * 12f32.sqrt() / (spacing * z * slope)).sqrt();
            let r = ((n - 1.0) * 0.5).ceil().clamp(f32::from(RADIUS_MIN), f32::from(RADIUS_MAX));
            table.rows.push(Row { sigma, smooth: sigma / (2.0 * r + 1.0).sqrt(), radius: r as u8 });
        }
        table
    }

    /// The row of a depth; the last one beyond the table.
    #[inline]
    pub(crate) fn row(&self, z: f32) -> Row {
        // The cast saturates; `fit` fills the table before any kernel runs.
        self.rows[((z * 100.0) as usize).min(self.rows.len() - 1)]
    }

    #[inline]
    pub(crate) fn sigma(&self, z: f32) -> f32 {
        self.row(z).sigma
    }

    #[inline]
    pub(crate) fn radius(&self, z: f32) -> u8 {
        self.row(z).radius
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
        assert!(t.radius(1.0) >= RADIUS_MIN && t.radius(4.0) <= RADIUS_MAX);
        let n = 2.0 * f32::from(t.radius(2.0)) + 1.0;
        assert!(m.sigma(2.0) * 12f32.sqrt() / (2.0 / 178.0 * n * n) <= 0.051);
    }
}
