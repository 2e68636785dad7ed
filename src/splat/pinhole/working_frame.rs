//! The frame in which a perspective scene is trained.
//!
//! The unit of a scene may be a metre, a millimetre or the distance of two of its cameras, and its origin may be anywhere. The
//! program has lengths of its own, such as the depth up to which nothing is drawn, and rounds. So that these mean the same in
//! every scene, training takes place in a frame with an origin among the cameras and a unit that follows from what the cameras
//! see. What a run writes is in the frame of the scene.

use super::super::primitive::PrimitiveKind;
use super::super::splats::Splats;
use super::start::focus;
use crate::frame::Point;
use crate::perspective::{PerspectiveError, PerspectiveScene, PinholeCamera, ScenePoint};
use crate::stats::quantile;
use glam::DVec3;

/// Depth up to which nothing is drawn, working units (3DGS).
pub const NEAREST: f64 = 0.2;
/// This share of what the cameras see is nearer than one working unit. Of rooms, on which the lengths were tuned, the unit is about
/// a metre. A share rather than the middle, because [`NEAREST`] must lie before everything that is seen, however far away the rest is.
const NEARER: f64 = 0.05;
/// Largest numbers of views and of points whose depths are looked at, and of views with depth maps.
const MOST_VIEWS: usize = 64;
const MOST_POINTS: usize = 5000;
const MOST_MAPS: usize = 8;

/// The frame in which a perspective scene is trained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorkingFrame {
    unit: f64,
    origin: DVec3,
}

impl WorkingFrame {
    /// The frame of a scene: its unit is such that 5 % of the points in the training views are nearer; without such points, of the
    /// depths of its depth maps; without these, half of the distance of a camera from the place that the cameras look at.
    ///
    /// # Errors
    /// [`PerspectiveError`] if a depth map that is needed cannot be read.
    pub fn of(scene: &PerspectiveScene) -> Result<Self, PerspectiveError> {
        let cameras: Vec<PinholeCamera> = scene.training().map(|view| view.camera).collect();
        let is_length = |v: &f64| v.is_normal() && *v > 0.0;
        let nearer = |depths: Vec<f64>| quantile(depths, NEARER).filter(is_length);
        let mut unit = nearer(depths_of_points(&cameras, &scene.points));
        if unit.is_none() {
            unit = nearer(depths_of_maps(scene)?);
        }
        let to_focus = || {
            let focus = focus(&cameras);
            quantile(cameras.iter().map(|c| 0.5 * c.center.distance(focus)).collect(), 0.5).filter(is_length)
        };
        Ok(Self::of_cameras(unit.or_else(to_focus).unwrap_or(1.0), &cameras))
    }

    /// The frame of this unit, metres or units of the scene, whose origin is the mean of the training cameras.
    #[must_use]
    pub fn of_cameras(unit: f64, cameras: &[PinholeCamera]) -> Self {
        let origin = cameras.iter().map(|c| c.center).sum::<DVec3>() / cameras.len().max(1) as f64;
        Self { unit, origin }
    }

    /// Length of a working unit, metres or units of the scene.
    #[must_use]
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// The scene in this frame, without its place on Earth.
    #[must_use]
    pub fn enter(&self, scene: &PerspectiveScene) -> PerspectiveScene {
        let mut scene = PerspectiveScene { georeference: None, ..scene.clone() };
        for view in &mut scene.views {
            view.camera.center = self.place(view.camera.center);
            if let Some(depth) = &mut view.depth {
                depth.metres_per_unit /= self.unit;
                if let Some(camera) = &mut depth.camera {
                    camera.center /= self.unit;
                }
            }
        }
        for point in &mut scene.points {
            let [x, y, z] = self.place(DVec3::from_array(point.position.xyz())).to_array();
            point.position = Point::new(x, y, z);
        }
        scene
    }

    fn place(&self, p: DVec3) -> DVec3 {
        (p - self.origin) / self.unit
    }

    /// Splats of the scene in this frame.
    #[must_use]
    pub fn enter_splats(&self, splats: Splats) -> Splats {
        moved(splats, self.unit.recip(), |p| self.place(p))
    }

    /// Splats of this frame in that of the scene.
    #[must_use]
    pub fn leave_splats(&self, splats: Splats) -> Splats {
        moved(splats, self.unit, |p| self.unit * p + self.origin)
    }
}

/// Splats at other places, larger by a factor. Discs stay flat.
fn moved(mut splats: Splats, factor: f64, place: impl Fn(DVec3) -> DVec3) -> Splats {
    let axes = if splats.primitive() == PrimitiveKind::Disc { 2 } else { 3 };
    for position in &mut splats.position {
        *position = place(DVec3::from_array(position.map(f64::from))).to_array().map(|v| v as f32);
    }
    for scale in splats.log_scale.iter_mut().flat_map(|scales| &mut scales[..axes]) {
        *scale = (f64::from(*scale) + factor.ln()) as f32;
    }
    splats
}

/// Depths of points in the images of cameras, whatever hides them.
fn depths_of_points(cameras: &[PinholeCamera], points: &[ScenePoint]) -> Vec<f64> {
    let points: Vec<DVec3> = some(points, MOST_POINTS).map(|p| DVec3::from_array(p.position.xyz())).collect();
    let depths = some(cameras, MOST_VIEWS).flat_map(|camera| {
        points.iter().filter_map(|p| {
            let px = camera.project(Point::new(p.x, p.y, p.z))?;
            let (width, height) = (camera.size.0 as f64 - 0.5, camera.size.1 as f64 - 0.5);
            let is_inside = px.col > -0.5 && px.row > -0.5 && px.col < width && px.row < height;
            is_inside.then(|| camera.cam_from_site.row(2).dot(*p - camera.center))
        })
    });
    depths.collect()
}

/// Depths of some of the training views' depth maps.
fn depths_of_maps(scene: &PerspectiveScene) -> Result<Vec<f64>, PerspectiveError> {
    let views: Vec<_> = scene.training().filter(|view| view.depth.is_some()).collect();
    let mut depths = Vec::new();
    for view in some(&views, MOST_MAPS) {
        let map = view.read_depth()?;
        let known: Vec<f64> = map.valid().map(f64::from).collect();
        depths.extend(some(&known, MOST_POINTS));
    }
    Ok(depths)
}

/// At most so many items, spread over all.
fn some<T>(items: &[T], most: usize) -> impl Iterator<Item = &T> {
    items.iter().step_by(items.len().div_ceil(most).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perspective::{Layout, LensCamera, PerspectiveView};
    use crate::scene::Role;
    use glam::{DMat3, DVec2};

    /// Cameras on a circle of 4 m that look at a ball of points of 1 m, times `unit` and moved `by`.
    fn scene(unit: f64, by: DVec3, with_points: bool) -> PerspectiveScene {
        let view = |k: u32| {
            let (sin, cos) = (0.7 * f64::from(k)).sin_cos();
            let forward = DVec3::new(-cos, -sin, 0.0);
            let cam_from_site = DMat3::from_cols((-DVec3::Z).cross(forward), -DVec3::Z, forward).transpose();
            let lens = LensCamera::pinhole(DVec2::splat(80.0), DVec2::splat(24.5), (50, 50));
            PerspectiveView {
                name: format!("{k}"),
                path_in_scene: format!("{k}.png").into(),
                image: format!("{k}.png").into(),
                role: Role::Train,
                turned: None,
                lens_camera: lens,
                camera: PerspectiveView::undistorted_camera(
                    &lens,
                    cam_from_site,
                    unit * (-4.0 * forward) + by,
                    1,
                ),
                downsampling: 1,
                masks: Vec::new(),
                transparency: None,
                depth: None,
                observed: Vec::new(),
            }
        };
        let point = |k: u64| {
            let on_ball = DVec3::from_array(crate::random::CounterRng::new(3, 0, 0, k).direction());
            let [x, y, z] = (unit * on_ball + by).to_array();
            ScenePoint { position: Point::new(x, y, z), rgb: [9; 3] }
        };
        PerspectiveScene {
            layout: Layout::Colmap,
            views: (0..9).map(view).collect(),
            points: (0..if with_points { 500 } else { 0 }).map(point).collect(),
            georeference: None,
            origin: None,
            skipped: Vec::new(),
            unused: Vec::new(),
            registration: None,
            rejected_registration: None,
        }
    }

    #[test]
    fn a_scene_is_the_same_in_its_frame_whatever_its_unit_and_origin() {
        let of = |scene: &PerspectiveScene| {
            let frame = WorkingFrame::of(scene).unwrap();
            (frame.unit(), frame.enter(scene))
        };
        for with_points in [true, false] {
            let (unit, expected) = of(&scene(1.0, DVec3::ZERO, with_points));
            let nearest = if with_points { 3.0..3.2 } else { 1.99..2.01 };
            assert!(nearest.contains(&unit), "{unit}");
            assert_eq!(of(&scene(0.25, DVec3::ZERO, with_points)), (0.25 * unit, expected.clone()));
            for (factor, by) in [(0.01, DVec3::ZERO), (20.0, DVec3::new(300.0, -50.0, 7.0))] {
                let (found, working) = of(&scene(factor, by, with_points));
                assert!((found / (factor * unit) - 1.0).abs() < 1e-9, "{found}");
                let places = |scene: &PerspectiveScene| {
                    let centers = scene.views.iter().map(|v| v.camera.center).collect::<Vec<_>>();
                    let points = scene.points.iter().map(|p| DVec3::from_array(p.position.xyz()));
                    centers.into_iter().chain(points).collect::<Vec<_>>()
                };
                let pairs = places(&working).into_iter().zip(places(&expected));
                assert!(pairs.into_iter().all(|(a, b)| a.distance(b) < 1e-9));
            }
        }
    }

    #[test]
    fn splats_that_enter_and_leave_are_where_they_were_and_discs_stay_discs() {
        for unit in [1e-4, 5e3] {
            let frame = WorkingFrame { unit, origin: DVec3::new(3.0 * unit, 0.0, -unit) };
            for kind in [PrimitiveKind::Ellipsoid, PrimitiveKind::Disc] {
                let mut splats = Splats::default();
                splats.push([unit as f32, 0.0, 2.0 * unit as f32], 0.1 * unit as f32, 0.9, [0.5; 3]);
                if kind == PrimitiveKind::Disc {
                    splats.flatten();
                }
                let inside = frame.enter_splats(splats.clone());
                assert!((inside.log_scale[0][0].exp() - 0.1).abs() < 1e-5);
                assert!((inside.position[0][0] + 2.0).abs() < 1e-5 && inside.primitive() == kind);
                let back = frame.leave_splats(inside);
                assert!(back.primitive() == kind);
                let off = (0..3).map(|k| (back.position[0][k] - splats.position[0][k]).abs());
                assert!(off.fold(0.0, f32::max) < 1e-5 * unit as f32);
                assert!((back.log_scale[0][1] - splats.log_scale[0][1]).abs() < 1e-5);
            }
        }
    }
}
