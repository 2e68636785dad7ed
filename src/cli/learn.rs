//! `satgs learn`: trains the network that predicts splats from points.

use super::{CliError, Ui, ending};
use crate::predict::learn::{LearnConfig, LearnLine, Validation, learn};
use serde::Serialize;
use std::path::PathBuf;

/// Train the network by which `satgs predict` makes splats from points, on simulated towns
///
/// Towns are simulated one after the other; points are drawn from their exact surfaces with the errors, holes and outliers of
/// stereo matching, and thinned to 1 to 100 %. The network learns to predict splats whose renders agree with images that it does
/// not see. Beside OUT.safetensors, the folder OUT.learn gets learn.csv (a line for each round; scores of towns that are not
/// learned from in dB, of the network and of untrained splats on the same points), curves.svg, the same scores by the part of the
/// points (points.csv, points.svg), a checkpoint, and the towns
/// (about 5 MB each; may be removed afterwards). An interrupted training goes on with the same command, and gives the same model.
///
///   satgs learn --print-config > learn.toml
///   satgs learn model.safetensors --config learn.toml
///   satgs predict run --model model.safetensors -o predicted
#[derive(clap::Args, Clone, Debug)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// The model to write
    #[arg(value_name = "OUT.safetensors", value_parser = ending(&["safetensors"]), required_unless_present = "print_config")]
    out: Option<PathBuf>,
    /// Numbers of towns, rounds and steps, learning rate, sizes of the network; what is absent is as in --print-config
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Print the configuration of the model that comes with satgs and exit
    #[arg(long, exclusive = true)]
    print_config: bool,
}

/// What the command prints.
#[derive(Serialize)]
struct Summary {
    model: PathBuf,
    rounds: usize,
    /// Scores of the last round.
    validation: Option<Validation>,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let config = match &args.config {
        Some(path) => LearnConfig::read(path)?,
        None => LearnConfig::default(),
    };
    let Some(out) = &args.out else {
        return ui.summary("learn", Some(&config.to_toml()), &config);
    };
    let log = learn(out, &out.with_extension("learn"), &config, ui)?;
    let validation = log.iter().rev().find_map(|line: &LearnLine| line.validation);
    let summary = Summary { model: out.clone(), rounds: log.len(), validation };
    ui.summary("learn", Some(&text(&summary)), &summary)
}

fn text(s: &Summary) -> String {
    let scores = s.validation.map_or_else(String::new, |Validation { dense, sparse }| {
        format!(
            "\nunseen towns: {:.2} dB (isotropic splats {:.2}, flat ones {:.2})\n5 % of the points: {:.2} dB ({:.2}, {:.2})",
            dense[0], dense[1], dense[2], sparse[0], sparse[1], sparse[2],
        )
    });
    format!("{}: {} rounds{scores}", s.model.display(), s.rounds)
}
