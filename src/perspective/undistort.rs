//! Removal of lens distortion from images, together with downsampling.

use super::lens::LensCamera;
use crate::io::Grid2;
use glam::DVec2;
use rayon::prelude::*;

/// Positions in the image of a lens of the pixels of the pinhole image with the same focal lengths and principal point,
/// downsampled by a whole number.
pub(super) struct Undistortion<'a> {
    lens: &'a LensCamera,
    monotone_radius: f64,
    factor: usize,
}

impl<'a> Undistortion<'a> {
    /// The removal of the distortion of a lens, with averages over squares of `factor` pixels.
    pub(super) fn new(lens: &'a LensCamera, factor: u32) -> Self {
        Self { lens, monotone_radius: lens.monotone_radius(), factor: factor.max(1) as usize }
    }

    /// Columns and rows of the result. Pixels that do not fill a square are left out.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.lens.size.0 / self.factor, self.lens.size.1 / self.factor)
    }

    /// Position in the lens's image of a pixel of the undistorted one; none where the lens shows nothing.
    fn source(&self, col: usize, row: usize) -> Option<DVec2> {
        let px = DVec2::new(col as f64, row as f64);
        if self.lens.model.is_pinhole() {
            return Some(px);
        }
        let p = (px - self.lens.principal) / self.lens.focal;
        (p.length() <= self.monotone_radius)
            .then(|| self.lens.distorted(p) * self.lens.focal + self.lens.principal)
    }

    /// The undistorted, averaged planes of an image, sampled bilinearly. NaN where a pixel of the square is outside of
    /// the image or has no data.
    pub(super) fn colors<const N: usize>(&self, planes: &[Grid2; N]) -> [Grid2; N] {
        let (width, height) = self.size();
        let n = self.factor;
        let rows: Vec<Vec<[f32; N]>> = (0..height)
            .into_par_iter()
            .map(|row| {
                let mean = |col: usize| {
                    let mut sum = [0.0f32; N];
                    for (dr, dc) in (0..n).flat_map(|dr| (0..n).map(move |dc| (dr, dc))) {
                        let Some(at) = self.source(col * n + dc, row * n + dr) else { return [f32::NAN; N] };
                        for (sum, plane) in sum.iter_mut().zip(planes) {
                            *sum += plane.bilinear(at.x, at.y);
                        }
                    }
                    sum.map(|s| s / (n * n) as f32)
                };
                (0..width).map(mean).collect()
            })
            .collect();
        std::array::from_fn(|k| Grid2 {
            width,
            height,
            data: rows.iter().flat_map(|row| row.iter().map(move |c| c[k])).collect(),
        })
    }

    /// The undistorted values of a plane that must not be mixed, such as depths: the nearest value to each pixel, and of
    /// a square the lower median of its values; NaN where less than half of the square has data.
    pub(super) fn nearest(&self, plane: &Grid2) -> Grid2 {
        let (width, height) = self.size();
        let n = self.factor;
        Grid2::from_rows(width, height, |row, line| {
            let mut values = Vec::with_capacity(n * n);
            for (col, out) in line.iter_mut().enumerate() {
                values.clear();
                for (dr, dc) in (0..n).flat_map(|dr| (0..n).map(move |dc| (dr, dc))) {
                    let at = self.source(col * n + dc, row * n + dr);
                    let value = at.map_or(f32::NAN, |at| plane.get(at.x.round() as i64, at.y.round() as i64));
                    values.extend(Some(value).filter(|v| !v.is_nan()));
                }
                values.sort_by(f32::total_cmp);
                *out = f32::NAN;
                if 2 * values.len() >= n * n
                    && let Some(median) = values.get(values.len().saturating_sub(1) / 2)
                {
                    *out = *median;
                }
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::lens::LensModel;
    use super::*;

    /// A phone's lens.
    fn lens() -> LensCamera {
        let parameters = [80.0, 80.0, 50.0, 40.0, 0.02, -0.05, 0.0006, -0.0004];
        LensCamera::from_colmap(LensModel::OpenCv, &parameters, (100, 80)).unwrap()
    }

    /// What the lens shows of a scene in which the pinhole camera would see its own column numbers.
    fn columns(lens: &LensCamera) -> Grid2 {
        Grid2::from_fn(lens.size.0, lens.size.1, |col, row| {
            let q = (DVec2::new(col as f64, row as f64) - lens.principal) / lens.focal;
            (lens.undistorted(q).unwrap().x * lens.focal.x + lens.principal.x) as f32
        })
    }

    #[test]
    fn undistortion_restores_straight_lines() {
        let lens = lens();
        let seen = columns(&lens);
        let [straight, ..] = Undistortion::new(&lens, 1).colors(&[seen.clone(), seen.clone(), seen.clone()]);
        let nearest = Undistortion::new(&lens, 1).nearest(&seen);
        for (col, row) in [(10, 10), (50, 40), (88, 70)] {
            assert!((straight.at(col, row) - col as f32).abs() < 0.01, "{}", straight.at(col, row));
            assert!((nearest.at(col, row) - col as f32).abs() < 0.6, "{}", nearest.at(col, row));
        }
        assert!(
            straight.data.iter().any(|v| v.is_nan()),
            "the lens shows less than the pinhole camera in the corners"
        );
    }

    #[test]
    fn a_downsampled_pixel_is_the_mean_of_its_square() {
        let lens = lens();
        let seen = columns(&lens);
        let [quarter, ..] = Undistortion::new(&lens, 4).colors(&[seen.clone(), seen.clone(), seen]);
        assert_eq!((quarter.width, quarter.height), (25, 20));
        // Columns 40 to 43 have the mean 41.5.
        assert!((quarter.at(10, 10) - 41.5).abs() < 0.01, "{}", quarter.at(10, 10));
    }

    #[test]
    fn depths_are_not_mixed_and_gaps_stay() {
        let lens = LensCamera::pinhole(DVec2::splat(10.0), DVec2::splat(1.5), (4, 4));
        let depth = Grid2::from_fn(4, 4, |col, row| match (col, row) {
            (0 | 1, 0) => f32::NAN,
            (0, 1) => 2.0,
            (1, 1) => 9.0,
            (2, 0) | (2 | 3, 1) => f32::NAN,
            _ => 5.0,
        });
        let half = Undistortion::new(&lens, 2).nearest(&depth);
        assert_eq!((half.at(0, 0), half.at(0, 1), half.at(1, 1)), (2.0, 5.0, 5.0));
        assert!(half.at(1, 0).is_nan());
    }
}
