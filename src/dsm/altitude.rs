//! The altitude of the splats in each cell of a DSM and in each pixel of a view: the median depth.
//!
//! It is the altitude of the splat at which the transmittance falls to one half. A mean over the splats along
//! a ray would give altitudes between those of a roof and of the street at its edge, and would be biased by
//! splats below a transparent roof.

use super::nadir_camera;
use crate::affine::ViewCamera;
use crate::camera::QuadraticKernel;
use crate::frame::{Point, SiteGrid};
use crate::io::{Grid2, MapGrid};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::raster::{ALPHA_CUT, LOW_PASS_PX2, parallel_slope};
use crate::splat::splats::{Splats, sigmoid, unit_quaternion};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use std::ops::Range;

/// Transmittance at the median depth.
const MEDIAN_TRANSMITTANCE: f32 = 0.5;
/// Samples along each side of a cell.
const SAMPLES: usize = 3;
/// Rows of cells that one thread processes at a time.
const BAND_ROWS: usize = 16;

/// The projection of a splat on the grid of samples, or on an image.
struct Ellipse {
    /// Centre (column, row), samples.
    center: [f32; 2],
    /// Inverse of the covariance: xx, xy, yy.
    conic: [f32; 3],
    /// Half the width and height of the part with an alpha above the threshold, samples.
    half_size: [f32; 2],
    opacity: f32,
    /// Altitude of the centre, site metres, and its change per sample to the right and down: that of the plane of a disc.
    altitude: f32,
    slope: [f32; 2],
}

impl Ellipse {
    /// None if the opacity of the splat is below the threshold of the rasteriser, or if the splat is not finite.
    fn new(splats: &Splats, i: usize, is_disc: bool, camera: &ViewCamera) -> Option<Self> {
        let position = splats.position[i];
        let opacity = sigmoid(splats.opacity_logit[i][0]);
        let radius2 = 2.0 * (f64::from(opacity) / ALPHA_CUT).ln();
        let [w, x, y, z] = unit_quaternion(splats.rotation[i].map(f64::from));
        let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
        let scale = DVec3::from_array(splats.log_scale[i].map(|s| f64::from(s).exp()));
        let [x, y, z] = position.map(f64::from);
        let place = Point::new(x, y, z);
        let [col, row]: [DVec3; 2] = camera
            .tangent_at(place)
            .linear
            .map(|[a, b, c]| (a * axes.row(0) + b * axes.row(1) + c * axes.row(2)) * scale);
        let (xx, xy, yy) =
            (col.length_squared() + LOW_PASS_PX2, col.dot(row), row.length_squared() + LOW_PASS_PX2);
        let det = xx * yy - xy * xy;
        let px = camera.project(place);
        let center = [px.col, px.row];
        let slope = if is_disc { disc_slope(camera, axes.z_axis, [xx, xy, yy]) } else { [0.0; 2] };
        let seen = radius2 > 0.0 && det > 0.0 && center.iter().all(|v| v.is_finite());
        seen.then(|| Self {
            center: center.map(|v| v as f32),
            conic: [yy / det, -xy / det, xx / det].map(|v| v as f32),
            half_size: [(radius2 * xx).sqrt(), (radius2 * yy).sqrt()].map(|v| v as f32),
            opacity,
            altitude: position[2],
            slope: slope.map(|v| v as f32),
        })
    }

    /// Samples of an axis (0 for columns, 1 for rows) that the ellipse can reach, within a range.
    fn range(&self, axis: usize, within: Range<usize>) -> Range<usize> {
        let (c, h) = (self.center[axis], self.half_size[axis]);
        let (first, end) = ((c - h).ceil().max(0.0) as usize, (c + h + 1.0).floor().max(0.0) as usize);
        first.max(within.start)..end.min(within.end)
    }

    /// Altitude of the splat at a sample.
    fn altitude(&self, col: usize, row: usize) -> f32 {
        let (dx, dy) = (col as f32 - self.center[0], row as f32 - self.center[1]);
        self.altitude + self.slope[0] * dx + self.slope[1] * dy
    }

    /// Alpha of the splat at a sample.
    fn alpha(&self, col: usize, row: usize) -> f32 {
        let (dx, dy) = (col as f32 - self.center[0], row as f32 - self.center[1]);
        let [a, b, c] = self.conic;
        self.opacity * (-0.5 * (a * dx * dx + 2.0 * b * dx * dy + c * dy * dy)).exp()
    }
}

/// The slope of a disc (metres per sample) as the rasteriser draws it, from its normal and the covariance (xx, xy, yy) of its
/// image with the low-pass filter, samples².
fn disc_slope(camera: &ViewCamera, normal: DVec3, [xx, xy, yy]: [f64; 3]) -> [f64; 2] {
    let kernel = QuadraticKernel::<f64>::from(camera);
    parallel_slope(&kernel, normal.to_array(), [xx - LOW_PASS_PX2, xy, yy - LOW_PASS_PX2])
}

/// Altitudes of the splats in the cells of a grid, metres above the origin of the site; NaN where the
/// transmittance of all splats together is above one half.
#[must_use]
pub fn altitudes(splats: &Splats, site: &SiteGrid, grid: &MapGrid) -> Grid2 {
    let fine = sampled(grid);
    let ellipses = sorted_ellipses(splats, &nadir_camera(&fine, site));
    let mut out = Grid2::filled(grid.width, grid.height, f32::NAN);
    out.data.par_chunks_mut(BAND_ROWS * grid.width).enumerate().for_each(|(k, band)| {
        let rows = band.len() / grid.width * SAMPLES;
        let samples = draw(&ellipses, k * BAND_ROWS * SAMPLES, rows, fine.width);
        let mut values = Vec::with_capacity(SAMPLES * SAMPLES);
        for (i, cell) in band.iter_mut().enumerate() {
            let (col, row) = (i % grid.width * SAMPLES, i / grid.width * SAMPLES);
            *cell = median(&mut values, |c, r| samples[(row + r) * fine.width + col + c]);
        }
    });
    out
}

/// Altitudes of the splats in the pixels of a view of a size (columns, rows), metres above the origin of the site; NaN
/// where the transmittance of all splats together is above one half.
#[must_use]
pub fn view_altitudes(splats: &Splats, camera: &ViewCamera, (width, height): (usize, usize)) -> Grid2 {
    let ellipses = sorted_ellipses(splats, camera);
    let mut out = Grid2::filled(width, height, f32::NAN);
    let rows = BAND_ROWS * SAMPLES;
    out.data.par_chunks_mut((rows * width).max(1)).enumerate().for_each(|(k, band)| {
        band.copy_from_slice(&draw(&ellipses, k * rows, band.len() / width, width));
    });
    out
}

/// The projections of the splats that are seen, from the highest to the lowest.
fn sorted_ellipses(splats: &Splats, camera: &ViewCamera) -> Vec<Ellipse> {
    let is_disc = splats.primitive() == PrimitiveKind::Disc;
    let of = |i| Ellipse::new(splats, i, is_disc, camera);
    let mut ellipses: Vec<Ellipse> = (0..splats.len()).into_par_iter().filter_map(of).collect();
    // A stable sort: splats of the same altitude keep their order.
    ellipses.par_sort_by(|a, b| b.altitude.total_cmp(&a.altitude));
    ellipses
}

/// The grid of the samples, [`SAMPLES`] times as fine as the given grid.
pub(super) fn sampled(grid: &MapGrid) -> MapGrid {
    let (width, height) = (grid.width * SAMPLES, grid.height * SAMPLES);
    MapGrid { cell: grid.cell / SAMPLES as f64, width, height, ..*grid }
}

/// The median of the samples of a cell, given by column and row within the cell; NaN if most of them are NaN.
/// `values` is working memory.
pub(super) fn median(values: &mut Vec<f32>, sample: impl Fn(usize, usize) -> f32) -> f32 {
    values.clear();
    for row in 0..SAMPLES {
        values.extend((0..SAMPLES).map(|col| sample(col, row)).filter(|v| !v.is_nan()));
    }
    if 2 * values.len() < SAMPLES * SAMPLES {
        return f32::NAN;
    }
    values.sort_unstable_by(f32::total_cmp);
    0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2])
}

/// Median altitudes of `rows` rows of samples from `first_row` on, by splatting the ellipses from the highest
/// to the lowest.
fn draw(ellipses: &[Ellipse], first_row: usize, rows: usize, width: usize) -> Vec<f32> {
    let mut altitudes = vec![f32::NAN; rows * width];
    let mut transmittance = vec![1.0f32; rows * width];
    for e in ellipses {
        for row in e.range(1, first_row..first_row + rows) {
            for col in e.range(0, 0..width) {
                let i = (row - first_row) * width + col;
                if transmittance[i] > MEDIAN_TRANSMITTANCE {
                    transmittance[i] *= 1.0 - e.alpha(col, row);
                    if transmittance[i] <= MEDIAN_TRANSMITTANCE {
                        altitudes[i] = e.altitude(col, row);
                    }
                }
            }
        }
    }
    altitudes
}
