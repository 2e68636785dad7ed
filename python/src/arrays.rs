//! Values of the library as arrays of NumPy.

use numpy::{Element, IntoPyArray, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use satgs::io::Grid2;
use satgs::pipeline::TrainedPhoto;

/// An array of shape (n, `W`).
pub fn rows<'py, T: Element, const W: usize>(
    py: Python<'py>,
    rows: Vec<[T; W]>,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let n = rows.len();
    rows.into_flattened().into_pyarray(py).reshape([n, W])
}

/// A plane as an array of shape (rows, columns).
pub fn plane(py: Python<'_>, plane: Grid2) -> PyResult<Bound<'_, PyArray2<f32>>> {
    let shape = [plane.height, plane.width];
    plane.data.into_pyarray(py).reshape(shape)
}

/// Planes of one size as an array of shape (rows, columns, planes), as pictures have it.
pub fn picture<'py>(py: Python<'py>, planes: &[Grid2]) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (width, height) = planes.first().map_or((0, 0), |plane| (plane.width, plane.height));
    let values: Vec<f32> =
        (0..width * height).flat_map(|i| planes.iter().map(move |plane| plane.data[i])).collect();
    values.into_pyarray(py).reshape([height, width, planes.len()])
}

/// Three numbers, as a tuple of Python.
type Triple = (f64, f64, f64);

/// The arguments of `satgs.PinholeCamera`: focal lengths, principal point, rotation, centre, columns and rows.
type Pinhole = ((f64, f64), (f64, f64), (Triple, Triple, Triple), Triple, (usize, usize));

/// A camera as the arguments of `satgs.PinholeCamera`.
pub fn pinhole(camera: &TrainedPhoto) -> Pinhole {
    let rows = camera.cam_from_site.map(Triple::from);
    (camera.focal.into(), camera.principal.into(), rows.into(), camera.center.into(), camera.size)
}
