//! A height raster in memory, with its place on the map.

use super::MetricsError;
use crate::frame::{Point, SiteGrid};
use crate::io::{Grid2, HeightSystem, ImageFile, MapGrid, Vertical, Window, read_heights};
use std::path::{Path, PathBuf};

/// Geoids are smooth: they are looked up every so many cells.
const GEOID_STEP: usize = 64;

/// A surface model: heights in metres on a map grid; NaN is no data.
#[derive(Clone, Debug)]
pub struct Surface {
    /// The file it came from, for messages.
    pub path: PathBuf,
    /// Its place on the map.
    pub grid: MapGrid,
    /// Heights in metres.
    pub height: Grid2,
    /// What the heights count from, as [`Vertical::read`] takes it, or a datum that it does not know.
    pub vertical: Option<String>,
    /// Cells that held a nodata value the file does not declare.
    pub undeclared_nodata: usize,
    /// The unit that heights were converted from, if they were not in metres.
    pub converted_from: Option<String>,
}

impl Surface {
    /// Reads the first band of a georeferenced raster.
    ///
    /// # Errors
    /// [`MetricsError::Raster`] when it cannot be read, has no north-up grid in metres, or heights in an unknown unit.
    pub fn read(path: &Path) -> Result<Self, MetricsError> {
        let file = ImageFile::open(path)?;
        let grid = file.map_grid()?;
        Self::on_grid(&file, grid)
    }

    /// Reads the first band of `file`, whose place is known from elsewhere.
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

    /// Makes heights count from the ellipsoid, if the file says that they count from something else; says what was done.
    ///
    /// # Errors
    /// [`MetricsError::Vertical`] for a datum whose height above the ellipsoid is not known,
    /// [`MetricsError::GeoidElsewhere`].
    pub fn to_ellipsoid(&mut self) -> Result<Option<String>, MetricsError> {
        let Some(from) = self.vertical.clone().filter(|from| from != Vertical::ELLIPSOID) else {
            return Ok(None);
        };
        let refused =
            |e| MetricsError::Vertical { path: self.path.clone(), from: from.clone(), reason: Box::new(e) };
        let vertical = Vertical::read(&from).map_err(refused)?;
        let (low, high) = self.lift(&vertical)?;
        Ok(Some(format!(
            "`{}` counts from the geoid ({}) and is lifted to the ellipsoid, by {low:+.2} to {high:+.2} m",
            self.path.display(),
            vertical.name()
        )))
    }

    /// Adds the height of a reference above the ellipsoid; returns the least and the most that was added.
    pub(super) fn lift(&mut self, from: &Vertical) -> Result<(f32, f32), MetricsError> {
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
        self.vertical = Some(Vertical::ELLIPSOID.into());
        Ok(undulation.valid().fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(v), h.max(v))))
    }
}
