//! Localisation: from an image position and a height to longitude and latitude, by Newton's method with the exact
//! Jacobian.

use super::Rpc;
use crate::frame::{CenterPx, Geodetic, Pixel, Point};

/// Residual at which the iteration stops, pixels. Rounding of f64 limits it to about 2e-9 px.
const TOLERANCE_PX: f64 = 1e-8;
/// Largest number of Newton steps. An image strip of 135,000 rows needs 4 steps from the centre of the model.
const MAX_STEPS: usize = 20;
/// Largest number of times that a step is halved because it increases the residual.
const MAX_HALVINGS: usize = 8;
/// Largest normalised ground coordinate that a step may reach; the cubic polynomials are meaningless beyond it.
const FARTHEST: f64 = 3.0;

/// No ground point at the given height projects to the given image position.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "no ground point at height {height_m} m is seen at column {col}, row {row} (best is {residual_px} px off)"
)]
pub struct LocalizeError {
    /// Column, pixels.
    pub col: f64,
    /// Row, pixels.
    pub row: f64,
    /// Height above the ellipsoid, metres.
    pub height_m: f64,
    /// Residual of the best point found, pixels.
    pub residual_px: f64,
}

impl Rpc {
    /// The ground point at ellipsoidal height `height_m`, in metres, that projects to the image position `px`.
    ///
    /// # Errors
    /// [`LocalizeError`] if Newton's method does not converge, as happens far outside the validity volume of the RPC.
    pub fn localize(&self, px: Pixel<CenterPx>, height_m: f64) -> Result<Point<Geodetic>, LocalizeError> {
        self.localize_from(px, self.center().at_height(height_m))
    }

    /// As [`Rpc::localize`] at the height of `start`, from the position of `start`, which should be near to the result.
    ///
    /// # Errors
    /// As [`Rpc::localize`].
    pub fn localize_from(
        &self,
        px: Pixel<CenterPx>,
        start: Point<Geodetic>,
    ) -> Result<Point<Geodetic>, LocalizeError> {
        self.newton(px, start, MAX_STEPS)
    }

    fn newton(
        &self,
        px: Pixel<CenterPx>,
        start: Point<Geodetic>,
        max_steps: usize,
    ) -> Result<Point<Geodetic>, LocalizeError> {
        let c = self.coefficients();
        let residual = |q: Pixel<CenterPx>| [px.col - q.col, px.row - q.row];
        let size = |e: [f64; 2]| e[0].abs().max(e[1].abs());
        let clamp = |value: f64, axis: super::Axis| {
            let reach = FARTHEST * axis.scale.abs();
            value.clamp(axis.offset - reach, axis.offset + reach)
        };

        let mut point = start;
        let (seen, mut jac) = self.project_with_jacobian(point);
        let mut error = residual(seen);
        for _ in 0..max_steps {
            if size(error) < TOLERANCE_PX {
                return Ok(point);
            }
            let [[a, b, _], [d, e, _]] = jac;
            let det = a * e - b * d;
            if det.abs() < 1e-12 * (a * a + b * b + d * d + e * e) {
                break;
            }
            let step = [(e * error[0] - b * error[1]) / det, (a * error[1] - d * error[0]) / det];
            let mut length = 1.0;
            let mut better = None;
            for _ in 0..MAX_HALVINGS {
                let q = Point::new(
                    clamp(point.lon_deg() + length * step[0], c.lon),
                    clamp(point.lat_deg() + length * step[1], c.lat),
                    point.height_m(),
                );
                let (seen, j) = self.project_with_jacobian(q);
                let e = residual(seen);
                if size(e) < size(error) {
                    better = Some((q, e, j));
                    break;
                }
                length *= 0.5;
            }
            let Some((q, e, j)) = better else { break };
            (point, error, jac) = (q, e, j);
        }
        // Near the limit of f64 rounding no step improves the residual any more; the point is accepted.
        if size(error) < 100.0 * TOLERANCE_PX {
            return Ok(point);
        }
        Err(LocalizeError {
            col: px.col,
            row: px.row,
            height_m: start.height_m(),
            residual_px: error[0].hypot(error[1]),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::tests::synthetic;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn projection_inverts_localisation(
            col in -100.0..1100.0f64, row in -100.0..1100.0f64, h in 70.0..310.0f64
        ) {
            let rpc = synthetic();
            let px = Pixel::new(col, row);
            let ground = rpc.localize(px, h).unwrap();
            prop_assert!(rpc.project(ground).distance(px) < 1e-7);
            prop_assert_eq!(ground.height_m(), h);
        }
    }

    /// A skewed SkySat frame on which the rpcm library does not converge.
    #[test]
    fn localisation_of_a_skysat_frame_converges_in_five_steps() {
        let name = "rpcm/20191015_073816_ssc1d3_0011_basic_l1a_panchromatic_dn_RPC.TXT";
        let Some(file) = crate::rpc::formats::tests::real_file(name) else { return };
        let rpc = crate::rpc::formats::read(&file).unwrap().rpc;
        for height in [70.0, 90.0] {
            let start = rpc.center().at_height(height);
            let steps = (1..).find(|n| rpc.newton(Pixel::new(0.0, 0.0), start, *n).is_ok()).unwrap();
            assert!(steps <= 5, "{steps} steps at {height} m");
        }
    }

    #[test]
    fn a_pixel_without_ground_is_an_error() {
        assert!(synthetic().localize(Pixel::new(1e9, 0.0), 190.0).is_err());
        assert!(synthetic().localize(Pixel::new(f64::NAN, 0.0), 190.0).is_err());
    }
}
