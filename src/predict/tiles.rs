//! Prediction of a whole area, tile by tile.

use super::head::Head;
use super::input::{SeenCloud, TileInput};
use super::{PredictError, Predictor, SplatSampling};
use crate::frame::SiteBox;
use crate::progress::{Event, Progress};
use crate::splat::edit::Edit;
use crate::splat::splats::{Splats, logit};
use rayon::prelude::*;

/// Side of a tile, metres.
const TILE_M: f64 = 64.0;
/// Splats of lower opacity are left out.
const LEAST_OPACITY: f32 = 0.02;
/// Smallest unit of the offsets, metres: about three times the noise of points from stereo matching.
const OFFSET_M: f64 = 1.0;

/// Largest change of a colour, relative to the brightness of the scene.
const MOST_COLOR: f64 = 2.0;

/// How the numbers of the network become splats, for a cloud of this spacing (metres) and linear brightness.
#[must_use]
pub fn head(sampling: &SplatSampling, cloud_spacing_m: f64, brightness: f32) -> Head {
    let most_offset_m = if sampling.offsets { OFFSET_M.max(cloud_spacing_m) } else { 0.0 };
    Head { spacing_m: sampling.spacing_m, most_offset_m, most_color: MOST_COLOR * f64::from(brightness) }
}

/// The splats of a level area (west, south, east, north; metres) that a model predicts of a cloud and the images that show it.
/// `has_walls` adds walls without points, which clouds from above lack.
///
/// # Errors
/// [`PredictError::Interrupted`] if `progress` asks to stop, [`PredictError::Onnx`] if a network of others cannot be evaluated.
pub fn predict(
    predictor: &Predictor,
    seen: &SeenCloud,
    area: SiteBox,
    has_walls: bool,
    progress: &dyn Progress,
) -> Result<Splats, PredictError> {
    let sampling = predictor.sampling();
    let head = head(sampling, seen.cloud.spacing_m(), seen.brightness());
    let tiles = tiles(area);
    progress.event(Event::Started { stage: "predicting splats", total: tiles.len() as u64 });
    let mut out = Splats::default();
    // Some tiles side by side, in their order, so that memory is bounded and the work can stop.
    let each = rayon::current_num_threads().max(1);
    let mut done = 0;
    for group in tiles.chunks(each) {
        progress.check()?;
        let of_tile = |tile: &SiteBox| {
            let Some(TileInput { network: input, bases }) = seen.tile(sampling, *tile, has_walls) else {
                return Ok(Splats::default());
            };
            Ok(head.splats(&predictor.outputs(&input)?, &bases))
        };
        let splats: Vec<Result<Splats, PredictError>> = group.par_iter().map(of_tile).collect();
        for splats in splats {
            out.append(splats?);
        }
        done += group.len();
        progress.event(Event::Advanced { done: done as u64, status: format!("{} splats", out.len()) });
    }
    let is_kept: Vec<bool> = out.opacity_logit.iter().map(|o| o[0] >= logit(LEAST_OPACITY)).collect();
    out.apply(&Edit::retain(&is_kept));
    progress.event(Event::Finished);
    Ok(out)
}

/// The tiles of an area, of equal size.
fn tiles((west, south, east, north): SiteBox) -> Vec<SiteBox> {
    let parts = |length: f64| (length / TILE_M).ceil().max(1.0);
    let (columns, rows) = (parts(east - west), parts(north - south));
    let (width, height) = ((east - west) / columns, (north - south) / rows);
    let at = |col: f64, row: f64| [west + width * col, south + height * row];
    let tile = |i: usize| {
        let (col, row) = ((i % columns as usize) as f64, (i / columns as usize) as f64);
        let ([w, s], [e, n]) = (at(col, row), at(col + 1.0, row + 1.0));
        (w, s, e, n)
    };
    (0..columns as usize * rows as usize).map(tile).collect()
}
