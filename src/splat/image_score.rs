//! PSNR and SSIM of a rendered picture against the image of a view that was not trained on.
//!
//! Such a view has no trained colour model. As in the papers, an affine map of colours is fitted on the left half of the
//! image, and the right half is scored.

use crate::io::Grid2;
use crate::splat::loss::photometric::Photometric;
use crate::splat::loss::target::TargetImage;
use crate::splat::raster::Image;
use nalgebra::{Matrix4, Vector4};
use serde::Serialize;

/// Similarity of a picture to an image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PictureScore {
    /// Peak signal-to-noise ratio, dB, of linear colours in [0, 1].
    pub psnr_db: f64,
    /// Mean structural similarity (11 x 11 Gaussian window of σ = 1.5 px).
    pub ssim: f64,
    /// Number of scored pixels.
    pub pixels: usize,
}

/// Scores a picture (red, green, blue; linear) against an image of the same size; none if a half of the image has too few
/// valid pixels.
#[must_use]
pub fn score_picture(colors: &[Grid2; 3], target: &TargetImage) -> Option<PictureScore> {
    let (width, height) = (target.colors.width, target.colors.height);
    let half = width / 2;
    let color = |col: usize, row: usize| colors.each_ref().map(|c| f64::from(c.at(col, row)));
    let is_valid = |col: usize, row: usize| target.valid[row * width + col];

    let mut normal = Matrix4::zeros();
    let mut right = [Vector4::zeros(); 3];
    for (col, row) in
        (0..height).flat_map(|r| (0..half).map(move |c| (c, r))).filter(|(c, r)| is_valid(*c, *r))
    {
        let [r, g, b] = color(col, row);
        let unknowns = Vector4::new(r, g, b, 1.0);
        normal += unknowns * unknowns.transpose();
        for (k, sum) in right.iter_mut().enumerate() {
            *sum += unknowns * f64::from(target.colors.at(k, col, row));
        }
    }
    let factor = normal.cholesky()?;
    let color_map = right.map(|b| factor.solve(&b));

    let mut picture = Image::<f32>::zeros(width - half, height, 3);
    let mut image = Image::<f32>::zeros(width - half, height, 3);
    let (mut squares, mut pixels) = (0.0, 0);
    for (col, row) in
        (0..height).flat_map(|r| (half..width).map(move |c| (c, r))).filter(|(c, r)| is_valid(*c, *r))
    {
        let [r, g, b] = color(col, row);
        pixels += 1;
        for (k, map_row) in color_map.iter().enumerate() {
            let expected = target.colors.at(k, col, row);
            let found = map_row.dot(&Vector4::new(r, g, b, 1.0)).clamp(0.0, 1.0) as f32;
            squares += f64::from(found - expected).powi(2);
            *picture.at_mut(k, col - half, row) = found;
            *image.at_mut(k, col - half, row) = expected;
        }
    }
    if pixels == 0 {
        return None;
    }
    let (similarity, _) = Photometric::default().compare(&picture, &image);
    // Invalid pixels are zero in both images, and there SSIM is 1.
    let all = ((width - half) * height) as f64;
    let invalid = all - pixels as f64;
    let ssim = (similarity.ssim * all - invalid) / pixels as f64;
    Some(PictureScore { psnr_db: -10.0 * (squares / (3 * pixels) as f64).log10(), ssim, pixels })
}

/// Scores a picture against a photograph of the same size, both as displayed, 0 to 1: all pixels that have data, without a
/// change of colours (3DGS). None if no pixel has data.
#[must_use]
pub fn score_photograph(colors: &[Grid2; 3], truth: &[Grid2; 3]) -> Option<PictureScore> {
    let (width, height) = (truth[0].width, truth[0].height);
    let mut picture = Image::<f32>::zeros(width, height, 3);
    let mut image = Image::<f32>::zeros(width, height, 3);
    let (mut squares, mut pixels) = (0.0, 0);
    for (col, row) in (0..height).flat_map(|r| (0..width).map(move |c| (c, r))) {
        let expected = truth.each_ref().map(|plane| plane.at(col, row));
        if expected.iter().any(|v| v.is_nan()) {
            continue;
        }
        pixels += 1;
        for (k, (found, expected)) in colors.iter().map(|c| c.at(col, row)).zip(expected).enumerate() {
            squares += f64::from(found - expected).powi(2);
            *picture.at_mut(k, col, row) = found;
            *image.at_mut(k, col, row) = expected;
        }
    }
    (pixels > 0).then(|| {
        let (similarity, _) = Photometric::default().compare(&picture, &image);
        // Pixels without data are zero in both images, and there SSIM is 1.
        let all = (width * height) as f64;
        let ssim = (similarity.ssim * all - (all - pixels as f64)) / pixels as f64;
        PictureScore { psnr_db: -10.0 * (squares / (3 * pixels) as f64).log10(), ssim, pixels }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(col: usize, row: usize, k: usize) -> f32 {
        0.5 + 0.3 * ((col as f32 * 0.7 + k as f32).sin() * (row as f32 * 0.4).cos())
    }

    fn target(of: impl Fn(usize, usize, usize) -> f32) -> TargetImage {
        let mut colors = Image::zeros(80, 60, 3);
        for (col, row, k) in (0..80 * 60 * 3).map(|i| (i % 80, i / 80 % 60, i / 4800)) {
            *colors.at_mut(k, col, row) = of(col, row, k);
        }
        TargetImage { colors, valid: vec![true; 80 * 60] }
    }

    #[test]
    fn an_affine_change_of_colours_costs_nothing_and_noise_has_the_expected_psnr() {
        let picture: [Grid2; 3] = std::array::from_fn(|k| Grid2::from_fn(80, 60, |c, r| texture(c, r, k)));
        let dimmed = target(|c, r, k| 0.1 + 0.6 * texture(c, r, k));
        let score = score_picture(&picture, &dimmed).unwrap();
        assert!(score.psnr_db > 90.0 && score.ssim > 0.9999, "{score:?}");
        assert_eq!(score.pixels, 40 * 60);
        let sign = |c: usize, r: usize| if (c * 7 + r * 13).is_multiple_of(2) { 1.0 } else { -1.0 };
        let noisy = target(|c, r, k| texture(c, r, k) + 0.05 * sign(c, r));
        let score = score_picture(&picture, &noisy).unwrap();
        assert!((score.psnr_db - 26.02).abs() < 0.1 && score.ssim < 0.97, "{score:?}");
    }

    #[test]
    fn invalid_pixels_are_not_scored() {
        let picture: [Grid2; 3] = std::array::from_fn(|k| Grid2::from_fn(80, 60, |c, r| texture(c, r, k)));
        let mut masked = target(texture);
        for i in (0..80 * 60).filter(|i| i % 80 > 60) {
            masked.valid[i] = false;
            (0..3).for_each(|k| *masked.colors.at_mut(k, i % 80, i / 80) = 0.0);
        }
        let score = score_picture(&picture, &masked).unwrap();
        assert!(score.psnr_db > 90.0 && score.ssim > 0.99 && score.pixels == 21 * 60, "{score:?}");
    }
}
