//! What an earlier pass tells the next one: what hides a cell, and what the views show there.

use super::PlaneSweep;
use super::occlusion::{OCCLUSION_TOLERANCE_M, occlusion_height};
use crate::io::Grid2;
use rayon::prelude::*;
use std::ops::Range;

/// Cells around a cell, each way, that tell whether it lies on something plain.
const AROUND: i64 = 2;
/// Contrast around a cell, standard deviations of the images, between which it ceases to be plain.
const PLAIN: Range<f32> = 0.02..0.12;

/// A surface as the views see it.
pub(super) struct Visibility {
    /// Of every view, the altitude from which on it sees a cell.
    seen_from: Vec<Grid2>,
    /// Brightness of every cell, in standard deviations above the mean of an image; NaN where no view sees it.
    brightness: Grid2,
}

impl Visibility {
    /// The look of `surface`, where the surface `hiding` hides what lies behind it.
    pub fn new(sweep: &PlaneSweep, surface: &Grid2, hiding: &Grid2) -> Self {
        let with_slack = |mut horizon: Grid2| {
            horizon.data.iter_mut().for_each(|z| *z -= OCCLUSION_TOLERANCE_M);
            horizon
        };
        let horizons = sweep
            .images
            .iter()
            .map(|i| occlusion_height(hiding, i.camera.line_of_sight_slope(), sweep.grid.cell));
        let seen_from: Vec<Grid2> = horizons.map(with_slack).collect();
        let median = |seen: &mut Vec<f32>, cell: usize| {
            let (col, row) = (cell % surface.width, cell / surface.width);
            let z = surface.data[cell];
            let p = sweep.site.site_from_utm(sweep.grid.cell_center(col, row)).at_height(f64::from(z));
            let views = sweep.images.iter().zip(&seen_from);
            let unhidden = views.filter(|(_, lowest)| z >= lowest.data[cell]);
            seen.clear();
            seen.extend(unhidden.map(|(image, _)| image.relative_brightness(p)).filter(|v| !v.is_nan()));
            let middle = seen.len() / 2;
            if seen.is_empty() { f32::NAN } else { *seen.select_nth_unstable_by(middle, f32::total_cmp).1 }
        };
        let mut brightness = Grid2::filled(surface.width, surface.height, f32::NAN);
        let cells = brightness.data.par_iter_mut().enumerate();
        cells.for_each_init(Vec::new, |seen, (cell, out)| *out = median(seen, cell));
        Self { seen_from, brightness }
    }

    /// Altitude from which on a view sees a cell.
    pub fn seen_from(&self, view: usize, cell: usize) -> f32 {
        self.seen_from[view].data[cell]
    }

    /// How much two cells differ in brightness; NaN if one is not seen.
    pub fn difference(&self, a: usize, b: usize) -> f32 {
        (self.brightness.data[a] - self.brightness.data[b]).abs()
    }

    /// From 0 on plain surfaces, which views cannot tell from a higher or a lower one, to 1; NaN where views see less
    /// than half of the cells around.
    pub fn texture(&self, cell: usize) -> f32 {
        let (col, row) = ((cell % self.brightness.width) as i64, (cell / self.brightness.width) as i64);
        let (mut n, mut sum, mut squares) = (0.0f32, 0.0, 0.0);
        for r in row - AROUND..=row + AROUND {
            for c in col - AROUND..=col + AROUND {
                let v = self.brightness.get(c, r);
                if !v.is_nan() {
                    (n, sum, squares) = (n + 1.0, sum + v, squares + v * v);
                }
            }
        }
        if 2.0 * n < ((2 * AROUND + 1) * (2 * AROUND + 1)) as f32 {
            return f32::NAN;
        }
        let mean = sum / n;
        let contrast = (squares / n - mean * mean).max(0.0).sqrt();
        ((contrast - PLAIN.start) / (PLAIN.end - PLAIN.start)).clamp(0.0, 1.0)
    }
}
