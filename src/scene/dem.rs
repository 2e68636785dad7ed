//! Heights of a scene from a digital elevation model.

use super::{Scene, SceneError, footprint};
use crate::frame::{CornerPx, Geodetic, Pixel, Point, SiteGrid, wrap_longitude_deg};
use crate::io::{Grid2, HeightSystem, ImageFile, VerticalError, VerticalReference, Window, read_heights};
use geo::{BoundingRect, MultiPolygon};
use std::path::Path;

/// Depth below the elevation model that is searched, metres; quarries are missing in models, and their heights have
/// errors.
const BELOW_M: f64 = 20.0;
/// Height above the elevation model that is searched, metres; buildings and trees are missing in most models.
const ABOVE_M: f64 = 80.0;
/// Lowest and highest height of land on Earth, metres.
const LOWEST_M: f64 = -500.0;
const HIGHEST_M: f64 = 9000.0;
/// Largest number of nodes along a side of the grid of heights.
const MOST_NODES: usize = 2048;

/// Ellipsoidal heights of an elevation model, on a regular grid in longitude and latitude.
#[derive(Clone, Debug)]
pub struct Dem {
    /// Longitude and latitude of the first node, and spacing of the nodes, degrees.
    origin: [f64; 2],
    step: [f64; 2],
    heights: Grid2,
    range: (f64, f64),
}

impl Dem {
    /// Lowest and highest ellipsoidal height to search, metres: from 20 m below the lowest to 80 m above the highest height
    /// of the model.
    #[must_use]
    pub fn heights_to_search(&self) -> (f64, f64) {
        (self.range.0 - BELOW_M, self.range.1 + ABOVE_M)
    }

    /// Ellipsoidal height of the model at the longitude and latitude of a point, metres, interpolated bilinearly; NaN where
    /// the model has none. The height of the point is not used.
    #[must_use]
    pub fn height_m(&self, p: Point<Geodetic>) -> f64 {
        let east = wrap_longitude_deg(p.lon_deg() - self.origin[0]);
        let north = p.lat_deg() - self.origin[1];
        f64::from(self.heights.bilinear(east / self.step[0], north / self.step[1]))
    }
}

impl Scene {
    /// Reads an elevation model in the area of interest of the scene, or in the footprints of its views.
    ///
    /// Without `vertical`, the file must state its vertical reference, by a compound CRS or the metadata item
    /// `VERTICAL_REFERENCE`. Heights in feet are converted. Known nodata values count as nodata even if the file does not
    /// declare them.
    ///
    /// # Errors
    /// [`SceneError::VerticalReference`] if the vertical reference is not known, [`SceneError::DemElsewhere`] if the model
    /// does not cover the scene, [`SceneError::GeoidElsewhere`] if the geoid grid does not, [`SceneError::DemVoid`] for
    /// heights that do not occur on Earth.
    pub fn dem(&self, path: &Path, vertical: Option<&VerticalReference>) -> Result<Dem, SceneError> {
        let elsewhere = || SceneError::DemElsewhere { path: path.into() };
        let file = ImageFile::open(path)?;
        file.require_heights()?;
        let stated = match vertical {
            Some(_) => None,
            None => Some(stated_reference(&file)?),
        };
        let vertical = vertical.or(stated.as_ref());
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
        // One node more than there are cells, so that the grid covers the last cell.
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
        // The undulation is nearly constant over a scene; for the range, that at the centre is used.
        let up = both[both.len() / 2].1;
        Ok(Dem {
            origin: [lon.0, lat.0],
            step,
            heights: Grid2 { width: columns, height: rows, data },
            range: (low + up, high + up),
        })
    }

    /// Longitude and latitude, in degrees, of the corners of the bounding box of the area of interest, or of the footprints;
    /// `None` without views.
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
            // Longitudes are counted from the first one, so that the box may cross the antimeridian.
            (center.lon_deg() + wrap_longitude_deg(p.lon_deg() - center.lon_deg()), p.lat_deg())
        })))
    }
}

/// The vertical reference that an elevation model states.
fn stated_reference(file: &ImageFile) -> Result<VerticalReference, SceneError> {
    let unknown = |stated: String| SceneError::VerticalReference { path: file.path().into(), stated };
    let Some(from) = HeightSystem::of_raster(file)?.from else { return Err(unknown(String::new())) };
    match VerticalReference::read(&from) {
        Err(VerticalError::Unknown { .. } | VerticalError::NoGrid { .. }) => {
            Err(unknown(format!("; it states the unknown reference `{from}`")))
        }
        read => Ok(read?),
    }
}

/// The window of cells around some positions, with a margin of one cell.
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
