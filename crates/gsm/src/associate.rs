//! Which surfels the frame sees again, which it looks through, and which pixels have a surfel.

use crate::Params;
use crate::event::Counts;
use crate::frame::{Frame, dot, sub};
use crate::store::{Step, Store};
use crate::surfels::{BLOCK, Cold, Hot, Surfels};
use nalgebra::{Isometry3, Matrix3};

/// Where errors are independent, surfels average them: fused is mostly the measured depth, since smoothing would
/// blur steps for good.
const RAW: f32 = 0.75;

/// A surfel seen again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    pub(crate) surfel: u32,
    pub(crate) pixel: u32,
    /// Distance of the surfel in front of the pixel's tangent plane at the depth to be fused, metres.
    pub(crate) ahead: f32,
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
    #[inline]
    pub(crate) fn turn(&self, v: [f32; 3]) -> [f32; 3] {
        let m = &self.world_from_camera;
        [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
    }

    /// Turns a world direction into the camera.
    #[inline]
    pub(crate) fn unturn(&self, v: [f32; 3]) -> [f32; 3] {
        let m = &self.world_from_camera;
        let c = |k: usize| m[0][k] * v[0] + m[1][k] * v[1] + m[2][k] * v[2];
        [c(0), c(1), c(2)]
    }

    /// A world point in the camera frame.
    #[inline]
    pub(crate) fn view(&self, p: [f32; 3]) -> [f32; 3] {
        self.unturn(sub(p, self.centre))
    }

    /// A camera point in the world.
    #[inline]
    pub(crate) fn place(&self, p: [f32; 3]) -> [f32; 3] {
        let q = self.turn(p);
        [q[0] + self.centre[0], q[1] + self.centre[1], q[2] + self.centre[2]]
    }
}

/// Result of the association, reused from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Association {
    pub(crate) matches: Vec<Match>,
    /// Per pixel the nearest matched surfel plus one, 0 = none.
    pub(crate) hit: Vec<u32>,
    /// Its segment (slot plus one), 0 = none.
    pub(crate) segment: Vec<u32>,
    /// Square of its distance from the pixel's point; `f32::MAX` = only strays, infinite = nothing there.
    hit_distance: Vec<f32>,
    /// Surfels that the frame speaks against, and how strongly.
    doubted: Vec<(u32, Doubt)>,
    /// Bricks that hold surfels to be removed.
    weeds: Vec<u32>,
}

/// Why a surfel in view is not seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Doubt {
    /// The camera looks through it.
    Through,
    /// It is near the measured surface, but not of it.
    Stray,
}

enum Sight {
    Seen,
    Doubt(Doubt),
    Nothing,
}

impl Association {
    /// Projects every surfel of the visible bricks. The measured depth itself decides visibility: a surfel within
    /// the gate of its pixel's tangent plane is seen, one clearly before it is contradicted, one behind is hidden.
    pub(crate) fn run(&mut self, step: Step<'_>, visible: &[u32], store: &mut Store, counts: &mut Counts) {
        self.matches.clear();
        self.hit.clear();
        self.hit.resize(step.frame.z.len(), 0);
        self.segment.clear();
        self.segment.resize(step.frame.z.len(), 0);
        self.hit_distance.clear();
        self.hit_distance.resize(step.frame.z.len(), f32::INFINITY);
        let Some(lens) = Lens::new(step) else { return };
        for &b in visible {
            let mut weeds = false;
            for &block in &store.bricks.list[b as usize].blocks {
                counts.visited += block.used.count_ones();
                let first = block.first as usize;
                let Some(hot) = store.surfels.hot[first..].first_chunk::<BLOCK>() else { continue };
                let unstable = store.surfels.flags(block.first).unstable;
                let cold = &mut store.surfels.cold[first..first + BLOCK];
                for (k, hot) in hot.iter().enumerate() {
                    if hot.radius <= 0.0 {
                        weeds |= hot.radius < 0.0;
                        continue;
                    }
                    let id = block.first + k as u32;
                    let spot = lens.project(hot);
                    let sight = spot.map_or(Sight::Nothing, |spot| self.look(&lens, hot, &spot, id));
                    if let Sight::Doubt(doubt) = sight {
                        self.doubted.push((id, doubt));
                    }
                    // Only unstable ones time out; the bookkeeping of the others is left alone.
                    if unstable >> k & 1 == 1 {
                        if matches!(sight, Sight::Seen) {
                            cold[k].seen = step.now;
                        } else {
                            weeds |= timed_out(&cold[k], step);
                        }
                    }
                }
            }
            weeds |= self.doubt(store, counts);
            if weeds {
                self.weeds.push(b);
            }
        }
        for b in self.weeds.drain(..) {
            let gone = |s: &Surfels, id: u32| {
                let cold = &s.cold[id as usize];
                cold.confidence < 0.0 || timed_out(cold, step)
            };
            counts.expired += store.weed(b as usize, gone);
        }
        counts.expired -= counts.contradicted;
        counts.matched = self.matches.len() as u32;
    }

    /// Lowers the confidence of the doubted surfels; true when one is worn out.
    fn doubt(&mut self, store: &mut Store, counts: &mut Counts) -> bool {
        let mut any = false;
        for (id, doubt) in self.doubted.drain(..) {
            let cold = &mut store.surfels.cold[id as usize];
            cold.confidence = match doubt {
                Doubt::Through => cold.confidence * 0.7 - 0.5,
                Doubt::Stray => cold.confidence * 0.9 - 0.3,
            };
            if cold.confidence < 0.0 {
                counts.contradicted += 1;
                any = true;
            }
        }
        any
    }

    /// Whether the pixel sees no surfel, and none strays about its point either.
    #[inline]
    pub(crate) fn is_bare(&self, pixel: usize) -> bool {
        self.hit_distance[pixel] == f32::INFINITY
    }

    /// What the pixel under a surfel says of it.
    #[inline]
    fn look(&mut self, lens: &Lens<'_>, hot: &Hot, spot: &Spot, id: u32) -> Sight {
        let Lens { frame, pose, params, .. } = *lens;
        let Spot { point: p, x, y } = *spot;
        let i = y * frame.width + x;
        let z = frame.z[i];
        if z == 0.0 {
            return Sight::Nothing;
        }
        let tolerance = params.gate_sigmas * frame.noise.sigma(z) + params.pose_error;
        if p[2] < z - 2.0 * tolerance {
            let through = looked_through(frame, x, y, p[2] + 2.0 * tolerance);
            return if through { Sight::Doubt(Doubt::Through) } else { Sight::Nothing };
        }
        let n = frame.normal(i);
        if n == [0.0; 3] || p[2] > z + 3.0 * tolerance + 0.1 * z {
            return Sight::Nothing;
        }
        let off = sub(p, frame.point(x, y));
        let ahead = dot(off, n);
        let parallel = dot(pose.unturn(hot.normal), n) >= params.gate_normal_cos;
        if ahead.abs() > tolerance || !parallel {
            // A sheet a little behind, or a wrongly turned disc within: not what the camera would see there.
            let near = ahead.abs() <= if parallel { 3.0 * tolerance } else { 0.5 * tolerance };
            if !near {
                return Sight::Nothing;
            }
            self.hit_distance[i] = self.hit_distance[i].min(f32::MAX);
            return Sight::Doubt(Doubt::Stray);
        }
        // Along the pixel's ray, what is z deeper lies z times their product behind.
        let facing = dot(n, [frame.ray_x[x], frame.ray_y[y], 1.0]);
        let ahead = ahead - lens.raw * (z - frame.smooth[i]) * facing;
        self.matches.push(Match { surfel: id, pixel: i as u32, ahead });
        let distance = dot(off, off);
        if distance < self.hit_distance[i] {
            self.hit_distance[i] = distance;
            self.hit[i] = id + 1;
            self.segment[i] = hot.segment;
        }
        Sight::Seen
    }
}

/// Where a surfel falls: its point in the camera frame, its column and its row.
struct Spot {
    point: [f32; 3],
    x: usize,
    y: usize,
}

/// Camera constants of the projection, shifted by half a pixel so that truncation rounds to the nearest.
struct Lens<'a> {
    frame: &'a Frame,
    pose: &'a Pose,
    params: &'a Params,
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
    width: f32,
    height: f32,
    /// Part of the measured depth in what is fused; the rest is the smoothed one.
    raw: f32,
}

impl<'a> Lens<'a> {
    fn new(Step { frame, pose, params, .. }: Step<'a>) -> Option<Self> {
        let c = frame.camera?;
        let (width, height) = (frame.width as f32, frame.height as f32);
        let (cx, cy) = (c.cx() + 0.5, c.cy() + 0.5);
        let raw = if frame.noise.independent { RAW } else { 0.0 };
        Some(Self { frame, pose, params, fx: c.fx(), fy: c.fy(), cx, cy, width, height, raw })
    }

    /// Projects a surfel; `None` outside the image.
    #[inline]
    fn project(&self, hot: &Hot) -> Option<Spot> {
        let point = self.pose.view(hot.position);
        if point[2] < self.params.min_depth {
            return None;
        }
        let inverse = 1.0 / point[2];
        let u = self.fx * point[0] * inverse + self.cx;
        let v = self.fy * point[1] * inverse + self.cy;
        (u >= 0.0 && v >= 0.0 && u < self.width && v < self.height).then_some(Spot {
            point,
            x: u as usize,
            y: v as usize,
        })
    }
}

/// Unstable and not seen for long.
#[inline]
pub(crate) fn timed_out(cold: &Cold, step: Step<'_>) -> bool {
    !cold.stable && step.now.saturating_sub(cold.seen) > step.params.unstable_frames
}

/// Whether all valid depths of the 3×3 pixels around (x, y), at least six, lie beyond `z`.
fn looked_through(frame: &Frame, x: usize, y: usize, z: f32) -> bool {
    let mut beyond = 0;
    for row in y.saturating_sub(1)..(y + 2).min(frame.height) {
        for column in x.saturating_sub(1)..(x + 2).min(frame.width) {
            let d = frame.z[row * frame.width + column];
            if d > 0.0 && d <= z {
                return false;
            }
            beyond += u32::from(d > z);
        }
    }
    beyond >= 6
}
