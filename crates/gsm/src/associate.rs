//! Which surfels the frame sees again, which it looks through, and which pixels have a surfel.

use crate::Params;
use crate::bricks::Bricks;
use crate::event::Counts;
use crate::frame::{Frame, dot, sub};
use crate::segments::Segments;
use crate::surfels::Surfels;
use nalgebra::{Isometry3, Matrix3};

/// A surfel seen again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    pub(crate) surfel: u32,
    pub(crate) pixel: u32,
    /// Distance of the surfel in front of the pixel's tangent plane, metres.
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
    hit_distance: Vec<f32>,
}

enum Fate {
    Keep,
    Expired,
    Contradicted,
}

impl Association {
    /// Projects every surfel of the visible bricks. The measured depth itself decides visibility: a surfel within
    /// the gate of its pixel's tangent plane is seen, one clearly before it is contradicted, one behind is hidden.
    #[allow(clippy::too_many_arguments)]
    pub(crate) fn run(
        &mut self,
        frame: &Frame,
        pose: &Pose,
        visible: &[u32],
        bricks: &mut Bricks,
        surfels: &mut Surfels,
        segments: &mut Segments,
        params: &Params,
        now: u32,
        counts: &mut Counts,
    ) {
        self.matches.clear();
        self.hit.clear();
        self.hit.resize(frame.z.len(), 0);
        self.hit_distance.clear();
        self.hit_distance.resize(frame.z.len(), f32::INFINITY);
        for &b in visible {
            let mut list = std::mem::take(&mut bricks.list[b as usize].surfels);
            counts.visited += list.len() as u32;
            let mut j = 0;
            while j < list.len() {
                let id = list[j];
                match self.look(frame, pose, surfels, params, now, id) {
                    Fate::Keep => {
                        j += 1;
                        continue;
                    }
                    Fate::Expired => counts.expired += 1,
                    Fate::Contradicted => counts.contradicted += 1,
                }
                segments.remove_surfel(surfels, id);
                list.swap_remove(j);
            }
            bricks.list[b as usize].surfels = list;
        }
        counts.matched = self.matches.len() as u32;
    }

    #[inline]
    fn look(
        &mut self,
        frame: &Frame,
        pose: &Pose,
        surfels: &mut Surfels,
        params: &Params,
        now: u32,
        id: u32,
    ) -> Fate {
        let hot = &surfels.hot[id as usize];
        let fate = match self.project(frame, pose, hot, params, id) {
            Sight::Seen => return Fate::Keep,
            Sight::Nothing => Fate::Expired,
            Sight::Through => {
                let cold = &mut surfels.cold[id as usize];
                cold.confidence = cold.confidence * 0.7 - 0.5;
                if cold.confidence < 0.0 {
                    cold.confidence = 0.0;
                    return Fate::Contradicted;
                }
                Fate::Expired
            }
        };
        let cold = &surfels.cold[id as usize];
        if !cold.stable && now.saturating_sub(cold.seen) > params.unstable_frames { fate } else { Fate::Keep }
    }

    #[inline]
    fn project(
        &mut self,
        frame: &Frame,
        pose: &Pose,
        hot: &crate::surfels::Hot,
        params: &Params,
        id: u32,
    ) -> Sight {
        let Some(camera) = &frame.camera else { return Sight::Nothing };
        let p = pose.view(hot.position);
        if p[2] < params.min_depth {
            return Sight::Nothing;
        }
        let (u, v) = (camera.fx() * p[0] / p[2] + camera.cx(), camera.fy() * p[1] / p[2] + camera.cy());
        if !(u > -0.5 && v > -0.5 && u < frame.width as f32 - 0.5 && v < frame.height as f32 - 0.5) {
            return Sight::Nothing;
        }
        let (x, y) = ((u + 0.5) as usize, (v + 0.5) as usize);
        let (x, y) = (x.min(frame.width - 1), y.min(frame.height - 1));
        let i = y * frame.width + x;
        let z = frame.z[i];
        if z == 0.0 {
            return Sight::Nothing;
        }
        let tolerance = params.gate_sigmas * frame.noise.sigma(z) + params.pose_error;
        if p[2] < z - 2.0 * tolerance {
            return if looked_through(frame, x, y, p[2] + 2.0 * tolerance) {
                Sight::Through
            } else {
                Sight::Nothing
            };
        }
        let n = frame.normal[i];
        if n == [0.0; 3] {
            return Sight::Nothing;
        }
        let off = sub(p, frame.point(x, y));
        let ahead = dot(off, n);
        if ahead.abs() > tolerance || dot(pose.unturn(hot.normal), n) < params.gate_normal_cos {
            return Sight::Nothing;
        }
        self.matches.push(Match { surfel: id, pixel: i as u32, ahead });
        let distance = dot(off, off);
        if distance < self.hit_distance[i] {
            self.hit_distance[i] = distance;
            self.hit[i] = id + 1;
        }
        Sight::Seen
    }
}

enum Sight {
    Seen,
    Through,
    Nothing,
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
