//! What `satgs.Scene` calls: scenes of either kind, their views with images. `satgs/_scene.py` documents it.

use crate::arrays;
use crate::error::exception;
use crate::rpc::Rpc;
use crate::work;
use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use satgs::cli::{self, CliError};
use satgs::perspective::{PerspectiveScene, PerspectiveView};
use satgs::pipeline::TrainedPhoto;
use satgs::rpc::formats::RpcFile;
use satgs::run::AnyScene;
use satgs::scene::{Role, Scene, View};
use std::ffi::OsString;

/// A view of a scene: an image with its camera.
#[pyclass(frozen, module = "satgs._satgs")]
pub struct SceneView(Kind);

enum Kind {
    Satellite(Box<View>),
    Photograph(Box<PerspectiveView>),
}

#[pymethods]
impl SceneView {
    /// What is known of the view, by the names of the attributes of `satgs.View`.
    fn describe<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        let (name, image, role, size) = match &self.0 {
            Kind::Satellite(v) => (&v.name, &v.image, v.role, (v.width, v.height)),
            Kind::Photograph(v) => (&v.name, &v.image, v.role, v.camera.size),
        };
        dict.set_item("name", name)?;
        dict.set_item("path", image)?;
        dict.set_item("role", if role == Role::Test { "test" } else { "train" })?;
        dict.set_item("size", size)?;
        match &self.0 {
            Kind::Satellite(v) => {
                dict.set_item("sun", v.sun.map(|sun| (sun.azimuth_deg, sun.elevation_deg)))?;
                dict.set_item("acquired", &v.acquired)?;
                dict.set_item("rpc", Rpc::from(RpcFile::new(v.rpc.clone(), "scene")))?;
            }
            Kind::Photograph(v) => {
                dict.set_item("pinhole", arrays::pinhole(&TrainedPhoto::new(v)))?;
            }
        }
        Ok(dict)
    }

    /// Colours from 0 to 1, of shape (rows, columns, bands); NaN at pixels that are not valid.
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let read = py.detach(|| match &self.0 {
            Kind::Satellite(v) => v.read_colors().map_err(CliError::from),
            Kind::Photograph(v) => v.read_image().map(|i| i.planes.into()).map_err(CliError::from),
        });
        arrays::picture(py, &read.map_err(|e| exception(py, e))?)
    }

    /// Depths along the optical axis, of shape (rows, columns); none without a depth map.
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        let Kind::Photograph(view) = &self.0 else { return Ok(None) };
        if view.depth.is_none() {
            return Ok(None);
        }
        let depth = py.detach(|| view.read_depth()).map_err(|e| exception(py, e))?;
        arrays::plane(py, depth).map(Some)
    }

    /// Longitudes and latitudes of the corners at a height; none of photographs, and where the camera tells none.
    fn footprint(&self, height_m: f64) -> Option<[[f64; 2]; 4]> {
        let Kind::Satellite(view) = &self.0 else { return None };
        Some(view.footprint(height_m)?.map(|p| [p.lon_deg(), p.lat_deg()]))
    }
}

/// Reads a scene. `words` are those of `satgs info`. Returns its views and what is known of all of them, by the names of the
/// attributes of `satgs.Scene`.
#[pyfunction]
pub fn read_scene(
    py: Python<'_>,
    words: Vec<OsString>,
    progress: Py<PyAny>,
) -> PyResult<(Vec<SceneView>, Bound<'_, PyDict>)> {
    let scene = work::run(py, &progress, |progress| cli::read_scene(words, progress))?;
    let known = PyDict::new(py);
    let views = match scene {
        AnyScene::Satellites(scene) => of_satellites(*scene, &known)?,
        AnyScene::Photographs(found) => of_photographs(py, found.scene, &known)?,
    };
    Ok((views, known))
}

fn of_satellites(scene: Scene, known: &Bound<'_, PyDict>) -> PyResult<Vec<SceneView>> {
    known.set_item("kind", "satellite")?;
    known.set_item("height_range", scene.height_range())?;
    known.set_item("gamma", scene.transfer_function.gamma())?;
    known.set_item("warnings", &scene.warnings)?;
    Ok(scene.views.into_iter().map(|view| SceneView(Kind::Satellite(view.into()))).collect())
}

fn of_photographs<'py>(
    py: Python<'py>,
    scene: PerspectiveScene,
    known: &Bound<'py, PyDict>,
) -> PyResult<Vec<SceneView>> {
    known.set_item("kind", scene.layout.name())?;
    let georeference = scene.georeference.as_ref();
    let site = georeference.map(|g| (g.grid.epsg, <(f64, f64, f64)>::from(g.grid.origin.xyz())));
    known.set_item("site", site)?;
    let warnings: Vec<&String> = georeference.iter().flat_map(|g| g.warnings()).collect();
    known.set_item("warnings", warnings)?;
    let places: Vec<[f64; 3]> = scene.points.iter().map(|p| p.position.xyz()).collect();
    let colors: Vec<[u8; 3]> = scene.points.iter().map(|p| p.rgb).collect();
    known.set_item("points", (arrays::rows(py, places)?, arrays::rows(py, colors)?))?;
    Ok(scene.views.into_iter().map(|view| SceneView(Kind::Photograph(view.into()))).collect())
}
