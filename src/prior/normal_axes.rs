//! The axes in which normals of files are given.
//!
//! Programs write normals in the axes of the camera or of the world, in any order and with either sign. Normals of the scene
//! agree with those of its points in one of these conventions, normals of another scene in none.

use super::agreement::FEWEST_POINTS;
use super::map::NormalPrior;
use super::seen::SeenPoint;
use crate::frame::{Point, Site};
use crate::perspective::PinholeCamera;
use crate::stats::quantile;
use glam::{DMat3, DVec3};

/// Largest median angle between normals of the scene and those of its points, degrees.
const MOST_DEG: f64 = 30.0;
/// A convention that is farther from the usual one is taken if it makes the mean angle smaller by more than this, degrees: errors of
/// the normals make smaller differences.
const CLEAR_DEG: f64 = 1.0;
/// Largest number of points that are compared.
const COMPARED_POINTS: usize = 20_000;
/// The orders of three components, the usual one first.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// The axes to which components refer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum AxesOf {
    Camera,
    World,
}

/// A convention: which component of a file, with which sign, is that along each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalAxes {
    of: AxesOf,
    order: [usize; 3],
    signs: [f64; 3],
}

/// A normal as a file gives it at a point, and that of the point, on the side of the camera.
#[derive(Clone, Copy)]
pub(super) struct ComparedNormal {
    given: DVec3,
    of_point: DVec3,
    cam_from_site: DMat3,
}

impl NormalAxes {
    /// Right, down, forward of the camera.
    pub const USUAL: Self = Self { of: AxesOf::Camera, order: [0, 1, 2], signs: [1.0; 3] };

    /// All conventions, the usual one first.
    fn all() -> impl Iterator<Item = Self> {
        let orders =
            [AxesOf::Camera, AxesOf::World].into_iter().flat_map(|of| ORDERS.map(|order| (of, order)));
        orders.flat_map(|(of, order)| {
            let sign = move |k: usize, turned: usize| if turned >> k & 1 == 1 { -1.0 } else { 1.0 };
            (0..8).map(move |turned| Self { of, order, signs: [0, 1, 2].map(|k| sign(k, turned)) })
        })
    }

    /// The normal in camera axes (right, down, forward).
    pub fn in_camera(&self, given: [f64; 3], cam_from_site: &DMat3) -> DVec3 {
        let own = DVec3::from_array([0, 1, 2].map(|k| self.signs[k] * given[self.order[k]]));
        if self.of == AxesOf::World { *cam_from_site * own } else { own }
    }

    /// The convention in which normals agree best with those of points; none with too few points.
    ///
    /// # Errors
    /// The median angle in degrees, if normals and points do not agree in any.
    pub(super) fn found(compared: &[ComparedNormal]) -> Result<Option<Self>, f64> {
        if compared.len() < FEWEST_POINTS {
            return Ok(None);
        }
        let step = compared.len().div_ceil(COMPARED_POINTS);
        let some: Vec<&ComparedNormal> = compared.iter().step_by(step).collect();
        let angles = |axes: &Self| -> Vec<f64> { some.iter().map(|normal| normal.angle_deg(axes)).collect() };
        let means: Vec<(Self, f64)> =
            Self::all().map(|axes| (axes, angles(&axes).iter().sum::<f64>() / some.len() as f64)).collect();
        let least = means.iter().map(|(_, mean)| *mean).fold(f64::INFINITY, f64::min);
        let first = means.iter().find(|(_, mean)| *mean <= least + CLEAR_DEG);
        let axes = first.map_or(Self::USUAL, |(axes, _)| *axes);
        let median = quantile(angles(&axes), 0.5).unwrap_or(f64::INFINITY);
        if median > MOST_DEG { Err(median) } else { Ok(Some(axes)) }
    }
}

impl ComparedNormal {
    fn angle_deg(&self, axes: &NormalAxes) -> f64 {
        let own = axes.in_camera(self.given.to_array(), &self.cam_from_site);
        own.dot(self.of_point).clamp(-1.0, 1.0).acos().to_degrees()
    }
}

impl std::fmt::Display for NormalAxes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names = ["x", "y", "z"];
        let parts = [0, 1, 2]
            .map(|k| format!("{}{}", if self.signs[k] < 0.0 { "-" } else { "" }, names[self.order[k]]));
        match self.of {
            AxesOf::Camera => {
                write!(f, "their ({}) is (right, down, forward) of the camera", parts.join(", "))
            }
            AxesOf::World => write!(f, "their ({}) is (x, y, z) of the scene", parts.join(", ")),
        }
    }
}

/// The normals that a prior, as it stands in its file, and the points of the scene have at the points that a view sees.
pub(super) fn compared_normals(
    prior: &NormalPrior,
    seen: &[SeenPoint],
    points: &[Point<Site>],
    normals: &[DVec3],
    camera: &PinholeCamera,
) -> Vec<ComparedNormal> {
    let compared = seen.iter().filter_map(|p| {
        let [x, y, z] = prior.planes.each_ref().map(|plane| f64::from(p.nearest(plane)));
        let normal = normals.get(p.index)?;
        let towards = camera.center - DVec3::from_array(points.get(p.index)?.xyz());
        let of_point = camera.cam_from_site * (*normal * normal.dot(towards).signum());
        let given = DVec3::new(x, y, z);
        (given.is_finite() && of_point.is_finite()).then_some(ComparedNormal {
            given,
            of_point,
            cam_from_site: camera.cam_from_site,
        })
    });
    compared.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;

    fn camera(k: u64) -> DMat3 {
        DMat3::from_rotation_z(0.7 * k as f64) * DMat3::from_rotation_x(-1.9)
    }

    /// Normals of four walls and a floor with errors of 6 degrees, as seen from some cameras and written in another way.
    fn compared(written: impl Fn(DVec3, &DMat3) -> DVec3) -> Vec<ComparedNormal> {
        let error = |k| DVec3::from_array(CounterRng::new(5, 0, 0, k).direction()) * 0.1;
        let walls = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z];
        let of = |k: u64| {
            let cam_from_site = camera(k % 7);
            let normal = cam_from_site * walls[k as usize % 5];
            ComparedNormal {
                given: (written(normal, &cam_from_site) + error(k)).normalize(),
                of_point: (normal + error(k + 1000)).normalize(),
                cam_from_site,
            }
        };
        (0..400).map(of).collect()
    }

    #[test]
    fn every_convention_is_found() {
        let all: Vec<NormalAxes> = NormalAxes::all().collect();
        assert_eq!((all.len(), all[0]), (96, NormalAxes::USUAL));
        for axes in all {
            let written = |normal: DVec3, cam_from_site: &DMat3| {
                let own = if axes.of == AxesOf::World { cam_from_site.transpose() * normal } else { normal };
                let mut out = [0.0; 3];
                (0..3).for_each(|k| out[axes.order[k]] = axes.signs[k] * own[k]);
                DVec3::from_array(out)
            };
            assert_eq!(NormalAxes::found(&compared(written)), Ok(Some(axes)), "{axes}");
        }
    }

    #[test]
    fn a_level_scene_from_straight_above_keeps_the_usual_axes() {
        let towards = |k| {
            let error = DVec3::from_array(CounterRng::new(5, 0, 0, k).direction()) * 0.1;
            (DVec3::NEG_Z + error).normalize()
        };
        let cam_from_site = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let up = |k| ComparedNormal { given: towards(k), of_point: towards(k + 1000), cam_from_site };
        let up: Vec<ComparedNormal> = (0..400).map(up).collect();
        assert_eq!(NormalAxes::found(&up), Ok(Some(NormalAxes::USUAL)));
    }

    #[test]
    fn normals_of_another_scene_are_refused() {
        let other = compared(|_, cam_from_site| cam_from_site * DVec3::new(0.6, 0.0, 0.8));
        assert!(NormalAxes::found(&other).is_err_and(|angle| angle > 30.0));
        let mut draws = (0..).map(|k| DVec3::from_array(CounterRng::new(9, 0, 0, k).direction()));
        let mut random = compared(|n, _| n);
        random.iter_mut().for_each(|c| c.given = draws.next().unwrap());
        assert!(NormalAxes::found(&random).is_err_and(|angle| angle > 60.0));
        assert_eq!(NormalAxes::found(&other[..10]), Ok(None));
    }
}
