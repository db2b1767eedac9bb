//! Which surfels the frame sees again, which it looks through, and which samples have a surfel.

use crate::event::Counts;
use crate::frame::{dot, sub};
use crate::project::{Lens, bits};
use crate::sight::Gate;
use crate::store::{Step, Store};
use crate::surfels::{BLOCK, Cold, HotBlock, Surfels};
use nalgebra::{Isometry3, Matrix3};
use rayon::prelude::*;

/// Surfels of a block that are seen again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Matches {
    /// Number of the block's first surfel.
    pub(crate) first: u32,
    /// Those seen, a bit each; the rest is valid for these only.
    pub(crate) seen: u32,
    pub(crate) sample: [u32; BLOCK],
    /// Square of the distance from the sample's point.
    distance: [f32; BLOCK],
}

/// A surfel seen again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    pub(crate) surfel: u32,
    pub(crate) sample: u32,
}

impl Matches {
    /// The surfels one by one, some of those seen.
    pub(crate) fn each(&self, some: u32) -> impl Iterator<Item = Match> {
        bits(some).map(|k| Match { surfel: self.first + k as u32, sample: self.sample[k] })
    }
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
    /// In the order of the surfels.
    pub(crate) matches: Vec<Matches>,
    /// Per sample.
    pub(crate) hits: Vec<Hit>,
    /// Those of the matches whose surfel is [tagged](Cold::tag).
    pub(crate) tagged: Vec<Match>,
    /// Blocks of the visible bricks, a bit each, and their numbers in order.
    marked: Vec<u64>,
    blocks: Vec<u32>,
    shares: Vec<Share>,
    weeds: Vec<u32>,
}

/// What some of the visible blocks gave.
#[derive(Debug, Default)]
struct Share {
    matches: Vec<Matches>,
    tagged: Vec<Match>,
    /// Samples near whose point a surfel strays.
    strays: Vec<u32>,
    /// Surfels that have become stable, and stable ones that may have moved.
    ripe: Vec<u32>,
    moved: Vec<u32>,
    /// Bricks that hold surfels to be removed.
    weeds: Vec<u32>,
    contradicted: u32,
}

/// A share's part of the storage.
struct Part<'a> {
    share: &'a mut Share,
    blocks: &'a [u32],
    /// Number of the first block in `hot` and `cold`.
    first: u32,
    hot: &'a mut [HotBlock],
    cold: &'a mut [Cold],
}

/// Why a surfel in view is not seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Doubt {
    /// The camera looks through it.
    Through,
    /// It is near the measured surface, but not of it.
    Stray,
}

impl Association {
    /// Projects every surfel of the visible bricks. The measured depth itself decides visibility: a surfel within
    /// the gate of its sample's tangent plane is seen and averaged with it, one clearly before it is contradicted,
    /// one behind is hidden.
    pub(crate) fn run(&mut self, step: Step<'_>, visible: &[u32], store: &mut Store, counts: &mut Counts) {
        self.matches.clear();
        self.tagged.clear();
        self.hits.clear();
        self.hits.resize(step.samples.list.len(), Hit::NONE);
        let Some(camera) = step.samples.camera else { return };
        counts.visited += self.list(visible, store);
        let gate = Gate::new(Lens::new(&camera, step.pose, step.params), step);
        let parts = split(&self.blocks, &mut self.shares, &mut store.surfels);
        parts.into_par_iter().for_each(|part| part.run(&gate));
        let mut shares = std::mem::take(&mut self.shares);
        for share in &mut shares {
            self.take(share, store, counts);
        }
        self.shares = shares;
        self.weeds.sort_unstable();
        self.weeds.dedup();
        for b in self.weeds.drain(..) {
            counts.expired += store.weed(b as usize, step);
        }
        counts.expired -= counts.contradicted;
        counts.matched = self.matches.iter().map(|m| m.seen.count_ones()).sum();
    }

    /// Lists the blocks of the visible bricks in the order in which they are stored; returns the number of surfels.
    fn list(&mut self, visible: &[u32], store: &Store) -> u32 {
        let mut visited = 0;
        self.marked.clear();
        self.marked.resize(store.surfels.hot.len().div_ceil(64), 0);
        for block in visible.iter().flat_map(|&b| &store.bricks.list[b as usize].blocks) {
            let number = block.first as usize / BLOCK;
            self.marked[number / 64] |= 1 << (number % 64);
            visited += block.used.count_ones();
        }
        self.blocks.clear();
        for (k, &word) in self.marked.iter().enumerate() {
            let mut word = word;
            while word != 0 {
                self.blocks.push(64 * k as u32 + word.trailing_zeros());
                word &= word - 1;
            }
        }
        visited
    }

    /// Takes in what a share of the blocks gave.
    fn take(&mut self, share: &mut Share, store: &mut Store, counts: &mut Counts) {
        let Store { surfels, segments, .. } = store;
        for &i in &share.strays {
            let hit = &mut self.hits[i as usize];
            hit.distance = hit.distance.min(f32::MAX);
        }
        for m in &share.matches {
            let segment = &surfels.hot[m.first as usize / BLOCK].segment;
            for k in bits(m.seen) {
                let hit = &mut self.hits[m.sample[k] as usize];
                // Which of a sample's surfels is the nearest is chance: no branch.
                let nearer = m.distance[k] < hit.distance;
                let own =
                    Hit { distance: m.distance[k], surfel: m.first + k as u32 + 1, segment: segment[k] };
                hit.distance = if nearer { own.distance } else { hit.distance };
                hit.surfel = if nearer { own.surfel } else { hit.surfel };
                hit.segment = if nearer { own.segment } else { hit.segment };
            }
        }
        share.ripe.drain(..).for_each(|id| segments.ripen(surfels, id));
        share.moved.drain(..).for_each(|id| segments.follow(surfels, id));
        if self.matches.is_empty() {
            std::mem::swap(&mut self.matches, &mut share.matches);
        } else {
            self.matches.append(&mut share.matches);
        }
        self.weeds.append(&mut share.weeds);
        self.tagged.append(&mut share.tagged);
        share.strays.clear();
        counts.contradicted += std::mem::take(&mut share.contradicted);
    }
}

/// Deals the blocks out to the threads, each with the stretch of the storage that holds its blocks.
fn split<'a>(blocks: &'a [u32], shares: &'a mut Vec<Share>, surfels: &'a mut Surfels) -> Vec<Part<'a>> {
    let size = blocks.len().div_ceil(rayon::current_num_threads()).max(1);
    shares.resize_with(blocks.len().div_ceil(size), Share::default);
    let (mut hot, mut cold, mut done) = (&mut surfels.hot[..], &mut surfels.cold[..], 0);
    let mut parts = Vec::with_capacity(shares.len());
    for (blocks, share) in blocks.chunks(size).zip(shares) {
        let end = blocks.last().map_or(done, |b| b + 1);
        let take = (end - done) as usize;
        let (own_hot, rest_hot) = std::mem::take(&mut hot).split_at_mut(take);
        let (own_cold, rest_cold) = std::mem::take(&mut cold).split_at_mut(take * BLOCK);
        parts.push(Part { share, blocks, first: done, hot: own_hot, cold: own_cold });
        (hot, cold, done) = (rest_hot, rest_cold, end);
    }
    parts
}

impl Part<'_> {
    fn run(self, gate: &Gate<'_>) {
        let Self { share, blocks, first, hot, cold } = self;
        for &number in blocks {
            let at = (number - first) as usize;
            let Some(cold) = cold[at * BLOCK..].first_chunk_mut() else { continue };
            if share.block(gate, number * BLOCK as u32, &mut hot[at], cold) {
                share.weeds.push(hot[at].brick);
            }
        }
    }
}

impl Share {
    /// Looks at the surfels of a block, numbered from `first`; true when one is to be removed.
    fn block(&mut self, gate: &Gate<'_>, first: u32, hot: &mut HotBlock, cold: &mut [Cold; BLOCK]) -> bool {
        let step = gate.step;
        let seen = gate.lens.project(hot);
        let mut weeds = seen.doomed != 0;
        let mut unseen = u32::from(hot.unstable) & !seen.doomed;
        if seen.inside != 0 {
            let marks = gate.look(hot, &seen);
            let width = step.samples.width as u32;
            let sample: [u32; BLOCK] =
                std::array::from_fn(|k| seen.y[k].wrapping_mul(width).wrapping_add(seen.x[k]));
            if marks.seen != 0 {
                let matches = Matches { first, seen: marks.seen, sample, distance: marks.distance };
                self.tagged.extend(matches.each(marks.seen & u32::from(hot.tagged)));
                self.matches.push(matches);
            }
            for k in bits(marks.before) {
                if gate.looks_through(&seen, k) {
                    weeds |= self.wear(&mut hot.confidence[k], Doubt::Through);
                }
            }
            for k in bits(marks.stray) {
                self.strays.push(sample[k]);
                weeds |= self.wear(&mut hot.confidence[k], Doubt::Stray);
            }
            for k in bits(marks.seen & unseen) {
                cold[k].seen = step.now;
            }
            unseen &= !marks.seen;
            let young = marks.fused & u32::from(hot.unstable);
            for k in bits(young) {
                if hot.confidence[k] >= step.params.stable_sightings as f32 {
                    hot.unstable &= !(1 << k);
                    self.ripe.push(first + k as u32);
                }
            }
            // One in eight at a time.
            let turn = 0x0101u32 << ((8 - (step.now + first) % 8) % 8);
            let follow = marks.fused & !young & turn;
            self.moved.extend(bits(follow).map(|k| first + k as u32));
        }
        // Only unstable ones time out; the bookkeeping of the others is left alone.
        for k in bits(unseen) {
            weeds |= cold[k].timed_out(step);
        }
        weeds
    }

    /// Lowers a confidence; true when it is worn out.
    fn wear(&mut self, confidence: &mut f32, doubt: Doubt) -> bool {
        *confidence = match doubt {
            Doubt::Through => *confidence * 0.3 - 0.5,
            Doubt::Stray => *confidence * 0.9 - 0.3,
        };
        self.contradicted += u32::from(*confidence < 0.0);
        *confidence < 0.0
    }
}
