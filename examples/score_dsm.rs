//! Scores a surface model against lidar or another truth.
//!
//! `cargo run --release --example score_dsm -- DSM TRUTH`, or without arguments on `data/town`.

#![allow(clippy::print_stdout)]

use satgs::metrics::Method;
use satgs::pipeline::{EvaluateOptions, evaluate};
use satgs::progress::NoProgress;
use std::path::PathBuf;

mod town;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    run(&std::env::args().skip(1).map(PathBuf::from).collect::<Vec<_>>())
}

/// The example; `arguments` are those of the command line.
pub fn run(arguments: &[PathBuf]) -> Result<(), Box<dyn std::error::Error>> {
    let town = town::Town::new()?;
    let [dsm, truth] = match arguments {
        [dsm, truth] => [dsm.clone(), truth.clone()],
        _ => [town.trained()?.join("dsm.tif"), town.truth()],
    };
    let evaluation = evaluate(&dsm, &truth, &EvaluateOptions::default(), None, &NoProgress)?;
    if let Some(best) = evaluation.registered_scores(Method::Xyz) {
        println!(
            "registered by {:.2} m east, {:.2} m north, {:.2} m up: MAE {:.2} m",
            best.east_m, best.north_m, best.registration.dz_m, best.scores.mae_m
        );
    }
    Ok(())
}
