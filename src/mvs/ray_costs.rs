//! The cost volume of a reference view: the matching cost of every plane on the rays of its pixels.
//!
//! For each plane, the source views are resampled to the pixels of the reference view and compared by normalised
//! cross-correlation in windows of three sizes. The smallest preserves edges, the larger ones resolve ambiguities.

use super::block_ranges::BLOCKS;
use super::image::MatchImage;
use super::plane_ranges::PlaneRanges;
use crate::io::Grid2;
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::Range;

/// Radii of the windows, pixels, and the weights of their correlations, which add up to 1.
const RADII: [usize; 3] = [1, 2, 4];
const WEIGHTS: [f32; 3] = [1.0 / 1.4, 0.3 / 1.4, 0.1 / 1.4];
/// Pixels around a block that its windows reach.
const MARGIN: usize = RADII[2];
/// Variance of the gray values in a window up to which the window is textureless and has no correlation.
const MIN_VARIANCE: f32 = 1e-5;

/// The rays of a reference view's pixels, which meet a stack of planes, and where the source views see these points.
pub(super) trait Rays: Sync {
    /// Columns and rows, pixels, at which source view `source` sees the points of a plane on the rays of some pixels of a row.
    /// What lies behind the source view has no place (NaN).
    fn places(
        &self,
        source: usize,
        plane: usize,
        row: usize,
        columns: Range<usize>,
        cols_and_rows: [&mut [f32]; 2],
    );

    /// What a map of the view holds where the surface lies at a plane on a pixel's ray, such as its altitude; fractions of planes
    /// interpolate.
    fn value(&self, pixel: usize, plane: f32) -> f32;
}

/// Matching costs of every pixel of a view at its planes, pixel by pixel: 0 for a perfect correlation,
/// [`RayCosts::UNCORRELATED`] for none.
pub(super) struct RayCosts<'a> {
    pub ranges: &'a PlaneRanges,
    pub costs: Vec<u8>,
}

impl<'a> RayCosts<'a> {
    /// Cost where no source view sees the point.
    pub const UNSEEN: u8 = 255;
    /// Cost of a correlation of 0.
    pub const UNCORRELATED: f32 = 127.0;

    /// Matches a reference view with source views along its rays.
    pub fn new<C: Sync>(
        reference: &MatchImage<C>,
        sources: &[&MatchImage<C>],
        rays: &impl Rays,
        ranges: &'a PlaneRanges,
    ) -> Self {
        let Grid2 { width, height, .. } = reference.gray;
        let mut costs = vec![Self::UNSEEN; ranges.volume()];
        let rows = |k: usize| k * BLOCKS.rows..((k + 1) * BLOCKS.rows).min(height);
        let pixels = |k: usize| rows(k).start * width..rows(k).end * width;
        let (across, down) = BLOCKS.count((width, height));
        let parts = PlaneRanges::split(&mut costs, (0..down).map(|k| ranges.entries(pixels(k)).len()));
        parts.into_par_iter().enumerate().for_each(|(k, costs)| {
            for block in 0..across {
                let columns = block * BLOCKS.columns..((block + 1) * BLOCKS.columns).min(width);
                let planes = ranges.planes(pixels(k).start + columns.start);
                if planes.is_empty() {
                    continue;
                }
                let block = Block::new(reference, sources, rays, (columns.clone(), rows(k)));
                let place = |row: usize| {
                    let first = row * width;
                    let entries = ranges.entries(pixels(k).start..first + columns.start).len();
                    entries..entries + ranges.entries(first + columns.start..first + columns.end).len()
                };
                block.fill(planes, costs, place);
            }
        });
        Self { ranges, costs }
    }
}

/// A block of pixels of the reference view, with margins.
struct Block<'a, C, R> {
    sources: &'a [&'a MatchImage<C>],
    rays: &'a R,
    /// Columns and rows of the reference view.
    size: (usize, usize),
    /// The columns and rows inside the margins.
    columns: Range<usize>,
    rows: Range<usize>,
    /// Number of columns and of lines with the margins.
    width: usize,
    lines: usize,
    /// The reference view.
    own: Sampled,
    /// Sums of the reference view over the windows of each size.
    own_sums: [WindowSums; RADII.len()],
}

/// Gray values minus the mean of the image; 0 where the view has no valid pixel.
struct Sampled {
    value: Vec<f32>,
    /// 1 where the view has no valid pixel, else 0.
    missing: Vec<f32>,
}

/// Sums of the gray values and of their squares over windows.
struct WindowSums {
    value: Vec<f32>,
    square: Vec<f32>,
}

impl<'a, C, R: Rays> Block<'a, C, R> {
    fn new(
        reference: &MatchImage<C>,
        sources: &'a [&'a MatchImage<C>],
        rays: &'a R,
        (columns, rows): (Range<usize>, Range<usize>),
    ) -> Self {
        let (width, lines) = (columns.len() + 2 * MARGIN, rows.len() + 2 * MARGIN);
        let n = width * lines;
        let mut own = Sampled { value: vec![0.0; n], missing: vec![1.0; n] };
        for (line, row) in in_image(&rows, reference.gray.height) {
            let known = in_image(&columns, reference.gray.width)
                .map(|(place, col)| (line * width + place, reference.gray.at(col, row)))
                .filter(|(_, v)| !v.is_nan());
            for (i, v) in known {
                (own.value[i], own.missing[i]) = (v - reference.mean as f32, 0.0);
            }
        }
        let squares: Vec<f32> = own.value.iter().map(|v| v * v).collect();
        let mut scratch = vec![0.0; n];
        let own_sums = RADII.map(|radius| {
            let mut sums = |source: &[f32]| {
                let mut out = vec![0.0; n];
                sum_windows(source, width, radius, &mut scratch, &mut out);
                out
            };
            WindowSums { value: sums(&own.value), square: sums(&squares) }
        });
        let size = (reference.gray.width, reference.gray.height);
        Self { sources, rays, size, columns, rows, width, lines, own, own_sums }
    }

    /// Computes the costs of the pixels inside the margins at `planes`; `place` tells where those of a row are in `costs`.
    fn fill(&self, planes: Range<usize>, costs: &mut [u8], place: impl Fn(usize) -> Range<usize>) {
        let zeros = || vec![0.0f32; self.width * self.lines];
        let mut view = Sampled { value: zeros(), missing: zeros() };
        let (mut square, mut product, mut scratch) = (zeros(), zeros(), zeros());
        let mut sums = SourceSums { value: zeros(), square: zeros(), product: zeros(), missing: zeros() };
        let mut scores: Vec<Vec<f32>> = self.sources.iter().map(|_| zeros()).collect();
        let mut places = [(); 2].map(|()| vec![0.0f32; self.width]);
        for plane in planes.clone() {
            for (k, score) in scores.iter_mut().enumerate() {
                self.resample(k, plane, &mut places, &mut view);
                multiply(&view.value, &view.value, &mut square);
                multiply(&view.value, &self.own.value, &mut product);
                score.fill(f32::NAN);
                for ((radius, weight), own) in RADII.into_iter().zip(WEIGHTS).zip(&self.own_sums) {
                    let mut sum = |source: &[f32], out: &mut [f32]| {
                        sum_windows(source, self.width, radius, &mut scratch, out);
                    };
                    sum(&view.value, &mut sums.value);
                    sum(&square, &mut sums.square);
                    sum(&product, &mut sums.product);
                    sum(&view.missing, &mut sums.missing);
                    add_correlation(score, own, &sums, ((2 * radius + 1).pow(2) as f32).recip(), weight);
                }
            }
            for (line, row) in self.rows.clone().enumerate() {
                let of_row = &mut costs[place(row)];
                self.store(&scores, line, of_row[plane - planes.start..].iter_mut().step_by(planes.len()));
            }
        }
    }

    /// Resamples source view `k` to the reference view by way of a plane; `places` is working memory.
    fn resample(
        &self,
        k: usize,
        plane: usize,
        [place_cols, place_rows]: &mut [Vec<f32>; 2],
        out: &mut Sampled,
    ) {
        let source = self.sources[k];
        out.value.fill(0.0);
        out.missing.fill(1.0);
        let Some((first, from)) = in_image(&self.columns, self.size.0).next() else { return };
        let length = in_image(&self.columns, self.size.0).count();
        let columns = from..from + length;
        for (line, row) in in_image(&self.rows, self.size.1) {
            let (cols, rows) = (&mut place_cols[..length], &mut place_rows[..length]);
            self.rays.places(k, plane, row, columns.clone(), [&mut *cols, &mut *rows]);
            let at = line * self.width + first..line * self.width + first + length;
            let (value, missing) = (&mut out.value[at.clone()], &mut out.missing[at.clone()]);
            sample_row(&source.gray, source.mean as f32, [cols, rows], value, missing);
            for (missing, own) in missing.iter_mut().zip(&self.own.missing[at]) {
                *missing = missing.max(*own);
            }
        }
    }

    /// Stores the costs of one plane in a row. The correlations with the source views that see a point are averaged as
    /// cubes, so that one view that correlates well has more influence than several that correlate
    /// moderately.
    fn store<'b>(&self, scores: &[Vec<f32>], line: usize, costs: impl Iterator<Item = &'b mut u8>) {
        let first = (line + MARGIN) * self.width + MARGIN;
        for (i, cost) in costs.enumerate() {
            let known = scores.iter().map(|s| s[first + i]).filter(|s| !s.is_nan()).map(|s| s.max(0.0));
            let (sum, n) = known.fold((0.0f32, 0.0f32), |(sum, n), s| (sum + s * s * s, n + 1.0));
            if n > 0.0 {
                *cost = (RayCosts::UNCORRELATED * (1.0 - (sum / n).cbrt()) + 0.5).clamp(0.0, 254.0) as u8;
            }
        }
    }
}

/// The columns or rows of a block with its margins that lie in an image of so many: their index in the block, and the column or
/// row.
fn in_image(inside: &Range<usize>, count: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
    let first = inside.start;
    (0..inside.len() + 2 * MARGIN).filter_map(move |i| {
        let place = (first + i).checked_sub(MARGIN)?;
        (place < count).then_some((i, place))
    })
}

/// Sums over windows of a source view's gray values, of their squares, of their products with those of the
/// reference view, and the number of pixels that are missing in either view.
struct SourceSums {
    value: Vec<f32>,
    square: Vec<f32>,
    product: Vec<f32>,
    missing: Vec<f32>,
}

/// Adds the weighted correlations in windows of `1 / share` pixels to the scores, which are NaN before the
/// first correlation. Windows with missing pixels are left out.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn add_correlation(score: &mut [f32], own: &WindowSums, sums: &SourceSums, share: f32, weight: f32) {
    let n = score.len();
    let (a, a2) = (&own.value[..n], &own.square[..n]);
    let (b, b2, ab) = (&sums.value[..n], &sums.square[..n], &sums.product[..n]);
    let missing = &sums.missing[..n];
    for i in 0..n {
        let covariance = (ab[i] - a[i] * b[i] * share) * share;
        let (own, other) = ((a2[i] - a[i] * a[i] * share) * share, (b2[i] - b[i] * b[i] * share) * share);
        let is_textured = own > MIN_VARIANCE && other > MIN_VARIANCE;
        let correlation =
            if is_textured { (covariance / (own * other).sqrt()).clamp(-1.0, 1.0) } else { 0.0 };
        let before = if score[i].is_nan() { 0.0 } else { score[i] };
        score[i] = if missing[i] == 0.0 { before + weight * correlation } else { score[i] };
    }
}

/// Products of the elements of two slices.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn multiply(a: &[f32], b: &[f32], out: &mut [f32]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = a * b;
    }
}

/// Sums over square windows of `2 * radius + 1` pixels a side; pixels outside of the image count as 0.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn sum_windows(source: &[f32], width: usize, radius: usize, scratch: &mut [f32], out: &mut [f32]) {
    let rows = source.len() / width;
    for (line, sums) in source.chunks_exact(width).zip(scratch.chunks_exact_mut(width)) {
        sums.copy_from_slice(line);
        for d in 1..=radius.min(width - 1) {
            for i in 0..width - d {
                sums[i] += line[i + d];
            }
            for i in d..width {
                sums[i] += line[i - d];
            }
        }
    }
    for (row, sums) in out.chunks_exact_mut(width).enumerate() {
        sums.fill(0.0);
        let near = row.saturating_sub(radius)..(row + radius + 1).min(rows);
        for line in scratch[near.start * width..near.end * width].chunks_exact(width) {
            for i in 0..width {
                sums[i] += line[i];
            }
        }
    }
}

/// Samples an image bilinearly at the columns and rows `at`, and subtracts `mean`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn sample_row(gray: &Grid2, mean: f32, [cols, rows]: [&[f32]; 2], value: &mut [f32], missing: &mut [f32]) {
    if gray.width < 2 || gray.height < 2 {
        return;
    }
    let (last_col, last_row) = ((gray.width - 1) as f32, (gray.height - 1) as f32);
    let n = value.len();
    let (cols, rows, missing) = (&cols[..n], &rows[..n], &mut missing[..n]);
    for i in 0..n {
        let (x, y) = (cols[i], rows[i]);
        // False for NaN.
        let inside = x >= 0.0 && y >= 0.0 && x < last_col && y < last_row;
        let (x, y) = if inside { (x, y) } else { (0.0, 0.0) };
        let (col, row) = (x as i32, y as i32);
        let first = row as usize * gray.width + col as usize;
        let top = &gray.data[first..first + 2];
        let low = &gray.data[first + gray.width..first + gray.width + 2];
        let (right, down) = (x - col as f32, y - row as f32);
        let above = top[0] + (top[1] - top[0]) * right;
        let below = low[0] + (low[1] - low[0]) * right;
        let sample = above + (below - above) * down;
        let known = inside && !sample.is_nan();
        value[i] = if known { sample - mean } else { 0.0 };
        missing[i] = if known { 0.0 } else { 1.0 };
    }
}
