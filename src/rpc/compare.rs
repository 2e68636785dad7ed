//! Comparison of two RPCs of the same image.

use super::{Axis, GroundBatch, PixelBatch, Rpc};

/// Nodes along columns, rows and heights at which cameras are compared.
const NODES: usize = 21;

/// Differences between the projections of the same ground points by two cameras, pixels.
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// Root mean square of the distances.
    pub rms_px: f64,
    /// Largest distance.
    pub max_px: f64,
    /// Mean of (column, row) of the second camera minus that of the first.
    pub mean_px: [f64; 2],
    /// Number of compared points.
    pub places: usize,
}

impl Rpc {
    /// The difference of `other` from this camera over this camera's validity volume.
    ///
    /// `None` if this camera cannot localise any pixel of its volume, or `other` projects none of the ground points.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Option<Difference> {
        let (own, ground) = self.volume();
        let mut seen = PixelBatch::default();
        other.project_batch(&ground, &mut seen);
        let (mut places, mut squares, mut max_px, mut sums) = (0, 0.0, 0.0f64, [0.0; 2]);
        for i in 0..seen.col.len() {
            let d = [seen.col[i] - own.col[i], seen.row[i] - own.row[i]];
            let square = d[0] * d[0] + d[1] * d[1];
            if square.is_finite() {
                places += 1;
                squares += square;
                max_px = max_px.max(square.sqrt());
                sums = [sums[0] + d[0], sums[1] + d[1]];
            }
        }
        let n = places as f64;
        let rms_px = (squares / n).sqrt();
        (places > 0).then(|| Difference { rms_px, max_px, mean_px: sums.map(|s| s / n), places })
    }

    /// A grid of pixels and heights over the validity volume, and their ground points.
    fn volume(&self) -> (PixelBatch, GroundBatch) {
        let c = self.coefficients();
        let node = |i: usize| 2.0 * (i % NODES) as f64 / (NODES - 1) as f64 - 1.0;
        let axis = |a: Axis, every: usize| -> Vec<f64> {
            (0..NODES.pow(3)).map(|i| a.offset + a.scale * node(i / every)).collect()
        };
        let pixels = PixelBatch { col: axis(c.col, 1), row: axis(c.row, NODES) };
        let mut ground = GroundBatch::default();
        self.localize_batch(&pixels, &axis(c.height, NODES * NODES), &mut ground);
        (pixels, ground)
    }
}

#[cfg(test)]
mod tests {
    use crate::rpc::test_camera;

    #[test]
    fn the_difference_of_a_shifted_camera_is_the_shift() {
        let d = test_camera().difference(&test_camera().shifted(3.0, -4.0)).unwrap();
        assert!((d.rms_px - 5.0).abs() < 1e-6 && (d.max_px - 5.0).abs() < 1e-6, "{d:?}");
        assert!((d.mean_px[0] - 3.0).abs() < 1e-6 && (d.mean_px[1] + 4.0).abs() < 1e-6, "{d:?}");
        assert_eq!(d.places, 21 * 21 * 21);
    }
}
