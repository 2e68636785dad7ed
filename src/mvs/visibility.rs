//! What an earlier pass tells the next one about each cell: the views from which it is occluded, and its gray value.

use super::occlusion::{OCCLUSION_TOLERANCE_M, occlusion_height};
use super::plane_sweep::PlaneSweep;
use crate::io::Grid2;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Radius of the square neighbourhood in which the texture around a cell is measured, cells.
const TEXTURE_RADIUS: i64 = 2;
/// The texture of a cell rises from 0 to 1 between these standard deviations of the gray values around it, in
/// standard deviations of the whole image.
const TEXTURE: Range<f32> = 0.02..0.12;

/// How the views see a surface.
pub(super) struct Visibility {
    /// For every view, the altitude in each cell from which on the cell is not occluded.
    lowest_visible: Arc<Vec<Grid2>>,
    /// Gray value of every cell, in standard deviations above the mean of an image: the median of the views
    /// that see it; NaN where none does.
    gray: Grid2,
}

impl Visibility {
    /// The visibility of `surface`, behind the surface `occluders`. Both hold altitudes on the grid of the
    /// sweep, site metres.
    pub fn new(sweep: &PlaneSweep, surface: &Grid2, occluders: &Grid2) -> Self {
        let with_tolerance = |mut height: Grid2| {
            height.data.iter_mut().for_each(|z| *z -= OCCLUSION_TOLERANCE_M);
            height
        };
        let occluded = sweep
            .images
            .iter()
            .map(|i| occlusion_height(occluders, i.camera.line_of_sight_slope(), sweep.grid.cell));
        Self::seen(sweep, surface, Arc::new(occluded.map(with_tolerance).collect()))
    }

    /// The visibility of another surface, behind the same occluders.
    pub fn of(&self, sweep: &PlaneSweep, surface: &Grid2) -> Self {
        Self::seen(sweep, surface, self.lowest_visible.clone())
    }

    fn seen(sweep: &PlaneSweep, surface: &Grid2, lowest_visible: Arc<Vec<Grid2>>) -> Self {
        let gray_of = |seen: &mut Vec<f32>, cell: usize| {
            let (col, row) = (cell % surface.width, cell / surface.width);
            let z = surface.data[cell];
            let p = sweep.site.site_from_utm(sweep.grid.cell_center(col, row)).at_height(f64::from(z));
            let views = sweep.images.iter().zip(lowest_visible.iter());
            let unoccluded = views.filter(|(_, lowest)| z >= lowest.data[cell]);
            seen.clear();
            seen.extend(unoccluded.map(|(image, _)| image.normalized_gray(p)).filter(|v| !v.is_nan()));
            median(seen)
        };
        let mut gray = Grid2::filled(surface.width, surface.height, f32::NAN);
        let cells = gray.data.par_iter_mut().enumerate();
        cells.for_each_init(Vec::new, |seen, (cell, out)| *out = gray_of(seen, cell));
        Self { lowest_visible, gray }
    }

    /// A visibility of no view, with the gray values of the cells.
    #[cfg(test)]
    pub fn of_gray(gray: Grid2) -> Self {
        Self { lowest_visible: Arc::default(), gray }
    }

    /// Altitude in a cell from which on a view sees it, site metres.
    pub fn lowest_visible(&self, view: usize, cell: usize) -> f32 {
        self.lowest_visible[view].data[cell]
    }

    /// Gray value of a cell, in standard deviations above the mean of an image; NaN if no view sees it.
    pub fn gray(&self, cell: usize) -> f32 {
        self.gray.data[cell]
    }

    /// Median of the gray values of cells; NaN if no view sees any.
    pub fn median_gray(&self, cells: &[usize]) -> f32 {
        let mut seen: Vec<f32> = cells.iter().map(|i| self.gray(*i)).filter(|v| !v.is_nan()).collect();
        median(&mut seen)
    }

    /// Absolute difference of the gray values of two cells, in standard deviations of an image; NaN if no
    /// view sees one of them.
    pub fn gray_difference(&self, a: usize, b: usize) -> f32 {
        (self.gray.data[a] - self.gray.data[b]).abs()
    }

    /// Texture around a cell: 0 where it is textureless, so that all altitudes match equally well, up to 1.
    /// NaN where the views see less than half of the neighbourhood.
    pub fn texture(&self, cell: usize) -> f32 {
        let (col, row) = ((cell % self.gray.width) as i64, (cell / self.gray.width) as i64);
        let (mut n, mut sum, mut squares) = (0.0f32, 0.0, 0.0);
        for r in row - TEXTURE_RADIUS..=row + TEXTURE_RADIUS {
            for c in col - TEXTURE_RADIUS..=col + TEXTURE_RADIUS {
                let v = self.gray.get(c, r);
                if !v.is_nan() {
                    (n, sum, squares) = (n + 1.0, sum + v, squares + v * v);
                }
            }
        }
        if 2.0 * n < ((2 * TEXTURE_RADIUS + 1) * (2 * TEXTURE_RADIUS + 1)) as f32 {
            return f32::NAN;
        }
        let mean = sum / n;
        let std_dev = (squares / n - mean * mean).max(0.0).sqrt();
        ((std_dev - TEXTURE.start) / (TEXTURE.end - TEXTURE.start)).clamp(0.0, 1.0)
    }
}

/// The median of values, the upper one of an even number; NaN if there is none.
fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    if values.is_empty() { f32::NAN } else { *values.select_nth_unstable_by(middle, f32::total_cmp).1 }
}
