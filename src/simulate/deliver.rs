//! What the user gets: GeoTIFFs with an RPC tag that points a few pixels wrong, and the sun in their metadata.

use super::Shot;
use crate::io::{SensorImage, WriteError};
use crate::rpc::formats::to_gdal;
use std::path::Path;

/// Writes a view's image with its delivered RPC, sun and date.
pub(super) fn write_view(
    path: &Path,
    shot: &Shot,
    size_px: usize,
    bands: Vec<Vec<u8>>,
) -> Result<(), WriteError> {
    let metadata = [
        ("SUN_AZIMUTH".to_owned(), format!("{:.4}", shot.plan.sun.azimuth_deg)),
        ("SUN_ELEVATION".to_owned(), format!("{:.4}", shot.plan.sun.elevation_deg)),
        ("ACQUISITION_TIME".to_owned(), shot.plan.acquired.clone()),
    ];
    let rpc = to_gdal(&shot.delivered_rpc());
    SensorImage { width: size_px, height: size_px, rpc: &rpc, metadata: &metadata }.write_u8(path, bands)
}
