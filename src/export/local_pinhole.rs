//! A satellite's view of a small area as a pinhole camera.
//!
//! The camera of a [`ViewCamera`] is affine, perhaps with a quadratic term: rays are parallel, pixels may be oblong and
//! oblique. A pinhole camera far away on the line of sight, with square pixels, sees the same but for two differences. One is
//! a map of the image plane, which is taken out by resampling the image ([`ImageMap`]). The other is the perspective: a
//! point at altitude `z` above the middle altitude and `r` metres beside the axis is displaced by about `scale r z' / distance`
//! pixels, `z'` being `z` along the line of sight. The distance is chosen so that this is small.

use super::ImageMap;
use crate::affine::ViewCamera;
use crate::frame::{CenterPx, Pixel, Point, Site, SiteBox};
use crate::perspective::PinholeCamera;
use glam::{DMat3, DVec2, DVec3};

/// Root mean square of the displacement by perspective over the area, pixels, from which the distance follows. A camera
/// further away would be more exact, but programs that compute depths as f32 resolve 8 mm at 100 km.
const PERSPECTIVE_RMS_PX: f64 = 0.05;
/// Smallest distance, in half diagonals of the area.
const NEAREST: f64 = 20.0;
/// Nodes along the columns and rows of the image and along altitudes, for the fit and for the check of it.
const FIT_NODES: [usize; 3] = [9, 9, 5];
const CHECK_NODES: [usize; 3] = [21, 21, 9];
/// Images of fewer columns or rows are not made.
const SMALLEST_PX: f64 = 16.0;

/// A pinhole camera for a view, the map that resamples the view's image for it, and what this leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalPinhole {
    /// The camera; its principal point is the middle of the image, and both focal lengths are equal.
    pub camera: PinholeCamera,
    /// From its image to the image of the view.
    pub map: ImageMap,
    /// Root mean square distance of points in the image between the view's camera and the pinhole camera with the map, over
    /// the pixels of the image and the altitudes; pixels of the view.
    pub rms_px: f64,
    /// The largest of these distances.
    pub max_px: f64,
}

/// What a view sees of the area.
pub enum Fitted {
    /// The camera.
    Pinhole(Box<LocalPinhole>),
    /// The view shows (almost) nothing of the area.
    OutsideOfImage,
    /// The camera looks along the ground, or the area has no extent.
    Degenerate,
}

impl LocalPinhole {
    /// The pinhole camera for a view with an image of `size` columns and rows. Its image shows the part of the view's image on
    /// which the area may be seen between the lowest and the highest of `altitudes` (site metres).
    #[must_use]
    pub fn fit(
        view: &ViewCamera,
        size: (usize, usize),
        (west, south, east, north): SiteBox,
        (low, high): (f64, f64),
    ) -> Fitted {
        let middle = DVec3::new(0.5 * (west + east), 0.5 * (south + north), 0.5 * (low + high));
        let half = DVec3::new(0.5 * (east - west), 0.5 * (north - south), 0.5 * (high - low));
        if !(half.is_finite() && half.min_element() > 0.0) {
            return Fitted::Degenerate;
        }
        let tangent = view.tangent_at(point(middle));
        let Some(plane) = ImagePlane::of(&tangent) else { return Fitted::Degenerate };

        // In the plane through the middle, in pixels: where the area appears, and where the image has pixels.
        let corners = (0..8).map(|k| {
            let sign = |bit: usize| if k >> bit & 1 == 0 { -1.0 } else { 1.0 };
            plane.place(half * DVec3::new(sign(0), sign(1), sign(2)))
        });
        let (width, height) = (size.0 as f64 - 0.5, size.1 as f64 - 0.5);
        let from = tangent.project(point(middle));
        let borders = [(-0.5, -0.5), (width, -0.5), (width, height), (-0.5, height)]
            .map(|(col, row)| plane.place_of_displacement(DVec2::new(col - from.col, row - from.row)));
        let (area, image) = (extent(corners), extent(borders.into_iter()));
        let (first, last) = (area.0.max(image.0), area.1.min(image.1));
        let extent = last - first;
        if !extent.is_finite() {
            return Fitted::Degenerate;
        }
        if extent.min_element() < SMALLEST_PX {
            return Fitted::OutsideOfImage;
        }
        let size = (extent.x.ceil() as usize, extent.y.ceil() as usize);

        // Root mean squares over a box of the distance from its axis and of the altitude.
        let beside = half.truncate().length() / 3f64.sqrt();
        let along = half.z / 3f64.sqrt() / plane.towards.z;
        let distance = (plane.scale * beside * along / PERSPECTIVE_RMS_PX).max(NEAREST * half.length());
        let axis = plane.right_down_forward;
        let at = 0.5 * (first + last) / plane.scale;
        let camera = PinholeCamera {
            cam_from_site: axis,
            center: middle + axis.transpose() * at.extend(-distance),
            focal: DVec2::splat(plane.scale * distance),
            principal: DVec2::new(0.5 * (size.0 as f64 - 1.0), 0.5 * (size.1 as f64 - 1.0)),
            size,
        };
        let Some(map) = ImageMap::fit(&pairs(&camera, view, (low, high), FIT_NODES), size) else {
            return Fitted::Degenerate;
        };
        let checked = pairs(&camera, view, (low, high), CHECK_NODES);
        let errors = checked.iter().map(|(px, seen)| map.original_from_resampled(*px).distance(*seen));
        let (sum, max_px) = errors.fold((0.0, 0f64), |(sum, max), e| (sum + e * e, max.max(e)));
        let rms_px = (sum / checked.len() as f64).sqrt();
        if !rms_px.is_finite() {
            return Fitted::Degenerate;
        }
        Fitted::Pinhole(Box::new(Self { camera, map, rms_px, max_px }))
    }
}

/// The axes of the pinhole camera of an affine view.
struct ImagePlane {
    /// Rows: the directions of the columns and rows of the image, and of the view.
    right_down_forward: DMat3,
    /// Unit vector towards the satellite.
    towards: DVec3,
    /// Pixels per metre.
    scale: f64,
    /// Columns: displacements in the view's image of a metre to the right and down, pixels.
    view_from_plane: glam::DMat2,
}

impl ImagePlane {
    /// The axes whose image needs the least distortion: between it and the view's image there is a symmetric map, so no
    /// rotation, and it has as many pixels.
    fn of(view: &ViewCamera) -> Option<Self> {
        let [x, y] = view.line_of_sight_slope();
        let towards = DVec3::new(x, y, 1.0).normalize();
        let [cols, rows] = view.linear.map(DVec3::from_array);
        let right = (cols - towards * cols.dot(towards)).normalize();
        let down = (-towards).cross(right);
        let displacement = |d: DVec3| DVec2::new(cols.dot(d), rows.dot(d));
        let (to_right, to_down) = (displacement(right), displacement(down));
        // The rotation of the polar decomposition.
        let angle = (to_right.y - to_down.x).atan2(to_right.x + to_down.y);
        let (sin, cos) = angle.sin_cos();
        let (right, down) = (cos * right - sin * down, sin * right + cos * down);
        let view_from_plane = glam::DMat2::from_cols(displacement(right), displacement(down));
        let scale = view_from_plane.determinant().abs().sqrt();
        let right_down_forward = DMat3::from_cols(right, down, -towards).transpose();
        let is_regular = right_down_forward.is_finite() && scale.is_finite() && scale > 0.0;
        is_regular.then_some(Self { right_down_forward, towards, scale, view_from_plane })
    }

    /// Place in the plane, pixels, of a displacement in the site frame.
    fn place(&self, d: DVec3) -> DVec2 {
        self.scale * (self.right_down_forward * d).truncate()
    }

    /// Place in the plane, pixels, of a displacement in the view's image.
    fn place_of_displacement(&self, d: DVec2) -> DVec2 {
        self.scale * (self.view_from_plane.inverse() * d)
    }
}

fn point(p: DVec3) -> Point<Site> {
    Point::new(p.x, p.y, p.z)
}

/// The smallest and largest coordinates.
fn extent(places: impl Iterator<Item = DVec2>) -> (DVec2, DVec2) {
    let none = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    places.fold(none, |(low, high), place| (low.min(place), high.max(place)))
}

/// Pixels of the pinhole camera, and where the view shows the points that they show at several altitudes.
fn pairs(
    camera: &PinholeCamera,
    view: &ViewCamera,
    (low, high): (f64, f64),
    nodes: [usize; 3],
) -> Vec<(Pixel<CenterPx>, Pixel<CenterPx>)> {
    let node = |i: usize, n: usize, from: f64, to: f64| from + (to - from) * i as f64 / (n - 1) as f64;
    let (width, height) = (camera.size.0 as f64 - 0.5, camera.size.1 as f64 - 0.5);
    let all = (0..nodes.iter().product()).map(|i: usize| {
        let [cols, rows, altitudes] = nodes;
        let px = Pixel::new(node(i % cols, cols, -0.5, width), node(i / cols % rows, rows, -0.5, height));
        let altitude = node(i / cols / rows, altitudes, low, high);
        let ray = DVec3::from_array(camera.ray(px));
        let seen = camera.center + ray * ((altitude - camera.center.z) / ray.z);
        (px, view.project(point(seen)))
    });
    all.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: SiteBox = (-130.0, -125.0, 128.0, 140.0);
    const ALTITUDES: (f64, f64) = (-20.0, 45.0);

    fn pinhole(view: &ViewCamera, size: (usize, usize)) -> LocalPinhole {
        match LocalPinhole::fit(view, size, AREA, ALTITUDES) {
            Fitted::Pinhole(found) => *found,
            _ => panic!("a camera that looks down has a pinhole camera"),
        }
    }

    /// An oblique view with oblong, oblique pixels.
    fn oblique() -> ViewCamera {
        ViewCamera::affine([[3.1, 0.25, 1.1], [-0.1, -2.7, 0.9]], [400.0, 390.0])
    }

    #[test]
    fn a_point_of_the_resampled_image_is_where_the_view_shows_it() {
        let turned = ViewCamera::affine([[0.3, 2.9, -0.4], [3.0, -0.2, 0.8]], [410.0, 395.0]);
        let mirrored = ViewCamera::affine([[-2.9, 0.1, 0.3], [0.1, -3.0, 0.5]], [410.0, 395.0]);
        for view in [oblique(), turned, mirrored] {
            let found = pinhole(&view, (800, 790));
            assert!(found.rms_px < 0.1 && found.max_px < 0.3, "{} {}", found.rms_px, found.max_px);
            for p in
                [Point::new(0.0, 0.0, 0.0), Point::new(60.0, -80.0, 40.0), Point::new(-90.0, 70.0, -15.0)]
            {
                let px = found.camera.project(p).unwrap();
                let error = found.map.original_from_resampled(px).distance(view.project(p));
                assert!(error < 0.3, "{error}");
            }
        }
    }

    #[test]
    fn the_camera_has_square_pixels_a_central_principal_point_and_proper_axes() {
        let found = pinhole(&oblique(), (800, 790)).camera;
        assert_eq!(found.focal.x, found.focal.y);
        assert_eq!(found.principal.x, 0.5 * (found.size.0 as f64 - 1.0));
        assert!((found.cam_from_site.determinant() - 1.0).abs() < 1e-12);
        assert!(found.center.z > 10_000.0);
        // It looks down, and the image is turned as that of the view.
        assert!(found.cam_from_site.row(2).z < -0.8 && found.cam_from_site.row(0).x > 0.8);
    }

    #[test]
    fn the_image_shows_the_area_and_no_more() {
        let whole = ViewCamera { offset: [2000.0, 2000.0], ..oblique() };
        let all = pinhole(&whole, (4000, 4000)).camera;
        let corners = [(AREA.0, AREA.1), (AREA.2, AREA.3)];
        for (x, y) in corners {
            for z in [ALTITUDES.0, ALTITUDES.1] {
                let px = all.project(Point::new(x, y, z)).unwrap();
                let inside = |v: f64, size: usize| v > -1.5 && v < size as f64 + 0.5;
                assert!(inside(px.col, all.size.0) && inside(px.row, all.size.1), "{px:?}");
            }
        }
        assert!(all.size.0 < 1100 && all.size.1 < 1000, "{:?}", all.size);
        let part = pinhole(&oblique(), (300, 300)).camera;
        assert!(part.size.0 < 350 && part.size.1 < 350, "{:?}", part.size);
        let beside = ViewCamera { offset: [9000.0, 0.0], ..oblique() };
        assert!(matches!(LocalPinhole::fit(&beside, (800, 800), AREA, ALTITUDES), Fitted::OutsideOfImage));
    }

    #[test]
    fn a_quadratic_term_of_a_satellite_is_resampled_away() {
        let quadratic = [[2e-6, -1e-6, 2e-6, 1e-6, -2e-6, 1e-6], [-1e-6, 2e-6, 1e-6, -3e-6, 2e-6, -1e-6]];
        let found = pinhole(&ViewCamera { quadratic, ..oblique() }, (800, 790));
        assert!(found.rms_px < 0.07, "{}", found.rms_px);
    }

    #[test]
    fn cameras_that_see_no_ground_and_empty_areas_have_none() {
        let along = ViewCamera::affine([[0.0, 0.0, 3.0], [0.0, 0.0, 1.0]], [0.0; 2]);
        let not_a_number = ViewCamera::affine([[f64::NAN, 0.0, 3.0], [0.0, 1.0, 1.0]], [0.0; 2]);
        for (view, area) in [(along, AREA), (not_a_number, AREA), (oblique(), (0.0, 0.0, 0.0, 1.0))] {
            let found = LocalPinhole::fit(&view, (800, 800), area, ALTITUDES);
            assert!(matches!(found, Fitted::Degenerate));
        }
    }
}
