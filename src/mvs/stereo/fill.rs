//! Filling of the cells for which no two views agree on an altitude.
//!
//! Two kinds of ground need opposite rules. Beside a step, what no two views see is occluded and lies low. Terrain is
//! continuous, and what was not matched lies between what was. Which kind a place is of, the matched surface tells
//! (`steps`): where it has steps, altitudes are interpolated only between borders that agree in all directions.

use super::steps::share_of_steps;
use crate::io::Grid2;
use crate::mvs::plane_sweep::PlaneSweep;
use rayon::prelude::*;

/// Width of the gaps within a surface that are interpolated, cells.
const GAP_CELLS: i64 = 2;
/// Largest distance of the cells from which others are filled, metres.
const FILL_RADIUS_M: f64 = 40.0;
/// Rank, from the lowest, of the altitude that fills an occluded cell among those found in eight directions: occluded
/// surfaces lie below what occludes them (Hirschmüller 2008, §2.6.3).
const FILL_RANK: usize = 1;
/// Number of directions in which an altitude must be found. Nothing is filled outside of the matched surface.
const MIN_FILL_DIRECTIONS: usize = 5;
/// Offsets (right, down) of the eight directions.
const DIRECTIONS: [(i64, i64); 8] = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];
/// Share of steps in the matched surface around a cell below which the surface there is terrain. Towns have 1.8 %, mountains
/// 0.1 %, a house of 10 x 10 m in a field 0.6 %.
const TERRAIN_STEPS: f32 = 0.006;
/// Largest mismatch of the surface across a hole, metres for each metre of its width: on terrain, and among steps, where
/// occluded ground beside a wall must not become a slope. Chosen on a simulated town and on pairs of a mountain and of Gizeh.
const TERRAIN_SLOPE: f32 = 1.6;
const SLOPE_AMONG_STEPS: f32 = 0.2;
/// The same of a hole without width among steps, metres; on terrain it is a discontinuity.
const MISMATCH_AMONG_STEPS_M: f32 = 0.5;
/// Number of cells beyond a border over which the slope of the surface is taken.
const SLOPE_CELLS: i64 = 8;
/// Number of passes that smooth what was filled.
const SMOOTHING_PASSES: usize = 200;

/// Closes gaps of up to [`GAP_CELLS`] cells, which the pixels of the maps leave within a surface: cells take
/// the mean altitude and score of both sides, if these differ by at most `max_step_m` metres.
pub(super) fn close_gaps(altitude: &mut Grid2, score: &mut Grid2, max_step_m: f32) {
    let (known, scores) = (altitude.clone(), score.clone());
    let width = known.width;
    let rows = altitude.data.par_chunks_mut(width).zip(score.data.par_chunks_mut(width));
    rows.enumerate().for_each(|(row, (altitude, score))| {
        for (col, (z, s)) in altitude.iter_mut().zip(score).enumerate().filter(|(_, (z, _))| z.is_nan()) {
            let nearest = |c: i64, r: i64| {
                let cells = (1..=GAP_CELLS).map(|k| (col as i64 + c * k, row as i64 + r * k));
                let mut values = cells.map(|(c, r)| (known.get(c, r), scores.get(c, r)));
                values.find(|(z, _)| !z.is_nan())
            };
            let across = DIRECTIONS[..4].iter().filter_map(|(c, r)| nearest(*c, *r).zip(nearest(-c, -r)));
            let flattest = across.min_by(|(a, b), (c, d)| (a.0 - b.0).abs().total_cmp(&(c.0 - d.0).abs()));
            if let Some((a, b)) = flattest.filter(|(a, b)| (a.0 - b.0).abs() <= max_step_m) {
                (*z, *s) = (0.5 * (a.0 + b.0), 0.5 * (a.1 + b.1));
            }
        }
    });
}

/// Fills cells without altitude from their surroundings, if at least two images cover the filled point. Their
/// score is 0. Neighbours that differ by more than `discontinuity_m` metres lie on two surfaces.
pub(super) fn fill(sweep: &PlaneSweep, altitude: &mut Grid2, score: &mut Grid2, discontinuity_m: f32) {
    let known = altitude.clone();
    let reach = (FILL_RADIUS_M / sweep.grid.cell) as i64;
    let steps = share_of_steps(&known, sweep.grid.cell, discontinuity_m, reach as usize);
    let surface = Surface { known: &known, reach, discontinuity_m };
    let of_terrain = Continuity::of_terrain(discontinuity_m, sweep.grid.cell as f32);
    let among_steps = Continuity::among_steps(sweep.grid.cell as f32);
    let filled = |i: usize| {
        let (col, row) = (i % known.width, i / known.width);
        let borders = surface.borders(col as i64, row as i64);
        let mut found: Vec<f32> = borders.iter().flatten().map(|border| border.altitude).collect();
        if found.len() < MIN_FILL_DIRECTIONS {
            return None;
        }
        let (z, step_m) = if steps.data[i] < TERRAIN_STEPS {
            let z = of_terrain.interpolate(&borders).unwrap_or_else(|| mean_of(&borders));
            (z, of_terrain.mismatch_m)
        } else {
            found.sort_unstable_by(f32::total_cmp);
            let z = among_steps.interpolate(&borders).or_else(|| found.get(FILL_RANK).copied())?;
            (z, among_steps.mismatch_m)
        };
        (sweep.covering_views(col, row, z) >= 2).then_some((z, Filled { cell: i, step_m }))
    };
    let unknown = (0..known.data.len()).into_par_iter().filter(|i| known.data[*i].is_nan());
    let filled: Vec<(f32, Filled)> = unknown.filter_map(filled).collect();
    score.data.iter_mut().zip(&known.data).filter(|(_, z)| z.is_nan()).for_each(|(score, _)| *score = 0.0);
    filled.iter().for_each(|(z, filled)| altitude.data[filled.cell] = *z);
    let filled: Vec<Filled> = filled.into_iter().map(|(_, filled)| filled).collect();
    smooth(altitude, &filled);
}

/// A cell that was filled, and the difference to a neighbour above which that is of another surface, metres.
struct Filled {
    cell: usize,
    step_m: f32,
}

/// Moves these cells towards the mean of their neighbours on the same surface, again and again: what was filled cell by cell then
/// has no steps of its own, and continues what was matched.
fn smooth(altitude: &mut Grid2, filled: &[Filled]) {
    let width = altitude.width as i64;
    for _ in 0..SMOOTHING_PASSES {
        let mean = |Filled { cell, step_m }: &Filled| {
            let (col, row, z) = (*cell as i64 % width, *cell as i64 / width, altitude.data[*cell]);
            let around = DIRECTIONS.iter().step_by(2).map(|(c, r)| altitude.get(col + c, row + r));
            let same = around.filter(|other| (other - z).abs() <= *step_m);
            let (sum, n) = same.fold((0.0, 0.0), |(sum, n), other| (sum + other, n + 1.0));
            if n > 0.0 { sum / n } else { z }
        };
        let means: Vec<f32> = filled.par_iter().map(mean).collect();
        filled.iter().zip(means).for_each(|(filled, z)| altitude.data[filled.cell] = z);
    }
}

/// The matched surface, and how far to look on it.
struct Surface<'a> {
    known: &'a Grid2,
    reach: i64,
    discontinuity_m: f32,
}

/// The matched surface beside a hole, in one direction.
struct Border {
    altitude: f32,
    /// Cells.
    distance: f32,
    /// Slope, metres upwards for each cell towards the hole.
    climb: f32,
}

impl Surface<'_> {
    /// The borders around a cell in all [`DIRECTIONS`].
    fn borders(&self, col: i64, row: i64) -> [Option<Border>; DIRECTIONS.len()] {
        DIRECTIONS.map(|(c, r)| {
            let at = |k: i64| self.known.get(col + c * k, row + r * k);
            let first = (1..=self.reach).find(|k| !at(*k).is_nan())?;
            let is_same = |k: &i64| (at(*k) - at(k - 1)).abs() <= self.discontinuity_m;
            let last = (first + 1..=first + SLOPE_CELLS).take_while(is_same).last();
            let length = ((c * c + r * r) as f32).sqrt();
            let climb = last.map_or(0.0, |last| (at(first) - at(last)) / ((last - first) as f32 * length));
            Some(Border { altitude: at(first), distance: first as f32 * length, climb })
        })
    }
}

/// Mean altitude of borders; near ones weigh more.
fn mean_of(borders: &[Option<Border>]) -> f32 {
    let weighted = borders.iter().flatten().map(|border| (border.altitude, border.distance.powi(-2)));
    let (sum, weight) = weighted.fold((0.0, 0.0), |(sum, total), (z, w)| (sum + w * z, total + w));
    sum / weight
}

/// When the surface is continuous across a hole.
struct Continuity {
    /// Largest mismatch of both sides, extended to the middle: metres, and metres for each cell between them.
    mismatch_m: f32,
    slope: f32,
    /// Whether it must be so in all directions, with the same altitude; else in half of them.
    is_everywhere: bool,
}

impl Continuity {
    /// Where the surface has no steps.
    fn of_terrain(discontinuity_m: f32, cell_m: f32) -> Self {
        Self { mismatch_m: discontinuity_m, slope: TERRAIN_SLOPE * cell_m, is_everywhere: false }
    }

    /// Where it has steps.
    fn among_steps(cell_m: f32) -> Self {
        Self { mismatch_m: MISMATCH_AMONG_STEPS_M, slope: SLOPE_AMONG_STEPS * cell_m, is_everywhere: true }
    }

    /// The altitude between opposite borders, if the surface is continuous.
    fn interpolate(&self, borders: &[Option<Border>; DIRECTIONS.len()]) -> Option<f32> {
        let (one, other) = borders.split_at(DIRECTIONS.len() / 2);
        let opposite: Vec<(&Border, &Border)> =
            one.iter().zip(other).filter_map(|(a, b)| a.as_ref().zip(b.as_ref())).collect();
        let most_m = |width: f32| self.mismatch_m + self.slope * width;
        let is_continuous = |(a, b): &&(&Border, &Border)| {
            let width = a.distance + b.distance;
            let step = a.altitude - b.altitude;
            let extended = step + 0.5 * width * (a.climb - b.climb);
            step.abs().min(extended.abs()) <= most_m(width)
        };
        let continuous: Vec<_> = opposite.iter().filter(is_continuous).collect();
        if continuous.is_empty() || 2 * continuous.len() < opposite.len() {
            return None;
        }
        let width = |(a, b): &(&Border, &Border)| a.distance + b.distance;
        let between = |pair: &(&Border, &Border)| {
            let (a, b) = pair;
            (a.altitude * b.distance + b.altitude * a.distance) / width(pair)
        };
        if self.is_everywhere {
            let values = || continuous.iter().map(|pair| between(pair));
            let spread = values().fold(f32::MIN, f32::max) - values().fold(f32::MAX, f32::min);
            let narrowest = continuous.iter().map(|pair| width(pair)).fold(f32::MAX, f32::min);
            if continuous.len() < opposite.len() || spread > most_m(narrowest) {
                return None;
            }
        }
        let weighted = continuous.iter().map(|pair| (between(pair), width(pair).powi(-2)));
        let (sum, weight) = weighted.fold((0.0, 0.0), |(sum, total), (z, w)| (sum + w * z, total + w));
        Some(sum / weight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 41;

    /// A surface with a hole where this holds, and its continuity in the middle by a rule.
    fn middle(
        z: impl Fn(f32, f32) -> f32,
        is_hole: impl Fn(f32, f32) -> bool,
        rule: &Continuity,
    ) -> Option<f32> {
        let known = Grid2::from_fn(SIZE, SIZE, |col, row| {
            let (x, y) = (col as f32 - 20.0, row as f32 - 20.0);
            if is_hole(x, y) { f32::NAN } else { z(x, y) }
        });
        let surface = Surface { known: &known, reach: 30, discontinuity_m: 1.5 };
        rule.interpolate(&surface.borders(20, 20))
    }

    fn rules() -> [Continuity; 2] {
        [Continuity::of_terrain(1.5, 0.5), Continuity::among_steps(0.5)]
    }

    #[test]
    fn a_slope_goes_on_across_a_hole() {
        let hole = |x: f32, y: f32| x.hypot(y) < 6.0;
        for rule in rules() {
            let z = middle(|x, y| 30.0 + 0.4 * x - 0.3 * y, hole, &rule).unwrap();
            assert!((z - 30.0).abs() < 0.1, "{z}");
        }
        // A ridge in the hole: both sides rise towards it.
        let z = middle(|x, _| 30.0 - 0.4 * x.abs(), hole, &rules()[0]).unwrap();
        assert!((28.0..30.0).contains(&z), "{z}");
    }

    #[test]
    fn occluded_ground_between_a_roof_and_the_ground_is_no_slope() {
        let step = |x: f32, _: f32| if x > 0.0 { 12.0 } else { 0.0 };
        let hole = |x: f32, _: f32| (-6.0..=0.0).contains(&x);
        let [_, among_steps] = rules();
        assert_eq!(middle(step, hole, &among_steps), None);
        // A narrow courtyard between roofs, whose ends show the ground.
        let court = |x: f32, y: f32| if x.abs() > 4.0 && y.abs() < 15.0 { 12.0 } else { 0.0 };
        assert_eq!(middle(court, |x, y| x.abs() <= 4.0 && y.abs() < 15.0, &among_steps), None);
    }

    #[test]
    fn what_is_smoothed_has_no_steps_and_stays_apart_from_walls() {
        let mut altitude = Grid2::from_fn(SIZE, 9, |col, _| match col {
            0..10 => 0.0,
            10..20 => {
                if col < 15 {
                    0.2
                } else {
                    1.1
                }
            }
            20..25 => 1.0,
            _ => 9.0,
        });
        let cells = (0..altitude.data.len()).filter(|i| (10..20).contains(&(i % SIZE)));
        let filled: Vec<Filled> = cells.map(|cell| Filled { cell, step_m: 1.5 }).collect();
        smooth(&mut altitude, &filled);
        let row = altitude.row(4);
        assert!(row[9..21].windows(2).all(|w| (0.0..0.2).contains(&(w[1] - w[0]))), "{row:?}");
        assert_eq!((row[24], row[25]), (1.0, 9.0));
    }
}
