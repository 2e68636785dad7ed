//! `satgs train`: cameras, splats, training.

use super::{CliError, Ui, named};
use crate::pipeline::{Outcome, PerspectiveManifest, TrainOptions, Trained, train};
use crate::prior::{DepthKind, InpaintCommand, PriorSource, PriorSources};
use crate::run_files::SPLATS;
use crate::splat::backend::DeviceChoice;
use crate::splat::primitive::PrimitiveKind;
use crate::splat::recipe::{Recipe, StartPoints};
use std::path::{Path, PathBuf};

/// Train Gaussian splats on an adjusted run: writes RUN/splats.ply and RUN/cameras.json
///
/// Fits quadratic cameras to the corrected RPCs of `satgs ba`, initialises splats and optimises them on the images, with cast
/// shadows. Splats start on a surface from multi-view stereo (recipe `best`), at the sparse points (`baeogs`), or at random in
/// the scene's volume (`eogs`). Views without a sun position are trained without shadows.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Run folder: of `satgs ba` or `satgs predict`, or of photographs
    #[arg(required_unless_present = "print_recipe")]
    run: Option<PathBuf>,
    /// Print a recipe as TOML and exit: a template for recipes of your own
    #[arg(long, value_name = "NAME", value_parser = Recipe::NAMES, exclusive = true)]
    print_recipe: Option<String>,
    #[command(flatten)]
    options: Options,
    /// Train again. By default splats of the same input and options are kept, and any others are an error
    #[arg(long)]
    overwrite: bool,
}

/// Points to start from.
#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum Start {
    /// The points of the scene
    Scene,
    /// The points of the scene, and more in parts of views that have few (IndoorSplat)
    Patches,
    /// A point for each pixel of the views, at its depth (GeoProp-GS)
    Hdd,
    /// As hdd, and points that no view sees, but cameras between the views would (GeoProp-GS)
    Gva,
    /// Splats predicted from the matched surface, else from the points of the scene (Point2GS)
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
    /// Recipe, such as `best` or `satgs`, or a TOML file
    ///
    /// For satellite images: `best` is for heights, `baeogs` and `eogs` follow the papers, `satgs` adds colours for any date and sun,
    /// `satgs-fast` in a quarter of the iterations. For photographs: `3dgs` trains ellipsoids, `2dgs` flat discs for surfaces,
    /// `indoor` is for rooms, `geoprop` for three to ten aerial views [default: `best`; for photographs `3dgs`].
    #[arg(long, value_name = "NAME|FILE", help_heading = "Training")]
    recipe: Option<String>,
    /// Kind of splats [default: the recipe's]
    #[arg(long, value_name = "KIND", value_parser = named(&PrimitiveKind::NAMED), hide_short_help = true, help_heading = "Training")]
    primitive: Option<PrimitiveKind>,
    /// Points that training starts from [default: the recipe's]
    ///
    /// All but `predict` are for photographs. `hdd` and `gva` take depths from --depth-prior, else interpolate them between the points
    /// that the view sees.
    #[arg(long, value_name = "POINTS", hide_short_help = true, help_heading = "Training")]
    start: Option<Start>,
    /// In scenes without points, start from points of the reference depth maps of LEVIR-NVS and ScanNet++
    ///
    /// --depth-prior is aligned with these points, too. By default training does not use reference depth maps.
    #[arg(long, hide_short_help = true, help_heading = "Training")]
    reference_points: bool,
    /// Number of iterations [default: the recipe's]
    ///
    /// The recipe's schedule is scaled in proportion.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000), help_heading = "Training")]
    iterations: Option<u32>,
    /// Stop at the matched surface: heights, orthophoto, confidence
    ///
    /// With two or three images, splats do not change the heights; with four and more, training improves them.
    #[arg(long, conflicts_with_all = ["iterations", "snapshots", "resume"], help_heading = "Training")]
    no_splats: bool,
    /// Seed of all random numbers; the same seed gives the same bytes
    #[arg(long, default_value_t = 0, value_name = "N", help_heading = "Run", hide_short_help = true)]
    seed: u64,
    /// Device that trains: auto, cpu, gpu, or gpu:N for device N of `satgs info --devices`
    ///
    /// `auto` takes a GPU for recipes that one can train (`best`, `baeogs`, `eogs`, `3dgs`), else the processor.
    #[arg(long, value_name = "DEVICE", default_value_t = DeviceChoice::Auto, help_heading = "Run", hide_short_help = true)]
    device: DeviceChoice,
    /// Iterations between checkpoints; an interrupted training continues from the last one
    #[arg(
        long, default_value_t = 500, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = "Run",
        hide_short_help = true
    )]
    checkpoint_every: u32,
    /// Fail unless there is a checkpoint to continue from
    ///
    /// By default training continues from a checkpoint if there is one, and otherwise starts from the beginning.
    #[arg(long, help_heading = "Run", hide_short_help = true)]
    resume: bool,
    /// Number of pictures to write during training, to RUN/train/snapshots [default: 0]
    ///
    /// Each shows image, rendering, shadows, altitudes and errors of one view.
    #[arg(
        long,
        default_value_t = 0,
        value_name = "N",
        hide_default_value = true,
        hide_short_help = true,
        help_heading = "Training"
    )]
    snapshots: u32,
    /// For recipe satgs: ONNX network of image features, such as DINOv2, to find cars and other transient objects
    ///
    /// It gives a feature vector for each patch of an image. Patches whose vectors differ between image and rendering count less
    /// [default: features that need no network].
    #[arg(long, value_name = "FILE", hide_short_help = true, help_heading = "Training")]
    features: Option<PathBuf>,
    /// For recipe satgs: network of the perceptual loss (LPIPS), a safetensors file made by scripts/fetch-weights [default:
    /// train without this loss]
    #[arg(long, value_name = "FILE", hide_short_help = true, help_heading = "Training")]
    lpips: Option<PathBuf>,
    /// Depth maps of the images, for recipes 2dgs, indoor and geoprop: a folder, an ONNX network, a command, or `stereo`
    ///
    /// A folder has NAME.npy, NAME.png or NAME.tif for each image. A network, such as Depth Anything V2, estimates depths from one
    /// image. A command writes the map {out} of the image {image}, for example 'python3 depth.py {image} {out}'. `stereo` matches the
    /// images with each other. Maps are kept in RUN/priors; `satgs prior` makes them once for several runs [default: the depth maps of
    /// RGB-D frames, else `stereo`; for recipe geoprop none].
    #[arg(long, value_name = "DIR|FILE.onnx|CMD|stereo", value_parser = PriorSource::parse, hide_short_help = true, help_heading = "Training")]
    depth_prior: Option<PriorSource>,
    /// What the values of --depth-prior are [default: as its prior.json says, else estimated from the points of the scene]
    #[arg(
        long,
        value_name = "KIND",
        value_parser = named(&DepthKind::STATED),
        requires = "depth_prior",
        hide_short_help = true,
        help_heading = "Training"
    )]
    prior_kind: Option<DepthKind>,
    /// Normal maps of the images, for recipe indoor: a folder, an ONNX network or a command, as for --depth-prior
    ///
    /// Normals may be in camera or world axes, with any signs: the convention is estimated from the points of the scene [default:
    /// computed from the depth maps of RGB-D frames, else train without].
    #[arg(long, value_name = "DIR|FILE.onnx|CMD", value_parser = PriorSource::parse, hide_short_help = true, help_heading = "Training")]
    normal_prior: Option<PriorSource>,
    /// For --start gva and recipe geoprop: command that paints what no view sees
    ///
    /// Example: 'python3 inpaint.py {rgb} {mask} {out}'. It is called for each rendering from a camera between the views: {rgb} is the
    /// rendering (PNG), {mask} is white where no view sees the scene, {depth} holds depths (.npy), {out} is the PNG to write
    /// [default: the colours of the surroundings].
    #[arg(long, value_name = "CMD", value_parser = InpaintCommand::parse, hide_short_help = true, help_heading = "Training")]
    inpaint: Option<InpaintCommand>,
}

impl Options {
    /// The options as the library takes them, with the recipe of this name by default.
    pub fn options(&self, default_recipe: &str, overwrite: bool) -> TrainOptions {
        TrainOptions {
            recipe: self.recipe.clone().unwrap_or_else(|| default_recipe.into()),
            primitive: self.primitive,
            start: self.start.and_then(Start::points),
            predict: matches!(self.start, Some(Start::Predict)),
            reference_points: self.reference_points,
            iterations: self.iterations,
            no_splats: self.no_splats,
            seed: self.seed,
            device: self.device,
            checkpoint_every: self.checkpoint_every,
            resume: self.resume,
            snapshots: self.snapshots,
            frame: None,
            features: self.features.clone(),
            lpips: self.lpips.clone(),
            priors: PriorSources {
                depths: self.depth_prior.clone(),
                kind: self.prior_kind,
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
        let Some((l1, ssim)) = t.l1.zip(t.ssim) else {
            return format!(
                "no splats trained: the surface comes from matching alone\n{}",
                cameras.trim_end()
            );
        };
        format!(
            "trained {} iterations in {:.0} s{}: {} splats at the start, {} at the end\n{cameras}\
             rendered images: L1 {l1:.4}, SSIM {ssim:.3}\n{colors}\
             {}",
            t.iterations,
            t.seconds,
            t.device.as_ref().map_or(String::new(), |name| format!(" on {name}")),
            t.splats_start,
            t.splats,
            run.join(SPLATS).display()
        )
    };
    ui.outcome("train", outcome, text)
}
