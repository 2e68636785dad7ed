//! What a COLMAP model holds.

use super::super::error::PerspectiveError;
use super::super::lens::{LensCamera, LensModel};
use super::super::pose::Pose;
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::Path;

/// A camera of a COLMAP model.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapCamera {
    /// Number of the camera.
    pub id: u32,
    /// The model of its lens.
    pub model: LensModel,
    /// Columns of its images.
    pub width: u64,
    /// Rows of its images.
    pub height: u64,
    /// Parameters of the model in COLMAP's order; (0.5, 0.5) is the centre of the first pixel.
    pub parameters: Vec<f64>,
}

/// A place in an image at which a keypoint was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColmapObservation {
    /// Column, 0.5 at the centre of the first pixel.
    pub x: f64,
    /// Row, 0.5 at the centre of the first pixel.
    pub y: f64,
    /// The point that is seen there, if one was triangulated.
    pub point: Option<u64>,
}

/// An image of a COLMAP model with its pose.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapImage {
    /// Number of the image.
    pub id: u32,
    /// Rotation from world to camera axes (right, down, forward): a quaternion, its real part first.
    pub rotation: [f64; 4],
    /// Camera coordinates of the world's origin.
    pub translation: [f64; 3],
    /// Number of its camera.
    pub camera: u32,
    /// Path of the file in the folder of images.
    pub name: String,
    /// Its keypoints.
    pub observations: Vec<ColmapObservation>,
}

/// A point of a COLMAP model.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapPoint {
    /// Number of the point.
    pub id: u64,
    /// World coordinates.
    pub position: [f64; 3],
    /// Red, green, blue.
    pub rgb: [u8; 3],
    /// Mean reprojection error as the file states it, pixels.
    pub error: f64,
    /// Numbers of the images that see the point, and of the keypoints in them.
    pub track: Vec<(u32, u32)>,
}

/// A COLMAP model, in the order of its files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColmapModel {
    /// Its cameras.
    pub cameras: Vec<ColmapCamera>,
    /// Its images.
    pub images: Vec<ColmapImage>,
    /// Its points.
    pub points: Vec<ColmapPoint>,
}

/// Mean reprojection error that no reconstruction has, pixels, and over the stated one.
const MOST_PX: f64 = 4.0;
const CHANGED: f64 = 4.0;

/// How well the points of a model fit its images.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Reprojection {
    /// Number of observations of points.
    pub observations: usize,
    /// Mean distance of the observations from the projections of their points, pixels: as COLMAP, the mean over points of
    /// the mean over the track of a point.
    pub mean_px: f64,
    /// The mean of the errors that the file states for its points, if it states any, pixels. They are those of the images
    /// that were reconstructed, which are larger than undistorted and resized ones.
    pub stated_px: Option<f64>,
}

impl Reprojection {
    /// What the user should know, if the points do not fit the images as they did when they were found.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let Self { mean_px, stated_px, .. } = *self;
        let stated = stated_px.unwrap_or(MOST_PX / CHANGED);
        (mean_px > MOST_PX && mean_px > CHANGED * stated).then(|| {
            let stated = stated_px.map_or(String::new(), |px| format!(" (the file states {px:.2} px)"));
            format!(
                "the points of the model lie {mean_px:.1} px from where its images observe them{stated}; were its cameras or poses \
                 changed after the reconstruction?"
            )
        })
    }
}

impl ColmapCamera {
    /// The camera with its lens, in centre-of-pixel coordinates; none if a parameter is not finite, a focal length is not
    /// above zero or the size does not fit the memory.
    #[must_use]
    pub fn lens(&self) -> Option<LensCamera> {
        let size = (usize::try_from(self.width).ok()?, usize::try_from(self.height).ok()?);
        LensCamera::from_colmap(self.model, &self.parameters, size)
    }
}

impl ColmapImage {
    /// The pose; an error says what was found and what is expected.
    pub(super) fn pose(&self) -> Result<Pose, (String, String)> {
        Pose::from_colmap(self.rotation, self.translation)
    }
}

impl ColmapModel {
    /// Checks the values on which everything else relies: focal lengths, poses, positions, and that cameras exist.
    pub(super) fn check(&self, cameras: &Path, images: &Path) -> Result<(), PerspectiveError> {
        for camera in &self.cameras {
            if camera.width == 0 || camera.height == 0 || camera.lens().is_none() {
                let found = format!("{} x {}, {:?}", camera.width, camera.height, camera.parameters);
                let expected = format!(
                    "a size above zero and {} finite parameters of {} with a focal length above zero",
                    camera.model.parameters(),
                    camera.model.name()
                );
                return Err(PerspectiveError::field(
                    cameras,
                    format!("camera {}", camera.id),
                    found,
                    expected,
                ));
            }
        }
        let known: BTreeMap<u32, ()> = self.cameras.iter().map(|c| (c.id, ())).collect();
        for image in &self.images {
            let field = |what: &str| format!("{what} of image {} (`{}`)", image.id, image.name);
            if !known.contains_key(&image.camera) {
                let expected = "the number of a camera of cameras";
                return Err(PerspectiveError::field(
                    images,
                    field("camera"),
                    image.camera.to_string(),
                    expected,
                ));
            }
            if let Err((found, expected)) = image.pose() {
                return Err(PerspectiveError::field(images, field("pose"), found, expected));
            }
        }
        Ok(())
    }

    /// How well the points fit the images; none without points that are observed.
    #[must_use]
    pub fn reprojection(&self) -> Option<Reprojection> {
        let cameras: BTreeMap<u32, LensCamera> =
            self.cameras.iter().filter_map(|c| Some((c.id, c.lens()?))).collect();
        let images: BTreeMap<u32, _> = self
            .images
            .iter()
            .filter_map(|i| Some((i.id, (i, i.pose().ok()?, *cameras.get(&i.camera)?))))
            .collect();
        let (mut observations, mut sum, mut points) = (0, 0.0, 0usize);
        let (mut stated_sum, mut stated) = (0.0, 0usize);
        for point in &self.points {
            let error = |(image, index): &(u32, u32)| {
                let (image, pose, lens) = images.get(image)?;
                let seen = image.observations.get(*index as usize)?;
                let camera = pose.cam_from_world * (DVec3::from_array(point.position) - pose.center);
                let px = lens.project(camera)?;
                Some((px.col + 0.5 - seen.x).hypot(px.row + 0.5 - seen.y))
            };
            let errors: Vec<f64> = point.track.iter().filter_map(error).collect();
            if !errors.is_empty() {
                observations += errors.len();
                sum += errors.iter().sum::<f64>() / errors.len() as f64;
                points += 1;
                // An error below zero is COLMAP's mark of one that is not known.
                if point.error >= 0.0 {
                    stated_sum += point.error;
                    stated += 1;
                }
            }
        }
        (points > 0).then(|| Reprojection {
            observations,
            mean_px: sum / points as f64,
            stated_px: (stated > 0).then(|| stated_sum / stated as f64),
        })
    }
}
