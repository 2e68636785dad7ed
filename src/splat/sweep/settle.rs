//! The last word on a sharpened surface: where views agree on little the cells around decide, and noise of single cells
//! goes. Where they agree, planes, straight edges and right corners stay as they are.

use super::{BELIEVED, SweptSurface};
use crate::raster::Plane;

/// A neighbourhood: cells within `reach`, of which the share `lower` (a fraction) lies below the one that is taken.
struct Around {
    reach: i64,
    lower: (usize, usize),
}

/// For cells that are not believed: thirteen, a little less than half lower, for windows fatten what stands out.
const DOUBTFUL: Around = Around { reach: 2, lower: (5, 12) };
/// For all cells: the median of a cell and its four neighbours.
const ALL: Around = Around { reach: 1, lower: (1, 2) };

impl SweptSurface {
    /// The surface once it is settled.
    #[must_use]
    pub(super) fn settled(mut self) -> Self {
        let decided = DOUBTFUL.decide(&self.altitude, |col, row| self.score.at(col, row) < BELIEVED);
        self.altitude = ALL.decide(&decided, |_, _| true);
        self
    }
}

impl Around {
    /// The altitudes, those of the cells that it is `asked` about taken from around them.
    fn decide(&self, altitudes: &Plane, asked: impl Fn(usize, usize) -> bool + Sync) -> Plane {
        Plane::from_rows(altitudes.width, altitudes.height, |row, line| {
            for (col, z) in line.iter_mut().enumerate() {
                *z = if asked(col, row) { self.pick(altitudes, col, row) } else { altitudes.at(col, row) };
            }
        })
    }

    /// The altitude that is taken for a cell; unknown ones do not count, and stay unknown.
    fn pick(&self, altitudes: &Plane, col: usize, row: usize) -> f32 {
        if altitudes.at(col, row).is_nan() {
            return f32::NAN;
        }
        let (mut known, mut n) = ([0.0; 13], 0);
        for down in -self.reach..=self.reach {
            for right in -self.reach..=self.reach {
                let z = altitudes.get(col as i64 + right, row as i64 + down);
                if right * right + down * down <= self.reach * self.reach && !z.is_nan() {
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
    use crate::raster::MapGrid;

    fn settled(altitude: Plane, score: impl Fn(usize, usize) -> f32) -> Plane {
        let (width, height) = (altitude.width, altitude.height);
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.0, 3_357_600.0, 10.0) };
        let grid = MapGrid { epsg: 32617, west: 436_190.0, north: 3_357_610.0, cell: 0.5, width, height };
        let (score, hold) = (Plane::from_fn(width, height, score), Plane::filled(width, height, 0.0));
        SweptSurface { site, grid, altitude, score, hold }.settled().altitude
    }

    #[test]
    fn a_block_s_edges_and_corners_stay_and_a_lone_cell_goes() {
        let block = Plane::from_fn(20, 16, |col, row| {
            if (5..12).contains(&col) && (4..10).contains(&row) { 9.0 } else { 0.1 * col as f32 }
        });
        let mut noisy = block.clone();
        noisy.data[13 * 20 + 15] = 20.0;
        let out = settled(noisy, |_, _| 0.9);
        for (i, (a, b)) in out.data.iter().zip(&block.data).enumerate() {
            let (col, row) = (i % 20, i / 20);
            let is_inside = (1..19).contains(&col) && (1..15).contains(&row);
            assert!(!is_inside || (a - b).abs() < 0.11, "{col} {row}: {a} {b}");
        }
    }

    #[test]
    fn a_clump_stays_if_it_is_believed() {
        let clump = |col: usize, row: usize| (8..10).contains(&col) && (7..9).contains(&row);
        let surface = || Plane::from_fn(20, 16, |col, row| if clump(col, row) { 5.0 } else { 0.0 });
        assert_eq!(settled(surface(), |_, _| 0.9), surface());
        let out = settled(surface(), |col, row| if clump(col, row) { 0.2 } else { 0.9 });
        assert_eq!(out, Plane::filled(20, 16, 0.0));
    }

    #[test]
    fn the_unknown_stays_unknown_and_counts_for_nothing() {
        let surface = Plane::from_fn(9, 9, |col, _| if col < 4 { f32::NAN } else { 3.0 });
        let out = settled(surface, |_, _| 0.1);
        assert!(out.at(3, 4).is_nan() && out.at(4, 4) == 3.0);
    }
}
