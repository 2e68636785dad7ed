//! The shift at the peak of the phase correlation, which also finds shifts that are large compared with the objects in the
//! raster.

use crate::io::Grid2;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;
use std::f64::consts::TAU;

/// Grids are halved while their longer side exceeds this number of cells, and padded to a square of twice that side.
const LONGEST: usize = 256;

/// (dx, dy) in cells for which `prediction[row + dy, col + dx]` matches `truth[row, col]` best, with the resolution of the
/// halved grids; `None` for a raster without relief.
pub(super) fn peak(prediction: &Grid2, truth: &Grid2) -> Option<(f64, f64)> {
    let (mut a, mut b, mut factor) = (prediction.clone(), truth.clone(), 1.0);
    while a.width.max(a.height) > LONGEST {
        (a, b) = (a.halved(), b.halved());
        factor *= 2.0;
    }
    let size = (2 * a.width.max(a.height).max(b.width).max(b.height)).next_power_of_two();
    let (a, b) = (spectrum(&a, size)?, spectrum(&b, size)?);
    // The transform of the conjugate is the inverse transform, apart from a factor and the sign of the imaginary part.
    let white = |(a, b): (&Complex<f64>, &Complex<f64>)| {
        let cross = a.conj() * b;
        cross / cross.norm().max(f64::MIN_POSITIVE)
    };
    let mut cross: Vec<Complex<f64>> = a.iter().zip(&b).map(white).collect();
    transform(&mut cross, size);
    let best = (0..cross.len()).max_by(|i, j| cross[*i].re.total_cmp(&cross[*j].re))?;
    let signed = |i: usize| if i > size / 2 { i as f64 - size as f64 } else { i as f64 };
    Some((signed(best % size) * factor, signed(best / size) * factor))
}

/// Two-dimensional spectrum of the heights minus their mean; holes have the mean. `None` for a raster without relief.
fn spectrum(raster: &Grid2, size: usize) -> Option<Vec<Complex<f64>>> {
    let (sum, n) = raster.valid().fold((0.0, 0.0), |(s, n), v| (s + f64::from(v), n + 1.0));
    let mean = sum / n;
    let mut out = vec![Complex::default(); size * size];
    for row in 0..raster.height {
        for (col, v) in raster.row(row).iter().enumerate().filter(|(_, v)| !v.is_nan()) {
            // A window function removes the edges of the raster, which would otherwise dominate the correlation.
            let fade = |i: usize, n: usize| 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / n as f64).cos();
            out[row * size + col].re =
                (f64::from(*v) - mean) * fade(col, raster.width) * fade(row, raster.height);
        }
    }
    let has_relief = out.iter().any(|v| v.re != 0.0);
    transform(&mut out, size);
    has_relief.then_some(out)
}

/// The two-dimensional Fourier transform of a square, in place: rows, then columns.
fn transform(data: &mut [Complex<f64>], size: usize) {
    let rows = FftPlanner::new().plan_fft_forward(size);
    for _ in 0..2 {
        rows.process(data);
        for i in 0..size {
            for j in i + 1..size {
                data.swap(i * size + j, j * size + i);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shift_of_a_sixth_of_the_grid_is_found() {
        let height = |c: i64, r: i64| {
            let (i, j) = (c.div_euclid(13), r.div_euclid(11));
            ((i * 7 + j * 5 + i * j * 3).rem_euclid(11) * 3) as f32
        };
        let truth = Grid2::from_fn(240, 200, |c, r| height(c as i64, r as i64));
        let prediction = Grid2::from_fn(240, 200, |c, r| height(c as i64 - 38, r as i64 + 21));
        assert_eq!(peak(&prediction, &truth), Some((38.0, -21.0)));
        assert_eq!(peak(&Grid2::filled(50, 50, 3.0), &truth), None);
    }
}
