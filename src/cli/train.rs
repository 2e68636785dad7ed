//! `satgs train`: cameras, splats, training.

use super::{CliError, Ui};
use crate::pipeline::{Outcome, PerspectiveManifest, TrainOptions, Trained, train};
use crate::prior::{DepthKind, InpaintCommand, PriorSource, PriorSources};
use crate::run_files::SPLATS;
use crate::splat::primitive::PrimitiveKind;
use crate::splat::train::recipe::{Recipe, StartPoints};
use std::path::{Path, PathBuf};

/// Train Gaussian splats on an adjusted run: writes RUN/splats.ply and RUN/cameras.json
///
/// Fits quadratic cameras to the RPCs that `satgs ba` corrected, places the first splats and optimises them on the images,
/// with cast shadows. Splats start on a surface from multi-view stereo (recipe `best`), at the sparse points (`baeogs`),
/// or at random in the scene's volume (`eogs`). Views without a sun position are trained without shadows.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Run folder of `satgs ba`
    #[arg(required_unless_present = "print_recipe")]
    run: Option<PathBuf>,
    /// Print a recipe as TOML and exit: a template for recipes of your own
    #[arg(long, value_name = "NAME", value_parser = Recipe::NAMES, exclusive = true)]
    print_recipe: Option<String>,
    #[command(flatten)]
    options: Options,
    /// Train again. Without this option splats of the same input and options are kept, and those of others are an error
    #[arg(long)]
    overwrite: bool,
}

/// Kinds of splats.
#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum Primitive {
    /// Ellipsoids
    #[value(name = "3d")]
    Ellipsoid,
    /// Flat discs
    #[value(name = "2d")]
    Disc,
}

impl From<Primitive> for PrimitiveKind {
    fn from(primitive: Primitive) -> Self {
        match primitive {
            Primitive::Ellipsoid => Self::Ellipsoid,
            Primitive::Disc => Self::Disc,
        }
    }
}

/// What the values of depths are.
#[derive(clap::ValueEnum, Clone, Copy, Debug)]
pub enum PriorKind {
    /// Depths in the unit of the scene
    Metric,
    /// Depths in the unit of the scene, as exact as those of a sensor: they are taken as they are
    Measured,
    /// Depths up to a scale and a shift, larger where the scene is farther
    Relative,
    /// Inverse depths up to a scale and a shift, larger where the scene is nearer
    Disparity,
}

impl From<PriorKind> for DepthKind {
    fn from(kind: PriorKind) -> Self {
        match kind {
            PriorKind::Metric => Self::Metric,
            PriorKind::Measured => Self::Measured,
            PriorKind::Relative => Self::Relative,
            PriorKind::Disparity => Self::Disparity,
        }
    }
}

/// Points to start from.
#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum Start {
    /// Those of the scene
    Scene,
    /// Those of the scene, and more where views have few (IndoorSplat)
    Patches,
    /// One behind each pixel, by depths that are aligned with the points of the scene (GeoProp-GS)
    Hdd,
    /// As hdd, and more where no view sees anything (GeoProp-GS)
    Gva,
    /// Splats that are predicted of the matched surface, else of the points of the scene (Point2GS)
    Predict,
}

impl Start {
    /// The points of a perspective scene; none for `predict`.
    fn points(self) -> Option<StartPoints> {
        match self {
            Self::Scene => Some(StartPoints::Scene),
            Self::Patches => Some(StartPoints::Patches),
            Self::Hdd => Some(StartPoints::Hdd),
            Self::Gva => Some(StartPoints::Gva),
            Self::Predict => None,
        }
    }
}

/// How to train.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "training")]
pub struct Options {
    /// Training recipe: `best`, `baeogs` or `eogs` (the latter two follow the papers), `satgs` (`best`, then colours for any
    /// date and sun; `satgs-fast` with a quarter of the iterations of colours), of perspective scenes `3dgs`, `2dgs`, `indoor`
    /// and `geoprop` (three to ten aerial views), or a TOML file [default: `best`, of perspective scenes `3dgs`]
    #[arg(long, value_name = "NAME|FILE")]
    recipe: Option<String>,
    /// Kind of splats: `3d` for ellipsoids, `2d` for flat discs, which have normals [default: the recipe's]
    #[arg(long, value_name = "3d|2d")]
    primitive: Option<Primitive>,
    /// What training starts from: points of a perspective scene (without --depth-prior, hdd and gva interpolate depths between the
    /// points of the scene), or `predict` [default: the recipe's]
    #[arg(long, value_name = "POINTS")]
    start: Option<Start>,
    /// Take points to start from, and to align --depth-prior with, from the reference depth maps of LEVIR-NVS and ScanNet++ scenes
    /// without points
    #[arg(long)]
    reference_points: bool,
    /// Number of iterations; the schedule is scaled in proportion [default: the recipe's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    iterations: Option<u32>,
    /// Seed of all random numbers; the same seed gives the same bytes
    #[arg(long, default_value_t = 0, value_name = "N")]
    seed: u64,
    /// Iterations between checkpoints; an interrupted training continues from the last one
    #[arg(long, default_value_t = 500, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    checkpoint_every: u32,
    /// Require a checkpoint. Training always continues from one if there is one; without this option it otherwise starts from the
    /// beginning
    #[arg(long)]
    resume: bool,
    /// Number of pictures of the training's progress to write to RUN/train/snapshots: image, render, shadows, altitudes
    /// and errors of one view [default: none]
    #[arg(long, default_value_t = 0, value_name = "N", hide_default_value = true)]
    snapshots: u32,
    /// Network (ONNX, such as DINOv2) by whose features recipe satgs finds what images and pictures do not share [default: features
    /// that need no network]
    #[arg(long, value_name = "FILE")]
    features: Option<PathBuf>,
    /// Network (safetensors, made by scripts/fetch-weights) of the perceptual loss of recipe satgs [default: train without]
    #[arg(long, value_name = "FILE")]
    lpips: Option<PathBuf>,
    /// Depths of the images for recipes indoor and geoprop: a folder with NAME.npy, NAME.png or NAME.tif for each image; a network
    /// (ONNX, such as Depth Anything V2); a command that writes the map {out} of the image {image}, as 'python3 depth.py {image} {out}';
    /// or `stereo`, which matches the images with each other. Maps that are made are kept in RUN/priors; `satgs prior` makes them once
    /// for several runs [default: the depth maps of RGB-D frames; else stereo, of recipe geoprop none]
    #[arg(long, value_name = "DIR|FILE.onnx|CMD|stereo", value_parser = PriorSource::parse)]
    depth_prior: Option<PriorSource>,
    /// What the values of --depth-prior are [default: what its prior.json says, else what the points of the scene show]
    #[arg(long, value_name = "KIND", requires = "depth_prior")]
    prior_kind: Option<PriorKind>,
    /// Normals of the images for recipe indoor, in camera axes (right, down, forward) with any signs: a folder, a network or a
    /// command, as --depth-prior [default: those of the depth maps of RGB-D frames, else train without]
    #[arg(long, value_name = "DIR|FILE.onnx|CMD", value_parser = PriorSource::parse)]
    normal_prior: Option<PriorSource>,
    /// Command that paints the holes of pseudo-views (--start gva), called for each: {rgb} is the picture, {mask} its holes, {depth}
    /// its depths (.npy), {out} the PNG to write, as 'python3 inpaint.py {rgb} {mask} {out}'. Without it, what no view sees takes
    /// the colours of what is near
    #[arg(long, value_name = "CMD", value_parser = InpaintCommand::parse)]
    inpaint: Option<InpaintCommand>,
}

impl Options {
    /// The options as the library takes them, with the recipe of this name by default.
    pub fn options(&self, default_recipe: &str, overwrite: bool) -> TrainOptions {
        TrainOptions {
            recipe: self.recipe.clone().unwrap_or_else(|| default_recipe.into()),
            primitive: self.primitive.map(PrimitiveKind::from),
            start: self.start.and_then(Start::points),
            predict: matches!(self.start, Some(Start::Predict)),
            reference_points: self.reference_points,
            iterations: self.iterations,
            seed: self.seed,
            checkpoint_every: self.checkpoint_every,
            resume: self.resume,
            snapshots: self.snapshots,
            frame: None,
            features: self.features.clone(),
            lpips: self.lpips.clone(),
            priors: PriorSources {
                depths: self.depth_prior.clone(),
                kind: self.prior_kind.map(DepthKind::from),
                normals: self.normal_prior.clone(),
            },
            inpaint: self.inpaint.clone(),
            overwrite,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    if let Some(recipe) = args.print_recipe.as_deref().and_then(Recipe::named) {
        ui.summary("recipe", Some(&recipe.to_toml()), &recipe)?;
    }
    let Some(run) = &args.run else { return Ok(()) };
    let is_perspective = PerspectiveManifest::read(run).is_ok();
    let recipe = if is_perspective { Recipe::OF_PERSPECTIVE_SCENES } else { Recipe::NAMES[0] };
    show(run, &train(run, &args.options.options(recipe, args.overwrite), ui)?, ui)
}

/// Shows the summary of a training.
pub fn show(run: &Path, outcome: &Outcome<Trained>, ui: &Ui) -> Result<(), CliError> {
    let text = |t: &Trained| {
        let cameras = t.camera_rms_px.zip(t.camera_max_px).map_or(String::new(), |(rms, most)| {
            format!("quadratic cameras: distance to the RPCs {rms:.3} px RMS, {most:.3} px at most\n")
        });
        let colors = t.colors.as_ref().map_or(String::new(), |c| {
            format!(
                "trained colours in {} iterations in {:.0} s: {} splats; displayed images: L1 {:.4}, SSIM {:.3}\n",
                c.iterations, c.seconds, c.splats, c.l1, c.ssim
            )
        });
        format!(
            "trained {} iterations in {:.0} s: {} splats at the start, {} at the end\n{cameras}\
             rendered images: L1 {:.4}, SSIM {:.3}\n{colors}\
             {}",
            t.iterations,
            t.seconds,
            t.splats_start,
            t.splats,
            t.l1,
            t.ssim,
            run.join(SPLATS).display()
        )
    };
    ui.outcome("train", outcome, text)
}
