//! One training of a run: what it reads, starts from and writes.

use super::super::run_folder::stage::adjustment_fingerprint;
use super::super::{PipelineError, TrainOptions, TrainedCameras, predict};
use crate::affine::{SiteScene, TrainingView};
use crate::bundle::Adjustment;
use crate::checkpoint::PartStore;
use crate::dsm::altitudes;
use crate::frame::{Point, Site};
use crate::io::{RgbImage, write_json};
use crate::mvs::{MatchError, MatchedSurface, PlaneSweep, angle_warning};
use crate::predict::Predictor;
use crate::progress::{Event, Progress};
use crate::run_files::{ADJUSTMENT, CAMERAS, FIRST_SURFACE, HEIGHT_SPLATS, MATCHING, SURFACE, TRAIN_STAGE};
use crate::scene::{Role, Scene, SearchedHeights};
use crate::splat::anchored::StartSplats;
use crate::splat::appearance::{Appearance, AppearanceKind, affine};
use crate::splat::backend::{BackendError, TrainingBackend};
use crate::splat::init;
use crate::splat::ply;
use crate::splat::primitive::PrimitiveKind;
use crate::splat::recipe::{Recipe, SatelliteRecipe, Start};
use crate::splat::satellite::{NovelView, Picture};
use crate::splat::splats::Splats;
use crate::splat::state::TrainingState;
use crate::splat::train::pictures;
use std::path::{Path, PathBuf};

/// A training: what it is of, and how it is done.
pub struct Training<'a> {
    run: &'a Path,
    options: &'a TrainOptions,
    pub recipe: Recipe<SatelliteRecipe>,
    pub setup: SiteScene,
    /// What gave the heights between which the surface is searched.
    heights: SearchedHeights,
    /// The sparse points in the area.
    sparse: Vec<Point<Site>>,
}

impl<'a> Training<'a> {
    /// The training of a run's scene as it was adjusted.
    pub fn new(
        run: &'a Path,
        options: &'a TrainOptions,
        recipe: Recipe<SatelliteRecipe>,
        scene: &Scene,
    ) -> Result<Self, PipelineError> {
        let adjustment = Adjustment::read(&run.join(ADJUSTMENT))?;
        let points = adjustment.positions();
        let cameras = adjustment.cameras_of(scene)?;
        let mut setup = match &options.frame {
            Some(frame) => SiteScene::in_frame(scene, &cameras, frame.clone())?,
            None => SiteScene::new(scene, &cameras, &points)?,
        };
        setup.transfer_function = setup.transfer_function.with_white(recipe.kind.white);
        for view in setup.views.iter().filter(|v| v.sun_shear.is_none()) {
            tracing::info!("view `{}` has no usable sun: it trains without shadows", view.name);
        }
        let sparse = setup.sparse(&points);
        let heights = scene.heights_with(points.iter().map(|p| p.height_m()));
        Ok(Self { run, options, recipe, setup, heights, sparse })
    }

    /// Finds the surface by matching, if the recipe has one, and writes it. That of a training before is removed. What matching finds
    /// is stored until the training is complete.
    pub fn match_surface(
        &self,
        views: &[TrainingView],
        progress: &dyn Progress,
    ) -> Result<(), PipelineError> {
        let _ = std::fs::remove_file(self.run.join(FIRST_SURFACE));
        if let Some(sweep) = self.sweep(views) {
            let (origin_m, (low, high)) = (self.setup.site.origin.z(), self.setup.searched);
            let heights = SearchedHeights { low_m: origin_m + low, high_m: origin_m + high, ..self.heights };
            progress.event(Event::Note(format!("heights searched: {heights}")));
            if let Some(warning) = angle_warning(views) {
                progress.event(Event::Warning(warning));
            }
            let parts = PartStore::new(self.matching(), self.matched_from()?);
            progress.event(Event::Resumable(true));
            sweep.run(Some(&parts), progress)?.write(&self.run.join(FIRST_SURFACE))?;
            progress.event(Event::Resumable(false));
        }
        Ok(())
    }

    /// Removes what matching has stored.
    pub fn forget_matching(&self) {
        PartStore::new(self.matching(), "").remove();
    }

    /// The folder of what matching stores.
    fn matching(&self) -> PathBuf {
        self.run.join(TRAIN_STAGE).join(MATCHING)
    }

    /// All that the matched surface depends on.
    fn matched_from(&self) -> Result<String, PipelineError> {
        let setup = serde_json::to_string(&self.setup);
        let setup =
            setup.map_err(|source| PipelineError::Json { what: "the scene of the training", source })?;
        Ok(format!("{:?} {setup}", adjustment_fingerprint(self.run)))
    }

    /// Extends the altitudes of splats to the surface that training starts on. Without one, they may lie wherever an option or an
    /// elevation model says that the surface is, else near the tie points.
    pub fn bound_altitudes(&mut self, first: Option<&MatchedSurface>) {
        match first.and_then(MatchedSurface::altitudes) {
            Some(found) => self.setup.include_surface(found),
            None if self.heights.is_stated() => self.setup.altitudes = self.setup.searched,
            None => {}
        }
    }

    /// The state that training begins with on the `first` surface, if there is one. The colour models of the views are those that
    /// were predicted with the splats, if they were.
    pub fn state_at_start(
        &self,
        views: &[TrainingView],
        first: Option<&MatchedSurface>,
        progress: &dyn Progress,
    ) -> Result<TrainingState, PipelineError> {
        let (start, appearances) = self.splats_at_start(views, first, progress)?;
        let kind = self.recipe.kind.appearance;
        let mut state = TrainingState::start(start, kind, views.len(), self.options.seed);
        let predicted = appearances.into_iter().filter(|appearance| appearance.kind == kind);
        state.appearances.iter_mut().zip(predicted).for_each(|((own, _), predicted)| *own = predicted);
        Ok(state)
    }

    fn splats_at_start(
        &self,
        views: &[TrainingView],
        first: Option<&MatchedSurface>,
        progress: &dyn Progress,
    ) -> Result<(StartSplats, Vec<Appearance>), PipelineError> {
        let (setup, seed) = (&self.setup, self.options.seed);
        let primitive = self.recipe.primitive;
        let (mut start, appearances) = match (self.predicted(views, first, progress)?, first) {
            (Some((splats, appearances)), _) => (splats.into(), appearances),
            (None, Some(first)) => (init::init_from_surface(first, views, primitive), Vec::new()),
            (None, None) => match self.recipe.kind.start {
                Start::Surface => return Err(MatchError::no_pair(views).into()),
                Start::Points => (init::init_from_points(&self.sparse, setup.area, seed).into(), Vec::new()),
                Start::Volume => {
                    (init::init_from_volume(setup.area, setup.altitudes, seed).into(), Vec::new())
                }
            },
        };
        if primitive == PrimitiveKind::Disc {
            start.splats.flatten();
        }
        Ok((start, appearances))
    }

    /// The splats that are predicted for the start, if it is one from these.
    fn predicted(
        &self,
        views: &[TrainingView],
        surface: Option<&MatchedSurface>,
        progress: &dyn Progress,
    ) -> Result<Option<(Splats, Vec<Appearance>)>, PipelineError> {
        let scene = adjustment_fingerprint(self.run);
        if let Some((mut splats, lights)) = predict::read_predicted(self.run, &scene, Some(&self.setup.site))?
        {
            let light_of = |view: &TrainingView| {
                let own = lights.iter().find(|(name, _)| *name == view.name);
                own.map_or_else(Appearance::default, |(_, light)| light.clone())
            };
            let mut lights: Vec<Appearance> = views.iter().map(light_of).collect();
            // Predictions are made with a white of one; offsets are colours too.
            let white = self.recipe.kind.white;
            if !self.setup.transfer_function.is_linear() && white != 1.0 {
                splats.recolor(|v| white * v);
                let affine = lights.iter_mut().filter(|light| light.kind == AppearanceKind::Affine);
                affine.for_each(|light| affine::scale(&mut light.values, white));
            }
            return Ok(Some((splats, lights)));
        }
        if !self.options.predict {
            return Ok(None);
        }
        let points = match surface {
            Some(surface) => predict::of_surface(surface),
            None => self.sparse.iter().map(|p| p.xyz()).collect(),
        };
        let model = Predictor::built_in()?;
        let made = predict::of_points(&self.setup, views, &points, &model, None, progress)?;
        Ok(Some((made.splats, made.lights)))
    }

    /// The sweep that finds the surface, if the recipe has one and two views can be matched.
    fn sweep(&self, views: &[TrainingView]) -> Option<PlaneSweep> {
        let is_swept = self.recipe.kind.start == Start::Surface;
        is_swept.then(|| PlaneSweep::new(&self.setup, views, &self.sparse)).flatten()
    }

    /// The surface that training starts on, if there is one.
    pub fn first_surface(&self) -> Result<Option<MatchedSurface>, PipelineError> {
        let path = self.run.join(FIRST_SURFACE);
        let is_used = self.recipe.kind.start == Start::Surface && path.exists();
        Ok(is_used.then(|| MatchedSurface::read(&path, &self.setup.site)).transpose()?)
    }

    /// A picture of the training after so many iterations.
    pub fn picture<B: TrainingBackend<Viewpoint = NovelView, Picture = Picture> + ?Sized>(
        &self,
        backend: &mut B,
        views: &[TrainingView],
        done: u32,
    ) -> Result<RgbImage, BackendError> {
        let watched = self.setup.reference_among_training();
        let panels = pictures::Panels::new(&views[watched], done > self.recipe.kind.shadows_from);
        let picture = backend.render(&panels.from, watched)?;
        Ok(panels.draw(picture, self.setup.altitudes))
    }

    /// Whether the surface is matched once more, with the trained splats. Few views do not refine it.
    pub fn refines_surface(&self) -> bool {
        let views = self.setup.views.iter().filter(|view| view.role == Role::Train).count();
        PlaneSweep::can_refine(views) && !self.options.no_splats
    }

    /// The cameras of a state of the training.
    pub fn cameras(
        &self,
        state: &TrainingState,
        views: &[TrainingView],
        from: Option<&MatchedSurface>,
    ) -> TrainedCameras {
        let names = views.iter().map(|v| v.name.clone());
        TrainedCameras {
            setup: self.setup.clone(),
            appearances: names.zip(state.appearances.iter().map(|a| a.0.clone())).collect(),
            recipe: self.recipe.clone(),
            is_matched: from.is_some(),
        }
    }

    /// Writes what training made, of the surface that it started `from`, if there is one.
    pub fn write(
        &self,
        made: &TrainingState,
        views: &[TrainingView],
        from: Option<&MatchedSurface>,
    ) -> Result<TrainedCameras, PipelineError> {
        let sweep = from.filter(|_| self.refines_surface()).and_then(|_| self.sweep(views));
        let run = self.run;
        if let Some(first) = from {
            let refined = sweep.map(|mut sweep| {
                let trained = altitudes(&made.splats, &self.setup.site, &sweep.grid());
                sweep.refine(&trained, first)
            });
            refined.as_ref().unwrap_or(first).write(&run.join(SURFACE))?;
        }
        let cameras = self.cameras(made, views, from);
        cameras.write_splats(run, &made.splats)?;
        if cameras.recipe.kind.then.is_some() {
            let shown = cameras.read_shown_splats(run)?;
            ply::write(&run.join(HEIGHT_SPLATS), &shown, &cameras.setup.site)?;
        }
        write_json(&run.join(CAMERAS), &cameras)?;
        Ok(cameras)
    }
}
