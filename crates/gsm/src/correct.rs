//! Corrected poses: what was learnt in a stretch of time moves with it, without integrating the frames again.

use crate::Map;
use crate::associate::Pose;
use crate::surfels::{Cold, Hot};
use nalgebra::Isometry3;

/// What a correction did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Corrected {
    /// Surfels that were moved.
    pub moved: u32,
    /// Of these, surfels that found no room in a full map and are gone.
    pub lost: u32,
}

/// All that is known of one surfel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Whole {
    pub(crate) hot: Hot,
    pub(crate) cold: Cold,
    pub(crate) confidence: f32,
    pub(crate) label_confidence: i16,
    pub(crate) stable: bool,
}

impl Map {
    /// Moves the surfels first seen at times in `from..=to` by a rigid correction that maps the world as it was
    /// believed into the world as it is: `p' = R p + t`. Labels, confidences and segments stay; moments are brought
    /// up to the new positions. What such a stretch had seen of free space is forgotten in the bricks that it filled,
    /// as no one knows any more where that was. The poses of later frames must be the corrected ones.
    ///
    /// A surfel belongs to the frame that made it; frames that saw it again do not move it.
    pub fn apply_correction(&mut self, from: f64, to: f64, correction: &Isometry3<f32>) -> Corrected {
        let pose = Pose::new(correction);
        let within = |frame: u32| self.times.get(frame as usize).is_some_and(|&t| t >= from && t <= to);
        let moving: Vec<u32> = (0..self.store.surfels.entries())
            .filter(|&id| self.store.surfels.is_live(id) && within(self.store.surfels.cold[id as usize].made))
            .collect();
        if self.times.last().is_some_and(|&t| t >= from && t <= to) {
            self.last_centre = self.last_centre.map(|c| pose.place(c));
        }
        let mut parts = Vec::with_capacity(moving.len());
        for &id in &moving {
            let brick = &mut self.store.bricks.list[self.store.surfels.brick(id) as usize];
            (brick.through, brick.surface) = (0, 0);
            parts.push(self.store.take_out(id));
        }
        let mut done = Corrected { moved: moving.len() as u32, lost: 0 };
        for mut whole in parts {
            whole.hot.position = pose.place(whole.hot.position);
            whole.hot.normal = pose.turn(whole.hot.normal);
            done.lost += u32::from(!self.store.put_in(&whole, self.params.max_surfels));
        }
        done
    }
}
