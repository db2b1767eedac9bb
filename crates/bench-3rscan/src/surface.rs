//! The annotated surface of a scan, and how much of it the visits saw.

use nalgebra::Point3;
use scan3r::{Annotation, Frame};
use std::collections::BTreeMap;

/// Side of a grid cell, metres: a little more than the spacing of vertices.
const CELL: f32 = 0.04;
/// A depth sample belongs to a vertex at most this many cells away.
const REACH: u8 = 2;
/// Most cells of a grid; larger scans get larger cells.
const MAX_CELLS: f32 = 48.0e6;
/// A vertex counts as seen from this many depth samples: flying pixels come singly.
const SEEN_HITS: u16 = 2;

/// Labelled vertices with a grid that finds the vertex nearest to a point.
pub struct Surface {
    annotation: Annotation,
    origin: Point3<f32>,
    cell: f32,
    size: [usize; 3],
    /// Vertex + 1 per cell, 0 where none is near.
    nearest: Vec<u32>,
}

impl Surface {
    /// Builds the grid: cells that hold vertices, then the 26 cells round each, then their neighbours.
    #[must_use]
    pub fn new(annotation: Annotation) -> Self {
        let pad = f32::from(REACH) * CELL;
        let (lo, hi) = crate::layout::bounds(annotation.points.iter().copied())
            .unwrap_or((Point3::origin(), Point3::origin()));
        let span = (hi - lo).add_scalar(2.0 * pad);
        let cells = span.map(|s| s / CELL + 1.0).product();
        let cell = CELL * (cells / MAX_CELLS).max(1.0).cbrt();
        let size = [0, 1, 2].map(|k| (span[k] / cell) as usize + 2);
        let mut s = Self {
            origin: lo - nalgebra::Vector3::repeat(pad),
            cell,
            size,
            nearest: vec![0; size.iter().product()],
            annotation,
        };
        s.fill();
        s
    }

    fn fill(&mut self) {
        let mut front = Vec::new();
        for v in 0..self.annotation.points.len() {
            // Vertices without an instance are background: they keep samples off their neighbours.
            if let Some(at) = self.cell_of(&self.annotation.points[v])
                && self.nearest[at] == 0
            {
                self.nearest[at] = v as u32 + 1;
                front.push(at);
            }
        }
        let strides = [1, self.size[0] as isize, (self.size[0] * self.size[1]) as isize];
        let straight: Vec<isize> = strides.iter().flat_map(|&s| [-s, s]).collect();
        let mut round = Vec::new();
        for k in -1..=1 {
            for j in -1..=1 {
                round.extend((-1..=1).map(|i| i * strides[0] + j * strides[1] + k * strides[2]));
            }
        }
        // A sample a hair off a vertex may lie in any of the 26 cells round the vertex's own; cells
        // across a face come first, as they are nearer.
        let mut first = self.spread(&front, &straight);
        first.extend(self.spread(&front, &round));
        for _ in 1..REACH {
            first = self.spread(&first, &straight);
        }
    }

    /// Gives free cells at these offsets from `cells` their vertices; the cells that got one.
    fn spread(&mut self, cells: &[usize], offsets: &[isize]) -> Vec<usize> {
        let mut got = Vec::new();
        for &at in cells {
            for next in offsets.iter().filter_map(|&o| at.checked_add_signed(o)) {
                if next < self.nearest.len() && self.nearest[next] == 0 {
                    self.nearest[next] = self.nearest[at];
                    got.push(next);
                }
            }
        }
        got
    }

    fn cell_of(&self, p: &Point3<f32>) -> Option<usize> {
        let mut at = 0;
        for k in (0..3).rev() {
            let c = (p[k] - self.origin[k]) / self.cell;
            if !(c >= 0.0 && c < self.size[k] as f32) {
                return None;
            }
            at = at * self.size[k] + c as usize;
        }
        Some(at)
    }

    /// The vertex near a point, in the scan's own frame.
    #[must_use]
    pub fn vertex_near(&self, p: &Point3<f32>) -> Option<usize> {
        (self.nearest[self.cell_of(p)?] as usize).checked_sub(1)
    }

    /// The instance at a point, in the scan's own frame.
    #[must_use]
    pub fn instance_at(&self, p: &Point3<f32>) -> Option<u32> {
        self.vertex_near(p).map(|v| self.annotation.instances[v]).filter(|&i| i != 0)
    }

    /// The annotation.
    #[must_use]
    pub fn annotation(&self) -> &Annotation {
        &self.annotation
    }
}

/// How often depth samples fell on each vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    hits: Vec<u16>,
    samples: BTreeMap<u32, u64>,
}

impl Seen {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(surface: &Surface) -> Self {
        Self { hits: vec![0; surface.annotation.points.len()], samples: BTreeMap::new() }
    }

    /// Counts the samples of a frame whose pose is in the scan's own frame.
    pub fn observe(&mut self, surface: &Surface, frame: &Frame) {
        let Some(pose) = frame.world_from_camera else { return };
        let k = frame.intrinsics;
        let mut counts: BTreeMap<u32, u64> = BTreeMap::new();
        // Neighbouring pixels mostly fall on one instance: count runs.
        let (mut run, mut length) = (0_u32, 0_u64);
        let rotation = pose.rotation.to_rotation_matrix();
        for v in 0..k.height {
            let row = &frame.depth[(v * k.width) as usize..((v + 1) * k.width) as usize];
            for (u, &z) in row.iter().enumerate() {
                if z <= 0.0 {
                    continue;
                }
                let p = rotation * k.unproject(u as f32, v as f32, z) + pose.translation.vector;
                let Some(vertex) = surface.vertex_near(&p) else { continue };
                self.hits[vertex] = self.hits[vertex].saturating_add(1);
                let instance = surface.annotation.instances[vertex];
                if instance == run {
                    length += 1;
                } else {
                    *counts.entry(run).or_default() += length;
                    (run, length) = (instance, 1);
                }
            }
        }
        *counts.entry(run).or_default() += length;
        for (instance, n) in counts.into_iter().filter(|(i, n)| *i != 0 && *n > 0) {
            *self.samples.entry(instance).or_default() += n;
        }
    }

    /// Ends a visit: vertices that share a cell of the grid share its samples, so that the seen
    /// surface does not shrink by the cell's size.
    pub fn finish(&mut self, surface: &Surface) {
        for (v, p) in surface.annotation.points.iter().enumerate() {
            if let Some(first) = surface.vertex_near(p).filter(|&f| f != v)
                && surface.annotation.instances[first] == surface.annotation.instances[v]
            {
                self.hits[v] = self.hits[v].max(self.hits[first]);
            }
        }
    }

    /// Adds what another visit of the same scan saw.
    pub fn add(&mut self, other: &Self) {
        self.hits.iter_mut().zip(&other.hits).for_each(|(a, b)| *a = a.saturating_add(*b));
        for (&i, &n) in &other.samples {
            *self.samples.entry(i).or_default() += n;
        }
    }

    /// Depth samples that fell on an instance.
    #[must_use]
    pub fn samples(&self, instance: u32) -> u64 {
        self.samples.get(&instance).copied().unwrap_or(0)
    }

    /// Seen vertices of each instance, in the scan's own frame.
    #[must_use]
    pub fn seen_points(&self, a: &Annotation) -> BTreeMap<u32, Vec<Point3<f32>>> {
        let mut out: BTreeMap<u32, Vec<Point3<f32>>> = BTreeMap::new();
        for (v, &hits) in self.hits.iter().enumerate() {
            if hits >= SEEN_HITS && a.instances[v] != 0 {
                out.entry(a.instances[v]).or_default().push(a.points[v]);
            }
        }
        out
    }
}
