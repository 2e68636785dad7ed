//! Unit and vertical reference of heights in files. All readers of heights use this module: for rasters it looks at the
//! band's unit, the compound CRS and the metadata, for point clouds at the CRS.

use super::crs::vertical_part;
use super::height_unit::{VerticalPart, metres_of};
use super::{Grid2, ImageFile, RasterError, VerticalReference, Window};
use gdal::Metadata;
use gdal::raster::ColorInterpretation;
use gdal::spatial_ref::SpatialRef;

/// Stored values that mean no data although the file does not declare them; so do values of the magnitude below.
const UNDECLARED_NODATA: [f32; 5] = [-9999.0, -32767.0, -32768.0, -99_999.0, -999_999.0];
const NO_HEIGHT: f32 = 1e30;
/// Descriptions of the first bands of satgs' rasters that are no heights above a vertical reference: `confidence.tif`,
/// `error.tif` and `ndsm.tif`.
const OTHER_BANDS: [&str; 3] = ["opacity", "error", "height above ground"];
/// GeoTIFF key of the vertical unit, and the EPSG codes of metre, foot and US survey foot.
const VERTICAL_UNITS_KEY: u16 = 4099;
const UNIT_CODES: [(u16, &str); 3] = [(9001, "metre"), (9002, "foot"), (9003, "US survey foot")];

/// Unit and vertical reference of a file's heights.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightSystem {
    /// Unit as the file names it; empty if it names none.
    pub unit: String,
    /// Metres per unit; 1 if the file names no unit.
    pub metres: f64,
    /// Vertical reference as [`VerticalReference::read`] takes it (`ellipsoid`, `EGM96`), or the name of an unknown
    /// datum (`NAVD88 height`); none if the file states none.
    pub from: Option<String>,
}

impl HeightSystem {
    /// Unit and vertical reference of a raster's first band.
    ///
    /// # Errors
    /// [`RasterError::NotHeights`] for colours, classes, shades and scores, [`RasterError::HeightUnit`] for an unknown unit.
    pub fn of_raster(file: &ImageFile) -> Result<Self, RasterError> {
        file.require_heights()?;
        let crs = file.dataset.spatial_ref().ok().map(|srs| vertical_part(&srs)).unwrap_or_default();
        let unit = file.unit(1)?;
        let metres =
            if unit.is_empty() { crs.metres.or_else(|| metres_of(&crs.unit)) } else { metres_of(&unit) };
        let unit = if unit.is_empty() { crs.unit } else { unit };
        let metres =
            metres.ok_or_else(|| RasterError::HeightUnit { path: file.path().into(), unit: unit.clone() })?;
        let item = file.metadata(VerticalReference::ITEM, "").filter(|item| !item.trim().is_empty());
        Ok(Self { unit, metres, from: item.map(|item| VerticalReference::known_name(&item)).or(crs.from) })
    }

    /// Unit and vertical reference of a point cloud, from its CRS as WKT or GeoTIFF keys.
    #[must_use]
    pub fn of_cloud(header: &las::Header) -> Self {
        super::gdal_setup::set_up_gdal();
        let wkt = header.get_wkt_crs_bytes().map(String::from_utf8_lossy);
        let srs = wkt.and_then(|w| SpatialRef::from_wkt(w.trim_end_matches('\0')).ok());
        let part = srs.map(|srs| vertical_part(&srs)).unwrap_or_else(|| of_geotiff_keys(header));
        Self { metres: part.metres.unwrap_or(1.0), unit: part.unit, from: part.from }
    }

    /// The unit, if heights in the file are not in metres.
    #[must_use]
    pub fn converted_from(&self) -> Option<String> {
        ((self.metres - 1.0).abs() > 1e-12).then(|| self.unit.clone())
    }
}

fn of_geotiff_keys(header: &las::Header) -> VerticalPart {
    let Some(keys) = header.get_geotiff_crs().ok().flatten() else { return VerticalPart::default() };
    let number = |id: u16| {
        keys.entries.iter().find(|e| e.id == id).and_then(|e| match e.data {
            las::crs::GeoTiffData::U16(v) => Some(v),
            _ => None,
        })
    };
    let code = keys.get_vertical_crs_geo_key_value().filter(|c| *c != 0 && *c != 32767);
    let mut part = code.map(|code| of_geotiff_code(u32::from(code))).unwrap_or_default();
    let unit = number(VERTICAL_UNITS_KEY).and_then(|c| UNIT_CODES.iter().find(|u| u.0 == c));
    if let Some((_, unit)) = unit {
        (part.unit, part.metres) = ((*unit).into(), metres_of(unit));
    }
    part
}

/// Meaning of a code of the vertical CRS: one of GeoTIFF 1.0 for heights above an ellipsoid, or one of EPSG.
fn of_geotiff_code(code: u32) -> VerticalPart {
    if (5001..=5033).contains(&code) {
        return VerticalPart { from: Some(VerticalReference::ELLIPSOID.into()), ..VerticalPart::default() };
    }
    SpatialRef::from_epsg(code).map(|srs| vertical_part(&srs)).unwrap_or_default()
}

/// Reads a window of the first band as heights in metres, averaged down by the smallest whole factor for which no side
/// is longer than `longest`; NaN where there is no data. Also returns the factor, and the number of nodata values that
/// the file does not declare.
///
/// # Errors
/// [`RasterError`] if the band cannot be read, or its unit is unknown.
pub fn read_heights(
    file: &ImageFile,
    window: Window,
    longest: usize,
) -> Result<(Grid2, usize, usize), RasterError> {
    let metres = HeightSystem::of_raster(file)?.metres;
    let factor = window.width.max(window.height).div_ceil(longest.max(1)).max(1);
    let (width, height) = (window.width.div_ceil(factor), window.height.div_ceil(factor));
    let (mut data, mut undeclared) = (Vec::with_capacity(width * height), 0);
    // GDAL's own averages would take an undeclared nodata value for a height.
    let rows_at_once = if factor == 1 { window.height } else { factor };
    for first in (0..window.height).step_by(rows_at_once.max(1)) {
        let rows = rows_at_once.min(window.height - first);
        let (strip, found) = file.read_values(Window { row: window.row + first, height: rows, ..window })?;
        undeclared += found;
        if factor == 1 {
            data = strip.data;
            continue;
        }
        for col in 0..width {
            let cols = col * factor..((col + 1) * factor).min(window.width);
            let cells = (0..rows).flat_map(|row| cols.clone().map(move |c| (c, row)));
            let valid = cells.map(|(c, r)| strip.at(c, r)).filter(|v| !v.is_nan());
            let (sum, n) = valid.fold((0.0, 0u32), |(sum, n), v| (sum + f64::from(v), n + 1));
            data.push((sum / f64::from(n)) as f32);
        }
    }
    if (metres - 1.0).abs() > 1e-12 {
        data.iter_mut().for_each(|v| *v = (f64::from(*v) * metres) as f32);
    }
    Ok((Grid2 { width, height, data }, factor, undeclared))
}

impl ImageFile {
    /// An error if the first band declares that it holds something else than heights. Colours and class codes differ from a
    /// surface model as an error of metres does, so that no later check would find them.
    pub(crate) fn require_heights(&self) -> Result<(), RasterError> {
        let band = self.dataset.rasterband(1).map_err(|_| self.no_band(1))?;
        let refused = |found: String| Err(RasterError::NotHeights { path: self.path().into(), found });
        let description = band.description().unwrap_or_default().to_lowercase();
        if !matches!(
            band.color_interpretation(),
            ColorInterpretation::Undefined | ColorInterpretation::GrayIndex
        ) {
            return refused(format!("its first of {} bands holds colours", self.bands()));
        }
        if OTHER_BANDS.contains(&description.as_str()) {
            return refused(format!("its first band is called `{description}`"));
        }
        if self.band(1)?.is_byte && band.unit().is_empty() {
            return refused(
                "it has values of 8 bits without a unit, as a picture, a hillshade or a class raster".into(),
            );
        }
        Ok(())
    }

    /// A window of the first band with scale and offset applied and NaN for no data; and the number of nodata values
    /// that the file does not declare.
    fn read_values(&self, window: Window) -> Result<(Grid2, usize), RasterError> {
        let mut raster = self.read_stored(1, window, (window.width, window.height))?;
        let nodata = self.band(1)?.nodata.map(|v| v as f32);
        let mut undeclared = 0;
        for v in &mut raster.data {
            if nodata == Some(*v) {
                *v = f32::NAN;
            } else if v.abs() >= NO_HEIGHT || UNDECLARED_NODATA.contains(v) {
                *v = f32::NAN;
                undeclared += 1;
            }
        }
        self.apply_scale(1, &mut raster)?;
        Ok((raster, undeclared))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::{Cog, MapGrid};

    const GRID: MapGrid =
        MapGrid { epsg: 32631, west: 700_000.0, north: 4_800_000.0, cell: 1.0, width: 40, height: 30 };

    fn written(unit: &str, vertical: Option<&str>, value: impl Fn(usize, usize) -> f32) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let metadata: Vec<(&str, String)> =
            vertical.map(|v| (VerticalReference::ITEM, v.to_owned())).into_iter().collect();
        let cog = Cog { grid: GRID, metadata: &metadata, heights_from: None };
        let raster = Grid2::from_fn(GRID.width, GRID.height, value);
        cog.write_f32(&folder.path().join("h.tif"), &[("height", unit, &raster)]).unwrap();
        folder
    }

    fn opened(folder: &tempfile::TempDir) -> ImageFile {
        ImageFile::open(&folder.path().join("h.tif")).unwrap()
    }

    const ALL: Window = Window { col: 0, row: 0, width: 40, height: 30 };

    #[test]
    fn feet_become_metres() {
        for (unit, metres) in [("", 1.0), ("metre", 1.0), ("ft", 0.3048), ("US survey foot", 1200.0 / 3937.0)]
        {
            let file = written(unit, None, |c, _| 100.0 + c as f32);
            let (raster, _, _) = read_heights(&opened(&file), ALL, 100).unwrap();
            assert!((f64::from(raster.at(7, 3)) - 107.0 * metres).abs() < 1e-4, "{unit}");
        }
        let fathoms = written("fathom", None, |_, _| 1.0);
        let error = HeightSystem::of_raster(&opened(&fathoms)).unwrap_err();
        assert!(matches!(error, RasterError::HeightUnit { .. }), "{error}");
    }

    #[test]
    fn a_raster_without_place_and_unit_is_in_metres() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("h.tif");
        let image = crate::io::SensorImage { width: 8, height: 8, rpc: &[], metadata: &[] };
        image.write_f32(&path, &[("", "", &Grid2::filled(8, 8, 7.0))]).unwrap();
        let system = HeightSystem::of_raster(&ImageFile::open(&path).unwrap()).unwrap();
        assert_eq!((system.metres, system.converted_from(), system.from), (1.0, None, None));
    }

    #[test]
    fn colors_classes_and_scores_are_no_heights() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("h.tif");
        let cells = || vec![7; GRID.width * GRID.height];
        let cog = Cog { grid: GRID, metadata: &[], heights_from: None };
        let refusal = || HeightSystem::of_raster(&ImageFile::open(&path).unwrap()).unwrap_err().to_string();
        cog.write_u8(&path, vec![cells(); 3], Some(0.0)).unwrap();
        assert!(refusal().contains("its first of 3 bands holds colours"), "{}", refusal());
        cog.write_u8(&path, vec![cells()], None).unwrap();
        assert!(refusal().contains("values of 8 bits without a unit"), "{}", refusal());
        let values = Grid2::from_fn(GRID.width, GRID.height, |c, _| c as f32);
        for (name, unit) in [("opacity", ""), ("error", "m"), ("height above ground", "m")] {
            cog.write_f32(&path, &[(name, unit, &values)]).unwrap();
            assert!(refusal().contains(name), "{}", refusal());
        }
    }

    #[test]
    fn the_metadata_item_states_the_reference() {
        for (item, from) in [
            ("WGS 84 ellipsoid", "ellipsoid"),
            ("EGM96", "EGM96"),
            ("EGM2008 height", "EGM2008"),
            ("EPSG:5773", "EGM96"),
            ("NAVD88", "NAVD88"),
        ] {
            let system = HeightSystem::of_raster(&opened(&written("m", Some(item), |_, _| 1.0))).unwrap();
            assert_eq!(system.from.as_deref(), Some(from));
        }
        assert_eq!(HeightSystem::of_raster(&opened(&written("m", None, |_, _| 1.0))).unwrap().from, None);
    }

    #[test]
    fn undeclared_nodata_is_left_out_also_where_cells_are_averaged() {
        for void in [-9999.0, -32768.0, f32::MIN, f32::MAX] {
            let file = written("m", None, |c, r| if (c, r) == (4, 5) { void } else { 50.0 });
            let (raster, factor, undeclared) = read_heights(&opened(&file), ALL, 10).unwrap();
            assert_eq!((raster.width, raster.height, factor, undeclared), (10, 8, 4, 1));
            assert!(raster.data.iter().all(|v| *v == 50.0), "{void}");
        }
    }

    #[test]
    fn geotiff_codes_state_reference_and_unit() {
        super::super::gdal_setup::set_up_gdal();
        assert_eq!(of_geotiff_code(5773).from.as_deref(), Some("EGM96"));
        assert_eq!(of_geotiff_code(5030).from.as_deref(), Some("ellipsoid"));
        let feet = of_geotiff_code(6360);
        assert_eq!(feet.from.as_deref(), Some("NAVD88 height (ftUS)"));
        assert!((feet.metres.unwrap() - 1200.0 / 3937.0).abs() < 1e-9);
    }
}
