//! Which matches of two images are those of one rigid scene, whatever the poses: RANSAC with the eight-point algorithm
//! (Fischler and Bolles 1981; Hartley and Zisserman 2004, section 11.2).

use super::motion::{RayPair, sampson};
use crate::random::CounterRng;
use glam::{DMat3, DVec3};

/// Pairs that determine a matrix.
const MINIMUM: usize = 8;
/// Largest number of samples, and the probability that one of them has no wrong match.
const MOST_SAMPLES: usize = 600;
const CONFIDENCE: f64 = 0.99;
/// Purpose of the random numbers.
const PURPOSE: u64 = 0x6570_6970;

/// Indices of the largest set of pairs found that fit one matrix to a tolerance.
pub(super) fn consensus(pairs: &[RayPair], tolerance: f64, item: u64) -> Vec<usize> {
    let mut draw = CounterRng::new(0, PURPOSE, pairs.len() as u64, item);
    let mut best = Vec::new();
    if pairs.len() < MINIMUM {
        return best;
    }
    let (mut sample, mut needed) = (0, MOST_SAMPLES);
    while sample < needed {
        sample += 1;
        let drawn: [usize; MINIMUM] = std::array::from_fn(|_| draw.below(pairs.len()));
        let Some(matrix) = matrix_of(&drawn.map(|i| pairs[i])) else { continue };
        let fits = |i: &usize| sampson(&matrix, &pairs[*i]) < tolerance;
        let found: Vec<usize> = (0..pairs.len()).filter(fits).collect();
        if found.len() > best.len() {
            best = found;
            let share = best.len() as f64 / pairs.len() as f64;
            let missed = (1.0 - share.powi(MINIMUM as i32)).ln();
            needed = (((1.0 - CONFIDENCE).ln() / missed).ceil() as usize).clamp(1, MOST_SAMPLES);
        }
    }
    best
}

/// The matrix with `y . (M x) = 0` for eight pairs; none if they leave it open, as repeated ones do.
fn matrix_of(pairs: &[RayPair; MINIMUM]) -> Option<DMat3> {
    const UNKNOWNS: usize = MINIMUM + 1;
    let mut rows: [[f64; UNKNOWNS]; MINIMUM] = pairs.map(|[x, y]| {
        let (x, y) = (x.extend(1.0), y.extend(1.0));
        std::array::from_fn(|k| y[k / 3] * x[k % 3])
    });
    // Elimination with a choice of rows and columns; the last column is free.
    let mut columns: [usize; UNKNOWNS] = std::array::from_fn(|k| k);
    for step in 0..MINIMUM {
        let places = (step..MINIMUM).flat_map(|r| (step..UNKNOWNS).map(move |c| (r, c)));
        let size = |(r, c): (usize, usize)| rows[r][columns[c]].abs();
        let (row, column) = places.max_by(|a, b| size(*a).total_cmp(&size(*b)))?;
        if rows[row][columns[column]].abs() < 1e-9 {
            return None;
        }
        rows.swap(step, row);
        columns.swap(step, column);
        let pivot = rows[step];
        for other in (0..MINIMUM).filter(|r| *r != step) {
            let factor = rows[other][columns[step]] / pivot[columns[step]];
            for k in 0..UNKNOWNS {
                rows[other][k] -= factor * pivot[k];
            }
        }
    }
    let free = columns[MINIMUM];
    let mut solution = [0.0; UNKNOWNS];
    solution[free] = 1.0;
    for step in 0..MINIMUM {
        solution[columns[step]] = -rows[step][free] / rows[step][columns[step]];
    }
    let row = |k: usize| DVec3::new(solution[3 * k], solution[3 * k + 1], solution[3 * k + 2]);
    Some(DMat3::from_cols(row(0), row(1), row(2)).transpose())
}

#[cfg(test)]
mod tests {
    use super::super::super::pose::Pose;
    use super::super::motion::Motion;
    use super::*;
    use glam::DVec2;

    #[test]
    fn matches_of_one_motion_are_told_from_wrong_ones() {
        let mut draw = CounterRng::new(3, 0, 0, 0);
        let mut within = |half: f64| half * (2.0 * draw.uniform() - 1.0);
        let a = Pose { cam_from_world: DMat3::IDENTITY, center: DVec3::ZERO };
        let b = Pose { cam_from_world: DMat3::from_rotation_y(0.2), center: DVec3::new(0.4, 0.1, 0.0) };
        let mut pairs: Vec<RayPair> = Vec::new();
        for i in 0..100 {
            let point = DVec3::new(within(1.0), within(0.8), 3.0 + within(1.0));
            let there = b.cam_from_world * (point - b.center);
            let right = [point.truncate() / point.z, there.truncate() / there.z];
            let wrong = [right[0], DVec2::new(within(0.4), within(0.3))];
            pairs.push(if i % 3 == 0 { wrong } else { right });
        }
        let found = consensus(&pairs, 1e-3, 0);
        let right = found.iter().filter(|i| **i % 3 != 0).count();
        assert!(right == 66 && found.len() < 72, "{right} of {}", found.len());
        let motion = Motion::between(&a, &b);
        assert!(found.iter().filter(|i| motion.distance(&pairs[**i]) < 1e-9).count() >= 66);
        assert!(consensus(&pairs[..7], 1e-3, 0).is_empty());
        assert!(consensus(&[pairs[1]; 30], 1e-3, 0).is_empty());
    }
}
