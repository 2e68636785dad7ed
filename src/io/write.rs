//! Writing of rasters: Cloud-Optimized GeoTIFFs, sensor images with an RPC tag, PNGs. All files are written atomically.

use super::atomic::{write_atomically, write_file};
use super::gdal_setup::set_up_gdal;
use super::{Cause, Grid2, ImageFile, MapGrid, RasterError, VerticalReference, WriteError};
use gdal::raster::{Buffer, ColorInterpretation, GdalType, RasterBand, RasterCreationOptions};
use gdal::spatial_ref::SpatialRef;
use gdal::vsi::get_vsi_mem_file_bytes_owned;
use gdal::{Dataset, DriverManager, Metadata};
use image::ImageEncoder;
use std::path::Path;

/// Number of rows that are passed to GDAL at a time.
const ROWS_AT_ONCE: usize = 256;
/// Descriptions of the bands of a colour image.
const COLORS: [(&str, ColorInterpretation); 3] = [
    ("red", ColorInterpretation::RedBand),
    ("green", ColorInterpretation::GreenBand),
    ("blue", ColorInterpretation::BlueBand),
];

/// A georeferenced raster to be written as a Cloud-Optimized GeoTIFF.
#[derive(Clone, Copy)]
pub struct Cog<'a> {
    /// The map grid, of which all bands have the size.
    pub grid: MapGrid,
    /// Metadata items of the default domain.
    pub metadata: &'a [(&'a str, String)],
    /// Vertical reference of the heights, if it holds heights; it is written to the CRS and to the metadata.
    pub heights_from: Option<&'a VerticalReference>,
}

impl Cog<'_> {
    /// Writes float32 bands, each with its description and unit; nodata is NaN.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write_f32(&self, path: &Path, bands: &[(&str, &str, &Grid2)]) -> Result<(), WriteError> {
        let data: Vec<_> = bands.iter().map(|b| b.2.data.as_slice()).collect();
        let labels: Vec<_> = bands.iter().map(|b| (b.0, b.1)).collect();
        self.write(path, &data, Some(f64::NAN), &labels, "FLOATING_POINT")
    }

    /// Writes 8-bit bands, each row by row; three bands are red, green and blue.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write_u8(&self, path: &Path, bands: Vec<Vec<u8>>, nodata: Option<f64>) -> Result<(), WriteError> {
        let data: Vec<_> = bands.iter().map(Vec::as_slice).collect();
        self.write(path, &data, nodata, color_labels(data.len()), "STANDARD")
    }

    fn write<T: GdalType + Copy>(
        &self,
        path: &Path,
        bands: &[&[T]],
        nodata: Option<f64>,
        labels: &[(&str, &str)],
        predictor: &str,
    ) -> Result<(), WriteError> {
        write_by(path, |temporary| {
            let mut memory = memory_dataset(self.grid.width, self.grid.height, bands, nodata)?;
            memory.set_geo_transform(&self.grid.geo_transform())?;
            let vertical = self.heights_from.and_then(VerticalReference::epsg).map(|code| format!("+{code}"));
            let crs = format!("EPSG:{}{}", self.grid.epsg, vertical.unwrap_or_default());
            memory.set_spatial_ref(&SpatialRef::from_definition(&crs)?)?;
            memory.set_metadata_item("TIFFTAG_SOFTWARE", concat!("satgs ", env!("CARGO_PKG_VERSION")), "")?;
            for (key, value) in self.metadata {
                memory.set_metadata_item(key, value, "")?;
            }
            if let Some(vertical) = self.heights_from {
                memory.set_metadata_item(VerticalReference::ITEM, vertical.name(), "")?;
            }
            label(&memory, labels)?;
            keep_statistics(&memory)?;
            copy_as(&memory, "COG", temporary, &cog_options(predictor))
        })
    }
}

/// An image in sensor geometry to be written: it has an RPC and no geotransform.
pub struct SensorImage<'a> {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Keys and values of the RPC domain, with the names of RPC00B.
    pub rpc: &'a [(String, String)],
    /// Metadata items of the default domain.
    pub metadata: &'a [(String, String)],
}

impl SensorImage<'_> {
    /// Writes 8-bit bands, each row by row, as a GeoTIFF with an RPC tag; three bands are red, green and blue.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write_u8(&self, path: &Path, bands: Vec<Vec<u8>>) -> Result<(), WriteError> {
        self.write_levels(path, &bands, None)
    }

    /// Writes bands of any type of numbers, with a nodata value if there is one; otherwise as [`SensorImage::write_u8`].
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write_levels<T: GdalType + Copy>(
        &self,
        path: &Path,
        bands: &[Vec<T>],
        nodata: Option<f64>,
    ) -> Result<(), WriteError> {
        let data: Vec<_> = bands.iter().map(Vec::as_slice).collect();
        self.write(path, &data, nodata, color_labels(data.len()))
    }

    /// Writes float32 bands, each with its description and unit, as a GeoTIFF with an RPC tag; nodata is NaN.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write_f32(&self, path: &Path, bands: &[(&str, &str, &Grid2)]) -> Result<(), WriteError> {
        let data: Vec<_> = bands.iter().map(|b| b.2.data.as_slice()).collect();
        self.write(path, &data, Some(f64::NAN), &bands.iter().map(|b| (b.0, b.1)).collect::<Vec<_>>())
    }

    fn write<T: GdalType + Copy>(
        &self,
        path: &Path,
        bands: &[&[T]],
        nodata: Option<f64>,
        labels: &[(&str, &str)],
    ) -> Result<(), WriteError> {
        write_by(path, |temporary| {
            let mut memory = memory_dataset(self.width, self.height, bands, nodata)?;
            label(&memory, labels)?;
            for (key, value) in self.rpc {
                memory.set_metadata_item(key, value, "RPC")?;
            }
            for (key, value) in self.metadata {
                memory.set_metadata_item(key, value, "")?;
            }
            copy_as(&memory, "GTiff", temporary, &[("COMPRESS", "DEFLATE"), ("PROFILE", "GDALGeoTIFF")])
        })
    }
}

/// Copies an image to a GeoTIFF with another RPC tag; the whole copy is held in memory. `rpc` holds keys and values of the
/// RPC domain, with the names of RPC00B.
///
/// # Errors
/// [`RasterError`] if the image cannot be read or the copy cannot be written.
pub fn write_with_rpc(image: &Path, out: &Path, rpc: &[(String, String)]) -> Result<(), RasterError> {
    let source = ImageFile::open(image)?;
    let written = write_by(out, |temporary| {
        // Metadata are set on a virtual copy, because GDAL would store those set on the image in a file beside it.
        let vrt = DriverManager::get_driver_by_name("VRT")?;
        let mut copy = source.dataset.create_copy(&vrt, "", &RasterCreationOptions::default())?;
        for (key, value) in rpc {
            copy.set_metadata_item(key, value, "RPC")?;
        }
        let options = [("COMPRESS", "DEFLATE"), ("PROFILE", "GDALGeoTIFF"), ("BIGTIFF", "IF_SAFER")];
        copy_as(&copy, "GTiff", temporary, &options)
    });
    Ok(written?)
}

/// Copies a map to a Cloud-Optimized GeoTIFF that is translated by metres east, north and up. `up` is added to the first
/// band, which must hold heights unless `up` is zero.
///
/// # Errors
/// [`RasterError`] if the map cannot be read or the copy cannot be written.
pub fn write_moved(map: &Path, out: &Path, [east, north, up]: [f64; 3]) -> Result<(), RasterError> {
    let source = ImageFile::open(map)?;
    let grid = source.map_grid()?;
    let moved = MapGrid { west: grid.west + east, north: grid.north + north, ..grid };
    let written = write_by(out, |temporary| {
        let memory = DriverManager::get_driver_by_name("MEM")?;
        let mut copy = source.dataset.create_copy(&memory, "", &RasterCreationOptions::default())?;
        copy.set_geo_transform(&moved.geo_transform())?;
        for i in 1..=copy.raster_count() {
            // The memory driver does not copy descriptions and units.
            let mut band = copy.rasterband(i)?;
            band.set_description(&source.dataset.rasterband(i)?.description()?)?;
            set_unit(&band, &source.unit(i)?)?;
        }
        let mut band = copy.rasterband(1)?;
        if up != 0.0 {
            let size = copy.raster_size();
            let mut heights = band.read_as::<f32>((0, 0), size, size, None)?;
            heights.data_mut().iter_mut().for_each(|v| *v = (f64::from(*v) + up) as f32);
            band.write((0, 0), size, &mut heights)?;
            for item in ["STATISTICS_MINIMUM", "STATISTICS_MAXIMUM", "STATISTICS_MEAN"] {
                if let Some(v) = band.metadata_item(item, "").and_then(|v| v.parse::<f64>().ok()) {
                    band.set_metadata_item(item, &(v + up).to_string(), "")?;
                }
            }
        }
        let predictor = if band.band_type().is_floating() { "FLOATING_POINT" } else { "STANDARD" };
        copy_as(&copy, "COG", temporary, &cog_options(predictor))
    });
    Ok(written?)
}

/// Creation options of Cloud-Optimized GeoTIFFs.
pub(super) fn cog_options(predictor: &str) -> [(&'static str, String); 6] {
    [
        ("NUM_THREADS", rayon::current_num_threads().to_string()),
        ("COMPRESS", "DEFLATE".into()),
        ("PREDICTOR", predictor.into()),
        ("BLOCKSIZE", "256".into()),
        ("OVERVIEWS", "IGNORE_EXISTING".into()),
        ("RESAMPLING", "AVERAGE".into()),
    ]
}

pub(super) fn memory_dataset<T: GdalType + Copy>(
    width: usize,
    height: usize,
    bands: &[&[T]],
    nodata: Option<f64>,
) -> gdal::errors::Result<Dataset> {
    set_up_gdal();
    let driver = DriverManager::get_driver_by_name("MEM")?;
    let dataset = driver.create_with_band_type::<T, _>("", width, height, bands.len())?;
    for (i, data) in bands.iter().enumerate() {
        let mut band = dataset.rasterband(i + 1)?;
        // Blocks of rows are written because the buffer of the `gdal` crate is a copy.
        for (k, rows) in data.chunks(width * ROWS_AT_ONCE).enumerate() {
            let size = (width, rows.len() / width);
            band.write((0, (k * ROWS_AT_ONCE) as isize), size, &mut Buffer::new(size, rows.to_vec()))?;
        }
        band.set_no_data_value(nodata)?;
    }
    Ok(dataset)
}

/// Writes a file atomically by a function that may fail with any error.
pub(super) fn write_by(path: &Path, make: impl FnOnce(&Path) -> Result<(), Cause>) -> Result<(), WriteError> {
    write_atomically(path, |temporary| make(temporary).map_err(|e| WriteError::new(path, e)))
}

/// Encodes a file with GDAL in memory and writes the bytes, because GDAL does not report a full disk.
///
/// `path` must be unique, as temporary names are.
pub(super) fn encode(path: &Path, write: impl FnOnce(&Path) -> Result<(), Cause>) -> Result<(), Cause> {
    let encoded = Path::new("/vsimem").join(path.strip_prefix("/").unwrap_or(path));
    write(&encoded)?;
    Ok(std::fs::write(path, get_vsi_mem_file_bytes_owned(&encoded)?)?)
}

pub(super) fn copy_as(
    memory: &Dataset,
    driver: &str,
    path: &Path,
    options: &[(&str, impl std::fmt::Display)],
) -> Result<(), Cause> {
    encode(path, |encoded| copy_to_disk(memory, driver, encoded, options))
}

/// As [`copy_as`], but the file is not held in memory, and an error of the disk may go unnoticed.
pub(super) fn copy_to_disk(
    dataset: &Dataset,
    driver: &str,
    path: &Path,
    options: &[(&str, impl std::fmt::Display)],
) -> Result<(), Cause> {
    let driver = DriverManager::get_driver_by_name(driver)?;
    let options: RasterCreationOptions = options.iter().map(|(k, v)| format!("{k}={v}")).collect();
    Ok(dataset.create_copy(&driver, path, &options)?.close()?)
}

/// Has GDAL store statistics in the metadata of the bands; a band without data has none.
pub(super) fn keep_statistics(dataset: &Dataset) -> gdal::errors::Result<()> {
    for i in 1..=dataset.raster_count() {
        let _ = dataset.rasterband(i)?.get_statistics(true, false);
    }
    Ok(())
}

/// Descriptions, without units, of the bands of an 8-bit image.
fn color_labels(bands: usize) -> &'static [(&'static str, &'static str)] {
    if bands == COLORS.len() { &[("red", ""), ("green", ""), ("blue", "")] } else { &[] }
}

/// Sets descriptions, units and colour interpretations of bands; a single band is grey.
pub(super) fn label(dataset: &Dataset, labels: &[(&str, &str)]) -> gdal::errors::Result<()> {
    if dataset.raster_count() == 1 {
        dataset.rasterband(1)?.set_color_interpretation(ColorInterpretation::GrayIndex)?;
    }
    for (i, (description, unit)) in labels.iter().enumerate() {
        let mut band = dataset.rasterband(i + 1)?;
        band.set_description(description)?;
        set_unit(&band, unit)?;
        if let Some((_, color)) = COLORS.into_iter().find(|c| c.0 == *description) {
            band.set_color_interpretation(color)?;
        }
    }
    Ok(())
}

/// Sets the unit of a band, for which the `gdal` crate has no function.
#[allow(unsafe_code)]
fn set_unit(band: &RasterBand, unit: &str) -> gdal::errors::Result<()> {
    let unit = std::ffi::CString::new(unit)?;
    // SAFETY: the band outlives the call, and GDAL copies the string.
    unsafe { gdal_sys::GDALSetRasterUnitType(band.c_rasterband(), unit.as_ptr()) };
    Ok(())
}

/// Writes an 8-bit RGB image as PNG; `rgb` holds three bytes per pixel, row by row.
///
/// # Errors
/// [`WriteError`] if the file cannot be written, or the number of bytes is wrong.
pub fn write_png_rgb(path: &Path, width: usize, height: usize, rgb: &[u8]) -> Result<(), WriteError> {
    write_png(path, width, height, rgb, image::ExtendedColorType::Rgb8)
}

/// Writes an 8-bit grey image as PNG; `gray` holds one byte per pixel, row by row.
///
/// # Errors
/// [`WriteError`] if the file cannot be written, or the number of bytes is wrong.
pub fn write_png_gray(path: &Path, width: usize, height: usize, gray: &[u8]) -> Result<(), WriteError> {
    write_png(path, width, height, gray, image::ExtendedColorType::L8)
}

/// Writes a 16-bit grey image as PNG; `gray` holds one number per pixel, row by row.
///
/// # Errors
/// [`WriteError`] if the file cannot be written, or the number of values is wrong.
pub fn write_png_gray16(path: &Path, width: usize, height: usize, gray: &[u16]) -> Result<(), WriteError> {
    // The encoder takes numbers in the order of bytes of the machine.
    let bytes: Vec<u8> = gray.iter().flat_map(|v| v.to_ne_bytes()).collect();
    write_png(path, width, height, &bytes, image::ExtendedColorType::L16)
}

fn write_png(
    path: &Path,
    width: usize,
    height: usize,
    data: &[u8],
    color: image::ExtendedColorType,
) -> Result<(), WriteError> {
    write_file(path, png(width, height, data, color).map_err(|e| WriteError::new(path, e))?)
}

/// The bytes of a PNG file of an 8-bit RGB image; `rgb` holds three bytes per pixel, row by row.
///
/// # Errors
/// [`RasterError::Encode`] if the number of bytes is not three per pixel.
pub fn png_rgb(width: usize, height: usize, rgb: &[u8]) -> Result<Vec<u8>, RasterError> {
    png(width, height, rgb, image::ExtendedColorType::Rgb8).map_err(|cause| RasterError::Encode {
        width,
        height,
        cause,
    })
}

fn png(width: usize, height: usize, data: &[u8], color: image::ExtendedColorType) -> Result<Vec<u8>, Cause> {
    // The encoder would panic for a wrong number of bytes.
    if data.len() * 8 != width * height * usize::from(color.bits_per_pixel()) {
        return Err(format!("{} bytes for {width} x {height} pixels", data.len()).into());
    }
    let mut bytes = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    encoder.write_image(data, width as u32, height as u32, color)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::super::ImageFile;
    use super::*;

    fn grid() -> MapGrid {
        MapGrid { epsg: 32617, west: 436_000.0, north: 3_357_700.0, cell: 0.5, width: 600, height: 300 }
    }

    #[test]
    fn a_round_trip_keeps_grid_values_and_nodata() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("dsm.tif");
        let mut raster = Grid2::from_fn(600, 300, |c, r| c as f32 * 0.1 - r as f32);
        raster.data[7] = f32::NAN;
        let cog = Cog { grid: grid(), metadata: &[], heights_from: Some(&VerticalReference::Ellipsoid) };
        cog.write_f32(&path, &[("height", "m", &raster)]).unwrap();
        let file = ImageFile::open(&path).unwrap();
        assert_eq!(file.map_grid().unwrap(), grid());
        assert_eq!(file.metadata(VerticalReference::ITEM, "").unwrap(), "WGS 84 ellipsoid");
        assert_eq!(file.metadata("LAYOUT", "IMAGE_STRUCTURE").unwrap(), "COG");
        let back = file.read(1).unwrap();
        assert!(back.data[7].is_nan());
        assert_eq!(back.data[8..], raster.data[8..]);
        let names: Vec<_> = std::fs::read_dir(dir.path()).unwrap().collect();
        assert_eq!(names.len(), 1, "nothing but the file itself: {names:?}");
    }

    #[test]
    fn a_translated_map_keeps_all_but_its_position_and_its_heights() {
        let dir = tempfile::tempdir().unwrap();
        let (path, out) = (dir.path().join("dsm.tif"), dir.path().join("moved.tif"));
        let mut raster = Grid2::from_fn(600, 300, |c, r| c as f32 * 0.1 - r as f32);
        raster.data[7] = f32::NAN;
        let cog = Cog { grid: grid(), metadata: &[], heights_from: Some(&VerticalReference::Ellipsoid) };
        cog.write_f32(&path, &[("height", "m", &raster), ("score", "", &raster)]).unwrap();
        write_moved(&path, &out, [1.25, -0.5, 3.5]).unwrap();
        let file = ImageFile::open(&out).unwrap();
        let expected = MapGrid { west: grid().west + 1.25, north: grid().north - 0.5, ..grid() };
        assert_eq!(file.map_grid().unwrap(), expected);
        assert_eq!(file.metadata(VerticalReference::ITEM, "").unwrap(), "WGS 84 ellipsoid");
        assert_eq!(file.metadata("LAYOUT", "IMAGE_STRUCTURE").unwrap(), "COG");
        assert_eq!(file.unit(1).unwrap(), "m");
        assert_eq!(file.dataset.rasterband(2).unwrap().description().unwrap(), "score");
        let (heights, scores) = (file.read(1).unwrap(), file.read(2).unwrap());
        assert!(heights.data[7].is_nan());
        assert_eq!(heights.data[8], raster.data[8] + 3.5);
        assert_eq!(scores.data[8..], raster.data[8..]);
        let highest: f64 = file
            .dataset
            .rasterband(1)
            .unwrap()
            .metadata_item("STATISTICS_MAXIMUM", "")
            .unwrap()
            .parse()
            .unwrap();
        assert!((highest - 59.9 - 3.5).abs() < 1e-3, "{highest}");
    }

    #[test]
    fn three_8_bit_bands_are_red_green_and_blue_also_after_a_copy() {
        use ColorInterpretation::{AlphaBand, BlueBand, GrayIndex, GreenBand, RedBand};
        let dir = tempfile::tempdir().unwrap();
        let colors = |path: &Path| -> Vec<ColorInterpretation> {
            let file = ImageFile::open(path).unwrap();
            (1..=file.bands()).map(|i| file.dataset.rasterband(i).unwrap().color_interpretation()).collect()
        };
        let path = |name: &str| dir.path().join(name);
        let cog = Cog { grid: grid(), metadata: &[], heights_from: None };
        let band = vec![7u8; 600 * 300];
        let rgb = [RedBand, GreenBand, BlueBand];
        cog.write_u8(&path("ortho.tif"), vec![band.clone(); 3], Some(0.0)).unwrap();
        assert_eq!(colors(&path("ortho.tif")), rgb);
        write_moved(&path("ortho.tif"), &path("moved.tif"), [1.0, 1.0, 0.0]).unwrap();
        assert_eq!(colors(&path("moved.tif")), rgb);
        cog.write_u8(&path("hillshade.tif"), vec![band.clone()], Some(255.0)).unwrap();
        assert_eq!(colors(&path("hillshade.tif")), [GrayIndex]);
        let image = SensorImage { width: 600, height: 300, rpc: &[], metadata: &[] };
        image.write_u8(&path("image.tif"), vec![band.clone(); 3]).unwrap();
        assert_eq!(colors(&path("image.tif")), rgb);
        let raster = Grid2::filled(600, 300, 0.5);
        let bands =
            [("red", "", &raster), ("green", "", &raster), ("blue", "", &raster), ("height", "m", &raster)];
        cog.write_f32(&path("picture.tif"), &bands).unwrap();
        assert_eq!(colors(&path("picture.tif"))[..3], rgb);
        assert_ne!(colors(&path("picture.tif"))[3], AlphaBand, "heights are not opacity");
        image.write_f32(&path("view.tif"), &bands).unwrap();
        assert_eq!(colors(&path("view.tif"))[..3], rgb);
        assert_ne!(colors(&path("view.tif"))[3], AlphaBand, "heights are not opacity");
        cog.write_f32(
            &path("confidence.tif"),
            &[("opacity", "", &raster), ("spread", "m", &raster), ("views", "", &raster)],
        )
        .unwrap();
        assert!(!colors(&path("confidence.tif")).iter().any(|c| rgb.contains(c)));
    }
}
