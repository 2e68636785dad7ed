//! `satgs predict`: splats from points in one pass.

use super::scene_kind::SceneKind;
use super::{CliError, PerspectiveArgs, Ui, ending};
use crate::perspective::PerspectiveScene;
use crate::pipeline::{POINT_ENDINGS, PerspectiveManifest, PredictOptions, Predicted, Untrained, predict};
use crate::run_files::SCENE;
use std::path::PathBuf;

/// Predict splats from points in one pass, in seconds instead of minutes of training (Point2GS)
///
/// Takes the cameras of RUN (adjusted or trained) and points of any source. Writes the run folder RUN2, on which `dsm`,
/// `render`, `nvs-eval`, `mesh` and `view` work; `train` continues from its splats. Photographs need no adjustment: give the
/// scene itself instead of RUN.
///
/// Points within half a metre are merged and outliers removed; the command prints how many. A network then predicts splats from
/// the surrounding points and the images: one every half metre of the surface and of walls between neighbouring heights (for
/// photographs, every third of the distance between points). It was trained on simulated towns; `satgs learn` trains others. For
/// photographs the default is flat splats without a network; --model names one.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Examples:
  satgs ba scene -o run && satgs predict run --points dsm.tif -o fast && satgs dsm fast
  satgs predict run --points lidar.laz -o fast && satgs train fast --iterations 500")]
pub struct Args {
    /// Run folder with adjusted cameras, or a perspective scene (COLMAP, transforms.json, RGB-D, LEVIR-NVS, ScanNet++) or its run
    #[arg(value_name = "RUN|SCENE")]
    run: PathBuf,
    /// Run folder to write
    #[arg(short, long, value_name = "RUN2")]
    output: PathBuf,
    /// Points: a cloud (.laz, .las, .ply) or a surface model (.tif), in any map projection in metres
    ///
    /// Heights are above the ellipsoid unless the file states another reference. Coordinates of a .ply are relative to the origin in
    /// NAME.georef.json beside it, else map coordinates of the scene [default: the matched surface of a training of RUN, else its
    /// sparse points; for photographs the points of the scene, else those of its depth maps].
    #[arg(long, value_name = "FILE", value_parser = ending(&POINT_ENDINGS))]
    points: Option<PathBuf>,
    /// Do not move the points onto the tie points
    ///
    /// By default points of satellite scenes are moved, because an adjusted run may be off by some metres; the command prints by how
    /// much. Points far from those of the scene are refused.
    #[arg(long, requires = "points")]
    keep_place: bool,
    /// Model of `satgs learn`, or an ONNX network of your own
    ///
    /// The network must have the inputs and the output of `satgs learn OUT.onnx --from built-in` [default: the model that comes with
    /// satgs; for photographs none].
    #[arg(long, value_name = "FILE.safetensors|FILE.onnx")]
    model: Option<PathBuf>,
    /// ONNX network of image features (such as DINOv2) that the model was trained with (`satgs learn --image-features`)
    #[arg(long, value_name = "FILE.onnx", requires = "model")]
    image_features: Option<PathBuf>,
    /// Make a splat of each point without a network, for comparison: isotropic, or flat along the surface
    #[arg(long, value_name = "KIND", conflicts_with = "model")]
    without_network: Option<Kind>,
    #[command(flatten)]
    perspective: PerspectiveArgs,
    /// Replace a prediction in RUN2 of other points or of another model
    #[arg(long)]
    overwrite: bool,
}

/// Splats without a network.
#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum Kind {
    Isotropic,
    Flat,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let is_scene = PerspectiveScene::is_one(&args.run) && !args.run.join(SCENE).exists();
    let is_of_photographs = is_scene || PerspectiveManifest::read(&args.run).is_ok();
    let kind = if is_of_photographs { SceneKind::Photographs } else { SceneKind::Satellites };
    ui.given().require_of(kind, &args.run)?;
    if !is_scene {
        // How a scene is read is settled in a run of it.
        ui.given().require_of(SceneKind::Satellites, &args.run)?;
    }
    let options = PredictOptions {
        points: args.points.clone(),
        model: args.model.clone(),
        image_features: args.image_features.clone(),
        without_network: args.without_network.map(|kind| match kind {
            Kind::Isotropic => Untrained::Isotropic,
            Kind::Flat => Untrained::Flat,
        }),
        keeps_place: args.keep_place,
        perspective: args.perspective.options(),
        overwrite: args.overwrite,
    };
    let outcome = predict(&args.run, &args.output, &options, ui)?;
    ui.outcome("predict", &outcome, |summary| text(args, summary))
}

fn text(args: &Args, s: &Predicted) -> String {
    let cleaned = &s.clean_up;
    format!(
        "{}: {} splats in {:.1} s from {} points of {} ({} after merging, {:.1} % dropped, {:.2} m apart)",
        args.output.display(),
        s.splats,
        s.seconds,
        cleaned.given,
        s.points,
        cleaned.merged,
        100.0 * cleaned.dropped_share(),
        s.spacing_m,
    )
}
