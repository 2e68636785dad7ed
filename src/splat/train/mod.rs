//! Training: plans each iteration after the recipe; a backend executes it.

pub mod checkpoint;
pub mod pictures;

use crate::progress::{Event, Progress};
use crate::random::CounterRng;
use crate::splat::backend::{BackendError, DensifyPlan, StepPlan, StepReport, TrainingBackend, Wait};
use crate::splat::loss::{COLUMNS, LossWeights, Losses, SurfaceDepth, column_names};
use crate::splat::recipe::{Background, NetworkRates, OpacityReset, PerspectiveRecipe, Recipe, RecipeKind};
use crate::splat::splats::PerGroup;
use serde::{Deserialize, Serialize};

/// Number of iterations between two progress events.
const STATUS_EVERY: u32 = 10;
/// Purposes of the random numbers.
const DRAW_ORDER: u64 = 10;
const DRAW_BACKGROUND: u64 = 11;
const DRAW_VIRTUAL: u64 = 12;
const DRAW_CROP: u64 = 13;
/// Rounds of all views without the sum of opacities. It takes the opacity of splats that no image needs at the full learning rate, so
/// every view must have shown what it needs.
const ROUNDS_BEFORE_OPACITY_SUM: usize = 2;
/// Loss terms that compare with the virtual view.
const VIRTUAL_TERMS: [&str; 2] = ["consistency_altitude", "consistency_color"];
/// Number of iterations of which one has the perceptual loss.
const CROP_EVERY: u32 = 4;

/// One line of the training log: an iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LogLine {
    /// Iteration, from 1.
    pub iteration: u32,
    /// The loss: the weighted sum of all terms.
    pub loss: f64,
    /// Unweighted columns of the loss terms, named by [`column_names`].
    pub columns: [f64; COLUMNS],
    /// Number of splats after the iteration.
    pub splats: usize,
    /// Number of splats that were densified after the iteration.
    pub grown: usize,
    /// Number of splats that were pruned after the iteration.
    pub pruned: usize,
    /// Number of splats that were active after the iteration; 0 without active growth.
    pub active: usize,
    /// Seconds of training since the start, without the time between interruption and restart.
    pub seconds: f64,
}

impl LogLine {
    fn new(report: &StepReport, seconds: f64) -> Self {
        let StepReport { iteration, losses, splats, active, counts } = *report;
        let Losses { total, columns } = losses;
        Self {
            iteration,
            loss: total,
            columns,
            splats,
            grown: counts.densified,
            pruned: counts.pruned,
            active,
            seconds,
        }
    }

    /// Names of the values of [`LogLine::record`], in their order.
    pub fn header() -> impl Iterator<Item = &'static str> {
        let after = ["splats", "grown", "pruned", "active", "seconds"];
        ["iteration", "loss"].into_iter().chain(column_names()).chain(after)
    }

    /// The values of the line as text, for `train.csv`.
    pub fn record(&self) -> impl Iterator<Item = String> + '_ {
        let before = [self.iteration.to_string(), self.loss.to_string()];
        let after = [self.splats, self.grown, self.pruned, self.active].map(|n| n.to_string());
        let columns = self.columns.iter().map(f64::to_string);
        before.into_iter().chain(columns).chain(after).chain([self.seconds.to_string()])
    }

    /// The value of a loss term's column; zero if no term has the column.
    #[must_use]
    pub fn column(&self, name: &str) -> f64 {
        column_names().position(|n| n == name).map_or(0.0, |k| self.columns[k])
    }
}

/// The schedule of a training: a recipe applied to a scene.
#[derive(Clone, Copy, Debug)]
pub struct Schedule<'a> {
    /// The training options.
    pub recipe: &'a Recipe,
    /// Number of training views.
    pub views: usize,
    /// Half of the area's diagonal, metres: the half side of the cube that the recipe's lengths refer to. In perspective
    /// scenes it is the extent of the cameras ([`extent_m`](crate::splat::pinhole::extent_m)) in the working frame.
    pub half_side_m: f64,
    /// Median pixel size of the training views, metres: [`median_pixel_m`](crate::affine::median_pixel_m).
    pub pixel_m: f64,
    /// Initial number of splats.
    pub splats_at_start: usize,
    /// Whether all training views are gray: a background of one value in all colours then leaves the splats gray.
    pub is_gray: bool,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// Trains from the iteration after the last of `log` to the end of the recipe.
///
/// `at` is called with the backend and the complete log after each iteration for which `is_due` is true, after the last one,
/// and after each iteration while `progress` is cancelled.
///
/// # Errors
/// The first error of the backend or of `at`, which ends the training.
pub fn train<B: TrainingBackend + ?Sized, E: From<BackendError>>(
    backend: &mut B,
    schedule: &Schedule,
    log: &mut Vec<LogLine>,
    progress: &dyn Progress,
    is_due: impl Fn(u32) -> bool,
    mut at: impl FnMut(&mut B, &[LogLine]) -> Result<(), E>,
) -> Result<(), E> {
    let total = schedule.recipe.iterations;
    let (done, before) = log.last().map_or((0, 0.0), |l| (l.iteration, l.seconds));
    let started = std::time::Instant::now();
    log.reserve_exact((total - done.min(total)) as usize);
    progress.event(Event::Started { stage: "training", total: total.into() });
    if done > 0 {
        progress.event(Event::Advanced { done: done.into(), status: String::new() });
    }
    let mut reports = Vec::new();
    for iteration in done + 1..=total {
        backend.submit(&schedule.plan(iteration))?;
        let is_stop = iteration == total || is_due(iteration) || progress.is_cancelled();
        backend.reports(if is_stop { Wait::ForAll } else { Wait::No }, &mut reports)?;
        let seconds = started.elapsed().as_secs_f64();
        log.extend(reports.drain(..).map(|report| LogLine::new(&report, before + seconds)));
        if let Some(line) = log.last().filter(|_| iteration.is_multiple_of(STATUS_EVERY)) {
            let rate = f64::from(line.iteration - done) / seconds;
            let status = format!("loss {:.4}, {} splats, {rate:.1} iterations/s", line.loss, line.splats);
            progress.event(Event::Advanced { done: line.iteration.into(), status });
        }
        if is_stop {
            at(backend, log)?;
        }
    }
    progress.event(Event::Finished);
    Ok(())
}

impl Schedule<'_> {
    /// The plan of an iteration, from 1.
    fn plan(&self, iteration: u32) -> StepPlan {
        let r = self.recipe;
        let mut draw = CounterRng::new(self.seed, DRAW_BACKGROUND, iteration.into(), 0);
        let random_background: [f32; 3] = std::array::from_fn(|_| draw.uniform() as f32);
        let past_reset = r.reset.and_then(|reset| {
            let since = (iteration - 1) % reset.every + 1;
            (iteration > reset.every).then_some((reset, since))
        });
        let is_paused = |span: fn(&OpacityReset) -> u32| past_reset.is_some_and(|(r, s)| s < span(&r));
        let weights = self.weights(iteration, is_paused(|r| r.opacity_loss_pause));
        let plan = StepPlan {
            iteration,
            view: self.view(iteration),
            level: 0,
            shadows: false,
            virtual_shear: None,
            background: if self.is_gray { [random_background[0]; 3] } else { random_background },
            random_background,
            opacity_divisor: None,
            sh_degree: 0,
            surface: SurfaceDepth::default(),
            rates: self.rates(iteration),
            appearance_rate: 0.0,
            network_rates: NetworkRates::default(),
            crop: self.crop(iteration),
            visibility: None,
            seed: self.seed,
            densify: self.densification(iteration, is_paused(|r| r.densification_pause)),
            weights,
        };
        match &r.kind {
            RecipeKind::Satellite(s) => {
                let shadows = iteration > s.shadows_from;
                let is_half =
                    iteration <= s.half_resolution_until && 2.0 * self.pixel_m <= s.half_resolution_px_m;
                let has_consistency = VIRTUAL_TERMS.iter().any(|name| plan.weights.get(name) > 0.0);
                let is_consistent = shadows && iteration.is_multiple_of(s.virtual_every) && has_consistency;
                StepPlan {
                    level: usize::from(is_half),
                    shadows,
                    virtual_shear: is_consistent.then(|| self.virtual_shear(iteration, s.virtual_shear)),
                    opacity_divisor: s.opacity_by_start.then_some(self.splats_at_start),
                    appearance_rate: s.appearance_rate,
                    network_rates: s.network_rates.unwrap_or_default(),
                    visibility: s.uncertainty.and_then(|u| u.share(iteration)),
                    ..plan
                }
            }
            RecipeKind::Perspective(p) => {
                let risen = (iteration - 1) / p.sh_degree_every.max(1);
                let background = match p.background {
                    Background::Black => [0.0; 3],
                    Background::Random => plan.background,
                };
                StepPlan {
                    background,
                    sh_degree: risen.min(p.sh_degree) as usize,
                    surface: p.surface,
                    ..plan
                }
            }
        }
    }

    /// Weights of the loss terms in an iteration.
    fn weights(&self, iteration: u32, is_opacity_paused: bool) -> LossWeights {
        let r = self.recipe;
        let mut weights = match &r.kind {
            RecipeKind::Satellite(s) => r.weights.scaled(&VIRTUAL_TERMS, f64::from(s.virtual_every)),
            RecipeKind::Perspective(_) => r.weights,
        };
        if is_opacity_paused {
            weights = weights.scaled(&["opacity"], 0.0);
        }
        for (name, from) in r.perspective().into_iter().flat_map(PerspectiveRecipe::weights_from) {
            if iteration < from {
                weights = weights.scaled(&[name], 0.0);
            }
        }
        if iteration as usize <= ROUNDS_BEFORE_OPACITY_SUM * self.views {
            weights = weights.scaled(&["opacity_sum"], 0.0);
        } else if let Some(last) = r.perspective().and_then(|p| p.last_opacity_sum) {
            let part = f64::from(iteration - 1) / f64::from((r.iterations - 1).max(1));
            let weight = weights.get("opacity_sum");
            weights = weights.with(&[("opacity_sum", weight + (last - weight) * part)]).unwrap_or(weights);
        }
        weights
    }

    /// The view of an iteration: each round goes through all views once, in random order.
    fn view(&self, iteration: u32) -> usize {
        let (round, turn) = ((iteration - 1) as usize / self.views, (iteration - 1) as usize % self.views);
        let mut order: Vec<usize> = (0..self.views).collect();
        let mut draw = CounterRng::new(self.seed, DRAW_ORDER, round as u64, 0);
        for i in (1..self.views).rev() {
            order.swap(i, draw.below(i + 1));
        }
        order[turn]
    }

    /// Place of the crop of the perceptual loss: random, in every fourth iteration.
    fn crop(&self, iteration: u32) -> Option<[f64; 2]> {
        let is_due = self.recipe.weights.get("perceptual") > 0.0 && iteration.is_multiple_of(CROP_EVERY);
        let mut draw = CounterRng::new(self.seed, DRAW_CROP, iteration.into(), 0);
        is_due.then(|| std::array::from_fn(|_| draw.uniform()))
    }

    /// Random shear of the virtual view: normal, clamped to one standard deviation (EOGS).
    fn virtual_shear(&self, iteration: u32, largest: f64) -> [f64; 2] {
        let mut draw = CounterRng::new(self.seed, DRAW_VIRTUAL, iteration.into(), 0);
        std::array::from_fn(|_| largest * draw.normal().clamp(-1.0, 1.0))
    }

    /// Learning rates, that of positions in metres.
    fn rates(&self, iteration: u32) -> PerGroup<f64> {
        let rates = self.recipe.rates;
        let decay = self.recipe.perspective().map_or(1.0, |p| {
            let part = f64::from(iteration) / f64::from(self.recipe.iterations);
            (p.last_position_rate / rates.position).powf(part)
        });
        PerGroup { position: rates.position * decay * self.half_side_m, ..rates }
    }

    /// Densification, pruning and opacity reset after an iteration.
    fn densification(&self, iteration: u32, is_paused: bool) -> DensifyPlan {
        let r = self.recipe;
        let due = iteration.is_multiple_of(r.check_every) && !is_paused;
        let densification = r.densification.filter(|g| due && (g.from..=g.until).contains(&iteration));
        let is_last = |reset: &OpacityReset| iteration >= reset.until.unwrap_or(r.iterations);
        let resets = r.reset.filter(|reset| iteration.is_multiple_of(reset.every) && !is_last(reset));
        let is_past_reset = r.reset.is_some_and(|reset| iteration > reset.every);
        let prune_above = r.perspective().filter(|_| densification.is_some() && is_past_reset);
        // What growth adds, pruning clears. Photographs show a splat in few iterations: before growth few have been seen, and after it
        // nothing takes the place of what is removed.
        let prunes = due && (r.perspective().is_none() || densification.is_some());
        DensifyPlan {
            densify: densification.map(|g| (g, self.half_side_m)),
            prune_below: prunes.then_some(r.prune_below),
            prune_above_m: prune_above.map(|p| p.prune_above * self.half_side_m),
            reset_opacity: resets.map(|reset| reset.opacity),
            seed: self.seed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::{NoProgress, Recorder};
    use crate::splat::satellite::{NovelView, Picture};
    use crate::splat::state::TrainingState;
    use crate::splat::stopwatch::Stopwatch;

    /// Records all plans, and reports an iteration only two submissions later or when it is asked to wait.
    #[derive(Default)]
    struct LateBackend {
        submitted: Vec<StepPlan>,
        reported: usize,
        state: TrainingState,
        watch: Stopwatch,
    }

    const NO_VIEW: BackendError = BackendError::NoView { view: 0, views: 0 };

    impl TrainingBackend for LateBackend {
        type Viewpoint = NovelView;
        type Picture = Picture;

        fn submit(&mut self, plan: &StepPlan) -> Result<(), BackendError> {
            if plan.view == usize::MAX {
                return Err(NO_VIEW);
            }
            self.submitted.push(plan.clone());
            Ok(())
        }

        fn reports(&mut self, wait: Wait, into: &mut Vec<StepReport>) -> Result<(), BackendError> {
            let done = self.submitted.len() - if wait == Wait::No { 2.min(self.submitted.len()) } else { 0 };
            let report = |plan: &StepPlan| StepReport { iteration: plan.iteration, ..StepReport::default() };
            into.extend(self.submitted[self.reported.min(done)..done].iter().map(report));
            self.reported = self.reported.max(done);
            Ok(())
        }

        fn render(&mut self, _: &NovelView, _: usize) -> Result<Picture, BackendError> {
            Err(NO_VIEW)
        }

        fn snapshot(&mut self) -> Result<&TrainingState, BackendError> {
            Ok(&self.state)
        }

        fn times(&self) -> &Stopwatch {
            &self.watch
        }
    }

    #[test]
    fn an_asynchronous_backend_gets_the_same_plans_and_the_log_is_complete_in_callbacks() {
        let recipe = Recipe { iterations: 50, ..Recipe::named("eogs").unwrap() };
        let schedule = of(&recipe);
        let (mut backend, mut log, mut lengths) = (LateBackend::default(), Vec::new(), Vec::new());
        let at = |_: &mut LateBackend, log: &[LogLine]| {
            lengths.push(log.len());
            Ok::<_, BackendError>(())
        };
        train(&mut backend, &schedule, &mut log, &NoProgress, |i| i.is_multiple_of(20), at).unwrap();
        assert_eq!(lengths, [20, 40, 50]);
        assert!(log.iter().map(|l| l.iteration).eq(1..=50));
        assert!(backend.submitted.iter().zip(1..).all(|(plan, i)| *plan == schedule.plan(i)));
    }

    #[test]
    fn cancelled_training_calls_back_with_the_complete_log() {
        let recipe = Recipe { iterations: 50, ..Recipe::named("eogs").unwrap() };
        let stop = Recorder::cancelling(|e| matches!(e, Event::Advanced { done: 18, .. }));
        let (mut backend, mut log) = (LateBackend::default(), Vec::new());
        let at = |_: &mut LateBackend, log: &[LogLine]| match log.len() {
            50 => Ok(()),
            _ => Err(NO_VIEW),
        };
        assert!(train(&mut backend, &of(&recipe), &mut log, &stop, |_| false, at).is_err());
        assert_eq!((log.len(), backend.submitted.len()), (21, 21));
    }

    /// The schedule of a recipe for an area with a diagonal of 452 m.
    fn of(recipe: &Recipe) -> Schedule<'_> {
        Schedule {
            recipe,
            views: 7,
            half_side_m: 226.0,
            pixel_m: 0.3,
            splats_at_start: 10,
            is_gray: false,
            seed: 1,
        }
    }

    #[test]
    fn every_round_has_every_view_once() {
        let recipe = Recipe::named("baeogs").unwrap();
        let schedule = of(&recipe);
        for round in 0..20 {
            let mut views: Vec<usize> = (1..=7).map(|i| schedule.plan(round * 7 + i).view).collect();
            views.sort_unstable();
            assert_eq!(views, [0, 1, 2, 3, 4, 5, 6]);
        }
    }

    #[test]
    fn gray_views_have_a_gray_background() {
        let recipe = Recipe::named("best").unwrap();
        let [r, g, b] = Schedule { is_gray: true, ..of(&recipe) }.plan(3).background;
        assert!(r == g && g == b);
        let [r, g, _] = of(&recipe).plan(3).background;
        assert!(r != g);
    }

    #[test]
    fn half_resolution_comes_first_unless_its_pixels_are_too_large() {
        let recipe = Recipe::named("best").unwrap();
        let levels = |pixel_m: f64| {
            let schedule = Schedule { pixel_m, ..of(&recipe) };
            let last = recipe.satellite().unwrap().half_resolution_until;
            [1, last, last + 1].map(|i| schedule.plan(i).level)
        };
        assert_eq!((levels(0.31), levels(0.41), levels(0.5)), ([1, 1, 0], [1, 1, 0], [0, 0, 0]));
        assert_eq!(of(&Recipe::named("eogs").unwrap()).plan(1).level, 0);
    }

    #[test]
    fn after_a_reset_the_opacity_loss_is_paused_until_densification_ends() {
        let recipe = Recipe::named("baeogs").unwrap();
        let weight = |i| of(&recipe).plan(i).weights.get("opacity");
        assert!(weight(3000) > 0.0 && weight(3001) == 0.0 && weight(3999) == 0.0 && weight(4000) > 0.0);
        assert_eq!(recipe.densification.unwrap().until, 4000);
    }

    #[test]
    fn every_reset_is_followed_by_a_pause() {
        let recipe = Recipe { iterations: 9000, ..Recipe::named("baeogs").unwrap() };
        let plan = |i| of(&recipe).plan(i);
        assert!(plan(6000).weights.get("opacity") > 0.0 && plan(6000).densify.prune_below.is_some());
        assert!(plan(6001).weights.get("opacity") == 0.0 && plan(6100).densify.prune_below.is_none());
    }

    #[test]
    fn the_schedule_of_baeogs_is_that_of_the_paper() {
        let recipe = Recipe::named("baeogs").unwrap();
        let schedule = of(&recipe);
        let densifies = |i| schedule.plan(i).densify.densify.is_some();
        assert!(!densifies(400) && densifies(500) && !densifies(550) && densifies(3000) && !densifies(3100));
        assert!(densifies(3500) && densifies(4000) && !densifies(4100));
        assert!(schedule.plan(3000).densify.reset_opacity.is_some());
        assert!(!schedule.plan(1000).shadows && schedule.plan(1001).shadows);
        assert!((schedule.plan(1).rates.position - 0.080).abs() < 1e-3);
        assert!(schedule.plan(1002).virtual_shear.is_some());
    }

    #[test]
    fn the_schedule_of_3dgs_is_that_of_its_program() {
        let recipe = Recipe::named("3dgs").unwrap();
        let plan = |i| of(&recipe).plan(i);
        let densifies = |i| plan(i).densify.densify.is_some();
        assert!(
            !densifies(500) && densifies(600) && densifies(3000) && densifies(14_900) && !densifies(15_000)
        );
        let resets = |i| plan(i).densify.reset_opacity.is_some();
        assert!(resets(3000) && resets(12_000) && !resets(15_000) && !resets(18_000));
        let prunes = |i| plan(i).densify.prune_below.is_some();
        assert!(!prunes(500) && prunes(600) && prunes(14_900) && !prunes(15_000) && !prunes(29_900));
        let prunes_large = |i| plan(i).densify.prune_above_m.is_some();
        assert!(!prunes_large(3000) && prunes_large(3100) && !prunes_large(15_100));
        assert_eq!([1, 1000, 1001, 3001, 30_000].map(|i| plan(i).sh_degree), [0, 0, 1, 3, 3]);
        assert_eq!(plan(7).background, [0.0; 3]);
        let rate = |i| plan(i).rates.position / 226.0;
        assert!((rate(15_000) - 1.6e-5).abs() < 1e-9 && (rate(30_000) - 1.6e-6).abs() < 1e-10);
        let short = recipe.with_iterations(3000);
        let plan = |i| of(&short).plan(i);
        assert_eq!([100, 101, 301].map(|i| plan(i).sh_degree), [0, 1, 3]);
        assert!((1..3000).all(|i| plan(i).densify.reset_opacity.is_none()), "there is no time to recover");
        let shorter = recipe.with_iterations(7000);
        let resets = |i: &u32| of(&shorter).plan(*i).densify.reset_opacity.is_some();
        assert!((1..7000).filter(resets).eq([3000]));
    }

    #[test]
    fn the_schedule_of_indoor_is_that_of_the_paper() {
        let recipe = Recipe::named("indoor").unwrap();
        let plan = |i| of(&recipe).plan(i);
        let weights = |i| {
            let weights = plan(i).weights;
            ["depth_prior", "depth_smoothness", "normal_prior", "normal_consistency"].map(|n| weights.get(n))
        };
        assert_eq!((weights(6999), weights(7000)), ([0.0; 4], [0.2, 0.2, 0.05, 0.05]));
        let opacity = |i| plan(i).weights.get("opacity_sum");
        // After two rounds of all seven views.
        for (i, expected) in [(14, 0.0), (15, 1e-10), (15_000, 5.5e-10), (30_000, 1e-9)] {
            assert!((opacity(i) - expected).abs() < 1e-12, "{i}: {}", opacity(i));
        }
        assert!((1..30_000).all(|i| plan(i).densify.prune_above_m.is_none()), "there is no reset");
        assert!((1..30_000).all(|i| plan(i).densify.reset_opacity.is_none()));
        let growth = |i| plan(i).densify.densify.and_then(|(rule, _)| rule.active);
        assert!(growth(14_900).is_some_and(|active| active.idle_rounds == 5) && growth(15_000).is_none());
        let half = recipe.with_iterations(15_000);
        assert!(of(&half).plan(3499).weights.get("depth_prior") == 0.0);
        assert!(of(&half).plan(3500).weights.get("depth_prior") > 0.0);
    }

    #[test]
    fn no_virtual_view_is_rendered_without_a_consistency_weight() {
        let mut recipe = Recipe::named("best").unwrap();
        recipe.weights = recipe.weights.scaled(&["consistency_altitude", "consistency_color"], 0.0);
        let schedule = of(&recipe);
        let plan = schedule.plan(recipe.iterations);
        assert!(plan.shadows && plan.virtual_shear.is_none());
    }

    #[test]
    fn less_frequent_virtual_views_have_larger_weights() {
        let mut recipe = Recipe::named("baeogs").unwrap();
        let RecipeKind::Satellite(satellite) = &mut recipe.kind else { unreachable!() };
        satellite.virtual_every = 3;
        let schedule = of(&recipe);
        let plans: Vec<_> = (1200..1206).map(|i| schedule.plan(i)).collect();
        let drawn: Vec<bool> = plans.iter().map(|p| p.virtual_shear.is_some()).collect();
        assert_eq!(drawn, [true, false, false, true, false, false]);
        assert_eq!(plans[0].weights.get("consistency_color"), 3.0 * recipe.weights.get("consistency_color"));
    }

    #[test]
    fn the_opacity_loss_of_eogs_divides_by_the_initial_number_of_splats() {
        let recipe = Recipe::named("eogs").unwrap();
        let schedule = Schedule { splats_at_start: 1000, ..of(&recipe) };
        let plan = schedule.plan(700);
        assert_eq!((plan.weights.get("opacity"), plan.opacity_divisor), (0.1, Some(1000)));
        assert!(plan.densify.densify.is_none() && plan.densify.prune_below.is_some());
    }
}
