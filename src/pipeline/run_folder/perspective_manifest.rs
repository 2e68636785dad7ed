//! `scene.json` of the run of a perspective scene.

use super::super::PipelineError;
use crate::io::{read_json, write_json};
use crate::perspective::{
    ColorRegistration, Georeference, GeoreferenceSource, Layout, PerspectiveOptions, PerspectiveScene,
    TestViews,
};
use crate::run_files::SCENE;
use crate::scene::Role;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What `kind` says in the `scene.json` of a perspective scene.
const KIND: &str = "perspective";

/// The content of `scene.json`: where the scene lies, how it is read, and what was found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PerspectiveManifest {
    /// `perspective`.
    pub kind: String,
    /// The scene.
    pub scene: PathBuf,
    /// How it is read.
    pub options: PerspectiveOptions,
    /// How its files are arranged.
    pub layout: Layout,
    /// Where it lies on Earth, if that is known.
    pub georeference: Option<Georeference>,
    /// Place in the frame of the scene's files from which positions are measured; none for their own origin.
    #[serde(default)]
    pub origin: Option<[f64; 3]>,
    /// Number of points that it comes with.
    pub points: usize,
    /// Its views.
    pub views: Vec<ManifestView>,
    /// Images and files that were left out, and why.
    pub skipped: Vec<(String, String)>,
    /// Keys and files of the scene that are not used, and why.
    #[serde(default)]
    pub unused: Vec<(String, String)>,
    /// The colour camera of RGB-D frames, if it is another one than that of the depth maps.
    #[serde(default)]
    pub registration: Option<ColorRegistration>,
}

/// A view in `scene.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ManifestView {
    /// Its name.
    pub name: String,
    /// Its image file.
    pub image: PathBuf,
    /// Whether it is trained on.
    pub role: Role,
    /// Columns and rows as it is read.
    pub size: (usize, usize),
}

impl PerspectiveManifest {
    /// The manifest of a scene that was read from a path. Paths become absolute, so that the run can be used from anywhere.
    #[must_use]
    pub fn new(path: &Path, options: &PerspectiveOptions, scene: &PerspectiveScene) -> Self {
        let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.into());
        let mut options = options.clone();
        if let TestViews::List(list) = &mut options.test_views {
            *list = absolute(list);
        }
        if let Some(GeoreferenceSource::File(file)) = &mut options.georeference {
            *file = absolute(file);
        }
        let view = |v: &crate::perspective::PerspectiveView| ManifestView {
            name: v.name.clone(),
            image: absolute(&v.image),
            role: v.role,
            size: v.camera.size,
        };
        Self {
            kind: KIND.into(),
            scene: absolute(path),
            options,
            layout: scene.layout,
            georeference: scene.georeference.clone(),
            origin: scene.origin,
            points: scene.points.len(),
            views: scene.views.iter().map(view).collect(),
            skipped: scene.skipped.clone(),
            unused: scene.unused.clone(),
            registration: scene.registration,
        }
    }

    /// Reads the manifest of a run.
    ///
    /// # Errors
    /// [`PipelineError::RunFile`].
    pub fn read(run: &Path) -> Result<Self, PipelineError> {
        let made_by = "`satgs run SCENE -o RUN` makes it";
        read_json(&run.join(SCENE)).map_err(|source| PipelineError::RunFile { source, made_by })
    }

    /// Writes it into a run.
    pub(crate) fn write(&self, run: &Path) -> Result<(), PipelineError> {
        Ok(write_json(&run.join(SCENE), self)?)
    }

    /// An error if a folder holds the run of a satellite scene, which photographs would replace.
    pub(crate) fn require_no_satellites(run: &Path) -> Result<(), PipelineError> {
        let is_other = run.join(SCENE).exists() && !is_run(run);
        if is_other { Err(PipelineError::OfSatellites { run: run.into() }) } else { Ok(()) }
    }

    /// Reads the scene again.
    ///
    /// # Errors
    /// [`PipelineError::Perspective`] when it is no longer there or has changed for the worse.
    pub fn read_scene(&self) -> Result<PerspectiveScene, PipelineError> {
        let scene = PerspectiveScene::read_again(&self.scene, &self.options, self.registration)?;
        Ok(match self.origin {
            Some(origin) => scene.measured_from(origin),
            None => scene,
        })
    }
}

/// Whether a folder holds the run of a perspective scene.
pub fn is_run(run: &Path) -> bool {
    let read = read_json::<serde_json::Value>(&run.join(SCENE));
    read.is_ok_and(|manifest| manifest["kind"] == KIND)
}

/// An error if a folder holds the run of a perspective scene, which the caller cannot work on.
pub fn refuse(run: &Path) -> Result<(), PipelineError> {
    if is_run(run) { Err(PipelineError::OfPerspective { run: run.into() }) } else { Ok(()) }
}
