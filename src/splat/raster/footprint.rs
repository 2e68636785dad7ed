//! The ellipse of a projected splat: the tiles that it touches, and the gradient from the ellipse to the splat.

use super::block::TILE;
use super::covariance::ELEMENTS;
use super::gradient_slot::GradientSlot;
use super::primitive::{Primitive, StoredNumbers};
use super::slope::SlopeGradient;
use super::splat_block::SplatGradient;
use crate::camera::{CameraKernel, DepthOrder};
use crate::simd::{Real, Simd, SimdVec};

/// The ellipse on which a splat's alpha equals [`ALPHA_CUT`](super::ALPHA_CUT): a scalar for each number, or a vector with
/// a lane for each splat.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Footprint<N> {
    /// Centre (column, row), pixels.
    pub mean: [N; 2],
    /// Inverse of the 2-D covariance: xx, xy, yy; 1/px².
    pub conic: [N; 3],
    /// Base-2 logarithm of the opacity.
    pub log2_opacity: N,
    /// Squared Mahalanobis radius of the ellipse.
    pub radius2: N,
    /// Row of the ellipse's rightmost point, relative to the centre, pixels.
    pub rightmost_dy: N,
}

impl<N: Copy> Footprint<N> {
    /// All fields as one array, as they are stored.
    #[inline(always)]
    pub fn numbers(self) -> [N; 8] {
        let Self { mean: [u, v], conic: [a, b, c], log2_opacity, radius2, rightmost_dy } = self;
        [u, v, a, b, c, log2_opacity, radius2, rightmost_dy]
    }

    /// From [`Footprint::numbers`].
    #[inline(always)]
    pub fn of([u, v, a, b, c, log2_opacity, radius2, rightmost_dy]: [N; 8]) -> Self {
        Self { mean: [u, v], conic: [a, b, c], log2_opacity, radius2, rightmost_dy }
    }
}

impl<S: Simd> Footprint<SimdVec<S>> {
    /// The ellipse on which the alpha of a disc with this slope equals the cut-off in a perspective projection, with half of
    /// its width and height in pixels. `covariance` (xx, xy, yy) is the inverse of the conic.
    ///
    /// With the conic `L`, the slope `g` and the squared radius `r²`, alpha equals the cut-off where `d L d = r² (1 + g . d)²`.
    #[inline(always)]
    pub fn silhouette(
        self,
        simd: S,
        [gx, gy]: [SimdVec<S>; 2],
        [xx, xy, yy]: [SimdVec<S>; 3],
    ) -> (Self, [SimdVec<S>; 2]) {
        let one = SimdVec::broadcast(simd, S::Scalar::from_f64(1.0));
        let (r2, [a, b, c]) = (self.radius2, self.conic);
        let (sx, sy) = (xx * gx + xy * gy, xy * gx + yy * gy);
        let widening = (one - r2 * (gx * sx + gy * sy)).reciprocal();
        let shift = r2 * widening;
        let (cxx, cxy, cyy) = (xx + shift * sx * sx, xy + shift * sx * sy, yy + shift * sy * sy);
        let radius2 = r2 * widening;
        let half_size = [(radius2 * cxx).sqrt(), (radius2 * cyy).sqrt()];
        let ellipse = Self {
            mean: [self.mean[0] + shift * sx, self.mean[1] + shift * sy],
            conic: [a - r2 * gx * gx, b - r2 * gx * gy, c - r2 * gy * gy],
            log2_opacity: self.log2_opacity,
            radius2,
            rightmost_dy: cxy * cxx.reciprocal() * half_size[0],
        };
        (ellipse, half_size)
    }
}

impl<T: Real> Footprint<T> {
    /// Adds to `out` the derivatives that follow from the sums `by` over the image's pixels; returns the derivative with
    /// respect to the ellipse's centre, per pixel. A disc has a normal and a slope, and `by_normal` receives the derivatives
    /// with respect to its normal.
    #[inline(always)]
    pub fn backward<const C: usize, K: CameraKernel<T>, P: Primitive>(
        &self,
        camera: &K,
        (position, covariance): ([T; 3], [T; 6]),
        (normal, slope): ([T; 3], [T; 2]),
        by: &GradientSlot<T, C, P>,
        out: &mut SplatGradient<T>,
        by_normal: &mut [T; 3],
    ) -> [T; 2] {
        let m = camera.jacobian(position);
        let ([a, b, c], [sum, x, xx, y, xy, yy]) = (self.conic, by.moments);
        let mut mean = [a * x + b * y, b * x + c * y];
        let [undivided_sum, by_plane, by_plane_x, by_plane_y] = by.slope.get();
        let is_perspective = matches!(K::ORDER, DepthOrder::Camera);
        out.log_opacity = out.log_opacity + if P::IS_FLAT && is_perspective { undivided_sum } else { sum };
        // The derivative with respect to the 2-D covariance is conic * second moments * conic / 2.
        let half = T::from_f64(0.5);
        let p = [[a * xx + b * xy, a * xy + b * yy], [b * xx + c * xy, b * xy + c * yy]];
        let mut gxx = half * (p[0][0] * a + p[0][1] * b);
        let mut gxy = half * (p[0][0] * b + p[0][1] * c);
        let mut gyy = half * (p[1][0] * b + p[1][1] * c);
        if P::IS_FLAT {
            mean = [mean[0] - slope[0] * by_plane, mean[1] - slope[1] * by_plane];
            let image = image_covariance(&m, covariance);
            let by_slope = [by_plane_x, by_plane_y];
            let disc = (position, normal);
            let by = SlopeGradient::new(camera, disc, image, self.radius2, by_slope, &mut out.position);
            gxx = gxx + by.covariance[0];
            gxy = gxy + half * by.covariance[1];
            gyy = gyy + by.covariance[2];
            *by_normal = by.normal;
        }
        for (k, (i, j)) in ELEMENTS.into_iter().enumerate() {
            let [u, v] = [gxx * m[0][j] + gxy * m[1][j], gxy * m[0][j] + gyy * m[1][j]];
            out.covariance[k] = out.covariance[k] + m[0][i] * u + m[1][i] * v;
        }
        // The 2-D covariance is J S Jᵀ; with G the derivative by it, the derivative by J is 2 G J S.
        let mut by_jacobian = [[T::zero(); 3]; 2];
        if K::IS_CURVED {
            let [xx, xy, xz, yy, yz, zz] = covariance;
            let twice = |a: T, b: T| {
                let row: [T; 3] = std::array::from_fn(|k| a * m[0][k] + b * m[1][k]);
                let row = row.map(|v| v + v);
                let dot = |c: [T; 3]| row[0] * c[0] + row[1] * c[1] + row[2] * c[2];
                [dot([xx, xy, xz]), dot([xy, yy, yz]), dot([xz, yz, zz])]
            };
            by_jacobian = [twice(gxx, gxy), twice(gxy, gyy)];
        }
        camera.add_position_gradient(position, mean, by_jacobian, &mut out.position);
        mean
    }

    /// First and last tile column that the ellipse touches within a band's rows, if any; `half_width` is half the ellipse's
    /// width, pixels.
    #[inline(always)]
    pub fn tiles(&self, half_width: T, band: u32, width: usize) -> Option<(u32, u32)> {
        let [mx, my] = self.mean;
        let top = T::from_f64(f64::from(band) * TILE as f64) - my;
        let bottom = top + T::from_f64(TILE as f64 - 1.0);
        let left = mx + self.edge_column(-T::one(), half_width, top, bottom);
        let right = mx + self.edge_column(T::one(), half_width, top, bottom);
        let left = left.max(T::zero()).ceil();
        let right = right.min(T::from_f64(width as f64 - 1.0)).floor();
        (left <= right).then(|| (left.as_u32() / TILE as u32, right.as_u32() / TILE as u32))
    }

    /// Outermost column of the ellipse on the left (`side` = -1) or right (`side` = 1) within the rows `top..=bottom`; all
    /// relative to the centre, pixels.
    #[inline(always)]
    fn edge_column(&self, side: T, half_width: T, top: T, bottom: T) -> T {
        let extreme_dy = side * self.rightmost_dy;
        if extreme_dy >= top && extreme_dy <= bottom {
            return side * half_width;
        }
        let dy = extreme_dy.max(top).min(bottom);
        let [a, b, c] = self.conic;
        let discriminant = b * b * dy * dy - a * (c * dy * dy - self.radius2);
        // Where the ellipse only touches the band, rounding can make the discriminant negative.
        (side * discriminant.max(T::zero()).sqrt() - b * dy) / a
    }
}

/// The covariance (xx, xy, yy) of a splat's image without the low-pass filter, px².
#[inline(always)]
fn image_covariance<T: Real>(jacobian: &[[T; 3]; 2], [xx, xy, xz, yy, yz, zz]: [T; 6]) -> [T; 3] {
    let times =
        |[a, b, c]: [T; 3]| [a * xx + b * xy + c * xz, a * xy + b * yy + c * yz, a * xz + b * yz + c * zz];
    let dot = |a: [T; 3], b: [T; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let [u, v] = *jacobian;
    [dot(times(u), u), dot(times(u), v), dot(times(v), v)]
}
