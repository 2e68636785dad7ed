//! The reference backend: iterations on the processor's cores.

use crate::affine::TrainingView;
use crate::splat::backend::stopwatch::Stopwatch;
use crate::splat::backend::{StepPlan, StepReport, TrainingBackend};
use crate::splat::loss::surface_prior::SurfacePrior;
use crate::splat::loss::target::TargetImage;
use crate::splat::objective::{Gradient, Objective, ShearedCamera, StepInput};
use crate::splat::raster::{FrameCamera, Image};
use crate::splat::state::TrainingState;

/// Splats, radiometry and their moments in memory.
pub struct CpuBackend {
    views: Vec<TrainingView>,
    /// Lowest and highest altitude of the scene, metres above the site's origin.
    altitudes: (f64, f64),
    hold: Option<SurfacePrior>,
    state: TrainingState,
    objective: Objective<f32>,
    gradient: Gradient<f32>,
    target: TargetImage,
    watch: Stopwatch,
}

impl CpuBackend {
    /// A backend that goes on from `state` with as many `views`; the scene lies between `altitudes`. Splats are pulled
    /// to what `hold` says.
    #[must_use]
    pub fn new(
        state: TrainingState,
        views: Vec<TrainingView>,
        altitudes: (f64, f64),
        hold: Option<SurfacePrior>,
    ) -> Self {
        Self {
            views,
            altitudes,
            hold,
            state,
            objective: Objective::default(),
            gradient: Gradient::default(),
            target: TargetImage::default(),
            watch: Stopwatch::default(),
        }
    }

    /// The views it trains on.
    #[must_use]
    pub fn views(&self) -> &[TrainingView] {
        &self.views
    }

    /// The picture of the last step, as the view sees it.
    #[must_use]
    pub fn picture(&self) -> &Image<f32> {
        self.objective.picture()
    }

    /// Where the time of the steps went.
    #[must_use]
    pub fn times(&self) -> &Stopwatch {
        &self.watch
    }

    fn change_population(&mut self, plan: &StepPlan, report: &mut StepReport) {
        let (p, state) = (&plan.population, &mut self.state);
        if let Some((rule, half_side_m)) = &p.grow {
            report.change.grown = state.grow(rule, *half_side_m, (p.seed, u64::from(plan.iteration)));
        }
        if let Some(opacity) = p.prune_below {
            report.change.pruned = state.prune(opacity, self.altitudes);
            state.statistics.reset(state.splats.len());
        }
        if let Some(opacity) = p.reset_opacity {
            state.reset_opacity(opacity);
        }
        if p.prune_below.is_some() {
            state.sort_by_altitude();
        }
    }
}

impl TrainingBackend for CpuBackend {
    fn step(&mut self, plan: &StepPlan) -> StepReport {
        let watch = &mut self.watch;
        watch.begin();
        let view = &self.views[plan.view];
        let scale = 0.5f64.powi(plan.level as i32);
        let camera = self.target.load(view, plan.level);
        let TargetImage { colors: truth, valid } = &self.target;
        watch.lap("view", "image");
        let size = (truth.width, truth.height);
        let half_sides = [0.5 * size.0 as f64, 0.5 * size.1 as f64];
        let sun = view.sun_shear.filter(|_| plan.shadows).map(|s| s.map(|s| s * scale));
        let virtual_shear = plan.virtual_shear.map(|s| [s[0] * half_sides[0], s[1] * half_sides[1]]);
        let shot = StepInput {
            camera: FrameCamera::new(&camera, size.0, size.1),
            truth,
            valid,
            sun: sun.map(|s| ShearedCamera::sun(&camera, size, s, self.altitudes)),
            virtual_view: virtual_shear.map(|s| ShearedCamera::virtual_view(&camera, size, s)),
            background: plan.background,
            floor: self.altitudes.0 as f32,
        };
        let TrainingState { splats, adam, appearances, statistics } = &mut self.state;
        let (appearance, appearance_adam) = &mut appearances[plan.view];
        let gradient = &mut self.gradient;
        let losses = self.objective.evaluate(splats, appearance, &shot, &plan.weights, gradient, watch);

        if let Some(hold) = &self.hold {
            hold.pull(splats, &mut gradient.splats);
        }

        let to_half_sides = half_sides.map(|h| h as f32);
        let seen =
            |i: usize| self.objective.seen(i).map(|g| [g[0] * to_half_sides[0], g[1] * to_half_sides[1]]);
        statistics.rendered(seen, 1.0 / camera.gsd_m(), size.0.max(size.1) as f64);
        watch.lap("splats", "statistics");

        appearance_adam.step(appearance, &gradient.appearance, plan.appearance_rate);
        adam.step(splats, &gradient.splats, &plan.rates);
        watch.lap("splats", "Adam");

        let mut report = StepReport { losses, ..StepReport::default() };
        self.change_population(plan, &mut report);
        self.watch.lap("splats", "growth and pruning");
        report.splats = self.state.splats.len();
        report
    }

    fn snapshot(&mut self) -> &TrainingState {
        &self.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::affine::AffineCamera;
    use crate::frame::{Point, SiteGrid};
    use crate::io::Plane;
    use crate::progress::NoProgress;
    use crate::random::CounterRng;
    use crate::splat::ply;
    use crate::splat::splats::Splats;
    use crate::splat::train::recipe::{Densification, Recipe, Reset};
    use crate::splat::train::{Schedule, train};
    use std::convert::Infallible;

    /// Densification, shadows, consistency and a reset within 200 iterations.
    fn compressed() -> Recipe {
        let mut recipe = Recipe::named("baeogs").unwrap();
        recipe.iterations = 200;
        recipe.half_resolution_until = 30;
        recipe.shadows_from = 50;
        recipe.check_every = 10;
        recipe.growth = recipe.growth.map(|g| Densification { from: 20, until: 150, ..g });
        recipe.reset = Some(Reset { every: 100, opacity: 0.005, opacity_loss_rests: 10, growth_rests: 10 });
        recipe
    }

    fn backend() -> CpuBackend {
        let views: Vec<TrainingView> = (0..3u32)
            .map(|v| {
                let lean = 0.2 * (f64::from(v) - 1.0);
                let linear = [[2.0, 0.0, lean], [0.0, -2.0, 0.3 - lean]];
                let camera = AffineCamera { linear, offset: [29.5, 27.5] };
                let mut draw = CounterRng::new(7, u64::from(v), 0, 0);
                let mut pattern = |c: f64, r: f64| {
                    (0.5 + 0.3 * (c * 0.3).sin() * (r * 0.2).cos() + 0.1 * draw.uniform()) as f32
                };
                let plane = Plane::from_fn(60, 56, |c, r| pattern(c as f64, r as f64));
                let area = (-14.0, -13.0, 14.0, 13.0);
                TrainingView::new(format!("v{v}"), camera, Some([1.1, -0.8]), &[plane], area)
            })
            .collect();
        let mut start = Splats::default();
        for i in 0..3000 {
            let mut d = CounterRng::new(1, 0, 0, i);
            let p = [28.0 * d.uniform() - 14.0, 26.0 * d.uniform() - 13.0, 3.0 * d.uniform()];
            start.push(p.map(|v| v as f32), 0.4, 0.9, [0.5; 3]);
        }
        CpuBackend::new(TrainingState::start(start, views.len()), views, (-5.0, 10.0), None)
    }

    fn trained(threads: usize) -> (TrainingState, Vec<usize>) {
        let (mut backend, mut log) = (backend(), Vec::new());
        let recipe = compressed();
        let schedule = Schedule {
            recipe: &recipe,
            views: 3,
            half_side_m: 20.0,
            pixel_m: 0.3,
            splats_at_start: 3000,
            seed: 0,
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            train(&mut backend, &schedule, &mut log, &NoProgress, |_, _| Ok::<_, Infallible>(()))
        })
        .unwrap();
        (backend.snapshot().clone(), log.iter().map(|l| l.splats).collect())
    }

    #[test]
    fn training_gives_the_same_bytes_for_1_2_and_16_threads() {
        let folder = tempfile::tempdir().unwrap();
        let bytes = |threads: usize| {
            let (made, counts) = trained(threads);
            let path = folder.path().join("splats.ply");
            let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.0, 3_357_611.0, -20.0) };
            ply::write(&path, &made.splats, &site).unwrap();
            (std::fs::read(&path).unwrap(), made, counts)
        };
        let one = bytes(1);
        for threads in [2, 16] {
            // Not by assert_eq, which would print megabytes.
            assert!(bytes(threads) == one, "{threads} threads make other splats than one");
        }
        let counts = one.2;
        assert!(
            counts.windows(2).any(|c| c[1] > c[0]) && counts.windows(2).any(|c| c[1] < c[0]),
            "{counts:?}"
        );
    }
}
