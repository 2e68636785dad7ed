//! Valid pixels according to a raster file: alpha bands and masks of GDAL.

use super::{Grid2, ImageFile, RasterError, Window};
use gdal::raster::{ColorInterpretation, GdalDataType, RasterBand, ResampleAlg, RgbaEntry};

/// Number of positions along each side of an image at which a band is sampled to find out whether it is an alpha band.
const LATTICE: usize = 512;
/// The value of masks, and of alpha bands of 8 bits, at opaque pixels.
const OPAQUE: f32 = 255.0;
/// Formats of pictures whose values are not exact, and the largest value of black in a mask of them.
const LOSSY_DRIVERS: [&str; 2] = ["JPEG", "WEBP"];
const LOSSY_BLACK: f32 = 127.0;

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

    /// The bands whose values are colours that the file declares: red, green and blue.
    fn declared_colors(&self) -> Option<[usize; 3]> {
        const COLORS: [ColorInterpretation; 3] =
            [ColorInterpretation::RedBand, ColorInterpretation::GreenBand, ColorInterpretation::BlueBand];
        let place = |color: &ColorInterpretation| {
            (1..=self.bands())
                .find(|b| self.dataset.rasterband(*b).is_ok_and(|b| b.color_interpretation() == *color))
        };
        let [red, green, blue] = COLORS.each_ref().map(place);
        Some([red?, green?, blue?])
    }

    /// The red, green, blue and alpha of the entries of a band's colour table, 0 to 255; empty without one.
    #[must_use]
    pub fn palette(&self, index: usize) -> Vec<[u8; 4]> {
        let Ok(band) = self.dataset.rasterband(index) else { return Vec::new() };
        let Some(table) = band.color_table() else { return Vec::new() };
        let byte = |value: i16| value.clamp(0, 255) as u8;
        let entry = |index| {
            let RgbaEntry { r, g, b, a } =
                table.entry_as_rgb(index).unwrap_or(RgbaEntry { r: 0, g: 0, b: 0, a: 0 });
            [r, g, b, a].map(byte)
        };
        (0..table.entry_count()).map(entry).collect()
    }

    /// Which pixels of a window a mask marks, row by row: those that are neither black nor transparent. Of a colour table the
    /// colours count, of a picture in colours red, green and blue, of other files the first band. Where compression loses the
    /// exact black, values below half of the largest one are black.
    ///
    /// # Errors
    /// [`RasterError::Read`] if the file is damaged or incomplete.
    pub fn marked(&self, window: Window) -> Result<Vec<bool>, RasterError> {
        let palette = if self.is_palette(1) { self.palette(1) } else { Vec::new() };
        let bands = self.declared_colors().filter(|_| palette.is_empty()).map_or(vec![1], Vec::from);
        let driver = self.dataset.driver().short_name();
        let black = if LOSSY_DRIVERS.contains(&driver.as_str()) { LOSSY_BLACK } else { 0.0 };
        let is_marked = |value: f32| match palette.get(value as usize) {
            _ if value.is_nan() => false,
            Some([r, g, b, alpha]) => (*r, *g, *b) != (0, 0, 0) && *alpha != 0,
            None => value.abs() > black,
        };
        let mut out = vec![false; window.width * window.height];
        for band in &bands {
            let values = self.read_window(*band, window)?.data;
            out.iter_mut().zip(values).for_each(|(out, value)| *out |= is_marked(value));
        }
        for mask in self.masks(&bands).read(window)? {
            out.iter_mut().zip(mask).for_each(|(out, value)| *out &= value != 0.0);
        }
        Ok(out)
    }

    /// Whether pixels of some bands can be transparent: there are alpha bands, masks, or a colour that stands for transparency,
    /// which is the nodata value of all of the bands.
    #[must_use]
    pub fn has_transparency(&self, bands: &[usize]) -> bool {
        !self.masks(bands).is_empty() || self.transparent_color(bands).is_some()
    }

    /// The opacity of each pixel of some bands, 0 to 1; none if the file says nothing of it.
    ///
    /// # Errors
    /// [`RasterError::Read`] if the file is damaged or incomplete.
    pub fn opacity(&self, bands: &[usize]) -> Result<Option<Grid2>, RasterError> {
        if !self.has_transparency(bands) {
            return Ok(None);
        }
        let (width, height) = self.size();
        let window = Window { col: 0, row: 0, width, height };
        let mut out = Grid2::filled(width, height, 1.0);
        let masks = self.masks(bands);
        // Masks beside alpha bands are 0 or 255.
        let of_alpha = masks.alpha.iter().map(|band| self.opaque_value(*band));
        let opaque = of_alpha.chain(std::iter::repeat(OPAQUE));
        for (values, opaque) in masks.read(window)?.into_iter().zip(opaque) {
            out.data.iter_mut().zip(values).for_each(|(out, v)| *out *= (v / opaque).clamp(0.0, 1.0));
        }
        if let Some(color) = self.transparent_color(bands) {
            let mut is_color = vec![true; width * height];
            for (band, color) in bands.iter().zip(color) {
                let values = self.read_stored(*band, window, (width, height))?.data;
                is_color.iter_mut().zip(values).for_each(|(is_color, v)| *is_color &= v == color);
            }
            let transparent = out.data.iter_mut().zip(is_color).filter(|(_, is_color)| *is_color);
            transparent.for_each(|(out, _)| *out = 0.0);
        }
        Ok(Some(out))
    }

    /// The value of an alpha band at opaque pixels.
    fn opaque_value(&self, band: usize) -> f32 {
        match self.dataset.rasterband(band).map(|b| b.band_type()) {
            Ok(GdalDataType::UInt8) => OPAQUE,
            Ok(GdalDataType::UInt16) => f32::from(u16::MAX),
            _ => 1.0,
        }
    }

    /// The nodata values of some bands, if all of them have one.
    fn transparent_color(&self, bands: &[usize]) -> Option<Vec<f32>> {
        let value = |band: &usize| self.dataset.rasterband(*band).ok()?.no_data_value();
        bands.iter().map(|band| value(band).filter(|v| !v.is_nan()).map(|v| v as f32)).collect()
    }

    /// Reads one whole band, counted from 1, with the scale and the offset that the file declares; its nodata value is kept.
    ///
    /// # Errors
    /// As [`ImageFile::read`].
    pub fn read_stored_band(&self, index: usize) -> Result<Grid2, RasterError> {
        let (width, height) = self.size();
        let mut raster =
            self.read_stored(index, Window { col: 0, row: 0, width, height }, (width, height))?;
        self.apply_scale(index, &mut raster)?;
        Ok(raster)
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
