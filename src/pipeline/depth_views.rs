//! The cameras of a run or a scene as cameras of depth maps.

use super::PerspectiveCameras;
use super::run_folder::perspective_manifest;
use super::{PipelineError, TrainedCameras};
use crate::affine::{SiteScene, SiteView, ViewCamera};
use crate::frame::{Point, SiteGrid};
use crate::mesh::DepthCamera;
use crate::perspective::{PerspectiveOptions, PerspectiveScene, TestViews};
use crate::run_files::CAMERAS;
use crate::scene::Role;
use std::path::Path;

/// The cameras of a run or a scene.
pub(super) struct DepthViews {
    /// Name and camera of each view.
    pub cameras: Vec<(String, DepthCamera)>,
    /// Where the frame is on Earth, if that is known.
    pub site: Option<SiteGrid>,
}

impl DepthViews {
    /// The training views of a run, or all views of a perspective scene.
    ///
    /// # Errors
    /// [`PipelineError`] if the path is neither, or a file of it cannot be read.
    pub fn read(path: &Path) -> Result<Self, PipelineError> {
        if !is_run(path) && PerspectiveScene::is_one(path) {
            let scene = read_perspective(path)?;
            let cameras = scene.views.iter().map(|v| (v.name.clone(), DepthCamera::Pinhole(v.camera)));
            return Ok(Self { cameras: cameras.collect(), site: scene.georeference.map(|g| g.grid) });
        }
        if perspective_manifest::is_run(path) {
            let PerspectiveCameras { views, site, .. } = PerspectiveCameras::read(path)?;
            let training = views.iter().filter(|v| v.role == Role::Train);
            let cameras = training.map(|v| (v.name.clone(), DepthCamera::Pinhole(v.camera())));
            return Ok(Self { cameras: cameras.collect(), site });
        }
        let setup = TrainedCameras::read(path)?.setup;
        let training = setup.views.iter().filter(|v| v.role == Role::Train);
        let cameras = training
            .filter_map(|v| seen_part(v, &setup).map(|(camera, size)| (v.name.clone(), camera, size)))
            .map(|(name, camera, size)| (name, DepthCamera::Parallel { camera, size }))
            .collect();
        Ok(Self { cameras, site: Some(setup.site) })
    }
}

/// Whether a folder is that of a trained run.
pub(super) fn is_run(path: &Path) -> bool {
    path.join(CAMERAS).exists()
}

/// Reads a perspective scene, all of whose views are used.
pub(super) fn read_perspective(path: &Path) -> Result<PerspectiveScene, PipelineError> {
    let options = PerspectiveOptions { test_views: TestViews::None, ..PerspectiveOptions::default() };
    Ok(PerspectiveScene::read(path, &options)?)
}

/// The box that is trained: lowest and highest coordinates, site metres.
pub(super) fn trained_box(setup: &SiteScene) -> [[f64; 3]; 2] {
    let ((west, south, east, north), (low, high)) = (setup.area, setup.altitudes);
    [[west, south, low], [east, north, high]]
}

/// Camera and size of the part of a view that shows the trained box; none if no part does.
pub(super) fn seen_part(view: &SiteView, setup: &SiteScene) -> Option<(ViewCamera, (usize, usize))> {
    let ends = trained_box(setup);
    let corners = (0..8).map(|i| {
        let [x, y, z] = std::array::from_fn(|k| ends[i >> k & 1][k]);
        view.camera.project(Point::new(x, y, z))
    });
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for px in corners {
        for (k, v) in [px.col, px.row].into_iter().enumerate() {
            (low[k], high[k]) = (low[k].min(v), high[k].max(v));
        }
    }
    let size = [view.size.0, view.size.1];
    let first: [f64; 2] = std::array::from_fn(|k| low[k].floor().max(0.0));
    let count: [f64; 2] = std::array::from_fn(|k| high[k].ceil().min(size[k] as f64 - 1.0) - first[k] + 1.0);
    let is_seen = count.iter().all(|n| *n >= 1.0);
    is_seen.then(|| (view.camera.cropped(first[0], first[1]), (count[0] as usize, count[1] as usize)))
}
