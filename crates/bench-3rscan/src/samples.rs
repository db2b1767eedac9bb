//! Training samples: what the network sees of generated rooms, with the truth beside it.
//!
//! A visit gives up to three graphs: the segments of the map half way and at the end, and the true
//! instances, cut out of the same surfels. Frames are never stored.

use crate::{Error, Surface};
use agent::{NONE, NodeInput, NodeParams, NodeSet, SAME_PART, integrate};
use gsm::{Map, SegmentId};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use safetensors::tensor::{Dtype, TensorView};
use scan3r::{Dataset, LabelSet};
use std::collections::{BTreeMap, BTreeSet};

/// No truth: takes no part in the loss.
pub const IGNORE: i64 = -1;
/// An instance has to hold this share of a segment.
const MIN_COVER: f64 = 0.5;
/// Where three or more instances share a segment, the second may have at most this share of the first.
const MAX_SECOND: f64 = 0.75;

/// Output names of our l20 networks: the 20 classes and `none`; the seven support predicates,
/// `same part` and `none`.
#[must_use]
pub fn output_names(labels: LabelSet) -> (Vec<String>, Vec<String>) {
    let owned = |v: &[&str], more: &[&str]| v.iter().chain(more).map(|s| (*s).to_owned()).collect();
    (owned(labels.classes(), &[NONE]), owned(labels.predicates(), &[SAME_PART, NONE]))
}

/// Where the nodes of a sample come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Segments of the map half way through the visit.
    Half,
    /// Segments at its end.
    End,
    /// True instances at its end.
    Instances,
}

impl Kind {
    /// As in a sample file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Half => "half",
            Self::End => "end",
            Self::Instances => "instances",
        }
    }
}

/// One graph with its truth.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Where its nodes come from.
    pub kind: Kind,
    /// Nodes and pairs.
    pub set: NodeSet,
    /// Class output per node, or [`IGNORE`].
    pub classes: Vec<i64>,
    /// Predicate output per pair, or [`IGNORE`].
    pub predicates: Vec<i64>,
    /// The instance that each node mostly shows, 0 = none.
    pub instances: Vec<u32>,
}

/// The truth of one scan in the form of network outputs.
pub struct Teacher<'a> {
    surface: &'a Surface,
    relations: BTreeMap<(u32, u32), BTreeSet<String>>,
    labels: LabelSet,
}

impl<'a> Teacher<'a> {
    /// Reads the relations of a scan.
    ///
    /// # Errors
    /// What the data set refuses.
    pub fn new(
        data: &dyn Dataset,
        scan: &str,
        surface: &'a Surface,
        labels: LabelSet,
    ) -> Result<Self, Error> {
        let mut relations: BTreeMap<_, BTreeSet<String>> = BTreeMap::new();
        for r in data.relations(scan)? {
            relations.entry((r.subject, r.object)).or_default().insert(r.predicate);
        }
        Ok(Self { surface, relations, labels })
    }

    /// The truth of a node set whose points are in the scan's own frame.
    #[must_use]
    pub fn teach(&self, kind: Kind, set: NodeSet) -> Sample {
        let instances: Vec<Option<u32>> = set.nodes.iter().map(|n| self.instance_of(n)).collect();
        let classes = instances.iter().map(|i| i.map_or(IGNORE, |i| self.class_of(i))).collect();
        let predicates = set.edges.iter().map(|&[i, j]| match (instances[i], instances[j]) {
            (Some(a), Some(b)) => self.predicate_of(a, b),
            _ => IGNORE,
        });
        let predicates = predicates.collect();
        let instances = instances.iter().map(|i| i.unwrap_or(0)).collect();
        Sample { kind, set, classes, predicates, instances }
    }

    /// The instance that holds a segment; `Some(0)` for a surface without annotation, `None` where
    /// no instance holds enough of it.
    fn instance_of(&self, n: &NodeInput) -> Option<u32> {
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        for (p, _) in &n.points {
            if let Some(v) = self.surface.vertex_near(p) {
                *counts.entry(self.surface.annotation().instances[v]).or_default() += 1;
            }
        }
        let mut order: Vec<(usize, u32)> = counts.into_iter().map(|(i, c)| (c, i)).collect();
        order.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        let &(best, instance) = order.first()?;
        let covered = best as f64 > MIN_COVER * n.points.len() as f64;
        let clear = order.len() < 3 || (order[1].0 as f64) < MAX_SECOND * best as f64;
        (covered && clear).then_some(instance)
    }

    fn class_of(&self, instance: u32) -> i64 {
        let classes = self.labels.classes();
        let label = self.surface.annotation().labels.get(&instance);
        let class = label.and_then(|raw| self.labels.class_of(raw));
        class.and_then(|c| classes.iter().position(|k| *k == c)).unwrap_or(classes.len()) as i64
    }

    fn predicate_of(&self, a: u32, b: u32) -> i64 {
        let names = self.labels.predicates();
        let (same, none) = (names.len() as i64, names.len() as i64 + 1);
        if a == b {
            return if a == 0 { none } else { same };
        }
        let Some(found) = self.relations.get(&(a, b)) else { return none };
        names.iter().position(|n| found.contains(*n)).map_or(none, |k| k as i64)
    }

    /// The true instances of a map as nodes: its stable surfels, grouped by the instance that is
    /// nearest to them. Nodes stay in the map's frame, whose points `scan_from_map` maps to the scan's.
    ///
    /// # Errors
    /// Surfels without finite coordinates.
    pub fn instances_of_map(
        &self,
        map: &Map,
        scan_from_map: &Isometry3<f32>,
        p: &NodeParams,
    ) -> Result<NodeSet, Error> {
        type Points = Vec<(Point3<f32>, Vector3<f32>)>;
        let mut groups: BTreeMap<u32, (Points, f32)> = BTreeMap::new();
        for s in map.surfels().filter(|s| s.stable) {
            if let Some(i) = self.surface.instance_at(&(scan_from_map * s.position)) {
                let g = groups.entry(i).or_default();
                g.0.push((s.position, s.normal));
                g.1 += 2.0 * s.radius * s.radius;
            }
        }
        let mut nodes = Vec::new();
        for (i, (dense, area)) in groups {
            if dense.len() >= p.min_surfels as usize && area >= p.min_area {
                let node = NodeInput::new(SegmentId(i), dense.len() as u32, area, &dense, p.points);
                nodes.push(node.map_err(|e| Error::Pipeline(e.to_string()))?);
            }
        }
        Ok(NodeSet::new(nodes, p.gap))
    }
}

/// The samples of one visit.
///
/// # Errors
/// What the data set or the segmentation refuses.
pub fn of_visit(
    data: &dyn Dataset,
    scan: &str,
    visit: u64,
    segmentation: &gsm::Params,
    nodes: &NodeParams,
    labels: LabelSet,
) -> Result<Vec<Sample>, Error> {
    let pipeline = |e: agent::Error| Error::Pipeline(e.to_string());
    let surface = Surface::new(data.annotation(scan)?);
    let teacher = Teacher::new(data, scan, &surface, labels)?;
    let mut map = Map::new(segmentation.clone()).map_err(|e| Error::Pipeline(e.to_string()))?;
    let count = data.frame_count(scan, visit)?;
    let mut samples = Vec::new();
    for (k, frame) in data.frames(scan, visit)?.enumerate() {
        integrate(&mut map, &frame?);
        let kind = match k as u32 + 1 {
            n if n == count => Kind::End,
            n if n == count / 2 => Kind::Half,
            _ => continue,
        };
        let set = NodeSet::of_map(&map, &UnitQuaternion::identity(), nodes).map_err(pipeline)?;
        samples.push(teacher.teach(kind, set));
    }
    samples
        .push(teacher.teach(Kind::Instances, teacher.instances_of_map(&map, &Isometry3::identity(), nodes)?));
    samples.retain(|s| !s.set.nodes.is_empty());
    Ok(samples)
}

/// Samples as one safetensors file. Per graph `<k>.points` of shape `[N, P, 6]` in f32 (xyz in metres,
/// normal; short nodes repeat their points), `<k>.classes` `[N]`, `<k>.edges` `[E, 2]` and
/// `<k>.predicates` `[E]` in i64; metadata `kinds` names the kind of each graph, one a line.
///
/// # Errors
/// Nothing that samples of [`of_visit`] can cause.
pub fn to_safetensors(samples: &[Sample], points: usize, labels: LabelSet) -> Result<Vec<u8>, Error> {
    let mut tensors: Vec<(String, Dtype, Vec<usize>, Vec<u8>)> = Vec::new();
    for (k, s) in samples.iter().enumerate() {
        let mut flat = Vec::with_capacity(s.set.nodes.len() * points * 24);
        for n in &s.set.nodes {
            for q in 0..points {
                let (p, normal) = n.points[q % n.points.len()];
                flat.extend(p.coords.iter().chain(normal.iter()).flat_map(|v| v.to_le_bytes()));
            }
        }
        let ints = |v: &mut dyn Iterator<Item = i64>| v.flat_map(i64::to_le_bytes).collect::<Vec<u8>>();
        let edges = ints(&mut s.set.edges.iter().flatten().map(|&v| v as i64));
        tensors.push((format!("{k}.points"), Dtype::F32, vec![s.set.nodes.len(), points, 6], flat));
        tensors.push((
            format!("{k}.classes"),
            Dtype::I64,
            vec![s.classes.len()],
            ints(&mut s.classes.iter().copied()),
        ));
        tensors.push((format!("{k}.edges"), Dtype::I64, vec![s.set.edges.len(), 2], edges));
        let predicates = ints(&mut s.predicates.iter().copied());
        tensors.push((format!("{k}.predicates"), Dtype::I64, vec![s.predicates.len()], predicates));
    }
    let (classes, predicates) = output_names(labels);
    let metadata = [
        ("kinds".to_owned(), samples.iter().map(|s| s.kind.name()).collect::<Vec<_>>().join("\n")),
        ("class_names".to_owned(), classes.join("\n")),
        ("predicate_names".to_owned(), predicates.join("\n")),
    ];
    let bad = |e: safetensors::SafeTensorError| Error::Pipeline(format!("samples: {e}"));
    let views = tensors
        .iter()
        .map(|(name, dtype, shape, data)| Ok((name.clone(), TensorView::new(*dtype, shape.clone(), data)?)))
        .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()
        .map_err(bad)?;
    safetensors::serialize(views, Some(metadata.into_iter().collect())).map_err(bad)
}
