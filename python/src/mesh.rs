//! What `satgs.Mesh` and `satgs.fuse_depths` call: mesh files, depth maps fused to a mesh. `satgs/_mesh.py` documents them.

use crate::arrays;
use crate::error::exception;
use crate::splats::{Camera, Site, photo, site_grid};
use crate::work;
use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use satgs::io::Grid2;
use satgs::mesh::{DepthCamera, DepthMap, FuseOptions, KeptPieces, TriangleMesh, fuse};
use satgs::pipeline::PipelineError;
use std::path::PathBuf;

/// The arrays of a mesh: vertices and normals of shape (n, 3), triangles of shape (m, 3), colours of shape (n, 3).
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct MeshArrays<'py> {
    vertices: PyReadonlyArray2<'py, f64>,
    triangles: PyReadonlyArray2<'py, u32>,
    normals: Option<PyReadonlyArray2<'py, f32>>,
    colors: Option<PyReadonlyArray2<'py, u8>>,
}

/// A camera, depths of shape (rows, columns), and colours from 0 to 1 of shape (rows, columns, 3).
type Map<'py> = (Camera, PyReadonlyArray2<'py, f32>, Option<PyReadonlyArray3<'py, f32>>);

/// Reads a mesh: its arrays, and where it stands on Earth.
#[pyfunction]
pub fn read_mesh(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let mesh = py.detach(|| TriangleMesh::read(&path)).map_err(|e| exception(py, e))?;
    let site = mesh.site.as_ref().map(|site| (site.epsg, <(f64, f64, f64)>::from(site.origin.xyz())));
    let dict = described(py, mesh)?;
    dict.set_item("site", site)?;
    Ok(dict)
}

/// Writes a mesh whose third axis points up, in the format of the file's name.
#[pyfunction]
#[pyo3(signature = (path, arrays, site))]
pub fn write_mesh(py: Python<'_>, path: PathBuf, arrays: MeshArrays<'_>, site: Option<Site>) -> PyResult<()> {
    let mesh = TriangleMesh { site: site.map(site_grid), ..arrays.mesh()? };
    py.detach(|| mesh.write(&path)).map_err(|e| exception(py, e))
}

/// Fuses depth maps of pinhole cameras to a mesh. Depths that are zero, negative or not finite are not known.
#[pyfunction]
#[pyo3(signature = (maps, voxel, truncation, depth_max, kept, progress))]
pub fn fuse_depths<'py>(
    py: Python<'py>,
    maps: Vec<Map<'_>>,
    voxel: f64,
    truncation: f64,
    depth_max: Option<f64>,
    kept: (usize, usize),
    progress: Py<PyAny>,
) -> PyResult<Bound<'py, PyDict>> {
    let maps = maps.iter().map(depth_map).collect::<PyResult<Vec<_>>>()?;
    let kept = KeptPieces { most: kept.0, least_triangles: kept.1 };
    let options =
        FuseOptions { voxel_m: voxel, truncation_m: truncation, depth_max_m: depth_max, bounds: None, kept };
    let fused = work::run(py, &progress, |progress| {
        fuse(maps.into_iter().map(Ok::<_, PipelineError>), &options, progress)
    })?;
    described(py, fused.mesh)
}

fn depth_map((camera, depth, colors): &Map<'_>) -> PyResult<DepthMap> {
    let camera = DepthCamera::Pinhole(photo(*camera)?.camera());
    let [height, width] = [depth.shape()[0], depth.shape()[1]];
    let known = |depth: f32| if depth > 0.0 && depth.is_finite() { depth } else { f32::NAN };
    let data = depth.as_array().iter().map(|depth| known(*depth)).collect();
    let mut map = DepthMap::new(camera, Grid2 { width, height, data });
    if let Some(colors) = colors {
        if colors.shape() != [height, width, 3] {
            let text = format!("colors have the shape {:?}, expected ({height}, {width}, 3)", colors.shape());
            return Err(PyValueError::new_err(text));
        }
        let all = colors.as_array();
        let plane = |k: usize| all.index_axis(numpy::ndarray::Axis(2), k).iter().copied().collect();
        map.color = Some([0, 1, 2].map(|k| Grid2 { width, height, data: plane(k) }));
    }
    Ok(map)
}

fn described(py: Python<'_>, mesh: TriangleMesh) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("vertices", arrays::rows(py, mesh.vertices)?)?;
    dict.set_item("triangles", arrays::rows(py, mesh.triangles)?)?;
    let normals = (!mesh.normals.is_empty()).then(|| arrays::rows(py, mesh.normals)).transpose()?;
    dict.set_item("normals", normals)?;
    let colors = (!mesh.colors.is_empty()).then(|| arrays::rows(py, mesh.colors)).transpose()?;
    dict.set_item("colors", colors)?;
    Ok(dict)
}

impl MeshArrays<'_> {
    fn mesh(&self) -> PyResult<TriangleMesh> {
        let vertices = triples("vertices", &self.vertices, None)?;
        let count = vertices.len();
        let triangles: Vec<[u32; 3]> = triples("triangles", &self.triangles, None)?;
        if let Some((i, t)) =
            triangles.iter().enumerate().find(|(_, t)| t.iter().any(|v| *v as usize >= count))
        {
            let text = format!("triangle {i} names the vertices {t:?}, but there are {count}");
            return Err(PyValueError::new_err(text));
        }
        if vertices.iter().flatten().any(|v| !v.is_finite()) {
            return Err(PyValueError::new_err("a value of `vertices` is not finite"));
        }
        let normals = self.normals.as_ref().map(|n| triples("normals", n, Some(count))).transpose()?;
        let colors = self.colors.as_ref().map(|c| triples("colors", c, Some(count))).transpose()?;
        Ok(TriangleMesh {
            vertices,
            triangles,
            normals: normals.unwrap_or_default(),
            colors: colors.unwrap_or_default(),
            ..TriangleMesh::default()
        })
    }
}

/// The rows of an array of shape (n, 3), of so many rows if that is known.
fn triples<T: numpy::Element + Copy>(
    name: &str,
    array: &PyReadonlyArray2<'_, T>,
    count: Option<usize>,
) -> PyResult<Vec<[T; 3]>> {
    let [rows, columns] = [array.shape()[0], array.shape()[1]];
    if columns != 3 || count.is_some_and(|count| count != rows) {
        let expected = count.map_or("n".to_owned(), |count| count.to_string());
        let text = format!("`{name}` has the shape ({rows}, {columns}), expected ({expected}, 3)");
        return Err(PyValueError::new_err(text));
    }
    Ok(array.as_array().rows().into_iter().map(|row| [row[0], row[1], row[2]]).collect())
}
