//! Trains splats on a folder of images and writes a surface model.
//!
//! `cargo run --release --example train_dsm -- SCENE RUN`, or without arguments, and for 20 iterations only, on
//! `data/town`. The same call continues an interrupted training.

#![allow(clippy::print_stdout)]

use satgs::pipeline::{AdjustOptions, DsmOptions, TrainOptions, adjust, dsm, train};
use satgs::progress::NoProgress;
use satgs::scene::{self, ReadOptions};
use std::path::PathBuf;

mod town;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    run(&std::env::args().skip(1).map(PathBuf::from).collect::<Vec<_>>())
}

/// The example; `arguments` are those of the command line.
pub fn run(arguments: &[PathBuf]) -> Result<(), Box<dyn std::error::Error>> {
    let town = town::Town::new()?;
    let (folder, run, training) = match arguments {
        [scene, run] => (scene.clone(), run.clone(), TrainOptions::default()),
        _ => (town.scene(), town.run(), town::brief()),
    };
    let scene = scene::read(&folder, &ReadOptions::default())?;
    adjust(&scene, &AdjustOptions::default(), &run, &NoProgress)?;
    let trained = train(&run, &training, &NoProgress)?;
    if let Some(figures) = trained.summary() {
        println!("{} splats after {} iterations", figures.splats, figures.iterations);
    }
    let options = DsmOptions { vertical: Some("EGM96".into()), ..DsmOptions::default() };
    if let Some(surface) = dsm(&run, &options, &NoProgress)?.summary() {
        println!(
            "{} x {} cells, heights above {}",
            surface.grid.width, surface.grid.height, surface.vertical
        );
    }
    println!("{}", run.join("dsm.tif").display());
    Ok(())
}
