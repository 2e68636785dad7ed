//! `satgs learn`: trains the network that predicts splats from points.

use super::{CliError, Ui, ending};
use crate::predict::learn::{LearnConfig, LearnLine, Validation, learn};
use crate::predict::{Model, write_onnx};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Train the network by which `satgs predict` makes splats from points, on simulated towns
///
/// Towns are simulated one after the other; points are drawn from their exact surfaces with the errors, holes and outliers of
/// stereo matching, and thinned to 1 to 100 %. The network learns to predict splats whose renders agree with images that it does
/// not see. Beside OUT.safetensors, the folder OUT.learn gets learn.csv (a line for each round; scores of towns that are not
/// learned from in dB, of the network and of untrained splats on the same points), curves.svg, the same scores by the part of the
/// points (points.csv, points.svg), a checkpoint, and the towns
/// (about 7 MB each; may be removed afterwards). An interrupted training goes on with the same command, and gives the same model.
///
///   satgs learn --print-config > learn.toml
///   satgs learn model.safetensors --config learn.toml
///   satgs predict run --model model.safetensors -o predicted
#[derive(clap::Args, Clone, Debug)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// The model to write; with --from also an ONNX file
    #[arg(value_name = "OUT", value_parser = ending(&["safetensors", "onnx"]), required_unless_present = "print_config")]
    out: Option<PathBuf>,
    /// Do not train, but write this model (`built-in` for the one that comes with satgs) as OUT: an ONNX file for other programs, or
    /// as the example of what `satgs predict --model FILE.onnx` takes
    #[arg(long, value_name = "FILE.safetensors|built-in", conflicts_with = "config")]
    from: Option<PathBuf>,
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
    if let Some(from) = &args.from {
        return convert(from, out, ui);
    }
    if out.extension().is_some_and(|e| e.eq_ignore_ascii_case("onnx")) {
        let hint = "train OUT.safetensors, then write it with --from OUT.safetensors";
        return Err(CliError::input("an ONNX file can only be written with --from", hint));
    }
    let log = learn(out, &out.with_extension("learn"), &config, ui)?;
    let validation = log.iter().rev().find_map(|line: &LearnLine| line.validation);
    let summary = Summary { model: out.clone(), rounds: log.len(), validation };
    ui.summary("learn", Some(&text(&summary)), &summary)
}

/// Writes a model in another format.
fn convert(from: &Path, out: &Path, ui: &Ui) -> Result<(), CliError> {
    let model = if from == Path::new("built-in") { Model::built_in()? } else { Model::read(from)? };
    if out.extension().is_some_and(|e| e.eq_ignore_ascii_case("onnx")) {
        write_onnx(&model, out)?;
    } else {
        model.write(out)?;
    }
    let text = format!("{}: {} parameters", out.display(), model.parameters.len());
    ui.summary("learn", Some(&text), &model.content)
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
