//! The reference backend: iterations on the processor's cores.

use super::adam::{AppearanceAdam, SplatAdam};
use super::appearance::Appearance;
use super::backend::{Snapshot, StepPlan, StepReport, TrainingBackend};
use super::density::{Statistics, grow, prune, reset_opacity};
use super::gaussians::Gaussians;
use super::objective::{Gradient, Objective, Sheared, Shot};
use super::raster::{FrameCamera, Layers};
use super::views::TrainingView;

/// Splats, radiometry and their moments in memory.
pub struct CpuBackend {
    views: Vec<TrainingView>,
    /// Lowest and highest altitude of the scene, metres above the site's origin.
    altitudes: (f64, f64),
    splats: Gaussians,
    adam: SplatAdam,
    appearances: Vec<(Appearance, AppearanceAdam)>,
    statistics: Statistics,
    objective: Objective<f32>,
    gradient: Gradient<f32>,
    truth: Layers<f32>,
}

impl CpuBackend {
    /// A backend that trains `splats` on `views`; the scene lies between `altitudes`.
    #[must_use]
    pub fn new(splats: Gaussians, views: Vec<TrainingView>, altitudes: (f64, f64)) -> Self {
        let mut statistics = Statistics::default();
        statistics.reset(splats.len());
        Self {
            adam: SplatAdam::new(splats.len()),
            appearances: vec![Default::default(); views.len()],
            views,
            altitudes,
            splats,
            statistics,
            objective: Objective::default(),
            gradient: Gradient::default(),
            truth: Layers::default(),
        }
    }

    /// The picture of the last step, as the view sees it.
    #[must_use]
    pub fn picture(&self) -> &Layers<f32> {
        self.objective.picture()
    }

    fn change_population(&mut self, plan: &StepPlan, report: &mut StepReport) {
        let p = &plan.population;
        if let Some((rule, lengths)) = &p.grow {
            let draw = (p.seed, u64::from(plan.iteration));
            report.change.grown =
                grow(&mut self.splats, &mut self.adam, &self.statistics, rule, lengths, draw);
        }
        if let Some(opacity) = p.prune_below {
            report.change.pruned = prune(&mut self.splats, &mut self.adam, opacity, self.altitudes);
            self.statistics.reset(self.splats.len());
        }
        if let Some(opacity) = p.reset_opacity {
            reset_opacity(&mut self.splats, &mut self.adam, opacity);
        }
    }
}

impl TrainingBackend for CpuBackend {
    fn step(&mut self, plan: &StepPlan) -> StepReport {
        let view = &self.views[plan.view];
        let level = &view.levels[plan.level];
        level.load(&mut self.truth);
        let size = (level.width, level.height);
        let scale = 0.5f64.powi(plan.level as i32);
        let half_sides = [0.5 * level.width as f64, 0.5 * level.height as f64];
        let sun = view.sun_shear.filter(|_| plan.shadows).map(|s| s.map(|s| s * scale));
        let virtual_shear = plan.virtual_shear.map(|s| [s[0] * half_sides[0], s[1] * half_sides[1]]);
        let shot = Shot {
            camera: FrameCamera::new(&level.camera, size.0, size.1),
            truth: &self.truth,
            valid: &level.valid,
            sun: sun.map(|s| Sheared::sun(&level.camera, size, s, self.altitudes)),
            virtual_view: virtual_shear.map(|s| Sheared::virtual_view(&level.camera, size, s)),
            background: plan.background,
            floor: self.altitudes.0 as f32,
        };
        let (appearance, adam) = &mut self.appearances[plan.view];
        let losses =
            self.objective.evaluate(&self.splats, appearance, &shot, &plan.weights, &mut self.gradient);

        let to_half_sides = half_sides.map(|h| h as f32);
        let statistics = &mut self.statistics;
        self.objective
            .for_each_seen(|i, g| statistics.saw(i, [g[0] * to_half_sides[0], g[1] * to_half_sides[1]]));
        statistics.rendered(1.0 / level.camera.gsd_m(), level.width.max(level.height) as f64);

        let [position, log_scale, rotation, logit, f_dc, radiometry] = plan.rates;
        adam.step(appearance, &self.gradient.appearance, radiometry);
        let rates = [position, log_scale, rotation, logit, f_dc];
        self.adam.step(&mut self.splats, &self.gradient.splats, rates);

        let mut report = StepReport { losses, ..StepReport::default() };
        self.change_population(plan, &mut report);
        report.splats = self.splats.len();
        report
    }

    fn snapshot(&self) -> Snapshot {
        Snapshot { splats: self.splats.clone(), appearances: self.appearances.iter().map(|a| a.0).collect() }
    }
}
