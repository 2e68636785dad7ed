//! Where a perspective scene lies on Earth: a similarity from the frame of its file to a site frame.

use super::pose::Pose;
use crate::frame::{Point, Site, SiteGrid};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// A similarity from the frame of a file to the site frame: `site = scale * rotation * file + translation`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Georeference {
    /// The site frame.
    pub grid: SiteGrid,
    /// Metres of a unit of the file.
    pub scale: f64,
    /// Rotation from file axes to site axes, row by row.
    pub rotation: [[f64; 3]; 3],
    /// Site position of the file's origin, metres.
    pub translation: [f64; 3],
    /// Root mean square distance of camera centres from the positions to which they were fitted, metres; none if the
    /// similarity was given.
    pub rms_m: Option<f64>,
    /// Number of positions to which it was fitted.
    pub positions: usize,
}

impl Georeference {
    fn matrix(&self) -> DMat3 {
        DMat3::from_cols_array_2d(&self.rotation).transpose()
    }

    /// Site position of a position in the frame of the file.
    #[must_use]
    pub fn site_from_file(&self, p: [f64; 3]) -> Point<Site> {
        let site = self.scale * (self.matrix() * DVec3::from_array(p)) + DVec3::from_array(self.translation);
        Point::new(site.x, site.y, site.z)
    }

    /// The pose in the site frame of a pose in the frame of the file.
    pub(super) fn pose(&self, pose: Pose) -> Pose {
        Pose {
            cam_from_world: pose.cam_from_world * self.matrix().transpose(),
            center: DVec3::from_array(self.site_from_file(pose.center.to_array()).xyz()),
        }
    }
}
