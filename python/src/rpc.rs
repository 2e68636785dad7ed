//! What `satgs.Rpc`, the rational polynomial camera with arrays of NumPy, calls. `satgs/_rpc.py` documents it.

use crate::error::exception;
use numpy::{IntoPyArray, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use satgs::rpc::formats::{self, RpcFile, ViewTags};
use satgs::rpc::{GroundBatch, PixelBatch};
use satgs::scene::read_camera;
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// Rational polynomial camera (RPC00B).
#[pyclass(frozen, eq, module = "satgs._satgs")]
pub struct Rpc {
    rpc: satgs::rpc::Rpc,
    /// Name of the format that it was read from.
    #[pyo3(get)]
    format: String,
    /// What is odd about the file, one sentence each.
    warnings: Vec<String>,
}

/// Two arrays of one shape, for Python.
type TwoArrays<'py> = (Bound<'py, PyArrayDyn<f64>>, Bound<'py, PyArrayDyn<f64>>);

/// Number of points that are projected at once: their numbers stay in the cache of a core.
const BLOCK: usize = 4096;

/// Three arrays of one shape, and that shape.
struct Arrays<'py> {
    arrays: [PyReadonlyArrayDyn<'py, f64>; 3],
    shape: Vec<usize>,
}

impl From<RpcFile> for Rpc {
    fn from(file: RpcFile) -> Self {
        Self { rpc: file.rpc, format: file.format.into(), warnings: file.warnings }
    }
}

#[pymethods]
impl Rpc {
    #[staticmethod]
    #[pyo3(signature = (path, *, trust_rpc = None))]
    fn read(py: Python<'_>, path: PathBuf, trust_rpc: Option<bool>) -> PyResult<Self> {
        let read = py.detach(|| read_camera(&path, trust_rpc.unwrap_or_default()));
        read.map(Self::from).map_err(|e| exception(py, e))
    }

    #[new]
    fn new(py: Python<'_>, text: &str) -> PyResult<Self> {
        formats::parse(Path::new("text"), text).map(Self::from).map_err(|e| exception(py, e))
    }

    fn to_json(&self) -> String {
        formats::to_json(&self.rpc, &ViewTags::default())
    }

    fn project<'py>(
        &self,
        py: Python<'py>,
        lon: &Bound<'py, PyAny>,
        lat: &Bound<'py, PyAny>,
        h: &Bound<'py, PyAny>,
    ) -> PyResult<TwoArrays<'py>> {
        let points = Arrays::broadcast(py, [lon, lat, h])?;
        let columns = points.columns();
        let n = columns[0].len();
        let (mut col, mut row) = (Vec::with_capacity(n), Vec::with_capacity(n));
        py.detach(|| {
            let (mut ground, mut seen) = (GroundBatch::default(), PixelBatch::default());
            for start in (0..n).step_by(BLOCK) {
                let block = start..n.min(start + BLOCK);
                for (into, from) in
                    [&mut ground.lon_deg, &mut ground.lat_deg, &mut ground.height_m].into_iter().zip(&columns)
                {
                    into.clear();
                    into.extend_from_slice(&from[block.clone()]);
                }
                self.rpc.project_batch(&ground, &mut seen);
                col.extend_from_slice(&seen.col);
                row.extend_from_slice(&seen.row);
            }
        });
        shaped(py, [col, row], &points.shape)
    }

    fn localize<'py>(
        &self,
        py: Python<'py>,
        col: &Bound<'py, PyAny>,
        row: &Bound<'py, PyAny>,
        h: &Bound<'py, PyAny>,
    ) -> PyResult<TwoArrays<'py>> {
        let points = Arrays::broadcast(py, [col, row, h])?;
        let [col, row, height_m] = points.columns().map(Cow::into_owned);
        let pixels = PixelBatch { col, row };
        let mut ground = GroundBatch::default();
        py.detach(|| self.rpc.localize_batch(&pixels, &height_m, &mut ground));
        shaped(py, [ground.lon_deg, ground.lat_deg], &points.shape)
    }

    #[getter]
    fn warnings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.warnings)
    }

    #[getter]
    fn image_offset<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let c = self.rpc.coefficients();
        PyArray1::from_slice(py, &[c.col.offset, c.row.offset])
    }

    #[getter]
    fn image_scale<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let c = self.rpc.coefficients();
        PyArray1::from_slice(py, &[c.col.scale, c.row.scale])
    }

    #[getter]
    fn ground_offset<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let c = self.rpc.coefficients();
        PyArray1::from_slice(py, &[c.lon.offset, c.lat.offset, c.height.offset])
    }

    #[getter]
    fn ground_scale<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let c = self.rpc.coefficients();
        PyArray1::from_slice(py, &[c.lon.scale, c.lat.scale, c.height.scale])
    }

    #[getter]
    fn col_num<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.rpc.coefficients().col_num)
    }

    #[getter]
    fn col_den<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.rpc.coefficients().col_den)
    }

    #[getter]
    fn row_num<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.rpc.coefficients().row_num)
    }

    #[getter]
    fn row_den<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.rpc.coefficients().row_den)
    }

    #[getter]
    fn height_range(&self) -> (f64, f64) {
        self.rpc.height_range()
    }

    #[getter]
    fn err_bias_m(&self) -> Option<f64> {
        self.rpc.coefficients().err_bias_m
    }

    #[getter]
    fn err_rand_m(&self) -> Option<f64> {
        self.rpc.coefficients().err_rand_m
    }

    fn __repr__(&self) -> String {
        let c = self.rpc.coefficients();
        let (low, high) = self.rpc.height_range();
        format!(
            "<satgs.Rpc at {:.5}, {:.5}, {low:.0} to {high:.0} m, about {:.0} x {:.0} pixels, from {}>",
            c.lon.offset,
            c.lat.offset,
            2.0 * c.col.scale.abs(),
            2.0 * c.row.scale.abs(),
            self.format
        )
    }
}

/// Cameras are equal that project alike, whatever file they come from.
impl PartialEq for Rpc {
    fn eq(&self, other: &Self) -> bool {
        self.rpc == other.rpc
    }
}

impl<'py> Arrays<'py> {
    /// Numbers or arrays by NumPy's rules of broadcasting.
    fn broadcast(py: Python<'py>, given: [&Bound<'py, PyAny>; 3]) -> PyResult<Self> {
        let numpy = py.import("numpy")?;
        let double = numpy.getattr("float64")?;
        let mut arrays = Vec::new();
        for value in given {
            arrays.push(numpy.call_method1("require", (value, &double, "CA"))?);
        }
        let alike = numpy.call_method1("broadcast_arrays", PyTuple::new(py, arrays)?)?;
        let arrays: [PyReadonlyArrayDyn<'py, f64>; 3] = alike.extract()?;
        let shape = arrays[0].shape().to_vec();
        Ok(Self { arrays, shape })
    }

    /// The values of each array; a copy only where they do not lie one after the other.
    fn columns(&self) -> [Cow<'_, [f64]>; 3] {
        self.arrays.each_ref().map(|array| match array.as_slice() {
            Ok(values) => Cow::Borrowed(values),
            Err(_) => array.as_array().iter().copied().collect(),
        })
    }
}

/// Two arrays of a shape.
fn shaped<'py>(py: Python<'py>, [a, b]: [Vec<f64>; 2], shape: &[usize]) -> PyResult<TwoArrays<'py>> {
    Ok((a.into_pyarray(py).reshape(shape)?, b.into_pyarray(py).reshape(shape)?))
}
