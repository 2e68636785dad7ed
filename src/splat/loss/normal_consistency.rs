//! Normal consistency (2DGS, Huang et al. 2024, equation 14): the rendered normals of discs agree with the normals of the
//! rendered depths.
//!
//! The normal of the depths in a pixel is that of the triangle of its neighbours' points, `X_v x X_u` with differences to
//! the left, right, upper and lower pixels; it counts with the opacity, through which no derivative goes, as in the authors'
//! program. Pixels on the border, and those that are or touch pixels with an opacity below one half, have none.

use super::term::{DiscView, LossTerm, Rendered, Scaled, SurfaceDepth, TermInfo};
use super::terms::TermInputs;
use crate::simd::{Real, SimdReal};
use crate::splat::raster::{Image, channel, disc_plane};
use rayon::prelude::*;

/// The column is the mean of one minus the product of the two normals.
pub const INFO: TermInfo = TermInfo { weights: &["normal_consistency"], columns: &["normal_consistency"] };
/// Added to the opacity that a mean depth is divided by (2DGS).
pub(super) const OPACITY_OFFSET: f64 = 1e-8;

/// The term; keeps its buffers between calls.
#[derive(Default)]
pub struct NormalConsistency<T> {
    by_view: Image<T>,
    /// Depth of the surface in each pixel; zero where the opacity is below one half.
    depth: Vec<T>,
    /// Derivatives by the differences `X_u` and `X_v` in each pixel.
    by_differences: Vec<[[T; 3]; 2]>,
    factor: T,
    is_evaluated: bool,
}

impl<T: SimdReal> NormalConsistency<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self::default()
    }
}

/// A pinhole camera in the precision of the kernel.
struct Rays<T> {
    rotation: [[T; 3]; 3],
    focal: [T; 2],
    principal: [T; 2],
}

impl<T: Real> Rays<T> {
    fn new(view: &DiscView) -> Self {
        let camera = view.camera;
        let rows = camera.cam_from_site.transpose().to_cols_array_2d();
        Self {
            rotation: rows.map(|row| row.map(T::from_f64)),
            focal: camera.focal.to_array().map(T::from_f64),
            principal: camera.principal.to_array().map(T::from_f64),
        }
    }

    /// Camera coordinates, per unit of depth, of the points that a pixel shows.
    fn ray(&self, col: usize, row: usize) -> [T; 3] {
        let at = [col, row].map(|v| T::from_f64(v as f64));
        let [x, y] = [0, 1].map(|k| (at[k] - self.principal[k]) / self.focal[k]);
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
        let (view, rays) = (rendered.view, Rays::new(discs));
        self.find_depths(view, discs.surface);
        let sum = self.compare(view, &rays);
        self.add_depth_derivatives(view, &rays, discs.surface);
        let pixels = (view.width * view.height) as f64;
        self.factor = T::from_f64(weights[0] / pixels);
        columns[0] = sum / pixels;
        weights[0] * columns[0]
    }

    fn by_view(&self) -> Option<Scaled<'_, T>> {
        self.is_evaluated.then_some(Scaled { image: &self.by_view, factor: self.factor })
    }
}

impl<T: SimdReal> NormalConsistency<T> {
    /// Computes the depths of the surface.
    fn find_depths(&mut self, view: &Image<T>, surface: SurfaceDepth) {
        let (width, offset, half) = (view.width, T::from_f64(OPACITY_OFFSET), T::from_f64(0.5));
        self.depth.resize(width * view.height, T::zero());
        self.depth.par_chunks_mut(width).enumerate().for_each(|(row, out)| {
            let (mean, median) = (view.row(channel::DEPTH, row), view.row(disc_plane::MEDIAN_DEPTH, row));
            let through = view.row(disc_plane::TRANSMITTANCE, row);
            for (col, out) in out.iter_mut().enumerate() {
                let opacity = T::one() - through[col];
                *out = match surface {
                    _ if opacity < half => T::zero(),
                    SurfaceDepth::Mean => mean[col] / (opacity + offset),
                    SurfaceDepth::Median => median[col],
                };
            }
        });
    }

    /// Compares the normals; writes the derivatives by the rendered normals and by the differences of points. Returns the sum.
    fn compare(&mut self, view: &Image<T>, rays: &Rays<T>) -> f64 {
        let Image { width, height, channels: planes, .. } = *view;
        let Self { by_view, depth, by_differences, .. } = self;
        by_view.resize(width, height, planes);
        by_differences.resize(width * height, [[T::zero(); 3]; 2]);
        let rows = by_view.data.par_chunks_mut(planes * width).zip(by_differences.par_chunks_mut(width));
        let sums: Vec<f64> = rows
            .enumerate()
            .map(|(row, (by, by_differences))| {
                by.fill(T::zero());
                by_differences.fill([[T::zero(); 3]; 2]);
                if row == 0 || row + 1 == height {
                    return 0.0;
                }
                let point = |col: usize, row: usize| {
                    let z = depth[row * width + col];
                    rays.ray(col, row).map(|v| v * z)
                };
                let normals = [0, 1, 2].map(|k| view.row(channel::NORMAL + k, row));
                let through = view.row(disc_plane::TRANSMITTANCE, row);
                let mut sum = 0.0;
                for col in 1..width.saturating_sub(1) {
                    let i = row * width + col;
                    if [i, i - 1, i + 1, i - width, i + width].iter().any(|i| depth[*i] == T::zero()) {
                        continue;
                    }
                    let along = minus(point(col + 1, row), point(col - 1, row));
                    let down = minus(point(col, row + 1), point(col, row - 1));
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
                    let by_rendered = rays.site_from_cam(of_depths.map(|v| -v * opacity));
                    for k in 0..3 {
                        by[(channel::NORMAL + k) * width + col] = by_rendered[k];
                    }
                    let scale = -opacity * inverse;
                    let by_w = [0, 1, 2].map(|k| scale * (rendered[k] - product * of_depths[k]));
                    by_differences[col] = [cross(by_w, down), cross(along, by_w)];
                }
                sum
            })
            .collect();
        sums.iter().sum()
    }

    /// Writes the derivatives by the planes that the depths were computed from.
    fn add_depth_derivatives(&mut self, view: &Image<T>, rays: &Rays<T>, surface: SurfaceDepth) {
        let Image { width, height, channels: planes, .. } = *view;
        let Self { by_view, depth, by_differences, .. } = self;
        let offset = T::from_f64(OPACITY_OFFSET);
        by_view.data.par_chunks_mut(planes * width).enumerate().for_each(|(row, by)| {
            let through = view.row(disc_plane::TRANSMITTANCE, row);
            for col in 0..width {
                let i = row * width + col;
                if depth[i] == T::zero() {
                    continue;
                }
                let mut by_point = [T::zero(); 3];
                let mut add = |difference: usize, pixel: usize, sign: T| {
                    for k in 0..3 {
                        by_point[k] = by_point[k] + sign * by_differences[pixel][difference][k];
                    }
                };
                if col > 0 {
                    add(0, i - 1, T::one());
                }
                if col + 1 < width {
                    add(0, i + 1, -T::one());
                }
                if row > 0 {
                    add(1, i - width, T::one());
                }
                if row + 1 < height {
                    add(1, i + width, -T::one());
                }
                let by_depth = dot(by_point, rays.ray(col, row));
                match surface {
                    SurfaceDepth::Mean => {
                        let per_opacity = by_depth / (T::one() - through[col] + offset);
                        by[channel::DEPTH * width + col] = per_opacity;
                        by[disc_plane::TRANSMITTANCE * width + col] = per_opacity * depth[i];
                    }
                    SurfaceDepth::Median => by[disc_plane::MEDIAN_DEPTH * width + col] = by_depth,
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perspective::PinholeCamera;
    use crate::random::CounterRng;
    use crate::splat::splats::Splats;
    use glam::{DMat3, DVec2, DVec3};

    const SIZE: (usize, usize) = (8, 7);
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
            let (by, factor) = (term.by_view.clone(), term.factor);
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
                let mut expected = factor * by.data[i];
                if plane == disc_plane::TRANSMITTANCE {
                    // The derivative by way of the weight, which the term leaves out, is the product of the normals.
                    let opacity = 1.0 - view.data[i];
                    let at = |image: &Image<f64>, k: usize| image.at(channel::NORMAL + k, col, row);
                    expected -= factor * (0..3).map(|k| at(&view, k) * at(&by, k)).sum::<f64>() / opacity;
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
