//! `satgs learn`: trains the network that predicts splats from points.

use super::perspective_args::ImageArgs;
use super::{CliError, Ui, ending};
use crate::predict::learn::{
    LearnConfig, LearnLine, PhotographedScenes, Validation, learn, learn_from_photographs,
};
use crate::predict::{ImageNetwork, Model, write_onnx};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Train the network with which `satgs predict` makes splats from points
///
/// Simulates one town after the other. Points are drawn from its exact surface with the errors, holes
/// and outliers of stereo matching, and thinned to 1 to 100 %. The network learns to predict splats
/// whose renderings agree with images that are not its input. With --scenes a model is trained
/// further, on points from the depth maps of photographs.
///
/// The folder OUT.learn beside OUT.safetensors gets a line for each round (learn.csv), scores on
/// validation towns (curves.svg), scores by the share of points that was kept (points.csv,
/// points.svg), a checkpoint, and the towns (7 MB each; you may remove them afterwards). After an
/// interruption the same command continues and gives the same model.
///
///   satgs learn --print-config > learn.toml
///   satgs learn model.safetensors --config learn.toml
///   satgs predict run --model model.safetensors -o predicted
///   satgs learn rooms.safetensors --scenes office kitchen --downsampling 2
#[derive(clap::Args, Clone, Debug)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// The model to write; with --from also an ONNX file
    #[arg(value_name = "OUT", value_parser = ending(&["safetensors", "onnx"]), required_unless_present = "print_config")]
    out: Option<PathBuf>,
    /// Model to start from: a file, or `built-in`, the one that comes with satgs
    ///
    /// With --scenes this model is trained further [default: built-in]. Without --scenes it is only converted to OUT, for example to
    /// ONNX for other programs; `satgs predict --model FILE.onnx` takes networks of the same form.
    #[arg(long, value_name = "FILE.safetensors|built-in")]
    from: Option<PathBuf>,
    /// Train a model further on these photographs with depth maps (RGB-D, LEVIR-NVS, ScanNet++)
    #[arg(long, value_name = "SCENE", num_args = 1..)]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    images: ImageArgs,
    /// ONNX network of image features, such as DINOv2, as further input of the model
    ///
    /// Input is an image of any or of a fixed square size, output a vector for each patch. `satgs predict` needs the same file. With
    /// --scenes: the file that the model was trained with.
    #[arg(long, value_name = "FILE.onnx")]
    image_features: Option<PathBuf>,
    /// Numbers of towns, rounds and steps, learning rate, sizes of the network; defaults are those of --print-config
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Print the default configuration (with --scenes: of further training) and exit
    #[arg(long, conflicts_with_all = ["out", "from", "config"])]
    print_config: bool,
}

/// Name of the model that comes with satgs.
const BUILT_IN: &str = "built-in";

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
    let is_further = !args.scenes.is_empty();
    let mut config = if is_further { LearnConfig::of_photographs() } else { LearnConfig::default() };
    if let Some(path) = &args.config {
        config = config.with_file(path)?;
    }
    let Some(out) = &args.out else {
        return ui.summary("learn", Some(&config.to_toml()), &config);
    };
    if !is_further {
        let given = [args.images.test_views.is_some(), args.images.downsampling.is_some()];
        if given.contains(&true) {
            let hint = "towns are simulated: --scenes trains on photographs";
            return Err(CliError::input("--test-views and --downsampling are for --scenes", hint));
        }
        if let Some(from) = &args.from {
            if args.config.is_some() || args.image_features.is_some() {
                let hint =
                    "without --from a model is trained, with --scenes that of --from is trained further";
                return Err(CliError::input("--from only writes a model: it takes no other options", hint));
            }
            return convert(from, out, ui);
        }
    }
    if out.extension().is_some_and(|e| e.eq_ignore_ascii_case("onnx")) {
        let hint = "train OUT.safetensors, then write it with --from OUT.safetensors";
        return Err(CliError::input("an ONNX file can only be written with --from", hint));
    }
    let folder = out.with_extension("learn");
    let image_network = args.image_features.as_deref().map(ImageNetwork::load).transpose()?;
    let image_network = image_network.as_ref();
    let log = if is_further {
        let model = read(args.from.as_deref().unwrap_or(Path::new(BUILT_IN)))?;
        // A wrong file is refused before all images are read.
        model.content.require(image_network.map(ImageNetwork::id))?;
        let scenes = PhotographedScenes::read(&args.scenes, &args.images.options(), image_network, ui)?;
        learn_from_photographs(out, &folder, model, &scenes, &config, ui)?
    } else {
        learn(out, &folder, &config, image_network, ui)?
    };
    let validation = log.iter().rev().find_map(|line: &LearnLine| line.validation);
    let summary = Summary { model: out.clone(), rounds: log.len(), validation };
    ui.summary("learn", Some(&text(&summary)), &summary)
}

/// The model that is called by this name, or in a file.
fn read(from: &Path) -> Result<Model, CliError> {
    Ok(if from == Path::new(BUILT_IN) { Model::built_in()? } else { Model::read(from)? })
}

/// Writes a model in another format.
fn convert(from: &Path, out: &Path, ui: &Ui) -> Result<(), CliError> {
    let model = read(from)?;
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
            "\nvalidation: {:.2} dB (isotropic splats {:.2}, flat ones {:.2})\n5 % of the points: {:.2} dB ({:.2}, {:.2})",
            dense[0], dense[1], dense[2], sparse[0], sparse[1], sparse[2],
        )
    });
    format!("{}: {} rounds{scores}", s.model.display(), s.rounds)
}
