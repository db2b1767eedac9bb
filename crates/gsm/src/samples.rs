//! What the map learns of a frame: one measurement per pixel, or per block of pixels where they are many.
//!
//! The image is segmented at its working resolution; the map need not hold a surfel for every pixel of it. Everything
//! that is counted in the map (votes, borders, sizes of regions) is counted in samples.

use crate::frame::{BAND, DOWN, Frame, RIGHT, dot};
use crate::{Intrinsics, Params};
use rayon::prelude::*;

/// One measurement, in the order in which the association reads it: half a cache line.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(32))]
pub(crate) struct Sample {
    /// Depth as measured, 0 = invalid, metres.
    pub(crate) z: f32,
    /// Depth of the plane around it, 0 = no normal.
    pub(crate) smooth: f32,
    /// Unit normal towards the camera, zero = none.
    pub(crate) normal: [f32; 3],
    /// Cosine between normal and viewing ray.
    pub(crate) cos: f32,
    /// Distance within which a surfel belongs to it, metres.
    pub(crate) tolerance: f32,
    /// Region, 0 = none, and in the highest bit whether it is an edge.
    tag: u32,
}

const EDGE: u32 = 1 << 31;

impl Sample {
    /// Region of the sample, 0 = none.
    #[inline]
    pub(crate) fn region(&self) -> usize {
        (self.tag & !EDGE) as usize
    }

    #[inline]
    pub(crate) fn is_edge(&self) -> bool {
        self.tag & EDGE != 0
    }
}

/// The measurements of a frame, row-major.
#[derive(Debug, Default)]
pub(crate) struct Samples {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Side of the block of working pixels that a sample stands for.
    pub(crate) pitch: usize,
    pub(crate) camera: Option<Intrinsics>,
    /// Mean width of a sample at 1 m.
    pub(crate) spacing: f32,
    /// Ray of column and row.
    pub(crate) ray_x: Vec<f32>,
    pub(crate) ray_y: Vec<f32>,
    pub(crate) list: Vec<Sample>,
    /// Unbroken links between neighbouring samples.
    pub(crate) links: Vec<u8>,
    /// Samples per region; entry 0 counts those of none.
    pub(crate) region_size: Vec<u32>,
    source: Option<Intrinsics>,
}

impl Samples {
    /// Sizes the grid for a camera of working resolution.
    pub(crate) fn fit(&mut self, working: &Intrinsics, params: &Params) {
        if self.source == Some(*working) {
            return;
        }
        // Blocks do not outgrow the image.
        let (w, h, mut pitch) = (working.width(), working.height(), 1);
        while (w / pitch) * (h / pitch) > params.max_samples && 2 * pitch <= w.min(h) {
            pitch *= 2;
        }
        let camera = working.shrunk(pitch);
        (self.width, self.height) = (camera.width() as usize, camera.height() as usize);
        self.pitch = pitch as usize;
        self.spacing = 0.5 * (1.0 / camera.fx() + 1.0 / camera.fy());
        self.ray_x = (0..self.width).map(|x| (x as f32 - camera.cx()) / camera.fx()).collect();
        self.ray_y = (0..self.height).map(|y| (y as f32 - camera.cy()) / camera.fy()).collect();
        self.list = vec![Sample::default(); self.width * self.height];
        self.links = vec![0; self.list.len()];
        (self.camera, self.source) = (Some(camera), Some(*working));
    }

    /// Reads the segmented frame.
    pub(crate) fn take(&mut self, frame: &Frame, params: &Params) {
        let (w, pitch) = (self.width, self.pitch);
        let gate = Gate { frame, params, share: 1.0 / (pitch as f32).sqrt() };
        let (ray_x, ray_y) = (&self.ray_x, &self.ray_y);
        let band = BAND * w;
        (self.list.par_chunks_mut(band), self.links.par_chunks_mut(band))
            .into_par_iter()
            .enumerate()
            .for_each(|(b, (list, links))| {
                for (y, (list, links)) in list.chunks_exact_mut(w).zip(links.chunks_exact_mut(w)).enumerate()
                {
                    let y = b * BAND + y;
                    if pitch == 1 {
                        let own = y * w..(y + 1) * w;
                        links.copy_from_slice(&frame.links[own.clone()]);
                        list.iter_mut().zip(own).for_each(|(s, i)| *s = gate.sample(i));
                        continue;
                    }
                    for (x, (s, link)) in list.iter_mut().zip(links).enumerate() {
                        (*s, *link) = gate.block([x * pitch, y * pitch], pitch, [ray_x[x], ray_y[y], 1.0]);
                        // Links of the last blocks may lead to cut off pixels.
                        *link &= if x + 1 < w { RIGHT | DOWN } else { DOWN };
                        *link &= if y + 1 < self.height { RIGHT | DOWN } else { RIGHT };
                    }
                }
            });
        self.region_size.clear();
        if pitch == 1 {
            self.region_size.extend_from_slice(&frame.region_size);
        } else {
            self.region_size.resize(frame.region_size.len(), 0);
            self.list.iter().for_each(|s| self.region_size[s.region()] += 1);
        }
    }

    /// The smoothed point of a sample, camera frame.
    #[inline]
    pub(crate) fn point(&self, x: usize, y: usize) -> [f32; 3] {
        let z = self.list[y * self.width + x].smooth;
        [z * self.ray_x[x], z * self.ray_y[y], z]
    }
}

/// How pixels become samples.
struct Gate<'a> {
    frame: &'a Frame,
    params: &'a Params,
    /// Part of a pixel's sigma that a sample keeps.
    share: f32,
}

impl Gate<'_> {
    /// The sample of one working pixel.
    #[inline(always)]
    fn sample(&self, i: usize) -> Sample {
        let f = self.frame;
        let z = f.z[i];
        let edge = if f.edge[i] == 0 { 0 } else { EDGE };
        Sample {
            z,
            smooth: f.smooth[i],
            normal: f.normal(i),
            cos: f.cos[i],
            tolerance: self.params.gate_sigmas * (f.noise.sigma(z) * self.share) + self.params.pose_error,
            tag: f.label[i] | edge,
        }
    }

    /// The sample and the links of a block: what the first of its middle pixels knows that has a region, moved to the
    /// block's ray; where errors are independent, its depth is averaged over the pixels of the same region.
    fn block(&self, [x, y]: [usize; 2], pitch: usize, ray: [f32; 3]) -> (Sample, u8) {
        let f = self.frame;
        let (low, high) = ((pitch - 1) / 2, pitch / 2);
        let places = [[high, high], [low, low], [low, high], [high, low]];
        let pixel = |[a, b]: [usize; 2]| (y + b) * f.width + x + a;
        let rank = |p: &[usize; 2]| {
            let i = pixel(*p);
            // What has a plane has a depth.
            if f.smooth[i] > 0.0 { 2 + u8::from(f.label[i] != 0) } else { u8::from(f.z[i] > 0.0) }
        };
        // The first of the best, mostly the first.
        let (mut best, mut most) = (places[0], rank(&places[0]));
        for place in &places[1..] {
            if most == 3 {
                break;
            }
            let rank = rank(place);
            (best, most) = if rank > most { (*place, rank) } else { (best, most) };
        }
        let i = pixel(best);
        let mut s = self.sample(i);
        if s.smooth > 0.0 {
            let own = [f.ray_x[x + best[0]], f.ray_y[y + best[1]], 1.0];
            let slant = dot(s.normal, own) / dot(s.normal, ray);
            let slant = if slant > 0.5 && slant < 2.0 { slant } else { 1.0 };
            s.smooth *= slant;
            if !f.noise.independent {
                s.z *= slant;
                return (s, self.links(pixel([high, high]), pitch));
            }
            let (mut sum, mut n) = (0.0, 0.0);
            for row in y..y + pitch {
                for j in row * f.width + x..row * f.width + x + pitch {
                    let same = f.smooth[j] > 0.0 && f.label[j] == f.label[i];
                    sum += if same { f.z[j] - f.smooth[j] } else { 0.0 };
                    n += if same { 1.0 } else { 0.0 };
                }
            }
            s.z = s.smooth + sum / n;
        }
        (s, self.links(pixel([high, high]), pitch))
    }

    /// Whether all links from the middle of a block to that of its neighbours are unbroken.
    fn links(&self, middle: usize, pitch: usize) -> u8 {
        let f = self.frame;
        let right = (middle..middle + pitch).all(|i| f.links.get(i).is_some_and(|l| l & RIGHT != 0));
        let down = (0..pitch).all(|k| f.links.get(middle + k * f.width).is_some_and(|l| l & DOWN != 0));
        (if right { RIGHT } else { 0 }) | (if down { DOWN } else { 0 })
    }
}
