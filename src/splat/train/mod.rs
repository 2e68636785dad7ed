//! Training: plans every iteration by the recipe and lets a backend run it.

pub mod expectation;
pub mod pictures;
pub mod recipe;

use crate::progress::{Event, Progress};
use crate::random::CounterRng;
use crate::splat::backend::{DensifyPlan, StepPlan, StepReport, TrainingBackend};
use crate::splat::objective::LossWeights;
use crate::splat::splats::PerGroup;
use crate::splat::train::recipe::Recipe;
use serde::{Deserialize, Serialize};

const DRAW_ORDER: u64 = 10;
const DRAW_BACKGROUND: u64 = 11;
const DRAW_VIRTUAL: u64 = 12;

/// One line of the training's log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LogLine {
    /// Iteration, from 1.
    pub iteration: u32,
    /// Loss.
    pub loss: f64,
    /// Mean absolute difference to the image.
    pub l1: f64,
    /// Mean SSIM with the image.
    pub ssim: f64,
    /// Mean opacity.
    pub opacity: f64,
    /// Altitude difference to the virtual view, metres; 0 without one.
    pub consistency_altitude_m: f64,
    /// Colour difference to the virtual view; 0 without one.
    pub consistency_color: f64,
    /// Entropy of the sunlight's shares, bits.
    pub shadow_entropy: f64,
    /// Splats.
    pub splats: usize,
    /// Splats doubled by this iteration's check.
    pub grown: usize,
    /// Splats removed by it.
    pub pruned: usize,
    /// Seconds since the start, interruptions excepted.
    pub seconds: f64,
}

impl LogLine {
    fn new(iteration: u32, report: &StepReport, seconds: f64) -> Self {
        let l = &report.losses;
        Self {
            iteration,
            loss: l.total,
            l1: l.picture.l1,
            ssim: l.picture.ssim,
            opacity: l.opacity,
            consistency_altitude_m: l.consistency_altitude,
            consistency_color: l.consistency_color,
            shadow_entropy: l.shadow_entropy,
            splats: report.splats,
            grown: report.change.grown,
            pruned: report.change.pruned,
            seconds,
        }
    }
}

/// What is done at which iteration: a recipe at a site.
#[derive(Clone, Copy, Debug)]
pub struct Schedule<'a> {
    /// The training choices.
    pub recipe: &'a Recipe,
    /// Training views.
    pub views: usize,
    /// Half the diagonal of the area, metres.
    pub half_side_m: f64,
    /// Pixel of the training views, metres: [`median_pixel_m`](crate::affine::median_pixel_m).
    pub pixel_m: f64,
    /// Splats that training starts with.
    pub splats_at_start: usize,
    /// Seed of every draw.
    pub seed: u64,
}

/// Trains to the recipe's end, from the iteration after the last of `log`.
///
/// `after` is called after every iteration with the backend and the log so far.
///
/// # Errors
/// The first that `after` returns: training stops there.
pub fn train<B: TrainingBackend, E>(
    backend: &mut B,
    schedule: &Schedule,
    log: &mut Vec<LogLine>,
    progress: &dyn Progress,
    mut after: impl FnMut(&mut B, &[LogLine]) -> Result<(), E>,
) -> Result<(), E> {
    let total = schedule.recipe.iterations;
    let (done, before) = log.last().map_or((0, 0.0), |l| (l.iteration, l.seconds));
    let started = std::time::Instant::now();
    log.reserve_exact((total - done.min(total)) as usize);
    progress.event(Event::Started { stage: "training", total: total.into() });
    if done > 0 {
        progress.event(Event::Advanced { done: done.into(), status: String::new() });
    }
    for iteration in done + 1..=total {
        let splats = log.last().map_or(schedule.splats_at_start, |l| l.splats);
        let report = backend.step(&schedule.plan(iteration, splats));
        let seconds = started.elapsed().as_secs_f64();
        let line = LogLine::new(iteration, &report, before + seconds);
        log.push(line);
        if iteration.is_multiple_of(10) {
            let rate = f64::from(iteration - done) / seconds;
            let status = format!("loss {:.4}, {} splats, {rate:.1} iterations/s", line.loss, line.splats);
            progress.event(Event::Advanced { done: iteration.into(), status });
        }
        after(backend, log)?;
    }
    progress.event(Event::Finished);
    Ok(())
}

impl Schedule<'_> {
    /// What an iteration does that begins with so many splats.
    fn plan(&self, iteration: u32, splats: usize) -> StepPlan {
        let r = self.recipe;
        let mut background = CounterRng::new(self.seed, DRAW_BACKGROUND, iteration.into(), 0);
        let past_reset = r.reset.and_then(|reset| {
            let since = (iteration - 1) % reset.every + 1;
            (iteration > reset.every).then_some((reset, since))
        });
        let rests = |span: fn(&crate::splat::train::recipe::Reset) -> u32| {
            past_reset.is_some_and(|(r, s)| s < span(&r))
        };
        let left = if r.opacity_by_start { splats as f64 / self.splats_at_start as f64 } else { 1.0 };
        let times = f64::from(r.virtual_every);
        let weights = LossWeights {
            opacity: if rests(|r| r.opacity_loss_rests) { 0.0 } else { r.weights.opacity * left },
            consistency_altitude: r.weights.consistency_altitude * times,
            consistency_color: r.weights.consistency_color * times,
            ..r.weights
        };
        let shadows = iteration > r.shadows_from;
        let is_half = iteration <= r.half_resolution_until && 2.0 * self.pixel_m <= r.half_resolution_px_m;
        let is_consistent = shadows && iteration.is_multiple_of(r.virtual_every) && weights.has_consistency();
        StepPlan {
            iteration,
            view: self.view(iteration),
            level: usize::from(is_half),
            shadows,
            virtual_shear: is_consistent.then(|| self.virtual_shear(iteration)),
            background: std::array::from_fn(|_| background.uniform() as f32),
            weights,
            rates: self.rates(),
            appearance_rate: r.appearance_rate,
            population: self.population(iteration, rests(|r| r.growth_rests)),
        }
    }

    /// Views in random order without replacement, round after round.
    fn view(&self, iteration: u32) -> usize {
        let (round, turn) = ((iteration - 1) as usize / self.views, (iteration - 1) as usize % self.views);
        let mut order: Vec<usize> = (0..self.views).collect();
        let mut draw = CounterRng::new(self.seed, DRAW_ORDER, round as u64, 0);
        for i in (1..self.views).rev() {
            order.swap(i, draw.below(i + 1));
        }
        order[turn]
    }

    fn virtual_shear(&self, iteration: u32) -> [f64; 2] {
        let mut draw = CounterRng::new(self.seed, DRAW_VIRTUAL, iteration.into(), 0);
        std::array::from_fn(|_| self.recipe.virtual_shear * draw.normal().clamp(-1.0, 1.0))
    }

    fn rates(&self) -> PerGroup<f64> {
        let rates = self.recipe.rates;
        PerGroup { position: rates.position * self.half_side_m, ..rates }
    }

    fn population(&self, iteration: u32, rests: bool) -> DensifyPlan {
        let r = self.recipe;
        let due = iteration.is_multiple_of(r.check_every) && !rests;
        let growth = r.growth.filter(|g| due && (g.from..=g.until).contains(&iteration));
        let resets =
            r.reset.filter(|reset| iteration.is_multiple_of(reset.every) && iteration < r.iterations);
        DensifyPlan {
            grow: growth.map(|g| (g, self.half_side_m)),
            prune_below: due.then_some(r.prune_below),
            reset_opacity: resets.map(|reset| reset.opacity),
            seed: self.seed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A recipe at a site of 452 m.
    fn of(recipe: &Recipe) -> Schedule<'_> {
        Schedule { recipe, views: 7, half_side_m: 226.0, pixel_m: 0.3, splats_at_start: 10, seed: 1 }
    }

    #[test]
    fn every_view_has_its_turn_in_every_round() {
        let recipe = Recipe::named("baeogs").unwrap();
        let schedule = of(&recipe);
        for round in 0..20 {
            let mut seen: Vec<usize> = (1..=7).map(|i| schedule.plan(round * 7 + i, 10).view).collect();
            seen.sort_unstable();
            assert_eq!(seen, [0, 1, 2, 3, 4, 5, 6]);
        }
    }

    #[test]
    fn half_resolution_comes_first_unless_its_pixels_are_too_wide() {
        let recipe = Recipe::named("best").unwrap();
        let levels = |pixel_m: f64| {
            let schedule = Schedule { pixel_m, ..of(&recipe) };
            let last = recipe.half_resolution_until;
            [1, last, last + 1].map(|i| schedule.plan(i, 10).level)
        };
        assert_eq!((levels(0.31), levels(0.41), levels(0.5)), ([1, 1, 0], [1, 1, 0], [0, 0, 0]));
        assert_eq!(of(&Recipe::named("eogs").unwrap()).plan(1, 10).level, 0);
    }

    #[test]
    fn after_a_reset_the_loss_on_opacities_rests_until_growth_ends() {
        let recipe = Recipe::named("baeogs").unwrap();
        let weight = |i| of(&recipe).plan(i, 10).weights.opacity;
        assert!(weight(3000) > 0.0 && weight(3001) == 0.0 && weight(3999) == 0.0 && weight(4000) > 0.0);
        assert_eq!(recipe.growth.unwrap().until, 4000);
    }

    #[test]
    fn every_reset_is_followed_by_its_own_rest() {
        let recipe = Recipe { iterations: 9000, ..Recipe::named("baeogs").unwrap() };
        let plan = |i| of(&recipe).plan(i, 10);
        assert!(plan(6000).weights.opacity > 0.0 && plan(6000).population.prune_below.is_some());
        assert!(plan(6001).weights.opacity == 0.0 && plan(6100).population.prune_below.is_none());
    }

    #[test]
    fn the_schedule_is_the_papers() {
        let recipe = Recipe::named("baeogs").unwrap();
        let schedule = of(&recipe);
        let grows = |i| schedule.plan(i, 10).population.grow.is_some();
        assert!(!grows(400) && grows(500) && !grows(550) && grows(3000) && !grows(3100));
        assert!(grows(3500) && grows(4000) && !grows(4100));
        assert!(schedule.plan(3000, 10).population.reset_opacity.is_some());
        assert!(!schedule.plan(1000, 10).shadows && schedule.plan(1001, 10).shadows);
        assert!((schedule.plan(1, 10).rates.position - 0.080).abs() < 1e-3);
        assert!(schedule.plan(1002, 10).virtual_shear.is_some());
    }

    #[test]
    fn no_virtual_view_is_drawn_where_consistency_weighs_nothing() {
        let mut recipe = Recipe::named("best").unwrap();
        (recipe.weights.consistency_altitude, recipe.weights.consistency_color) = (0.0, 0.0);
        let schedule = of(&recipe);
        let plan = schedule.plan(recipe.iterations, 10);
        assert!(plan.shadows && plan.virtual_shear.is_none());
    }

    #[test]
    fn fewer_virtual_views_weigh_more() {
        let recipe = Recipe { virtual_every: 3, ..Recipe::named("baeogs").unwrap() };
        let schedule = of(&recipe);
        let plans: Vec<_> = (1200..1206).map(|i| schedule.plan(i, 10)).collect();
        let drawn: Vec<bool> = plans.iter().map(|p| p.virtual_shear.is_some()).collect();
        assert_eq!(drawn, [true, false, false, true, false, false]);
        assert_eq!(plans[0].weights.consistency_color, 3.0 * recipe.weights.consistency_color);
    }

    #[test]
    fn opacities_of_eogs_count_by_the_splats_at_the_start() {
        let recipe = Recipe::named("eogs").unwrap();
        let schedule = Schedule { splats_at_start: 1000, ..of(&recipe) };
        let plan = schedule.plan(700, 250);
        assert_eq!(plan.weights.opacity, 0.1 * 0.25);
        assert!(plan.population.grow.is_none() && plan.population.prune_below.is_some());
    }
}
