//! Settings that several commands share.

/// Segmentation with the defaults, for one kind of sensor.
pub(crate) fn segmentation(profile: gsm::Profile) -> gsm::Params {
    gsm::Params { noise: gsm::NoiseModel::of(profile), ..gsm::Params::default() }
}
