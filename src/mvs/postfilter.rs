//! The last word on a refined surface: where views agree on little the cells around decide, noise of single cells
//! goes, and at steps the trained splats tell which side a cell belongs to. Where views agree, planes, straight edges and
//! right corners stay as they are.

use super::{CONFIDENT, MatchedSurface};
use crate::io::Grid2;

/// A neighbourhood: cells within `reach`, of which the share `lower` (a fraction) lies below the one that is taken.
struct Around {
    reach: i64,
    lower: (usize, usize),
}

/// For cells that are not confident: thirteen, a little less than half lower, for windows fatten what stands out.
const DOUBTFUL: Around = Around { reach: 2, lower: (5, 12) };
/// For all cells: the median of a cell and its four neighbours.
const ALL: Around = Around { reach: 1, lower: (1, 2) };
/// A step between a cell and its four neighbours, metres.
const STEP_M: f32 = 2.0;
/// Score below which splats know better where it is: a window matches whole, splats are as wide as they need to be.
const EXACT: f32 = 0.5;
/// A cell's four neighbours.
const BESIDE: [(i64, i64); 4] = [(1, 0), (0, -1), (-1, 0), (0, 1)];

impl MatchedSurface {
    /// The surface once it is postfiltered; `trained` are the splats' altitudes, NaN where they are not to be
    /// confident.
    #[must_use]
    pub(super) fn postfiltered(mut self, trained: &Grid2) -> Self {
        let decided = DOUBTFUL.decide(&self.altitude, |col, row| self.score.at(col, row) < CONFIDENT);
        let smooth = ALL.decide(&decided, |_, _| true);
        self.altitude = Grid2::from_rows(smooth.width, smooth.height, |row, line| {
            for (col, z) in line.iter_mut().enumerate() {
                let is_exact = self.score.at(col, row) >= EXACT;
                *z = if is_exact {
                    smooth.at(col, row)
                } else {
                    side(&smooth, col, row, trained.at(col, row))
                };
            }
        });
        self
    }
}

/// A cell's altitude; at a step, of its own and its neighbours' the one that is nearest to `trained`.
fn side(altitudes: &Grid2, col: usize, row: usize, trained: f32) -> f32 {
    let own = altitudes.at(col, row);
    if own.is_nan() || trained.is_nan() {
        return own;
    }
    let beside = BESIDE.map(|(right, down)| altitudes.get(col as i64 + right, row as i64 + down));
    let (low, high) = beside.iter().fold((own, own), |(low, high), z| (low.min(*z), high.max(*z)));
    if high - low <= STEP_M {
        return own;
    }
    let nearer = |best: f32, z: f32| if (z - trained).abs() < (best - trained).abs() { z } else { best };
    beside.into_iter().fold(own, nearer)
}

impl Around {
    /// Number of cells.
    const fn cells(&self) -> usize {
        let side = 2 * self.reach + 1;
        let (mut n, mut k) = (0, 0);
        while k < side * side {
            n += self.contains(k % side - self.reach, k / side - self.reach) as usize;
            k += 1;
        }
        n
    }

    /// Whether the cell so far to the right and down is one of them.
    const fn contains(&self, right: i64, down: i64) -> bool {
        right * right + down * down <= self.reach * self.reach
    }

    /// The altitudes, those of the cells that it is `asked` about taken from around them.
    fn decide(&self, altitudes: &Grid2, asked: impl Fn(usize, usize) -> bool + Sync) -> Grid2 {
        Grid2::from_rows(altitudes.width, altitudes.height, |row, line| {
            for (col, z) in line.iter_mut().enumerate() {
                *z = if asked(col, row) { self.pick(altitudes, col, row) } else { altitudes.at(col, row) };
            }
        })
    }

    /// The altitude that is taken for a cell; unknown ones do not count, and stay unknown.
    fn pick(&self, altitudes: &Grid2, col: usize, row: usize) -> f32 {
        if altitudes.at(col, row).is_nan() {
            return f32::NAN;
        }
        let (mut known, mut n) = ([0.0; DOUBTFUL.cells()], 0);
        for down in -self.reach..=self.reach {
            for right in -self.reach..=self.reach {
                let z = altitudes.get(col as i64 + right, row as i64 + down);
                if self.contains(right, down) && !z.is_nan() {
                    known[n] = z;
                    n += 1;
                }
            }
        }
        known[..n].sort_unstable_by(f32::total_cmp);
        let (part, of) = self.lower;
        known[(n - 1) * part / of]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Point, SiteGrid};
    use crate::io::MapGrid;

    fn postfiltered(altitude: Grid2, score: impl Fn(usize, usize) -> f32) -> Grid2 {
        let unknown = Grid2::filled(altitude.width, altitude.height, f32::NAN);
        settled_by(altitude, score, &unknown)
    }

    fn settled_by(altitude: Grid2, score: impl Fn(usize, usize) -> f32, trained: &Grid2) -> Grid2 {
        let (width, height) = (altitude.width, altitude.height);
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.0, 3_357_600.0, 10.0) };
        let grid = MapGrid { epsg: 32617, west: 436_190.0, north: 3_357_610.0, cell: 0.5, width, height };
        let (score, prior_weight) = (Grid2::from_fn(width, height, score), Grid2::filled(width, height, 0.0));
        MatchedSurface { site, grid, altitude, score, prior_weight }.postfiltered(trained).altitude
    }

    #[test]
    fn a_block_s_edges_and_corners_stay_and_a_lone_cell_goes() {
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
    fn a_clump_stays_if_it_is_believed() {
        let clump = |col: usize, row: usize| (8..10).contains(&col) && (7..9).contains(&row);
        let surface = || Grid2::from_fn(20, 16, |col, row| if clump(col, row) { 5.0 } else { 0.0 });
        assert_eq!(postfiltered(surface(), |_, _| 0.9), surface());
        let out = postfiltered(surface(), |col, row| if clump(col, row) { 0.2 } else { 0.9 });
        assert_eq!(out, Grid2::filled(20, 16, 0.0));
    }

    #[test]
    fn splats_say_where_a_step_is_unless_views_agree_or_the_step_is_small() {
        let step = |at: usize, height: f32| {
            Grid2::from_fn(20, 16, move |col, _| if col < at { height } else { 0.1 })
        };
        let trained = step(11, 7.0);
        assert_eq!(settled_by(step(10, 8.0), |_, _| 0.45, &trained), step(11, 8.0));
        assert_eq!(settled_by(step(10, 8.0), |_, _| 0.55, &trained), step(10, 8.0));
        assert_eq!(settled_by(step(10, 1.5), |_, _| 0.45, &trained), step(10, 1.5));
        // A cell further than the next is not theirs to move.
        assert_eq!(settled_by(step(9, 8.0), |_, _| 0.45, &trained), step(10, 8.0));
    }

    #[test]
    fn the_unknown_stays_unknown_and_counts_for_nothing() {
        let surface = Grid2::from_fn(9, 9, |col, _| if col < 4 { f32::NAN } else { 3.0 });
        let out = postfiltered(surface, |_, _| 0.1);
        assert!(out.at(3, 4).is_nan() && out.at(4, 4) == 3.0);
    }
}
