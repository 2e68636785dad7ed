//! The heights of a scene from a digital elevation model.

use super::{Scene, SceneError, footprint};
use crate::frame::{CornerPx, Geodetic, Pixel, Point, SiteGrid, half_turn};
use crate::io::{Grid2, HeightSystem, ImageFile, Vertical, VerticalError, Window, read_heights};
use geo::{BoundingRect, MultiPolygon};
use std::path::Path;

/// Elevation models lack quarries and cellars, and err.
const BELOW_M: f64 = 20.0;
/// Most lack buildings and trees.
const ABOVE_M: f64 = 80.0;
/// No land is lower or higher, metres.
const LOWEST_M: f64 = -500.0;
const HIGHEST_M: f64 = 9000.0;
/// No side of the grid of heights has more nodes.
const MOST_NODES: usize = 2048;

/// Heights of an elevation model above the ellipsoid, on a grid in longitude and latitude.
#[derive(Clone, Debug)]
pub struct Dem {
    /// Longitude and latitude of the first node, and from one node to the next, degrees.
    origin: [f64; 2],
    step: [f64; 2],
    heights: Grid2,
    range: (f64, f64),
}

impl Dem {
    /// The lowest and the highest ellipsoidal height to search in metres: 20 m below the model's, 80 m above.
    #[must_use]
    pub fn heights_to_search(&self) -> (f64, f64) {
        (self.range.0 - BELOW_M, self.range.1 + ABOVE_M)
    }

    /// Ellipsoidal height of the model at a point's longitude and latitude, metres, bilinear; NaN where it has none.
    #[must_use]
    pub fn height_m(&self, p: Point<Geodetic>) -> f64 {
        let east = half_turn(p.lon_deg() - self.origin[0]);
        let north = p.lat_deg() - self.origin[1];
        f64::from(self.heights.bilinear(east / self.step[0], north / self.step[1]))
    }
}

impl Scene {
    /// An elevation model of the scene's area, or of its footprints.
    ///
    /// Without `vertical` the model itself must say what its heights count from, by a compound CRS or `VERTICAL_REFERENCE`.
    /// Heights in feet are converted, and voids that are not declared as nodata are left out.
    ///
    /// # Errors
    /// [`SceneError::Vertical`] when what its heights count from is not known, [`SceneError::DemElsewhere`] when it does
    /// not cover the scene, [`SceneError::GeoidElsewhere`] when the geoid's grid does not, [`SceneError::DemVoid`] for
    /// heights that are none.
    pub fn dem(&self, path: &Path, vertical: Option<&Vertical>) -> Result<Dem, SceneError> {
        let elsewhere = || SceneError::DemElsewhere { path: path.into() };
        let file = ImageFile::open(path)?;
        let told = match vertical {
            Some(_) => None,
            None => Some(told_reference(&file)?),
        };
        let vertical = vertical.or(told.as_ref());
        let corners = self.corners()?.ok_or_else(elsewhere)?;
        let places = file.px_of_lon_lats(&corners).ok_or_else(elsewhere)?;
        let window = window(&places, file.size()).ok_or_else(elsewhere)?;
        let (raster, factor, _) = read_heights(&file, window, MOST_NODES)?;
        let size = (raster.width, raster.height);

        let span = |k: usize| {
            let of = corners.iter().map(|c| [c.0, c.1][k]);
            of.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
        };
        let (lon, lat) = (span(0), span(1));
        // A node more than there are cells, so that the last one is reached.
        let step = [(lon.1 - lon.0) / size.0 as f64, (lat.1 - lat.0) / size.1 as f64];
        let (columns, rows) = (size.0 + 1, size.1 + 1);
        let node =
            |i: usize| (lon.0 + (i % columns) as f64 * step[0], lat.0 + (i / columns) as f64 * step[1]);
        let nodes: Vec<(f64, f64)> = (0..columns * rows).map(node).collect();
        let places = file.px_of_lon_lats(&nodes).ok_or_else(elsewhere)?;
        let height = |(px, (lon_deg, lat_deg)): (&Pixel<CornerPx>, &(f64, f64))| {
            let col = (px.col - window.col as f64) / factor as f64 - 0.5;
            let row = (px.row - window.row as f64) / factor as f64 - 0.5;
            let up = vertical.map_or(0.0, |v| v.undulation_m(*lon_deg, *lat_deg));
            (f64::from(raster.bilinear(col, row)), up)
        };
        let both: Vec<(f64, f64)> = places.iter().zip(&nodes).map(height).collect();
        if both.iter().any(|(_, up)| up.is_nan()) {
            return Err(SceneError::GeoidElsewhere);
        }
        let data = both.iter().map(|(h, up)| (h + up) as f32).collect();
        let (low, high) = raster
            .valid()
            .map(f64::from)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return Err(elsewhere());
        }
        if low < LOWEST_M || high > HIGHEST_M {
            let height_m = if low < LOWEST_M { low } else { high };
            return Err(SceneError::DemVoid { path: path.into(), height_m });
        }
        // Over a scene a geoid is as good as level.
        let up = both[both.len() / 2].1;
        Ok(Dem {
            origin: [lon.0, lat.0],
            step,
            heights: Grid2 { width: columns, height: rows, data },
            range: (low + up, high + up),
        })
    }

    /// Longitudes and latitudes in degrees of the corners of the scene's area, or of its footprints; none without views.
    fn corners(&self) -> Result<Option<[(f64, f64); 4]>, SceneError> {
        let Some(center) = self.center() else { return Ok(None) };
        let grid = SiteGrid::at(center)?;
        let (w, s, e, n) = match &self.aoi {
            Some(aoi) => aoi.utm_box(&grid),
            None => {
                let all = self.views.iter();
                let outlines =
                    all.filter_map(|v| footprint(&v.rpc, (v.width, v.height), &grid, center.height_m()));
                let Some(r) = MultiPolygon(outlines.collect()).bounding_rect() else { return Ok(None) };
                (r.min().x, r.min().y, r.max().x, r.max().y)
            }
        };
        Ok(Some([(w, s), (e, s), (e, n), (w, n)].map(|(x, y)| {
            let p = grid.geodetic_from_utm(Point::new(x, y, 0.0));
            // On the same side of the antimeridian.
            (center.lon_deg() + half_turn(p.lon_deg() - center.lon_deg()), p.lat_deg())
        })))
    }
}

/// What a model's heights count from, as it says itself.
fn told_reference(file: &ImageFile) -> Result<Vertical, SceneError> {
    let unknown = |told: String| SceneError::Vertical { path: file.path().into(), told };
    let Some(from) = HeightSystem::of_raster(file)?.from else { return Err(unknown(String::new())) };
    match Vertical::read(&from) {
        Err(VerticalError::Unknown { .. } | VerticalError::NoGrid { .. }) => {
            Err(unknown(format!(" by a reference that is known: it says `{from}`")))
        }
        read => Ok(read?),
    }
}

/// The cells around some places, one more on each side.
fn window(places: &[Pixel<CornerPx>], (width, height): (usize, usize)) -> Option<Window> {
    let span = |of: fn(&Pixel<CornerPx>) -> f64, size: usize| {
        let low = places.iter().map(of).fold(f64::INFINITY, f64::min) - 1.0;
        let high = places.iter().map(of).fold(f64::NEG_INFINITY, f64::max) + 1.0;
        let (from, to) = (low.floor().max(0.0), high.ceil().min(size as f64));
        (to > from).then_some((from as usize, (to - from) as usize))
    };
    let ((col, width), (row, height)) = (span(|p| p.col, width)?, span(|p| p.row, height)?);
    Some(Window { col, row, width, height })
}
