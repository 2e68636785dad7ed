//! `satgs train`: affine cameras, splats from the sparse points, training.

use super::interrupt::Interruptible;
use super::stage::{Fingerprint, Stage, hash, hash_file};
use super::{Failure, Ui, align};
use crate::bundle::Adjustment;
use crate::dsm::altitudes;
use crate::event::Event;
use crate::frame::{Point, Site};
use crate::raster::{RasterError, write_atomically, write_file};
use crate::scene::Scene;
use crate::splat::appearance::Appearance;
use crate::splat::backend::{Snapshot, TrainingBackend};
use crate::splat::checkpoint::Checkpoint;
use crate::splat::cpu::CpuBackend;
use crate::splat::hold::Hold;
use crate::splat::recipe::{Recipe, Start};
use crate::splat::setup::Setup;
use crate::splat::sweep::{Sweep, SweptSurface};
use crate::splat::train::{LogLine, Schedule, train};
use crate::splat::views::TrainingView;
use crate::splat::{init, ply, progress};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// Train Gaussian splats on an adjusted run: RUN/splats.ply, RUN/cameras.json
///
/// Fits affine cameras to the RPCs that `satgs ba` corrected, matches the views to find the surface that splats start
/// on (recipe `best`; `baeogs` starts at the sparse points, `eogs` all over the air), and trains the splats on the
/// images with cast shadows. Views without a sun train without shadows.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Folder that `satgs ba -o RUN` made
    #[arg(required_unless_present = "print_recipe")]
    run: Option<PathBuf>,
    /// Print a recipe as TOML, to start one's own from
    #[arg(long, value_name = "NAME", value_parser = Recipe::NAMES, exclusive = true)]
    print_recipe: Option<String>,
    #[command(flatten)]
    options: Options,
    /// Train anew though RUN holds splats, of the same or of other input and options
    #[arg(long)]
    overwrite: bool,
}

/// How to train.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "training")]
pub struct Options {
    /// Training choices: `best`, `baeogs` or `eogs` as the papers have them, or a TOML file
    #[arg(long, default_value = Recipe::NAMES[0], value_name = "NAME|FILE")]
    recipe: String,
    /// Iterations; the whole schedule scales with them [default: the recipe's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    iterations: Option<u32>,
    /// Seed of every random choice; the same seed gives the same bytes
    #[arg(long, default_value_t = 0, value_name = "N")]
    seed: u64,
    /// Iterations between checkpoints, from which a training that was interrupted goes on
    #[arg(long, default_value_t = 500, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    checkpoint_every: u32,
    /// Go on from the checkpoint, or fail; without this option a training goes on if it can, else begins
    #[arg(long)]
    resume: bool,
    /// Pictures of the training as it goes on, RUN/train/snapshots: a view's image, its picture, shadows, altitudes, errors
    #[arg(long, default_value_t = 0, value_name = "N", hide_default_value = true)]
    snapshots: u32,
}

/// The trained surface, matched with the views, in a run's folder; and the one that training started on.
pub const SURFACE: &str = "train/surface.tif";
pub const FIRST_SURFACE: &str = "train/first_surface.tif";
/// Folder of the pictures of a training's progress, in a run's.
const SNAPSHOTS: &str = "train/snapshots";

/// `RUN/cameras.json`.
#[derive(Serialize, Deserialize)]
pub struct TrainedCameras {
    /// Site, area, cameras.
    #[serde(flatten)]
    pub setup: Setup,
    /// Name and radiometry of every training view.
    pub appearances: Vec<(String, Appearance)>,
    /// What was trained by.
    pub recipe: Recipe,
    /// Whether `surface.tif` holds the trained surface matched with the views.
    pub is_matched: bool,
}

impl TrainedCameras {
    /// Reads a run's cameras, aligned if an alignment was interrupted.
    pub fn read(run: &Path) -> Result<Self, Failure> {
        align::finish(run)?;
        read_json(&run.join("cameras.json"), "`satgs train RUN` makes it")
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    if let Some(recipe) = args.print_recipe.as_deref().and_then(Recipe::named) {
        ui.summary("recipe", &recipe.to_toml(), serde_json::json!(recipe));
    }
    match &args.run {
        Some(run) => train_run(run, &args.options, args.overwrite, ui),
        None => Ok(()),
    }
}

/// Trains a run folder, unless it is trained already; goes on from a checkpoint of the same input and options.
pub fn train_run(run: &Path, options: &Options, overwrite: bool, ui: &Ui) -> Result<(), Failure> {
    align::finish(run)?;
    let scene: Scene = read_json(&run.join("scene.json"), "`satgs ba SCENE -o RUN` makes it")?;
    let mut recipe = match Recipe::named(&options.recipe) {
        Some(recipe) => recipe,
        None => Recipe::read(Path::new(&options.recipe))?,
    };
    if let Some(iterations) = options.iterations {
        recipe = recipe.with_iterations(iterations);
    }
    let outputs = ["splats.ply", "cameras.json"];
    let stage = Stage::new(run, "train", &outputs, fingerprint(run, &recipe, options.seed));
    if stage.is_done(overwrite)? {
        ui.note(&format!("`{}` is trained already", run.display()));
        return Ok(());
    }
    let adjustment = Adjustment::read(&run.join("ba"))?;
    let rpcs: Vec<_> = adjustment.cameras_of(&scene)?;
    let points = adjustment.positions();
    let setup = Setup::new(&scene, &rpcs, &points)?;
    for view in setup.views.iter().filter(|v| v.sun_shear.is_none()) {
        tracing::info!("view `{}` has no usable sun: it trains without shadows", view.name);
    }
    let views = setup.training_views(&scene)?;
    if views.is_empty() {
        return Err(crate::splat::setup::SetupError::NoViews.into());
    }
    let sparse = setup.sparse(&points);
    let checkpoints = Checkpoints { path: run.join("train").join("checkpoint.bin"), stage: &stage, options };
    let (at_start, mut log, state) = match checkpoints.take_up(views.len(), overwrite, ui)? {
        Some(c) => (c.splats_at_start, c.log.into_owned(), c.state.into_owned()),
        None => {
            // Another training's.
            let _ = std::fs::remove_file(run.join(FIRST_SURFACE));
            let _ = std::fs::remove_dir_all(run.join(SNAPSHOTS));
            let splats = match (sweep(&recipe, &setup, &views, &sparse), recipe.start) {
                (Some(sweep), _) => {
                    let first = sweep.run(&|e| ui.show(e));
                    first.write(&run.join(FIRST_SURFACE))?;
                    init::on_surface(&first, &views)
                }
                (None, Start::Surface | Start::Points) => init::on_points(&sparse, setup.area, options.seed),
                (None, Start::Box) => init::in_box(setup.area, setup.altitudes, options.seed),
            };
            (splats.len(), Vec::new(), Snapshot::start(splats, views.len()))
        }
    };
    let names: Vec<String> = views.iter().map(|v| v.name.clone()).collect();
    // From the file whether or not training was interrupted: the same bytes.
    let first = first_surface(run, &recipe, &setup)?;
    let hold = first.as_ref().zip(recipe.hold).map(|(first, weight)| Hold::new(first, weight));
    let mut backend = CpuBackend::new(state, views, setup.altitudes, hold);
    let schedule = Schedule {
        recipe: &recipe,
        views: names.len(),
        half_side_m: setup.half_side_m(),
        splats_at_start: at_start,
        seed: options.seed,
    };
    let watched = setup.reference_among_training();
    let view = (options.snapshots > 0).then(|| backend.views()[watched].clone());
    let interruptible = Interruptible::new();
    train(&mut backend, &schedule, &mut log, &|e| ui.show(e), |backend, log| {
        let done = log.len() as u32;
        let is_due = progress::is_snapshot_due(options.snapshots, done, recipe.iterations);
        if let Some(view) = view.as_ref().filter(|_| is_due) {
            let (state, shadows) = (backend.snapshot(), done > recipe.shadows_from);
            let appearance = &state.appearances[watched].0;
            let panels = progress::panels(view, &state.splats, appearance, setup.altitudes, shadows);
            // A picture less is no reason to stop.
            if let Err(e) = panels.write(&run.join(format!("{SNAPSHOTS}/{done:06}.png"))) {
                ui.show(Event::Warning(e.to_string()));
            }
        }
        checkpoints.keep(at_start, log, backend, &interruptible)
    })?;
    drop(interruptible);

    if ui.is_verbose() {
        ui.note(&backend.times().table());
    }
    let sweep = sweep(&recipe, &setup, backend.views(), &sparse);
    let made = backend.snapshot();
    let swept = sweep.zip(first);
    if let Some((sweep, first)) = &swept {
        let trained = altitudes(&made.splats, &setup.site, &sweep.grid());
        sweep.sharpen(&trained, first).write(&run.join(SURFACE))?;
    }
    ply::write(&run.join("splats.ply"), &made.splats, &setup.site)?;
    write_log(&run.join("train/train.csv"), &log)?;
    progress::curves(&log).write(&run.join("train/curves.png"))?;
    let splats = (at_start, made.splats.len());
    let appearances = names.into_iter().zip(made.appearances.iter().map(|a| a.0)).collect();
    let cameras = TrainedCameras { setup, appearances, recipe, is_matched: swept.is_some() };
    write_json(&run.join("cameras.json"), &cameras)?;
    stage.complete()?;
    checkpoints.remove();
    summarise(run, &cameras, &log, splats, ui);
    Ok(())
}

/// The sweep that finds the surface, if the recipe has one and two views can be matched.
fn sweep(recipe: &Recipe, setup: &Setup, views: &[TrainingView], sparse: &[Point<Site>]) -> Option<Sweep> {
    (recipe.start == Start::Surface).then(|| Sweep::new(setup, views, sparse)).flatten()
}

/// The surface that training starts on, if there is one.
fn first_surface(run: &Path, recipe: &Recipe, setup: &Setup) -> Result<Option<SweptSurface>, Failure> {
    let path = run.join(FIRST_SURFACE);
    let is_used = recipe.start == Start::Surface && path.exists();
    Ok(is_used.then(|| SweptSurface::read(&path, &setup.site)).transpose()?)
}

/// Says what training made; `splats` are their numbers at the start and at the end.
fn summarise(run: &Path, cameras: &TrainedCameras, log: &[LogLine], splats: (usize, usize), ui: &Ui) {
    let fits = &cameras.setup.views;
    let worst = fits.iter().map(|v| v.max_px).fold(0.0, f64::max);
    let rms = mean(fits.iter().map(|v| v.rms_px));
    let seconds = log.last().map_or(0.0, |l| l.seconds);
    let tail = &log[log.len().saturating_sub(cameras.appearances.len())..];
    let (l1, ssim) = (mean(tail.iter().map(|l| l.l1)), mean(tail.iter().map(|l| l.ssim)));
    let (at_start, at_end) = splats;
    let text = format!(
        "trained {} iterations in {seconds:.0} s: {at_start} splats at the start, {at_end} at the end\n\
         affine cameras: {rms:.3} px RMS, {worst:.3} px at most\n\
         pictures: L1 {l1:.4}, SSIM {ssim:.3}\n\
         {}",
        cameras.recipe.iterations,
        run.join("splats.ply").display()
    );
    let json = serde_json::json!({
        "iterations": cameras.recipe.iterations, "seconds": seconds, "splats_start": at_start, "splats": at_end,
        "affine_rms_px": rms, "affine_max_px": worst, "l1": l1, "ssim": ssim,
    });
    ui.summary("train", &text, json);
}

/// The checkpoint of a stage that trains.
struct Checkpoints<'a> {
    path: PathBuf,
    stage: &'a Stage,
    options: &'a Options,
}

impl Checkpoints<'_> {
    /// The checkpoint to go on from: of the same input and options, and for so many views.
    ///
    /// One of others is an error that names them, unless `overwrite`. A damaged one is passed over with a warning;
    /// with `--resume` it is an error, as is none.
    fn take_up(
        &self,
        views: usize,
        overwrite: bool,
        ui: &Ui,
    ) -> Result<Option<Checkpoint<'static>>, Failure> {
        if !self.path.exists() {
            if self.options.resume {
                let message = format!("`{}` does not exist", self.path.display());
                return Err(Failure::input(message, "without --resume training begins at the start"));
            }
            return Ok(None);
        }
        let checkpoint = match Checkpoint::read(&self.path) {
            Ok(checkpoint) => checkpoint,
            Err(e) if self.options.resume => return Err(e.into()),
            Err(e) => {
                ui.show(Event::Warning(format!("{e}; training begins at the start")));
                return Ok(None);
            }
        };
        if !self.stage.is_made_from(&checkpoint.origin, overwrite)? || !checkpoint.state.fits(views) {
            self.remove();
            return Ok(None);
        }
        let done = checkpoint.log.len();
        ui.note(&format!("going on from `{}` after {done} iterations", self.path.display()));
        Ok(Some(checkpoint))
    }

    /// Writes a checkpoint where one is due; when asked to stop, writes one and stops.
    fn keep(
        &self,
        splats_at_start: usize,
        log: &[LogLine],
        backend: &mut CpuBackend,
        interruptible: &Interruptible,
    ) -> Result<(), Failure> {
        let interrupted = interruptible.is_requested();
        if interrupted || log.len().is_multiple_of(self.options.checkpoint_every as usize) {
            let origin = Cow::Borrowed(self.stage.fingerprint());
            let state = Cow::Borrowed(backend.snapshot());
            Checkpoint { origin, splats_at_start, log: log.into(), state }.write(&self.path)?;
        }
        if interrupted {
            let message = format!("interrupted after {} iterations", log.len());
            let hint = format!("the same command goes on from `{}`", self.path.display());
            return Err(Failure::interrupted(message, hint));
        }
        Ok(())
    }

    /// A complete training needs none; one that is left behind does no harm.
    fn remove(&self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / f64::max(n, 1.0)
}

fn fingerprint(run: &Path, recipe: &Recipe, seed: u64) -> Fingerprint {
    let recipe_text = serde_json::to_string(recipe).unwrap_or_default();
    Fingerprint::from([
        ("scene".into(), hash_file(&run.join("scene.json"))),
        ("adjustment".into(), hash_file(&run.join("ba").join("stage.json"))),
        ("recipe".into(), format!("{} {}", recipe.name, hash(recipe_text.as_bytes()))),
        ("iterations".into(), recipe.iterations.to_string()),
        ("seed".into(), seed.to_string()),
    ])
}

fn write_log(path: &Path, log: &[LogLine]) -> Result<(), Failure> {
    let failed = |reason: String| RasterError::Write { path: path.into(), reason };
    write_atomically(path, |t| {
        let mut writer = csv::Writer::from_path(t).map_err(|e| failed(e.to_string()))?;
        for line in log {
            writer.serialize(line).map_err(|e| failed(e.to_string()))?;
        }
        writer.flush().map_err(|e| failed(e.to_string()))
    })?;
    Ok(())
}

/// Reads a JSON file of the run folder; `made_by` is the hint when it is absent.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path, made_by: &str) -> Result<T, Failure> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| Failure::input(format!("`{}` cannot be read: {e}", path.display()), made_by))?;
    serde_json::from_str(&text)
        .map_err(|e| Failure::input(format!("`{}` is damaged: {e}", path.display()), made_by))
}

/// Writes a JSON file of the run folder.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), Failure> {
    let failed = |reason: String| RasterError::Write { path: path.into(), reason };
    let text = serde_json::to_string_pretty(value).map_err(|e| failed(e.to_string()))?;
    Ok(write_file(path, text)?)
}
