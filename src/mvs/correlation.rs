//! How well the views agree on every cell at every altitude.

use super::visibility::Visibility;
use super::{DRIFT_COST, PRIOR_COST, PRIOR_REACH_M, PlaneStack, PlaneSweep, RETURN_COST};
use crate::affine::AffineCamera;
use crate::affine::TrainingView;
use crate::frame::{Point, Site};
use crate::io::{Grid2, ValidPixels, Window};
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Brightness, here the square root of light, is compared in windows of 3 x 3 cells.
const WINDOW: usize = 3;
/// Rows and columns of a tile, which overlaps its neighbours by the windows' margins: as much as stays in a core's
/// cache.
const ROWS: usize = 18;
const COLUMNS: usize = 64;
const INNER_ROWS: usize = ROWS - (WINDOW - 1);
const INNER_COLUMNS: usize = COLUMNS - (WINDOW - 1);
/// Variance of brightness in a window below which it has no texture.
const FLAT: f32 = 1e-5;
/// Pairs without correlation that every cell is given, so that few pairs convince less than many.
const DOUBT: f32 = 1.0;

/// Difference in brightness, standard deviations of the images, at which a cell of a window counts for 1/e.
const ALIKE: f32 = 0.2;
/// Scores at a cell's best altitude between which it becomes one that views agree on.
const AGREEMENT: Range<f32> = 0.1..0.25;

/// A value for every cell of a tile's row, and of a tile.
type Line<T = f32> = [T; COLUMNS];
type Lines = [Line; ROWS];
/// What each cell of a window counts, together 1, row by row; by the window's central cell.
type Weights = [Lines; WINDOW * WINDOW];

/// A view's brightness and camera.
pub(super) struct MatchImage {
    /// NaN where there is no image.
    pub gray: Grid2,
    /// Which pixels are image, if not all are.
    valid: Option<Arc<ValidPixels>>,
    pub camera: AffineCamera,
    /// Mean and standard deviation of the brightness.
    pub level: f64,
    pub contrast: f64,
}

impl MatchImage {
    pub fn new(view: &TrainingView) -> Self {
        let gray = view.root_of_light();
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
            sum / f64::max(n, 1.0)
        };
        let level = mean(&mut gray.valid().map(f64::from));
        let variance = mean(&mut gray.valid().map(|v| (f64::from(v) - level).powi(2)));
        let valid = view.valid_pixels().cloned();
        Self { camera: view.camera, level, contrast: variance.sqrt(), gray, valid }
    }

    /// The brightness of a part, with its camera and the whole image's level and contrast.
    pub fn cropped(&self, part: Window) -> Self {
        let camera = self.camera.cropped(part.col as f64, part.row as f64);
        // The window's own NaN tell where there is no image.
        Self { gray: self.gray.window(part), valid: None, camera, ..*self }
    }

    /// Brightness where a point is seen, in standard deviations above the image's mean; NaN outside.
    pub fn relative_brightness(&self, p: Point<Site>) -> f32 {
        let px = self.camera.project(p);
        ((f64::from(self.gray.bilinear(px.col, px.row)) - self.level) / self.contrast) as f32
    }

    /// Whether a point lies in the image and what shows it there is valid.
    pub fn has(&self, p: Point<Site>) -> bool {
        let px = self.camera.project(p);
        if let Some(valid) = &self.valid {
            return valid.surround(px);
        }
        let within = |v: f64, n: usize| v >= 0.0 && v <= n as f64 - 1.0;
        within(px.col, self.gray.width) && within(px.row, self.gray.height)
    }
}

/// Costs of every cell at every plane of the stack, cell by cell.
pub(super) struct CostVolume {
    planes: usize,
    costs: Vec<u8>,
}

impl CostVolume {
    /// Cost where no pair sees the cell; 254 is no correlation, 0 a perfect one.
    pub const UNSEEN: u8 = 255;

    /// Correlates; in the light of an earlier pass, windows keep to what looks alike, and what is hidden is not seen.
    pub fn correlate(sweep: &PlaneSweep, visibility: Option<&Visibility>) -> Self {
        let (planes, width) = (sweep.stack.planes, sweep.grid.width);
        let mut costs = vec![Self::UNSEEN; width * sweep.grid.height * planes];
        costs.par_chunks_mut(INNER_ROWS * width * planes).enumerate().for_each(|(k, costs)| {
            let mut tile = Tile::new(sweep);
            for first_column in (0..width).step_by(INNER_COLUMNS) {
                tile.place(first_column, k * INNER_ROWS, visibility);
                tile.weigh(visibility);
                tile.correlate(costs);
            }
        });
        Self { planes, costs }
    }

    /// Adds the distance to a prior, or to the first surface if that is nearer.
    ///
    /// Where the views agree on nothing, or what they show is plain, training drifts: there the first surface is the
    /// one to trust.
    pub fn add_prior(&mut self, prior: &Grid2, first: &Grid2, stack: &PlaneStack, visibility: &Visibility) {
        let share = 1.0 - PRIOR_COST / 255.0;
        self.costs.par_chunks_mut(self.planes).enumerate().for_each(|(cell, costs)| {
            let trusted = agreement(costs).min(visibility.texture(cell));
            for (k, cost) in costs.iter_mut().enumerate().filter(|(_, c)| **c != Self::UNSEEN) {
                let z = stack.altitude(cell, k as f32);
                let drift = DRIFT_COST * (1.0 - trusted) + farness(z - prior.data[cell]);
                let back = RETURN_COST * trusted + farness(z - first.data[cell]);
                let far = drift.min(back);
                *cost = (share * f32::from(*cost) + PRIOR_COST * far).min(254.0) as u8;
            }
        });
    }

    /// A cell's costs.
    pub fn cell(&self, cell: usize) -> &[u8] {
        &self.costs[cell * self.planes..(cell + 1) * self.planes]
    }

    /// Costs of all cells, one after the other.
    pub fn costs(&self) -> &[u8] {
        &self.costs
    }
}

/// From 0 where the views agree on no altitude to 1 where they agree on one.
fn agreement(costs: &[u8]) -> f32 {
    let best = 1.0 - f32::from(costs.iter().copied().min().unwrap_or(CostVolume::UNSEEN)) / 255.0;
    ((best - AGREEMENT.start) / (AGREEMENT.end - AGREEMENT.start)).clamp(0.0, 1.0)
}

/// From 0 at a prior to 1 far from it (Geman and McClure); 1 without a prior.
fn farness(distance_m: f32) -> f32 {
    let d = distance_m / PRIOR_REACH_M;
    if d.is_nan() { 1.0 } else { d * d / (d * d + 1.0) }
}

/// A few rows and columns of cells, with a margin as wide as a window reaches.
struct Tile<'a> {
    sweep: &'a PlaneSweep,
    first_column: usize,
    /// Which cell of the grid each is; margins beyond the grid repeat its border.
    cells: [Line<u32>; ROWS],
    views: Vec<Samples<'a>>,
    weights: Box<Weights>,
    score: Box<Lines>,
    pairs: Box<Lines>,
}

/// A view's samples of one plane.
struct Samples<'a> {
    image: &'a MatchImage,
    /// MatchImage positions at the site's altitude.
    column: Lines,
    row: Lines,
    /// Altitude below which something hides a cell.
    hidden_below: Lines,
    brightness: Lines,
    /// 1 where the view sees the cell, else 0.
    seen: Lines,
    mean: Lines,
    /// One over the standard deviation; zero where not seen or without texture.
    sharpness: Lines,
}

const ZEROS: Lines = [[0.0; COLUMNS]; ROWS];

impl<'a> Tile<'a> {
    fn new(sweep: &'a PlaneSweep) -> Self {
        let samples = |image| Samples {
            image,
            column: ZEROS,
            row: ZEROS,
            hidden_below: ZEROS,
            brightness: ZEROS,
            seen: ZEROS,
            mean: ZEROS,
            sharpness: ZEROS,
        };
        Self {
            sweep,
            first_column: 0,
            cells: [[0; COLUMNS]; ROWS],
            views: sweep.images.iter().map(samples).collect(),
            weights: Box::new([ZEROS; WINDOW * WINDOW]),
            score: Box::new(ZEROS),
            pairs: Box::new(ZEROS),
        }
    }

    /// Moves to where the first cell inside the margins is the one at `first_column`, `first_row`.
    fn place(&mut self, first_column: usize, first_row: usize, visibility: Option<&Visibility>) {
        let grid = &self.sweep.grid;
        let inside = |i: usize, n: usize| i.saturating_sub(WINDOW / 2).min(n - 1);
        self.first_column = first_column;
        for r in 0..ROWS {
            for c in 0..COLUMNS {
                let (col, row) = (inside(first_column + c, grid.width), inside(first_row + r, grid.height));
                let cell = row * grid.width + col;
                let p = self.sweep.site.site_from_utm(grid.cell_center(col, row));
                self.cells[r][c] = cell as u32;
                for (index, view) in self.views.iter_mut().enumerate() {
                    let px = view.image.camera.project(Point::new(p.x(), p.y(), 0.0));
                    (view.column[r][c], view.row[r][c]) = (px.col as f32, px.row as f32);
                    view.hidden_below[r][c] =
                        visibility.map_or(f32::NEG_INFINITY, |visibility| visibility.seen_from(index, cell));
                }
            }
        }
    }

    /// Weighs the cells of every window: those that visibility like the central one count most, without a visibility all alike.
    fn weigh(&mut self, visibility: Option<&Visibility>) {
        for r in 1..ROWS - 1 {
            for c in 1..COLUMNS - 1 {
                let center = self.cells[r][c] as usize;
                let weight = |n: usize| {
                    let other = self.cells[r + n / WINDOW - 1][c + n % WINDOW - 1] as usize;
                    let difference =
                        visibility.map_or(0.0, |visibility| visibility.difference(center, other));
                    if difference.is_nan() { 1.0 } else { (-difference / ALIKE).exp() }
                };
                let weights: [f32; WINDOW * WINDOW] = std::array::from_fn(weight);
                let total: f32 = weights.iter().sum();
                for (lines, weight) in self.weights.iter_mut().zip(weights) {
                    lines[r][c] = weight / total;
                }
            }
        }
    }

    /// Fills the costs of its cells in `costs`, those of the grid's rows that it stands on.
    fn correlate(&mut self, costs: &mut [u8]) {
        let (planes, width) = (self.sweep.stack.planes, self.sweep.grid.width);
        let columns = INNER_COLUMNS.min(width - self.first_column);
        let rows = costs.len() / (planes * width);
        let mut altitudes = ZEROS;
        for plane in 0..planes {
            let up = plane as f32 / (planes - 1) as f32;
            for (z, cell) in altitudes.as_flattened_mut().iter_mut().zip(self.cells.as_flattened()) {
                *z = self.sweep.stack.altitude(*cell as usize, plane as f32);
            }
            for view in &mut self.views {
                sample(view, &altitudes);
                summarise(view, &self.weights);
            }
            *self.score = ZEROS;
            *self.pairs = ZEROS;
            for &(i, j) in &self.sweep.pairs {
                let (a, b) = (&self.views[i], &self.views[j]);
                add_pair(a, b, &self.weights, &mut self.score, &mut self.pairs);
            }
            for row in 0..rows {
                let line = row + WINDOW / 2;
                let (cells, score, pairs) = (&self.cells[line], &self.score[line], &self.pairs[line]);
                let first = (row * width + self.first_column) * planes + plane;
                for (column, cost) in costs[first..].iter_mut().step_by(planes).take(columns).enumerate() {
                    let k = column + WINDOW / 2;
                    if pairs[k] > 0.0 {
                        // The few views that reach beyond the others' images agree by chance.
                        let share = self.sweep.covers[cells[k] as usize].share(up);
                        let mean = share * score[k] / (pairs[k] + DOUBT);
                        *cost = (255.5 - 255.0 * mean).min(254.0) as u8;
                    }
                }
            }
        }
    }
}

/// Brightness, bilinear, of every cell at an altitude; zero where it is not seen.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn sample(view: &mut Samples, altitudes: &Lines) {
    let MatchImage { gray, camera, .. } = view.image;
    let up = camera.linear.map(|l| l[2] as f32);
    let (last_column, last_row) = ((gray.width - 1) as f32, (gray.height - 1) as f32);
    for line in 0..ROWS {
        let (mut index, mut right, mut down, mut known) =
            ([0u32; COLUMNS], [0.0; COLUMNS], [0.0; COLUMNS], [false; COLUMNS]);
        for k in 0..COLUMNS {
            let z = altitudes[line][k];
            let (u, v) = (view.column[line][k] + up[0] * z, view.row[line][k] + up[1] * z);
            known[k] = u >= 0.0 && v >= 0.0 && u < last_column && v < last_row;
            let (u, v) = if known[k] { (u, v) } else { (0.0, 0.0) };
            let (column, row) = (u as i32, v as i32);
            index[k] = row as u32 * gray.width as u32 + column as u32;
            (right[k], down[k]) = (u - column as f32, v - row as f32);
        }
        let mut corners = [[0.0f32; COLUMNS]; 4];
        for k in 0..COLUMNS {
            let i = index[k] as usize;
            let (top, low) = (&gray.data[i..i + 2], &gray.data[i + gray.width..i + gray.width + 2]);
            [corners[0][k], corners[1][k], corners[2][k], corners[3][k]] = [top[0], top[1], low[0], low[1]];
        }
        for k in 0..COLUMNS {
            let top = corners[0][k] + (corners[1][k] - corners[0][k]) * right[k];
            let low = corners[2][k] + (corners[3][k] - corners[2][k]) * right[k];
            let value = top + (low - top) * down[k];
            let known = known[k] && !value.is_nan();
            view.brightness[line][k] = if known { value } else { 0.0 };
            let seen = known && altitudes[line][k] >= view.hidden_below[line][k];
            view.seen[line][k] = if seen { 1.0 } else { 0.0 };
        }
    }
}

/// Means and sharpness of the windows around every cell.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn summarise(view: &mut Samples, weights: &Weights) {
    let mut values = Windows::EMPTY;
    let mut squares = Windows::EMPTY;
    for line in 0..ROWS {
        let v = &view.brightness[line];
        values.push(v);
        squares.push(&times(v, v));
        let Some(center) = line.checked_sub(WINDOW - 1).map(|first| first + WINDOW / 2) else { continue };
        let (mean, square) = (values.means(weights, center), squares.means(weights, center));
        for k in 0..COLUMNS {
            let variance = square[k] - mean[k] * mean[k];
            let usable = view.seen[center][k] > 0.0 && variance > FLAT;
            view.sharpness[center][k] = if usable { variance.sqrt().recip() } else { 0.0 };
        }
        view.mean[center] = mean;
    }
}

/// Adds the cubes of two views' correlations, and where both see the cell. Cubed: one good pair says more than three
/// fair ones.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn add_pair(a: &Samples, b: &Samples, weights: &Weights, score: &mut Lines, pairs: &mut Lines) {
    let mut products = Windows::EMPTY;
    for line in 0..ROWS {
        products.push(&times(&a.brightness[line], &b.brightness[line]));
        let Some(center) = line.checked_sub(WINDOW - 1).map(|first| first + WINDOW / 2) else { continue };
        let mean = products.means(weights, center);
        for k in 0..COLUMNS {
            let covariance = mean[k] - a.mean[center][k] * b.mean[center][k];
            let sharpness = a.sharpness[center][k] * b.sharpness[center][k];
            let correlation = (covariance * sharpness).clamp(0.0, 1.0);
            score[center][k] += correlation * correlation * correlation;
            pairs[center][k] += a.seen[center][k] * b.seen[center][k];
        }
    }
}

#[inline(always)]
fn times(a: &Line, b: &Line) -> Line {
    let mut out = [0.0; COLUMNS];
    for k in 0..COLUMNS {
        out[k] = a[k] * b[k];
    }
    out
}

/// The last lines of a tile.
struct Windows([Line; WINDOW]);

impl Windows {
    const EMPTY: Self = Self([[0.0; COLUMNS]; WINDOW]);

    #[inline(always)]
    fn push(&mut self, line: &Line) {
        self.0.rotate_left(1);
        self.0[WINDOW - 1] = *line;
    }

    /// Means of the windows whose last row is the last line and whose central row `center`; the margins are without
    /// meaning.
    #[inline(always)]
    fn means(&self, weights: &Weights, center: usize) -> Line {
        let mut out = [0.0; COLUMNS];
        for (n, weights) in weights.iter().enumerate() {
            let (line, weights) = (&self.0[n / WINDOW], &weights[center]);
            for k in 1..COLUMNS - 1 {
                out[k] += weights[k] * line[k + n % WINDOW - 1];
            }
        }
        out
    }
}
