//! Images that are embedded in the page.

use crate::dsm::hillshade;
use crate::io::{Grid2, ImageFile, MapGrid, RasterError, Window, escape_xml, png_rgb};
use base64::prelude::{BASE64_STANDARD, Engine};
use std::path::Path;

/// Longest side of an image of a map, pixels.
const LARGEST_SIDE: usize = 900;

/// An `<img>` element with an embedded PNG; `rgb` holds three bytes per pixel.
pub(super) fn img(
    width: usize,
    height: usize,
    rgb: &[u8],
    alt: &str,
    class: &str,
) -> Result<String, RasterError> {
    let data = BASE64_STANDARD.encode(png_rgb(width, height, rgb)?);
    let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
    Ok(format!(
        "<img{class} src=\"data:image/png;base64,{data}\" width=\"{width}\" height=\"{height}\" alt=\"{}\">",
        escape_xml(alt)
    ))
}

/// An `<img>` element with an embedded PNG file.
pub(super) fn img_of_file(path: &Path, alt: &str) -> Result<String, RasterError> {
    let file = ImageFile::open(path)?;
    let (width, height) = file.size();
    let bands = (1..=3).map(|band| file.read(band)).collect::<Result<Vec<_>, _>>()?;
    let rgb: Vec<u8> = (0..width * height).flat_map(|i| [0, 1, 2].map(|k| bands[k].data[i] as u8)).collect();
    img(width, height, &rgb, alt, "")
}

/// RGB bytes of colours in [0, 1], from one band or three; NaN becomes black.
pub(super) fn rgb_of(bands: &[Grid2]) -> Vec<u8> {
    let band = |i: usize| &bands[i.min(bands.len() - 1)].data;
    let byte = |v: f32| (255.0 * v).round() as u8;
    (0..band(0).len()).flat_map(|i| [byte(band(0)[i]), byte(band(1)[i]), byte(band(2)[i])]).collect()
}

/// The bands of a map, downsampled to the size that a page needs, and their grid.
///
/// # Errors
/// [`RasterError`] if the map cannot be read.
pub fn map_of_page(path: &Path) -> Result<(Vec<Grid2>, MapGrid), RasterError> {
    let file = ImageFile::open(path)?;
    let grid = file.map_grid()?;
    let step = grid.width.max(grid.height).div_ceil(LARGEST_SIDE);
    let (width, height) = ((grid.width / step).max(1), (grid.height / step).max(1));
    // The factor is a whole number, so that cells stay square.
    let window = Window {
        col: 0,
        row: 0,
        width: (width * step).min(grid.width),
        height: (height * step).min(grid.height),
    };
    let bands = (1..=file.bands()).map(|b| file.read_scaled(b, window, (width, height)));
    let bands = bands.collect::<Result<Vec<_>, _>>()?;
    Ok((bands, MapGrid { width, height, cell: grid.cell * step as f64, ..grid }))
}

/// The hillshade of heights in metres as an `<img>` element.
///
/// # Errors
/// [`RasterError`] if the picture cannot be encoded.
pub fn shaded(height: &Grid2, grid: &MapGrid, alt: &str) -> Result<String, RasterError> {
    let rgb: Vec<u8> = hillshade(height, grid.cell).into_iter().flat_map(|v| [v; 3]).collect();
    img(grid.width, grid.height, &rgb, alt, "")
}
