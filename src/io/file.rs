//! Reading of rasters through GDAL: bands, metadata, position on the map.

use super::gdal_setup::{listing_is_off, remote_options, set_up_gdal, transform};
use super::{Cause, Grid2, MapGrid, NumberKind, RasterError, Window, vsi};
use crate::frame::{CornerPx, Pixel};
use gdal::raster::{GdalDataType, ResampleAlg};
use gdal::spatial_ref::SpatialRef;
use gdal::{Dataset, DatasetOptions, Metadata};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Largest number of pixels per byte of a file; a header that states more is damaged, as no codec compresses so much.
const MAX_PIXELS_PER_BYTE: u64 = 20_000;
/// Size in bytes below which this limit does not apply, because virtual rasters (VRT) are small files.
const SMALL_IS_SUSPECT_PIXELS: u64 = 1 << 24;

/// Size of values from which on they stand for missing ones, whatever a file declares: fill values of floats are ±3.4e38, 1e38 and
/// 9.97e36 (NetCDF), and no brightness or height comes near.
const LARGEST_VALUE: f32 = 1e30;

/// Whether a stored value can be a measurement: it is finite, and no usual fill value of floats.
#[must_use]
pub fn is_measurement(value: f32) -> bool {
    value.abs() < LARGEST_VALUE
}

/// An opened raster file.
pub struct ImageFile {
    path: PathBuf,
    pub(super) dataset: Dataset,
}

/// Properties of a band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandInfo {
    /// Whether values are 8-bit unsigned integers.
    pub is_byte: bool,
    /// The type of the values.
    pub kind: NumberKind,
    /// The declared nodata value.
    pub nodata: Option<f64>,
}

impl ImageFile {
    /// Opens a raster in any format of GDAL, on disk or in one of its virtual file systems ([`vsi`]).
    ///
    /// # Errors
    /// [`RasterError::Open`] if GDAL cannot open it, [`RasterError::Size`] if its size is not plausible.
    pub fn open(path: &Path) -> Result<Self, RasterError> {
        set_up_gdal();
        let refused = |cause: Cause| RasterError::Open { path: path.into(), cause };
        let bytes = vsi::size(path).map_err(|e| refused(e.into()))?;
        let dataset = open(path).map_err(|e| refused(e.into()))?;
        let (width, height) = dataset.raster_size();
        let size = |reason| RasterError::Size { path: path.into(), width, height, bytes, reason };
        let pixels = width as u64 * height as u64;
        if width < 2 || height < 2 || dataset.raster_count() == 0 {
            return Err(size("too small for an image"));
        }
        if pixels > SMALL_IS_SUSPECT_PIXELS && pixels / MAX_PIXELS_PER_BYTE > bytes {
            return Err(size("the file cannot hold that many pixels"));
        }
        Ok(Self { path: path.into(), dataset })
    }

    /// Path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of columns and rows.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        self.dataset.raster_size()
    }

    /// Number of bands.
    #[must_use]
    pub fn bands(&self) -> usize {
        self.dataset.raster_count()
    }

    /// Properties of a band, counted from 1.
    ///
    /// # Errors
    /// [`RasterError::NoBand`] if there is no such band.
    pub fn band(&self, index: usize) -> Result<BandInfo, RasterError> {
        let band = self.dataset.rasterband(index).map_err(|_| self.no_band(index))?;
        let stored = band.band_type();
        Ok(BandInfo {
            is_byte: stored == GdalDataType::UInt8,
            kind: match stored {
                GdalDataType::UInt16 => NumberKind::U16,
                _ if stored.is_integer() => NumberKind::Integer,
                _ => NumberKind::Float,
            },
            nodata: band.no_data_value(),
        })
    }

    /// Unit of the values of a band, counted from 1, as the file names it; empty if it names none.
    ///
    /// # Errors
    /// [`RasterError::NoBand`] if there is no such band.
    pub fn unit(&self, index: usize) -> Result<String, RasterError> {
        Ok(self.dataset.rasterband(index).map_err(|_| self.no_band(index))?.unit())
    }

    /// Reads one band, counted from 1; its nodata value, and what is no measurement ([`is_measurement`]), become NaN.
    ///
    /// # Errors
    /// [`RasterError::NoBand`] if there is no such band, [`RasterError::Read`] if the file is damaged or incomplete.
    pub fn read(&self, index: usize) -> Result<Grid2, RasterError> {
        let (width, height) = self.size();
        self.read_window(index, Window { col: 0, row: 0, width, height })
    }

    /// Reads a window of a band; otherwise as [`ImageFile::read`].
    ///
    /// # Errors
    /// As [`ImageFile::read`].
    pub fn read_window(&self, index: usize, window: Window) -> Result<Grid2, RasterError> {
        self.read_scaled(index, window, (window.width, window.height))
    }

    /// Reads a window of a band, downsampled by averaging to `size` (columns, rows); otherwise as [`ImageFile::read`].
    ///
    /// # Errors
    /// As [`ImageFile::read`].
    pub fn read_scaled(
        &self,
        index: usize,
        window: Window,
        size: (usize, usize),
    ) -> Result<Grid2, RasterError> {
        let mut raster = self.read_stored(index, window, size)?;
        if let Some(nodata) = self.band(index)?.nodata.filter(|v| !v.is_nan()) {
            let nodata = nodata as f32;
            raster.data.par_iter_mut().filter(|v| **v == nodata).for_each(|v| *v = f32::NAN);
        }
        if self.band(index)?.kind == NumberKind::Float {
            raster.data.par_iter_mut().filter(|v| !is_measurement(**v)).for_each(|v| *v = f32::NAN);
        }
        self.apply_scale(index, &mut raster)?;
        Ok(raster)
    }

    /// Applies scale and offset of a band to stored values. The nodata value refers to stored values.
    pub(super) fn apply_scale(&self, index: usize, raster: &mut Grid2) -> Result<(), RasterError> {
        let band = self.dataset.rasterband(index).map_err(|_| self.no_band(index))?;
        let (scale, offset) = (band.scale().unwrap_or(1.0), band.offset().unwrap_or(0.0));
        if (scale, offset) != (1.0, 0.0) && scale != 0.0 {
            raster.data.par_iter_mut().for_each(|v| *v = (f64::from(*v) * scale + offset) as f32);
        }
        Ok(())
    }

    /// As [`ImageFile::read_scaled`], but returns stored values: nodata is not replaced by NaN, and scale and offset are not
    /// applied.
    ///
    /// # Errors
    /// As [`ImageFile::read`].
    pub fn read_stored(
        &self,
        index: usize,
        window: Window,
        (width, height): (usize, usize),
    ) -> Result<Grid2, RasterError> {
        let band = self.dataset.rasterband(index).map_err(|_| self.no_band(index))?;
        let (from, size) = ((window.col as isize, window.row as isize), (window.width, window.height));
        let pixels = band
            .read_as::<f32>(from, size, (width, height), Some(ResampleAlg::Average))
            .map_err(|e| RasterError::Read { path: self.path.clone(), cause: e })?;
        Ok(Grid2 { width, height, data: pixels.into_shape_and_vec().1 })
    }

    /// A metadata item of a domain of GDAL: `""` is the default domain, others are `"RPC"`, `"IMAGE_STRUCTURE"`, …; `None`
    /// if there is no such item.
    #[must_use]
    pub fn metadata(&self, key: &str, domain: &str) -> Option<String> {
        self.dataset.metadata_item(key, domain)
    }

    /// All `KEY=VALUE` pairs of a metadata domain.
    #[must_use]
    pub fn metadata_domain(&self, domain: &str) -> Vec<(String, String)> {
        let lines = self.dataset.metadata_domain(domain).unwrap_or_default();
        lines.iter().filter_map(|l| l.split_once('=')).map(|(k, v)| (k.into(), v.into())).collect()
    }

    /// The XMP packet of a photograph, if it has one.
    #[must_use]
    pub fn xmp(&self) -> Option<String> {
        Some(self.dataset.metadata_domain("xml:XMP")?.join("\n"))
    }

    /// Checks that the file is complete by reading the last pixel of the last band.
    ///
    /// # Errors
    /// [`RasterError::Read`] if it cannot be read.
    pub fn check_complete(&self) -> Result<(), RasterError> {
        let (width, height) = self.size();
        let band = self.dataset.rasterband(self.bands()).map_err(|_| self.no_band(self.bands()))?;
        let last = (width as isize - 1, height as isize - 1);
        band.read_as::<f32>(last, (1, 1), (1, 1), None)
            .map(|_| ())
            .map_err(|e| RasterError::Read { path: self.path.clone(), cause: e })
    }

    /// Number of bits per stored value of the first band.
    #[must_use]
    pub fn bit_depth(&self) -> u32 {
        let stated = self.metadata("NBITS", "IMAGE_STRUCTURE").and_then(|b| b.parse().ok());
        let stored = || self.dataset.rasterband(1).map_or(0, |b| u32::from(b.band_type().bits()));
        stated.unwrap_or_else(stored)
    }

    /// GDAL's geotransform: the map position of the corner of the first pixel, and the steps of a column and of a row; `None` if
    /// the file has none.
    #[must_use]
    pub fn geotransform(&self) -> Option<[f64; 6]> {
        self.dataset.geo_transform().ok()
    }

    /// The CRS as WKT; empty if the file has none.
    #[must_use]
    pub fn crs_wkt(&self) -> String {
        self.dataset.projection()
    }

    /// Description of a band, counted from 1; empty if it has none.
    ///
    /// # Errors
    /// [`RasterError::NoBand`] if there is no such band.
    pub fn description(&self, index: usize) -> Result<String, RasterError> {
        let band = self.dataset.rasterband(index).map_err(|_| self.no_band(index))?;
        Ok(band.description().unwrap_or_default())
    }

    /// Whether the file has a geotransform and a CRS.
    #[must_use]
    pub fn has_geotransform(&self) -> bool {
        self.dataset.geo_transform().is_ok() && !self.dataset.projection().is_empty()
    }

    /// Whether the raster is a map, as orthorectified images are: it has a CRS and a north-up geotransform.
    ///
    /// The approximate position of a sensor image, as from the corners in the header of a NITF, is rotated and does not
    /// count.
    #[must_use]
    pub fn is_map(&self) -> bool {
        let north_up = self.dataset.geo_transform().is_ok_and(|t| t[2] == 0.0 && t[4] == 0.0);
        north_up && self.has_geotransform()
    }

    /// Column and row of the corner of the first pixel in a larger image, from a geotransform in pixels: without a CRS, with
    /// unit cells, and rows that count down or, as OTB writes them, up. `None` for other geotransforms.
    #[must_use]
    pub fn pixel_offset(&self) -> Option<(f64, f64)> {
        let t = self.dataset.geo_transform().ok()?;
        let counts = t[1] == 1.0 && t[5].abs() == 1.0 && t[2] == 0.0 && t[4] == 0.0;
        (counts && self.dataset.projection().is_empty()).then_some((t[0], t[3] * t[5]))
    }

    /// WGS 84 longitude and latitude of an image position, degrees; `None` if the image is not a map.
    #[must_use]
    pub fn lon_lat(&self, px: Pixel<CornerPx>) -> Option<(f64, f64)> {
        let t = self.is_map().then(|| self.dataset.geo_transform().ok())??;
        let (mut x, mut y) = ([t[0] + t[1] * px.col], [t[3] + t[5] * px.row]);
        let (from, to) = (self.dataset.spatial_ref().ok()?, SpatialRef::from_epsg(4326).ok()?);
        transform(from, to, &mut x, &mut y, &mut [])?;
        Some((x[0], y[0]))
    }

    /// Image positions of (longitude, latitude) in degrees, WGS 84; `None` if the image is not a map.
    #[must_use]
    pub fn px_of_lon_lats(&self, places_deg: &[(f64, f64)]) -> Option<Vec<Pixel<CornerPx>>> {
        let t = self.is_map().then(|| self.dataset.geo_transform().ok())??;
        let (mut x, mut y): (Vec<f64>, Vec<f64>) = places_deg.iter().copied().unzip();
        let (from, to) = (SpatialRef::from_epsg(4326).ok()?, self.dataset.spatial_ref().ok()?);
        transform(from, to, &mut x, &mut y, &mut [])?;
        Some(x.iter().zip(&y).map(|(x, y)| Pixel::new((x - t[0]) / t[1], (y - t[3]) / t[5])).collect())
    }

    /// The map grid of the raster.
    ///
    /// # Errors
    /// [`RasterError::NotAMap`] unless it is north-up with square cells in a projected CRS in metres with an EPSG code.
    pub fn map_grid(&self) -> Result<MapGrid, RasterError> {
        let not = |reason: &'static str| RasterError::NotAMap { path: self.path.clone(), reason };
        let t = self.dataset.geo_transform().map_err(|_| not("the raster has no geotransform"))?;
        let srs = self.dataset.spatial_ref().map_err(|_| not("the raster has no CRS"))?;
        if srs.is_geographic() {
            return Err(not("the raster's CRS is in degrees"));
        }
        if t[2] != 0.0 || t[4] != 0.0 || t[1] <= 0.0 || (t[1] + t[5]).abs() > 1e-6 * t[1] {
            return Err(not("the raster is not north-up with square cells"));
        }
        if (srs.linear_units() - 1.0).abs() > 1e-9 {
            return Err(not("the raster's CRS is not in metres"));
        }
        // Only the horizontal part of a compound CRS belongs to the grid.
        let code = super::crs::epsg_of_map(&srs).ok_or_else(|| not("the raster's CRS has no EPSG code"))?;
        let (width, height) = self.size();
        Ok(MapGrid { epsg: code, west: t[0], north: t[3], cell: t[1], width, height })
    }

    pub(super) fn no_band(&self, asked: usize) -> RasterError {
        RasterError::NoBand { path: self.path.clone(), found: self.bands(), asked }
    }
}

/// Opens a dataset. Of a virtual folder GDAL learns which files stand beside the raster from [`vsi::siblings`], so that it
/// reads the same ones as of a local folder without a request for every name that there might be.
fn open(path: &Path) -> gdal::errors::Result<Dataset> {
    if !vsi::is_virtual(path) || listing_is_off() {
        return Dataset::open(path);
    }
    let siblings = vsi::siblings(path);
    let siblings: Vec<&str> = siblings.iter().map(String::as_str).collect();
    let _options = remote_options();
    let options = DatasetOptions { sibling_files: Some(&siblings), ..DatasetOptions::default() };
    Dataset::open_ex(path, options)
}
