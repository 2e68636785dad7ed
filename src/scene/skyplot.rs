//! Drawing of the geometry of a scene: footprints on the left, a sky plot on the right.
//!
//! North is up. The centre of the sky plot is the zenith, its border the horizon, and rings are 30° apart. Blue dots are
//! satellites with the names of their views, hollow ones those of test views; orange dots are suns.

use super::{Overlap, Role, Scene, SceneError, short_names};
use crate::frame::SiteGrid;
use crate::io::svg::{BLUE, GRAY, GREEN, ORANGE};
use crate::io::{Drawing, round_below};

/// Side of each half of the drawing and the margin inside of it, pixels.
const SIDE: f64 = 480.0;
const MARGIN: f64 = 24.0;

/// Largest share of the drawing that the scale takes.
const SCALE_SHARE: f64 = 0.4;

impl Scene {
    /// Draws the footprints at the height of `overlap` and, beside them, the directions to satellites and suns.
    ///
    /// # Errors
    /// [`SceneError`] if the scene is outside of UTM.
    pub fn skyplot(&self, overlap: &Overlap) -> Result<Drawing, SceneError> {
        let mut drawing = Drawing::new(2.0 * SIDE, SIDE);
        self.draw_footprints(overlap, &mut drawing)?;
        self.draw_sky(&mut drawing, SIDE);
        Ok(drawing)
    }

    /// The two halves of [`Scene::skyplot`]: the footprints, and the sky.
    ///
    /// # Errors
    /// [`SceneError`] if the scene is outside of UTM.
    pub fn skyplots(&self, overlap: &Overlap) -> Result<[Drawing; 2], SceneError> {
        let [mut ground, mut sky] = [Drawing::new(SIDE, SIDE), Drawing::new(SIDE, SIDE)];
        self.draw_footprints(overlap, &mut ground)?;
        self.draw_sky(&mut sky, 0.0);
        Ok([ground, sky])
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
        let metres = round_below(SCALE_SHARE * SIDE / scale);
        let [left, right, y] = [MARGIN, MARGIN + scale * metres, SIDE - 0.5 * MARGIN];
        drawing.lines([[[left, y], [right, y]]].into_iter(), GRAY, 1.0);
        drawing.text([right + 6.0, y], "start", &format!("{metres} m"));
        drawing.text([SIDE - 0.5 * MARGIN, 0.5 * MARGIN], "end", "N \u{2191}");
        Ok(())
    }

    /// Draws the sky into the square whose left border is at `left`.
    fn draw_sky(&self, drawing: &mut Drawing, left: f64) {
        let middle = [left + 0.5 * SIDE, 0.5 * SIDE];
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
        for (azimuth, name) in [(0.0, "N"), (90.0, "E"), (180.0, "S"), (270.0, "W")] {
            drawing.text(place(azimuth, 95.0), "middle", name);
        }
        for ring in [30.0, 60.0] {
            drawing.text(place(45.0, ring), "start", &format!("{ring}°"));
        }
        let (low, high) = self.height_range();
        let names: Vec<&str> = self.views.iter().map(|view| view.name.as_str()).collect();
        let mut named = Vec::new();
        for (view, name) in self.views.iter().zip(short_names(&names)) {
            if let Some(sun) = view.sun {
                drawing.circle(place(sun.azimuth_deg, 90.0 - sun.elevation_deg), 4.0, ORANGE, true);
            }
            if let Some((azimuth, off_nadir)) = view.direction_deg(0.5 * (low + high)) {
                drawing.circle(place(azimuth, off_nadir), 4.0, BLUE, view.role != Role::Test);
                named.push((place(azimuth, off_nadir), name));
            }
        }
        drawing.labels(&named);
    }
}
