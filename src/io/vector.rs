//! Vector files: points and polygons are written as GeoJSON or GeoPackage; polygons are read from any format as a mask.

use super::gdal_setup::set_up_gdal;
use super::write::{encode, memory_dataset};
use super::{Cause, MapGrid, VectorError, WriteError, write_atomically};
use gdal::config::set_thread_local_config_option;
use gdal::raster::rasterize;
use gdal::spatial_ref::{AxisMappingStrategy, CoordTransform, SpatialRef};
use gdal::vector::{Feature, Geometry, LayerAccess, LayerOptions, OGRFieldType, OGRwkbGeometryType};
use gdal::{Dataset, DatasetOptions, DriverManager, GdalOpenFlags};
use std::path::Path;

/// Time of the last change in GeoPackages; it is fixed so that the same content gives the same bytes.
const UNDATED: &str = "2000-01-01T00:00:00.000Z";

/// EPSG code of longitude and latitude, WGS 84.
const WGS84: u32 = 4326;

/// Attributes of a feature: names and values, NaN if unknown. All features of a layer have the same names.
pub type Numbers = Vec<(&'static str, f64)>;

/// A named polygon in longitude and latitude.
pub struct Outline {
    /// Name of the feature.
    pub name: String,
    /// Corners in order, (longitude, latitude) in degrees, WGS 84; the first one is not repeated.
    pub ring: Vec<(f64, f64)>,
    /// Attributes of the feature.
    pub numbers: Numbers,
}

/// A point with attributes.
pub struct Marker {
    /// Longitude and latitude in degrees and ellipsoidal height in metres, WGS 84.
    pub place: [f64; 3],
    /// Attributes of the feature.
    pub numbers: Numbers,
}

/// A line or polygon in the coordinates of a map, with attributes.
pub struct MapFeature {
    /// Corners in order, (east, north) in metres; the first corner of a polygon is not repeated.
    pub corners: Vec<(f64, f64)>,
    /// Attributes that are texts. All features of a layer have the same names.
    pub texts: Vec<(&'static str, String)>,
    /// Attributes that are numbers.
    pub numbers: Numbers,
}

/// Whether features are lines or polygons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapShape {
    /// Open lines.
    Line,
    /// Closed polygons.
    Polygon,
}

/// Writes lines or polygons in the CRS of an EPSG code as one layer: a GeoPackage if `path` ends in `.gpkg`, else GeoJSON.
///
/// # Errors
/// [`WriteError`] if the file cannot be written.
pub fn write_map_features(
    path: &Path,
    layer: &str,
    epsg: u32,
    shape: MapShape,
    features: &[MapFeature],
) -> Result<(), WriteError> {
    let written = features.iter().map(|f| {
        let closing = f.corners.first().filter(|_| shape == MapShape::Polygon);
        let corners: Vec<String> =
            f.corners.iter().chain(closing).map(|(east, north)| format!("{east} {north}")).collect();
        let corners = corners.join(", ");
        let geometry = match shape {
            MapShape::Line => format!("LINESTRING ({corners})"),
            MapShape::Polygon => format!("POLYGON (({corners}))"),
        };
        (f.texts.iter().map(|(key, text)| (*key, text.as_str())).collect(), geometry, &f.numbers)
    });
    let ty = match shape {
        MapShape::Line => OGRwkbGeometryType::wkbLineString,
        MapShape::Polygon => OGRwkbGeometryType::wkbPolygon,
    };
    write_features(path, layer, (epsg, ty), &written.collect::<Vec<_>>())
}

/// Writes polygons as one layer: a GeoPackage if `path` ends in `.gpkg`, else GeoJSON.
///
/// # Errors
/// [`WriteError`] if the file cannot be written.
pub fn write_outlines(path: &Path, layer: &str, outlines: &[Outline]) -> Result<(), WriteError> {
    let features = outlines.iter().map(|o| {
        let corners = o.ring.iter().chain(o.ring.first());
        let corners: Vec<String> = corners.map(|(lon, lat)| format!("{lon} {lat}")).collect();
        (vec![("name", o.name.as_str())], format!("POLYGON (({}))", corners.join(", ")), &o.numbers)
    });
    write_features(path, layer, (WGS84, OGRwkbGeometryType::wkbPolygon), &features.collect::<Vec<_>>())
}

/// Writes points as one layer: a GeoPackage if `path` ends in `.gpkg`, else GeoJSON.
///
/// # Errors
/// [`WriteError`] if the file cannot be written.
pub fn write_markers(path: &Path, layer: &str, markers: &[Marker]) -> Result<(), WriteError> {
    let features = markers.iter().map(|m| {
        let [lon, lat, h] = m.place;
        (Vec::new(), format!("POINT Z ({lon} {lat} {h})"), &m.numbers)
    });
    write_features(path, layer, (WGS84, OGRwkbGeometryType::wkbPoint25D), &features.collect::<Vec<_>>())
}

/// A feature as it is written: texts, geometry as WKT, numbers.
type WrittenFeature<'a> = (Vec<(&'static str, &'a str)>, String, &'a Numbers);

/// Writes features. The CRS is given by its EPSG code.
fn write_features(
    path: &Path,
    layer: &str,
    (epsg, ty): (u32, OGRwkbGeometryType::Type),
    features: &[WrittenFeature],
) -> Result<(), WriteError> {
    set_up_gdal();
    let is_package = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gpkg"));
    let driver = if is_package { "GPKG" } else { "GeoJSON" };
    write_atomically(path, |temporary| {
        let make = |encoded: &Path| -> Result<(), Cause> {
            set_thread_local_config_option("OGR_CURRENT_DATE", UNDATED)?;
            let mut dataset = DriverManager::get_driver_by_name(driver)?.create_vector_only(encoded)?;
            let mut srs = SpatialRef::from_epsg(epsg)?;
            srs.set_axis_mapping_strategy(AxisMappingStrategy::TraditionalGisOrder);
            let layer =
                dataset.create_layer(LayerOptions { name: layer, srs: Some(&srs), ty, options: None })?;
            let first = features.first();
            let texts = first.into_iter().flat_map(|f| &f.0).map(|(key, _)| (*key, OGRFieldType::OFTString));
            let numbers = first.into_iter().flat_map(|f| f.2).map(|(key, _)| (*key, OGRFieldType::OFTReal));
            let offset = first.map_or(0, |f| f.0.len());
            layer.create_defn_fields(&texts.chain(numbers).collect::<Vec<_>>())?;
            for (texts, geometry, numbers) in features {
                let mut feature = Feature::new(layer.defn())?;
                feature.set_geometry(Geometry::from_wkt(geometry)?)?;
                for (i, (_, text)) in texts.iter().enumerate() {
                    feature.set_field_string(i, text)?;
                }
                for (i, (_, value)) in numbers.iter().enumerate().filter(|(_, n)| n.1.is_finite()) {
                    feature.set_field_double(i + offset, *value)?;
                }
                feature.create(&layer)?;
            }
            Ok(dataset.close()?)
        };
        encode(temporary, make).map_err(|e| WriteError::new(path, e))
    })
}

/// For each cell of a grid, row by row, whether its centre lies inside of the polygons of a vector file; `None` if the file
/// is not a vector file.
///
/// # Errors
/// [`VectorError::Mask`] if it has no CRS or no polygon.
pub fn inside_polygons(path: &Path, grid: &MapGrid) -> Result<Option<Vec<bool>>, VectorError> {
    set_up_gdal();
    let flags = GdalOpenFlags::GDAL_OF_VECTOR;
    let options = DatasetOptions { open_flags: flags, ..DatasetOptions::default() };
    let Ok(vector) = Dataset::open_ex(path, options) else { return Ok(None) };
    let burn = || -> Result<Option<Vec<bool>>, Cause> {
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
        let mut burnt = memory_dataset(grid.width, grid.height, &[&cells], None)?;
        burnt.set_geo_transform(&grid.geo_transform())?;
        rasterize(&mut burnt, &[1], &polygons, &vec![1.0; polygons.len()], None)?;
        let size = (grid.width, grid.height);
        let cells = burnt.rasterband(1)?.read_as::<u8>((0, 0), size, size, None)?.into_shape_and_vec().1;
        Ok(Some(cells.into_iter().map(|c| c != 0).collect()))
    };
    burn().map_err(|cause| VectorError::Mask { path: path.into(), cause })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_features_give_the_same_bytes_at_any_time() {
        let dir = tempfile::tempdir().unwrap();
        let square = vec![(5.0, 43.0), (5.1, 43.0), (5.1, 43.1)];
        let outline = Outline { name: "a".into(), ring: square, numbers: vec![("gsd_m", 0.5)] };
        let marker = Marker { place: [5.0, 43.0, 100.0], numbers: vec![("views", 3.0)] };
        let written = |name: &str| {
            let path = dir.path().join(name);
            write_outlines(&path, "footprints", std::slice::from_ref(&outline)).unwrap();
            let outlines = std::fs::read(&path).unwrap();
            write_markers(&path, "points", std::slice::from_ref(&marker)).unwrap();
            [outlines, std::fs::read(&path).unwrap()]
        };
        for kind in ["gpkg", "geojson"] {
            let first = written(&format!("first.{kind}"));
            // This is longer than the resolution of the time stamps of GeoPackages.
            std::thread::sleep(std::time::Duration::from_millis(20));
            assert!(first == written(&format!("second.{kind}")), "{kind}");
        }
    }

    #[test]
    fn lines_and_polygons_keep_their_map_and_attributes() {
        let dir = tempfile::tempdir().unwrap();
        let feature = MapFeature {
            corners: vec![(435_000.0, 3_354_000.0), (435_100.0, 3_354_000.0), (435_100.0, 3_354_100.0)],
            texts: vec![("first", "x000_y000".into()), ("second", "x001_y000".into())],
            numbers: vec![("step_m", -0.25), ("nmad_m", f64::NAN)],
        };
        for (shape, area) in [(MapShape::Line, 0.0), (MapShape::Polygon, 5000.0)] {
            let path = dir.path().join("seams.gpkg");
            write_map_features(&path, "seams", 32617, shape, std::slice::from_ref(&feature)).unwrap();
            let read = Dataset::open(&path).unwrap();
            let mut layer = read.layer_by_name("seams").unwrap();
            assert_eq!(layer.spatial_ref().unwrap().auth_code().unwrap(), 32617);
            let found = layer.features().next().unwrap();
            let field = |name: &str| found.field(found.field_index(name).unwrap()).unwrap();
            assert_eq!(field("second").and_then(|v| v.into_string()).as_deref(), Some("x001_y000"));
            assert_eq!(field("step_m").and_then(|v| v.into_real()), Some(-0.25));
            assert!(field("nmad_m").is_none());
            let geometry = found.geometry().unwrap();
            assert!((geometry.area() - area).abs() < 1e-6, "a line has no area");
        }
    }
}
