//! How far two cameras of one image differ.

use super::{Axis, GroundBatch, PixelBatch, Rpc};

/// Nodes along columns, rows and heights at which cameras are compared.
const NODES: usize = 21;

/// Distances in the image between where two cameras see the same ground, pixels.
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// Root of the mean squared distance.
    pub rms_px: f64,
    /// Largest distance.
    pub max_px: f64,
    /// Mean of the second camera's column and row minus the first's.
    pub mean_px: [f64; 2],
    /// Places compared.
    pub places: usize,
}

impl Rpc {
    /// The difference of another camera over the image and heights that this one is made for; none where this one sees
    /// no ground in its own volume, or the other none of that.
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

    /// Pixels over the image and heights, and the ground seen there.
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
    fn a_shifted_camera_differs_by_its_shift() {
        let d = test_camera().difference(&test_camera().shifted(3.0, -4.0)).unwrap();
        assert!((d.rms_px - 5.0).abs() < 1e-6 && (d.max_px - 5.0).abs() < 1e-6, "{d:?}");
        assert!((d.mean_px[0] - 3.0).abs() < 1e-6 && (d.mean_px[1] + 4.0).abs() < 1e-6, "{d:?}");
        assert_eq!(d.places, 21 * 21 * 21);
    }
}
