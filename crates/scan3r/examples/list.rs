//! Lists the frames of a recording: `cargo run -p scan3r --example list -- DIR`

#![allow(clippy::print_stdout, reason = "an example prints")]

use scan3r::Recording;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let dir = std::env::args().nth(1).ok_or("want the folder of a recording")?;
    let recording = Recording::open(dir.as_ref(), None)?;
    println!("{}, {} frames", recording.format().name(), recording.len());
    for frame in recording.into_frames() {
        let f = frame?;
        let valid = f.depth.iter().filter(|z| **z > 0.0).count();
        println!(
            "{} at {:.2} s: {valid} of {} pixels, pose {}",
            f.index,
            f.time,
            f.depth.len(),
            f.world_from_camera.is_some()
        );
    }
    Ok(())
}
