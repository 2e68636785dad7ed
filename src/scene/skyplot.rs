//! One picture of a scene: left the footprints, north up, right the sky over it.
//!
//! On the sky the middle is the zenith, the rim the horizon, rings stand every 30°; north is up, east right. Blue dots
//! are satellites, hollow ones of test views; orange dots are suns.

use super::{Overlap, Role, Scene, SceneError};
use crate::frame::SiteGrid;
use crate::io::Canvas;

/// Side of each half, pixels.
const SIDE: usize = 480;
const MARGIN: f64 = 24.0;
const PAPER: [u8; 3] = [255; 3];
const VIEW: [u8; 3] = Canvas::BLUE;
const SUN: [u8; 3] = Canvas::ORANGE;
const AREA: [u8; 3] = [44, 160, 44];

impl Scene {
    /// Draws the picture.
    ///
    /// # Errors
    /// [`SceneError`] for a place outside UTM.
    pub fn skyplot(&self, overlap: &Overlap) -> Result<Canvas, SceneError> {
        let mut canvas = Canvas::new(2 * SIDE, SIDE);
        self.draw_footprints(overlap, &mut canvas)?;
        self.draw_sky(&mut canvas);
        Ok(canvas)
    }

    fn draw_footprints(&self, overlap: &Overlap, canvas: &mut Canvas) -> Result<(), SceneError> {
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
        let middle = 0.5 * SIDE as f64;
        let scale = (middle - MARGIN) / reach;
        let place = |[x, y]: [f64; 2]| [middle + scale * x, middle - scale * y];
        for ring in rings {
            canvas.outline(&ring.into_iter().map(place).collect::<Vec<_>>(), VIEW);
        }
        if let Some(ring) = area {
            canvas.outline(&ring.into_iter().map(place).collect::<Vec<_>>(), AREA);
        }
        Ok(())
    }

    fn draw_sky(&self, canvas: &mut Canvas) {
        let middle = [1.5 * SIDE as f64, 0.5 * SIDE as f64];
        let radius = 0.5 * SIDE as f64 - MARGIN;
        let place = |azimuth_deg: f64, zenith_deg: f64| {
            let (sin, cos) = azimuth_deg.to_radians().sin_cos();
            let r = radius * zenith_deg / 90.0;
            [middle[0] + r * sin, middle[1] - r * cos]
        };
        for ring in [30.0, 60.0, 90.0] {
            canvas.outline(
                &(0..120).map(|i| place(3.0 * f64::from(i), ring)).collect::<Vec<_>>(),
                Canvas::GRID,
            );
        }
        for azimuth in [0.0, 90.0] {
            canvas.line(place(azimuth, 90.0), place(azimuth + 180.0, 90.0), Canvas::GRID);
        }
        let (low, high) = self.height_range();
        for view in &self.views {
            if let Some(sun) = view.sun {
                canvas.disc(place(sun.azimuth_deg, 90.0 - sun.elevation_deg), 5.0, SUN);
            }
            if let Some((azimuth, off_nadir)) = view.direction_deg(0.5 * (low + high)) {
                canvas.disc(place(azimuth, off_nadir), 5.0, VIEW);
                if view.role == Role::Test {
                    canvas.disc(place(azimuth, off_nadir), 3.0, PAPER);
                }
            }
        }
    }
}
