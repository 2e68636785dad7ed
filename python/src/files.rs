//! Rasters and point clouds as arrays, read by the library's own GDAL.

use crate::arrays;
use crate::error::exception;
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use satgs::cli::CliError;
use satgs::io::{CloudContent, ImageFile, RasterError, Window, epsg_of_wkt};
use std::path::{Path, PathBuf};

/// What a raster holds.
struct Content {
    values: Values,
    shape: [usize; 3],
    transform: Option<[f64; 6]>,
    wkt: String,
    nodata: Option<f64>,
    names: Vec<String>,
}

/// Values of all bands, one after the other.
enum Values {
    /// As they are stored, if all bands are 8-bit.
    Bytes(Vec<u8>),
    /// With NaN where there is no data.
    Floats(Vec<f32>),
}

/// Array of shape (bands, rows, columns), geotransform, CRS as WKT, EPSG code, nodata value, descriptions of the bands.
type Raster<'py> = (Bound<'py, PyAny>, Option<Transform>, String, Option<u32>, Option<f64>, Vec<String>);

/// A geotransform, as a tuple of Python.
type Transform = (f64, f64, f64, f64, f64, f64);

/// Coordinates, colours from 0 to 65535 and the EPSG code of the horizontal CRS.
type Cloud<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Option<u32>);

/// Reads all bands of a raster.
#[pyfunction]
pub fn read_raster(py: Python<'_>, path: PathBuf) -> PyResult<Raster<'_>> {
    let content = py.detach(|| read(&path)).map_err(|e| exception(py, e))?;
    let Content { values, shape, transform, wkt, nodata, names } = content;
    let values = match values {
        Values::Bytes(values) => values.into_pyarray(py).reshape(shape)?.into_any(),
        Values::Floats(values) => values.into_pyarray(py).reshape(shape)?.into_any(),
    };
    let epsg = epsg_of_wkt(&wkt);
    Ok((values, transform.map(Transform::from), wkt, epsg, nodata, names))
}

fn read(path: &Path) -> Result<Content, RasterError> {
    let file = ImageFile::open(path)?;
    let (width, height) = file.size();
    let bands = 1..=file.bands();
    let infos = bands.clone().map(|band| file.band(band)).collect::<Result<Vec<_>, _>>()?;
    let window = Window { col: 0, row: 0, width, height };
    let values = if infos.iter().all(|info| info.is_byte) {
        let mut values = Vec::with_capacity(infos.len() * width * height);
        for band in bands.clone() {
            let stored = file.read_stored(band, window, (width, height))?;
            // Stored values of 8 bits are whole numbers from 0 to 255.
            values.extend(stored.data.iter().map(|v| *v as u8));
        }
        Values::Bytes(values)
    } else {
        let mut values = Vec::new();
        for band in bands.clone() {
            let mut plane = file.read(band)?.data;
            if values.is_empty() { values = plane } else { values.append(&mut plane) }
        }
        Values::Floats(values)
    };
    Ok(Content {
        values,
        shape: [infos.len(), height, width],
        transform: file.geotransform(),
        wkt: file.crs_wkt(),
        nodata: infos.first().and_then(|info| info.nodata),
        names: bands.map(|band| file.description(band)).collect::<Result<_, _>>()?,
    })
}

/// Reads the points of a LAS or LAZ file.
#[pyfunction]
pub fn read_points(py: Python<'_>, path: PathBuf) -> PyResult<Cloud<'_>> {
    let read = py.detach(|| CloudContent::read(&path));
    let cloud = read.map_err(|e| exception(py, CliError::from(e)))?;
    let (places, colors) = (arrays::rows(py, cloud.places)?, arrays::rows(py, cloud.colors)?);
    Ok((places.into_any(), colors.into_any(), cloud.epsg))
}
