//! The splats that a camera may show, copied from all splats.
//!
//! A view of a room shows a part of its splats. An iteration copies these, so that its time depends on their number, not on that of
//! all splats.

use super::super::primitive::PrimitiveKind;
use super::super::raster::{ALPHA_CUT, FrameCamera, LOW_PASS_PX2, MAX_TILT};
use super::super::splats::{Splats, logit, opacities};
use crate::perspective::PinholeKernel;
use crate::simd::{Real, SimdReal};
use rayon::prelude::*;

/// Number of splats that one task works on; fixed, so that sums do not depend on the number of threads.
const PIECE: usize = 1 << 13;
/// A splat shows nothing below [`ALPHA_CUT`], and nothing outside the image. The rasteriser rounds both otherwise than this file.
const OPACITY_MARGIN: f64 = 0.999;
const MARGIN_PX: f64 = 1.0;

/// What an ellipsoid shows lies within so many standard deviations of its image's centre.
#[must_use]
pub fn ellipsoid_reach() -> f64 {
    (-2.0 * ALPHA_CUT.ln()).sqrt()
}

/// Splats with a smaller logit of the opacity show nothing.
#[must_use]
pub fn least_logit<T: Real>() -> T {
    logit(T::from_f64(OPACITY_MARGIN * ALPHA_CUT))
}

/// What the smallest splat shows lies within so many pixels of its image's centre, for a reach in standard deviations.
#[must_use]
pub fn least_reach_px<T: Real>(reach: T) -> T {
    reach * T::from_f64(LOW_PASS_PX2.sqrt()) + T::from_f64(MARGIN_PX)
}

/// The splats that the camera of the last selection may show.
#[derive(Default)]
pub struct SeenSplats<T> {
    /// Their indices among all splats, rising.
    pub indices: Vec<u32>,
    /// The splats.
    pub splats: Splats<T>,
    /// Mean opacity of all splats.
    pub mean_opacity: f64,
    pieces: Vec<Piece<T>>,
}

/// What a task finds.
#[derive(Default)]
struct Piece<T> {
    indices: Vec<u32>,
    /// The opacities of all splats of the task.
    opacities: Vec<T>,
    opacity_sum: f64,
}

/// Which splats a camera may show.
struct Frustum<'a, T> {
    camera: &'a FrameCamera<PinholeKernel<T>>,
    /// What a splat shows lies within so many standard deviations of its image's centre.
    reach: T,
    least_logit: T,
}

impl<T: SimdReal> Frustum<'_, T> {
    /// False only for splats of which the image shows nothing; false if the position or the logit of the opacity is NaN.
    fn may_show(&self, position: [T; 3], log_scale: [T; 3], logit: T) -> bool {
        let FrameCamera { kernel, width, height } = self.camera;
        let is_opaque = logit >= self.least_logit;
        if !is_opaque {
            return false;
        }
        let Some((image, px_per_m)) = kernel.image_and_scale(position) else {
            return false;
        };
        let is_within = |half_px: T| {
            let size = [*width, *height].map(|v| T::from_f64(v as f64));
            (0..2).all(|k| image[k] + half_px >= T::zero() && image[k] - half_px <= size[k])
        };
        // Most splats in the frustum have their centres in the image, which spares the exponential.
        let least_px = least_reach_px(self.reach);
        let [a, b, c] = log_scale;
        is_within(least_px) || is_within(least_px + self.reach * px_per_m * a.max(b).max(c).exp())
    }
}

impl<T: SimdReal> SeenSplats<T> {
    /// Selects the splats of a kind that a camera may show; all of them without a camera.
    pub fn select(
        &mut self,
        all: &Splats<T>,
        kind: PrimitiveKind,
        camera: Option<&FrameCamera<PinholeKernel<T>>>,
    ) {
        let reach = match kind {
            PrimitiveKind::Ellipsoid => ellipsoid_reach(),
            // The near end of the disc that is inclined most.
            PrimitiveKind::Disc => ellipsoid_reach() / (1.0 - MAX_TILT.sqrt()),
        };
        let (reach, least_logit) = (T::from_f64(reach), least_logit());
        let frustum = camera.map(|camera| Frustum { camera, reach, least_logit });
        self.pieces.resize_with(all.len().div_ceil(PIECE), Piece::default);
        self.pieces.par_iter_mut().enumerate().for_each(|(k, piece)| {
            let places = k * PIECE..all.len().min((k + 1) * PIECE);
            let logits = &all.opacity_logit[places.clone()];
            piece.opacities.resize(logits.len(), T::zero());
            opacities(logits, &mut piece.opacities);
            piece.opacity_sum = piece.opacities.iter().map(|opacity| opacity.as_f64()).sum();
            piece.indices.clear();
            piece.indices.extend(places.zip(logits).filter_map(|(i, [logit])| {
                let may_show = |f: &Frustum<T>| f.may_show(all.position[i], all.log_scale[i], *logit);
                frustum.as_ref().is_none_or(may_show).then_some(i as u32)
            }));
        });
        self.indices.clear();
        self.pieces.iter().for_each(|piece| self.indices.extend(&piece.indices));
        let opacities: f64 = self.pieces.iter().map(|piece| piece.opacity_sum).sum();
        self.mean_opacity = opacities / all.len().max(1) as f64;
        self.splats.take_from(all, &self.indices);
    }
}
