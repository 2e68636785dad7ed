//! Normal consistency (2DGS, Huang et al. 2024, equation 14): the rendered normals of discs agree with the normals of the
//! rendered depths.
//!
//! The normal of the depths in a pixel is that of the triangle of its neighbours' points, `X_v x X_u` with differences to
//! the left, right, upper and lower pixels; it counts with the opacity, through which no derivative goes, as in the authors'
//! program. Pixels on the border, and those that are or touch pixels with an opacity below one half, have none.

use super::term::{ByView, DiscView, LossTerm, Rendered, SurfaceDepth, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::simd::{Real, SimdReal};
use crate::splat::raster::{Image, Scaled, channel, disc_plane};
use rayon::prelude::*;
use std::ops::Range;

/// The column is the mean of one minus the product of the two normals.
pub const INFO: TermInfo = TermInfo {
    weights: &["normal_consistency"],
    columns: &["normal_consistency"],
    scope: TermScope::PhotographedDiscs,
};
/// Added to the opacity that a mean depth is divided by (2DGS).
pub(super) const OPACITY_OFFSET: f64 = 1e-8;

/// Channels of the render that the term has derivatives by: the normal, the sum of depths or the median depth, the transmittance.
const CHANNELS_OF_MEAN: [usize; 5] = channels_with(channel::DEPTH);
const CHANNELS_OF_MEDIAN: [usize; 5] = channels_with(disc_plane::MEDIAN_DEPTH);

const fn channels_with(depth: usize) -> [usize; 5] {
    [channel::NORMAL, channel::NORMAL + 1, channel::NORMAL + 2, depth, disc_plane::TRANSMITTANCE]
}

/// Number of rows of a strip, which one task processes; its points and derivatives stay in the cache.
const STRIP_ROWS: usize = 32;

/// The term; keeps its buffers between calls.
#[derive(Default)]
pub struct NormalConsistency<T> {
    by_view: Image<T>,
    surface: SurfaceDepth,
    strips: Vec<Strip<T>>,
    factor: T,
    is_evaluated: bool,
}

/// Buffers of a strip and of the rows next to it.
#[derive(Default)]
struct Strip<T> {
    /// The point of the surface in each pixel, in the camera's axes; zero where the opacity is below one half.
    points: Vec<[T; 3]>,
    /// Derivatives by the differences `X_u` and `X_v` in each pixel.
    by_differences: Vec<[[T; 3]; 2]>,
    sum: f64,
}

impl<T: SimdReal> NormalConsistency<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self::default()
    }

    fn channels(&self) -> &'static [usize; 5] {
        match self.surface {
            SurfaceDepth::Mean => &CHANNELS_OF_MEAN,
            SurfaceDepth::Median => &CHANNELS_OF_MEDIAN,
        }
    }
}

/// A pinhole camera in the precision of the kernel.
struct Rays<T> {
    rotation: [[T; 3]; 3],
    per_focal: [T; 2],
    principal: [T; 2],
}

impl<T: Real> Rays<T> {
    fn new(view: &DiscView) -> Self {
        let camera = view.camera;
        let rows = camera.cam_from_site.transpose().to_cols_array_2d();
        Self {
            rotation: rows.map(|row| row.map(T::from_f64)),
            per_focal: camera.focal.to_array().map(|focal| T::from_f64(focal.recip())),
            principal: camera.principal.to_array().map(T::from_f64),
        }
    }

    /// Camera coordinates, per unit of depth, of the points that a pixel shows.
    fn ray(&self, col: usize, row: usize) -> [T; 3] {
        let at = [col, row].map(|v| T::from_f64(v as f64));
        let [x, y] = [0, 1].map(|k| (at[k] - self.principal[k]) * self.per_focal[k]);
        [x, y, T::one()]
    }

    fn cam_from_site(&self, v: [T; 3]) -> [T; 3] {
        self.rotation.map(|r| dot(r, v))
    }

    fn site_from_cam(&self, v: [T; 3]) -> [T; 3] {
        let r = &self.rotation;
        [0, 1, 2].map(|k| r[0][k] * v[0] + r[1][k] * v[1] + r[2][k] * v[2])
    }
}

fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn minus<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

impl<T: SimdReal> LossTerm<T> for NormalConsistency<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        columns.fill(0.0);
        let discs = rendered.discs.as_ref().filter(|_| weights[0] > 0.0);
        self.is_evaluated = discs.is_some();
        let Some(discs) = discs else { return 0.0 };
        let (view, rays, surface) = (rendered.view, Rays::new(discs), discs.surface);
        let Image { width, height, .. } = *view;
        self.surface = surface;
        let planes = self.channels().len();
        self.by_view.resize(width, height, planes);
        self.strips.resize_with(height.div_ceil(STRIP_ROWS), Strip::default);
        let strips = self.by_view.data.par_chunks_mut(STRIP_ROWS * planes * width).zip(&mut self.strips);
        strips.enumerate().for_each(|(k, (by, strip))| {
            let rows = k * STRIP_ROWS..height.min((k + 1) * STRIP_ROWS);
            strip.evaluate(view, &rays, surface, rows, by);
        });
        let sum: f64 = self.strips.iter().map(|strip| strip.sum).sum();
        let pixels = (width * height) as f64;
        self.factor = T::from_f64(weights[0] / pixels);
        columns[0] = sum / pixels;
        weights[0] * columns[0]
    }

    fn by_view(&self) -> Option<ByView<'_, T>> {
        let scaled = Scaled { image: &self.by_view, factor: self.factor };
        self.is_evaluated.then_some(ByView { scaled, channels: self.channels() })
    }
}

impl<T: SimdReal> Strip<T> {
    /// Sums over the pixels of `rows`, and writes the derivatives by the five channels of these rows.
    fn evaluate(
        &mut self,
        view: &Image<T>,
        rays: &Rays<T>,
        surface: SurfaceDepth,
        rows: Range<usize>,
        by: &mut [T],
    ) {
        let (width, height) = (view.width, view.height);
        let planes = by.len() / (width * rows.len());
        // The points of a row are part of the differences in the rows next to it, and these of the points in the rows after them.
        let compared = rows.start.saturating_sub(1)..(rows.end + 1).min(height);
        let first = rows.start.saturating_sub(2);
        self.find_points(view, rays, surface, first..(rows.end + 2).min(height));
        self.by_differences.clear();
        self.by_differences.resize(width * compared.len(), [[T::zero(); 3]; 2]);
        by.fill(T::zero());
        self.sum = 0.0;
        for row in compared.clone() {
            if row == 0 || row + 1 == height {
                continue;
            }
            let points = [row - 1, row, row + 1].map(|row| &self.points[(row - first) * width..][..width]);
            let by_differences = &mut self.by_differences[(row - compared.start) * width..][..width];
            let own =
                rows.contains(&row).then(|| &mut by[(row - rows.start) * planes * width..][..3 * width]);
            let sum = compare_row(view, rays, row, points, by_differences, own);
            self.sum += if rows.contains(&row) { sum } else { 0.0 };
        }
        for row in rows.clone() {
            let points = &self.points[(row - first) * width..][..width];
            let by_differences = &self.by_differences;
            let at =
                |row: usize| by_differences.get((row.checked_sub(compared.start)?) * width..)?.get(..width);
            let by_differences = [row.checked_sub(1).and_then(at), at(row), at(row + 1)];
            let by = &mut by[(row - rows.start) * planes * width..][..planes * width];
            let by_depths = &mut by[3 * width..];
            write_depth_derivatives(view, rays, surface, row, points, by_differences, by_depths);
        }
    }

    /// Computes the points of the surface in rows.
    fn find_points(&mut self, view: &Image<T>, rays: &Rays<T>, surface: SurfaceDepth, rows: Range<usize>) {
        let (offset, half) = (T::from_f64(OPACITY_OFFSET), T::from_f64(0.5));
        self.points.clear();
        for row in rows {
            let (mean, median) = (view.row(channel::DEPTH, row), view.row(disc_plane::MEDIAN_DEPTH, row));
            let through = view.row(disc_plane::TRANSMITTANCE, row);
            self.points.extend((0..view.width).map(|col| {
                let opacity = T::one() - through[col];
                let depth = match surface {
                    _ if opacity < half => T::zero(),
                    SurfaceDepth::Mean => mean[col] / (opacity + offset),
                    SurfaceDepth::Median => median[col],
                };
                rays.ray(col, row).map(|v| v * depth)
            }));
        }
    }
}

/// Compares the normals of a row, given the points of the rows above, of it, and below; writes the derivatives by the differences of
/// points and, to `own`, by the rendered normals. Returns the sum.
fn compare_row<T: SimdReal>(
    view: &Image<T>,
    rays: &Rays<T>,
    row: usize,
    [above, points, below]: [&[[T; 3]]; 3],
    by_differences: &mut [[[T; 3]; 2]],
    mut own: Option<&mut [T]>,
) -> f64 {
    let width = view.width;
    let normals = [0, 1, 2].map(|k| view.row(channel::NORMAL + k, row));
    let through = view.row(disc_plane::TRANSMITTANCE, row);
    let mut sum = 0.0;
    for col in 1..width.saturating_sub(1) {
        let [left, right, upper, lower] = [points[col - 1], points[col + 1], above[col], below[col]];
        if [points[col], left, right, upper, lower].iter().any(|point| point[2] == T::zero()) {
            continue;
        }
        let (along, down) = (minus(right, left), minus(lower, upper));
        let w = cross(down, along);
        let inverse = dot(w, w).sqrt().recip();
        if !inverse.is_finite() {
            continue;
        }
        let of_depths = w.map(|v| v * inverse);
        let rendered = rays.cam_from_site(normals.map(|n| n[col]));
        let opacity = T::one() - through[col];
        let product = dot(rendered, of_depths);
        sum += 1.0 - (opacity * product).as_f64();
        if let Some(own) = &mut own {
            let by_rendered = rays.site_from_cam(of_depths.map(|v| -v * opacity));
            for k in 0..3 {
                own[k * width + col] = by_rendered[k];
            }
        }
        let scale = -opacity * inverse;
        let by_w = [0, 1, 2].map(|k| scale * (rendered[k] - product * of_depths[k]));
        by_differences[col] = [cross(by_w, down), cross(along, by_w)];
    }
    sum
}

/// Writes the derivatives of a row by the planes that its depths were computed from: depth and transmittance. `by_differences` are
/// those of the rows above, of it, and below.
fn write_depth_derivatives<T: SimdReal>(
    view: &Image<T>,
    rays: &Rays<T>,
    surface: SurfaceDepth,
    row: usize,
    points: &[[T; 3]],
    [above, own, below]: [Option<&[[[T; 3]; 2]]>; 3],
    by: &mut [T],
) {
    let (width, offset) = (view.width, T::from_f64(OPACITY_OFFSET));
    let through = view.row(disc_plane::TRANSMITTANCE, row);
    let (by_depth_plane, by_through) = by.split_at_mut(width);
    for col in 0..width {
        let depth = points[col][2];
        if depth == T::zero() {
            continue;
        }
        // The point is the right one of the pixel to the left, and so on.
        let around = [
            (own.zip(col.checked_sub(1)), 0, T::one()),
            (own.zip(Some(col + 1).filter(|col| *col < width)), 0, -T::one()),
            (above.zip(Some(col)), 1, T::one()),
            (below.zip(Some(col)), 1, -T::one()),
        ];
        let mut by_point = [T::zero(); 3];
        for (place, difference, sign) in around {
            if let Some((by_differences, col)) = place {
                for k in 0..3 {
                    by_point[k] = by_point[k] + sign * by_differences[col][difference][k];
                }
            }
        }
        let by_depth = dot(by_point, rays.ray(col, row));
        match surface {
            SurfaceDepth::Mean => {
                let per_opacity = by_depth / (T::one() - through[col] + offset);
                by_depth_plane[col] = per_opacity;
                by_through[col] = per_opacity * depth;
            }
            SurfaceDepth::Median => by_depth_plane[col] = by_depth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perspective::PinholeCamera;
    use crate::random::CounterRng;
    use crate::splat::splats::Splats;
    use glam::{DMat3, DVec2, DVec3};

    /// More than one strip of rows.
    const SIZE: (usize, usize) = (8, STRIP_ROWS + 4);
    const PLANES: usize = disc_plane::FEATURES + 4;

    fn camera() -> PinholeCamera {
        let cam_from_site = DMat3::from_rotation_x(2.7) * DMat3::from_rotation_z(0.4);
        let (focal, principal) = (DVec2::new(12.0, 11.0), DVec2::new(3.3, 3.1));
        PinholeCamera { cam_from_site, center: DVec3::ZERO, focal, principal, size: SIZE }
    }

    /// Random planes of an uneven surface; one pixel is transparent.
    fn view() -> Image<f64> {
        let mut view = Image::zeros(SIZE.0, SIZE.1, PLANES);
        let mut draw = CounterRng::new(3, 0, 0, 0);
        for row in 0..SIZE.1 {
            for col in 0..SIZE.0 {
                let through = if (col, row) == (6, 5) { 0.9 } else { 0.1 + 0.3 * draw.uniform() };
                let depth = 5.0 + 0.2 * col as f64 + draw.uniform();
                *view.at_mut(channel::DEPTH, col, row) = (1.0 - through) * depth;
                *view.at_mut(disc_plane::MEDIAN_DEPTH, col, row) = depth + 0.1;
                *view.at_mut(disc_plane::TRANSMITTANCE, col, row) = through;
                for k in 0..3 {
                    *view.at_mut(channel::NORMAL + k, col, row) = draw.uniform() - 0.5;
                }
            }
        }
        view
    }

    fn evaluate(term: &mut NormalConsistency<f64>, view: &Image<f64>, surface: SurfaceDepth) -> f64 {
        let (none, splats) = (Image::default(), Splats::default());
        let camera = camera();
        let discs = Some(DiscView { camera: &camera, surface });
        let rendered = Rendered { view, discs, ..Rendered::of_splats(&splats, &none) };
        term.evaluate(&rendered, &[0.7], &mut [0.0])
    }

    #[test]
    fn derivatives_by_all_planes_agree_with_central_differences() {
        for surface in [SurfaceDepth::Mean, SurfaceDepth::Median] {
            let (view, mut term) = (view(), NormalConsistency::default());
            evaluate(&mut term, &view, surface);
            let (by, factor, channels) = (term.by_view.clone(), term.factor, *term.channels());
            let mut largest = [0.0f64; PLANES];
            for i in 0..view.data.len() {
                let plane = i / SIZE.0 % PLANES;
                let (row, col) = (i / SIZE.0 / PLANES, i % SIZE.0);
                let mut quotient = |e: f64| {
                    let (mut a, mut b) = (view.clone(), view.clone());
                    a.data[i] += e;
                    b.data[i] -= e;
                    (evaluate(&mut term, &a, surface) - evaluate(&mut term, &b, surface)) / (2.0 * e)
                };
                let own = channels.iter().position(|channel| *channel == plane);
                let mut expected = own.map_or(0.0, |k| factor * by.at(k, col, row));
                if plane == disc_plane::TRANSMITTANCE {
                    // The derivative by way of the weight, which the term leaves out, is the product of the normals.
                    let opacity = 1.0 - view.data[i];
                    expected -= factor
                        * (0..3)
                            .map(|k| view.at(channel::NORMAL + k, col, row) * by.at(k, col, row))
                            .sum::<f64>()
                        / opacity;
                }
                let found = quotient(1e-6);
                assert!((found - expected).abs() < 1e-9, "{surface:?} plane {plane}: {found} and {expected}");
                largest[plane] = largest[plane].max(expected.abs());
            }
            let depth = if surface == SurfaceDepth::Mean { channel::DEPTH } else { disc_plane::MEDIAN_DEPTH };
            assert!(largest[depth] > 1e-3 && largest[channel::NORMAL] > 1e-3);
        }
    }
}
