//! Many frames at once: images are segmented side by side while the map takes those before.

use crate::event::Skip;
use crate::image::Image;
use crate::{DepthView, FrameReport, Map, Params};
use rayon::prelude::*;
use std::mem;

/// Images that were segmented ahead of the map, and which of them cannot be used.
#[derive(Debug, Default)]
pub(crate) struct Ahead {
    images: Vec<Image>,
    refused: Vec<Option<Skip>>,
}

impl Ahead {
    fn segment(&mut self, views: &[DepthView<'_>], params: &Params) {
        self.images.resize_with(views.len().max(self.images.len()), Image::default);
        self.refused.clear();
        self.refused.par_extend(views.par_iter().zip(&mut self.images).map(|(view, image)| {
            let refused = image.read(view, params);
            if refused.is_none() {
                image.segment(params, &mut |_| ());
            }
            refused
        }));
    }
}

impl Map {
    /// Adds frames in their order, bit for bit like [`integrate`](Self::integrate) for each; where rayon has more
    /// than one thread, as many images are segmented side by side while the map learns those before. With a sensor
    /// whose images are steadied by what the map expects ([`NoiseModel::is_independent`](crate::NoiseModel)) each
    /// frame needs the one before, and is taken alone.
    ///
    /// Results come when all frames are done: give ten to a hundred at a time. Memory: the workspace of four images per
    /// thread, some 100 bytes per working pixel each.
    pub fn integrate_all(&mut self, views: &[DepthView<'_>]) -> Vec<FrameReport> {
        let threads = rayon::current_num_threads();
        if threads == 1 || views.len() < 2 || self.params.noise.is_independent() {
            return views.iter().map(|view| self.integrate(view)).collect();
        }
        let params = self.params.clone();
        let [mut ready, mut next] = mem::take(&mut self.ahead);
        let mut reports = Vec::with_capacity(views.len());
        // Two per thread, so that none waits long for the others at the end.
        let mut chunks = views.chunks(2 * threads);
        let mut current = chunks.next().unwrap_or_default();
        ready.segment(current, &params);
        while !current.is_empty() {
            let following = chunks.next().unwrap_or_default();
            rayon::join(
                || self.learn_all(current, &mut ready, &mut reports),
                || next.segment(following, &params),
            );
            mem::swap(&mut ready, &mut next);
            current = following;
        }
        self.ahead = [ready, next];
        reports
    }

    /// The map learns images that are segmented.
    fn learn_all(&mut self, views: &[DepthView<'_>], ready: &mut Ahead, reports: &mut Vec<FrameReport>) {
        for ((view, image), &skipped) in views.iter().zip(&mut ready.images).zip(&ready.refused) {
            let mut report = FrameReport { skipped, ..FrameReport::default() };
            if skipped.is_none() {
                mem::swap(&mut self.image, image);
                let pose = self.enter(view, &mut report);
                self.learn(&pose, &mut report, &mut |_| ());
            }
            reports.push(report);
        }
    }
}
