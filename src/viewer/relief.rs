//! A surface model as a relief: its heights on a grid that is not too fine for a browser, and the colours of an orthophoto.

use super::ViewerError;
use crate::dsm::VIEWS_BAND;
use crate::frame::SiteGrid;
use crate::io::{Grid2, HeightSystem, ImageFile, MapGrid, VerticalReference, Window, png_rgb, read_heights};
use std::path::Path;

/// Largest number of cells; each has two triangles.
const MOST_CELLS: usize = 500_000;
/// Largest side of the texture, pixels.
const LARGEST_TEXTURE: usize = 2048;
/// A grid is that of another if no edge differs by more than this share of a cell.
const SLACK: f64 = 0.01;

/// A surface model in the site frame.
#[derive(Clone, Debug)]
pub struct ReliefLayer {
    /// Altitudes, metres above the site's origin; NaN where there are none.
    pub altitudes: Grid2,
    /// Western edge, site metres.
    pub west: f64,
    /// Northern edge, site metres.
    pub north: f64,
    /// Side of a cell, metres.
    pub cell: f64,
    /// A PNG of the colours of the whole grid.
    pub texture: Option<Vec<u8>>,
    /// The number of views that see each cell, [`ReliefLayer::UNKNOWN`] where that is not known.
    pub views: Option<Vec<u8>>,
}

impl ReliefLayer {
    /// The number of views of a cell of which it is not known.
    pub const UNKNOWN: u8 = 255;

    /// Reads a surface model, averaged down if it has too many cells, and an orthophoto and a confidence on the same grid.
    ///
    /// # Errors
    /// [`ViewerError`] if a file cannot be read or the vertical reference is unknown.
    pub fn read(
        dsm: &Path,
        ortho: Option<&Path>,
        confidence: Option<&Path>,
        site: &SiteGrid,
    ) -> Result<Self, ViewerError> {
        let file = ImageFile::open(dsm)?;
        let grid = file.map_grid()?;
        let step = ((grid.width * grid.height) as f64 / MOST_CELLS as f64).sqrt().ceil().max(1.0) as usize;
        // Whole cells of the coarser grid.
        let whole = |side: usize| (side / step).max(1) * step.min(side);
        let window = Window { col: 0, row: 0, width: whole(grid.width), height: whole(grid.height) };
        let longest = window.width.max(window.height).div_ceil(step);
        let (mut altitudes, factor, _) = read_heights(&file, window, longest)?;
        let down = site.origin.z() - undulation_m(&file, &grid, site)?;
        altitudes.data.iter_mut().for_each(|z| *z = (f64::from(*z) - down) as f32);
        let texture = ortho.map(|path| texture(path, &grid, window)).transpose()?.flatten();
        let size = (altitudes.width, altitudes.height);
        let views = confidence.map(|path| views(path, &grid, window, size)).transpose()?.flatten();
        let [east, north, _] = site.origin.xyz();
        Ok(Self {
            altitudes,
            west: grid.west - east,
            north: grid.north - north,
            cell: grid.cell * factor as f64,
            texture,
            views,
        })
    }

    /// The altitudes as little-endian f32, row by row.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        self.altitudes.data.iter().flat_map(|z| z.to_le_bytes()).collect()
    }
}

/// What is added to the heights of a file to give ellipsoidal heights, at the middle of its grid: across a run it changes by
/// centimetres.
fn undulation_m(file: &ImageFile, grid: &MapGrid, site: &SiteGrid) -> Result<f64, ViewerError> {
    let Some(name) = HeightSystem::of_raster(file)?.from else { return Ok(0.0) };
    let place = site.geodetic_from_utm(grid.cell_center(grid.width / 2, grid.height / 2));
    let undulation = VerticalReference::read(&name)?.undulation_m(place.lon_deg(), place.lat_deg());
    Ok(if undulation.is_finite() { undulation } else { 0.0 })
}

/// The numbers of views in a window of a confidence, averaged down to a size, if it has the grid of the surface model and the views
/// are counted.
fn views(
    path: &Path,
    grid: &MapGrid,
    window: Window,
    size: (usize, usize),
) -> Result<Option<Vec<u8>>, ViewerError> {
    let file = ImageFile::open(path)?;
    if file.bands() < VIEWS_BAND || !file.map_grid()?.is_same(grid, SLACK) {
        return Ok(None);
    }
    let views = file.read_scaled(VIEWS_BAND, window, size)?;
    let count = |v: &f32| if v.is_nan() { ReliefLayer::UNKNOWN } else { v.round().clamp(0.0, 254.0) as u8 };
    Ok(views.valid().next().is_some().then(|| views.data.iter().map(count).collect()))
}

/// The colours of a window of an orthophoto, if it has the grid of the surface model.
fn texture(path: &Path, grid: &MapGrid, window: Window) -> Result<Option<Vec<u8>>, ViewerError> {
    let file = ImageFile::open(path)?;
    if file.bands() < 3 || !file.map_grid()?.is_same(grid, SLACK) {
        return Ok(None);
    }
    let step = window.width.max(window.height).div_ceil(LARGEST_TEXTURE);
    let size = (window.width.div_ceil(step), window.height.div_ceil(step));
    let mut rgb = vec![0; 3 * size.0 * size.1];
    for band in 0..3 {
        let values = file.read_scaled(band + 1, window, size)?;
        for (pixel, value) in rgb.chunks_exact_mut(3).zip(&values.data) {
            // Pixels without data have no triangle.
            pixel[band] = value.clamp(0.0, 255.0).round() as u8;
        }
    }
    Ok(Some(png_rgb(size.0, size.1, &rgb)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Point;
    use crate::io::Cog;

    #[test]
    fn a_large_surface_model_is_averaged_down_and_stays_in_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let grid = MapGrid {
            epsg: 32617,
            west: 436_000.0,
            north: 3_357_700.0,
            cell: 0.5,
            width: 1601,
            height: 1200,
        };
        let plane = Grid2::from_fn(1601, 1200, |col, row| 5.0 + 0.5 * col as f32 - 0.25 * row as f32);
        let cog = Cog { grid, metadata: &[], heights_from: Some(&VerticalReference::Ellipsoid) };
        let (dsm, ortho) = (folder.path().join("dsm.tif"), folder.path().join("ortho.tif"));
        cog.write_f32(&dsm, &[("height", "m", &plane)]).unwrap();
        let band = |v: u8| vec![v; 1601 * 1200];
        let colors = Cog { heights_from: None, ..cog };
        colors.write_u8(&ortho, vec![band(200), band(100), band(50)], None).unwrap();
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_100.0, 3_357_600.0, -20.0) };
        let relief = ReliefLayer::read(&dsm, Some(&ortho), None, &site).unwrap();
        let cells = &relief.altitudes;
        assert!(cells.data.len() <= MOST_CELLS && relief.cell == 1.0);
        assert_eq!((cells.width, cells.height), (800, 600));
        assert_eq!((relief.west, relief.north), (-100.0, 100.0));
        // The mean of cells (20, 30) to (21, 31), 20 m above the origin.
        let expected = 5.0 + 0.5 * 20.5 - 0.25 * 30.5 + 20.0;
        assert!((cells.at(10, 15) - expected).abs() < 1e-4, "{}", cells.at(10, 15));
        let png = image::load_from_memory(&relief.texture.unwrap()).unwrap().to_rgb8();
        assert_eq!((png.width(), png.height()), (1600, 1200));
        assert_eq!(png.get_pixel(700, 300).0, [200, 100, 50]);
    }
}
