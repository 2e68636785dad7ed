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
        let scale = 0.5f64.powi(plan.level as i32);
        level.load(&mut self.truth);
        let size = (level.width, level.height);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::affine::AffineCamera;
    use crate::event::ignore;
    use crate::raster::Plane;
    use crate::splat::random::Draw;
    use crate::splat::recipe::{Recipe, Reset};
    use crate::splat::train::train;

    /// Growth, shadows, consistency and a reset within 200 iterations.
    fn compressed() -> Recipe {
        let mut recipe = Recipe::named("baeogs").unwrap();
        recipe.iterations = 200;
        recipe.half_resolution_until = 30;
        recipe.shadows_from = 50;
        recipe.growth.from = 20;
        recipe.growth.until = 150;
        recipe.growth.every = 10;
        recipe.reset = Some(Reset { every: 100, opacity: 0.005, opacity_loss_rests: 10, growth_rests: 10 });
        recipe
    }

    fn trained(threads: usize) -> (Gaussians, Vec<usize>) {
        let views = (0..3u32).map(|v| {
            let lean = 0.2 * (f64::from(v) - 1.0);
            let camera =
                AffineCamera { linear: [[2.0, 0.0, lean], [0.0, -2.0, 0.3 - lean]], offset: [29.5, 27.5] };
            let mut draw = Draw::new(7, u64::from(v), 0, 0);
            let plane = Plane::from_fn(60, 56, |c, r| {
                (0.5 + 0.3 * (c as f64 * 0.3).sin() * (r as f64 * 0.2).cos() + 0.1 * draw.uniform()) as f32
            });
            TrainingView::new(
                format!("v{v}"),
                camera,
                Some([1.1, -0.8]),
                &[plane],
                (-14.0, -13.0, 14.0, 13.0),
            )
        });
        let mut start = Gaussians::default();
        for i in 0..3000 {
            let mut d = Draw::new(1, 0, 0, i);
            let p = [28.0 * d.uniform() - 14.0, 26.0 * d.uniform() - 13.0, 3.0 * d.uniform()];
            start.push(p.map(|v| v as f32), 0.4, 0.9, [0.5; 3]);
        }
        let mut backend = CpuBackend::new(start, views.collect(), (-5.0, 10.0));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (made, log) = pool.install(|| train(&mut backend, &compressed(), 3, 20.0, 0, &ignore));
        (made.splats, log.iter().map(|l| l.splats).collect())
    }

    #[test]
    fn training_gives_the_same_bytes_for_one_and_two_threads() {
        let (one, counts) = trained(1);
        let (two, _) = trained(2);
        assert_eq!(one, two);
        let (most, last) = (counts.iter().max().unwrap(), counts.last().unwrap());
        assert!(most > &3000 && last < most, "the count must have gone up and down: {most}, {last}");
    }
}
