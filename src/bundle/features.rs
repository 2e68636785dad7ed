//! SIFT keypoints with RootSIFT descriptors (Lowe 2004, sections 5 and 6; Arandjelović & Zisserman 2012). The scalar
//! product of two descriptors is their similarity.
//!
//! Written by hand because no Rust library runs on images that do not fit into memory, masks missing pixels and gives
//! the same result for any number of threads; `scripts/compare-sift` compares it with OpenCV.

use super::scale_space::{Extremum, Octave, SCALES, SIGMA, extrema, octaves};
use crate::frame::{CenterPx, Pixel};
use crate::io::{Grid2, Window};
use multiversion::multiversion;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::ops::Range;

/// Length of a descriptor: 4 x 4 cells of 8 directions.
pub const VALUES: usize = 128;
/// Number of keypoints kept per megapixel, the strongest of the whole image. A limit per cell instead would choose
/// other keypoints when the image is rotated or shifted.
const PER_MEGAPIXEL: usize = 7500;
/// Side of the cells, in pixels, and the number of keypoints that each cell keeps however weak they are, so that
/// keypoints cover the whole image.
const CELL_PX: usize = 64;
const PER_CELL: usize = 8;
/// Largest number of keypoints of an image of any size: a camera has few unknowns.
const MOST: usize = 60_000;
/// A keypoint is rejected when a pixel is missing within this distance: at least so many pixels, and the radius of a
/// descriptor in units of the keypoint's scale.
const MASK_REACH_PX: usize = 10;
const MASK_REACH_SCALES: f64 = 7.5;
/// Large images are searched tile by tile. `TILE_PX` is the side of a tile and `BEYOND_PX` the overlap with its
/// neighbours, pixels. Both are multiples of the cell size and of the coarsest octave's pixel, so that tiles find the
/// keypoints of the whole image; the overlap is larger than the radius of the largest descriptor.
const TILE_PX: usize = 2048;
const BEYOND_PX: usize = 256;
const DIRECTIONS: usize = 36;
/// A peak of the direction histogram of this fraction of the highest gives a keypoint of its own.
const SECOND_PEAK: f32 = 0.8;

/// A keypoint with its descriptor.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Keypoint {
    /// Position, with fractions of a pixel.
    #[serde(with = "super::stored_keypoint::px")]
    pub px: Pixel<CenterPx>,
    /// Scale: standard deviation of the Gaussian at which it was detected, pixels.
    pub scale: f32,
    /// Gray value at the position, 0 to 255.
    pub gray: u8,
    /// Descriptor: non-negative values whose squares sum to 1.
    #[serde(with = "super::stored_keypoint::descriptor")]
    pub descriptor: [f32; VALUES],
}

/// Detects the keypoints of a gray image with values in [0, 1]; `size` is (columns, rows), NaN pixels are missing. The
/// image is read window by window. Keypoints are ordered such that any number of the first ones cover the image.
///
/// # Errors
/// The errors of `read`.
pub fn detect<E>(
    size: (usize, usize),
    mut read: impl FnMut(Window) -> Result<Grid2, E>,
) -> Result<Vec<Keypoint>, E> {
    let quota = Quota::of(size);
    let mut found: Vec<(usize, Keypoint)> = Vec::new();
    for row in (0..size.1).step_by(TILE_PX) {
        for col in (0..size.0).step_by(TILE_PX) {
            let (cols, rows) = (reach(col, size.0), reach(row, size.1));
            let seen =
                read(Window { col: cols.start, row: rows.start, width: cols.len(), height: rows.len() })?;
            let own = [(col, &cols, size.0), (row, &rows, size.1)]
                .map(|(first, seen, size)| first - seen.start..(first + TILE_PX).min(size) - seen.start);
            let place =
                |px: Pixel<CenterPx>| Pixel::new(px.col + cols.start as f64, px.row + rows.start as f64);
            let placed = keypoints(&seen, own, &quota).into_iter();
            found.extend(placed.map(|(rank, k)| (rank, Keypoint { px: place(k.px), ..k })));
        }
    }
    // The sort is stable, so that keypoints of equal rank stay in the order of the tiles.
    found.sort_by_key(|(rank, _)| *rank);
    Ok(found.into_iter().map(|(_, keypoint)| keypoint).collect())
}

/// Range of columns or rows that are read for the tile that starts at `first`.
fn reach(first: usize, size: usize) -> Range<usize> {
    first.saturating_sub(BEYOND_PX)..(first + TILE_PX + BEYOND_PX).min(size)
}

/// Numbers of keypoints to keep.
struct Quota {
    /// Keypoints per pixel of the image, the strongest.
    per_px: f64,
    /// Side of the cells, pixels.
    cell_px: usize,
}

impl Quota {
    /// The quota of an image of (columns, rows).
    fn of((width, height): (usize, usize)) -> Self {
        let pixels = width as f64 * height as f64;
        let usual = 1e-6 * PER_MEGAPIXEL as f64;
        let per_px = usual.min(MOST as f64 / pixels);
        // In large images the cells grow with the quota of each, up to the size of a tile.
        let doublings = (0.5 * (usual / per_px).log2()).ceil() as u32;
        Self { per_px, cell_px: (CELL_PX << doublings.min(8)).min(TILE_PX) }
    }
}

/// The keypoints in a range of columns and rows, each with its rank in its cell.
fn keypoints(image: &Grid2, [cols, rows]: [Range<usize>; 2], quota: &Quota) -> Vec<(usize, Keypoint)> {
    let known: Vec<f32> = image.valid().collect();
    if known.is_empty() {
        return Vec::new();
    }
    let mean = known.iter().sum::<f32>() / known.len() as f32;
    let masked = known.len() < image.data.len();
    let filled = Grid2 {
        data: image.data.iter().map(|v| if v.is_nan() { mean } else { *v }).collect(),
        ..image.clone()
    };
    let octaves = octaves(&filled);
    let mut found = extrema(&octaves);
    found.retain(|e| {
        let px = place(e, &octaves);
        cols.contains(&(px.col as usize)) && rows.contains(&(px.row as usize))
    });
    if masked {
        let missing = Missing::new(image);
        found.retain(|e| {
            let blur = SIGMA * 2f64.powf(f64::from(e.position[2]) / SCALES as f64) * octaves[e.octave].step;
            let reach = MASK_REACH_PX.max((MASK_REACH_SCALES * blur).ceil() as usize);
            !missing.is_near(place(e, &octaves), reach)
        });
    }
    let known = rows.map(|r| image.row(r)[cols.clone()].iter().filter(|v| !v.is_nan()).count());
    let strongest = (quota.per_px * known.sum::<usize>() as f64) as usize;
    let kept = spread(found, &octaves, image, strongest, quota.cell_px);
    let gradients: Vec<Vec<Gradients>> =
        octaves.iter().map(|o| o.levels[1..=SCALES].par_iter().map(Gradients::new).collect()).collect();
    let described: Vec<Vec<(usize, Keypoint)>> = kept
        .par_iter()
        .with_min_len(64)
        .map(|(rank, e)| {
            let step = octaves[e.octave].step;
            let level = (e.position[2].round() as usize).clamp(1, SCALES);
            let scale = SIGMA as f32 * 2f32.powf(e.position[2] / SCALES as f32);
            let around = &gradients[e.octave][level - 1];
            let px = place(e, &octaves);
            let gray = (255.0 * image.get(px.col.round() as i64, px.row.round() as i64)).round() as u8;
            let keypoint = |direction| {
                let descriptor = describe(around, e.position, scale, direction)?;
                Some((*rank, Keypoint { px, scale: scale * step as f32, gray, descriptor }))
            };
            directions(around, e.position, scale).into_iter().filter_map(keypoint).collect()
        })
        .collect();
    described.into_iter().flatten().collect()
}

/// Position of an extremum in the image.
fn place(e: &Extremum, octaves: &[Octave]) -> Pixel<CenterPx> {
    let step = octaves[e.octave].step;
    Pixel::new(f64::from(e.position[0]) * step, f64::from(e.position[1]) * step)
}

/// Summed-area table of the missing pixels.
struct Missing {
    columns: usize,
    rows: usize,
    sums: Vec<u32>,
}

impl Missing {
    fn new(image: &Grid2) -> Self {
        let (columns, rows) = (image.width + 1, image.height + 1);
        let mut sums = vec![0; columns * rows];
        for row in 1..rows {
            let mut in_row = 0;
            for (col, v) in image.row(row - 1).iter().enumerate() {
                in_row += u32::from(v.is_nan());
                sums[row * columns + col + 1] = sums[(row - 1) * columns + col + 1] + in_row;
            }
        }
        Self { columns, rows, sums }
    }

    /// Whether a pixel is missing within `reach` columns and rows of a position.
    fn is_near(&self, px: Pixel<CenterPx>, reach: usize) -> bool {
        let around = |p: f64, n: usize| {
            let p = p.round() as usize;
            [p.saturating_sub(reach).min(n - 1), (p + reach + 1).min(n - 1)]
        };
        let ([left, right], [top, bottom]) = (around(px.col, self.columns), around(px.row, self.rows));
        let at = |row: usize, col: usize| self.sums[row * self.columns + col];
        at(bottom, right) + at(top, left) > at(bottom, left) + at(top, right)
    }
}

/// The strongest extrema of the image up to the quota, and the strongest of each cell, with their ranks in their cells.
/// The first of every cell come first, then the second of every cell, and so on, so that any number of them from the
/// beginning covers the image.
fn spread(
    mut found: Vec<Extremum>,
    octaves: &[Octave],
    image: &Grid2,
    strongest: usize,
    cell_px: usize,
) -> Vec<(usize, Extremum)> {
    let columns = image.width.div_ceil(cell_px);
    let mut taken = vec![0; columns * image.height.div_ceil(cell_px)];
    // The sorts are stable: equal extrema keep the order in which they were found.
    found.sort_by(|a, b| b.response.abs().total_cmp(&a.response.abs()));
    let mut ranked: Vec<(usize, Extremum)> = found
        .into_iter()
        .enumerate()
        .filter_map(|(stronger, e)| {
            let step = octaves[e.octave].step as f32;
            let cell = |p: f32| ((p * step) as usize) / cell_px;
            let rank = &mut taken[cell(e.position[1]) * columns + cell(e.position[0])];
            *rank += 1;
            (stronger < strongest || *rank <= PER_CELL).then_some((*rank, e))
        })
        .collect();
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked
}

/// Gradients of a blurred image, computed once although many keypoints use each of them.
struct Gradients {
    width: usize,
    height: usize,
    /// Magnitude and direction (radians) at each pixel; zero at the border.
    polar: Vec<[f32; 2]>,
}

impl Gradients {
    fn new(raster: &Grid2) -> Self {
        let (width, height) = (raster.width, raster.height);
        let mut polar = vec![[0.0; 2]; width * height];
        for row in 1..height - 1 {
            let [above, here, below] = [row - 1, row, row + 1].map(|r| raster.row(r));
            gradients_of_row(above, here, below, &mut polar[row * width..(row + 1) * width]);
        }
        Self { width, height, polar }
    }

    /// Ranges of rows and columns within `reach` of a position.
    fn around(&self, at: [f32; 3], reach: usize) -> [Range<usize>; 2] {
        let range = |p: f32, n: usize| {
            let middle = p.round() as usize;
            middle.saturating_sub(reach)..(middle + reach + 1).min(n)
        };
        [range(at[1], self.height), range(at[0], self.width)]
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn gradients_of_row(above: &[f32], here: &[f32], below: &[f32], out: &mut [[f32; 2]]) {
    let inner = out.iter_mut().skip(1).zip(above.iter().zip(below).skip(1)).zip(here.windows(3));
    for ((out, (above, below)), here) in inner {
        let (dx, dy) = (here[2] - here[0], below - above);
        *out = [(dx * dx + dy * dy).sqrt(), direction(dx, dy)];
    }
}

/// `atan2(dy, dx)` to 1e-4 rad without branches (Abramowitz & Stegun 4.4.49, its minimax coefficients).
#[inline(always)]
fn direction(dx: f32, dy: f32) -> f32 {
    let (x, y) = (dx.abs(), dy.abs());
    let t = x.min(y) / x.max(y).max(f32::MIN_POSITIVE);
    let t2 = t * t;
    let slope = ((((0.020_835_1 * t2 - 0.085_133) * t2 + 0.180_141) * t2 - 0.330_299_5) * t2 + 0.999_866) * t;
    let steep = if y > x { FRAC_PI_2 - slope } else { slope };
    let turned = if dx < 0.0 { PI - steep } else { steep };
    turned.copysign(dy)
}

/// Gaussian weights along one axis for a range of indices.
fn window(range: Range<usize>, middle: f32, sigma: f32) -> Vec<f32> {
    range.map(|i| (-(i as f32 - middle).powi(2) / (2.0 * sigma * sigma)).exp()).collect()
}

/// The dominant gradient directions around a point.
fn directions(around: &Gradients, at: [f32; 3], scale: f32) -> Vec<f32> {
    let sigma = 1.5 * scale;
    let [rows, cols] = around.around(at, (3.0 * sigma).round() as usize);
    let (by_row, by_col) = (window(rows.clone(), at[1], sigma), window(cols.clone(), at[0], sigma));
    let mut histogram = [0.0f32; DIRECTIONS];
    for (row, in_row) in rows.zip(by_row) {
        let line = &around.polar[row * around.width..][cols.clone()];
        for ([magnitude, direction], in_col) in line.iter().zip(&by_col) {
            let bin = direction / TAU * DIRECTIONS as f32 + DIRECTIONS as f32;
            let low = bin as usize;
            let part = bin - low as f32;
            let weight = in_row * in_col * magnitude;
            histogram[low % DIRECTIONS] += (1.0 - part) * weight;
            histogram[(low + 1) % DIRECTIONS] += part * weight;
        }
    }
    for _ in 0..3 {
        let h = histogram;
        for i in 0..DIRECTIONS {
            let (before, after) = (h[(i + DIRECTIONS - 1) % DIRECTIONS], h[(i + 1) % DIRECTIONS]);
            histogram[i] = 0.25 * before + 0.5 * h[i] + 0.25 * after;
        }
    }
    let highest = histogram.iter().fold(0.0f32, |m, v| m.max(*v));
    let mut out = Vec::new();
    for i in 0..DIRECTIONS {
        let (before, here, after) =
            (histogram[(i + DIRECTIONS - 1) % DIRECTIONS], histogram[i], histogram[(i + 1) % DIRECTIONS]);
        if here > before && here >= after && here >= SECOND_PEAK * highest {
            let offset = 0.5 * (before - after) / (before - 2.0 * here + after);
            out.push((i as f32 + offset) / DIRECTIONS as f32 * TAU);
        }
    }
    out
}

/// The RootSIFT descriptor; none where the image is constant.
fn describe(around: &Gradients, at: [f32; 3], scale: f32, direction: f32) -> Option<[f32; VALUES]> {
    let cell = 3.0 * scale;
    let [rows, cols] = around.around(at, (cell * 2.5 * std::f32::consts::SQRT_2).round() as usize);
    // The standard deviation is half the width of the descriptor (Lowe 2004).
    let (by_row, by_col) = (window(rows.clone(), at[1], 2.0 * cell), window(cols.clone(), at[0], 2.0 * cell));
    let (sin, cos) = direction.sin_cos();
    // One more cell on each side, so that samples half outside need no test.
    let mut padded = [[[0.0f32; 8]; 6]; 6];
    for (row, in_row) in rows.zip(by_row) {
        let line = &around.polar[row * around.width..][cols.clone()];
        let dy = row as f32 - at[1];
        for (([magnitude, angle], in_col), col) in line.iter().zip(&by_col).zip(cols.clone()) {
            let dx = col as f32 - at[0];
            let (bx, by) = ((cos * dx + sin * dy) / cell + 2.5, (cos * dy - sin * dx) / cell + 2.5);
            if bx <= 0.0 || by <= 0.0 || bx >= 5.0 || by >= 5.0 {
                continue;
            }
            // Two full turns are added to keep the value positive.
            let bo = (angle - direction) / TAU * 8.0 + 16.0;
            let (x, y, o) = (bx as usize, by as usize, bo as usize);
            let (fx, fy, fo) = (bx - x as f32, by - y as f32, bo - o as f32);
            let weight = in_row * in_col * magnitude;
            for (y, wy) in [(y, 1.0 - fy), (y + 1, fy)] {
                for (x, wx) in [(x, 1.0 - fx), (x + 1, fx)] {
                    let bins = &mut padded[y][x];
                    bins[o % 8] += weight * wy * wx * (1.0 - fo);
                    bins[(o + 1) % 8] += weight * wy * wx * fo;
                }
            }
        }
    }
    let mut histogram: [f32; VALUES] = std::array::from_fn(|i| padded[i / 32 + 1][i / 8 % 4 + 1][i % 8]);
    let norm = histogram.iter().map(|v| v * v).sum::<f32>().sqrt();
    if norm <= f32::MIN_POSITIVE {
        return None;
    }
    for v in &mut histogram {
        *v = (*v / norm).min(0.2);
    }
    let sum: f32 = histogram.iter().sum();
    Some(histogram.map(|v| (v / sum).sqrt()))
}

/// Scalar product of two descriptors; 1 for equal descriptors.
#[inline(always)]
#[must_use]
pub fn similarity(a: &[f32; VALUES], b: &[f32; VALUES]) -> f32 {
    let mut sum = [0.0f32; 16];
    for (a, b) in a.chunks_exact(16).zip(b.chunks_exact(16)) {
        for i in 0..16 {
            sum[i] += a[i] * b[i];
        }
    }
    sum.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::scale_space::blurred;

    /// Noise of several scales.
    fn texture(width: usize, height: usize) -> Grid2 {
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1u32 << 24) as f32 - 0.5
        };
        let white = Grid2::from_fn(width, height, |_, _| noise());
        let (fine, coarse) = (blurred(&white, 1.0), blurred(&white, 4.0));
        Grid2::from_fn(width, height, |c, r| 0.5 + 0.8 * fine.at(c, r) + 4.0 * coarse.at(c, r))
    }

    fn all(image: &Grid2) -> Vec<Keypoint> {
        let Ok(found) = detect((image.width, image.height), |window| {
            Ok::<_, std::convert::Infallible>(image.window(window))
        });
        found
    }

    #[test]
    fn keypoints_turn_with_the_image() {
        let image = texture(160, 140);
        // A rotation by 90°: (col, row) becomes (row, width - 1 - col).
        let turned = Grid2::from_fn(140, 160, |c, r| image.at(159 - r, c));
        let (a, b) = (all(&image), all(&turned));
        assert!(a.len() > 100, "{}", a.len());
        let matched = a
            .iter()
            .filter(|k| {
                let there = Pixel::new(k.px.row, 159.0 - k.px.col);
                b.iter()
                    .any(|q| q.px.distance(there) < 0.3 && similarity(&k.descriptor, &q.descriptor) > 0.95)
            })
            .count();
        // Pixels of coarser octaves start at another place in the rotated image.
        assert!(matched * 5 > a.len() * 4, "{matched} of {}", a.len());
    }

    #[test]
    fn tiles_find_what_the_whole_image_would() {
        let (width, height) = (TILE_PX + 500, 400);
        let image = texture(width, height);
        let whole: Vec<Keypoint> = keypoints(&image, [0..width, 0..height], &Quota::of((width, height)))
            .into_iter()
            .map(|(_, k)| k)
            .collect();
        let tiled = all(&image);
        // The strongest keypoints of a tile are not exactly those of the whole image.
        assert!(whole.len().abs_diff(tiled.len()) * 50 <= whole.len(), "{} {}", whole.len(), tiled.len());
        // Coordinates are single precision relative to the tile's corner.
        let near = whole.iter().filter(|k| tiled.iter().any(|q| q.px.distance(k.px) < 2e-3)).count();
        assert!(near * 50 > whole.len() * 49, "{near} of {}", whole.len());
        let early = tiled.iter().take(tiled.len() / 10).filter(|k| k.px.col > TILE_PX as f64).count();
        assert!(early * 200 > tiled.len(), "{early} of {}", tiled.len());
    }

    #[test]
    fn the_strongest_are_kept_and_some_of_every_cell() {
        // The left half has strong texture, the right half another, weaker one.
        let (image, side) = (texture(1024, 512), 512);
        let image = Grid2::from_fn(1024, 512, |c, r| {
            if c < side { image.at(c, r) } else { 0.5 + 0.2 * (image.at(c, r) - 0.5) }
        });
        let octaves = octaves(&image);
        let found = extrema(&octaves);
        let kept = spread(found.clone(), &octaves, &image, 1500, CELL_PX);
        let weakest = |all: &mut Vec<f32>| *all.select_nth_unstable_by(1499, |a, b| b.total_cmp(a)).1;
        let limit = weakest(&mut found.iter().map(|e| e.response.abs()).collect());
        assert!(kept.len() > 1900 && kept.len() < 1500 + PER_CELL * 128, "{}", kept.len());
        assert_eq!(kept.iter().filter(|(_, e)| e.response.abs() >= limit).count(), 1500);
        let by_cell = |all: &[Extremum]| {
            let mut cells = vec![0; 128];
            for px in all.iter().map(|e| place(e, &octaves)) {
                cells[px.row as usize / CELL_PX * 16 + px.col as usize / CELL_PX] += 1;
            }
            cells
        };
        let kept: Vec<Extremum> = kept.into_iter().map(|(_, e)| e).collect();
        for (all, kept) in by_cell(&found).into_iter().zip(by_cell(&kept)) {
            assert!(kept >= PER_CELL.min(all), "{kept} of {all}");
        }
    }

    #[test]
    fn directions_are_those_of_the_library() {
        for i in 0..720 {
            let (sin, cos) = (i as f32 / 360.0 * PI).sin_cos();
            let off = (direction(cos, sin) - sin.atan2(cos)).abs();
            assert!(off.min(TAU - off) < 1e-4, "{cos} {sin}");
        }
        assert_eq!(direction(0.0, 0.0), 0.0);
    }

    #[test]
    fn there_are_no_keypoints_near_missing_pixels() {
        let mut image = texture(128, 128);
        for row in 0..128 {
            image.data[row * 128..row * 128 + 40].fill(f32::NAN);
        }
        let found = all(&image);
        assert!(!found.is_empty() && found.iter().all(|k| k.px.col > 49.0));
    }

    #[test]
    fn there_are_no_keypoints_around_a_small_hole() {
        let mut image = texture(128, 128);
        for row in 60..63 {
            image.data[row * 128 + 60..row * 128 + 63].fill(f32::NAN);
        }
        let found = all(&image);
        let reach = |k: &Keypoint| (k.px.col - 61.0).abs().max((k.px.row - 61.0).abs());
        assert!(!found.is_empty() && found.iter().all(|k| reach(k) > MASK_REACH_PX as f64));
    }
}
