//! Files that list the products of a run for other programs: a STAC Item and QGIS layers.

mod qgis_layers;
mod stac_item;

use super::PipelineError;
use std::path::Path;

/// Writes the lists of the products that are there, after a change of these.
pub(crate) fn list_products(run: &Path) -> Result<(), PipelineError> {
    stac_item::write_item(run)?;
    qgis_layers::write_layers(run)
}
