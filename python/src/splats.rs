//! What `satgs.Splats` calls: splat files, changes of frame, renders. `satgs/_splats.py` documents it.

use crate::arrays;
use crate::error::exception;
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use satgs::frame::{Point, SiteGrid};
use satgs::pipeline::TrainedPhoto;
use satgs::scene::Role;
use satgs::splat::pinhole::PinholePicture;
use satgs::splat::ply::{self, PlyTable};
use satgs::splat::primitive::FLAT_LOG_SCALE;
use satgs::splat::splats::Splats;
use std::path::PathBuf;

/// Spherical harmonics above degree 0 of a colour channel.
const REST: usize = 15;

/// The parameters of splats, each of shape (n, width); flat splats have two scales.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Groups<'py> {
    position: PyReadonlyArray2<'py, f32>,
    f_dc: PyReadonlyArray2<'py, f32>,
    f_rest: Option<PyReadonlyArray2<'py, f32>>,
    opacity_logit: PyReadonlyArray2<'py, f32>,
    log_scale: PyReadonlyArray2<'py, f32>,
    rotation: PyReadonlyArray2<'py, f32>,
}

/// EPSG code, and easting, northing and ellipsoidal height of the origin.
pub type Site = (u32, [f64; 3]);

/// Focal lengths, principal point, rotation from the frame of the splats to the camera, centre, columns and rows.
pub type Camera = ([f64; 2], [f64; 2], [[f64; 3]; 3], [f64; 3], (usize, usize));

/// Bytes before the table of a splat file, its rows, and the names of its columns.
#[pyfunction]
pub fn splat_table(py: Python<'_>, path: PathBuf) -> PyResult<(usize, usize, Vec<String>)> {
    let table = py.detach(|| PlyTable::of(&path)).map_err(|e| exception(py, e))?;
    Ok((table.offset, table.rows, table.columns))
}

/// Writes splats, and their georeference beside them if they have one.
#[pyfunction]
#[pyo3(signature = (path, groups, site))]
pub fn write_splats(py: Python<'_>, path: PathBuf, groups: Groups<'_>, site: Option<Site>) -> PyResult<()> {
    let splats = groups.splats()?;
    let site = site.map(site_grid);
    let written = py.detach(|| match site {
        Some(site) => ply::write(&path, &splats, &site),
        None => ply::write_local(&path, &splats),
    });
    written.map_err(|e| exception(py, e))
}

/// The parameters of the splats in another frame: `to = scale * rotation * from + translation`.
#[pyfunction]
pub fn transform_splats<'py>(
    py: Python<'py>,
    groups: Groups<'_>,
    scale: f64,
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
) -> PyResult<Bound<'py, PyDict>> {
    let splats = groups.splats()?;
    let out = py.detach(|| splats.transformed(scale, rotation, translation));
    let dict = PyDict::new(py);
    dict.set_item("position", arrays::rows(py, out.position)?)?;
    dict.set_item("f_dc", arrays::rows(py, out.f_dc)?)?;
    let rest = (!out.f_rest.is_empty()).then(|| arrays::rows(py, out.f_rest)).transpose()?;
    dict.set_item("f_rest", rest)?;
    dict.set_item("opacity_logit", arrays::rows(py, out.opacity_logit)?)?;
    dict.set_item("log_scale", arrays::rows(py, out.log_scale)?)?;
    dict.set_item("rotation", arrays::rows(py, out.rotation)?)?;
    Ok(dict)
}

/// Renders the splats as a pinhole camera sees them beyond the depth `nearest`: colours, depth, opacity, and of flat splats
/// the depth of the surface and its normals.
#[pyfunction]
pub fn render_splats<'py>(
    py: Python<'py>,
    groups: Groups<'_>,
    camera: Camera,
    nearest: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let splats = groups.splats()?;
    let photo = photo(camera)?;
    let picture = py.detach(|| PinholePicture::render(&splats, &photo.camera(), nearest));
    let dict = PyDict::new(py);
    dict.set_item("colors", arrays::picture(py, &picture.colors)?)?;
    dict.set_item("depth", arrays::plane(py, picture.depth)?)?;
    dict.set_item("opacity", arrays::plane(py, picture.opacity)?)?;
    if let Some(discs) = picture.discs {
        dict.set_item("surface_depth", arrays::plane(py, discs.median_depth)?)?;
        dict.set_item("normals", arrays::picture(py, &discs.normals)?)?;
    }
    Ok(dict)
}

/// A frame on the map.
pub fn site_grid((epsg, [east, north, height]): Site) -> SiteGrid {
    SiteGrid { epsg, origin: Point::new(east, north, height) }
}

/// A photograph with this camera.
pub fn photo(camera: Camera) -> PyResult<TrainedPhoto> {
    let (focal, principal, cam_from_site, center, size) = camera;
    if size.0 == 0 || size.1 == 0 {
        let text = format!("the camera has {} x {} pixels, expected 1 or more", size.0, size.1);
        return Err(PyValueError::new_err(text));
    }
    let name = String::new();
    Ok(TrainedPhoto { name, role: Role::Train, size, focal, principal, cam_from_site, center })
}

impl Groups<'_> {
    /// The splats of the library.
    fn splats(&self) -> PyResult<Splats> {
        let n = self.position.shape()[0];
        let mut splats = Splats::zeros(n);
        splats.position = rows("position", &self.position, n, [0.0; 3], 3)?;
        splats.f_dc = rows("f_dc", &self.f_dc, n, [0.0; 3], 3)?;
        splats.opacity_logit = rows("opacity_logit", &self.opacity_logit, n, [0.0], 1)?;
        let axes = if self.log_scale.shape()[1] == 2 { 2 } else { 3 };
        splats.log_scale = rows("log_scale", &self.log_scale, n, [FLAT_LOG_SCALE; 3], axes)?;
        splats.rotation = rows("rotation", &self.rotation, n, [0.0; 4], 4)?;
        if let Some(rest) = &self.f_rest {
            splats.f_rest = harmonics(rest, n)?;
        }
        Ok(splats)
    }
}

/// The rows of an array of shape (n, `width`); what is missing of `W` values is that of `filled`.
fn rows<const W: usize>(
    name: &str,
    array: &PyReadonlyArray2<'_, f32>,
    n: usize,
    filled: [f32; W],
    width: usize,
) -> PyResult<Vec<[f32; W]>> {
    if array.shape() != [n, width] {
        let message = format!("`{name}` has the shape {:?}, expected ({n}, {width})", array.shape());
        return Err(PyValueError::new_err(message));
    }
    let row = |row: numpy::ndarray::ArrayView1<'_, f32>| {
        let mut out = filled;
        out.iter_mut().zip(row).for_each(|(out, v)| *out = *v);
        out
    };
    let rows: Vec<[f32; W]> = array.as_array().rows().into_iter().map(row).collect();
    if rows.iter().flatten().any(|v| !v.is_finite()) {
        return Err(PyValueError::new_err(format!("a value of `{name}` is not finite")));
    }
    Ok(rows)
}

/// Coefficients channel by channel, of degree 1, 2 or 3, filled up to degree 3.
fn harmonics(array: &PyReadonlyArray2<'_, f32>, n: usize) -> PyResult<Vec<[f32; 3 * REST]>> {
    let width = array.shape()[1];
    let of_channel = width / 3;
    if ![3, 8, REST].contains(&of_channel) || width != 3 * of_channel {
        let message = format!("`f_rest` has {width} columns, expected 9, 24 or 45");
        return Err(PyValueError::new_err(message));
    }
    let given: Vec<[f32; 3 * REST]> = rows("f_rest", array, n, [0.0; 3 * REST], width)?;
    let place = |row: [f32; 3 * REST]| {
        let mut out = [0.0; 3 * REST];
        for (channel, values) in row[..width].chunks_exact(of_channel).enumerate() {
            out[channel * REST..][..of_channel].copy_from_slice(values);
        }
        out
    };
    Ok(given.into_iter().map(place).collect())
}
