//! Maps that are written like another one: with its CRS, metadata, bands and nodata value, over another grid.

use super::gdal_setup::set_up_gdal;
use super::write::{cog_options, copy_as, copy_to_disk, keep_statistics, label, memory_dataset, write_by};
use super::{Cause, Grid2, ImageFile, MapGrid, RasterError, Window, escape_xml};
use gdal::raster::GdalDataType;
use gdal::{Dataset, Metadata};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Metadata items that are not copied, because GDAL derives them from the file.
const DERIVED: [&str; 2] = ["AREA_OR_POINT", "OVR_RESAMPLING_ALG"];
/// Number of rows that are read at a time to check a file.
const ROWS_AT_ONCE: usize = 256;

/// A map whose format others are written in: float32 or 8-bit bands, with their descriptions, units and nodata value.
pub struct Template {
    crs: String,
    is_byte: bool,
    nodata: Option<f64>,
    labels: Vec<(String, String)>,
    metadata: Vec<(String, String)>,
}

/// A part of a mosaic: a file and the column and row of its first cell in the mosaic.
pub struct MosaicPart {
    /// The file; its CRS, cells and bands are those of the template.
    pub path: PathBuf,
    /// Where the file lies in the mosaic.
    pub window: Window,
}

impl Template {
    /// The format of a map.
    ///
    /// # Errors
    /// [`RasterError`] if it cannot be read, or has bands that are neither float32 nor 8-bit.
    pub fn of(file: &ImageFile) -> Result<Self, RasterError> {
        let failed = |cause| RasterError::Read { path: file.path().into(), cause };
        let info = file.band(1)?;
        let is_float = file.dataset.rasterband(1).map_err(failed)?.band_type() == GdalDataType::Float32;
        if !info.is_byte && !is_float {
            let reason = "its bands are neither float32 nor 8-bit";
            return Err(RasterError::NotAMap { path: file.path().into(), reason });
        }
        let mut labels = Vec::new();
        for i in 1..=file.bands() {
            let band = file.dataset.rasterband(i).map_err(failed)?;
            labels.push((band.description().map_err(failed)?, band.unit()));
        }
        let metadata = file.metadata_domain("");
        Ok(Self {
            crs: file.dataset.projection(),
            is_byte: info.is_byte,
            nodata: info.nodata,
            labels,
            metadata: metadata.into_iter().filter(|(key, _)| !DERIVED.contains(&key.as_str())).collect(),
        })
    }

    /// Replaces a metadata item of the default domain, or adds it.
    pub fn set_metadata(&mut self, key: &str, value: String) {
        self.metadata.retain(|item| item.0 != key);
        self.metadata.push((key.into(), value));
    }

    /// Writes bands as a Cloud-Optimized GeoTIFF. NaN becomes the nodata value; 8-bit values are rounded and keep clear of
    /// it.
    ///
    /// # Errors
    /// [`RasterError`] if the file cannot be written.
    pub fn write(&self, path: &Path, grid: &MapGrid, bands: &[&Grid2]) -> Result<(), RasterError> {
        let written = write_by(path, |temporary| {
            let mut memory = if self.is_byte {
                let lowest = if self.nodata == Some(0.0) { 1.0 } else { 0.0 };
                let byte = |v: &f32| if v.is_nan() { 0 } else { v.round().clamp(lowest, 255.0) as u8 };
                let bytes: Vec<Vec<u8>> = bands.iter().map(|b| b.data.iter().map(byte).collect()).collect();
                let bytes: Vec<&[u8]> = bytes.iter().map(Vec::as_slice).collect();
                memory_dataset(grid.width, grid.height, &bytes, self.nodata)?
            } else {
                let data: Vec<&[f32]> = bands.iter().map(|b| b.data.as_slice()).collect();
                memory_dataset(grid.width, grid.height, &data, self.nodata)?
            };
            memory.set_geo_transform(&grid.geo_transform())?;
            memory.set_projection(&self.crs)?;
            for (key, value) in &self.metadata {
                memory.set_metadata_item(key, value, "")?;
            }
            let labels: Vec<_> = self.labels.iter().map(|(d, unit)| (d.as_str(), unit.as_str())).collect();
            label(&memory, &labels)?;
            keep_statistics(&memory)?;
            copy_as(&memory, "COG", temporary, &cog_options(self.predictor()))
        });
        Ok(written?)
    }

    /// Writes parts as one Cloud-Optimized GeoTIFF, without holding it in memory; cells without a part have no data. The
    /// file is a BigTIFF if it might become larger than 4 GB.
    ///
    /// # Errors
    /// [`RasterError`] if a part cannot be read or the file cannot be written.
    pub fn write_mosaic(&self, path: &Path, grid: &MapGrid, parts: &[MosaicPart]) -> Result<(), RasterError> {
        let written = write_by(path, |temporary| {
            set_up_gdal();
            let vrt = Dataset::open(Path::new(&self.vrt(grid, parts)?))?;
            keep_statistics(&vrt)?;
            let options: Vec<_> =
                cog_options(self.predictor()).into_iter().chain([("BIGTIFF", "IF_SAFER".into())]).collect();
            copy_to_disk(&vrt, "COG", temporary, &options)?;
            // GDAL does not report a full disk, and the file is too large to be encoded in memory.
            Ok(require_readable(&ImageFile::open(temporary)?)?)
        });
        Ok(written?)
    }

    fn predictor(&self) -> &'static str {
        if self.is_byte { "STANDARD" } else { "FLOATING_POINT" }
    }

    /// The mosaic as a virtual raster of GDAL.
    fn vrt(&self, grid: &MapGrid, parts: &[MosaicPart]) -> Result<String, Cause> {
        let transform = grid.geo_transform().map(|v| format!("{v:?}")).join(", ");
        let mut out = format!(
            "<VRTDataset rasterXSize=\"{}\" rasterYSize=\"{}\"><SRS>{}</SRS><GeoTransform>{transform}</GeoTransform><Metadata>",
            grid.width,
            grid.height,
            escape_xml(&self.crs),
        );
        for (key, value) in &self.metadata {
            write!(out, "<MDI key=\"{}\">{}</MDI>", escape_xml(key), escape_xml(value))?;
        }
        out.push_str("</Metadata>");
        let paths = parts.iter().map(|part| Ok(escape_xml(&part.path.canonicalize()?.to_string_lossy())));
        let paths = paths.collect::<Result<Vec<_>, std::io::Error>>()?;
        let ty = if self.is_byte { "Byte" } else { "Float32" };
        for (i, (description, unit)) in self.labels.iter().enumerate() {
            write!(
                out,
                "<VRTRasterBand dataType=\"{ty}\" band=\"{}\"><Description>{}</Description><UnitType>{}</UnitType>",
                i + 1,
                escape_xml(description),
                escape_xml(unit)
            )?;
            if let Some(nodata) = self.nodata {
                let text = if nodata.is_nan() { "nan".into() } else { nodata.to_string() };
                write!(out, "<NoDataValue>{text}</NoDataValue>")?;
            }
            for (part, path) in parts.iter().zip(&paths) {
                let Window { col, row, width, height } = part.window;
                write!(
                    out,
                    "<SimpleSource><SourceFilename relativeToVRT=\"0\">{path}</SourceFilename>\
                     <SourceBand>{}</SourceBand><SourceProperties RasterXSize=\"{width}\" RasterYSize=\"{height}\" \
                     DataType=\"{ty}\"/><SrcRect xOff=\"0\" yOff=\"0\" xSize=\"{width}\" ySize=\"{height}\"/>\
                     <DstRect xOff=\"{col}\" yOff=\"{row}\" xSize=\"{width}\" ySize=\"{height}\"/></SimpleSource>",
                    i + 1
                )?;
            }
            write!(out, "<ColorInterp>{}</ColorInterp></VRTRasterBand>", self.color(description))?;
        }
        out.push_str("</VRTDataset>");
        Ok(out)
    }

    /// What GDAL calls the colour of a band: as [`label`] sets it.
    fn color(&self, description: &str) -> &'static str {
        match description {
            "red" => "Red",
            "green" => "Green",
            "blue" => "Blue",
            _ if self.labels.len() == 1 => "Gray",
            _ => "Undefined",
        }
    }
}

/// Reads all of a file.
fn require_readable(file: &ImageFile) -> Result<(), RasterError> {
    let (width, height) = file.size();
    for band in 1..=file.bands() {
        for row in (0..height).step_by(ROWS_AT_ONCE) {
            let rows = ROWS_AT_ONCE.min(height - row);
            file.read_stored(band, Window { col: 0, row, width, height: rows }, (width, rows))?;
        }
    }
    Ok(())
}
