//! Levenberg–Marquardt with the Schur complement, as a solver of `argmin`.
//!
//! The points are eliminated track by track; what remains is a dense system in the parameters of the views. Tracks are
//! summed in fixed groups, so that the result does not depend on the number of threads. The damping follows Nielsen
//! (1999).

use super::correction::{CorrectionModel, Parameters, by_parameters};
use super::problem::{Block, Linearised, Unknowns};
use argmin::core::observers::Observe;
use argmin::core::{Error, IterState, KV, Problem, Solver, State, TerminationReason, TerminationStatus};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix2x3, Matrix3, SMatrix, Vector2, Vector3};
use rayon::prelude::*;

/// Number of tracks that are summed in a group.
const GROUP: usize = 256;
/// Relative decrease of the cost below which the iterations end: shifts then change by less than 0.01 px, and most
/// solutions are followed by another.
const COST_TOLERANCE: f64 = 1e-4;
/// Initial damping, relative to the diagonal.
const FIRST_DAMPING: f64 = 1e-6;
/// Damping at which the iterations end without a step.
const LAST_DAMPING: f64 = 1e12;

/// State of the iterations as `argmin` holds it.
pub type SearchState = IterState<Unknowns, (), (), (), (), f64>;

/// Levenberg–Marquardt with elimination of the points.
pub struct SchurLevenbergMarquardt {
    damping: f64,
    growth: f64,
    converged: bool,
}

impl Default for SchurLevenbergMarquardt {
    fn default() -> Self {
        Self { damping: FIRST_DAMPING, growth: 2.0, converged: false }
    }
}

impl<'a> Solver<Block<'a>, SearchState> for SchurLevenbergMarquardt {
    fn name(&self) -> &str {
        "Levenberg-Marquardt with Schur complement"
    }

    fn init(
        &mut self,
        problem: &mut Problem<Block<'a>>,
        state: SearchState,
    ) -> Result<(SearchState, Option<KV>), Error> {
        let cost = match state.get_param() {
            Some(u) => problem.problem("cost_count", |p| Ok(p.cost(u)))?,
            None => return Err(Error::msg("the search needs a start")),
        };
        Ok((state.cost(cost), None))
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<Block<'a>>,
        mut state: SearchState,
    ) -> Result<(SearchState, Option<KV>), Error> {
        let here = state.take_param().ok_or_else(|| Error::msg("the search lost its place"))?;
        let cost = state.get_cost();
        let system = problem.problem("normal_count", |p| Ok(Normal::new(p, &here)))?;
        while self.damping < LAST_DAMPING {
            let step = problem.problem("solve_count", |p| Ok(system.step(p, &here, self.damping)))?;
            if let Some((there, predicted)) = step {
                let new_cost = problem.problem("cost_count", |p| Ok(p.cost(&there)))?;
                let gain = (cost - new_cost) / predicted.max(f64::MIN_POSITIVE);
                if new_cost <= cost {
                    self.damping *= (1.0 - (2.0 * gain - 1.0).powi(3)).clamp(1.0 / 3.0, 1.0);
                    self.growth = 2.0;
                    self.converged = cost - new_cost <= COST_TOLERANCE * cost;
                    return Ok((state.param(there).cost(new_cost), None));
                }
            }
            self.damping *= self.growth;
            self.growth *= 2.0;
        }
        self.converged = true;
        Ok((state.param(here).cost(cost), None))
    }

    fn terminate(&mut self, _state: &SearchState) -> TerminationStatus {
        if self.converged {
            TerminationStatus::Terminated(TerminationReason::SolverConverged)
        } else {
            TerminationStatus::NotTerminated
        }
    }
}

/// Logs the cost of every iteration.
pub struct Log;

impl Observe<SearchState> for Log {
    fn observe_iter(&mut self, search: &SearchState, _: &KV) -> Result<(), Error> {
        tracing::debug!("iteration {}: cost {:.6e}", search.get_iter(), search.get_cost());
        Ok(())
    }
}

/// The linearised problem, without damping.
pub struct Normal {
    /// The linearised observations, track by track.
    pub observations: Vec<Vec<Linearised>>,
}

/// The reduced normal equations, from which the points are eliminated.
pub struct Reduced {
    /// `U - W V⁻¹ Wᵀ`.
    pub matrix: DMatrix<f64>,
    right: DVector<f64>,
}

/// The normal equations of a track's point.
pub struct Eliminated {
    /// Cholesky factor of the 3 x 3 block `V`.
    pub inverse: Cholesky<f64, nalgebra::Const<3>>,
    right: Vector3<f64>,
}

impl Normal {
    /// Linearises all observations.
    #[must_use]
    pub fn new(p: &Block, at: &Unknowns) -> Self {
        let observations = p
            .tracks
            .par_iter()
            .zip(&at.points)
            .with_min_len(64)
            .map(|(track, point)| {
                track.observations.iter().map(|m| p.linearise(m, &at.corrections[m.view], *point)).collect()
            })
            .collect();
        Self { observations }
    }

    /// The damped step from `here` and the decrease of the cost that the linear model predicts.
    fn step(&self, p: &Block, here: &Unknowns, damping: f64) -> Option<(Unknowns, f64)> {
        match p.model {
            CorrectionModel::Shift => self.step_of::<2>(p, here, damping),
            CorrectionModel::ShiftScale => self.step_of::<4>(p, here, damping),
            CorrectionModel::Affine => self.step_of::<6>(p, here, damping),
        }
    }

    /// [`Normal::step`] for `P` parameters per view.
    fn step_of<const P: usize>(&self, p: &Block, here: &Unknowns, damping: f64) -> Option<(Unknowns, f64)> {
        let points = self.eliminated(p, here, damping)?;
        let steps = self.correction_steps::<P>(p, here, &points, damping)?;
        let moved: Vec<([f64; 3], f64)> = points
            .par_iter()
            .enumerate()
            .with_min_len(64)
            .map(|(t, e)| {
                let point = here.points[t];
                let mut right = e.right;
                for (m, o) in p.tracks[t].observations.iter().zip(&self.observations[t]) {
                    right -= jacobian(o).transpose() * (by_parameters::<P>(o.at) * steps[m.view]) * o.weight;
                }
                let step = e.inverse.solve(&right);
                let decrease = self.predicted(p, t, point, &steps, step);
                (std::array::from_fn(|k| point[k] + step[k]), decrease)
            })
            .collect();
        let mut there = here.clone();
        let mut predicted = 0.0;
        for (point, (place, decrease)) in there.points.iter_mut().zip(moved) {
            *point = place;
            predicted += decrease;
        }
        for (v, (correction, step)) in there.corrections.iter_mut().zip(&steps).enumerate() {
            let w = p.prior_weights(v, correction);
            for k in 0..P {
                predicted -= w[k] * step[k] * (correction[k] + 0.5 * step[k]);
                correction[k] += step[k];
            }
        }
        Some((there, predicted))
    }

    /// Decrease of a track's cost that the linear model predicts.
    fn predicted<const P: usize>(
        &self,
        p: &Block,
        t: usize,
        point: [f64; 3],
        steps: &[SMatrix<f64, P, 1>],
        step: Vector3<f64>,
    ) -> f64 {
        let track = &p.tracks[t];
        let terms = track.observations.iter().zip(&self.observations[t]).map(|(m, o)| {
            let moves = jacobian(o) * step + by_parameters::<P>(o.at) * steps[m.view];
            o.weight * moves.dot(&(Vector2::from(o.residual) - 0.5 * moves))
        });
        let known = track.prior.map_or(0.0, |known| {
            let to_survey = |k: usize| known.place[k] - point[k] - 0.5 * step[k];
            (0..3).map(|k| step[k] * to_survey(k) / known.sigma_m[k].powi(2)).sum()
        });
        let height = p.heights.as_ref().and_then(|h| h.residual_and_weight(t, point));
        let height = height.map_or(0.0, |(residual, weight)| weight * step[2] * (residual - 0.5 * step[2]));
        terms.sum::<f64>() + known + height
    }

    /// Solves the reduced system for the corrections.
    fn correction_steps<const P: usize>(
        &self,
        p: &Block,
        here: &Unknowns,
        points: &[Eliminated],
        damping: f64,
    ) -> Option<Vec<SMatrix<f64, P, 1>>> {
        let views = here.corrections.len();
        let mut total = self.reduced::<P>(p, points);
        for (v, correction) in here.corrections.iter().enumerate() {
            let w: Parameters = p.prior_weights(v, correction);
            for k in 0..P {
                let i = P * v + k;
                total.matrix[(i, i)] = total.matrix[(i, i)] * (1.0 + damping) + w[k];
                total.right[i] -= w[k] * correction[k];
                if p.is_fixed[v] {
                    total.matrix.row_mut(i).fill(0.0);
                    total.matrix.column_mut(i).fill(0.0);
                    total.matrix[(i, i)] = 1.0;
                    total.right[i] = 0.0;
                }
            }
        }
        let solution = Cholesky::<f64, Dyn>::new(total.matrix)?.solve(&total.right);
        Some((0..views).map(|v| SMatrix::from_fn(|k, _| solution[P * v + k])).collect())
    }

    /// The reduced normal equations, without the priors of the corrections.
    #[must_use]
    pub fn reduced<const P: usize>(&self, p: &Block, points: &[Eliminated]) -> Reduced {
        let n = P * p.rpcs.len();
        let groups: Vec<Reduced> = (0..p.tracks.len().div_ceil(GROUP))
            .into_par_iter()
            .map(|g| {
                let mut sum = Reduced { matrix: DMatrix::zeros(n, n), right: DVector::zeros(n) };
                for t in g * GROUP..((g + 1) * GROUP).min(p.tracks.len()) {
                    self.reduce::<P>(p, t, &points[t], &mut sum);
                }
                sum
            })
            .collect();
        let mut total = Reduced { matrix: DMatrix::zeros(n, n), right: DVector::zeros(n) };
        for group in groups {
            total.matrix += group.matrix;
            total.right += group.right;
        }
        total
    }

    /// Adds the contribution of a track to the reduced system.
    fn reduce<const P: usize>(&self, p: &Block, t: usize, e: &Eliminated, sum: &mut Reduced) {
        let carried = e.inverse.solve(&e.right);
        // For each observation the index of its view's first parameter, W, and W V⁻¹.
        let parts: Vec<(usize, SMatrix<f64, P, 3>, SMatrix<f64, P, 3>)> = p.tracks[t]
            .observations
            .iter()
            .zip(&self.observations[t])
            .map(|(m, o)| {
                let w = by_parameters::<P>(o.at).transpose() * jacobian(o) * o.weight;
                (P * m.view, w, e.inverse.solve(&w.transpose()).transpose())
            })
            .collect();
        for ((i, _, solved), o) in parts.iter().zip(&self.observations[t]) {
            let own = by_parameters::<P>(o.at);
            let right = own.transpose() * (Vector2::from(o.residual) - jacobian(o) * carried) * o.weight;
            let mut rows = sum.right.fixed_rows_mut::<P>(*i);
            rows += right;
            let mut block = sum.matrix.fixed_view_mut::<P, P>(*i, *i);
            block += own.transpose() * own * o.weight;
            for (j, w, _) in &parts {
                let mut block = sum.matrix.fixed_view_mut::<P, P>(*i, *j);
                block -= solved * w.transpose();
            }
        }
    }

    /// The normal equations of all points; none if the rays of one do not determine it.
    #[must_use]
    pub fn eliminated(&self, p: &Block, here: &Unknowns, damping: f64) -> Option<Vec<Eliminated>> {
        let points: Vec<Option<Eliminated>> = (0..p.tracks.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|t| self.eliminate(p, t, here.points[t], damping))
            .collect();
        points.into_iter().collect()
    }

    /// The damped normal equations of a track's point.
    fn eliminate(&self, p: &Block, t: usize, point: [f64; 3], damping: f64) -> Option<Eliminated> {
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for o in &self.observations[t] {
            let j = jacobian(o);
            normal += j.transpose() * j * o.weight;
            right += j.transpose() * Vector2::from(o.residual) * o.weight;
        }
        if let Some(known) = p.tracks[t].prior {
            for k in 0..3 {
                let weight = known.sigma_m[k].powi(-2);
                normal[(k, k)] += weight;
                right[k] += weight * (known.place[k] - point[k]);
            }
        }
        if let Some((residual, weight)) = p.heights.as_ref().and_then(|h| h.residual_and_weight(t, point)) {
            normal[(2, 2)] += weight;
            right[2] += weight * residual;
        }
        for k in 0..3 {
            normal[(k, k)] *= 1.0 + damping;
        }
        Some(Eliminated { inverse: Cholesky::new(normal)?, right })
    }
}

/// Derivative of an observation by its point.
#[must_use]
pub fn jacobian(o: &Linearised) -> Matrix2x3<f64> {
    let [a, b] = o.by_point;
    Matrix2x3::new(a[0], a[1], a[2], b[0], b[1], b[2])
}
