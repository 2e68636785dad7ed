//! The options of a training.

use super::PipelineError;
use super::gpu_support::unsupported_heights;
use crate::affine::SiteFrame;
use crate::prior::{InpaintCommand, PriorSource, PriorSources};
use crate::splat::backend::DeviceChoice;
use crate::splat::primitive::PrimitiveKind;
use crate::splat::recipe::{
    OfScene, PerspectiveRecipe, Recipe, RecipeKind, SatelliteRecipe, Start, StartPoints,
};
use std::path::{Path, PathBuf};

/// How to train.
#[derive(Clone, Debug)]
pub struct TrainOptions {
    /// Name of a recipe ([`Recipe::NAMES`]) or path of a TOML file with one.
    pub recipe: String,
    /// The kind of splats; by default the recipe's.
    pub primitive: Option<PrimitiveKind>,
    /// The points that training of photographs starts from; by default the recipe's.
    pub start: Option<StartPoints>,
    /// Start from splats that are predicted of the matched surface, or of the points of the scene without one. A run that `predict`
    /// made starts from its splats in any case.
    pub predict: bool,
    /// Whether scenes without points start from their depth maps, and align priors with these, also where they are a reference that
    /// no survey has (LEVIR-NVS, ScanNet++).
    pub reference_points: bool,
    /// Number of iterations, to which the recipe's schedule is scaled; by default the recipe's own.
    pub iterations: Option<u32>,
    /// Stop at the matched surface: no splats are trained, and the orthophoto is rendered from those that training would start
    /// from.
    pub no_splats: bool,
    /// Seed of all random numbers. The same seed gives the same bytes.
    pub seed: u64,
    /// Which device trains; what can train on a GPU is in docs/guide/gpu.md.
    pub device: DeviceChoice,
    /// Iterations from one checkpoint to the next.
    pub checkpoint_every: u32,
    /// Fail unless there is a checkpoint to continue from.
    pub resume: bool,
    /// Number of pictures of the progress to write; 0 for none.
    pub snapshots: u32,
    /// The frame of the training scene, if it is part of a larger scene; by default, views and sparse points determine it.
    pub frame: Option<SiteFrame>,
    /// ONNX file of a network whose features find pixels that other images do not confirm, for recipes that leave these out;
    /// by default, features that need no network.
    pub features: Option<PathBuf>,
    /// Safetensors file of the network of the perceptual loss, for recipes with that loss; without one they train without.
    pub lpips: Option<PathBuf>,
    /// Depths and normals of the images, for recipes that compare the splats with them.
    pub priors: PriorSources,
    /// The command that gives holes of pseudo-views colours, for starts that have these; by default colours of what is near.
    pub inpaint: Option<InpaintCommand>,
    /// Train again, whatever the run folder holds.
    pub overwrite: bool,
}

impl Default for TrainOptions {
    fn default() -> Self {
        Self {
            recipe: Recipe::NAMES[0].into(),
            primitive: None,
            start: None,
            predict: false,
            reference_points: false,
            iterations: None,
            no_splats: false,
            seed: 0,
            device: DeviceChoice::default(),
            checkpoint_every: 500,
            resume: false,
            snapshots: 0,
            frame: None,
            features: None,
            lpips: None,
            priors: PriorSources::default(),
            inpaint: None,
            overwrite: false,
        }
    }
}

impl TrainOptions {
    /// The recipe that is asked for, scaled to `iterations`.
    ///
    /// # Errors
    /// [`PipelineError::Recipe`] when it cannot be read, [`PipelineError::Option`] for a number of iterations of 0.
    pub fn recipe(&self) -> Result<Recipe, PipelineError> {
        let recipe = self.recipe_as_written()?;
        match self.iterations {
            Some(0) => Err(PipelineError::Option {
                option: "--iterations",
                found: "0".into(),
                expected: "a number from 1 on",
            }),
            Some(iterations) => Ok(recipe.with_iterations(iterations)),
            None => Ok(recipe),
        }
    }

    /// As [`TrainOptions::recipe`], of a satellite scene.
    ///
    /// # Errors
    /// Also [`PipelineError::RecipeOfPerspective`].
    pub fn satellite_recipe(&self) -> Result<Recipe<SatelliteRecipe>, PipelineError> {
        let any = self.recipe()?;
        let Some(recipe) = any.clone().of_kind::<SatelliteRecipe>() else {
            return Err(PipelineError::RecipeOfPerspective { recipe: any.name });
        };
        if let DeviceChoice::Gpu(_) = self.device {
            let trainings = [Some(&recipe), recipe.kind.then.as_deref()];
            if let Some(why) = trainings.into_iter().flatten().find_map(unsupported_heights) {
                let found = format!("{}, but {why}", self.device);
                return Err(PipelineError::Option { option: "--device", found, expected: "auto or cpu" });
            }
        }
        if self.no_splats && (recipe.kind.start != Start::Surface || recipe.kind.then.is_some()) {
            let found = format!("given with recipe `{}`", recipe.name);
            let expected = "a recipe whose heights are matched, and nothing more: best";
            return Err(PipelineError::Option { option: "--no-splats", found, expected });
        }
        self.require_use(&any)?;
        Ok(recipe)
    }

    /// As [`TrainOptions::recipe`], of a perspective scene.
    ///
    /// # Errors
    /// Also [`PipelineError::RecipeOfSatellites`].
    pub fn perspective_recipe(&self) -> Result<Recipe<PerspectiveRecipe>, PipelineError> {
        let any = self.recipe()?;
        let Some(recipe) = any.clone().of_kind() else {
            return Err(PipelineError::RecipeOfSatellites { recipe: any.name });
        };
        self.require_use(&any)?;
        Ok(recipe)
    }

    /// An error, if the recipe makes nothing of a file that is given.
    fn require_use(&self, recipe: &Recipe) -> Result<(), PipelineError> {
        let weighs = |names: &[&str]| names.iter().any(|name| recipe.weights.get(name) > 0.0);
        let PriorSources { depths, normals, .. } = &self.priors;
        let of_colors =
            (recipe.satellite().is_some_and(|s| s.then.is_some()), "none: of the recipes, satgs uses it");
        let needs_depths = recipe.perspective().is_some_and(|p| p.start_points.needs_depths());
        let of_depths = weighs(&["depth_prior", "depth_smoothness"]) || needs_depths;
        let file = |path: &Option<PathBuf>| path.as_ref().map(|path| path.display().to_string());
        let source = |source: &Option<PriorSource>| source.as_ref().map(ToString::to_string);
        let depths_expected = "none: recipes 2dgs, indoor and geoprop use it, and --start does";
        let is_completed = recipe.perspective().is_some_and(|p| p.start_points == StartPoints::Gva);
        let inpaint = self.inpaint.as_ref().map(|command| command.text().to_owned());
        let normals_expected = "none: of the recipes, indoor uses it";
        let given = [
            ("--features", file(&self.features), of_colors),
            ("--lpips", file(&self.lpips), of_colors),
            ("--depth-prior", source(depths), (of_depths, depths_expected)),
            ("--inpaint", inpaint, (is_completed, "none: recipe geoprop and --start gva use it")),
            ("--normal-prior", source(normals), (weighs(&["normal_prior"]), normals_expected)),
        ];
        for (option, found, (is_used, expected)) in given {
            if let Some(found) = found.filter(|_| !is_used) {
                return Err(PipelineError::Option { option, found, expected });
            }
        }
        Ok(())
    }

    /// The recipe for a number of training views: few of them need fewer iterations than it has, unless a number is
    /// asked for.
    pub(crate) fn recipe_for(&self, views: usize) -> Result<Recipe<SatelliteRecipe>, PipelineError> {
        Ok(self.for_views(self.satellite_recipe()?, views))
    }

    /// As [`TrainOptions::recipe_for`], of a perspective scene.
    pub(crate) fn perspective_recipe_for(
        &self,
        views: usize,
    ) -> Result<Recipe<PerspectiveRecipe>, PipelineError> {
        Ok(self.for_views(self.perspective_recipe()?, views))
    }

    fn for_views<K: OfScene>(&self, recipe: Recipe<K>, views: usize) -> Recipe<K> {
        if self.iterations.is_some() { recipe } else { recipe.for_views(views) }
    }

    /// The recipe with its own number of iterations, for the kind of splats that is asked for.
    pub(super) fn recipe_as_written(&self) -> Result<Recipe, PipelineError> {
        let recipe = match Recipe::named(&self.recipe) {
            Some(recipe) => recipe,
            None => Recipe::read(Path::new(&self.recipe))?,
        };
        let mut recipe = Recipe { primitive: self.primitive.unwrap_or(recipe.primitive), ..recipe };
        if let Some(start_points) = self.start {
            let RecipeKind::Perspective(perspective) = &mut recipe.kind else {
                return Err(PipelineError::Option {
                    option: "--start",
                    found: format!("given with recipe `{}`", recipe.name),
                    expected: "a recipe of perspective scenes",
                });
            };
            perspective.start_points = start_points;
        }
        if self.reference_points && recipe.perspective().is_none() {
            let found = format!("given with recipe `{}`", recipe.name);
            let expected = "a recipe of perspective scenes";
            return Err(PipelineError::Option { option: "--reference-points", found, expected });
        }
        if recipe.idle_weight().is_some() {
            let expected = "2d: the recipe has loss terms of discs";
            return Err(PipelineError::Option { option: "--primitive", found: "3d".into(), expected });
        }
        Ok(recipe)
    }
}
