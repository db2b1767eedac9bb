//! From a clean image to what a hand-held time-of-flight camera delivers.

use crate::render::{Image, Scene};
use crate::rng::Draw;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use scan3r::Intrinsics;
use std::sync::LazyLock;

/// The sensor's faults. Lengths in metres, angles in radians, shares from 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorParams {
    /// Standard deviation of depth at 1 m and its growth per metre.
    pub sigma: [f32; 2],
    /// Depths outside are not measured; beyond the second they fade over 0.8 m.
    pub range: [f32; 2],
    /// Share of pixels at a depth edge that fly between the two depths.
    pub flying: f32,
    /// Share of pixels at a depth edge that are lost.
    pub edge_loss: f32,
    /// Scale of the loss on dark, far and grazing surfaces.
    pub loss: f32,
    /// Standard deviation of the pose error per frame: translation and rotation.
    pub jitter: [f32; 2],
    /// Step of the random walk of the pose per frame: translation and rotation.
    pub drift: [f32; 2],
    /// Probability that a run of frames without pose begins at a frame.
    pub pose_loss: f32,
    /// Depth is rounded to millimetres, as files store it.
    pub quantise: bool,
}

impl Default for SensorParams {
    /// The phone of 3RScan.
    fn default() -> Self {
        Self {
            sigma: [0.005, 0.003],
            range: [0.35, 4.2],
            flying: 0.3,
            edge_loss: 0.3,
            loss: 1.0,
            jitter: [0.0015, 0.0012],
            drift: [0.0006, 0.0003],
            pose_loss: 0.004,
            quantise: true,
        }
    }
}

impl SensorParams {
    /// No faults at all: exact depth up to 20 m, exact poses.
    #[must_use]
    pub fn clean() -> Self {
        Self {
            sigma: [0.0; 2],
            range: [0.0, 20.0],
            flying: 0.0,
            edge_loss: 0.0,
            loss: 0.0,
            jitter: [0.0; 2],
            drift: [0.0; 2],
            pose_loss: 0.0,
            quantise: false,
        }
    }

    fn is_clean(&self) -> bool {
        self.sigma == [0.0; 2] && self.loss == 0.0 && self.flying == 0.0 && self.edge_loss == 0.0
    }
}

/// 4096 quantiles of the standard normal, as the sum of twelve uniforms draws them.
static NORMAL: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let mut draw = Draw::new(0, "normal table", &[]);
    (0..4096).map(|_| draw.normal()).collect()
});

/// Side of the blocks over which losses are correlated, pixels.
const BLOCK: usize = 4;

/// Turns clean images into measured ones.
pub(crate) struct Sensor {
    params: SensorParams,
    intrinsics: Intrinsics,
    /// Viewing ray (x, y, 1): x per column, y per row, its length per pixel.
    columns: Vec<f32>,
    rows: Vec<f32>,
    lengths: Vec<f32>,
    bytes: Vec<u8>,
    blocks: Vec<u8>,
    normal: &'static [f32],
}

impl Sensor {
    pub(crate) fn new(params: SensorParams, k: Intrinsics) -> Self {
        let columns: Vec<f32> = (0..k.width).map(|u| (u as f32 - k.cx) / k.fx).collect();
        let rows: Vec<f32> = (0..k.height).map(|v| (v as f32 - k.cy) / k.fy).collect();
        let lengths =
            rows.iter().flat_map(|y| columns.iter().map(move |x| (x * x + y * y + 1.0).sqrt())).collect();
        let blocks = (k.width as usize / BLOCK + 1) * (k.height as usize / BLOCK + 1);
        Self {
            params,
            intrinsics: k,
            columns,
            rows,
            lengths,
            bytes: vec![0; k.len() * 4],
            blocks: vec![0; blocks],
            normal: &NORMAL,
        }
    }

    /// The measured depth, metres.
    pub(crate) fn measure(&mut self, image: &Image, scene: &Scene, draw: &mut Draw) -> Vec<f32> {
        if self.params.is_clean() {
            return self.clean(image);
        }
        draw.fill(&mut self.bytes);
        draw.fill(&mut self.blocks);
        let bias = 1.0 + 0.0015 * draw.normal();
        let w = self.intrinsics.width as usize;
        let mut out = vec![0.0; self.intrinsics.len()];
        for (v, row) in out.chunks_exact_mut(w).enumerate() {
            self.row(image, scene, v, bias, row);
        }
        out
    }

    /// One row of the image.
    fn row(&self, image: &Image, scene: &Scene, v: usize, bias: f32, out: &mut [f32]) {
        let w = out.len();
        let span = v * w..(v + 1) * w;
        let (inverse, triangles) = (&image.inverse[span.clone()], &image.triangle[span.clone()]);
        let (words, lengths) = (&self.bytes[4 * v * w..4 * (v + 1) * w], &self.lengths[span]);
        let blocks = &self.blocks[v / BLOCK * (w / BLOCK + 1)..];
        let mut last = u32::MAX;
        // Albedo, and the plane that gives minus the cosine of incidence times the ray's length.
        let (mut albedo, mut slope, mut base) = (0.0, 0.0, 0.0);
        let pixels = inverse.iter().zip(triangles).zip(words.chunks_exact(4)).zip(lengths).zip(&self.columns);
        for (u, ((((&i, &t), bits), &length), &x)) in pixels.enumerate() {
            if i <= 0.0 {
                continue;
            }
            if last != t {
                let n = image.normals[t as usize];
                (albedo, slope, base) = (scene.surface(t).1, -n.x, -(n.y * self.rows[v] + n.z));
                last = t;
            }
            let z = 1.0 / i;
            let cosine = (base + slope * x) / length;
            let block = blocks[u / BLOCK];
            let Some(d) = self.pixel(z, z * length, cosine, albedo, bits, block) else { continue };
            let d = self.edge(image, u, v, d, bits[3]) * bias;
            out[u] = if self.params.quantise { (d * 1000.0 + 0.5) as u16 as f32 / 1000.0 } else { d };
        }
    }

    fn clean(&self, image: &Image) -> Vec<f32> {
        let [near, far] = self.params.range;
        image
            .inverse
            .iter()
            .map(|&i| if i > 0.0 { 1.0 / i } else { 0.0 })
            .map(|z| if z < near || z > far { 0.0 } else { z })
            .map(|z| if self.params.quantise { (z * 1000.0).round() / 1000.0 } else { z })
            .collect()
    }

    /// One pixel's depth with noise, unless too little light comes back.
    #[inline]
    fn pixel(&self, z: f32, range: f32, cosine: f32, albedo: f32, bits: &[u8], block: u8) -> Option<f32> {
        let p = &self.params;
        if range < p.range[0] || range > p.range[1] + 0.8 {
            return None;
        }
        // Light that comes back falls with the square of the distance and with the incidence.
        let light = albedo * (cosine + 0.05) / (0.25 + 0.25 * range * range);
        let dark = (0.2 - light).max(0.0) * 2.6
            + ((0.16 - cosine) * 3.0).max(0.0)
            + ((range - p.range[1]) * 1.25).max(0.0);
        let chance = f32::from(block) * 0.6 + f32::from(bits[2]) * 0.4;
        // Speckle: a little is always lost.
        if dark > 0.0 && chance < 255.0 * p.loss * dark || f32::from(bits[2]) < 3.0 * p.loss {
            return None;
        }
        let index = (usize::from(bits[0]) | usize::from(bits[1]) << 8) & 4095;
        let weak = 1.0 + (0.25 - light).max(0.0) * 3.0;
        Some(z + (p.sigma[0] + p.sigma[1] * (z - 1.0).max(0.0)) * weak * z.max(0.5) * self.normal[index])
    }

    /// At a depth edge a pixel flies, is lost, or holds. Steep surfaces are no edges.
    fn edge(&self, image: &Image, u: usize, v: usize, d: f32, bits: u8) -> f32 {
        let (w, h) = (self.intrinsics.width as usize, self.intrinsics.height as usize);
        let at = v * w + u;
        if u == 0 || v == 0 || u + 1 == w || v + 1 == h {
            return d;
        }
        let t = image.triangle[at];
        let near = [at - 1, at + 1, at - w, at + w];
        if near.iter().all(|&j| image.triangle[j] == t) {
            return d;
        }
        let own = image.inverse[at];
        let jump = |j: usize| {
            let i = image.inverse[j];
            image.triangle[j] != t && i > 0.0 && (i - own).abs() > 0.06 * own
        };
        let Some(j) = near.into_iter().find(|&j| jump(j)) else { return d };
        let roll = f32::from(bits) / 256.0;
        let p = &self.params;
        if roll < p.edge_loss {
            0.0
        } else if roll < p.edge_loss + p.flying {
            let s = 0.7 * (roll - p.edge_loss) / p.flying;
            d * (1.0 - s) + s / image.inverse[j]
        } else {
            d
        }
    }
}

/// The pose that the phone's tracking reports.
pub(crate) struct Tracker {
    params: SensorParams,
    drift: [Vector3<f32>; 2],
    lost: u32,
}

impl Tracker {
    pub(crate) fn new(params: SensorParams) -> Self {
        Self { params, drift: [Vector3::zeros(); 2], lost: 0 }
    }

    /// The reported pose of a true one; `None` while tracking is lost.
    pub(crate) fn report(&mut self, pose: &Isometry3<f32>, draw: &mut Draw) -> Option<Isometry3<f32>> {
        let p = &self.params;
        let mut noise = |sigma: f32| Vector3::new(draw.normal(), draw.normal(), draw.normal()) * sigma;
        // The walk is pulled back: tracking closes its loops.
        self.drift[0] = self.drift[0] * 0.98 + noise(p.drift[0]);
        self.drift[1] = self.drift[1] * 0.98 + noise(p.drift[1]);
        let (t, r) = (self.drift[0] + noise(p.jitter[0]), self.drift[1] + noise(p.jitter[1]));
        if self.lost > 0 {
            self.lost -= 1;
            return None;
        }
        if draw.chance(p.pose_loss) {
            self.lost = draw.below(4) as u32;
            return None;
        }
        if p.jitter == [0.0; 2] && p.drift == [0.0; 2] {
            return Some(*pose);
        }
        let rotation = UnitQuaternion::from_scaled_axis(r) * pose.rotation;
        Some(Isometry3::from_parts(Translation3::from(pose.translation.vector + t), rotation))
    }
}
