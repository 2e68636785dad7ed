//! A raster of heights in memory, with its map grid.

use super::MetricsError;
use crate::frame::{Point, SiteGrid};
use crate::io::{Grid2, HeightSystem, ImageFile, MapGrid, VerticalReference, Window, read_heights};
use std::path::{Path, PathBuf};

/// Distance in cells between the nodes at which undulations are computed; they are smooth and are interpolated between
/// the nodes.
const GEOID_STEP: usize = 64;

/// Heights in metres on a map grid, NaN where there is no data.
#[derive(Clone, Debug)]
pub struct HeightRaster {
    /// The file, for messages.
    pub path: PathBuf,
    /// The map grid.
    pub grid: MapGrid,
    /// Heights in metres.
    pub height: Grid2,
    /// Vertical reference as [`VerticalReference::read`] takes it, or the name of an unknown datum; none if the file
    /// states none.
    pub vertical: Option<String>,
    /// Number of cells with a nodata value that the file does not declare.
    pub undeclared_nodata: usize,
    /// Unit of the file, if it is not metres; the heights are converted.
    pub converted_from: Option<String>,
}

impl HeightRaster {
    /// Reads the first band of a georeferenced raster.
    ///
    /// # Errors
    /// [`MetricsError::Raster`] when it cannot be read, has no north-up grid in metres, or heights in an unknown unit.
    pub fn read(path: &Path) -> Result<Self, MetricsError> {
        let file = ImageFile::open(path)?;
        let grid = file.map_grid()?;
        Self::on_grid(&file, grid)
    }

    /// Reads the first band of `file` with a map grid that is known from elsewhere.
    pub(super) fn on_grid(file: &ImageFile, grid: MapGrid) -> Result<Self, MetricsError> {
        let system = HeightSystem::of_raster(file)?;
        let (width, height) = file.size();
        let window = Window { col: 0, row: 0, width, height };
        let (height, _, undeclared_nodata) = read_heights(file, window, usize::MAX)?;
        let converted_from = system.converted_from();
        Ok(Self {
            path: file.path().into(),
            grid,
            height,
            vertical: system.from,
            undeclared_nodata,
            converted_from,
        })
    }

    /// Converts the heights to ellipsoidal ones if the file states another vertical reference; returns a sentence that
    /// says so.
    ///
    /// # Errors
    /// [`MetricsError::VerticalReference`] for a datum whose height above the ellipsoid is not known,
    /// [`MetricsError::GeoidElsewhere`].
    pub fn to_ellipsoid(&mut self) -> Result<Option<String>, MetricsError> {
        let Some(from) = self.vertical.clone().filter(|from| from != VerticalReference::ELLIPSOID) else {
            return Ok(None);
        };
        let refused = |e| MetricsError::VerticalReference {
            path: self.path.clone(),
            from: from.clone(),
            reason: Box::new(e),
        };
        let vertical = VerticalReference::read(&from).map_err(refused)?;
        let (low, high) = self.lift(&vertical)?;
        Ok(Some(format!(
            "`{}` counts from the geoid ({}) and is lifted to the ellipsoid, by {low:+.2} to {high:+.2} m",
            self.path.display(),
            vertical.name()
        )))
    }

    /// Adds the height of a vertical reference above the ellipsoid; returns the smallest and the largest value added.
    pub(super) fn lift(&mut self, from: &VerticalReference) -> Result<(f32, f32), MetricsError> {
        let grid = self.grid;
        let map = SiteGrid { epsg: grid.epsg, origin: Point::new(0.0, 0.0, 0.0) };
        let nodes = |cells: usize| cells.div_ceil(GEOID_STEP) + 1;
        let undulation = Grid2::from_fn(nodes(grid.width), nodes(grid.height), |col, row| {
            let p = map.geodetic_from_utm(grid.cell_center(col * GEOID_STEP, row * GEOID_STEP));
            from.undulation_m(p.lon_deg(), p.lat_deg()) as f32
        });
        if undulation.data.iter().any(|v| v.is_nan()) {
            return Err(MetricsError::GeoidElsewhere { path: self.path.clone() });
        }
        let step = GEOID_STEP as f64;
        for (i, v) in self.height.data.iter_mut().enumerate() {
            let (col, row) = (i % grid.width, i / grid.width);
            *v += undulation.bilinear(col as f64 / step, row as f64 / step);
        }
        self.vertical = Some(VerticalReference::ELLIPSOID.into());
        Ok(undulation.valid().fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(v), h.max(v))))
    }
}
