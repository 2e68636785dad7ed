//! The training views of a satellite scene.

use super::novel_view::{NovelView, Picture};
use super::objective::{Gradient, SatelliteObjective, SatelliteStep};
use super::step_cameras::StepCameras;
use crate::affine::TrainingView;
use crate::nn::adam::AdamRule;
use crate::splat::appearance::satgs::Cube;
use crate::splat::appearance::{AppearanceKind, ModelParameters};
use crate::splat::backend::{BackendError, StepPlan, ViewModel};
use crate::splat::loss::target::TargetImage;
use crate::splat::loss::{Losses, TermInputs, terms};
use crate::splat::raster::FrameCamera;
use crate::splat::state::TrainingState;
use crate::splat::stopwatch::Stopwatch;
use crate::splat::visibility::{PatchVisibility, VisibilityModel};
use std::sync::Arc;

/// The input of a training of a satellite scene.
pub struct SatelliteScene {
    /// The training views.
    pub views: Arc<Vec<TrainingView>>,
    /// Lowest and highest altitude of the scene, metres above the site's origin.
    pub altitudes: (f64, f64),
    /// What some loss terms need.
    pub inputs: TermInputs<f32>,
    /// The colour model of the views.
    pub appearance: AppearanceKind,
    /// The cube that networks of the colour model cover.
    pub cube: Cube,
    /// What compares images with pictures, to find pixels that other images do not confirm; none if all pixels count alike.
    pub visibility: Option<VisibilityModel>,
}

/// The views of a satellite scene with the buffers of their iterations.
pub struct SatelliteViews {
    scene: SatelliteScene,
    objective: SatelliteObjective<f32>,
    gradient: Gradient<f32>,
    target: TargetImage,
}

impl SatelliteViews {
    /// The views of a scene whose training starts from a state, whose kind of splats stays.
    #[must_use]
    pub fn new(mut scene: SatelliteScene, start: &TrainingState) -> Self {
        let (terms, model) = (terms(std::mem::take(&mut scene.inputs)), scene.appearance.model(scene.cube));
        let objective = SatelliteObjective::new(start.splats.primitive(), model, terms);
        Self { scene, objective, gradient: Gradient::default(), target: TargetImage::default() }
    }

    /// The visibility of a view's patches; none where pixels count alike.
    ///
    /// # Errors
    /// [`BackendError`] if it cannot be computed.
    pub fn visibility(
        &self,
        state: &TrainingState,
        view: usize,
    ) -> Result<Option<PatchVisibility>, BackendError> {
        let patches = self.scene.visibility.as_ref().map(|model| model.patches(&state.visibility, view));
        Ok(patches.transpose()?.flatten())
    }
}

impl ViewModel for SatelliteViews {
    type Viewpoint = NovelView;
    type Picture = Picture;

    fn views(&self) -> usize {
        self.scene.views.len()
    }

    fn appearances(&self) -> usize {
        self.scene.views.len()
    }

    fn altitudes(&self) -> Option<(f64, f64)> {
        Some(self.scene.altitudes)
    }

    fn step(
        &mut self,
        state: &mut TrainingState,
        plan: &StepPlan,
        watch: &mut Stopwatch,
    ) -> Result<Losses, BackendError> {
        let Self { scene, objective, gradient, target } = self;
        let view = &scene.views[plan.view];
        let cameras @ StepCameras { camera, size, sun, virtual_view } =
            StepCameras::new(view, plan, scene.altitudes);
        target.load(view, plan.level);
        watch.lap("view", "image");
        let TrainingState { splats, adam, appearances, shared, visibility, statistics, anchored, .. } = state;
        let mask = match (&mut scene.visibility, plan.visibility) {
            (Some(model), Some(share)) => model.mask(visibility, plan.view, size, share)?,
            _ => None,
        };
        let input = SatelliteStep {
            camera: FrameCamera::new(&camera, size.0, size.1),
            visibility: mask,
            crop: plan.crop,
            target: &target.colors,
            valid: &target.valid,
            sun,
            virtual_view,
            background: plan.background,
            floor: scene.altitudes.0 as f32,
            anchored: anchored.anchorings(),
        };
        let (appearance, appearance_adam) = &mut appearances[plan.view];
        let share = plan.opacity_divisor.map_or(1.0, |divisor| splats.len() as f64 / divisor as f64);
        let parameters = ModelParameters { shared: &shared.values, view: &appearance.values };
        let weights = plan.weights.scaled(&["opacity"], share);
        let losses = objective.evaluate(splats, parameters, &input, &weights, gradient, watch);

        let to_half_sides = cameras.half_sides().map(|h| h as f32);
        let in_half_sides = |i: usize| {
            objective.mean2d_gradient(i).map(|g| [g[0] * to_half_sides[0], g[1] * to_half_sides[1]])
        };
        let (pixels_per_m, longer_side) = cameras.scale();
        statistics.add_view(in_half_sides, pixels_per_m, longer_side);
        watch.lap("splats", "statistics");

        appearance_adam.step(
            AdamRule::DEFAULT,
            &mut appearance.values,
            &gradient.appearance,
            plan.appearance_rate,
        );
        shared.step(&gradient.shared, &plan.network_rates);
        anchored.add_to_anchors(&mut gradient.splats);
        anchored.step(splats, |splats| adam.step(splats, &gradient.splats, &plan.rates));
        watch.lap("splats", "Adam");
        if let (Some(_), 0, Some(model)) = (plan.visibility, plan.level, &mut scene.visibility) {
            let draw = (plan.seed, plan.iteration.into());
            model.observe(visibility, plan.view, &target.colors, objective.picture(), draw)?;
            watch.lap("pixels", "visibility");
        }
        Ok(losses)
    }

    fn picture(&self, state: &TrainingState, from: &NovelView, view: usize) -> Picture {
        let (appearance, _) = &state.appearances[view];
        let parameters = ModelParameters { shared: &state.shared.values, view: &appearance.values };
        let model = self.scene.appearance.model(self.scene.cube);
        from.picture_of(&state.splats, model, parameters, self.scene.altitudes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::affine::{TrainingView, ViewCamera};
    use crate::frame::{Point, SiteGrid};
    use crate::io::Grid2;
    use crate::progress::NoProgress;
    use crate::random::CounterRng;
    use crate::splat::anchored::{Anchoring, StartSplats};
    use crate::splat::appearance::AppearanceKind;
    use crate::splat::appearance::satgs::Cube;
    use crate::splat::backend::{CpuBackend, TrainingBackend};
    use crate::splat::loss::TermInputs;
    use crate::splat::ply;
    use crate::splat::recipe::{Densification, OpacityReset, Recipe, RecipeKind};
    use crate::splat::splats::Splats;
    use crate::splat::train::{LogLine, Schedule, train};

    type Backend = CpuBackend<SatelliteViews>;

    /// The recipe with checks every 10 iterations, and shadows after 50.
    fn with_shadows(name: &str) -> Recipe {
        let mut recipe = Recipe { check_every: 10, ..Recipe::named(name).unwrap() };
        let RecipeKind::Satellite(satellite) = &mut recipe.kind else { unreachable!() };
        satellite.shadows_from = 50;
        recipe
    }

    /// A recipe with densification, shadows, consistency and an opacity reset within 200 iterations.
    fn compressed() -> Recipe {
        let mut recipe = with_shadows("baeogs");
        let RecipeKind::Satellite(satellite) = &mut recipe.kind else { unreachable!() };
        satellite.half_resolution_until = 30;
        recipe.iterations = 200;
        recipe.densification = recipe.densification.map(|g| Densification { from: 20, until: 150, ..g });
        recipe.reset = Some(OpacityReset {
            every: 100,
            opacity: 0.005,
            opacity_loss_pause: 10,
            densification_pause: 10,
            until: None,
        });
        recipe
    }

    fn loaded(start: StartSplats) -> Backend {
        loaded_at(start, [0.0; 2])
    }

    /// A scene, and splats that were moved with it, whose middle lies east and north of the site's origin, metres.
    fn loaded_at(start: StartSplats, [east, north]: [f64; 2]) -> Backend {
        let views: Vec<TrainingView> = (0..3u32)
            .map(|v| {
                let slope = 0.2 * (f64::from(v) - 1.0);
                let linear = [[2.0, 0.0, slope], [0.0, -2.0, 0.3 - slope]];
                let camera = ViewCamera::affine(linear, [29.5 - 2.0 * east, 27.5 + 2.0 * north]);
                let mut draw = CounterRng::new(7, u64::from(v), 0, 0);
                let mut pattern = |c: f64, r: f64| {
                    (0.5 + 0.3 * (c * 0.3).sin() * (r * 0.2).cos() + 0.1 * draw.uniform()) as f32
                };
                let plane = Grid2::from_fn(60, 56, |c, r| pattern(c as f64, r as f64));
                let area = (east - 14.0, north - 13.0, east + 14.0, north + 13.0);
                TrainingView::new(format!("v{v}"), camera, Some([1.1, -0.8]), &[plane], area, (0.0, 0.0))
            })
            .collect();
        let state = TrainingState::start(start, AppearanceKind::Affine, views.len(), 0);
        let (altitudes, appearance, cube) = ((-5.0, 10.0), AppearanceKind::Affine, Cube::default());
        let inputs = TermInputs::default();
        let scene =
            SatelliteScene { views: views.into(), altitudes, inputs, appearance, cube, visibility: None };
        CpuBackend::new(SatelliteViews::new(scene, &state), state).unwrap()
    }

    /// Splats all over the views, one in seven anchored to the one before it.
    fn splats_at_start() -> StartSplats {
        let mut splats = Splats::default();
        for i in 0..3000 {
            let mut d = CounterRng::new(1, 0, 0, i);
            let p = [28.0 * d.uniform() - 14.0, 26.0 * d.uniform() - 13.0, 3.0 * d.uniform()];
            splats.push(p.map(|v| v as f32), 0.4, 0.9, [0.5; 3]);
        }
        let anchoring = |splat: u32| Anchoring { splat, anchor: splat - 1 };
        let anchorings = (7..splats.len() as u32).step_by(7).map(anchoring).collect();
        StartSplats { splats, anchorings }
    }

    fn schedule(recipe: &Recipe) -> Schedule<'_> {
        Schedule {
            recipe,
            views: 3,
            half_side_m: 20.0,
            pixel_m: 0.3,
            splats_at_start: 3000,
            is_gray: false,
            seed: 0,
        }
    }

    fn trained(threads: usize) -> (TrainingState, Vec<usize>) {
        let (state, log) = trained_by(&compressed(), loaded(splats_at_start()), threads);
        (state, log.iter().map(|l| l.splats).collect())
    }

    fn trained_by(recipe: &Recipe, mut backend: Backend, threads: usize) -> (TrainingState, Vec<LogLine>) {
        let (schedule, mut log) = (schedule(recipe), Vec::new());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let no_callback = |_: &mut Backend, _: &[LogLine]| Ok::<_, BackendError>(());
            train(&mut backend, &schedule, &mut log, &NoProgress, |_| false, no_callback)
        })
        .unwrap();
        (backend.snapshot().unwrap().clone(), log)
    }

    #[test]
    fn a_training_does_not_depend_on_where_the_origin_of_the_site_lies() {
        for name in ["best", "eogs"] {
            let recipe = Recipe { iterations: 120, ..with_shadows(name) };
            let recipe =
                Recipe { densification: recipe.densification.and(compressed().densification), ..recipe };
            let of = |[east, north]: [f64; 2]| {
                let mut start = splats_at_start();
                for p in &mut start.splats.position {
                    *p = [p[0] + east as f32, p[1] + north as f32, p[2]];
                }
                let (state, log) = trained_by(&recipe, loaded_at(start, [east, north]), 2);
                let l1 = log[90..].iter().map(|line| line.column("l1")).sum::<f64>() / 30.0;
                (state.splats.len() as f64, l1)
            };
            let (at_origin, moved) = (of([0.0; 2]), of([640.0, -300.0]));
            assert!((moved.0 / at_origin.0 - 1.0).abs() < 0.02, "{name}: {at_origin:?} and {moved:?}");
            assert!((moved.1 / at_origin.1 - 1.0).abs() < 0.01, "{name}: {at_origin:?} and {moved:?}");
        }
    }

    #[test]
    fn a_splat_beyond_the_images_follows_its_anchor() {
        let mut start = splats_at_start();
        // Near the middle, and far away but at the same altitude, so that both stay neighbours in the order of altitudes.
        let near = (0..3000).min_by_key(|i| {
            start.splats.position[*i][..2].iter().map(|v| (100.0 * v.abs()) as i32).sum::<i32>()
        });
        let near = near.unwrap();
        let [_, _, z] = start.splats.position[near];
        start.splats.push([200.0, 0.0, z], 0.4, 0.9, [0.5; 3]);
        start.anchorings = vec![Anchoring { splat: 3000, anchor: near as u32 }];
        let mut backend = loaded(start);
        let offset = |backend: &mut Backend| {
            let TrainingState { splats, anchored, .. } = backend.snapshot().unwrap();
            let [Anchoring { splat, anchor }] = *anchored.anchorings() else { panic!("one is anchored") };
            let (own, of_anchor) = (splats.position[splat as usize], splats.position[anchor as usize]);
            (of_anchor, [0, 1, 2].map(|k| own[k] - of_anchor[k]))
        };
        let before = offset(&mut backend);
        let mut recipe = compressed();
        recipe.iterations = recipe.check_every - 1;
        let no_callback = |_: &mut Backend, _: &[LogLine]| Ok::<_, BackendError>(());
        train(&mut backend, &schedule(&recipe), &mut Vec::new(), &NoProgress, |_| false, no_callback)
            .unwrap();
        let after = offset(&mut backend);
        assert!(before.0 != after.0, "the anchor moved");
        assert!((0..3).all(|k| (before.1[k] - after.1[k]).abs() < 1e-4), "{:?} {:?}", before.1, after.1);
    }

    #[test]
    fn training_gives_the_same_bytes_with_1_2_and_16_threads() {
        let folder = tempfile::tempdir().unwrap();
        let bytes = |threads: usize| {
            let (state, counts) = trained(threads);
            let path = folder.path().join("splats.ply");
            let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.0, 3_357_611.0, -20.0) };
            ply::write(&path, &state.splats, &site).unwrap();
            (std::fs::read(&path).unwrap(), state, counts)
        };
        let one = bytes(1);
        let state = &one.1;
        // Most anchors were split or pruned.
        let anchored = state.anchored.anchorings().len();
        assert!((1..428).contains(&anchored) && state.fits(3), "{anchored} of 428 are still anchored");
        for threads in [2, 16] {
            // `assert_eq` would print megabytes.
            assert!(bytes(threads) == one, "{threads} threads and one thread give different splats");
        }
        let counts = one.2;
        assert!(
            counts.windows(2).any(|c| c[1] > c[0]) && counts.windows(2).any(|c| c[1] < c[0]),
            "{counts:?}"
        );
    }
}
