//! One robot in an analytic room: depth frames in, scene graph out:
//! `cargo run -p agent --example one_visit`

#![allow(clippy::print_stdout, reason = "an example prints")]

use agent::{GraphParams, Robot, RobotParams};
use graph_align::Vocabulary;
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use scan3r::{Frame, Intrinsics};
use sgfn_infer::Model;

const WEIGHTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/weights/sgfn-l20.safetensors");
const FRAMES: u32 = 60;

/// An axis-aligned box by its corners, metres, z up.
type Block = ([f32; 3], [f32; 3]);

/// Seen from within.
const ROOM: Block = ([0.0, 0.0, 0.0], [4.0, 3.5, 2.5]);
/// Seen from outside: a bed-sized block, a cabinet along a wall.
const THINGS: [Block; 2] = [([0.0, 0.0, 0.0], [2.0, 1.6, 0.5]), ([2.8, 3.0, 0.0], [3.8, 3.5, 1.8])];

/// Ray parameters at which a line enters and leaves a box; no hit if the first is the larger one.
fn slab((lo, hi): Block, o: &Point3<f32>, d: &Vector3<f32>) -> (f32, f32) {
    (0..3).fold((f32::NEG_INFINITY, f32::INFINITY), |(near, far), k| {
        let (a, b) = ((lo[k] - o[k]) / d[k], (hi[k] - o[k]) / d[k]);
        (near.max(a.min(b)), far.min(a.max(b)))
    })
}

/// Camera x right, y down, z forward, in a world whose z is up.
fn looking(from: [f32; 3], yaw: f32, down: f32) -> Isometry3<f32> {
    let forward = Vector3::new(yaw.cos() * down.cos(), yaw.sin() * down.cos(), -down.sin());
    let right = Vector3::new(yaw.sin(), -yaw.cos(), 0.0);
    let axes = Rotation3::from_basis_unchecked(&[right, forward.cross(&right), forward]);
    Isometry3::from_parts(Translation3::from(from), UnitQuaternion::from_rotation_matrix(&axes))
}

/// Frame `index` of a robot that turns once in the middle of the room, with depth in whole millimetres.
fn frame(index: u32, k: Intrinsics) -> Frame {
    let turn = index as f32 / FRAMES as f32 * std::f32::consts::TAU;
    let pose = looking([2.3 + 0.2 * turn.cos(), 2.0 + 0.2 * turn.sin(), 1.4], turn, 0.45);
    let origin = Point3::from(pose.translation.vector);
    let depth = (0..k.width * k.height).map(|i| {
        let ray = k.unproject((i % k.width) as f32, (i / k.width) as f32, 1.0);
        let d = pose.rotation * ray.coords;
        // The ray's z is 1 in the camera, so its parameter is the depth.
        let hits =
            THINGS.iter().map(|b| slab(*b, &origin, &d)).filter(|(near, far)| *near > 0.0 && near <= far);
        let z = hits.map(|h| h.0).fold(slab(ROOM, &origin, &d).1, f32::min);
        (z * 1000.0).round() / 1000.0
    });
    Frame {
        index,
        time: f64::from(index) / 5.0,
        depth: depth.collect(),
        intrinsics: k,
        world_from_camera: Some(pose),
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let model = Model::from_safetensors(&std::fs::read(WEIGHTS)?)?;
    let params = RobotParams {
        segmentation: gsm::Params {
            noise: gsm::NoiseModel::of(gsm::Profile::Ideal),
            ..gsm::Params::default()
        },
        graph: GraphParams { min_class: 0.3, ..GraphParams::default() },
        ..RobotParams::default()
    };
    let mut robot = Robot::new(&model, params)?;
    let intrinsics = Intrinsics::new(110.0, 110.0, 79.5, 59.5, 160, 120)?;
    for index in 0..FRAMES {
        let report = robot.segment(&frame(index, intrinsics));
        if let Some(why) = report.skipped {
            println!("frame {index} skipped: {why:?}");
        }
        // The network runs now and then, on the segments that changed.
        if robot.inference_is_due() {
            robot.infer()?;
            println!("frame {index}: {} surfels, {} segments", report.counts.surfels, report.counts.segments);
        }
    }
    robot.infer()?;

    let mut vocabulary = Vocabulary::default();
    let (graph, instances) = robot.graph(&mut vocabulary)?;
    println!(
        "{} objects made of {} segments, {} relations",
        graph.len(),
        instances.len(),
        graph.edges().len()
    );
    for n in graph.nodes() {
        let (c, e) = (n.bounds.centroid(), n.bounds.extent());
        println!(
            "{} {} ({:.2}): centre {:.1} {:.1} {:.1}, size {:.1} {:.1} {:.1}",
            n.id.0,
            vocabulary.label_name(n.label),
            n.score,
            c.x,
            c.y,
            c.z,
            e.x,
            e.y,
            e.z
        );
    }
    for e in graph.edges() {
        println!("{} {} {} ({:.2})", e.s.0, vocabulary.predicate_name(e.p), e.t.0, e.score);
    }
    Ok(())
}
