//! Visits out of the frames of a bench run.

use graph_align::{Observation, SceneGraph, Vocabulary, wire};
use nalgebra::{Point3, Vector3};
use scan3r::LabelSet;

/// The names that frames of l20 use.
#[must_use]
pub fn names() -> Vocabulary {
    let set = LabelSet::L20;
    let classes = set.classes().iter().copied().chain(["none"]);
    Vocabulary::new(classes, set.predicates().iter().copied()).unwrap()
}

/// The observations of a file under `wire/`.
///
/// # Errors
/// A file that cannot be read, frames that are none.
pub fn read(path: &str, names: &Vocabulary) -> Result<Vec<Observation>, Box<dyn std::error::Error>> {
    let file = std::fs::read(path)?;
    Ok(wire::split(&file)?.into_iter().map(|f| wire::decode(f, names)).collect::<Result<_, _>>()?)
}

/// The mean of the nodes' centroids.
#[must_use]
pub fn middle(graph: &SceneGraph) -> Point3<f32> {
    let n = graph.len().max(1) as f32;
    Point3::from(graph.nodes().fold(Vector3::zeros(), |s, x| s + x.bounds.centroid().coords / n))
}
