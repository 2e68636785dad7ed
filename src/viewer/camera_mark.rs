//! How a camera is drawn: a pyramid whose apex is the projection centre, and a line to what it looks at.

use crate::affine::ViewCamera;
use crate::perspective::PinholeCamera;
use glam::DVec3;
use serde::Serialize;

/// Half the side of the pyramid of a satellite, and its height, relative to its distance.
const SATELLITE_HALF_SIDE: f64 = 0.035;
const SATELLITE_DEPTH: f64 = 0.06;

/// A camera of the page; positions are in the site frame, metres.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct CameraMark {
    /// Name of the view.
    pub name: String,
    /// Whether the view is held back from training.
    pub is_test: bool,
    /// The apex.
    pub at: [f64; 3],
    /// The corners of the base, in order around it.
    pub corners: [[f64; 3]; 4],
    /// The end of the line of sight, of views from far away.
    pub to: Option<[f64; 3]>,
}

impl CameraMark {
    /// A satellite's view: the line of sight ends at `target`; the apex is at `distance` from it, far below the satellite.
    #[must_use]
    pub fn of_satellite(
        name: &str,
        is_test: bool,
        camera: &ViewCamera,
        target: [f64; 3],
        distance: f64,
    ) -> Self {
        let [x, y] = camera.line_of_sight_slope();
        let up = DVec3::new(x, y, 1.0).normalize();
        let target = DVec3::from_array(target);
        let at = target + distance * up;
        // The sides of the base are those of the image.
        let [right, down] = camera.linear.map(|line| {
            let line = DVec3::from_array(line);
            distance * SATELLITE_HALF_SIDE * (line - up * line.dot(up)).normalize_or_zero()
        });
        let middle = at - distance * SATELLITE_DEPTH * up;
        let corners = [-right - down, right - down, right + down, -right + down];
        Self {
            name: name.into(),
            is_test,
            at: at.to_array(),
            corners: corners.map(|corner| (middle + corner).to_array()),
            to: Some(target.to_array()),
        }
    }

    /// A pinhole camera, whose base is its image at `depth` metres.
    #[must_use]
    pub fn of_pinhole(name: &str, is_test: bool, camera: &PinholeCamera, depth: f64) -> Self {
        let (width, height) = (camera.size.0 as f64, camera.size.1 as f64);
        let corner = |col: f64, row: f64| {
            let x = (col - 0.5 - camera.principal.x) / camera.focal.x;
            let y = (row - 0.5 - camera.principal.y) / camera.focal.y;
            let place = camera.center + camera.cam_from_site.transpose() * (depth * DVec3::new(x, y, 1.0));
            place.to_array()
        };
        let corners = [corner(0.0, 0.0), corner(width, 0.0), corner(width, height), corner(0.0, height)];
        Self { name: name.into(), is_test, at: camera.center.to_array(), corners, to: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Point;
    use glam::{DMat3, DVec2};

    #[test]
    fn all_of_the_line_of_sight_of_a_satellite_is_in_one_pixel() {
        let camera = ViewCamera::affine([[3.0, 0.1, 0.6], [0.2, -2.9, 0.4]], [400.0, 390.0]);
        let mark = CameraMark::of_satellite("v", false, &camera, [5.0, 6.0, 7.0], 300.0);
        let px = |[x, y, z]: [f64; 3]| camera.project(Point::new(x, y, z));
        assert!(mark.at[2] > 200.0);
        assert!(px(mark.at).distance(px([5.0, 6.0, 7.0])) < 1e-9);
        let [first, second, third, _] = mark.corners.map(px);
        assert!(first.col < second.col && second.row < third.row);
    }

    #[test]
    fn the_base_of_a_pinhole_camera_has_the_corners_of_its_image() {
        let camera = PinholeCamera {
            cam_from_site: DMat3::from_rotation_x(2.2),
            center: DVec3::new(1.0, -2.0, 30.0),
            focal: DVec2::new(700.0, 710.0),
            principal: DVec2::new(319.5, 239.5),
            size: (640, 480),
        };
        let mark = CameraMark::of_pinhole("v", true, &camera, 2.0);
        for ([x, y, z], (col, row)) in
            mark.corners.iter().zip([(-0.5, -0.5), (639.5, -0.5), (639.5, 479.5), (-0.5, 479.5)])
        {
            let px = camera.project(Point::new(*x, *y, *z)).unwrap();
            assert!((px.col - col).abs() < 1e-9 && (px.row - row).abs() < 1e-9, "{px:?}");
        }
    }
}
