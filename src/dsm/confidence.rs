//! Confidence of a surface model in each cell, and removal and filling of cells.

use super::Dsm;
use super::spikes::spikes;
use crate::affine::ViewCamera;
use crate::frame::{CenterPx, Pixel, SiteGrid};
use crate::io::{Grid2, ValidPixels};
use crate::mvs::{MatchedSurface, OCCLUSION_TOLERANCE_M, occlusion_height};
use rayon::prelude::*;

/// Smallest number of views whose valid pixels must cover a cell for it to keep its height.
const FEWEST_VIEWS: f32 = 2.0;

/// Confidence of the heights of a surface model, per cell.
pub struct Confidence {
    /// Accumulated opacity of the splats along the vertical through the cell, 0 to 1.
    pub opacity: Grid2,
    /// Standard deviation of the altitudes of the splats along the vertical, weighted as in the rendering, metres.
    pub spread: Grid2,
    /// Number of views that see the cell: it lies on valid pixels of their image and is not occluded. 0 where the height
    /// was filled.
    pub views: Grid2,
    /// Difference of height that moves a point by a pixel between the two views for which it is least, metres; 0 if views are
    /// not counted.
    pub height_of_pixel_m: f64,
}

/// A view for the counting of views per cell.
pub struct Seeing {
    /// Its camera, from site coordinates to pixels.
    pub camera: ViewCamera,
    /// Columns and rows of its image.
    pub size: (usize, usize),
    /// Its valid pixels; `None` if all are valid.
    pub valid: Option<ValidPixels>,
}

impl Seeing {
    fn covers(&self, px: Pixel<CenterPx>) -> bool {
        let inside = |v: f64, n: usize| v >= 0.0 && v <= n as f64 - 1.0;
        let in_image = inside(px.col, self.size.0) && inside(px.row, self.size.1);
        in_image && self.valid.as_ref().is_none_or(|valid| valid.surround(px))
    }
}

impl Dsm {
    /// Counts the views that see each cell. Cells that lie on valid pixels of fewer than two images become nodata.
    ///
    /// A cell that lies on valid pixels but is occluded keeps its height, which comes from its neighbours.
    pub fn count_views(&mut self, site: &SiteGrid, views: &[Seeing]) {
        let Self { grid, height, colors, confidence, .. } = self;
        let origin_m = site.origin.z() as f32;
        let mut covering = Grid2::filled(grid.width, grid.height, 0.0);
        let mut seeing = covering.clone();
        for view in views {
            let hidden_below = occlusion_height(height, view.camera.line_of_sight_slope(), grid.cell);
            let counts = covering.data.par_chunks_mut(grid.width).zip(seeing.data.par_chunks_mut(grid.width));
            counts.enumerate().for_each(|(row, (covering, seeing))| {
                for (col, (covering, seeing)) in covering.iter_mut().zip(seeing).enumerate() {
                    let z = height.at(col, row);
                    let p = site.site_from_utm(grid.cell_center(col, row));
                    let px = view.camera.project(p.at_height(f64::from(z - origin_m)));
                    // Cells without a height have a NaN position, which lies in no image.
                    if view.covers(px) {
                        *covering += 1.0;
                        *seeing +=
                            f32::from(u8::from(z >= hidden_below.at(col, row) - OCCLUSION_TOLERANCE_M));
                    }
                }
            });
        }
        for i in 0..height.data.len() {
            if covering.data[i] < FEWEST_VIEWS {
                height.data[i] = f32::NAN;
                colors.iter_mut().for_each(|c| c.data[i] = f32::NAN);
            }
        }
        confidence.views = seeing;
        confidence.height_of_pixel_m = height_of_pixel_m(views);
    }

    /// Sets the number of views to 0 where the matched surface was filled instead of measured, which its score of 0 marks, and
    /// where it has a spike that the cells around it deny.
    pub fn mark_filled(&mut self, matched: &MatchedSurface) {
        let Self { grid, confidence, .. } = self;
        let spikes = spikes(&matched.altitude, matched.grid.cell);
        confidence.views.data.par_chunks_mut(grid.width).enumerate().for_each(|(row, views)| {
            for (col, views) in views.iter_mut().enumerate() {
                let px = matched.grid.corner_px_from_utm(grid.cell_center(col, row));
                let (col, row) = (px.col.floor() as i64, px.row.floor() as i64);
                if matched.score.get(col, row) == 0.0 || spikes.get(col, row) > 0.0 {
                    *views = 0.0;
                }
            }
        });
    }

    /// Fills cells without a height that have cells with heights on both sides, at most `reach_m` metres away along a row or
    /// a column, with the lowest of those heights: occluded ground lies below what occludes it.
    pub fn fill(&mut self, reach_m: f64) {
        let known = self.height.clone();
        let reach = (reach_m / self.grid.cell).floor() as i64;
        for i in 0..known.data.len() {
            if !known.data[i].is_nan() {
                continue;
            }
            let (col, row) = ((i % known.width) as i64, (i / known.width) as i64);
            let nearest = |dc: i64, dr: i64| {
                let mut along = (1..=reach).map(|n| known.get(col + dc * n, row + dr * n));
                along.find(|z| !z.is_nan())
            };
            let between = |dc, dr| nearest(dc, dr).zip(nearest(-dc, -dr)).map(|(a, b)| a.min(b));
            if let Some(z) = [between(1, 0), between(0, 1)].into_iter().flatten().reduce(f32::min) {
                self.height.data[i] = z;
                self.confidence.views.data[i] = 0.0;
            }
        }
    }
}

/// See [`Confidence::height_of_pixel_m`]; 0 for fewer than two views.
fn height_of_pixel_m(views: &[Seeing]) -> f64 {
    let pairs = views.iter().enumerate().flat_map(|(i, a)| views[i + 1..].iter().map(move |b| (a, b)));
    let of_pair =
        |(a, b): (&Seeing, &Seeing)| a.camera.gsd_m().max(b.camera.gsd_m()) / a.camera.parallax(&b.camera);
    pairs.map(of_pair).reduce(f64::min).filter(|least| least.is_finite()).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsm::render::tests::flat_surface;

    #[test]
    fn occluded_cells_are_not_counted_and_cells_in_a_single_image_are_nodata() {
        let (mut surface, site) = flat_surface(20, 10);
        for row in 0..10 {
            surface.height.data[row * 20 + 10] = 30.0;
        }
        // The second camera looks from the east; the last two see columns from 2 on, the first those up to 15.
        let camera = |lean: f64, first_col: f64| {
            let straight = super::super::nadir_camera(&surface.grid, &site);
            straight.sheared([2.0 * lean, 0.0]).cropped(first_col, 0.0)
        };
        let view = |camera, size| Seeing { camera, size, valid: None };
        let mut views = [
            view(camera(0.0, 0.0), (16, 10)),
            view(camera(0.5, 2.0), (40, 10)),
            view(camera(0.0, 2.0), (40, 10)),
        ];
        surface.count_views(&site, &views);
        let seen = &surface.confidence.views;
        assert_eq!([seen.at(4, 5), seen.at(8, 5), seen.at(14, 5), seen.at(18, 5)], [2.0, 2.0, 3.0, 2.0]);
        assert_eq!((surface.height.at(4, 5), surface.height.at(18, 5)), (10.0, 10.0));
        assert!(surface.height.at(1, 5).is_nan());

        // The last one has no image in its columns up to 8, the second none in its rows from 7 on.
        let mut valid = [(); 2].map(|()| ValidPixels::filled(40, 10, true));
        (0..10).for_each(|row| (0..9).for_each(|col| valid[0].set(col, row, false)));
        (7..10).for_each(|row| (0..40).for_each(|col| valid[1].set(col, row, false)));
        [views[2].valid, views[1].valid] = valid.map(Some);
        surface.count_views(&site, &views);
        let views = &surface.confidence.views;
        assert_eq!([views.at(4, 5), views.at(14, 5), views.at(14, 8), views.at(12, 8)], [1.0, 3.0, 2.0, 2.0]);
        assert_eq!(surface.height.at(4, 5), 10.0);
        assert!(surface.height.at(4, 8).is_nan() && surface.colors[0].at(4, 8).is_nan());
    }

    #[test]
    fn cells_that_matching_filled_count_no_views() {
        let (mut surface, site) = flat_surface(8, 3);
        surface.confidence.views = Grid2::filled(8, 3, 2.0);
        let cells = |value: f32| Grid2::filled(8, 3, value);
        let score = Grid2::from_fn(8, 3, |col, _| if col == 5 { 0.0 } else { 0.4 });
        let matched = MatchedSurface {
            site,
            grid: surface.grid,
            altitude: cells(0.0),
            score,
            prior_weight: cells(0.0),
        };
        surface.mark_filled(&matched);
        assert_eq!(surface.confidence.views, Grid2::from_fn(8, 3, |col, _| if col == 5 { 0.0 } else { 2.0 }));
    }

    #[test]
    fn small_holes_are_filled_with_the_lower_height_and_large_ones_are_kept() {
        let (mut surface, _) = flat_surface(30, 3);
        surface.confidence.views = Grid2::filled(30, 3, 4.0);
        for col in [3, 4, 10, 11, 12, 13, 14, 15, 16] {
            for row in 0..3 {
                surface.height.data[row * 30 + col] = f32::NAN;
            }
        }
        surface.height.data[35] = 12.0;
        surface.fill(1.5);
        assert_eq!([surface.height.at(3, 1), surface.height.at(4, 1)], [10.0; 2]);
        assert_eq!((surface.confidence.views.at(4, 1), surface.confidence.views.at(5, 1)), (0.0, 4.0));
        assert!(surface.height.at(13, 1).is_nan());
    }
}
