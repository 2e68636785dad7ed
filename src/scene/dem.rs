//! The heights of a scene from a digital elevation model.

use super::{Scene, SceneError, footprint};
use crate::frame::{CornerPx, Pixel, SiteGrid};
use crate::raster::{ImageFile, Vertical, Window};
use geo::{BoundingRect, MultiPolygon};
use std::path::Path;

/// Elevation models lack quarries and cellars, and err.
const BELOW_M: f64 = 20.0;
/// Most lack buildings and trees.
const ABOVE_M: f64 = 80.0;

impl Scene {
    /// Lowest and highest ellipsoidal height in the scene's area (or its footprints) after an elevation model,
    /// 20 m lower and 80 m higher.
    ///
    /// Without `vertical` the model itself must say that its heights are ellipsoidal (`VERTICAL_REFERENCE`).
    ///
    /// # Errors
    /// [`SceneError::Vertical`] when what its heights count from is not known, [`SceneError::DemElsewhere`] when it does
    /// not cover the scene, [`SceneError::GeoidElsewhere`] when the geoid's grid does not.
    pub fn heights_from_dem(
        &self,
        path: &Path,
        vertical: Option<&Vertical>,
    ) -> Result<(f64, f64), SceneError> {
        let elsewhere = || SceneError::DemElsewhere { path: path.into() };
        let file = ImageFile::open(path)?;
        let told = file.metadata("VERTICAL_REFERENCE", "");
        if vertical.is_none() && told.as_deref() != Some("ellipsoid") {
            return Err(SceneError::Vertical { path: path.into() });
        }
        let center = self.center().ok_or_else(elsewhere)?;
        let grid = SiteGrid::at(center)?;
        let (w, s, e, n) = match &self.aoi {
            Some(aoi) => aoi.utm_box(&grid),
            None => {
                let all = self.views.iter();
                let outlines =
                    all.filter_map(|v| footprint(&v.rpc, (v.width, v.height), &grid, center.height_m()));
                let r = MultiPolygon(outlines.collect()).bounding_rect().ok_or_else(elsewhere)?;
                (r.min().x, r.min().y, r.max().x, r.max().y)
            }
        };
        let corners = [(w, s), (e, s), (e, n), (w, n)].map(|(x, y)| {
            let p = grid.geodetic_from_utm(crate::frame::Point::new(x, y, 0.0));
            file.px_of_lon_lat(p.lon_deg(), p.lat_deg())
        });
        let window = window(&corners, file.size()).ok_or_else(elsewhere)?;
        let plane = file.read_window(1, window)?;
        let range = |low: f64, high: f64| (low <= high).then_some((low, high)).ok_or_else(elsewhere);
        let (low, high) = plane
            .valid()
            .map(f64::from)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = range(low, high)?;
        let up = match vertical {
            Some(Vertical::Geoid(geoid)) => geoid.undulation_m(center.lon_deg(), center.lat_deg()),
            _ => 0.0,
        };
        if up.is_nan() {
            return Err(SceneError::GeoidElsewhere);
        }
        range(low + up - BELOW_M, high + up + ABOVE_M)
    }
}

/// The cells around some places, one more on each side.
fn window(places: &[Option<Pixel<CornerPx>>; 4], (width, height): (usize, usize)) -> Option<Window> {
    let places: Vec<Pixel<CornerPx>> = places.iter().copied().collect::<Option<_>>()?;
    let span = |of: fn(&Pixel<CornerPx>) -> f64, size: usize| {
        let low = places.iter().map(of).fold(f64::INFINITY, f64::min) - 1.0;
        let high = places.iter().map(of).fold(f64::NEG_INFINITY, f64::max) + 1.0;
        let (from, to) = (low.floor().max(0.0), high.ceil().min(size as f64));
        (to > from).then_some((from as usize, (to - from) as usize))
    };
    let ((col, width), (row, height)) = (span(|p| p.col, width)?, span(|p| p.row, height)?);
    Some(Window { col, row, width, height })
}
