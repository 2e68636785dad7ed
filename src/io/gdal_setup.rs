//! Configuration of GDAL, and coordinate transforms.

use gdal::spatial_ref::{AxisMappingStrategy, CoordTransform, SpatialRef};
use std::sync::Once;

/// Configures GDAL at the first call. Messages of GDAL are written to the log only, because errors contain them.
pub(super) fn set_up_gdal() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // Tiles of large rasters are decoded in parallel.
        let _ =
            gdal::config::set_config_option("GDAL_NUM_THREADS", &rayon::current_num_threads().to_string());
        gdal::config::set_error_handler(|class, number, message| {
            tracing::debug!("GDAL {class:?} {number}: {message}");
        });
    });
}

/// Transforms coordinates in place. x is east or longitude and y north or latitude, whatever order the CRS defines.
pub(super) fn transform(
    mut from: SpatialRef,
    mut to: SpatialRef,
    x: &mut [f64],
    y: &mut [f64],
    z: &mut [f64],
) -> Option<()> {
    from.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    to.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
    CoordTransform::new(&from, &to).ok()?.transform_coords(x, y, z).ok()
}
