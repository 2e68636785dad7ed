//! How a scene is cut into tiles, and how these are trained and rendered.

use super::error::TilesError;
use super::plan::{PlannedFile, TileSurface, TileTraining, adjustment_hash};
use crate::io::VerticalReference;
use crate::mvs::DSM_CELL_M;
use crate::pipeline::{Fingerprint, PipelineError, TrainOptions, hash, hash_file, or_none};
use crate::splat::recipe::Recipe;
use std::path::Path;

/// Smallest side of a core, as a multiple of the overlap: strips on opposite sides of a tile must not touch.
pub(super) const CORE_PER_OVERLAP: f64 = 2.0;
/// File of a recipe that is not one of the built-in ones, in the run folder.
pub(super) const RECIPE: &str = "tiles/recipe.toml";

/// How to cut a scene into tiles.
#[derive(Clone, Debug)]
pub struct PlanOptions {
    /// Largest side of the core of a tile, metres.
    pub core_m: f64,
    /// Width of the overlap around a core, metres.
    pub overlap_m: f64,
    /// Memory that a tile may take, megabytes; cores are halved until the prediction is below it.
    pub max_memory_mb: Option<f64>,
    /// Side of a cell of the rasters, metres.
    pub resolution_m: f64,
    /// How the surfaces are rendered.
    pub surface: TileSurface,
    /// How tiles are trained: recipe, iterations and seed.
    pub train: TrainOptions,
    /// Plan again, whatever the run folder holds.
    pub overwrite: bool,
}

impl Default for PlanOptions {
    fn default() -> Self {
        Self {
            core_m: 512.0,
            overlap_m: 32.0,
            max_memory_mb: None,
            resolution_m: DSM_CELL_M,
            surface: TileSurface::default(),
            train: TrainOptions::default(),
            overwrite: false,
        }
    }
}

impl PlanOptions {
    /// Checks the options that need no scene.
    ///
    /// # Errors
    /// [`PipelineError`] of the option that is wrong.
    pub fn check(&self) -> Result<(), PipelineError> {
        let wrong = |option, found: f64, expected| {
            Err(PipelineError::Option { option, found: found.to_string(), expected })
        };
        if !(self.resolution_m.is_finite() && self.resolution_m > 0.0) {
            return wrong("--resolution", self.resolution_m, "metres above 0");
        }
        if !(self.overlap_m.is_finite() && self.overlap_m >= 4.0 * self.resolution_m) {
            return wrong("--overlap", self.overlap_m, "metres, at least four cells of the surface model");
        }
        if !(self.core_m.is_finite() && self.core_m >= CORE_PER_OVERLAP * self.overlap_m) {
            return wrong("--core", self.core_m, "metres, at least twice the overlap");
        }
        if self.surface.no_fill && self.surface.fill_m.is_some() {
            let found = "given with --fill".into();
            return Err(PipelineError::Option { option: "--no-fill", found, expected: "one of the two" });
        }
        self.surface.found()?;
        self.train.satellite_recipe().map(|_| ())
    }
}

impl TileTraining {
    /// How tiles are trained by these options, which are all named, so that none is forgotten: `recipe` is made of the recipe,
    /// the kind of splats and the points to start from; of the others, those of photographs are refused by the recipe.
    pub(super) fn of(options: &TrainOptions, made: &Recipe) -> Self {
        let TrainOptions {
            recipe,
            primitive,
            start: _,
            predict,
            reference_points: _,
            iterations,
            no_splats,
            seed,
            device: _,
            checkpoint_every: _,
            resume: _,
            snapshots,
            frame: _,
            features,
            lpips,
            priors: _,
            inpaint: _,
            overwrite: _,
        } = options;
        let is_named = Recipe::named(recipe).is_some() && primitive.is_none();
        Self {
            recipe: if is_named { recipe.clone() } else { RECIPE.into() },
            recipe_hash: hash(made.to_toml().as_bytes()),
            iterations: *iterations,
            no_splats: *no_splats,
            seed: *seed,
            predict: *predict,
            snapshots: *snapshots,
            features: features.as_deref().map(PlannedFile::of),
            lpips: lpips.as_deref().map(PlannedFile::of),
        }
    }
}

impl TileSurface {
    /// The same with the absolute path and the hash of a grid, because jobs run in other folders.
    pub(super) fn found(&self) -> Result<Self, PipelineError> {
        let Some(vertical) = &self.vertical else { return Ok(self.clone()) };
        VerticalReference::read(vertical)?;
        let path = Path::new(vertical);
        if !path.is_file() {
            return Ok(self.clone());
        }
        let absolute =
            path.canonicalize().map_or_else(|_| vertical.clone(), |p| p.to_string_lossy().into_owned());
        Ok(Self { vertical: Some(absolute), vertical_hash: Some(hash_file(path)), ..self.clone() })
    }
}

/// What a plan is made from; its keys are the names of options on the command line.
pub(super) fn fingerprint(run: &Path, options: &PlanOptions) -> Result<Fingerprint, TilesError> {
    let (recipe, surface) = (options.train.recipe()?, options.surface.found()?);
    let train = TileTraining::of(&options.train, &recipe);
    let mut fingerprint = Fingerprint::from([
        ("adjustment".into(), adjustment_hash(run)?),
        ("--core".into(), options.core_m.to_string()),
        ("--overlap".into(), options.overlap_m.to_string()),
        ("--max-memory".into(), or_none(options.max_memory_mb)),
        ("--resolution".into(), options.resolution_m.to_string()),
        ("--vertical".into(), or_none(surface.vertical.as_ref())),
        ("content of --vertical".into(), or_none(surface.vertical_hash.as_ref())),
        ("--fill".into(), or_none(surface.fill_m)),
        ("--recipe".into(), recipe.name.clone()),
        ("content of the recipe".into(), hash(recipe.to_toml().as_bytes())),
        ("--iterations".into(), recipe.iterations.to_string()),
        ("--seed".into(), options.train.seed.to_string()),
    ]);
    // Keys of what is not usual are there only if it is given, so that plans without it stay what they are.
    let hash_of = |file: &Option<PlannedFile>| file.as_ref().map(|file| file.hash.clone());
    let more = [
        ("--start", train.predict.then(|| "predict".to_owned())),
        ("--snapshots", (train.snapshots > 0).then(|| train.snapshots.to_string())),
        ("--features", hash_of(&train.features)),
        ("--lpips", hash_of(&train.lpips)),
        ("--no-splats", train.no_splats.then(|| "given".to_owned())),
        ("--no-fill", surface.no_fill.then(|| "given".to_owned())),
    ];
    fingerprint.extend(more.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?))));
    Ok(fingerprint)
}
