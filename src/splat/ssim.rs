//! L1 and structural similarity with their gradient, fused and separable.
//!
//! SSIM after Wang et al. 2004 with an 11 × 11 Gaussian window of σ 1.5, zeros beyond the border, as 3DGS uses it.

use super::raster::Layers;
use super::real::Real;
use multiversion::multiversion;
use rayon::prelude::*;

/// Taps of the window.
const TAPS: usize = 11;
const SIGMA: f64 = 1.5;
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;
/// Weight of SSIM against L1 (3DGS, EOGS).
pub const SSIM_WEIGHT: f64 = 0.2;

/// Compares a picture with the truth; keeps its buffers.
#[derive(Default)]
pub struct Photometric<T> {
    blurred: Layers<T>,
    statistics: Layers<T>,
    by_picture: Layers<T>,
}

/// Mean absolute difference and mean SSIM.
#[derive(Clone, Copy, Debug, Default)]
pub struct Similarity {
    /// Mean absolute difference.
    pub l1: f64,
    /// Mean structural similarity.
    pub ssim: f64,
}

impl Similarity {
    /// `0.8 L1 + 0.2 (1 - SSIM)`.
    #[must_use]
    pub fn loss(&self) -> f64 {
        (1.0 - SSIM_WEIGHT) * self.l1 + SSIM_WEIGHT * (1.0 - self.ssim)
    }
}

fn window<T: Real>() -> [T; TAPS] {
    let g = |i: usize| (-((i as f64 - 5.0) / SIGMA).powi(2) / 2.0).exp();
    let sum: f64 = (0..TAPS).map(g).sum();
    std::array::from_fn(|i| T::of(g(i) / sum))
}

/// `out[i] += factor * input[i + shift]`, where that exists.
#[inline(always)]
fn accumulate<T: Real>(out: &mut [T], input: &[T], factor: T) {
    for (o, v) in out.iter_mut().zip(input) {
        *o = *o + factor * *v;
    }
}

#[inline(always)]
fn blur_row_generic<T: Real>(out: &mut [T], input: &[T], window: &[T; TAPS]) {
    let n = out.len();
    out.fill(T::zero());
    for (t, w) in window.iter().enumerate() {
        // Output i takes input i + t - 5.
        let (from_out, from_in) = (5usize.saturating_sub(t), t.saturating_sub(5));
        let count = n.saturating_sub(from_out.max(from_in));
        accumulate(&mut out[from_out..from_out + count], &input[from_in..from_in + count], *w);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn blur_row_f32(out: &mut [f32], input: &[f32], window: &[f32; TAPS]) {
    blur_row_generic(out, input, window);
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn accumulate_f32(out: &mut [f32], input: &[f32], factor: f32) {
    accumulate(out, input, factor);
}

/// Row operations compiled for the processor at hand.
pub trait Rows: Real {
    /// Blurs along a row.
    fn blur_row(out: &mut [Self], input: &[Self], window: &[Self; TAPS]);
    /// Adds a multiple of a row.
    fn add_row(out: &mut [Self], input: &[Self], factor: Self);
}

impl Rows for f32 {
    fn blur_row(out: &mut [Self], input: &[Self], window: &[Self; TAPS]) {
        blur_row_f32(out, input, window);
    }
    fn add_row(out: &mut [Self], input: &[Self], factor: Self) {
        accumulate_f32(out, input, factor);
    }
}

impl Rows for f64 {
    fn blur_row(out: &mut [Self], input: &[Self], window: &[Self; TAPS]) {
        blur_row_generic(out, input, window);
    }
    fn add_row(out: &mut [Self], input: &[Self], factor: Self) {
        accumulate(out, input, factor);
    }
}

/// Blurs column-wise into one row of all channels.
fn blur_column<T: Rows>(image: &Layers<T>, row: usize, window: &[T; TAPS], out: &mut [T]) {
    out.fill(T::zero());
    let stride = image.width * image.channels;
    for (t, w) in window.iter().enumerate() {
        let Some(r) = (row + t).checked_sub(5).filter(|r| *r < image.height) else { continue };
        T::add_row(out, &image.data[r * stride..(r + 1) * stride], *w);
    }
}

impl<T: Rows> Photometric<T> {
    /// Derivatives of the last comparison's loss by the picture.
    #[must_use]
    pub fn by_picture(&self) -> &Layers<T> {
        &self.by_picture
    }

    /// Compares `picture` with `truth` (three channels each); pixels equal in both contribute nothing.
    ///
    /// Returns the figures and the loss's derivatives by the picture.
    pub fn compare(&mut self, picture: &Layers<T>, truth: &Layers<T>) -> (Similarity, &Layers<T>) {
        let (width, height) = (picture.width, picture.height);
        let window = window::<T>();
        let stride = 3 * width;

        // Rows of x, y, xx, yy, xy for each color, blurred along the row.
        self.blurred.resize(width, height, 15);
        self.blurred.data.par_chunks_mut(15 * width).enumerate().for_each_init(
            || vec![T::zero(); width],
            |product, (row, out)| {
                for c in 0..3 {
                    let (x, y) = (picture.row(c, row), truth.row(c, row));
                    let mut planes = out[5 * c * width..5 * (c + 1) * width].chunks_exact_mut(width);
                    let mut blur = |product: &mut [T], a: &[T], b: Option<&[T]>| {
                        if let Some(plane) = planes.next() {
                            match b {
                                None => T::blur_row(plane, a, &window),
                                Some(b) => {
                                    for ((p, a), b) in product.iter_mut().zip(a).zip(b) {
                                        *p = *a * *b;
                                    }
                                    T::blur_row(plane, product, &window);
                                }
                            }
                        }
                    };
                    blur(product, x, None);
                    blur(product, y, None);
                    blur(product, x, Some(x));
                    blur(product, y, Some(y));
                    blur(product, x, Some(y));
                }
            },
        );

        // Down the columns; SSIM and its derivatives by the blurred x, xx and xy, blurred along the row again.
        let scale = T::of(-SSIM_WEIGHT / (3 * width * height) as f64);
        let blurred = &self.blurred;
        self.statistics.resize(width, height, 9);
        let ssim: Vec<f64> = self
            .statistics
            .data
            .par_chunks_mut(9 * width)
            .enumerate()
            .map_init(
                || (vec![T::zero(); 15 * width], vec![T::zero(); 3 * width]),
                |(column, slopes), (row, out)| {
                    blur_column(blurred, row, &window, column);
                    let mut sum = 0.0;
                    for c in 0..3 {
                        let plane = |k: usize| &column[(5 * c + k) * width..(5 * c + k + 1) * width];
                        sum += ssim_row([plane(0), plane(1), plane(2), plane(3), plane(4)], scale, slopes);
                        for k in 0..3 {
                            let target = &mut out[(3 * c + k) * width..(3 * c + k + 1) * width];
                            T::blur_row(target, &slopes[k * width..(k + 1) * width], &window);
                        }
                    }
                    sum
                },
            )
            .collect();

        // Down the columns once more: derivatives by the picture.
        let statistics = &self.statistics;
        let l1_scale = T::of((1.0 - SSIM_WEIGHT) / (3 * width * height) as f64);
        self.by_picture.resize(width, height, 3);
        let l1: Vec<f64> = self
            .by_picture
            .data
            .par_chunks_mut(stride)
            .enumerate()
            .map_init(
                || vec![T::zero(); 9 * width],
                |column, (row, out)| {
                    blur_column(statistics, row, &window, column);
                    let mut sum = T::zero();
                    for c in 0..3 {
                        let (x, y) = (picture.row(c, row), truth.row(c, row));
                        let plane = |k: usize| &column[(3 * c + k) * width..(3 * c + k + 1) * width];
                        let (by_x, by_xx, by_xy) = (plane(0), plane(1), plane(2));
                        let out = &mut out[c * width..(c + 1) * width];
                        for i in 0..width {
                            let d = x[i] - y[i];
                            sum = sum + d.abs();
                            let sign = if d == T::zero() { T::zero() } else { d.signum() };
                            out[i] =
                                by_x[i] + T::of(2.0) * x[i] * by_xx[i] + y[i] * by_xy[i] + l1_scale * sign;
                        }
                    }
                    sum.wide()
                },
            )
            .collect();
        let count = (3 * width * height) as f64;
        let similarity =
            Similarity { l1: l1.iter().sum::<f64>() / count, ssim: ssim.iter().sum::<f64>() / count };
        (similarity, &self.by_picture)
    }
}

/// Sum of SSIM over a row; writes `scale` times its derivatives by the means of x, xx and xy.
fn ssim_row<T: Real>([mx, my, xx, yy, xy]: [&[T]; 5], scale: T, slopes: &mut [T]) -> f64 {
    let n = mx.len();
    let (c1, c2, two) = (T::of(C1), T::of(C2), T::of(2.0));
    let (by_x, rest) = slopes.split_at_mut(n);
    let (by_xx, by_xy) = rest.split_at_mut(n);
    let mut sum = T::zero();
    for i in 0..n {
        let (ux, uy) = (mx[i], my[i]);
        let a1 = two * ux * uy + c1;
        let a2 = two * (xy[i] - ux * uy) + c2;
        let b1 = ux * ux + uy * uy + c1;
        let b2 = (xx[i] - ux * ux) + (yy[i] - uy * uy) + c2;
        let inverse = T::one() / (b1 * b2);
        let value = a1 * a2 * inverse;
        sum = sum + value;
        by_x[i] = scale * (two * uy * (a2 - a1) * inverse - two * ux * value * (b2 - b1) * inverse);
        by_xx[i] = -scale * value / b2;
        by_xy[i] = scale * two * a1 * inverse;
    }
    sum.wide()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::random::Draw;

    fn pictures(width: usize, height: usize) -> (Layers<f64>, Layers<f64>) {
        let mut draw = Draw::new(3, 0, 0, 0);
        let mut make = || {
            let mut l = Layers::zeros(width, height, 3);
            l.data.iter_mut().for_each(|v| *v = draw.uniform());
            l
        };
        (make(), make())
    }

    #[test]
    fn equal_pictures_have_no_loss_and_no_gradient() {
        let (x, _) = pictures(20, 13);
        let mut p = Photometric::default();
        let (s, g) = p.compare(&x, &x.clone());
        assert!(s.loss().abs() < 1e-12);
        assert!(g.data.iter().all(|v| v.abs() < 1e-12));
    }

    #[test]
    fn gradient_agrees_with_central_differences() {
        let (x, y) = pictures(17, 14);
        let gradient = Photometric::default().compare(&x, &y).1.clone();
        for k in (0..x.data.len()).step_by(7) {
            let e = 1e-6;
            let at = |d: f64| {
                let mut moved = x.clone();
                moved.data[k] += d;
                Photometric::default().compare(&moved, &y).0.loss()
            };
            let numeric = (at(e) - at(-e)) / (2.0 * e);
            assert!((numeric - gradient.data[k]).abs() < 1e-9, "{k}: {numeric} {}", gradient.data[k]);
        }
    }
}
