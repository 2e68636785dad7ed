//! Corrections of a camera in image space: `corrected = rpc + d(rpc)` with a linear function d (Grodecki & Dial 2003).
//!
//! d is a function of image coordinates relative to the middle of the image, divided by half its size, so that every
//! parameter is a displacement in pixels at the edge of the image.

use crate::frame::{CenterPx, Pixel};
use crate::rpc::{Axis, LocalizeError, Rpc, RpcCoefficients, Volume, fit};
use serde::{Deserialize, Serialize};

/// Number of parameters of the largest model.
pub const MOST: usize = 6;
/// Parameters of a correction, pixels: shift of columns, shift of rows; then displacements at the edge: columns by
/// columns, rows by rows, columns by rows, rows by columns.
pub type Parameters = [f64; MOST];

/// A refitted camera is valid this far from the middle of the image, in halves of its size.
const REACH: f64 = 1.05;

/// Which parameters of a correction are free.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CorrectionModel {
    /// Two parameters, a shift: sufficient for images up to 8,000 pixels a side, in which a small rotation of the
    /// satellite is a shift to within 0.01 px.
    #[default]
    Shift,
    /// Four parameters: a shift and a scale of each axis.
    ShiftScale,
    /// Six parameters: for whole scenes, during which the attitude of the satellite drifts.
    Affine,
}

impl CorrectionModel {
    /// Number of free parameters, the first of [`Parameters`].
    #[must_use]
    pub const fn parameters(self) -> usize {
        match self {
            Self::Shift => 2,
            Self::ShiftScale => 4,
            Self::Affine => MOST,
        }
    }
}

/// Size of an image, to which the parameters of its correction refer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageFrame {
    middle: [f64; 2],
    half: [f64; 2],
}

impl ImageFrame {
    /// The frame of an image of (columns, rows).
    #[must_use]
    pub fn new((width, height): (usize, usize)) -> Self {
        let half = [0.5 * width as f64, 0.5 * height as f64];
        Self { middle: half.map(|h| h - 0.5), half }
    }

    /// The longer side, pixels.
    #[must_use]
    pub fn side_px(&self) -> f64 {
        2.0 * self.half[0].max(self.half[1])
    }

    /// (column, row) relative to the middle, in halves of the image's size.
    #[must_use]
    pub fn normalised(&self, px: Pixel<CenterPx>) -> [f64; 2] {
        [(px.col - self.middle[0]) / self.half[0], (px.row - self.middle[1]) / self.half[1]]
    }

    /// Position in the corrected camera of what the delivered camera sees at `px`.
    #[must_use]
    pub fn corrected_px(&self, p: &Parameters, px: Pixel<CenterPx>) -> Pixel<CenterPx> {
        let [x, y] = self.normalised(px);
        Pixel::new(px.col + p[0] + p[2] * x + p[4] * y, px.row + p[1] + p[3] * y + p[5] * x)
    }

    /// Derivatives of [`ImageFrame::corrected_px`] by `px`.
    #[must_use]
    pub fn jacobian_by_px(&self, p: &Parameters) -> [[f64; 2]; 2] {
        let [w, h] = self.half;
        [[1.0 + p[2] / w, p[4] / h], [p[5] / w, 1.0 + p[3] / h]]
    }

    /// The corrected RPC. It has other offsets and scales, exactly, unless columns depend on rows or rows on columns;
    /// then it is fitted to the corrected camera over the image with a small margin, between two heights in metres.
    ///
    /// # Errors The reason why the fit is not an RPC.
    pub fn corrected(&self, rpc: &Rpc, p: &Parameters, heights: (f64, f64)) -> Result<Rpc, String> {
        let c = rpc.coefficients();
        if p[4] != 0.0 || p[5] != 0.0 {
            let volume = self.volume(rpc, heights).map_err(|e| e.to_string())?;
            let fitted = fit(&volume, |ground| self.corrected_px(p, rpc.project(ground)))
                .map_err(|e| e.to_string())?;
            let told =
                RpcCoefficients { err_bias_m: c.err_bias_m, err_rand_m: c.err_rand_m, ..fitted.into() };
            return Rpc::new(told).map_err(|e| e.to_string());
        }
        let mut c = c.clone();
        for (k, axis) in [&mut c.col, &mut c.row].into_iter().enumerate() {
            let stretch = p[2 + k] / self.half[k];
            axis.offset += p[k] + stretch * (axis.offset - self.middle[k]);
            axis.scale += stretch * axis.scale;
        }
        Rpc::new(c).map_err(|e| e.to_string())
    }

    /// The volume that the image with a small margin sees between two heights.
    ///
    /// The volume of the RPC itself may be a hundred times as wide, as that of SkySat's is, so that a fit over it would
    /// miss the image.
    fn volume(&self, rpc: &Rpc, heights: (f64, f64)) -> Result<Volume, LocalizeError> {
        let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for (x, y) in [(-REACH, -REACH), (REACH, -REACH), (-REACH, REACH), (REACH, REACH)] {
            let px = Pixel::new(self.middle[0] + x * self.half[0], self.middle[1] + y * self.half[1]);
            for h in [heights.0, heights.1] {
                let ground = rpc.localize(px, h)?;
                for (range, v) in bounds.iter_mut().zip([ground.lon_deg(), ground.lat_deg()]) {
                    *range = [range[0].min(v), range[1].max(v)];
                }
            }
        }
        let axis = |low: f64, high: f64| Axis { offset: 0.5 * (low + high), scale: 0.5 * (high - low) };
        let [lon, lat] = bounds.map(|[low, high]| axis(low, high));
        let [col, row] = [0, 1].map(|k| Axis { offset: self.middle[k], scale: self.half[k] });
        Ok(Volume { lon, lat, height: axis(heights.0, heights.1), col, row })
    }
}

/// Derivatives of a corrected position by the first `P` parameters, at a normalised position.
#[must_use]
pub fn by_parameters<const P: usize>([x, y]: [f64; 2]) -> nalgebra::SMatrix<f64, 2, P> {
    let rows = [[1.0, 0.0, x, 0.0, y, 0.0], [0.0, 1.0, 0.0, y, 0.0, x]];
    nalgebra::SMatrix::from_fn(|r, c| rows[r][c])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rpc::formats;

    /// Largest distance between the written camera and the corrected one over the image, pixels.
    fn export_error_px(rpc: &Rpc, size: (usize, usize), p: &Parameters) -> f64 {
        let frame = ImageFrame::new(size);
        let middle = rpc.center().height_m();
        let heights = (middle - 500.0, middle + 500.0);
        let text = formats::to_text(&frame.corrected(rpc, p, heights).unwrap());
        let written = formats::parse("written_RPC.TXT".as_ref(), &text).unwrap().rpc;
        let node = |i: i32| f64::from(i % 17) / 16.0;
        let apart = (0..17i32.pow(3)).map(|i| {
            let px = Pixel::new(node(i) * size.0 as f64, node(i / 17) * size.1 as f64);
            let ground = rpc.localize(px, heights.0 + 1000.0 * node(i / 289)).unwrap();
            written.project(ground).distance(frame.corrected_px(p, rpc.project(ground)))
        });
        apart.fold(0.0, f64::max)
    }

    #[test]
    fn a_shift_and_a_scale_are_written_exactly() {
        let rpc = crate::rpc::test_camera();
        assert!(export_error_px(&rpc, (1000, 800), &[36.2, -5.1, 0.0, 0.0, 0.0, 0.0]) < 1e-9);
        assert!(export_error_px(&rpc, (1000, 800), &[3.2, -5.1, 0.4, -0.7, 0.0, 0.0]) < 1e-9);
    }

    #[test]
    fn an_affine_correction_is_written_to_a_millionth_of_a_pixel() {
        let here = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
        let data = std::env::var_os("SATGS_DATA").map_or(here, std::path::PathBuf::from).join("rpc");
        let files = [
            ("rpcm/rpc_WV3.xml", (40_000, 34_000)),
            ("rpcm/rpc_PLEIADES.xml", (40_000, 22_939)),
            ("skysat/20200413_151408_ssc4d2_0011_basic_panchromatic_dn.rpc", (3199, 1349)),
        ];
        for (name, size) in files {
            let Ok(file) = formats::read(&data.join(name)) else {
                #[allow(clippy::print_stdout)]
                {
                    println!("skipped: no {name} in {}", data.display());
                }
                continue;
            };
            let off = export_error_px(&file.rpc, size, &[6.0, -4.0, 0.8, -0.5, 1.0, -1.2]);
            assert!(off < 1e-6, "{name}: {off:e} px");
        }
    }

    #[test]
    fn derivatives_are_those_of_the_correction() {
        let frame = ImageFrame::new((3000, 2000));
        let p = [1.0, 2.0, 30.0, -40.0, 50.0, 60.0];
        let at = Pixel::<CenterPx>::new(700.0, 1500.0);
        let here = frame.corrected_px(&p, at);
        let jacobian_by_px = frame.jacobian_by_px(&p);
        for (k, step) in [[1.0, 0.0], [0.0, 1.0]].into_iter().enumerate() {
            let there = frame.corrected_px(&p, Pixel::new(at.col + step[0], at.row + step[1]));
            assert!((there.col - here.col - jacobian_by_px[0][k]).abs() < 1e-9);
            assert!((there.row - here.row - jacobian_by_px[1][k]).abs() < 1e-9);
        }
        let by_parameters = by_parameters::<MOST>(frame.normalised(at));
        for k in 0..MOST {
            let mut more = p;
            more[k] += 1.0;
            let there = frame.corrected_px(&more, at);
            assert!((there.col - here.col - by_parameters[(0, k)]).abs() < 1e-9);
            assert!((there.row - here.row - by_parameters[(1, k)]).abs() < 1e-9);
        }
    }
}
