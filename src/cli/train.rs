//! `satgs train`: affine cameras, splats from the sparse points, training.

use super::checkpoints::Checkpoints;
use super::run_folder::{TrainedCameras, read_scene, require_images, write_json};
use super::stage::{Fingerprint, Stage, hash, hash_file};
use super::{Failure, Ui, align, run_lock};
use crate::affine::{SiteScene, SiteSceneError};
use crate::affine::{TrainingView, median_pixel_m};
use crate::bundle::Adjustment;
use crate::dsm::altitudes;
use crate::frame::{Point, Site};
use crate::io::{RasterError, write_atomically};
use crate::mvs::{MatchError, MatchedSurface, PlaneSweep};
use crate::progress::{Event, Progress};
use crate::run_files::{ADJUSTMENT, CAMERAS, CHECKPOINT, FIRST_SURFACE, SPLATS, STAGE, SURFACE, TRAINING};
use crate::scene::Scene;
use crate::splat::backend::TrainingBackend;
use crate::splat::backend::cpu::CpuBackend;
use crate::splat::init;
use crate::splat::loss::surface_prior::SurfacePrior;
use crate::splat::splats::Splats;
use crate::splat::state::TrainingState;
use crate::splat::train::recipe::{Recipe, Start};
use crate::splat::train::{LogLine, Schedule, train};
use crate::splat::train::{expectation::Extent, pictures};
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
    /// Training choices: `best`, `baeogs` or `eogs` after the papers, or a TOML file
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

impl Options {
    /// The recipe that is asked for.
    pub(super) fn recipe(&self) -> Result<Recipe, Failure> {
        let recipe = self.recipe_as_written()?;
        Ok(match self.iterations {
            Some(iterations) => recipe.with_iterations(iterations),
            None => recipe,
        })
    }

    /// The recipe for so many training views: few of them need fewer iterations than it has, unless a number is asked for.
    fn recipe_for(&self, views: usize) -> Result<Recipe, Failure> {
        let recipe = self.recipe()?;
        Ok(if self.iterations.is_some() { recipe } else { recipe.for_views(views) })
    }

    /// The recipe with its own number of iterations.
    fn recipe_as_written(&self) -> Result<Recipe, Failure> {
        match Recipe::named(&self.recipe) {
            Some(recipe) => Ok(recipe),
            None => Ok(Recipe::read(Path::new(&self.recipe))?),
        }
    }
}

/// Folder of the pictures of a training's progress, in a run's.
const SNAPSHOTS: &str = "train/snapshots";

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
    run_lock::lock(run)?;
    align::finish(run)?;
    let scene = read_scene(run)?;
    let recipe = options.recipe_for(scene.training().count())?;
    let outputs = [SPLATS, CAMERAS].map(|name| run.join(name)).into();
    let stage = Stage::new(run, "train", outputs, fingerprint(run, options, &recipe)?);
    if stage.is_done(overwrite)? {
        ui.note(&format!("`{}` is trained already", run.display()));
        ui.repeat_summary("train", stage.summary());
        return Ok(());
    }
    stage.require_writable()?;
    require_images(&scene)?;
    let job = Job::new(run, options, recipe, &scene)?;
    let (extent, threads) = (Extent::of(&job.setup), rayon::current_num_threads());
    if job.recipe.name == Recipe::NAMES[0] && options.iterations.is_none() && extent.views > 1 {
        ui.note(&extent.expectation(&job.recipe, threads).text(&extent, threads));
    }
    let views = job.setup.training_views(&scene)?;
    if views.is_empty() {
        return Err(SiteSceneError::NoViews.into());
    }
    let (every, is_required) = (options.checkpoint_every, options.resume);
    let checkpoints = Checkpoints { path: run.join(CHECKPOINT), stage: &stage, every, is_required };
    let (at_start, mut log, state) = match checkpoints.take_up(views.len(), overwrite, ui)? {
        Some(c) => (c.splats_at_start, c.log.into_owned(), c.state.into_owned()),
        None => {
            let splats = job.splats_at_start(&views, ui)?;
            (splats.len(), Vec::new(), TrainingState::start(splats, views.len()))
        }
    };
    // From the file whether or not training was interrupted: the same bytes.
    let first = job.first_surface()?;
    let hold = first.as_ref().zip(job.recipe.hold).map(|(first, weight)| SurfacePrior::new(first, weight));
    let schedule = Schedule {
        recipe: &job.recipe,
        views: views.len(),
        half_side_m: job.setup.half_side_m(),
        pixel_m: median_pixel_m(&views),
        splats_at_start: at_start,
        seed: options.seed,
    };
    let mut backend = CpuBackend::new(state, views, job.setup.altitudes, hold);
    ui.event(Event::Resumable(true));
    train(&mut backend, &schedule, &mut log, ui, |backend, log| {
        job.take_picture(backend, log.len() as u32, ui);
        checkpoints.keep(at_start, log, backend, ui)
    })?;
    ui.event(Event::Resumable(false));

    if ui.is_verbose() {
        ui.note(&backend.times().table());
    }
    let cameras = job.write(&mut backend, first.as_ref(), &log)?;
    let (text, json) = summary(run, &cameras, &log, (at_start, backend.snapshot().splats.len()));
    stage.complete(&json)?;
    checkpoints.remove();
    ui.summary("train", &text, json);
    Ok(())
}

/// A training: what it is of, and how it is done.
struct Job<'a> {
    run: &'a Path,
    options: &'a Options,
    recipe: Recipe,
    setup: SiteScene,
    /// The sparse points in the area.
    sparse: Vec<Point<Site>>,
}

impl<'a> Job<'a> {
    /// The training of a run's scene as it was adjusted.
    fn new(run: &'a Path, options: &'a Options, recipe: Recipe, scene: &Scene) -> Result<Self, Failure> {
        let adjustment = Adjustment::read(&run.join(ADJUSTMENT))?;
        let points = adjustment.positions();
        let mut setup = SiteScene::new(scene, &adjustment.cameras_of(scene)?, &points)?;
        setup.tone = setup.tone.with_white(recipe.white);
        for view in setup.views.iter().filter(|v| v.sun_shear.is_none()) {
            tracing::info!("view `{}` has no usable sun: it trains without shadows", view.name);
        }
        let sparse = setup.sparse(&points);
        Ok(Self { run, options, recipe, setup, sparse })
    }

    /// The splats that training begins with. Nothing is left of a training before.
    fn splats_at_start(&self, views: &[TrainingView], ui: &Ui) -> Result<Splats, Failure> {
        let _ = std::fs::remove_file(self.run.join(FIRST_SURFACE));
        let _ = std::fs::remove_dir_all(self.run.join(SNAPSHOTS));
        let (setup, seed) = (&self.setup, self.options.seed);
        Ok(match (self.sweep(views), self.recipe.start) {
            (Some(sweep), _) => {
                let first = sweep.run(ui)?;
                first.write(&self.run.join(FIRST_SURFACE))?;
                init::init_from_surface(&first, views)
            }
            (None, Start::Surface) => return Err(MatchError::no_pair(views).into()),
            (None, Start::Points) => init::init_from_points(&self.sparse, setup.area, seed),
            (None, Start::Box) => init::init_from_volume(setup.area, setup.altitudes, seed),
        })
    }

    /// The sweep that finds the surface, if the recipe has one and two views can be matched.
    fn sweep(&self, views: &[TrainingView]) -> Option<PlaneSweep> {
        let is_swept = self.recipe.start == Start::Surface;
        is_swept.then(|| PlaneSweep::new(&self.setup, views, &self.sparse)).flatten()
    }

    /// The surface that training starts on, if there is one.
    fn first_surface(&self) -> Result<Option<MatchedSurface>, Failure> {
        let path = self.run.join(FIRST_SURFACE);
        let is_used = self.recipe.start == Start::Surface && path.exists();
        Ok(is_used.then(|| MatchedSurface::read(&path, &self.setup.site)).transpose()?)
    }

    /// Writes a picture of the training after so many iterations, if one is due.
    fn take_picture(&self, backend: &mut CpuBackend, done: u32, ui: &Ui) {
        if !pictures::is_snapshot_due(self.options.snapshots, done, self.recipe.iterations) {
            return;
        }
        let watched = self.setup.reference_among_training();
        let view = backend.views()[watched].clone();
        let (state, shadows) = (backend.snapshot(), done > self.recipe.shadows_from);
        let appearance = &state.appearances[watched].0;
        let panels = pictures::panels(&view, &state.splats, appearance, self.setup.altitudes, shadows);
        // A picture less is no reason to stop.
        if let Err(e) = panels.write(&self.run.join(format!("{SNAPSHOTS}/{done:06}.png"))) {
            ui.event(Event::Warning(e.to_string()));
        }
    }

    /// Writes what training made; the surface is matched once more if there is one to start `from`.
    fn write(
        self,
        backend: &mut CpuBackend,
        from: Option<&MatchedSurface>,
        log: &[LogLine],
    ) -> Result<TrainedCameras, Failure> {
        let swept = self.sweep(backend.views()).zip(from);
        let names: Vec<String> = backend.views().iter().map(|v| v.name.clone()).collect();
        let Self { run, recipe, setup, .. } = self;
        let made = backend.snapshot();
        if let Some((sweep, first)) = &swept {
            let surface = if sweep.is_bettered_by_training() {
                let trained = altitudes(&made.splats, &setup.site, &sweep.grid());
                &sweep.sharpen(&trained, first)
            } else {
                first
            };
            surface.write(&run.join(SURFACE))?;
        }
        write_log(&run.join(TRAINING), log)?;
        pictures::curves(log).write(&run.join("train/curves.png"))?;
        let appearances = names.into_iter().zip(made.appearances.iter().map(|a| a.0)).collect();
        let cameras = TrainedCameras { setup, appearances, recipe, is_matched: swept.is_some() };
        cameras.write_splats(run, &made.splats)?;
        write_json(&run.join(CAMERAS), &cameras)?;
        Ok(cameras)
    }
}

/// What training made, in words and for `--json`; `splats` are their numbers at the start and at the end.
fn summary(
    run: &Path,
    cameras: &TrainedCameras,
    log: &[LogLine],
    splats: (usize, usize),
) -> (String, serde_json::Value) {
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
        run.join(SPLATS).display()
    );
    let json = serde_json::json!({
        "iterations": cameras.recipe.iterations, "seconds": seconds, "splats_start": at_start, "splats": at_end,
        "affine_rms_px": rms, "affine_max_px": worst, "l1": l1, "ssim": ssim,
    });
    (text, json)
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / f64::max(n, 1.0)
}

fn fingerprint(run: &Path, options: &Options, recipe: &Recipe) -> Result<Fingerprint, Failure> {
    // What --iterations scales is not told as a change of everything.
    let choices = serde_json::to_string(&options.recipe_as_written()?).unwrap_or_default();
    Ok(Fingerprint::from([
        // It covers the scene, but not where its files lie.
        ("adjustment".into(), hash_file(&run.join(ADJUSTMENT).join(STAGE))),
        ("--recipe".into(), recipe.name.clone()),
        ("what the recipe says".into(), hash(choices.as_bytes())),
        ("--iterations".into(), recipe.iterations.to_string()),
        ("--seed".into(), options.seed.to_string()),
    ]))
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
