//! `cameras.json` of the run of a perspective scene.

use super::super::PipelineError;
use crate::frame::{SiteBox, SiteGrid};
use crate::io::{read_json, write_json};
use crate::perspective::{PerspectiveScene, PerspectiveView, PinholeCamera};
use crate::run_files::{CAMERAS, SPLATS};
use crate::scene::Role;
use crate::splat::pinhole::{NEAREST, PinholePicture, WorkingFrame, extent_m};
use crate::splat::ply;
use crate::splat::recipe::{PerspectiveRecipe, Recipe};
use crate::splat::splats::Splats;
use crate::stats::quantile;
use glam::{DMat3, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Differences that writing a number may make, of lengths as a share.
const SAME: f64 = 1e-6;
/// The box of the splats leaves out this share at each side: a few lie far away.
const OUTSIDE: f64 = 0.02;

/// The content of `cameras.json`: pinhole cameras, the frame they are in, and the recipe that was trained by.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PerspectiveCameras {
    /// The site frame; none if positions are in the frame of the scene's own files.
    pub site: Option<SiteGrid>,
    /// 1.1 times the largest distance of a training camera from their mean, metres.
    pub extent_m: f64,
    /// Length of the unit in which the scene was trained ([`WorkingFrame`](crate::splat::pinhole::WorkingFrame)), metres; all of this
    /// file is in the frame of the scene.
    #[serde(default = "metre")]
    pub unit: f64,
    /// The ground below the splats: west, south, east, north, site metres.
    pub area: SiteBox,
    /// Lowest and highest altitude of the splats, site metres.
    pub altitudes: (f64, f64),
    /// All views.
    pub views: Vec<TrainedPhoto>,
    /// What was trained by.
    pub recipe: Recipe<PerspectiveRecipe>,
}

/// A view with the pinhole camera of its image after undistortion and downsampling. Axes are those of COLMAP: right, down,
/// forward; pixel (0, 0) is the centre of the first pixel.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TrainedPhoto {
    /// Its name.
    pub name: String,
    /// Whether it was trained on.
    pub role: Role,
    /// Columns and rows.
    pub size: (usize, usize),
    /// Focal lengths, pixels.
    pub focal: [f64; 2],
    /// Principal point (column, row), pixels.
    pub principal: [f64; 2],
    /// Rotation from site to camera axes, row by row.
    pub cam_from_site: [[f64; 3]; 3],
    /// Projection centre, site metres.
    pub center: [f64; 3],
}

impl TrainedPhoto {
    /// Of a view of a scene.
    #[must_use]
    pub fn new(view: &PerspectiveView) -> Self {
        let camera = &view.camera;
        Self {
            name: view.name.clone(),
            role: view.role,
            size: camera.size,
            focal: camera.focal.to_array(),
            principal: camera.principal.to_array(),
            cam_from_site: camera.cam_from_site.transpose().to_cols_array_2d(),
            center: camera.center.to_array(),
        }
    }

    /// The view of a scene, read again, that it was made from.
    ///
    /// # Errors
    /// [`PipelineError::ViewNotInScene`] if there is no view of its name with its camera: the scene is read in another way
    /// since, or its files have changed.
    pub(in super::super) fn view_of<'a>(
        &self,
        scene: &'a PerspectiveScene,
        run: &Path,
    ) -> Result<&'a PerspectiveView, PipelineError> {
        let trained = self.camera();
        let is_it = |v: &&PerspectiveView| {
            let c = &v.camera;
            let off_px = (c.focal - trained.focal).abs() + (c.principal - trained.principal).abs();
            let is_there = c.center.distance(trained.center) <= SAME * c.center.length();
            v.name == self.name && c.size == self.size && off_px.max_element() < SAME && is_there
        };
        let missing = || PipelineError::ViewNotInScene { run: run.into(), name: self.name.clone() };
        scene.views.iter().find(is_it).ok_or_else(missing)
    }

    /// Its camera.
    #[must_use]
    pub fn camera(&self) -> PinholeCamera {
        PinholeCamera {
            cam_from_site: DMat3::from_cols_array_2d(&self.cam_from_site).transpose(),
            center: DVec3::from_array(self.center),
            focal: DVec2::from_array(self.focal),
            principal: DVec2::from_array(self.principal),
            size: self.size,
        }
    }
}

/// Runs without a unit were trained in that of the scene.
fn metre() -> f64 {
    1.0
}

impl PerspectiveCameras {
    /// The cameras of a scene, and the box of its splats, which are in the frame of the scene.
    #[must_use]
    pub fn new(
        scene: &PerspectiveScene,
        frame: &WorkingFrame,
        splats: &Splats,
        recipe: Recipe<PerspectiveRecipe>,
    ) -> Self {
        let [x, y, z] = [0, 1, 2].map(|k| range(splats, k));
        let training: Vec<PinholeCamera> = scene.training().map(|v| v.camera).collect();
        Self {
            site: scene.georeference.as_ref().map(|g| g.grid),
            extent_m: extent_m(&training),
            unit: frame.unit(),
            area: (x.0, y.0, x.1, y.1),
            altitudes: z,
            views: scene.views.iter().map(TrainedPhoto::new).collect(),
            recipe,
        }
    }

    /// The frame in which the scene was trained.
    #[must_use]
    pub fn working_frame(&self) -> WorkingFrame {
        WorkingFrame::of_cameras(self.unit, &self.training_cameras())
    }

    /// A picture of splats of this run.
    #[must_use]
    pub fn picture(&self, splats: &Splats, camera: &PinholeCamera) -> PinholePicture {
        PinholePicture::render(splats, camera, NEAREST * self.unit)
    }

    /// Reads the cameras of a run folder.
    ///
    /// # Errors
    /// [`PipelineError::RunFile`].
    pub fn read(run: &Path) -> Result<Self, PipelineError> {
        let made_by = "`satgs train RUN` makes it";
        read_json(&run.join(CAMERAS)).map_err(|source| PipelineError::RunFile { source, made_by })
    }

    /// Reads the splats of a run folder; their colours are those of the images, as displayed.
    ///
    /// # Errors
    /// [`PipelineError::Ply`].
    pub fn read_splats(run: &Path) -> Result<Splats, PipelineError> {
        Ok(ply::read(&run.join(SPLATS))?)
    }

    /// The cameras of the views that were trained on.
    #[must_use]
    pub fn training_cameras(&self) -> Vec<PinholeCamera> {
        self.views.iter().filter(|v| v.role == Role::Train).map(TrainedPhoto::camera).collect()
    }

    /// The view of this name.
    ///
    /// # Errors
    /// [`PipelineError::NoView`] lists those that there are.
    pub fn find(&self, name: &str) -> Result<&TrainedPhoto, PipelineError> {
        self.views.iter().find(|v| v.name == name).ok_or_else(|| {
            let views: Vec<&str> = self.views.iter().map(|v| v.name.as_str()).collect();
            PipelineError::NoView { name: name.into(), views: views.join(", ") }
        })
    }
}

/// Writes the splats of a scene, in its own frame, and its cameras to a run folder.
pub fn write_trained(
    run: &Path,
    scene: &PerspectiveScene,
    frame: &WorkingFrame,
    splats: &Splats,
    recipe: Recipe<PerspectiveRecipe>,
) -> Result<PerspectiveCameras, PipelineError> {
    let cameras = PerspectiveCameras::new(scene, frame, splats, recipe);
    match &cameras.site {
        Some(site) => ply::write(&run.join(SPLATS), splats, site)?,
        None => ply::write_local(&run.join(SPLATS), splats)?,
    }
    write_json(&run.join(CAMERAS), &cameras)?;
    Ok(cameras)
}

/// Lowest and highest coordinate of the splats, without the outermost.
fn range(splats: &Splats, axis: usize) -> (f64, f64) {
    let values = || splats.position.iter().map(|p| f64::from(p[axis])).collect();
    let at = |share: f64| quantile(values(), share).unwrap_or(0.0);
    (at(OUTSIDE), at(1.0 - OUTSIDE))
}
