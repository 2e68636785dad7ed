//! Splats of a site, placed in a level frame.

use crate::frame::{LevelFrame, Point, Site, SiteGrid};
use crate::splat::splats::Splats;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Half the step along the axes of the site by which their directions are found, metres.
const HALF_STEP_M: f64 = 50.0;

/// Moves splats of a site frame into a level frame: positions through the map projection, each by itself; shapes and colours
/// turned by the directions of the site's axes there. The scale of the map, less than a thousandth, is left to the shapes.
/// None if the projection is not defined at one of the positions.
#[must_use]
pub fn place(mut splats: Splats, site: &SiteGrid, level: &LevelFrame) -> Option<Splats> {
    let level_from_site =
        |p: Point<Site>| DVec3::from_array(level.level_from_geodetic(site.geodetic_from_site(p)));
    splats.position.par_iter_mut().with_min_len(1024).for_each(|position| {
        let [x, y, z] = position.map(f64::from);
        *position = level_from_site(Point::new(x, y, z)).as_vec3().to_array();
    });
    let along = |dx: f64, dy: f64| {
        level_from_site(Point::new(dx, dy, 0.0)) - level_from_site(Point::new(-dx, -dy, 0.0))
    };
    let east = along(HALF_STEP_M, 0.0).normalize();
    let up = east.cross(along(0.0, HALF_STEP_M)).normalize();
    splats.turn_shapes(DMat3::from_cols(east, up.cross(east), up));
    let is_finite = splats.groups().iter().all(|group| group.iter().all(|v| v.is_finite()));
    is_finite.then_some(splats)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Far from the meridian of the zone, where the grid's north is a degree and a half off.
    #[test]
    fn splats_are_turned_by_the_convergence_of_the_grid_and_stand_where_their_coordinates_say() {
        let site = SiteGrid::at(Point::new(5.44, 43.26, 150.0)).unwrap();
        let level = LevelFrame::at(site.geodetic_from_utm(site.origin));
        let mut splats = Splats::default();
        splats.push([1000.0, 0.0, 20.0], 1.0, 0.5, [0.5; 3]);
        splats.push([0.0, 1000.0, 0.0], 1.0, 0.5, [0.5; 3]);
        let placed = place(splats, &site, &level).unwrap();
        let [east, north, up] = placed.position[0].map(f64::from);
        let convergence = site.convergence_deg();
        // The grid's east is turned to the south by the convergence, and the ground falls by 8 cm over a kilometre.
        assert!((-north.atan2(east).to_degrees() - convergence).abs() < 0.01, "{east} {north}");
        assert!((up - 20.0 + 1000.0f64.powi(2) / 2.0 / 6.378e6).abs() < 0.002, "{up}");
        let [w, x, y, z] = placed.rotation[1].map(f64::from);
        let turn = 2.0 * z.atan2(w).to_degrees();
        assert!((-turn - convergence).abs() < 1e-3 && x.abs() < 1e-5 && y.abs() < 1e-5, "{turn}");
        let nowhere = SiteGrid { epsg: 32631, origin: Point::new(f64::NAN, 0.0, 0.0) };
        assert!(place(placed, &nowhere, &level).is_none());
    }
}
