//! Filtering of the refined surface.
//!
//! 1. Cells that are not confident take a low percentile of the altitudes around them.
//! 2. A small median filter removes noise of single cells. It preserves planes, straight edges and
//!    right-angled corners.
//! 3. Next to a discontinuity, cells that are not confident take the altitude of the side that the trained splats
//!    are nearer to: these are not limited by the size of a window.
//! 4. Each cell takes the altitude of the plane of least squares of the cells around it, of which only those count that
//!    lie on it. That removes noise of a few decimetres and leaves edges where they are.

use super::surface::{CONFIDENT, MatchedSurface};
use crate::io::Grid2;
use nalgebra::{Matrix3, Vector3};

/// A rank filter: the value of a given quantile among the cells of a disc.
struct RankFilter {
    /// Radius of the disc, cells.
    radius: i64,
    /// The quantile, as numerator and denominator.
    quantile: (usize, usize),
}

/// For cells that are not confident: thirteen cells, and slightly less than the median, because matching in
/// windows enlarges elevated objects (foreground fattening).
const UNCONFIDENT: RankFilter = RankFilter { radius: 2, quantile: (5, 12) };
/// For all cells: the median of a cell and its four neighbours.
const MEDIAN: RankFilter = RankFilter { radius: 1, quantile: (1, 2) };
/// Difference of altitude among a cell and its four neighbours from which on it is a discontinuity, metres.
const DISCONTINUITY_M: f32 = 2.0;
/// Half the side of the square whose cells a plane is fitted to, cells; distance from the plane up to which cells lie on it, metres;
/// number of fits, the first to the cells around the altitude of the cell itself; and fewest cells of a plane.
const PLANE_RADIUS: i64 = 3;
const PLANE_TOLERANCE_M: f32 = 0.15;
const PLANE_FITS: usize = 3;
const PLANE_CELLS: f64 = 6.0;
/// For the first fit the tolerance grows with the distance from the cell by this part for each cell: slopes are not known yet.
const SLOPE_ALLOWANCE: f32 = 0.3;
/// Added to the sums of squares, square cells: planes of few cells are nearly level rather than steep.
const LEVELNESS: f64 = 1e-3;
/// Offsets (right, down) of the four neighbours of a cell.
const NEIGHBOURS: [(i64, i64); 4] = [(1, 0), (0, -1), (-1, 0), (0, 1)];

impl MatchedSurface {
    /// The filtered surface. `trained` holds the altitudes of the trained splats, site metres; NaN where they
    /// are not to be used.
    #[must_use]
    pub(super) fn postfiltered(mut self, trained: &Grid2) -> Self {
        let filled = UNCONFIDENT.apply(&self.altitude, |col, row| self.score.at(col, row) < CONFIDENT);
        let smooth = MEDIAN.apply(&filled, |_, _| true);
        self.altitude = Grid2::from_rows(smooth.width, smooth.height, |row, line| {
            for (col, z) in line.iter_mut().enumerate() {
                let is_confident = self.score.at(col, row) >= CONFIDENT;
                *z = if is_confident {
                    smooth.at(col, row)
                } else {
                    snapped(&smooth, col, row, trained.at(col, row))
                };
            }
        });
        self.altitude = Grid2::from_rows(self.altitude.width, self.altitude.height, |row, line| {
            line.iter_mut().enumerate().for_each(|(col, z)| *z = on_plane(&self.altitude, col, row));
        });
        self
    }
}

/// The altitude of a cell on the plane of least squares of the cells around it that lie on it; its own if these are too few.
fn on_plane(altitudes: &Grid2, col: usize, row: usize) -> f32 {
    let own = altitudes.at(col, row);
    if own.is_nan() {
        return own;
    }
    // Altitude in the cell and its slopes per cell, right and down.
    let mut plane = [own, 0.0, 0.0];
    for fit in 0..PLANE_FITS {
        let (mut normal, mut sums, mut cells) = (Matrix3::<f64>::zeros(), Vector3::zeros(), 0.0);
        for down in -PLANE_RADIUS..=PLANE_RADIUS {
            for right in -PLANE_RADIUS..=PLANE_RADIUS {
                let z = altitudes.get(col as i64 + right, row as i64 + down);
                let (x, y) = (right as f32, down as f32);
                let allowance = if fit == 0 { 1.0 + SLOPE_ALLOWANCE * x.hypot(y) } else { 1.0 };
                // Unknown altitudes are on no plane.
                if (z - plane[0] - plane[1] * x - plane[2] * y).abs() < PLANE_TOLERANCE_M * allowance {
                    let place = Vector3::new(1.0, f64::from(x), f64::from(y));
                    normal += place * place.transpose();
                    sums += place * f64::from(z - own);
                    cells += 1.0;
                }
            }
        }
        normal += Matrix3::from_diagonal(&Vector3::new(0.0, LEVELNESS, LEVELNESS));
        let Some(solved) = normal.cholesky().filter(|_| cells >= PLANE_CELLS).map(|n| n.solve(&sums)) else {
            return own;
        };
        plane = [own + solved[0] as f32, solved[1] as f32, solved[2] as f32];
    }
    plane[0]
}

/// The altitude of a cell; at a discontinuity, that one of its own and its neighbours' which is nearest to `trained`.
fn snapped(altitudes: &Grid2, col: usize, row: usize, trained: f32) -> f32 {
    let own = altitudes.at(col, row);
    if own.is_nan() || trained.is_nan() {
        return own;
    }
    let neighbours = NEIGHBOURS.map(|(right, down)| altitudes.get(col as i64 + right, row as i64 + down));
    let (low, high) = neighbours.iter().fold((own, own), |(low, high), z| (low.min(*z), high.max(*z)));
    if high - low <= DISCONTINUITY_M {
        return own;
    }
    let nearer = |best: f32, z: f32| if (z - trained).abs() < (best - trained).abs() { z } else { best };
    neighbours.into_iter().fold(own, nearer)
}

impl RankFilter {
    /// Number of cells of the disc.
    const fn cells(&self) -> usize {
        let side = 2 * self.radius + 1;
        let (mut n, mut k) = (0, 0);
        while k < side * side {
            n += self.contains(k % side - self.radius, k / side - self.radius) as usize;
            k += 1;
        }
        n
    }

    /// Whether the disc contains the cell at an offset from its centre.
    const fn contains(&self, right: i64, down: i64) -> bool {
        right * right + down * down <= self.radius * self.radius
    }

    /// Filters the altitudes of the cells that are `selected` by column and row.
    fn apply(&self, altitudes: &Grid2, selected: impl Fn(usize, usize) -> bool + Sync) -> Grid2 {
        Grid2::from_rows(altitudes.width, altitudes.height, |row, line| {
            for (col, z) in line.iter_mut().enumerate() {
                *z =
                    if selected(col, row) { self.value(altitudes, col, row) } else { altitudes.at(col, row) };
            }
        })
    }

    /// The filtered altitude of a cell. Unknown altitudes (NaN) stay unknown, and do not count for other cells.
    fn value(&self, altitudes: &Grid2, col: usize, row: usize) -> f32 {
        if altitudes.at(col, row).is_nan() {
            return f32::NAN;
        }
        let (mut known, mut n) = ([0.0; UNCONFIDENT.cells()], 0);
        for down in -self.radius..=self.radius {
            for right in -self.radius..=self.radius {
                let z = altitudes.get(col as i64 + right, row as i64 + down);
                if self.contains(right, down) && !z.is_nan() {
                    known[n] = z;
                    n += 1;
                }
            }
        }
        known[..n].sort_unstable_by(f32::total_cmp);
        let (numerator, denominator) = self.quantile;
        known[(n - 1) * numerator / denominator]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Point, SiteGrid};
    use crate::io::MapGrid;

    fn postfiltered(altitude: Grid2, score: impl Fn(usize, usize) -> f32) -> Grid2 {
        let unknown = Grid2::filled(altitude.width, altitude.height, f32::NAN);
        postfiltered_with(altitude, score, &unknown)
    }

    fn postfiltered_with(altitude: Grid2, score: impl Fn(usize, usize) -> f32, trained: &Grid2) -> Grid2 {
        let (width, height) = (altitude.width, altitude.height);
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.0, 3_357_600.0, 10.0) };
        let grid = MapGrid { epsg: 32617, west: 436_190.0, north: 3_357_610.0, cell: 0.5, width, height };
        let (score, prior_weight) = (Grid2::from_fn(width, height, score), Grid2::filled(width, height, 0.0));
        MatchedSurface { site, grid, altitude, score, prior_weight }.postfiltered(trained).altitude
    }

    #[test]
    fn edges_and_corners_of_a_block_are_kept_and_single_cells_are_removed() {
        let block = Grid2::from_fn(20, 16, |col, row| {
            if (5..12).contains(&col) && (4..10).contains(&row) { 9.0 } else { 0.1 * col as f32 }
        });
        let mut noisy = block.clone();
        noisy.data[13 * 20 + 15] = 20.0;
        let out = postfiltered(noisy, |_, _| 0.9);
        for (i, (a, b)) in out.data.iter().zip(&block.data).enumerate() {
            let (col, row) = (i % 20, i / 20);
            let is_inside = (1..19).contains(&col) && (1..15).contains(&row);
            assert!(!is_inside || (a - b).abs() < 0.11, "{col} {row}: {a} {b}");
        }
    }

    #[test]
    fn noise_of_a_slope_is_reduced_and_a_ridge_and_a_small_step_stay() {
        let slope = |col: usize, row: usize| 0.2 * col as f32 - 0.1 * row as f32;
        let noise = |col: usize, row: usize| 0.06 * (((col * 7 + row * 13) % 11) as f32 / 5.0 - 1.0);
        let rms = |surface: &Grid2| {
            let inside = (4..36).flat_map(|row| (4..36).map(move |col| (col, row)));
            (inside.map(|(c, r)| (surface.at(c, r) - slope(c, r)).powi(2)).sum::<f32>() / 1024.0).sqrt()
        };
        let noisy = Grid2::from_fn(40, 40, |c, r| slope(c, r) + noise(c, r));
        let smooth = postfiltered(noisy.clone(), |_, _| 0.9);
        assert!(rms(&smooth) < 0.5 * rms(&noisy), "{} of {}", rms(&smooth), rms(&noisy));
        let ridge = |col: usize| 8.0 - 0.4 * (col as f32 - 19.5).abs();
        let step = |col: usize| if col < 20 { 1.0 } else { 0.0 };
        for shape in [&ridge as &dyn Fn(usize) -> f32, &step] {
            let out = postfiltered(Grid2::from_fn(40, 40, |col, _| shape(col)), |_, _| 0.9);
            let worst = (4..36).map(|col| (out.at(col, 20) - shape(col)).abs()).fold(0.0, f32::max);
            assert!(worst < 0.11, "{worst}");
        }
    }

    #[test]
    fn a_group_of_cells_is_kept_if_it_is_confident() {
        let group = |col: usize, row: usize| (8..10).contains(&col) && (7..9).contains(&row);
        let surface = || Grid2::from_fn(20, 16, |col, row| if group(col, row) { 5.0 } else { 0.0 });
        assert_eq!(postfiltered(surface(), |_, _| 0.9), surface());
        let out = postfiltered(surface(), |col, row| if group(col, row) { 0.2 } else { 0.9 });
        assert_eq!(out, Grid2::filled(20, 16, 0.0));
    }

    #[test]
    fn splats_locate_a_discontinuity_unless_the_score_is_high_or_the_step_is_small() {
        let step = |at: usize, height: f32| {
            Grid2::from_fn(20, 16, move |col, _| if col < at { height } else { 0.1 })
        };
        let trained = step(11, 7.0);
        assert_eq!(postfiltered_with(step(10, 8.0), |_, _| 0.35, &trained), step(11, 8.0));
        assert_eq!(postfiltered_with(step(10, 8.0), |_, _| 0.45, &trained), step(10, 8.0));
        assert_eq!(postfiltered_with(step(10, 1.5), |_, _| 0.35, &trained), step(10, 1.5));
        // The discontinuity moves by one cell at most.
        assert_eq!(postfiltered_with(step(9, 8.0), |_, _| 0.35, &trained), step(10, 8.0));
    }

    #[test]
    fn unknown_altitudes_stay_unknown_and_do_not_count() {
        let surface = Grid2::from_fn(9, 9, |col, _| if col < 4 { f32::NAN } else { 3.0 });
        let out = postfiltered(surface, |_, _| 0.1);
        assert!(out.at(3, 4).is_nan() && out.at(4, 4) == 3.0);
    }
}
