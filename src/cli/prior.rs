//! `satgs prior`: maps of depths or normals of all images of a perspective scene.

use super::perspective_args::ImageArgs;
use super::{CliError, Ui};
use crate::pipeline::{PriorMapOptions, PriorMapSummary, prior_maps};
use crate::prior::{DepthKind, PriorCommand, PriorContent, PriorMaker};
use std::path::PathBuf;

/// Make depth or normal maps of the images of a perspective scene, with a network, a command or matching
///
/// Training takes the folder as `--depth-prior DIR` or `--normal-prior DIR`. It holds NAME.npy for
/// each image, prior.json and made_from.json. The same command keeps the maps that are there: it
/// continues after an interruption, and makes only the maps of new images.
///
/// --model takes an ONNX file such as Depth Anything V2: the input is f32 [1, 3, rows, columns];
/// the first output is f32 [1, rows, columns] or [1, 1, rows, columns] for depths, and
/// [1, 3, rows, columns] or [1, rows, columns, 3] for normals. Images are resized to the input, and
/// maps to the proportions of the image.
///
/// --command is called for each image, for at most 600 s. {image} stands for the image, {out} for
/// the file to write, NAME.npy; {out}.png and {out}.tif are pictures. It is split into words as a
/// shell does, but no shell runs it: pipes need `sh -c 'depth "$0" > "$1"' {image} {out}`.
///
/// --stereo matches the images with each other at their poses, and needs no network: depths in the
/// unit of the scene, with holes where views do not agree. Training does the same if it needs depths
/// and has no others. Held-back views (--test-views) are not used and get no map.
///
///   satgs prior kitchen -o depths --stereo
///   satgs prior kitchen -o depths --model depth_anything_v2_vits.onnx --kind disparity
///   satgs prior kitchen -o depths --command 'python3 depth.py {image} {out}'
///   satgs prior kitchen -o normals --normals --command 'python3 normals.py {image} {out}.png'
///   satgs run kitchen -o run --recipe indoor --depth-prior depths --normal-prior normals
#[derive(clap::Args, Clone, Debug)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// The scene: a COLMAP project, transforms.json, RGB-D frames, LEVIR-NVS, ScanNet++
    scene: PathBuf,
    /// Folder of the maps
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    maker: Maker,
    #[command(flatten)]
    images: ImageArgs,
    /// Make normal maps, in camera axes (right, down, forward) with any signs [default: depth maps]
    #[arg(long)]
    normals: bool,
    /// What the values of depth maps are, for prior.json [default: training estimates it from the points of the scene]
    #[arg(long, value_name = "KIND", value_parser = super::named(&DepthKind::STATED), conflicts_with = "normals")]
    kind: Option<DepthKind>,
    /// Make all maps again. By default maps from another network or command are an error
    #[arg(long)]
    overwrite: bool,
}

/// What makes the maps.
#[derive(clap::Args, Clone, Debug)]
#[group(required = true, multiple = false)]
struct Maker {
    /// Network that estimates a map from an image
    #[arg(long, value_name = "FILE.onnx")]
    model: Option<PathBuf>,
    /// Command that writes the map {out} of the image {image}
    #[arg(long, value_name = "CMD", value_parser = PriorCommand::parse)]
    command: Option<PriorCommand>,
    /// Match the images with each other at their poses: depths in the unit of the scene
    #[arg(long)]
    stereo: bool,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let Maker { model, command, stereo } = &args.maker;
    let of_model = model.clone().map(PriorMaker::Network);
    let of_command = command.clone().map(PriorMaker::Command);
    let Some(maker) = of_model.or(of_command).or(stereo.then_some(PriorMaker::Stereo)) else {
        return Ok(());
    };
    let options = PriorMapOptions {
        scene: args.images.options(),
        content: if args.normals { PriorContent::Normals } else { PriorContent::Depths },
        kind: args.kind,
        overwrite: args.overwrite,
    };
    let summary = prior_maps(&args.scene, &maker, &args.output, &options, ui)?;
    ui.summary("prior", Some(&text(&summary)), &summary)
}

fn text(s: &PriorMapSummary) -> String {
    let left_out = if s.maps.left_out > 0 {
        format!(", {} images without a map", s.maps.left_out)
    } else {
        String::new()
    };
    format!("{}: {} maps made, {} kept{left_out}", s.output.display(), s.maps.made, s.maps.kept)
}
