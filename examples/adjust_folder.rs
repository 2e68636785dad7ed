//! Corrects the RPC cameras of a folder of images by bundle adjustment.
//!
//! `cargo run --release --example adjust_folder -- SCENE RUN`, or without arguments on `data/town`.

#![allow(clippy::print_stdout)]

use satgs::pipeline::{AdjustOptions, adjust};
use satgs::progress::{Event, Progress};
use satgs::scene::{self, ReadOptions};
use std::path::PathBuf;

mod town;

/// Prints the steps of the work; `is_cancelled` could ask it to stop.
struct Print;

impl Progress for Print {
    fn event(&self, event: Event) {
        match event {
            Event::Started { stage, .. } => println!("{stage} ..."),
            Event::Warning(text) | Event::Note(text) => println!("{text}"),
            _ => {}
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    run(&std::env::args().skip(1).map(PathBuf::from).collect::<Vec<_>>())
}

/// The example; `arguments` are those of the command line.
pub fn run(arguments: &[PathBuf]) -> Result<(), Box<dyn std::error::Error>> {
    let town = town::Town::new()?;
    let [folder, run] = match arguments {
        [scene, run] => [scene.clone(), run.clone()],
        _ => [town.scene(), town.run()],
    };
    let scene = scene::read(&folder, &ReadOptions::default())?;
    let adjusted = adjust(&scene, &AdjustOptions::default(), &run, &Print)?;
    print!("{}", adjusted.report.table());
    println!("corrected cameras: {}", run.join("ba/rpcs").display());
    Ok(())
}
