//! Delivered images: GeoTIFFs with an RPC tag that includes a pointing error, and the sun in their metadata.

use super::options::BitDepth;
use super::view::SimulatedView;
use crate::io::{SensorImage, WriteError, write_file};
use crate::rpc::formats::to_gdal;
use std::path::Path;

/// Name of the list of views that are held out.
pub(super) const TEST_LIST: &str = "test.txt";
/// Name of the list of views to train on.
pub(super) const TRAIN_LIST: &str = "train.txt";

/// Writes a view's image with its delivered RPC, sun and date.
pub(super) fn write_view(
    path: &Path,
    view: &SimulatedView,
    size_px: usize,
    bands: &[Vec<u16>],
    depth: BitDepth,
) -> Result<(), WriteError> {
    let metadata = [
        ("SUN_AZIMUTH".to_owned(), format!("{:.4}", view.plan.sun.azimuth_deg)),
        ("SUN_ELEVATION".to_owned(), format!("{:.4}", view.plan.sun.elevation_deg)),
        ("ACQUISITION_TIME".to_owned(), view.plan.acquired.clone()),
    ];
    let rpc = to_gdal(&view.delivered_rpc());
    let image = SensorImage { width: size_px, height: size_px, rpc: &rpc, metadata: &metadata };
    // No ray that ends on the ground gives 0.
    let nodata = bands.iter().flatten().any(|level| *level == 0).then_some(0.0);
    match depth {
        BitDepth::Eight => {
            let narrow = |band: &Vec<u16>| band.iter().map(|level| (*level).min(255) as u8).collect();
            image.write_levels(path, &bands.iter().map(narrow).collect::<Vec<_>>(), nodata)
        }
        BitDepth::Sixteen => image.write_levels(path, bands, nodata),
    }
}

/// Writes `test.txt`, which holds views back from training, unless there are none.
pub(super) fn write_test_list(folder: &Path, names: &[&str]) -> Result<(), WriteError> {
    if names.is_empty() {
        return Ok(());
    }
    let lines: String = names.iter().map(|name| format!("{name}.tif\n")).collect();
    write_file(&folder.join(TEST_LIST), lines)
}
