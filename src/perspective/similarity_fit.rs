//! The similarity between two frames in which points are known, in spite of wrong points, and how well they determine it.
//!
//! Wrong points are found by a least quantile of squares over sets of three (Rousseeuw & Leroy, Robust Regression and Outlier
//! Detection, 1987, chapter 5): the similarity of three points from which just over half of all points have the smallest
//! distances. Weighted least squares of the points that agree with it follow. Their normal equations tell which turns the
//! points leave open: of points near a line that about the line, by an angle that grows with the noise.

use super::similarity::SimilarityTransform;
use crate::random::CounterRng;
use crate::stats::FitQuality;
use glam::{DMat3, DQuat, DVec3};
use nalgebra::{SMatrix, SVector};

/// Unknowns of a similarity, and points that determine them.
pub const UNKNOWNS: usize = 7;
const LEAST_POINTS: usize = 3;
/// Largest standard deviation of a turn that counts as determined, degrees: 0.9 m over 100 m.
pub const DETERMINED_DEG: f64 = 0.5;
/// Points farther from a fit than this multiple of the standard deviation of a coordinate disagree with it. Of right points
/// with normal errors 0.1 % are farther (chi distribution of three degrees of freedom).
pub const MOST_SIGMAS: f64 = 4.0;
/// Median of the chi distribution of three degrees of freedom: the median distance of a point with normal errors of 1 in each
/// coordinate.
const MEDIAN_DISTANCE: f64 = 1.538;
/// Positions that differ from a fit by more than this multiple of their stated accuracy, RMS, are not those of the points.
const MOST_TIMES_STATED: f64 = 10.0;
/// Sets of three points that are tried: with 40 % of wrong points one of 600 is right with a probability of 1 - 1e-63.
const MOST_SETS: usize = 600;
/// Most rounds of least squares and rejection, and steps of one least squares.
const ROUNDS: usize = 20;
const STEPS: usize = 30;
/// Coordinates are never more exact than this share of the extent of the points.
const NUMERIC: f64 = 1e-6;
/// Eigenvalues of the normal equations below this share of the largest one are none.
const SINGULAR: f64 = 1e-12;
/// Variance of a turn that the points leave open altogether, radians squared.
const OPEN: f64 = 1e6;

/// A point that is known in both frames.
#[derive(Clone, Debug)]
pub struct PointPair {
    /// Its name, for messages.
    pub name: String,
    /// Position in the frame of origin.
    pub from: DVec3,
    /// Position in the target frame, metres.
    pub to: DVec3,
    /// Standard deviation of each coordinate of `to` as stated, metres; if one point has none, all points count alike.
    pub sigma_m: Option<DVec3>,
}

/// A direction that is known in both frames, unit vectors, with its standard deviation.
#[derive(Clone, Copy, Debug)]
pub struct DirectionPair {
    /// In the frame of origin.
    pub from: DVec3,
    /// In the target frame.
    pub to: DVec3,
    /// Standard deviation of the angle between them, degrees.
    pub sigma_deg: f64,
}

/// The similarity that points determine.
#[derive(Clone, Debug)]
pub struct SimilarityFit {
    /// The similarity.
    pub transform: SimilarityTransform,
    /// How well the points agree with it.
    pub quality: FitQuality,
    /// Covariance of a small turn about the axes of the target frame, radians squared, row by row.
    turn: [[f64; 3]; 3],
}

impl SimilarityFit {
    /// The similarity of points of which some may be wrong, and of directions.
    ///
    /// # Errors
    /// What is missing, or contradicts, as text. A turn that is not determined is no error: see
    /// [`SimilarityFit::tilt_sigma_deg`].
    pub fn new(pairs: &[PointPair], directions: &[DirectionPair]) -> Result<Self, String> {
        if pairs.len() < LEAST_POINTS {
            return Err(format!("{} of its images have positions, {LEAST_POINTS} are needed", pairs.len()));
        }
        let problem = Problem::new(pairs, directions);
        let (start, sigma) = problem.least_quantile()?;
        let mut kept = problem.within(&start, sigma);
        let mut solved = problem.least_squares(start, &kept)?;
        for _ in 0..ROUNDS {
            let agree = problem.within(&solved.transform, solved.sigma);
            if agree == kept {
                break;
            }
            kept = agree;
            if count(&kept) < problem.majority() {
                let (some, all) = (count(&kept), pairs.len());
                return Err(format!("only {some} of {all} positions agree with each other"));
            }
            solved = problem.least_squares(solved.transform, &kept)?;
        }
        let Solution { transform, sigma, turn } = solved;
        let distances = pairs.iter().map(|p| (transform.apply(p.from) - p.to).length());
        let points = pairs.iter().zip(distances).zip(&kept).map(|((p, d), kept)| (p.name.as_str(), d, *kept));
        let quality = FitQuality::of(points, UNKNOWNS);
        if problem.is_stated && sigma > MOST_TIMES_STATED {
            return Err(format!(
                "the positions differ from the cameras by {sigma:.0} times their stated accuracy ({quality})"
            ));
        }
        Ok(Self { transform, quality, turn })
    }

    /// Standard deviation of the vertical of the target frame in its worst direction, degrees.
    #[must_use]
    pub fn tilt_sigma_deg(&self) -> f64 {
        let [[xx, xy, _], [_, yy, _], _] = self.turn;
        let largest = 0.5 * (xx + yy) + (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        largest.max(0.0).sqrt().to_degrees()
    }

    /// Standard deviation of the turn about the vertical of the target frame, degrees.
    #[must_use]
    pub fn heading_sigma_deg(&self) -> f64 {
        self.turn[2][2].max(0.0).sqrt().to_degrees()
    }

    /// Whether both are determined.
    #[must_use]
    pub fn is_determined(&self) -> bool {
        self.tilt_sigma_deg().max(self.heading_sigma_deg()) <= DETERMINED_DEG
    }
}

fn count(kept: &[bool]) -> usize {
    kept.iter().filter(|k| **k).count()
}

struct Problem<'a> {
    pairs: &'a [PointPair],
    directions: &'a [DirectionPair],
    /// Standard deviation of each coordinate; ones without stated ones.
    sigma: Vec<DVec3>,
    is_stated: bool,
    /// The smallest standard deviation of a coordinate that is believed, in units of `sigma`.
    least_sigma: f64,
}

/// A least-squares solution, the standard deviation of a coordinate in units of the stated ones, the covariance of the turn.
struct Solution {
    transform: SimilarityTransform,
    sigma: f64,
    turn: [[f64; 3]; 3],
}

impl<'a> Problem<'a> {
    fn new(pairs: &'a [PointPair], directions: &'a [DirectionPair]) -> Self {
        let stated: Option<Vec<DVec3>> = pairs.iter().map(|p| p.sigma_m).collect();
        let is_stated = stated.is_some();
        let sigma = stated.unwrap_or_else(|| vec![DVec3::ONE; pairs.len()]);
        // The median, because one position may be anything.
        let median = |k: usize| crate::stats::median(pairs.iter().map(|p| p.to[k]).collect()).unwrap_or(0.0);
        let middle = DVec3::new(median(0), median(1), median(2));
        let extent = pairs.iter().map(|p| (p.to - middle).length()).collect();
        let least_sigma = if is_stated { 1.0 } else { NUMERIC * crate::stats::median(extent).unwrap_or(0.0) };
        Self { pairs, directions, sigma, is_stated, least_sigma }
    }

    /// Number of points that must agree: more than half of those beyond three, which any similarity can fit.
    fn majority(&self) -> usize {
        (self.pairs.len() + LEAST_POINTS).div_ceil(2).min(self.pairs.len())
    }

    /// Distance of each point from its image, in units of the standard deviations.
    fn distances(&self, transform: &SimilarityTransform) -> Vec<f64> {
        let off = |(p, sigma): (&PointPair, &DVec3)| ((transform.apply(p.from) - p.to) / *sigma).length();
        self.pairs.iter().zip(&self.sigma).map(off).collect()
    }

    fn within(&self, transform: &SimilarityTransform, sigma: f64) -> Vec<bool> {
        let limit = MOST_SIGMAS * sigma.max(self.least_sigma);
        self.distances(transform).into_iter().map(|d| d <= limit).collect()
    }

    /// The similarity of three points that is nearest to the majority, and the standard deviation of a coordinate that this
    /// tells.
    fn least_quantile(&self) -> Result<(SimilarityTransform, f64), String> {
        let n = self.pairs.len();
        let mut best: Option<(f64, SimilarityTransform)> = None;
        let mut try_set = |set: [usize; LEAST_POINTS]| {
            let chosen = set.map(|i| (self.pairs[i].from, self.pairs[i].to));
            let Some(found) = SimilarityTransform::closed_form(&chosen) else { return };
            let mut distances = self.distances(&found);
            let rank = self.majority() - 1;
            let distance = *distances.select_nth_unstable_by(rank, f64::total_cmp).1;
            if best.is_none_or(|(least, _)| distance < least) {
                best = Some((distance, found));
            }
        };
        if n * (n - 1) * (n - 2) / 6 <= MOST_SETS {
            (0..n).for_each(|i| (i + 1..n).for_each(|j| (j + 1..n).for_each(|k| try_set([i, j, k]))));
        } else {
            let mut random = CounterRng::new(0, 0, 0, n as u64);
            (0..MOST_SETS).for_each(|_| try_set(std::array::from_fn(|_| random.below(n))));
        }
        let (distance, found) = best.ok_or("the positions are all in one place")?;
        // Three points fit too well: the factor of Rousseeuw & Leroy for small samples.
        let small = 1.0 + 5.0 / (n + 1 - LEAST_POINTS) as f64;
        Ok((found, small * distance / MEDIAN_DISTANCE))
    }

    /// The weighted least squares of some points and all directions, by Gauss-Newton steps from a start.
    fn least_squares(&self, start: SimilarityTransform, kept: &[bool]) -> Result<Solution, String> {
        let chosen: Vec<(&PointPair, &DVec3)> =
            self.pairs.iter().zip(&self.sigma).zip(kept).filter(|(_, kept)| **kept).map(|(p, _)| p).collect();
        let n = chosen.len() as f64;
        let middle = chosen.iter().map(|(p, _)| p.from).sum::<DVec3>() / n;
        let spread = (chosen.iter().map(|(p, _)| (p.from - middle).length_squared()).sum::<f64>() / n).sqrt();
        // Turns and logarithms of the scale are multiplied by this length, so that all unknowns are lengths.
        let length = start.scale * spread;
        let unsolved = || "the positions cannot be fitted".to_owned();
        // A comparison that NaN fails too.
        let has_extent = length > 0.0;
        if !has_extent {
            return Err("the positions are all in one place".into());
        }
        let (mut scale, mut rotation, mut place) = (start.scale, start.rotation, start.apply(middle));
        let mut normal = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut squares = 0.0;
        for _ in 0..STEPS {
            normal.fill(0.0);
            let mut right = SVector::<f64, UNKNOWNS>::zeros();
            squares = 0.0;
            for (p, sigma) in &chosen {
                let arm = scale * (rotation * (p.from - middle));
                let residual = p.to - (arm + place);
                squares += (residual / **sigma).length_squared();
                for axis in 0..3 {
                    let unit = DVec3::AXES[axis];
                    // d(turn x arm) along an axis is (arm x axis) . d(turn).
                    let turned = arm.cross(unit) / length;
                    let row = SVector::<f64, UNKNOWNS>::from([
                        turned.x,
                        turned.y,
                        turned.z,
                        unit.x,
                        unit.y,
                        unit.z,
                        arm[axis] / length,
                    ]) / sigma[axis];
                    normal += row * row.transpose();
                    right += row * (residual[axis] / sigma[axis]);
                }
            }
            for d in self.directions {
                let now = rotation * d.from;
                // Points are weighted relative to each other, and so must the directions be.
                let sigma = d.sigma_deg.to_radians() / self.sigma_of(squares, n);
                for unit in DVec3::AXES {
                    let turned = now.cross(unit) / length;
                    let row =
                        SVector::<f64, UNKNOWNS>::from([turned.x, turned.y, turned.z, 0.0, 0.0, 0.0, 0.0])
                            / sigma;
                    normal += row * row.transpose();
                    right += row * ((d.to - now).dot(unit) / sigma);
                }
            }
            let damped = normal + SMatrix::identity() * (SINGULAR * normal.trace());
            let step = damped.cholesky().ok_or_else(unsolved)?.solve(&right);
            let turn = DVec3::new(step[0], step[1], step[2]) / length;
            rotation = DMat3::from_quat(DQuat::from_scaled_axis(turn)) * rotation;
            place += DVec3::new(step[3], step[4], step[5]);
            scale *= (step[6] / length).exp();
            if step.norm() < 1e-9 * length {
                break;
            }
        }
        let transform =
            SimilarityTransform { scale, rotation, translation: place - scale * (rotation * middle) };
        if !(transform.translation.is_finite() && scale > 0.0) {
            return Err(unsolved());
        }
        let sigma = self.sigma_of(squares, n);
        let eigen = normal.symmetric_eigen();
        let largest = eigen.eigenvalues.max();
        let turn = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let part = |k: usize| {
                    let value = eigen.eigenvalues[k];
                    let variance = if value > SINGULAR * largest {
                        sigma * sigma / (value * length * length)
                    } else {
                        OPEN
                    };
                    variance * eigen.eigenvectors[(i, k)] * eigen.eigenvectors[(j, k)]
                };
                (0..UNKNOWNS).map(part).sum()
            })
        });
        Ok(Solution { transform, sigma, turn })
    }

    /// Standard deviation of a coordinate in units of the stated ones, of a sum of squares of some points.
    fn sigma_of(&self, squares: f64, points: f64) -> f64 {
        let redundancy = (3.0 * points - UNKNOWNS as f64).max(1.0);
        (squares / redundancy).sqrt().max(self.least_sigma)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth() -> SimilarityTransform {
        let rotation = DMat3::from_euler(glam::EulerRot::XYZ, 2.9, -0.4, 1.1);
        SimilarityTransform { scale: 7.3, rotation, translation: DVec3::new(5e5, 4e6, 120.0) }
    }

    /// Points with normal errors of a standard deviation at their targets, which are a similarity's images.
    fn pairs(at: impl Iterator<Item = DVec3>, sigma: f64) -> Vec<PointPair> {
        let mut random = CounterRng::new(7, 0, 0, 0);
        at.enumerate()
            .map(|(i, from)| {
                let error = sigma * DVec3::new(random.normal(), random.normal(), random.normal());
                PointPair { name: format!("p{i}"), from, to: truth().apply(from) + error, sigma_m: None }
            })
            .collect()
    }

    fn block() -> impl Iterator<Item = DVec3> {
        (0..20).map(|i| DVec3::new(f64::from(i % 5), f64::from(i / 5), 0.1 * f64::from(i * 7 % 3)))
    }

    /// Points 0.03 off a line of 9.
    fn line() -> impl Iterator<Item = DVec3> {
        (0..10).map(|i| DVec3::new(f64::from(i), 0.03 * f64::from(i * 3 % 4), 0.0))
    }

    fn turned_deg(fit: &SimilarityFit) -> f64 {
        (DQuat::from_mat3(&(fit.transform.rotation * truth().rotation.transpose())).to_axis_angle().1)
            .to_degrees()
    }

    #[test]
    fn wrong_points_are_named_and_do_not_move_the_fit() {
        let mut all = pairs(block(), 0.03);
        (all[3].to, all[4].to) = (all[4].to, all[3].to);
        all[9].to = DVec3::ZERO;
        all[12].to.z += 4000.0;
        let fit = SimilarityFit::new(&all, &[]).unwrap();
        let mut names: Vec<&str> = fit.quality.left_out.iter().map(|(name, _)| name.as_str()).collect();
        names.sort_unstable();
        assert_eq!(names, ["p12", "p3", "p4", "p9"]);
        assert_eq!((fit.quality.points, fit.quality.redundancy), (16, 41));
        assert!((fit.transform.scale - 7.3).abs() < 0.02 && fit.quality.rms_m < 0.08, "{fit:?}");
        assert!(turned_deg(&fit) < 0.3 && fit.is_determined());
    }

    #[test]
    fn right_points_with_normal_errors_are_kept() {
        for sigma in [0.0, 0.01, 0.2] {
            let fit = SimilarityFit::new(&pairs(block(), sigma), &[]).unwrap();
            assert_eq!(fit.quality.left_out, [], "{sigma}");
            assert!((fit.quality.rms_m - sigma * 3f64.sqrt()).abs() <= 0.3 * sigma + 1e-6, "{fit:?}");
        }
    }

    /// The same line is determined by exact positions, and open by noisy ones; the standard deviation says how much.
    #[test]
    fn a_turn_about_a_line_is_as_open_as_the_noise_makes_it() {
        let fit = |sigma| SimilarityFit::new(&pairs(line(), sigma), &[]).unwrap();
        assert!(fit(1e-5).is_determined());
        for sigma in [0.02, 0.05, 0.1] {
            let noisy = fit(sigma);
            assert!(!noisy.is_determined());
            let (turned, stated) =
                (turned_deg(&noisy), noisy.tilt_sigma_deg().max(noisy.heading_sigma_deg()));
            assert!(turned < 4.0 * stated && stated < 40.0 * sigma / 0.1, "{turned} {stated}");
        }
        let exactly = (0..6).map(|i| DVec3::new(f64::from(i), 2.0 * f64::from(i), 1.0));
        assert!(!SimilarityFit::new(&pairs(exactly, 0.0), &[]).unwrap().is_determined());
    }

    #[test]
    fn directions_complete_what_points_leave_open() {
        let down = truth().rotation.transpose() * DVec3::NEG_Z;
        let known = DirectionPair { from: down, to: DVec3::NEG_Z, sigma_deg: 0.1 };
        let noisy = pairs(line(), 0.05);
        let before = SimilarityFit::new(&noisy, &[]).unwrap();
        let fit = SimilarityFit::new(&noisy, &[known]).unwrap();
        assert!(before.tilt_sigma_deg() > 1.0 && fit.tilt_sigma_deg() < 0.11, "{fit:?}");
        assert!((fit.transform.rotation * down).angle_between(DVec3::NEG_Z).to_degrees() < 0.4, "{fit:?}");
    }

    #[test]
    fn stated_accuracies_are_weights_and_a_bound() {
        let mut all = pairs(block(), 0.03);
        all.iter_mut().for_each(|p| p.sigma_m = Some(DVec3::splat(0.03)));
        all[5].to.x += 3.0;
        all[5].sigma_m = Some(DVec3::splat(5.0));
        let fit = SimilarityFit::new(&all, &[]).unwrap();
        assert!(fit.quality.left_out.is_empty() && turned_deg(&fit) < 0.3, "{fit:?}");
        all.iter_mut().for_each(|p| p.sigma_m = Some(DVec3::splat(0.001)));
        assert!(SimilarityFit::new(&all, &[]).unwrap_err().contains("times their stated accuracy"));
    }

    #[test]
    fn too_few_points_and_points_in_one_place_are_refused() {
        assert!(SimilarityFit::new(&pairs(block().take(2), 0.0), &[]).unwrap_err().contains("3 are needed"));
        let mut one_place = pairs(block(), 0.0);
        one_place.iter_mut().for_each(|p| p.to = DVec3::ONE);
        assert!(SimilarityFit::new(&one_place, &[]).unwrap_err().contains("one place"));
    }
}
