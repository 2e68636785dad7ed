//! Position of an image in the larger image for which its RPC was made, from NITF's ICHIPB or the geotransform of a crop.

use super::SceneError;
use crate::io::ImageFile;
use crate::rpc::Axis;
use crate::rpc::formats::RpcFile;

/// Largest difference between the offsets of the four corners of a chip that is only cropped, pixels.
const SAME_OFFSET_PX: f64 = 0.01;

/// Column and row in the full image of the first pixel of a NITF chip, from its ICHIPB extension; `None` without the
/// extension, and for the offset (0, 0).
///
/// The extension (STDI-0002, appendix B) states the four corners in the chip (OP) and in the full image (FI).
///
/// # Errors
/// [`SceneError::Chip`] if the chip was rotated, scaled or warped, or the extension is incomplete.
pub(super) fn ichipb(image: &ImageFile) -> Result<Option<(f64, f64)>, SceneError> {
    let refused = |reason: String| SceneError::Chip { path: image.path().into(), reason };
    let number = |key: &str| image.metadata(&format!("ICHIP_{key}"), "")?.trim().parse::<f64>().ok();
    let Some(scale) = number("SCALE_FACTOR") else {
        // GDAL decodes the extension only if it states that the chip was made by cropping alone.
        let is_there = ["ICHIPB", "ICHIPA"].iter().find(|name| image.metadata(name, "TRE").is_some());
        return is_there.map_or(Ok(None), |name| {
            Err(refused(format!("its {name} states no position in the full image")))
        });
    };
    if (scale - 1.0).abs() > 1e-9 {
        return Err(refused(format!("its scale is {scale}")));
    }
    if number("ANAMORPH_CORR").is_some_and(|a| a != 0.0) {
        return Err(refused("it was stretched along one axis".into()));
    }
    let mut offsets = Vec::with_capacity(4);
    for corner in ["11", "12", "21", "22"] {
        let offset = |axis: &str| {
            Some(number(&format!("FI_{axis}_{corner}"))? - number(&format!("OP_{axis}_{corner}"))?)
        };
        let both = offset("COL").zip(offset("ROW"));
        offsets.push(both.ok_or_else(|| refused(format!("its corner {corner} is missing")))?);
    }
    let (col, row) = offsets[0];
    if offsets.iter().any(|o| (o.0 - col).abs() > SAME_OFFSET_PX || (o.1 - row).abs() > SAME_OFFSET_PX) {
        return Err(refused("it was rotated, mirrored or resampled".into()));
    }
    Ok((col != 0.0 || row != 0.0).then_some((col, row)))
}

/// Column and row in the whole image of the first pixel of a crop, from a geotransform in pixels, as OTB, CARS and
/// rasterio write it; `None` if there is none, or the camera is not that of the whole image.
pub(super) fn counted_from_whole(image: &ImageFile, camera: &RpcFile) -> Option<(f64, f64)> {
    let (col, row) = image.pixel_offset()?;
    // In OTB's convention, the origin is the centre of the first pixel.
    let (col, row) = (col.floor(), row.floor());
    let (width, height) = image.size();
    if (col == 0.0 && row == 0.0) || col < 0.0 || row < 0.0 {
        return None;
    }
    let c = camera.rpc.coefficients();
    let whole =
        camera.tags.size.map_or((2.0 * c.col.scale, 2.0 * c.row.scale), |(w, h)| (w as f64, h as f64));
    // Two pixels of tolerance, because half of a size is rounded.
    let is_inside = col + width as f64 <= whole.0 + 2.0 && row + height as f64 <= whole.1 + 2.0;
    // The offset of an RPC that was shifted with the crop differs from its scale by the offset of the crop.
    let off_middle = |axis: Axis, moved: f64| (axis.offset + moved - axis.scale).abs();
    let as_it_is = off_middle(c.col, 0.0) + off_middle(c.row, 0.0);
    let if_moved = off_middle(c.col, col) + off_middle(c.row, row);
    (is_inside && as_it_is < if_moved).then_some((col, row))
}
