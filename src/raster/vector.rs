//! Polygons on the map: written as GeoJSON or GeoPackage, read from any vector file as a mask.

use super::file::quiet_gdal;
use super::write::{encode, memory_dataset};
use super::{MapGrid, RasterError, write_atomically};
use gdal::raster::rasterize;
use gdal::spatial_ref::{AxisMappingStrategy, CoordTransform, SpatialRef};
use gdal::vector::{Feature, Geometry, LayerAccess, LayerOptions, OGRFieldType, OGRwkbGeometryType};
use gdal::{Dataset, DatasetOptions, DriverManager, GdalOpenFlags};
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

/// Which cells of a grid have their centre inside of a vector file's polygons; none if it is no vector file.
///
/// # Errors
/// [`RasterError::Mask`] when it has no CRS or no polygon.
pub fn inside_polygons(path: &Path, grid: &MapGrid) -> Result<Option<Vec<bool>>, RasterError> {
    quiet_gdal();
    let wrong = |reason: String| RasterError::Mask { path: path.into(), reason };
    let flags = GdalOpenFlags::GDAL_OF_VECTOR;
    let options = DatasetOptions { open_flags: flags, ..DatasetOptions::default() };
    let Ok(vector) = Dataset::open_ex(path, options) else { return Ok(None) };
    let burn = || -> Result<Option<Vec<bool>>, Box<dyn std::error::Error>> {
        let mut to = SpatialRef::from_epsg(grid.epsg)?;
        to.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
        let mut polygons = Vec::new();
        for mut layer in vector.layers() {
            let mut from = layer.spatial_ref().ok_or("its CRS is not stated")?;
            from.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
            let to_grid = CoordTransform::new(&from, &to)?;
            for feature in layer.features() {
                let Some(geometry) = feature.geometry() else { continue };
                if geometry.area() > 0.0 {
                    polygons.push(geometry.transform(&to_grid)?);
                }
            }
        }
        if polygons.is_empty() {
            return Err("it holds no polygon".into());
        }
        let cells = vec![0u8; grid.width * grid.height];
        let mut burnt = memory_dataset(grid.width, grid.height, vec![cells], None, "")?;
        burnt.set_geo_transform(&grid.geo_transform())?;
        rasterize(&mut burnt, &[1], &polygons, &vec![1.0; polygons.len()], None)?;
        let size = (grid.width, grid.height);
        let cells = burnt.rasterband(1)?.read_as::<u8>((0, 0), size, size, None)?.into_shape_and_vec().1;
        Ok(Some(cells.into_iter().map(|c| c != 0).collect()))
    };
    burn().map_err(|e| wrong(e.to_string()))
}
