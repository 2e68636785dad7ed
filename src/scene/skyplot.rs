//! Drawing of the geometry of a scene: footprints on the left, a sky plot on the right.
//!
//! North is up. The centre of the sky plot is the zenith, its border the horizon, and rings are 30° apart. Blue dots are
//! satellites, hollow ones those of test views; orange dots are suns.

use super::{Overlap, Role, Scene, SceneError};
use crate::frame::SiteGrid;
use crate::io::Drawing;
use crate::io::svg::{BLUE, GRAY, GREEN, ORANGE};

/// Side of each half of the drawing and the margin inside of it, pixels.
const SIDE: f64 = 480.0;
const MARGIN: f64 = 24.0;

impl Scene {
    /// Draws the footprints at the height of `overlap`, and the directions to satellites and suns.
    ///
    /// # Errors
    /// [`SceneError`] if the scene is outside of UTM.
    pub fn skyplot(&self, overlap: &Overlap) -> Result<Drawing, SceneError> {
        let mut drawing = Drawing::new(2.0 * SIDE, SIDE);
        self.draw_footprints(overlap, &mut drawing)?;
        self.draw_sky(&mut drawing);
        Ok(drawing)
    }

    fn draw_footprints(&self, overlap: &Overlap, drawing: &mut Drawing) -> Result<(), SceneError> {
        let Some(center) = self.center() else { return Ok(()) };
        let grid = SiteGrid::at(center)?;
        let rings: Vec<Vec<[f64; 2]>> = self
            .views
            .iter()
            .filter_map(|v| v.footprint(overlap.height_m))
            .map(|ring| ring.map(|p| grid.site_from_geodetic(p).xyz()).map(|p| [p[0], p[1]]).to_vec())
            .collect();
        let area =
            self.aoi.as_ref().map(|aoi| aoi.utm_box(&grid)).or(overlap.common_box).map(|(w, s, e, n)| {
                let [x, y, _] = grid.origin.xyz();
                [[w - x, s - y], [e - x, s - y], [e - x, n - y], [w - x, n - y]].to_vec()
            });
        let reach = rings.iter().chain(&area).flatten().flatten().fold(1.0f64, |a, b| a.max(b.abs()));
        let middle = 0.5 * SIDE;
        let scale = (middle - MARGIN) / reach;
        let place = |[x, y]: [f64; 2]| [middle + scale * x, middle - scale * y];
        for ring in rings {
            drawing.outline(&ring.into_iter().map(place).collect::<Vec<_>>(), BLUE);
        }
        if let Some(ring) = area {
            drawing.outline(&ring.into_iter().map(place).collect::<Vec<_>>(), GREEN);
        }
        Ok(())
    }

    fn draw_sky(&self, drawing: &mut Drawing) {
        let middle = [1.5 * SIDE, 0.5 * SIDE];
        let radius = 0.5 * SIDE - MARGIN;
        let place = |azimuth_deg: f64, zenith_deg: f64| {
            let (sin, cos) = azimuth_deg.to_radians().sin_cos();
            let r = radius * zenith_deg / 90.0;
            [middle[0] + r * sin, middle[1] - r * cos]
        };
        for ring in [30.0, 60.0, 90.0] {
            drawing.outline(&(0..120).map(|i| place(3.0 * f64::from(i), ring)).collect::<Vec<_>>(), GRAY);
        }
        for azimuth in [0.0, 90.0] {
            drawing.lines([[place(azimuth, 90.0), place(azimuth + 180.0, 90.0)]].into_iter(), GRAY, 1.0);
        }
        let (low, high) = self.height_range();
        for view in &self.views {
            if let Some(sun) = view.sun {
                drawing.circle(place(sun.azimuth_deg, 90.0 - sun.elevation_deg), 4.0, ORANGE, true);
            }
            if let Some((azimuth, off_nadir)) = view.direction_deg(0.5 * (low + high)) {
                drawing.circle(place(azimuth, off_nadir), 4.0, BLUE, view.role != Role::Test);
            }
        }
    }
}
