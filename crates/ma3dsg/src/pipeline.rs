//! Settings that several commands share.

use agent::{GraphParams, RobotParams};

/// What a robot is run for.
#[derive(Clone, Copy)]
pub(crate) enum Quality {
    /// The benchmark: scores are fused over the visit.
    Bench,
    /// A recording whose up direction is known only at its end.
    UpAtEnd,
}

/// Segmentation with the defaults, for one kind of sensor.
pub(crate) fn segmentation(profile: gsm::Profile) -> gsm::Params {
    gsm::Params { noise: gsm::NoiseModel::of(profile), ..gsm::Params::default() }
}

/// A robot with the thresholds that were tuned on validation rooms (seeds 5 to 9; docs/decisions.md).
pub(crate) fn robot(quality: Quality) -> RobotParams {
    let infer_every = match quality {
        Quality::Bench => RobotParams::default().infer_every,
        Quality::UpAtEnd => 0,
    };
    let graph = GraphParams {
        min_class: MIN_CLASS,
        min_same_part: 0.35,
        second_look: 0.5,
        min_predicate: 0.5,
        ..GraphParams::default()
    };
    RobotParams { infer_every, graph, ..RobotParams::default() }
}

/// The processor's name, for provenance.
pub(crate) fn cpu_name() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("model name"));
    line.and_then(|l| l.split_once(':'))
        .map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, v)| v.trim().to_owned())
}

/// Sets parameters given as `name=value`.
pub(crate) fn set_robust(params: &mut graph_align::RobustParams, list: &[String]) -> anyhow::Result<()> {
    for item in list {
        let known = item.split_once('=').and_then(|(name, value)| Some((name, value.parse().ok()?)));
        if !known.is_some_and(|(name, value): (_, f32)| value.is_finite() && params.set(name, value)) {
            anyhow::bail!("--robust {item:?}, want NAME=VALUE with a name of RobustParams");
        }
    }
    Ok(())
}

/// Probability of its class that a node of a graph has; chosen on validation rooms.
pub(crate) const MIN_CLASS: f32 = 0.45;

/// The names that frames of a label set may use: its classes, "none" for what has no name, and its
/// predicates.
pub(crate) fn vocabulary(labels: scan3r::LabelSet) -> anyhow::Result<graph_align::Vocabulary> {
    let classes = labels.classes().iter().copied().chain([agent::NONE]);
    Ok(graph_align::Vocabulary::new(classes, labels.predicates().iter().copied())?)
}
