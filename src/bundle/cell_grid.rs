//! The cells of ground by which a large scene is matched.

use super::error::BundleError;
use crate::frame::{Geodetic, Point, SiteGrid, Utm};
use crate::scene::{
    Aoi, Footprints, Overlap, Scene, SceneError, UtmBox, footprint, ground_seen, require_tiled_images,
};
use geo::{Area, BooleanOps, BoundingRect, Rect};

/// Smallest share of a cell that two views must see, and that a view must see in order to be matched in the cell.
const MIN_SEEN: f64 = 0.1;

/// The ground that two views see, cut into equal cells.
pub(super) struct CellGrid {
    /// The map of the cells' boxes.
    pub(super) map: SiteGrid,
    /// The cells that two views see, row by row from the south-west.
    pub(super) cells: Vec<GroundCell>,
    /// Whether the ground is larger than one cell.
    pub(super) is_cut: bool,
}

/// A cell of ground.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GroundCell {
    /// Column from the west and row from the south: `x003_y000`.
    pub(super) id: String,
    /// Its box on the map.
    pub(super) bounds: UtmBox,
}

impl CellGrid {
    /// Cuts a scene's area of interest, or else the ground that two of its views see, into equal cells with sides of at most
    /// `side_m` metres.
    ///
    /// # Errors
    /// [`BundleError::Scene`] if the scene is outside of UTM.
    pub(super) fn of(scene: &Scene, overlap: &Overlap, side_m: f64) -> Result<Self, BundleError> {
        let center = scene.center().unwrap_or_else(|| scene.views[0].rpc.center());
        let map = SiteGrid::at(center).map_err(SceneError::from)?;
        let height_m = overlap.height_m;
        let outlines =
            scene.views.iter().filter_map(|v| footprint(&v.rpc, (v.width, v.height), &map, height_m));
        let mut seen = ground_seen(&outlines.collect::<Vec<_>>(), 2);
        if let Some(aoi) = &scene.aoi {
            seen = seen.intersection(&rectangle(aoi.utm_box(&map)));
        }
        let Some(extent) = seen.bounding_rect() else {
            return Ok(Self { map, cells: Vec::new(), is_cut: false });
        };
        let [columns, rows] = [extent.width(), extent.height()].map(|side| (side / side_m).ceil().max(1.0));
        let (width, height) = (extent.width() / columns, extent.height() / rows);
        let (columns, rows) = (columns as usize, rows as usize);
        let cell = |(row, column): (usize, usize)| {
            let (west, south) =
                (extent.min().x + column as f64 * width, extent.min().y + row as f64 * height);
            GroundCell {
                id: format!("x{column:03}_y{row:03}"),
                bounds: (west, south, west + width, south + height),
            }
        };
        let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
        let share =
            |cell: &GroundCell| seen.intersection(&rectangle(cell.bounds)).unsigned_area() / (width * height);
        let all: Vec<GroundCell> = places.map(cell).collect();
        let well_seen: Vec<GroundCell> = all.iter().filter(|c| share(c) >= MIN_SEEN).cloned().collect();
        // A narrow strip may fill no cell well.
        let cells = if well_seen.is_empty() { all } else { well_seen };
        Ok(Self { map, cells, is_cut: columns * rows > 1 })
    }

    /// An error if images are stored so that reading them cell by cell would read them many times.
    ///
    /// # Errors
    /// [`SceneError::Striped`]; [`SceneError`] if an image cannot be opened.
    pub(super) fn require_tiled_images(&self, scene: &Scene, heights: (f64, f64)) -> Result<(), SceneError> {
        let areas = self.cells.iter().map(|cell| Aoi::from_utm_box(cell.bounds, &self.map));
        let areas = areas.collect::<Result<Vec<_>, _>>()?;
        let mut reads = Vec::new();
        for area in &areas {
            reads.extend(scene.views.iter().filter_map(|view| {
                let window = view.window_showing(area, heights)?;
                Some((view, view.cropped(window).window.unwrap_or(window)))
            }));
        }
        require_tiled_images(reads)
    }

    /// The scene cropped to a cell; views that see little of the cell are left out.
    ///
    /// # Errors
    /// [`SceneError`] if no view sees it.
    pub(super) fn crop(
        &self,
        scene: &Scene,
        cell: &GroundCell,
        heights: (f64, f64),
    ) -> Result<Scene, SceneError> {
        let mut part = scene.clone();
        part.crop(Aoi::from_utm_box(cell.bounds, &self.map)?, heights)?;
        let area = rectangle(cell.bounds);
        let is_kept: Vec<bool> = {
            let cameras = part.views.iter().map(|v| (&v.rpc, (v.width, v.height))).collect();
            let footprints = Footprints::new(cameras, &self.map, heights);
            (0..part.views.len()).map(|view| footprints.share_of(view, &area) >= MIN_SEEN).collect()
        };
        let mut is_kept = is_kept.into_iter();
        part.views.retain(|_| is_kept.next().unwrap_or(false));
        Ok(part)
    }

    /// Longitude and latitude of a cell's middle, degrees.
    pub(super) fn center_deg(&self, cell: &GroundCell) -> [f64; 2] {
        let (west, south, east, north) = cell.bounds;
        let middle: Point<Utm> = Point::new(0.5 * (west + east), 0.5 * (south + north), 0.0);
        let place = self.map.geodetic_from_utm(middle);
        [place.lon_deg(), place.lat_deg()]
    }

    /// Position of a place in a cell, from (0, 0) in the south-west to (1, 1) in the north-east.
    pub(super) fn position_in(&self, cell: &GroundCell, place: Point<Geodetic>) -> [f64; 2] {
        let (west, south, east, north) = cell.bounds;
        let at = self.map.utm_from_geodetic(place);
        [(at.x() - west) / (east - west), (at.y() - south) / (north - south)]
    }
}

fn rectangle((west, south, east, north): UtmBox) -> geo::MultiPolygon<f64> {
    geo::MultiPolygon(vec![Rect::new((west, south), (east, north)).to_polygon()])
}
