//! The frame in which each agent's poses stand (BENCH.md section 1, Frames).

use crate::scenario::{FramesMode, Visit};
use crate::seeds;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;

/// Offsets of agents' frames from the domain frame.
#[derive(Clone, Debug)]
pub struct AgentFrames {
    mode: FramesMode,
    seed: u64,
}

impl AgentFrames {
    /// For one scenario.
    #[must_use]
    pub fn new(mode: FramesMode, seed: u64) -> Self {
        Self { mode, seed }
    }

    /// The mode.
    #[must_use]
    pub fn mode(&self) -> FramesMode {
        self.mode
    }

    /// The number of the frame in which a visit's graph stands: 0 is shared, others are an agent's
    /// or a visit's own.
    #[must_use]
    pub fn number(&self, v: &Visit) -> u32 {
        match self.mode {
            FramesMode::Shared => 0,
            FramesMode::Drift | FramesMode::Unknown => v.agent as u32 + 1,
            FramesMode::UnknownVisit => (v.agent as u32 + 1) << 16 | (v.seq + 1),
        }
    }

    /// Domain points to the visit's frame. For `drift` it is the unknown offset of the agent.
    #[must_use]
    pub fn frame_from_domain(&self, v: &Visit) -> Isometry3<f32> {
        let agent = v.agent as u64;
        match self.mode {
            FramesMode::Shared => Isometry3::identity(),
            FramesMode::Drift => {
                let mut rng = seeds::stream(self.seed, "drift", &[agent]);
                let mut n = |sigma: f64| seeds::normal(&mut rng) * sigma;
                yaw_shift(n(2.0_f64.to_radians()), [n(0.25), n(0.25), n(0.05)])
            }
            FramesMode::Unknown => anywhere(&mut seeds::stream(self.seed, "frame", &[agent])),
            FramesMode::UnknownVisit => {
                anywhere(&mut seeds::stream(self.seed, "frame", &[agent, u64::from(v.seq) + 1]))
            }
        }
    }

    /// The error that the poses of a visit gather while walking, for `drift`.
    #[must_use]
    pub fn walk(&self, v: &Visit) -> Option<Walk> {
        (self.mode == FramesMode::Drift).then(|| Walk {
            rng: seeds::stream(self.seed, "walk", &[v.agent as u64, u64::from(v.seq)]),
            last: None,
            error: Isometry3::identity(),
        })
    }
}

fn yaw_shift(yaw: f64, shift: [f64; 3]) -> Isometry3<f32> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw as f32);
    Isometry3::from_parts(Translation3::from(shift.map(|v| v as f32)), turn)
}

/// Any yaw, within 100 m.
fn anywhere(rng: &mut ChaCha8Rng) -> Isometry3<f32> {
    let mut u = || seeds::unit(rng);
    yaw_shift(u() * std::f64::consts::TAU, [200.0 * u() - 100.0, 200.0 * u() - 100.0, 0.0])
}

/// A random walk of poses: 0.5 % of the path, 0.5 degrees per 10 m.
pub struct Walk {
    rng: ChaCha8Rng,
    last: Option<Isometry3<f32>>,
    error: Isometry3<f32>,
}

impl Walk {
    /// The pose as the robot believes it to be.
    pub fn believed(&mut self, pose: Isometry3<f32>) -> Isometry3<f32> {
        if let Some(last) = self.last {
            let step = f64::from((pose.translation.vector - last.translation.vector).norm());
            // Sigmas grow with the root of the path, as a random walk's do: 0.5 % and 0.5 degrees
            // after 10 m.
            let root = (step / 10.0).sqrt();
            let mut n = |sigma: f64| seeds::normal(&mut self.rng) * sigma * root;
            let yaw = n(0.5_f64.to_radians());
            let shift = [n(0.05), n(0.05), n(0.05)];
            let at = pose.translation;
            self.error = at * yaw_shift(yaw, shift) * at.inverse() * self.error;
        }
        self.last = Some(pose);
        self.error * pose
    }
}
