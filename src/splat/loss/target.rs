//! The image that a view's picture is compared with, at one resolution.

use crate::affine::{TrainingView, ViewCamera};
use crate::splat::raster::Image;
use rayon::prelude::*;

/// Coarsest resolution level: each pixel is the mean of 16 x 16 pixels of the view.
pub const COARSEST_LEVEL: usize = 4;

/// The image that a view's picture is compared with, at one resolution.
#[derive(Clone, Debug, Default)]
pub struct TargetImage {
    /// Linear colours in [0, 1], three channels; zero where masked.
    pub colors: Image<f32>,
    /// Which pixels are valid, row by row.
    pub valid: Vec<bool>,
}

impl TargetImage {
    /// Loads a view's image at a resolution level (0 full, 1 half, up to [`COARSEST_LEVEL`]) and returns the view's camera for
    /// that resolution. A pixel is the mean of the linear values of the valid pixels that it covers.
    pub fn load(&mut self, view: &TrainingView, level: usize) -> ViewCamera {
        let side = 1 << level;
        let (camera, (width, height)) = camera_at(view, level);
        self.colors.resize(width, height, 3);
        self.valid.resize(width * height, false);
        let rows = self.colors.data.par_chunks_mut(3 * width).zip(self.valid.par_chunks_mut(width));
        rows.enumerate().for_each(|(row, (colors, valid))| {
            let (red, rest) = colors.split_at_mut(width);
            let (green, blue) = rest.split_at_mut(width);
            for col in 0..width {
                let mean = view.block_mean(col * side, row * side, side);
                valid[col] = mean.is_some();
                [red[col], green[col], blue[col]] = mean.unwrap_or_default();
            }
        });
        camera
    }
}

/// The camera of a view at a resolution level, and its columns and rows there.
#[must_use]
pub fn camera_at(view: &TrainingView, level: usize) -> (ViewCamera, (usize, usize)) {
    let side = 1 << level;
    let camera = if level == 0 { view.camera } else { view.camera.rescaled(1.0 / f64::from(side)) };
    (camera, (view.width >> level, view.height >> level))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Grid2;
    use crate::scene::TransferFunction;

    #[test]
    fn black_pixels_are_valid_and_unknown_or_outside_ones_are_not() {
        let plane = Grid2::from_fn(4, 2, |col, row| match (col, row) {
            (0, 0) => 0.0,
            (1, 0) => f32::NAN,
            (_, row) => 0.2 + 0.4 * row as f32,
        });
        // A pixel is 1 m wide; the last column lies outside the area.
        let camera = ViewCamera::affine([[1.0, 0.0, 0.3], [0.0, -1.0, 0.1]], [0.0; 2]);
        let view = TrainingView::new("v".into(), camera, None, &[plane], (-0.5, -5.0, 2.5, 5.0), (0.0, 0.0));
        let mut target = TargetImage::default();
        assert_eq!(target.load(&view, 0), camera);
        assert_eq!(target.valid, [true, false, true, false, true, true, true, false]);
        let near = |row: &[f32], expected: &[f32]| {
            row.len() == expected.len() && row.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6)
        };
        assert!(near(target.colors.row(0, 0), &[0.0, 0.0, 0.2, 0.0]));
        assert_eq!(target.load(&view, 1), camera.rescaled(0.5));
        assert_eq!((target.colors.width, target.colors.height, target.valid.len()), (2, 1, 2));
        // The means are over three and over two valid pixels.
        assert!(near(target.colors.row(0, 0), &[0.4, 0.4]));
    }

    #[test]
    fn pixels_are_averaged_in_linear_values() {
        let transfer_function = TransferFunction::new(2.0).unwrap();
        let plane = Grid2::from_fn(2, 2, |col, _| if col == 0 { 0.2 } else { 1.0 });
        let camera = ViewCamera::affine([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], [0.0; 2]);
        let view = TrainingView::new("v".into(), camera, None, &[plane], (-5.0, -5.0, 5.0, 5.0), (0.0, 0.0))
            .with_transfer_function(transfer_function);
        let mut target = TargetImage::default();
        let _ = target.load(&view, 0);
        let (dark, white) = (transfer_function.linear(0.2), transfer_function.linear(1.0));
        assert_eq!(target.colors.row(1, 0), [dark, white]);
        let _ = target.load(&view, 1);
        assert!((target.colors.at(0, 0, 0) - 0.5 * (dark + white)).abs() < 1e-6);
        assert!((view.sqrt_gray().at(1, 1) - 1.0).abs() < 1e-6);
        assert!((view.sqrt_gray().at(0, 0) - dark.sqrt()).abs() < 1e-6);
    }
}
