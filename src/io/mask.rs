//! Valid pixels according to a raster file: alpha bands and masks of GDAL.

use super::{ImageFile, RasterError, Window};
use gdal::raster::{ColorInterpretation, GdalDataType, RasterBand, ResampleAlg};

/// Number of positions along each side of an image at which a band is sampled to find out whether it is an alpha band.
const LATTICE: usize = 512;

impl ImageFile {
    /// Bands with image data, counted from 1: all but alpha bands, or all bands if there are only alpha bands.
    #[must_use]
    pub fn color_bands(&self) -> Vec<usize> {
        let all = 1..=self.bands();
        let colors: Vec<usize> = all.clone().filter(|b| !self.is_alpha(*b)).collect();
        if colors.is_empty() { all.collect() } else { colors }
    }

    /// Bands that are used by default, red, green and blue: those that the file declares as such, in whatever order it has them, else
    /// the first three bands with image data, or the only one; counted from 1.
    #[must_use]
    pub fn default_bands(&self) -> Vec<usize> {
        let mut bands = self.color_bands();
        let colors =
            [ColorInterpretation::RedBand, ColorInterpretation::GreenBand, ColorInterpretation::BlueBand];
        let declared = colors.map(|color| {
            let is_declared = |index: &&usize| {
                self.dataset.rasterband(**index).is_ok_and(|band| band.color_interpretation() == color)
            };
            bands.iter().find(is_declared).copied()
        });
        if let [Some(red), Some(green), Some(blue)] = declared {
            return vec![red, green, blue];
        }
        bands.truncate(if bands.len() >= 3 { 3 } else { 1 });
        bands
    }

    /// Whether a band, counted from 1, is an alpha band: because the file says so, or because it is the undescribed last one
    /// of two or four 8-bit bands and holds only 0 and 255.
    #[must_use]
    pub fn is_alpha(&self, index: usize) -> bool {
        let Ok(band) = self.dataset.rasterband(index) else { return false };
        match band.color_interpretation() {
            ColorInterpretation::AlphaBand => true,
            ColorInterpretation::Undefined => {
                let is_last = index == self.bands() && [2, 4].contains(&index);
                is_last && band.band_type() == GdalDataType::UInt8 && self.is_all_or_nothing(&band)
            }
            _ => false,
        }
    }

    /// Whether the values of a band, counted from 1, are indices into a colour table.
    #[must_use]
    pub fn is_palette(&self, index: usize) -> bool {
        let band = self.dataset.rasterband(index);
        band.is_ok_and(|b| b.color_interpretation() == ColorInterpretation::PaletteIndex)
    }

    /// Whether a band is 0 or 255 at the nodes of a lattice, and has both values.
    fn is_all_or_nothing(&self, band: &RasterBand) -> bool {
        let (width, height) = self.size();
        let nodes = (width.min(LATTICE), height.min(LATTICE));
        let values = band.read_as::<u8>((0, 0), (width, height), nodes, Some(ResampleAlg::NearestNeighbour));
        let Ok(values) = values else { return false };
        let has = |v: u8| values.data().contains(&v);
        has(0) && has(255) && values.data().iter().all(|v| [0, 255].contains(v))
    }

    /// The masks that apply to some bands: alpha bands, and masks in or beside the file (.msk). Nodata values are not
    /// included.
    pub(crate) fn masks(&self, bands: &[usize]) -> Masks<'_> {
        let alpha: Vec<usize> =
            (1..=self.bands()).filter(|b| self.is_alpha(*b) && !bands.contains(b)).collect();
        let mut of_bands = Vec::new();
        for index in bands {
            let Ok(band) = self.dataset.rasterband(*index) else { continue };
            let Ok(flags) = band.mask_flags() else { continue };
            let is_nodata = flags.is_nodata() && band.no_data_value().is_some();
            if !(flags.is_all_valid() || flags.is_alpha() || is_nodata) {
                of_bands.push(*index);
                if flags.is_per_dataset() {
                    break;
                }
            }
        }
        Masks { file: self, alpha, of_bands }
    }
}

/// Alpha bands and masks of a file.
pub(crate) struct Masks<'a> {
    file: &'a ImageFile,
    /// Alpha bands.
    alpha: Vec<usize>,
    /// Bands with masks of their own.
    of_bands: Vec<usize>,
}

impl Masks<'_> {
    /// Whether there is no mask.
    pub fn is_empty(&self) -> bool {
        self.alpha.is_empty() && self.of_bands.is_empty()
    }

    /// The values of each mask in a window, row by row; 0 means not valid.
    ///
    /// # Errors
    /// [`RasterError::Read`] if a mask cannot be read.
    pub fn read(&self, window: Window) -> Result<Vec<Vec<f32>>, RasterError> {
        let failed =
            |e: gdal::errors::GdalError| RasterError::Read { path: self.file.path().into(), cause: e };
        let pixels = |band: &RasterBand| -> Result<Vec<f32>, RasterError> {
            let (from, size) = ((window.col as isize, window.row as isize), (window.width, window.height));
            Ok(band.read_as::<f32>(from, size, size, None).map_err(failed)?.into_shape_and_vec().1)
        };
        let mut out = Vec::new();
        for index in &self.alpha {
            out.push(pixels(&self.file.dataset.rasterband(*index).map_err(failed)?)?);
        }
        for index in &self.of_bands {
            let band = self.file.dataset.rasterband(*index).map_err(failed)?;
            out.push(pixels(&band.open_mask_band().map_err(failed)?)?);
        }
        Ok(out)
    }
}
