//! Polygons on the map as GeoJSON or GeoPackage.

use super::file::quiet_gdal;
use super::write::encode;
use super::{RasterError, write_atomically};
use gdal::DriverManager;
use gdal::spatial_ref::{AxisMappingStrategy, SpatialRef};
use gdal::vector::{Feature, Geometry, LayerAccess, LayerOptions, OGRFieldType, OGRwkbGeometryType};
use std::path::Path;

/// A named polygon in longitude and latitude.
pub struct Outline {
    /// Its name.
    pub name: String,
    /// Its corners in order, (longitude, latitude) in degrees; the first is not repeated.
    pub ring: Vec<(f64, f64)>,
    /// What else is known of it, NaN what is not; every outline has the same keys.
    pub numbers: Vec<(&'static str, f64)>,
}

/// Writes polygons as one layer: a GeoPackage if `path` ends in `.gpkg`, else GeoJSON.
///
/// # Errors
/// [`RasterError::Write`].
pub fn write_outlines(path: &Path, layer: &str, outlines: &[Outline]) -> Result<(), RasterError> {
    quiet_gdal();
    let is_package = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gpkg"));
    let driver = if is_package { "GPKG" } else { "GeoJSON" };
    write_atomically(path, |temporary| {
        let make = |encoded: &Path| -> Result<(), Box<dyn std::error::Error>> {
            let mut dataset = DriverManager::get_driver_by_name(driver)?.create_vector_only(encoded)?;
            let mut srs = SpatialRef::from_epsg(4326)?;
            srs.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
            let options = LayerOptions {
                name: layer,
                srs: Some(&srs),
                ty: OGRwkbGeometryType::wkbPolygon,
                options: None,
            };
            let layer = dataset.create_layer(options)?;
            let mut fields = vec![("name", OGRFieldType::OFTString)];
            let numbers = outlines.first().map_or(&[][..], |o| &o.numbers);
            fields.extend(numbers.iter().map(|(name, _)| (*name, OGRFieldType::OFTReal)));
            layer.create_defn_fields(&fields)?;
            for outline in outlines {
                let corners = outline.ring.iter().chain(outline.ring.first());
                let corners: Vec<String> = corners.map(|(lon, lat)| format!("{lon} {lat}")).collect();
                let polygon = Geometry::from_wkt(&format!("POLYGON (({}))", corners.join(", ")))?;
                let mut feature = Feature::new(layer.defn())?;
                feature.set_geometry(polygon)?;
                feature.set_field_string(0, &outline.name)?;
                for (i, (_, value)) in outline.numbers.iter().enumerate().filter(|(_, n)| n.1.is_finite()) {
                    feature.set_field_double(i + 1, *value)?;
                }
                feature.create(&layer)?;
            }
            Ok(dataset.close()?)
        };
        encode(temporary, make).map_err(|e| RasterError::Write { path: path.into(), reason: e.to_string() })
    })
}
