//! Projection and localisation of many points at once with SIMD instructions.
//!
//! Localisation starts from cubic polynomials that approximate the ground position as a function of column, row and
//! height over the bounding box of the batch. Steps with one fixed Jacobian follow until the exact model projects every
//! point to within 1e-8 px of its pixel. Points that do not converge are localised one by one by Newton's method.

use super::Rpc;
use super::kernel::{KernelModel, Localize, Project, StartPolynomials};
use super::model::{TERMS, monomials};
use crate::frame::{Pixel, Point, wrap_longitude_deg};
use nalgebra::{DMatrix, Matrix2};

/// Nodes along each axis of the batch's bounding box to which the initial polynomials are fitted; one more than a cubic
/// needs.
const NODES: usize = 5;
/// Below this number of points, fitting the initial polynomials takes longer than it saves.
const SMALLEST_FITTED_BATCH: usize = 1000;

/// Ground points as three arrays of the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroundBatch {
    /// WGS 84 longitudes, degrees, between -360 and 360.
    pub lon_deg: Vec<f64>,
    /// WGS 84 latitudes, degrees.
    pub lat_deg: Vec<f64>,
    /// Heights above the WGS 84 ellipsoid, metres.
    pub height_m: Vec<f64>,
}

/// Image positions as two arrays of the same length; (0, 0) is the centre of the first pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PixelBatch {
    /// Columns, pixels.
    pub col: Vec<f64>,
    /// Rows, pixels.
    pub row: Vec<f64>,
}

impl Rpc {
    /// Projects ground points; writes their image positions to `out`, which is resized.
    ///
    /// # Panics
    /// Panics if the arrays of `ground` differ in length.
    pub fn project_batch(&self, ground: &GroundBatch, out: &mut PixelBatch) {
        let n = ground.lon_deg.len();
        assert!(ground.lat_deg.len() == n && ground.height_m.len() == n, "arrays of the same length");
        out.col.resize(n, 0.0);
        out.row.resize(n, 0.0);
        pulp::Arch::new().dispatch(Project {
            model: &self.kernel_model(wrap_longitude_deg(self.center().lon_deg())),
            lon: &ground.lon_deg,
            lat: &ground.lat_deg,
            height: &ground.height_m,
            col: &mut out.col,
            row: &mut out.row,
        });
    }

    /// Localises image positions at given ellipsoidal heights in metres; writes the ground points to `out`, which is
    /// resized.
    ///
    /// Each ground point projects to within 1e-8 px of its image position, or to within 1e-6 px where rounding allows
    /// no better. Image positions to which no ground point projects give NaN.
    ///
    /// # Panics
    /// Panics if the arrays differ in length.
    pub fn localize_batch(&self, pixels: &PixelBatch, height_m: &[f64], out: &mut GroundBatch) {
        let n = height_m.len();
        assert!(pixels.col.len() == n && pixels.row.len() == n, "arrays of the same length");
        out.lon_deg.clear();
        out.lon_deg.resize(n, f64::NAN);
        out.lat_deg.clear();
        out.lat_deg.resize(n, f64::NAN);
        out.height_m.clear();
        out.height_m.extend_from_slice(height_m);
        let start = (n >= SMALLEST_FITTED_BATCH).then(|| self.start_polynomials(pixels, height_m)).flatten();
        if let Some(start) = start {
            pulp::Arch::new().dispatch(Localize {
                model: &self.kernel_model(self.center().lon_deg()),
                start: &start,
                col: &pixels.col,
                row: &pixels.row,
                height: height_m,
                lon: &mut out.lon_deg,
                lat: &mut out.lat_deg,
            });
        }
        for i in 0..n {
            if out.lon_deg[i].is_nan()
                && let Ok(p) = self.localize(Pixel::new(pixels.col[i], pixels.row[i]), height_m[i])
            {
                (out.lon_deg[i], out.lat_deg[i]) = (p.lon_deg(), p.lat_deg());
            }
        }
    }

    /// The coefficients with the longitude offset replaced by `lon`, which differs from it by whole turns.
    fn kernel_model(&self, lon: f64) -> KernelModel {
        let c = self.coefficients();
        KernelModel {
            terms: [c.col_num, c.col_den, c.row_num, c.row_den],
            ground_offset: [lon, c.lat.offset, c.height.offset],
            ground_scale: [c.lon.scale, c.lat.scale, c.height.scale],
            image_offset: [c.col.offset, c.row.offset],
            image_scale: [c.col.scale, c.row.scale],
        }
    }

    /// Polynomials from pixel and height to ground, fitted over the bounding box of the points; `None` where some node of
    /// that box cannot be localised.
    fn start_polynomials(&self, pixels: &PixelBatch, height_m: &[f64]) -> Option<StartPolynomials> {
        let boxes = [&pixels.col[..], &pixels.row[..], height_m].map(|values| {
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            (low, high)
        });
        if !boxes.iter().all(|(low, high)| low.is_finite() && high.is_finite()) {
            return None;
        }
        let offset = boxes.map(|(low, high)| 0.5 * (low + high));
        // A bounding box without extent is widened to one pixel or one metre, so that the fit has a slope.
        let scale = boxes.map(|(low, high)| (0.5 * (high - low)).max(1.0));
        let c = self.coefficients();
        let chebyshev = |i: usize| (std::f64::consts::PI * (i as f64 + 0.5) / NODES as f64).cos();
        let count = NODES.pow(3);
        let mut design = DMatrix::zeros(count, TERMS);
        let mut ground = DMatrix::zeros(count, 2);
        for i in 0..count {
            let node = [chebyshev(i % NODES), chebyshev(i / NODES % NODES), chebyshev(i / NODES.pow(2))];
            let at: [f64; 3] = std::array::from_fn(|k| offset[k] + scale[k] * node[k]);
            let p = self.localize(Pixel::new(at[0], at[1]), at[2]).ok()?;
            ground[(i, 0)] = (p.lon_deg() - c.lon.offset) / c.lon.scale;
            ground[(i, 1)] = (p.lat_deg() - c.lat.offset) / c.lat.scale;
            for (k, m) in monomials(node).into_iter().enumerate() {
                design[(i, k)] = m;
            }
        }
        let qr = design.qr();
        qr.q_tr_mul(&mut ground);
        let terms = qr.r().solve_upper_triangular(&ground.rows(0, TERMS))?;
        let column = |j: usize| std::array::from_fn(|k| terms[(k, j)]);
        let middle = Point::new(
            c.lon.offset + c.lon.scale * terms[(0, 0)],
            c.lat.offset + c.lat.scale * terms[(0, 1)],
            offset[2],
        );
        let (_, [[a, b, _], [d, e, _]]) = self.project_with_jacobian(middle);
        let (x, y) = (c.lon.scale, c.lat.scale);
        let inverse = Matrix2::new(a * x, b * y, d * x, e * y).try_inverse()?;
        Some(StartPolynomials {
            terms: [column(0), column(1)],
            offset,
            scale,
            inverse: [[inverse[(0, 0)], inverse[(0, 1)]], [inverse[(1, 0)], inverse[(1, 1)]]],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rpc::test_camera;

    /// Pixels spread over an image larger than the model's volume, and heights over twice its height range.
    fn spread(n: usize) -> (PixelBatch, Vec<f64>) {
        let place = |i: usize, step: f64| (i as f64 * step).fract();
        let col = (0..n).map(|i| 1200.0 * place(i, 0.618_034) - 100.0).collect();
        let row = (0..n).map(|i| 1200.0 * place(i, 0.754_878) - 100.0).collect();
        let height = (0..n).map(|i| 70.0 + 240.0 * place(i, 0.569_840)).collect();
        (PixelBatch { col, row }, height)
    }

    #[test]
    fn batch_projection_agrees_with_single_points() {
        let rpc = test_camera();
        for n in [0, 1, 3, 4, 7, 500] {
            let place = |i: usize, step: f64| (i as f64 * step).fract() - 0.5;
            let ground = GroundBatch {
                lon_deg: (0..n).map(|i| 5.44 + 0.007 * place(i, 0.618)).collect(),
                lat_deg: (0..n).map(|i| 43.26 + 0.005 * place(i, 0.755)).collect(),
                height_m: (0..n).map(|i| 190.0 + 240.0 * place(i, 0.570)).collect(),
            };
            let mut out = PixelBatch::default();
            rpc.project_batch(&ground, &mut out);
            assert_eq!(out.col.len(), n);
            for i in 0..n {
                let p = Point::new(ground.lon_deg[i], ground.lat_deg[i], ground.height_m[i]);
                assert!(rpc.project(p).distance(Pixel::new(out.col[i], out.row[i])) < 1e-9);
            }
        }
    }

    #[test]
    fn batch_localisation_is_exact_to_1e_8_px() {
        let rpc = test_camera();
        for n in [3, 2003] {
            let (pixels, height) = spread(n);
            let mut ground = GroundBatch::default();
            rpc.localize_batch(&pixels, &height, &mut ground);
            for i in 0..n {
                let p = Point::new(ground.lon_deg[i], ground.lat_deg[i], ground.height_m[i]);
                let apart = rpc.project(p).distance(Pixel::new(pixels.col[i], pixels.row[i]));
                assert!(apart < 1e-8, "{i} of {n}: {apart} px");
            }
        }
    }

    #[test]
    fn a_point_without_ground_is_nan_and_leaves_its_batch_unchanged() {
        let rpc = test_camera();
        let (mut pixels, mut height) = spread(2003);
        pixels.col[5] = f64::NAN;
        pixels.row[7] = 1e9;
        height[1000] = f64::INFINITY;
        let mut ground = GroundBatch::default();
        rpc.localize_batch(&pixels, &height, &mut ground);
        let lost: Vec<usize> = (0..2003).filter(|i| ground.lon_deg[*i].is_nan()).collect();
        assert_eq!(lost, [5, 7, 1000]);
    }

    #[test]
    fn a_batch_may_cross_the_antimeridian() {
        let mut c = test_camera().coefficients().clone();
        c.lon.offset = 179.999;
        let rpc = Rpc::new(c).unwrap();
        let ground = GroundBatch {
            lon_deg: vec![180.001, -179.999],
            lat_deg: vec![43.26; 2],
            height_m: vec![200.0; 2],
        };
        let mut out = PixelBatch::default();
        rpc.project_batch(&ground, &mut out);
        assert!((out.col[0] - out.col[1]).abs() < 1e-6 && (out.col[0] - 511.5).abs() < 600.0);
    }
}
