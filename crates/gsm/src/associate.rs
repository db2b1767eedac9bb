//! Which surfels the frame sees again, which it looks through, and which pixels have a surfel.

use crate::event::Counts;
use crate::frame::{dot, sub};
use crate::project::{Lens, Seen, bits};
use crate::samples::Samples;
use crate::store::{Step, Store};
use crate::surfels::{BLOCK, Block, Cold, Surfels};
use nalgebra::{Isometry3, Matrix3};
use rayon::prelude::*;

/// Where errors are independent, surfels average them: fused is mostly the measured depth, since smoothing would
/// blur steps for good.
const RAW: f32 = 0.75;

/// A surfel seen again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    pub(crate) surfel: u32,
    pub(crate) sample: u32,
    /// Distance of the surfel in front of the sample's tangent plane at the depth to be fused, metres.
    pub(crate) ahead: f32,
    /// Square of its distance from the sample's point.
    distance: f32,
}

/// Camera pose as plain arrays.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pose {
    /// Rows of the rotation that maps camera directions into the world.
    pub(crate) world_from_camera: [[f32; 3]; 3],
    pub(crate) centre: [f32; 3],
}

impl Pose {
    pub(crate) fn new(pose: &Isometry3<f32>) -> Self {
        let r: Matrix3<f32> = pose.rotation.to_rotation_matrix().into_inner();
        let row = |i: usize| [r[(i, 0)], r[(i, 1)], r[(i, 2)]];
        let t = pose.translation.vector;
        Self { world_from_camera: [row(0), row(1), row(2)], centre: [t.x, t.y, t.z] }
    }

    /// Turns a camera direction into the world.
    #[inline(always)]
    pub(crate) fn turn(&self, v: [f32; 3]) -> [f32; 3] {
        let m = &self.world_from_camera;
        [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
    }

    /// Turns a world direction into the camera.
    #[inline(always)]
    pub(crate) fn unturn(&self, v: [f32; 3]) -> [f32; 3] {
        let m = &self.world_from_camera;
        [
            m[0][0] * v[0] + m[1][0] * v[1] + m[2][0] * v[2],
            m[0][1] * v[0] + m[1][1] * v[1] + m[2][1] * v[2],
            m[0][2] * v[0] + m[1][2] * v[1] + m[2][2] * v[2],
        ]
    }

    /// A world point in the camera frame.
    #[inline(always)]
    pub(crate) fn view(&self, p: [f32; 3]) -> [f32; 3] {
        self.unturn(sub(p, self.centre))
    }

    /// A camera point in the world.
    #[inline(always)]
    pub(crate) fn place(&self, p: [f32; 3]) -> [f32; 3] {
        let q = self.turn(p);
        [q[0] + self.centre[0], q[1] + self.centre[1], q[2] + self.centre[2]]
    }
}

/// What a sample sees of the map.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hit {
    /// Square of the nearest matched surfel's distance from the sample's point; `f32::MAX` = only strays, infinite =
    /// nothing there.
    distance: f32,
    /// Nearest matched surfel plus one, 0 = none.
    pub(crate) surfel: u32,
    /// Its segment (slot plus one), 0 = none.
    pub(crate) segment: u32,
}

impl Hit {
    const NONE: Self = Self { distance: f32::INFINITY, surfel: 0, segment: 0 };

    /// Whether the sample sees no surfel, and none strays about its point either.
    #[inline]
    pub(crate) fn is_bare(&self) -> bool {
        self.distance == f32::INFINITY
    }
}

/// Result of the association, reused from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Association {
    pub(crate) matches: Vec<Match>,
    /// Per sample.
    pub(crate) hits: Vec<Hit>,
    shares: Vec<Share>,
}

/// What some of the visible bricks gave.
#[derive(Debug, Default)]
struct Share {
    matches: Vec<Match>,
    /// Surfels that the frame speaks against, how strongly, and the brick.
    doubts: Vec<(u32, Doubt)>,
    /// Samples near whose point a surfel strays.
    strays: Vec<u32>,
    /// Bricks that hold surfels to be removed.
    weeds: Vec<u32>,
    visited: u32,
}

/// Why a surfel in view is not seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Doubt {
    /// The camera looks through it.
    Through,
    /// It is near the measured surface, but not of it.
    Stray,
}

/// What the sample under a surfel says of it.
enum Sight {
    Seen { ahead: f32, distance: f32 },
    Doubt(Doubt),
    Nothing,
}

impl Association {
    /// Projects every surfel of the visible bricks. The measured depth itself decides visibility: a surfel within
    /// the gate of its sample's tangent plane is seen, one clearly before it is contradicted, one behind is hidden.
    pub(crate) fn run(&mut self, step: Step<'_>, visible: &[u32], store: &mut Store, counts: &mut Counts) {
        self.matches.clear();
        self.hits.clear();
        self.hits.resize(step.samples.list.len(), Hit::NONE);
        let Some(camera) = step.samples.camera else { return };
        let gate = Gate {
            lens: Lens::new(&camera, step.pose, step.params),
            step,
            raw: if step.frame.noise.independent { RAW } else { 0.0 },
        };
        // Each thread looks at its share of the bricks; what they say is taken in the order of the bricks.
        let share = visible.len().div_ceil(rayon::current_num_threads()).max(1);
        self.shares.resize_with(visible.len().div_ceil(share), Share::default);
        (visible.par_chunks(share), &mut self.shares[..])
            .into_par_iter()
            .for_each(|(bricks, share)| share.run(&gate, bricks, store));
        let mut shares = std::mem::take(&mut self.shares);
        for share in &mut shares {
            self.take(share, step, store, counts);
        }
        for b in shares.iter_mut().flat_map(|s| s.weeds.drain(..)) {
            let gone = |s: &Surfels, id: u32| {
                let cold = &s.cold[id as usize];
                cold.confidence < 0.0 || timed_out(cold, step)
            };
            counts.expired += store.weed(b as usize, gone);
        }
        self.shares = shares;
        counts.expired -= counts.contradicted;
        counts.matched = self.matches.len() as u32;
    }

    /// Takes in what a share of the bricks gave.
    fn take(&mut self, share: &mut Share, step: Step<'_>, store: &mut Store, counts: &mut Counts) {
        counts.visited += share.visited;
        for &i in &share.strays {
            let hit = &mut self.hits[i as usize];
            hit.distance = hit.distance.min(f32::MAX);
        }
        for m in &share.matches {
            let hit = &mut self.hits[m.sample as usize];
            if m.distance < hit.distance {
                let segment = store.surfels.segment(m.surfel);
                *hit = Hit { distance: m.distance, surfel: m.surfel + 1, segment };
            }
            if store.surfels.is_unstable(m.surfel) {
                store.surfels.cold[m.surfel as usize].seen = step.now;
            }
        }
        self.matches.append(&mut share.matches);
        counts.contradicted += share.doubt(store);
    }
}

impl Share {
    fn run(&mut self, gate: &Gate<'_>, bricks: &[u32], store: &Store) {
        self.matches.clear();
        self.strays.clear();
        self.visited = 0;
        for &b in bricks {
            let mut weeds = false;
            for block in &store.bricks.list[b as usize].blocks {
                weeds |= self.block(gate, block, &store.surfels);
            }
            if weeds {
                self.weeds.push(b);
            }
        }
    }

    /// Looks at the surfels of a block; true when one is to be removed.
    fn block(&mut self, gate: &Gate<'_>, block: &Block, surfels: &Surfels) -> bool {
        self.visited += block.used.count_ones();
        let seen = gate.lens.project(&surfels.hot[block.first as usize / BLOCK]);
        let mut unseen = u32::from(surfels.flags(block.first).unstable);
        let mut weeds = seen.doomed != 0;
        unseen &= !seen.doomed;
        for k in bits(seen.inside) {
            let id = block.first + k as u32;
            let sample = seen.y[k] * gate.step.samples.width as u32 + seen.x[k];
            match gate.look(&seen, k) {
                Sight::Seen { ahead, distance } => {
                    self.matches.push(Match { surfel: id, sample, ahead, distance });
                    unseen &= !(1 << k);
                }
                Sight::Doubt(doubt) => {
                    self.doubts.push((id, doubt));
                    if doubt == Doubt::Stray {
                        self.strays.push(sample);
                    }
                    weeds |= wear(surfels.cold[id as usize].confidence, doubt) < 0.0;
                }
                Sight::Nothing => {}
            }
        }
        // Only unstable ones time out; the bookkeeping of the others is left alone.
        for k in bits(unseen) {
            weeds |= timed_out(&surfels.cold[block.first as usize + k], gate.step);
        }
        weeds
    }

    /// Lowers the confidence of the doubted surfels; returns how many are worn out.
    fn doubt(&mut self, store: &mut Store) -> u32 {
        let mut worn = 0;
        for (id, doubt) in self.doubts.drain(..) {
            let confidence = &mut store.surfels.cold[id as usize].confidence;
            *confidence = wear(*confidence, doubt);
            worn += u32::from(*confidence < 0.0);
        }
        worn
    }
}

/// Confidence after a doubt.
fn wear(confidence: f32, doubt: Doubt) -> f32 {
    match doubt {
        Doubt::Through => confidence * 0.7 - 0.5,
        Doubt::Stray => confidence * 0.9 - 0.3,
    }
}

/// What decides whether a surfel is seen.
struct Gate<'a> {
    lens: Lens<'a>,
    step: Step<'a>,
    /// Part of the measured depth in what is fused; the rest is the smoothed one.
    raw: f32,
}

impl Gate<'_> {
    /// What the sample under surfel `k` of a block says of it.
    #[inline]
    fn look(&self, seen: &Seen, k: usize) -> Sight {
        let Step { samples, params, .. } = self.step;
        let (x, y, p) = (seen.x[k] as usize, seen.y[k] as usize, seen.point(k));
        let s = &samples.list[y * samples.width + x];
        let (z, tolerance) = (s.z, s.tolerance);
        if z == 0.0 {
            return Sight::Nothing;
        }
        if p[2] < z - 2.0 * tolerance {
            let through = looked_through(samples, x, y, p[2] + 2.0 * tolerance);
            return if through { Sight::Doubt(Doubt::Through) } else { Sight::Nothing };
        }
        let n = s.normal;
        if s.smooth == 0.0 || p[2] > z + 3.0 * tolerance + 0.1 * z {
            return Sight::Nothing;
        }
        let ray = [samples.ray_x[x], samples.ray_y[y], 1.0];
        let off = sub(p, [s.smooth * ray[0], s.smooth * ray[1], s.smooth]);
        let ahead = dot(off, n);
        let parallel = dot(seen.normal(k), n) >= params.gate_normal_cos;
        if ahead.abs() > tolerance || !parallel {
            // A sheet a little behind, or a wrongly turned disc within: not what the camera would see there.
            let near = ahead.abs() <= if parallel { 3.0 * tolerance } else { 0.5 * tolerance };
            return if near { Sight::Doubt(Doubt::Stray) } else { Sight::Nothing };
        }
        // Along the pixel's ray, what is z deeper lies z times their product behind.
        let facing = dot(n, ray);
        let ahead = ahead - self.raw * (z - s.smooth) * facing;
        Sight::Seen { ahead, distance: dot(off, off) }
    }
}

/// Unstable and not seen for long.
#[inline]
pub(crate) fn timed_out(cold: &Cold, step: Step<'_>) -> bool {
    !cold.stable && step.now.saturating_sub(cold.seen) > step.params.unstable_frames
}

/// Whether all valid depths of the 3×3 samples around (x, y), at least six, lie beyond `z`.
fn looked_through(samples: &Samples, x: usize, y: usize, z: f32) -> bool {
    let mut beyond = 0;
    for row in y.saturating_sub(1)..(y + 2).min(samples.height) {
        for column in x.saturating_sub(1)..(x + 2).min(samples.width) {
            let d = samples.list[row * samples.width + column].z;
            if d > 0.0 && d <= z {
                return false;
            }
            beyond += u32::from(d > z);
        }
    }
    beyond >= 6
}
