//! What the user gets: GeoTIFFs with an RPC tag that points a few pixels wrong, and the sun in their metadata.

use super::Shot;
use crate::raster::{RasterError, SensorImage};
use crate::rpc::Rpc;
use std::path::Path;

/// Writes a view's image with its delivered RPC, sun and date.
pub(super) fn write_view(
    path: &Path,
    shot: &Shot,
    size_px: usize,
    bands: Vec<Vec<u8>>,
) -> Result<(), RasterError> {
    let metadata = [
        ("SUN_AZIMUTH".to_owned(), format!("{:.4}", shot.plan.sun.azimuth_deg)),
        ("SUN_ELEVATION".to_owned(), format!("{:.4}", shot.plan.sun.elevation_deg)),
        ("ACQUISITION_TIME".to_owned(), shot.plan.acquired.clone()),
    ];
    let rpc = rpc_domain(&shot.delivered_rpc());
    SensorImage { width: size_px, height: size_px, rpc: &rpc, metadata: &metadata }.write_u8(path, bands)
}

/// GDAL's RPC metadata domain.
fn rpc_domain(rpc: &Rpc) -> Vec<(String, String)> {
    let c = rpc.coefficients();
    let mut items = Vec::new();
    for (name, axis) in
        [("LINE", c.row), ("SAMP", c.col), ("LAT", c.lat), ("LONG", c.lon), ("HEIGHT", c.height)]
    {
        items.push((format!("{name}_OFF"), format!("{:.16e}", axis.offset)));
        items.push((format!("{name}_SCALE"), format!("{:.16e}", axis.scale)));
    }
    for (name, terms) in [
        ("LINE_NUM", &c.row_num),
        ("LINE_DEN", &c.row_den),
        ("SAMP_NUM", &c.col_num),
        ("SAMP_DEN", &c.col_den),
    ] {
        let values: Vec<String> = terms.iter().map(|t| format!("{t:.16e}")).collect();
        items.push((format!("{name}_COEFF"), values.join(" ")));
    }
    items
}
