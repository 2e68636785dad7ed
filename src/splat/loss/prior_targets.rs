//! The priors that a view's depths and normals are compared with.

use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use crate::prior::{DepthPrior, NormalPrior, ViewPriors};
use glam::DVec3;

/// The priors of a view as the loss terms compare them; a term without its prior is zero.
#[derive(Clone, Debug, Default)]
pub struct PriorTargets {
    /// Depths.
    pub(super) depth: Option<DepthPrior>,
    /// The components of unit normals that face the camera, in site axes; NaN where nothing is known.
    pub(super) normal: Option<[Grid2; 3]>,
}

impl PriorTargets {
    /// The prior of the depths.
    #[must_use]
    pub fn depth(&self) -> Option<&DepthPrior> {
        self.depth.as_ref()
    }

    /// The components of the unit normals of the prior in site axes; NaN where nothing is known.
    #[must_use]
    pub fn normal(&self) -> Option<&[Grid2; 3]> {
        self.normal.as_ref()
    }

    /// Whether there is a prior of depths or of normals.
    #[must_use]
    pub fn is_any(&self) -> bool {
        self.depth.is_some() || self.normal.is_some()
    }

    /// Turns the normals of priors into site axes. Priors that are not of the size of the camera are left out.
    #[must_use]
    pub fn new(priors: ViewPriors, camera: &PinholeCamera) -> Self {
        let (width, height) = camera.size;
        let fits =
            |grid: &Grid2| (grid.width, grid.height) == (width, height) && grid.data.len() == width * height;
        let depth = priors.depth.filter(|prior| fits(&prior.values));
        let normal = priors.normal.filter(|prior| prior.planes.iter().all(fits));
        Self { depth, normal: normal.map(|prior| in_site_axes(prior, camera)) }
    }
}

/// The unit normals of a prior, in site axes.
fn in_site_axes(prior: NormalPrior, camera: &PinholeCamera) -> [Grid2; 3] {
    let site_from_cam = camera.cam_from_site.transpose();
    let mut planes = prior.planes;
    let [x, y, z] = &mut planes;
    for ((x, y), z) in x.data.iter_mut().zip(&mut y.data).zip(&mut z.data) {
        let normal = DVec3::new((*x).into(), (*y).into(), (*z).into());
        // Without a direction, as zero has none, all three become NaN.
        let turned = site_from_cam * (normal / normal.length());
        [*x, *y, *z] = turned.as_vec3().to_array();
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prior::DepthKind;
    use glam::{DMat3, DVec2};

    fn camera() -> PinholeCamera {
        // The camera looks along the site's x axis: right is -y, down is -z.
        let cam_from_site = DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X).transpose();
        let (focal, principal) = (DVec2::ONE, DVec2::ZERO);
        PinholeCamera { cam_from_site, center: DVec3::ZERO, focal, principal, size: (3, 1) }
    }

    #[test]
    fn normals_are_unit_vectors_in_site_axes_and_unknown_where_they_have_no_direction() {
        let plane = |data: [f32; 3]| Grid2 { width: 3, height: 1, data: data.into() };
        let planes = [plane([0.0, 2.0, 0.0]), plane([0.0, 0.0, 0.0]), plane([-0.5, 0.0, 0.0])];
        let priors = ViewPriors { normal: Some(NormalPrior { planes }), depth: None };
        let [x, y, z] = PriorTargets::new(priors, &camera()).normal.unwrap();
        assert_eq!((x.data[0], y.data[0], z.data[0]), (-1.0, 0.0, 0.0));
        assert_eq!((x.data[1], y.data[1], z.data[1]), (0.0, -1.0, 0.0));
        assert!([x, y, z].iter().all(|plane| plane.data[2].is_nan()));
    }

    #[test]
    fn priors_of_another_size_are_left_out() {
        let of = |width: usize| {
            let depth = DepthPrior { values: Grid2::from_fn(width, 1, |_, _| 1.0), kind: DepthKind::Metric };
            PriorTargets::new(ViewPriors { depth: Some(depth), normal: None }, &camera()).depth.is_some()
        };
        assert!(of(3) && !of(2));
    }
}
