//! Levenberg–Marquardt with the Schur complement, as a solver of `argmin`.
//!
//! Points are eliminated track by track; what remains is a dense system of two unknowns a view. Tracks are summed
//! in fixed groups, so that the result does not depend on the number of threads. Damping after Nielsen (1999).

use super::problem::{Block, Linearised, Unknowns, prior_weight};
use argmin::core::{Error, IterState, KV, Problem, Solver, State, TerminationReason, TerminationStatus};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix2x3, Matrix3, Vector2, Vector3};
use rayon::prelude::*;

/// Tracks summed together.
const GROUP: usize = 256;
/// Steps that change the cost by less than this share end the search.
const COST_TOLERANCE: f64 = 1e-9;
/// Damping at the start, relative to the diagonal.
const FIRST_DAMPING: f64 = 1e-6;
/// Damping at which no step is to be expected any more.
const LAST_DAMPING: f64 = 1e12;

/// State of the search as argmin holds it.
pub type SearchState = IterState<Unknowns, (), (), (), (), f64>;

/// The solver.
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

/// The linearised problem, not yet damped.
struct Normal {
    /// Every observation, track by track.
    observations: Vec<Vec<Linearised>>,
}

/// Sums over a group of tracks.
struct Reduced {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

/// A track's point, eliminated.
struct Eliminated {
    inverse: Cholesky<f64, nalgebra::Const<3>>,
    right: Vector3<f64>,
}

impl Normal {
    fn new(p: &Block, at: &Unknowns) -> Self {
        let observations = p
            .tracks
            .par_iter()
            .zip(&at.points)
            .with_min_len(64)
            .map(|(track, point)| track.iter().map(|m| p.linearise(m, at.shifts[m.view], *point)).collect())
            .collect();
        Self { observations }
    }

    /// The damped step from `here` and the decrease of the cost that the linear model predicts.
    fn step(&self, p: &Block, here: &Unknowns, damping: f64) -> Option<(Unknowns, f64)> {
        let views = here.shifts.len();
        let shift_steps =
            if p.shifts_free { self.shift_steps(p, here, damping)? } else { vec![[0.0; 2]; views] };
        let moved: Vec<Option<([f64; 3], f64)>> = (0..p.tracks.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|t| {
                let e = self.eliminate(t, damping)?;
                let mut right = e.right;
                for (m, o) in p.tracks[t].iter().zip(&self.observations[t]) {
                    let (j, w) = (jacobian(o), o.weight);
                    right -= j.transpose() * Vector2::from(shift_steps[m.view]) * w;
                }
                let step = e.inverse.solve(&right);
                let decrease = self.predicted(p, t, &shift_steps, step);
                let point = here.points[t];
                Some((std::array::from_fn(|k| point[k] + step[k]), decrease))
            })
            .collect();
        let mut there = here.clone();
        let mut predicted = 0.0;
        for (point, moved) in there.points.iter_mut().zip(moved) {
            let (place, decrease) = moved?;
            *point = place;
            predicted += decrease;
        }
        for (shift, step) in there.shifts.iter_mut().zip(&shift_steps) {
            let w = prior_weight(*shift);
            for k in 0..2 {
                predicted -= w * step[k] * (shift[k] + 0.5 * step[k]);
                shift[k] += step[k];
            }
        }
        Some((there, predicted))
    }

    /// Decrease of a track's cost that the linear model predicts.
    fn predicted(&self, p: &Block, t: usize, shifts: &[[f64; 2]], step: Vector3<f64>) -> f64 {
        let terms = p.tracks[t].iter().zip(&self.observations[t]).map(|(m, o)| {
            let moves = jacobian(o) * step + Vector2::from(shifts[m.view]);
            o.weight * moves.dot(&(Vector2::from(o.residual) - 0.5 * moves))
        });
        terms.sum()
    }

    /// Solves the reduced system for the shifts.
    fn shift_steps(&self, p: &Block, here: &Unknowns, damping: f64) -> Option<Vec<[f64; 2]>> {
        let n = 2 * here.shifts.len();
        let groups: Vec<Option<Reduced>> = (0..p.tracks.len().div_ceil(GROUP))
            .into_par_iter()
            .map(|g| {
                let mut sum = Reduced { matrix: DMatrix::zeros(n, n), right: DVector::zeros(n) };
                for t in g * GROUP..((g + 1) * GROUP).min(p.tracks.len()) {
                    self.reduce(p, t, damping, &mut sum)?;
                }
                Some(sum)
            })
            .collect();
        let mut total = Reduced { matrix: DMatrix::zeros(n, n), right: DVector::zeros(n) };
        for group in groups {
            let group = group?;
            total.matrix += group.matrix;
            total.right += group.right;
        }
        for (v, shift) in here.shifts.iter().enumerate() {
            let w = prior_weight(*shift);
            for k in 0..2 {
                let i = 2 * v + k;
                total.matrix[(i, i)] = total.matrix[(i, i)] * (1.0 + damping) + w;
                total.right[i] -= w * shift[k];
            }
        }
        let solution = Cholesky::<f64, Dyn>::new(total.matrix)?.solve(&total.right);
        Some((0..here.shifts.len()).map(|v| [solution[2 * v], solution[2 * v + 1]]).collect())
    }

    /// Adds a track's share of the reduced system: `U - W V⁻¹ Wᵀ` and its right side.
    fn reduce(&self, p: &Block, t: usize, damping: f64, sum: &mut Reduced) -> Option<()> {
        let e = self.eliminate(t, damping)?;
        let track = &p.tracks[t];
        let carried = e.inverse.solve(&e.right);
        // W V⁻¹ of each observation.
        let solved: Vec<Matrix2x3<f64>> = self.observations[t]
            .iter()
            .map(|o| e.inverse.solve(&(jacobian(o) * o.weight).transpose()).transpose())
            .collect();
        for (a, (m, o)) in track.iter().zip(&self.observations[t]).enumerate() {
            let i = 2 * m.view;
            let right = (Vector2::from(o.residual) - jacobian(o) * carried) * o.weight;
            sum.right[i] += right[0];
            sum.right[i + 1] += right[1];
            sum.matrix[(i, i)] += o.weight;
            sum.matrix[(i + 1, i + 1)] += o.weight;
            for (other, q) in track.iter().zip(&self.observations[t]) {
                let block = solved[a] * (jacobian(q) * q.weight).transpose();
                let j = 2 * other.view;
                for r in 0..2 {
                    for c in 0..2 {
                        sum.matrix[(i + r, j + c)] -= block[(r, c)];
                    }
                }
            }
        }
        Some(())
    }

    /// The damped normal equations of a track's point.
    fn eliminate(&self, t: usize, damping: f64) -> Option<Eliminated> {
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for o in &self.observations[t] {
            let j = jacobian(o);
            normal += j.transpose() * j * o.weight;
            right += j.transpose() * Vector2::from(o.residual) * o.weight;
        }
        for k in 0..3 {
            normal[(k, k)] *= 1.0 + damping;
        }
        Some(Eliminated { inverse: Cholesky::new(normal)?, right })
    }
}

fn jacobian(o: &Linearised) -> Matrix2x3<f64> {
    let [a, b] = o.by_point;
    Matrix2x3::new(a[0], a[1], a[2], b[0], b[1], b[2])
}
