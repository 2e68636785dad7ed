//! The Gaussian scale space of an image and the extrema of its differences (Lowe 2004, §§3 and 4).

use crate::io::Grid2;
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::Range;

/// Scales an octave is divided into.
pub const SCALES: usize = 3;
/// Blur of the first level, in the octave's pixels.
///
/// Lowe takes 1.6 and images doubled in size, which begins at much the same scale. Doubled, a few percent more are seen
/// again in a warped image, at four times the cost; not doubled they are less exact, which patches make good.
pub const SIGMA: f64 = 0.75;
/// Blur an image is taken to have.
const INITIAL_SIGMA: f64 = 0.5;
/// Octaves; satellite views of a scene differ little in scale.
const OCTAVES: usize = 4;
/// Smallest side of an octave.
const SMALLEST: usize = 32;
/// Difference of Gaussians below which an extremum is noise, images in [0, 1].
const CONTRAST: f32 = 0.004;
/// Largest ratio of principal curvatures (Lowe: 10).
const EDGE_RATIO: f32 = 10.0;
/// Pixels at the border of an octave that are not searched.
const BORDER: usize = 5;
/// Rows a thread takes at a time.
const ROWS_AT_ONCE: usize = 16;

/// Blurred images of one resolution.
pub struct Octave {
    /// `SCALES + 3` levels.
    pub levels: Vec<Grid2>,
    /// Pixels of the image a pixel of the octave is wide.
    pub step: f64,
}

/// An extremum of the differences of Gaussians.
#[derive(Clone, Copy, Debug)]
pub struct Extremum {
    /// Which octave.
    pub octave: usize,
    /// Column, row, level within the octave, with fractions.
    pub position: [f32; 3],
    /// Difference there.
    pub response: f32,
}

/// Builds the octaves of an image without NaN.
pub fn octaves(image: &Grid2) -> Vec<Octave> {
    let mut out: Vec<Octave> = Vec::new();
    let mut base = blurred(image, (SIGMA * SIGMA - INITIAL_SIGMA * INITIAL_SIGMA).sqrt());
    for o in 0..OCTAVES {
        if base.width.min(base.height) < SMALLEST {
            break;
        }
        let mut levels = vec![base];
        for s in 1..SCALES + 3 {
            let factor = 2f64.powf(1.0 / SCALES as f64);
            let before = SIGMA * factor.powi(s as i32 - 1);
            let added = before * (factor * factor - 1.0).sqrt();
            let next = blurred(&levels[s - 1], added);
            levels.push(next);
        }
        let twice = &levels[SCALES];
        base = Grid2::from_fn(twice.width / 2, twice.height / 2, |c, r| twice.at(2 * c, 2 * r));
        out.push(Octave { levels, step: f64::from(1u32 << o) });
    }
    out
}

/// Extrema of all octaves, with subpixel positions; octave by octave, strip by strip of rows, level by level.
pub fn extrema(octaves: &[Octave]) -> Vec<Extremum> {
    let mut out = Vec::new();
    for (o, octave) in octaves.iter().enumerate() {
        let height = octave.levels[0].height;
        let strips = (BORDER..height.saturating_sub(BORDER)).into_par_iter().step_by(ROWS_AT_ONCE);
        let of_strip = |first: usize| {
            let rows = first..(first + ROWS_AT_ONCE).min(height - BORDER);
            let differences = Differences::new(&octave.levels, rows.start - 1..rows.end + 1);
            let mut found = Vec::new();
            for s in 1..=SCALES {
                for row in rows.clone() {
                    let cols = BORDER..differences.width.saturating_sub(BORDER);
                    let peaks = cols.filter(|col| differences.is_extremum([*col, row, s]));
                    found.extend(peaks.filter_map(|col| refined(&octave.levels, o, [col, row, s])));
                }
            }
            found
        };
        out.par_extend(strips.flat_map_iter(of_strip));
    }
    out
}

/// Some rows of the differences of an octave's levels.
struct Differences {
    width: usize,
    rows: Range<usize>,
    /// Difference after difference, row by row.
    data: Vec<f32>,
}

impl Differences {
    fn new(levels: &[Grid2], rows: Range<usize>) -> Self {
        let width = levels[0].width;
        let pixels = rows.start * width..rows.end * width;
        let mut data = Vec::with_capacity((levels.len() - 1) * pixels.len());
        for pair in levels.windows(2) {
            let [a, b] = [&pair[0], &pair[1]].map(|level| &level.data[pixels.clone()]);
            data.extend(a.iter().zip(b).map(|(a, b)| b - a));
        }
        Self { width, rows, data }
    }

    /// Three pixels around a column of a row of a difference.
    fn around(&self, [col, row, s]: [usize; 3]) -> &[f32] {
        let start = (s * self.rows.len() + row - self.rows.start) * self.width + col;
        &self.data[start - 1..start + 2]
    }

    fn is_extremum(&self, [col, row, s]: [usize; 3]) -> bool {
        let v = self.around([col, row, s])[1];
        if v.abs() < 0.8 * CONTRAST {
            return false;
        }
        let beats = |other: f32| if v > 0.0 { v > other } else { v < other };
        // The own level first: it settles most cases.
        [s, s - 1, s + 1].into_iter().all(|level| {
            (row - 1..=row + 1).all(|r| {
                let own = level == s && r == row;
                let line = self.around([col, r, level]);
                beats(line[0]) && (own || beats(line[1])) && beats(line[2])
            })
        })
    }
}

/// The extremum of the parabola through an extremum's neighbours; none if it is faint, an edge, or runs away.
fn refined(levels: &[Grid2], octave: usize, mut at: [usize; 3]) -> Option<Extremum> {
    for _ in 0..5 {
        let [c, r, s] = at;
        let v = |dc: i64, dr: i64, ds: i64| {
            let (col, row) = ((c as i64 + dc) as usize, (r as i64 + dr) as usize);
            let level = (s as i64 + ds) as usize;
            levels[level + 1].at(col, row) - levels[level].at(col, row)
        };
        let center = v(0, 0, 0);
        let gradient = nalgebra::Vector3::new(
            0.5 * (v(1, 0, 0) - v(-1, 0, 0)),
            0.5 * (v(0, 1, 0) - v(0, -1, 0)),
            0.5 * (v(0, 0, 1) - v(0, 0, -1)),
        );
        let xx = v(1, 0, 0) + v(-1, 0, 0) - 2.0 * center;
        let yy = v(0, 1, 0) + v(0, -1, 0) - 2.0 * center;
        let ss = v(0, 0, 1) + v(0, 0, -1) - 2.0 * center;
        let xy = 0.25 * (v(1, 1, 0) - v(1, -1, 0) - v(-1, 1, 0) + v(-1, -1, 0));
        let xs = 0.25 * (v(1, 0, 1) - v(1, 0, -1) - v(-1, 0, 1) + v(-1, 0, -1));
        let ys = 0.25 * (v(0, 1, 1) - v(0, 1, -1) - v(0, -1, 1) + v(0, -1, -1));
        let hessian = nalgebra::Matrix3::new(xx, xy, xs, xy, yy, ys, xs, ys, ss);
        let offset = -hessian.try_inverse()? * gradient;
        if offset.amax() > 0.6 {
            let moved: [i64; 3] = std::array::from_fn(|k| at[k] as i64 + offset[k].round() as i64);
            let (w, h) = (levels[0].width as i64, levels[0].height as i64);
            let border = BORDER as i64;
            let inside = (border..w - border).contains(&moved[0])
                && (border..h - border).contains(&moved[1])
                && (1..=SCALES as i64).contains(&moved[2]);
            if !inside {
                return None;
            }
            at = moved.map(|m| m as usize);
            continue;
        }
        let response = center + 0.5 * gradient.dot(&offset);
        let (trace, det) = (xx + yy, xx * yy - xy * xy);
        let edge = (EDGE_RATIO + 1.0) * (EDGE_RATIO + 1.0) / EDGE_RATIO;
        if response.abs() < CONTRAST || det <= 0.0 || trace * trace >= edge * det {
            return None;
        }
        let position = [c as f32 + offset[0], r as f32 + offset[1], s as f32 + offset[2]];
        return Some(Extremum { octave, position, response });
    }
    None
}

/// Gaussian blur, borders repeated.
pub fn blurred(image: &Grid2, sigma: f64) -> Grid2 {
    let reach = (3.5 * sigma).ceil() as usize;
    let taps: Vec<f64> =
        (0..=2 * reach).map(|i| (-(i as f64 - reach as f64).powi(2) / (2.0 * sigma * sigma)).exp()).collect();
    let sum: f64 = taps.iter().sum();
    let taps: Vec<f32> = taps.iter().map(|t| (t / sum) as f32).collect();
    let (width, height) = (image.width, image.height);
    let mut out = Grid2::filled(width, height, 0.0);
    out.data.par_chunks_mut(width * ROWS_AT_ONCE).enumerate().for_each(|(k, lines)| {
        let first = k * ROWS_AT_ONCE;
        let rows = first.saturating_sub(reach)..(first + ROWS_AT_ONCE + reach).min(height);
        // The rows that the strip needs, blurred along.
        let mut along = vec![0.0f32; rows.len() * width];
        let mut padded = vec![0.0f32; width + 2 * reach];
        for (line, out) in image.data[rows.start * width..].chunks(width).zip(along.chunks_mut(width)) {
            padded[..reach].fill(line[0]);
            padded[reach..reach + width].copy_from_slice(line);
            padded[reach + width..].fill(line[width - 1]);
            let shifted: Vec<&[f32]> = padded.windows(width).collect();
            weighted_sum(&taps, &shifted, out);
        }
        for (row, line) in (first..).zip(lines.chunks_mut(width)) {
            let from = |t: usize| (row + t).saturating_sub(reach).min(height - 1) - rows.start;
            let covered = (0..taps.len()).map(|t| &along[from(t) * width..(from(t) + 1) * width]);
            weighted_sum(&taps, &covered.collect::<Vec<_>>(), line);
        }
    });
    out
}

/// Sums lines times weights.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn weighted_sum(weights: &[f32], lines: &[&[f32]], out: &mut [f32]) {
    /// So many columns stay in registers.
    const AT_ONCE: usize = 64;
    let (blocks, rest) = out.as_chunks_mut::<AT_ONCE>();
    let mut start = 0;
    for out in blocks {
        let mut sums = [0.0; AT_ONCE];
        for (weight, line) in weights.iter().zip(lines) {
            for (sum, v) in sums.iter_mut().zip(&line[start..start + AT_ONCE]) {
                *sum += weight * v;
            }
        }
        *out = sums;
        start += AT_ONCE;
    }
    for (col, out) in (start..).zip(rest) {
        *out = weights.iter().zip(lines).map(|(weight, line)| weight * line[col]).sum();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Across the strips that are searched at a time, too.
    #[test]
    fn a_blob_is_found_where_it_is_to_a_twentieth_of_a_pixel() {
        let sigma = 3.0f64;
        for i in 0..ROWS_AT_ONCE {
            let (x, y) = (40.3, 19.7 + 2.0 * i as f64);
            let image = Grid2::from_fn(90, 80, |c, r| {
                let d2 = (c as f64 - x).powi(2) + (r as f64 - y).powi(2);
                (0.2 + 0.6 * (-d2 / (2.0 * sigma * sigma)).exp()) as f32
            });
            let octaves = octaves(&image);
            let found = extrema(&octaves);
            let best = found.iter().max_by(|a, b| a.response.abs().total_cmp(&b.response.abs())).unwrap();
            let step = octaves[best.octave].step;
            assert!((f64::from(best.position[0]) * step - x).abs() < 0.05, "{y}: {best:?}");
            assert!((f64::from(best.position[1]) * step - y).abs() < 0.05, "{y}: {best:?}");
        }
    }

    #[test]
    fn images_of_any_size_are_blurred_as_the_definition_says() {
        for (width, height) in [(1, 1), (5, 1), (1, 40), (63, 5), (64, 16), (65, 17), (130, 33)] {
            let image = Grid2::from_fn(width, height, |c, r| ((c * 7 + r * 13) % 11) as f32);
            for sigma in [0.56f64, 1.45] {
                let reach = (3.5 * sigma).ceil() as i64;
                let bell = |d: i64| (-0.5 * (d as f64 / sigma).powi(2)).exp();
                let total = (-reach..=reach).map(bell).sum::<f64>().powi(2);
                let at = |c: i64, r: i64| {
                    let (c, r) = (c.clamp(0, width as i64 - 1), r.clamp(0, height as i64 - 1));
                    f64::from(image.at(c as usize, r as usize))
                };
                let made = blurred(&image, sigma);
                for (i, v) in made.data.iter().enumerate() {
                    let (col, row) = ((i % width) as i64, (i / width) as i64);
                    let around = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y)));
                    let sum: f64 = around.map(|(x, y)| bell(x) * bell(y) * at(col + x, row + y)).sum();
                    let off = (f64::from(*v) - sum / total).abs();
                    assert!(off < 1e-4, "{width} x {height}, {sigma}: {off} at {col} {row}");
                }
            }
        }
    }

    #[test]
    fn a_constant_image_has_no_extrema() {
        assert!(extrema(&octaves(&Grid2::filled(64, 64, 0.5))).is_empty());
    }
}
