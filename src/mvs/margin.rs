//! Noise at the margin of a refined surface.
//!
//! Beyond the ground that most views share only a few see a cell, and what these agree on may be noise, metres up and down from
//! cell to cell. Such cells are nodata if a path of others like them, or of unknown ones, leads out of the grid.

use super::plane_sweep::PlaneSweep;
use super::surface::MatchedSurface;
use crate::io::{Grid2, ValidPixels};
use rayon::prelude::*;

/// Share of the largest number of views of a cell below which a cell has few views.
const FEW_VIEWS_SHARE: f32 = 0.35;
/// Mean score of the known cells around a cell below which it may be noise. Scores of refined surfaces include the distance from
/// the prior.
const NOISE_SCORE: f32 = 0.35;
/// Difference of the highest and the lowest altitude around a cell above which it may be noise, metres.
const NOISE_M: f32 = 6.0;
/// Radius of the square neighbourhood around a cell, cells.
const RADIUS: i64 = 2;

impl PlaneSweep {
    /// Makes cells of the margin of `surface` that are noise unknown (NaN).
    pub(super) fn remove_noisy_margin(&self, surface: &mut MatchedSurface) {
        let (width, height) = (self.grid.width, self.grid.height);
        let views: Vec<usize> = (0..width * height)
            .into_par_iter()
            .map(|cell| self.covering_views(cell % width, cell / width, surface.altitude.data[cell]))
            .collect();
        let few = FEW_VIEWS_SHARE * views.iter().copied().max().unwrap_or(0) as f32;
        let is_noise: Vec<bool> = (0..width * height)
            .into_par_iter()
            .map(|cell| (views[cell] as f32) < few && surface.is_rough_and_unconfident(cell))
            .collect();
        let margin = margin(&surface.altitude, &is_noise);
        for cell in (0..width * height).filter(|cell| margin.at(cell % width, cell / width)) {
            surface.altitude.data[cell] = f32::NAN;
            surface.score.data[cell] = 0.0;
        }
    }
}

impl MatchedSurface {
    fn is_rough_and_unconfident(&self, cell: usize) -> bool {
        let (col, row) = ((cell % self.grid.width) as i64, (cell / self.grid.width) as i64);
        let (mut low, mut high, mut score, mut known) = (f32::INFINITY, f32::NEG_INFINITY, 0.0, 0.0);
        for r in row - RADIUS..=row + RADIUS {
            for c in col - RADIUS..=col + RADIUS {
                let z = self.altitude.get(c, r);
                if !z.is_nan() {
                    (low, high) = (low.min(z), high.max(z));
                    (score, known) = (score + self.score.get(c, r), known + 1.0);
                }
            }
        }
        score < NOISE_SCORE * known && high - low > NOISE_M
    }
}

/// The cells that are unknown or noise, and from which a path of such cells leads out of the grid.
fn margin(altitude: &Grid2, is_noise: &[bool]) -> ValidPixels {
    let mut out = ValidPixels::filled(altitude.width, altitude.height, false);
    for (cell, z) in altitude.data.iter().enumerate() {
        out.set(cell % altitude.width, cell / altitude.width, is_noise[cell] || z.is_nan());
    }
    out.connected_with_border()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Point, SiteGrid};
    use crate::io::MapGrid;

    fn surface(altitude: Grid2, score: f32) -> MatchedSurface {
        let (width, height) = (altitude.width, altitude.height);
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.0, 3_357_600.0, 10.0) };
        let grid = MapGrid { epsg: 32617, west: 436_190.0, north: 3_357_610.0, cell: 0.5, width, height };
        let raster = |value| Grid2::filled(width, height, value);
        MatchedSurface { site, grid, altitude, score: raster(score), prior_weight: raster(0.0) }
    }

    #[test]
    fn noise_is_rough_and_unconfident_and_a_roof_is_neither() {
        let rough = Grid2::from_fn(9, 9, |col, row| if (col + row) % 2 == 0 { 0.0 } else { 9.0 });
        assert!(surface(rough.clone(), 0.2).is_rough_and_unconfident(40));
        assert!(!surface(rough, 0.5).is_rough_and_unconfident(40));
        assert!(!surface(Grid2::filled(9, 9, 5.0), 0.2).is_rough_and_unconfident(40));
    }

    #[test]
    fn only_cells_with_a_path_to_the_border_are_found() {
        // A ring of meant cells at the border, a path from it, and a spot inside.
        let is_meant = |col: usize, row: usize| {
            col == 0 || (row == 4 && col < 4) || (6..8).contains(&col) && (6..8).contains(&row)
        };
        let meant: Vec<bool> = (0..100).map(|i| is_meant(i % 10, i / 10)).collect();
        let margin = margin(&Grid2::filled(10, 10, 1.0), &meant);
        let found: Vec<usize> = (0..100).filter(|i| margin.at(i % 10, i / 10)).collect();
        let expected: Vec<usize> =
            (0..100).filter(|i| meant[*i] && !((6..8).contains(&(i % 10)) && i / 10 >= 6)).collect();
        assert_eq!(found, expected);
    }
}
