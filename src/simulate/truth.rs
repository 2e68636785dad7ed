//! Ground truth in `truth/`: the exact DSM, its classes, the true RPCs, and the shifts of the delivered RPCs.

use super::field::Material;
use super::landscape::Landscape;
use super::summary::SceneFigures;
use super::view::SimulatedView;
use crate::frame::{Point, Site};
use crate::io::{Cog, Grid2, MapGrid, VerticalReference, WriteError, write_file};
use crate::rpc::formats::{ViewTags, to_json};
use std::path::Path;

/// Class codes of DFC2019.
const GROUND: u8 = 2;
const TREES: u8 = 5;
const BUILDING: u8 = 6;
const WATER: u8 = 9;
const UNLABELLED: u8 = 65;
/// Number of views that must see the area of the exact DSM; all views if there are fewer.
const SEEN_BY: usize = 3;
/// Side of the exact DSM as a fraction of the side of the square that these views see.
const CROP: f64 = 0.97;

/// The exact DSM and its classes on the map grid.
pub(super) struct ExactDsm {
    pub(super) grid: MapGrid,
    pub(super) heights: Grid2,
    /// Heights of the ground under buildings and trees, if that is known.
    pub(super) ground: Option<Grid2>,
    pub(super) classes: Vec<u8>,
}

impl ExactDsm {
    /// Samples the field at the centres of the cells, in the square that at least three views see.
    pub(super) fn sample(
        landscape: &Landscape,
        views: &[SimulatedView],
        size_px: usize,
        cell_m: f64,
    ) -> Self {
        let Landscape { field, grid, .. } = landscape;
        let half = CROP * seen_half_m(landscape, views, size_px);
        let [e, n, _] = grid.origin.xyz();
        let map = MapGrid::covering(grid.epsg, (e - half, n - half, e + half, n + half), cell_m);
        let place = |col, row| {
            let c = map.cell_center(col, row);
            (c.x() - e, c.y() - n)
        };
        let heights = Grid2::from_fn(map.width, map.height, |col, row| {
            let (x, y) = place(col, row);
            let is_known = field.nearest(x, y).material != Material::Void;
            if is_known { field.height_m(x, y) as f32 } else { f32::NAN }
        });
        let classes = (0..map.width * map.height)
            .map(|k| {
                let (x, y) = place(k % map.width, k / map.width);
                match field.nearest(x, y).material {
                    Material::Roof => BUILDING,
                    Material::Tree => TREES,
                    Material::Water => WATER,
                    Material::Void => UNLABELLED,
                    Material::Grass
                    | Material::Paving
                    | Material::Asphalt
                    | Material::Rock
                    | Material::Scree
                    | Material::Snow => GROUND,
                }
            })
            .collect();
        let ground = landscape.plan.as_ref().map(|plan| {
            Grid2::from_fn(map.width, map.height, |col, row| {
                let (x, y) = place(col, row);
                plan.ground_m(x, y) as f32
            })
        });
        Self { grid: map, heights, ground, classes }
    }

    /// Statistics of the DSM.
    pub(super) fn figures(&self, landscape: &Landscape) -> SceneFigures {
        let n = self.classes.len() as f64;
        let share = |class| self.classes.iter().filter(|c| **c == class).count() as f64 / n;
        let known = self.heights.valid().count() as f64;
        let mean = self.heights.valid().map(f64::from).sum::<f64>() / known;
        let deviation = self.heights.valid().map(|h| (f64::from(h) - mean).abs()).sum::<f64>() / known;
        let (mut lowest, mut highest, mut tallest) = (f64::INFINITY, f64::NEG_INFINITY, 0.0f64);
        for (k, class) in self.classes.iter().enumerate().filter(|(_, class)| **class != UNLABELLED) {
            let c = self.grid.cell_center(k % self.grid.width, k / self.grid.width);
            let origin = landscape.grid.origin;
            let ground = landscape.ground_m(c.x() - origin.x(), c.y() - origin.y());
            lowest = lowest.min(ground);
            highest = highest.max(ground);
            if *class == BUILDING {
                tallest = tallest.max(f64::from(self.heights.data[k]) - ground);
            }
        }
        SceneFigures {
            mean_absolute_deviation_m: deviation,
            roofs_share: share(BUILDING),
            trees_share: share(TREES),
            water_share: share(WATER),
            tallest_building_m: tallest,
            relief_m: highest - lowest,
        }
    }

    /// Writes `NAME_DSM.tif`, `NAME_DTM.tif` if the ground under it is known, and `NAME_CLS.tif` if its classes are.
    pub(super) fn write(&self, folder: &Path, name: &str, has_classes: bool) -> Result<(), WriteError> {
        let classes = Cog { grid: self.grid, metadata: &[], heights_from: None };
        let dsm = Cog { heights_from: Some(&VerticalReference::Ellipsoid), ..classes };
        dsm.write_f32(&folder.join(format!("{name}_DSM.tif")), &[("height", "m", &self.heights)])?;
        if let Some(ground) = &self.ground {
            dsm.write_f32(&folder.join(format!("{name}_DTM.tif")), &[("height", "m", ground)])?;
        }
        if !has_classes {
            return Ok(());
        }
        classes.write_u8(&folder.join(format!("{name}_CLS.tif")), vec![self.classes.clone()], None)
    }
}

/// Half the side of the largest centred square whose border is seen by enough views, metres.
fn seen_half_m(landscape: &Landscape, views: &[SimulatedView], size_px: usize) -> f64 {
    const STEP_M: f64 = 1.0;
    let Landscape { field, grid, .. } = landscape;
    let needed = SEEN_BY.min(views.len());
    let last = size_px as f64 - 1.0;
    let is_seen = |x: f64, y: f64| {
        let ground = grid.geodetic_from_site(Point::<Site>::new(x, y, field.height_m(x, y)));
        let sees = |view: &&SimulatedView| {
            let px = view.true_rpc.project(ground);
            (0.0..=last).contains(&px.col) && (0.0..=last).contains(&px.row)
        };
        views.iter().filter(sees).count() >= needed
    };
    let mut half = STEP_M;
    while half < field.half_m() {
        let steps = (2.0 * half / STEP_M).round() as i64;
        let along = |i: i64| i as f64 * STEP_M - half;
        let side = |i| {
            let v = along(i);
            is_seen(v, -half) && is_seen(v, half) && is_seen(-half, v) && is_seen(half, v)
        };
        if !(0..=steps).all(side) {
            break;
        }
        half += STEP_M;
    }
    half - STEP_M
}

/// Writes the true RPC of a view as JSON.
pub(super) fn write_rpc(
    path: &Path,
    view: &SimulatedView,
    size_px: usize,
    heights_m: (f64, f64),
) -> Result<(), WriteError> {
    let sun = view.plan.sun;
    let tags = ViewTags {
        image: Some(format!("{}.tif", view.plan.name)),
        size: Some((size_px, size_px)),
        sun_deg: Some((sun.azimuth_deg, sun.elevation_deg)),
        acquired: Some(view.plan.acquired.clone()),
        height_range: Some((heights_m.0.floor(), heights_m.1.ceil())),
        ..ViewTags::default()
    };
    write_file(path, to_json(&view.true_rpc, &tags))
}
