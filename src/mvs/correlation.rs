//! The cost volume of the plane sweep: how well the views agree in every cell at every altitude.
//!
//! Gray values are compared by normalised cross-correlation in small windows of cells. From the second pass
//! on, the cells of a window are weighted by how similar they are to its centre (adaptive support weights;
//! Yoon and Kweon 2006).

use super::image::MatchImage;
use super::plane_ranges::PlaneRanges;
use super::plane_sweep::{BLOCKS, PlaneStack, PlaneSweep};
use super::visibility::Visibility;
use crate::frame::Point;
use crate::io::Grid2;
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::Range;

/// Side of the windows, cells.
const WINDOW: usize = 3;
/// Rows and columns of a tile: a block of cells whose data fit into the cache of a core, and whose planes are the same. Tiles
/// overlap by the margins of the windows.
const INNER_ROWS: usize = BLOCKS.rows;
const INNER_COLUMNS: usize = BLOCKS.columns;
const ROWS: usize = INNER_ROWS + (WINDOW - 1);
const COLUMNS: usize = INNER_COLUMNS + (WINDOW - 1);
/// Variance of the gray values in a window up to which the window is textureless and has no correlation.
const MIN_VARIANCE: f32 = 1e-5;
/// Difference of gray values, in standard deviations of the image, at which the weight of a cell in a window
/// falls to 1/e.
const SIMILARITY_SCALE: f32 = 0.2;
/// The agreement of the views in a cell rises from 0 to 1 between these scores of the best altitude.
const AGREEMENT: Range<f32> = 0.1..0.25;

/// Largest cost of the priors of [`CostVolume::add_prior`], where 255 stands for a correlation of 0.
const PRIOR_COST: f32 = 90.0;
/// Distance from a prior at which half of its cost is reached, metres.
const PRIOR_SCALE_M: f32 = 3.0;
/// Cost at the trained surface where the views do not agree, as a share of `PRIOR_COST`: there the first
/// surface is preferred.
const TRAINED_OFFSET: f32 = 0.25;
/// Cost at the first surface where the views agree, as a share of `PRIOR_COST`: there the trained surface is
/// preferred.
const FIRST_OFFSET: f32 = 0.5;

/// A value for every cell of a row of a tile.
type Line<T = f32> = [T; COLUMNS];
/// A value for every cell of a tile.
type Lines = [Line; ROWS];
/// For every position in a window, row by row, its weight in the window around each cell. The weights of a
/// window add up to 1.
type Weights = [Lines; WINDOW * WINDOW];

/// Matching costs of every cell at its planes, cell by cell: from 0 for a perfect correlation to 254 for none.
pub(super) struct CostVolume<'a> {
    pub ranges: &'a PlaneRanges,
    pub costs: Vec<u8>,
}

impl<'a> CostVolume<'a> {
    /// Cost where no pair of views sees the cell.
    pub const UNSEEN: u8 = 255;
    /// Cost of no correlation.
    const UNCORRELATED: u8 = 254;

    /// Correlates all pairs of views. With the visibility from an earlier pass, similar cells of a window
    /// weigh more, and views from which a cell is occluded are left out.
    pub fn correlate(sweep: &'a PlaneSweep, visibility: Option<&Visibility>) -> Self {
        let (ranges, width) = (&sweep.ranges, sweep.grid.width);
        let mut costs = vec![Self::UNSEEN; ranges.volume()];
        let rows = |k: usize| k * INNER_ROWS..((k + 1) * INNER_ROWS).min(sweep.grid.height);
        let cells = |k: usize| rows(k).start * width..rows(k).end * width;
        let bands = sweep.grid.height.div_ceil(INNER_ROWS);
        let parts = PlaneRanges::split(&mut costs, (0..bands).map(|k| ranges.entries(cells(k)).len()));
        parts.into_par_iter().enumerate().for_each(|(k, costs)| {
            let mut tile = Tile::new(sweep);
            for first_column in (0..width).step_by(INNER_COLUMNS) {
                if ranges.planes(cells(k).start + first_column).is_empty() {
                    continue;
                }
                tile.move_to(first_column, rows(k).start, visibility);
                tile.set_weights(visibility);
                tile.correlate(costs, rows(k));
            }
        });
        Self { ranges, costs }
    }

    /// Raises the costs of the planes of cells for which this holds; `of_cell` is called once for each cell.
    pub fn raise<F: Fn(usize) -> bool>(&mut self, by: u8, of_cell: impl Fn(usize) -> F + Sync) {
        let ranges = self.ranges;
        let lengths = (0..ranges.cells()).map(|cell| ranges.planes(cell).len());
        PlaneRanges::split(&mut self.costs, lengths).into_par_iter().enumerate().for_each(|(cell, costs)| {
            let seen = ranges.planes(cell).zip(costs).filter(|(_, cost)| **cost != Self::UNSEEN);
            let is_raised = of_cell(cell);
            for (_, cost) in seen.filter(|(plane, _)| is_raised(*plane)) {
                *cost = cost.saturating_add(by).min(Self::UNCORRELATED);
            }
        });
    }

    /// Adds the cost of the distance to the nearer of two priors: the trained surface `trained` and the
    /// `first` surface.
    ///
    /// Where the views do not agree or show a textureless surface, splats drift during training: there the
    /// first surface is preferred, elsewhere the trained one.
    pub fn add_prior(&mut self, trained: &Grid2, first: &Grid2, stack: &PlaneStack, visibility: &Visibility) {
        let scale = 1.0 - PRIOR_COST / 255.0;
        let ranges = self.ranges;
        let lengths = (0..ranges.cells()).map(|cell| ranges.planes(cell).len());
        PlaneRanges::split(&mut self.costs, lengths).into_par_iter().enumerate().for_each(|(cell, costs)| {
            let confidence = agreement(costs).min(visibility.texture(cell));
            let of_planes = ranges.planes(cell).zip(costs.iter_mut());
            for (k, cost) in of_planes.filter(|(_, c)| **c != Self::UNSEEN) {
                let z = stack.altitude(cell, k as f32);
                let to_trained = TRAINED_OFFSET * (1.0 - confidence) + geman_mcclure(z - trained.data[cell]);
                let to_first = FIRST_OFFSET * confidence + geman_mcclure(z - first.data[cell]);
                let nearer = to_trained.min(to_first);
                *cost = (scale * f32::from(*cost) + PRIOR_COST * nearer).min(254.0) as u8;
            }
        });
    }

    /// The costs of a cell, plane by plane.
    pub fn cell(&self, cell: usize) -> &[u8] {
        &self.costs[self.ranges.entries(cell..cell + 1)]
    }
}

/// How well the views agree at the best altitude of a cell, from 0 to 1.
fn agreement(costs: &[u8]) -> f32 {
    let best = 1.0 - f32::from(costs.iter().copied().min().unwrap_or(CostVolume::UNSEEN)) / 255.0;
    ((best - AGREEMENT.start) / (AGREEMENT.end - AGREEMENT.start)).clamp(0.0, 1.0)
}

/// Robust distance of an altitude from a prior (Geman and McClure 1985): from 0 at the prior to 1 far from
/// it; 1 if the prior is unknown.
fn geman_mcclure(distance_m: f32) -> f32 {
    let d = distance_m / PRIOR_SCALE_M;
    if d.is_nan() { 1.0 } else { d * d / (d * d + 1.0) }
}

/// A block of cells of the map grid, with margins of half a window, and the working memory to correlate it.
struct Tile<'a> {
    sweep: &'a PlaneSweep,
    first_column: usize,
    /// Indices of the cells in the grid. Margins beyond the grid repeat its border.
    cells: [Line<u32>; ROWS],
    views: Vec<Samples<'a>>,
    weights: Box<Weights>,
    score: Box<Lines>,
    pairs: Box<Lines>,
}

/// Samples of a view at the cells of a tile, for one plane of the stack.
struct Samples<'a> {
    image: &'a MatchImage,
    /// Image positions of the cells at altitude 0, pixels.
    column: Lines,
    row: Lines,
    /// Their displacements per metre of altitude at altitude 0, columns and rows, pixels.
    px_per_m: [Lines; 2],
    /// Altitude below which the cell is occluded.
    occluded_below: Lines,
    /// Gray values; 0 where the view has none.
    gray: Lines,
    /// 1 where the view sees the cell at this altitude, else 0.
    seen: Lines,
    /// Means over windows.
    mean: Lines,
    /// Reciprocals of the standard deviations over windows; 0 where the cell is not seen or textureless.
    inverse_std_dev: Lines,
}

const ZEROS: Lines = [[0.0; COLUMNS]; ROWS];

impl<'a> Tile<'a> {
    fn new(sweep: &'a PlaneSweep) -> Self {
        let samples = |image| Samples {
            image,
            column: ZEROS,
            row: ZEROS,
            px_per_m: [ZEROS; 2],
            occluded_below: ZEROS,
            gray: ZEROS,
            seen: ZEROS,
            mean: ZEROS,
            inverse_std_dev: ZEROS,
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

    /// Moves the tile: its first cell inside the margins is that at `first_column`, `first_row` of the grid.
    fn move_to(&mut self, first_column: usize, first_row: usize, visibility: Option<&Visibility>) {
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
                    let level = Point::new(p.x(), p.y(), 0.0);
                    let px = view.image.camera.project(level);
                    (view.column[r][c], view.row[r][c]) = (px.col as f32, px.row as f32);
                    let linear = view.image.camera.tangent_at(level).linear;
                    (0..2).for_each(|axis| view.px_per_m[axis][r][c] = linear[axis][2] as f32);
                    view.occluded_below[r][c] =
                        visibility.map_or(f32::NEG_INFINITY, |v| v.lowest_visible(index, cell));
                }
            }
        }
    }

    /// Sets the weights of the cells of every window: larger for cells whose gray values are similar to those
    /// of the central cell. Without a visibility all weights are equal.
    fn set_weights(&mut self, visibility: Option<&Visibility>) {
        for r in 1..ROWS - 1 {
            for c in 1..COLUMNS - 1 {
                let center = self.cells[r][c] as usize;
                let weight = |n: usize| {
                    let other = self.cells[r + n / WINDOW - 1][c + n % WINDOW - 1] as usize;
                    let difference = visibility.map_or(0.0, |v| v.gray_difference(center, other));
                    if difference.is_nan() { 1.0 } else { (-difference / SIMILARITY_SCALE).exp() }
                };
                let weights: [f32; WINDOW * WINDOW] = std::array::from_fn(weight);
                let total: f32 = weights.iter().sum();
                for (lines, weight) in self.weights.iter_mut().zip(weights) {
                    lines[r][c] = weight / total;
                }
            }
        }
    }

    /// Computes the costs of the cells inside the margins, which have the same planes. `costs` holds those of whole rows of the
    /// grid.
    fn correlate(&mut self, costs: &mut [u8], rows: Range<usize>) {
        let (ranges, width) = (&self.sweep.ranges, self.sweep.grid.width);
        let columns = INNER_COLUMNS.min(width - self.first_column);
        let (planes, band) = (ranges.planes(rows.start * width + self.first_column), rows.start * width);
        let mut altitudes = ZEROS;
        for plane in planes.clone() {
            let (above, last) = (plane - planes.start, planes.len() - 1);
            let relative = above as f32 / last.max(1) as f32;
            for (z, cell) in altitudes.as_flattened_mut().iter_mut().zip(self.cells.as_flattened()) {
                *z = self.sweep.stack.altitude(*cell as usize, plane as f32);
            }
            for view in &mut self.views {
                sample(view, &altitudes);
                window_statistics(view, &self.weights);
            }
            *self.score = ZEROS;
            *self.pairs = ZEROS;
            for &(i, j) in &self.sweep.pairs {
                let (a, b) = (&self.views[i], &self.views[j]);
                add_pair(a, b, &self.weights, &mut self.score, &mut self.pairs);
            }
            for row in 0..rows.len() {
                let line = row + WINDOW / 2;
                let (cells, score, pairs) = (&self.cells[line], &self.score[line], &self.pairs[line]);
                let cell = band + row * width + self.first_column;
                let first = ranges.entries(band..cell).len() + above;
                let of_row = costs[first..].iter_mut().step_by(planes.len()).take(columns);
                for (column, cost) in of_row.enumerate() {
                    let k = column + WINDOW / 2;
                    if pairs[k] > 0.0 {
                        // Where few images cover the cell, their views may agree by chance.
                        let share = self.sweep.coverage[cells[k] as usize].share(relative);
                        let mean = share * score[k] / (pairs[k] + self.sweep.extra_pairs);
                        *cost = (255.5 - 255.0 * mean).min(254.0) as u8;
                    }
                }
            }
        }
    }
}

/// Samples the gray values of a view, bilinearly, at the cells of a tile at their `altitudes`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn sample(view: &mut Samples, altitudes: &Lines) {
    let MatchImage { gray, camera, .. } = view.image;
    // Coefficients of the square of the altitude.
    let [square_col, square_row] = camera.quadratic.map(|q| q[5] as f32);
    let (last_column, last_row) = ((gray.width - 1) as f32, (gray.height - 1) as f32);
    for line in 0..ROWS {
        let (mut index, mut right, mut down, mut known) =
            ([0u32; COLUMNS], [0.0; COLUMNS], [0.0; COLUMNS], [false; COLUMNS]);
        for k in 0..COLUMNS {
            let z = altitudes[line][k];
            let u = view.column[line][k] + view.px_per_m[0][line][k] * z + square_col * z * z;
            let v = view.row[line][k] + view.px_per_m[1][line][k] * z + square_row * z * z;
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
            view.gray[line][k] = if known { value } else { 0.0 };
            let seen = known && altitudes[line][k] >= view.occluded_below[line][k];
            view.seen[line][k] = if seen { 1.0 } else { 0.0 };
        }
    }
}

/// Means and reciprocal standard deviations of a view's gray values in the window around every cell.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn window_statistics(view: &mut Samples, weights: &Weights) {
    let mut values = Windows::EMPTY;
    let mut squares = Windows::EMPTY;
    for line in 0..ROWS {
        let v = &view.gray[line];
        values.push(v);
        squares.push(&product(v, v));
        let Some(center) = line.checked_sub(WINDOW - 1).map(|first| first + WINDOW / 2) else { continue };
        let (mean, square) = (values.means(weights, center), squares.means(weights, center));
        for k in 0..COLUMNS {
            let variance = square[k] - mean[k] * mean[k];
            let usable = view.seen[center][k] > 0.0 && variance > MIN_VARIANCE;
            view.inverse_std_dev[center][k] = if usable { variance.sqrt().recip() } else { 0.0 };
        }
        view.mean[center] = mean;
    }
}

/// Adds the cubes of the correlations of two views to `score`, and to `pairs` 1 where both see the cell. With
/// the cubes, one pair that correlates well has more influence than several that correlate moderately.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn add_pair(a: &Samples, b: &Samples, weights: &Weights, score: &mut Lines, pairs: &mut Lines) {
    let mut products = Windows::EMPTY;
    for line in 0..ROWS {
        products.push(&product(&a.gray[line], &b.gray[line]));
        let Some(center) = line.checked_sub(WINDOW - 1).map(|first| first + WINDOW / 2) else { continue };
        let mean = products.means(weights, center);
        for k in 0..COLUMNS {
            let covariance = mean[k] - a.mean[center][k] * b.mean[center][k];
            let scale = a.inverse_std_dev[center][k] * b.inverse_std_dev[center][k];
            let correlation = (covariance * scale).clamp(0.0, 1.0);
            score[center][k] += correlation * correlation * correlation;
            pairs[center][k] += a.seen[center][k] * b.seen[center][k];
        }
    }
}

#[inline(always)]
fn product(a: &Line, b: &Line) -> Line {
    let mut out = [0.0; COLUMNS];
    for k in 0..COLUMNS {
        out[k] = a[k] * b[k];
    }
    out
}

/// The last rows of a tile, as many as a window has.
struct Windows([Line; WINDOW]);

impl Windows {
    const EMPTY: Self = Self([[0.0; COLUMNS]; WINDOW]);

    #[inline(always)]
    fn push(&mut self, line: &Line) {
        self.0.rotate_left(1);
        self.0[WINDOW - 1] = *line;
    }

    /// Weighted means of the windows that end with the row that was pushed last; `center` is their central
    /// row. The first and last column have no meaning.
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
