//! How well the views agree on every cell at every altitude.

use super::horizon::horizon;
use super::{PRIOR_COST, PRIOR_REACH_M, Stack, Sweep};
use crate::raster::Plane;
use crate::splat::views::TrainingView;
use rayon::prelude::*;

/// Cells from the window's centre to its border.
const REACH: usize = 1;
const SIDE: usize = 2 * REACH + 1;
/// Rows of cells that one thread sweeps at a time.
const BAND_ROWS: usize = 32;
/// Variance of brightness in a window below which it has no texture.
const FLAT: f32 = 1e-5;
/// A cell may lie this much below its horizon and still count as seen, metres.
const HORIZON_SLACK_M: f32 = 0.5;
/// Pairs without correlation that every cell is given, so that few pairs convince less than many.
const DOUBT: f32 = 1.0;

/// A view's brightness and camera.
pub(super) struct Image {
    gray: Plane,
    linear: [[f64; 3]; 2],
    offset: [f64; 2],
}

impl Image {
    pub fn new(view: &TrainingView) -> Self {
        Self { gray: view.gray(), linear: view.camera.linear, offset: view.camera.offset }
    }

    /// Ground displacement (east, north) per metre of height along the rays of this camera sheared by `shear`.
    pub fn lean(&self, shear: [f64; 2]) -> [f64; 2] {
        let [[a, b, p], [c, d, q]] = self.linear;
        let det = a * d - b * c;
        let (u, v) = (shear[0] - p, shear[1] - q);
        [(d * u - b * v) / det, (a * v - c * u) / det]
    }

    fn position(&self, x: f64, y: f64) -> [f32; 2] {
        std::array::from_fn(|k| (self.linear[k][0] * x + self.linear[k][1] * y + self.offset[k]) as f32)
    }

    /// Bilinear brightness, NaN outside.
    #[inline(always)]
    fn sample(&self, [u, v]: [f32; 2]) -> f32 {
        let Plane { width, height, data } = &self.gray;
        if !(u >= 0.0 && v >= 0.0 && u < (*width - 1) as f32 && v < (*height - 1) as f32) {
            return f32::NAN;
        }
        let (col, row) = (u as usize, v as usize);
        let (fc, fr) = (u - col as f32, v - row as f32);
        let i = row * width + col;
        let top = data[i] + (data[i + 1] - data[i]) * fc;
        let low = data[i + width] + (data[i + width + 1] - data[i + width]) * fc;
        top + (low - top) * fr
    }
}

/// Costs of every cell at every plane of the stack, cell by cell.
pub(super) struct Volume {
    planes: usize,
    costs: Vec<u8>,
}

impl Volume {
    /// Cost where no pair sees the cell; 254 is no correlation, 0 a perfect one.
    pub const UNSEEN: u8 = 255;

    /// Correlates; what lies behind the surface `hiding` is not seen.
    pub fn correlate(sweep: &Sweep, hiding: Option<&Plane>) -> Self {
        let horizons: Vec<Option<Plane>> = sweep
            .images
            .iter()
            .map(|image| {
                let [east, north] = image.lean([0.0; 2]).map(|v| v / sweep.grid.cell);
                hiding.map(|surface| horizon(surface, [east, -north]))
            })
            .collect();
        let (planes, width) = (sweep.stack.planes, sweep.grid.width);
        let mut costs = vec![Self::UNSEEN; width * sweep.grid.height * planes];
        costs.par_chunks_mut(BAND_ROWS * width * planes).enumerate().for_each(|(k, costs)| {
            Band::new(sweep, &horizons, k * BAND_ROWS, costs.len() / (width * planes)).correlate(costs);
        });
        Self { planes, costs }
    }

    /// Adds the distance to a prior.
    pub fn draw_to(&mut self, prior: &Plane, stack: &Stack) {
        let share = 1.0 - PRIOR_COST / 255.0;
        self.costs.par_chunks_mut(self.planes).enumerate().for_each(|(cell, costs)| {
            for (k, cost) in costs.iter_mut().enumerate().filter(|(_, c)| **c != Self::UNSEEN) {
                let d = (stack.altitude(cell, k as f32) - prior.data[cell]) / PRIOR_REACH_M;
                let far = if d.is_nan() { 1.0 } else { d * d / (d * d + 1.0) };
                *cost = (share * f32::from(*cost) + PRIOR_COST * far).min(254.0) as u8;
            }
        });
    }

    /// Number of altitudes.
    pub fn planes(&self) -> usize {
        self.planes
    }

    /// A cell's costs.
    pub fn cell(&self, cell: usize) -> &[u8] {
        &self.costs[cell * self.planes..(cell + 1) * self.planes]
    }

    /// Costs of a row of cells after the other.
    pub fn rows(&self, width: usize) -> std::slice::ChunksExact<'_, u8> {
        self.costs.chunks_exact(width * self.planes)
    }
}

/// Rows of cells, with a margin as wide as the window reaches.
struct Band<'a> {
    sweep: &'a Sweep<'a>,
    /// Rows and columns with the margin.
    rows: usize,
    columns: usize,
    /// Which cell of the grid each is; margins beyond the grid repeat its border.
    cells: Vec<u32>,
    views: Vec<Samples<'a>>,
}

/// A view's samples of one plane.
struct Samples<'a> {
    image: &'a Image,
    horizon: Option<&'a Plane>,
    /// Image positions at the site's altitude.
    positions: Vec<[f32; 2]>,
    brightness: Vec<f32>,
    seen: Vec<bool>,
    mean: Vec<f32>,
    /// One over the standard deviation; zero where not seen or without texture.
    sharpness: Vec<f32>,
}

impl<'a> Band<'a> {
    fn new(sweep: &'a Sweep, horizons: &'a [Option<Plane>], first_row: usize, inner_rows: usize) -> Self {
        let (rows, columns) = (inner_rows + 2 * REACH, sweep.grid.width + 2 * REACH);
        let n = rows * columns;
        let inside = |i: usize, n: usize| i.saturating_sub(REACH).min(n - 1);
        let place = |i: usize| {
            (inside(i % columns, sweep.grid.width), inside(first_row + i / columns, sweep.grid.height))
        };
        let cells = (0..n).map(|i| (place(i).1 * sweep.grid.width + place(i).0) as u32).collect();
        let views = sweep.images.iter().zip(horizons).map(|(image, horizon)| Samples {
            image,
            horizon: horizon.as_ref(),
            positions: (0..n)
                .map(|i| {
                    let p = sweep.site.site_from_utm(sweep.grid.cell_center(place(i).0, place(i).1));
                    image.position(p.x(), p.y())
                })
                .collect(),
            brightness: vec![0.0; n],
            seen: vec![false; n],
            mean: vec![0.0; n],
            sharpness: vec![0.0; n],
        });
        Self { sweep, rows, columns, cells, views: views.collect() }
    }

    fn correlate(mut self, costs: &mut [u8]) {
        let n = self.rows * self.columns;
        let planes = self.sweep.stack.planes;
        let (mut altitudes, mut products, mut scratch) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let (mut score, mut pairs) = (vec![0.0f32; n], vec![0.0f32; n]);
        for plane in 0..planes {
            for (z, cell) in altitudes.iter_mut().zip(&self.cells) {
                *z = self.sweep.stack.altitude(*cell as usize, plane as f32);
            }
            for view in &mut self.views {
                view.sample(&altitudes, &self.cells);
                view.summarise(self.columns, &mut products, &mut scratch);
            }
            score.fill(0.0);
            pairs.fill(0.0);
            for &(i, j) in &self.sweep.pairs {
                let (a, b) = (&self.views[i], &self.views[j]);
                for k in 0..n {
                    products[k] = a.brightness[k] * b.brightness[k];
                }
                window_means(&mut products, self.columns, &mut scratch);
                for k in 0..n {
                    let covariance = products[k] - a.mean[k] * b.mean[k];
                    let correlation = (covariance * a.sharpness[k] * b.sharpness[k]).clamp(0.0, 1.0);
                    // Cubed: one good pair says more than three fair ones.
                    score[k] += correlation * correlation * correlation;
                    pairs[k] += if a.seen[k] && b.seen[k] { 1.0 } else { 0.0 };
                }
            }
            let width = self.sweep.grid.width;
            for (cell, costs) in costs.chunks_exact_mut(planes).enumerate() {
                let k = (cell / width + REACH) * self.columns + cell % width + REACH;
                if pairs[k] > 0.0 {
                    let mean = score[k] / (pairs[k] + DOUBT);
                    costs[plane] = (255.0 * (1.0 - mean)).round().min(254.0) as u8;
                }
            }
        }
    }
}

impl Samples<'_> {
    fn sample(&mut self, altitudes: &[f32], cells: &[u32]) {
        let up = [self.image.linear[0][2] as f32, self.image.linear[1][2] as f32];
        for (k, z) in altitudes.iter().enumerate() {
            let [u, v] = self.positions[k];
            let value = self.image.sample([u + up[0] * z, v + up[1] * z]);
            let known = !value.is_nan();
            let hidden = self.horizon.is_some_and(|h| *z < h.data[cells[k] as usize] - HORIZON_SLACK_M);
            self.brightness[k] = if known { value } else { 0.0 };
            self.seen[k] = known && !hidden;
        }
    }

    fn summarise(&mut self, columns: usize, squares: &mut [f32], scratch: &mut [f32]) {
        for (square, v) in squares.iter_mut().zip(&self.brightness) {
            *square = v * v;
        }
        self.mean.copy_from_slice(&self.brightness);
        window_means(&mut self.mean, columns, scratch);
        window_means(squares, columns, scratch);
        for k in 0..squares.len() {
            let variance = squares[k] - self.mean[k] * self.mean[k];
            let usable = self.seen[k] && variance > FLAT;
            self.sharpness[k] = if usable { variance.sqrt().recip() } else { 0.0 };
        }
    }
}

/// Means over the window around every cell, in place; the margin is left without meaning.
fn window_means(values: &mut [f32], columns: usize, scratch: &mut [f32]) {
    const SHARE: f32 = 1.0 / (SIDE * SIDE) as f32;
    let n = values.len();
    for k in 0..n - 2 * REACH {
        scratch[k + REACH] = values[k..k + SIDE].iter().sum();
    }
    for k in 0..n - 2 * REACH * columns {
        let sum: f32 = (0..SIDE).map(|row| scratch[k + row * columns]).sum();
        values[k + REACH * columns] = SHARE * sum;
    }
}
