//! Renders an animation of a trained run: the camera turns around the scene.
//!
//! `cargo run --release --example fly_through -- RUN OUT.png`, or without arguments, and with 3 frames only, on
//! `data/town`.

#![allow(clippy::print_stdout)]

use satgs::pipeline::{RenderOptions, Viewpoint, render};
use satgs::progress::NoProgress;
use std::path::PathBuf;

mod town;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    run(&std::env::args().skip(1).map(PathBuf::from).collect::<Vec<_>>())
}

/// The example; `arguments` are those of the command line.
pub fn run(arguments: &[PathBuf]) -> Result<(), Box<dyn std::error::Error>> {
    let town = town::Town::new()?;
    let (run, output, frames) = match arguments {
        [run, output] => (run.clone(), output.clone(), 90),
        _ => (town.trained()?, town.run().join("orbit.png"), 3),
    };
    // Azimuth clockwise from north and angle off nadir, degrees.
    let viewpoint = Viewpoint::Direction { from_deg: [0.0, 30.0], to_deg: Some([360.0, 30.0]), size: None };
    let options = RenderOptions { viewpoint, frames: Some(frames), ..RenderOptions::default() };
    let rendered = render(&run, &output, &options, &NoProgress)?;
    println!("{} frames beside {}", rendered.frames, rendered.output.display());
    Ok(())
}
