//! Lidar points (LAS, LAZ) as a surface: the highest point of every cell, and its class.

use super::{MetricsError, Surface};
use crate::frame::Transform;
use crate::raster::{MapGrid, Plane, epsg_of_cloud, is_metric_map};
use las::{Reader, point::Classification};
use std::path::Path;

/// Points read at a time.
const CHUNK: u64 = 1 << 20;

/// Whether a file is named like a point cloud.
pub(super) fn is_cloud(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("las") || e.eq_ignore_ascii_case("laz"))
}

/// Opens a file of points; gives its CRS, for which `epsg` stands in where the file does not state one.
///
/// # Errors
/// [`MetricsError::Cloud`] for a file that is empty or damaged, [`MetricsError::CloudCrs`] when its CRS is not known or
/// not in metres.
pub(super) fn open(path: &Path, epsg: Option<u32>) -> Result<(Reader, u32), MetricsError> {
    let damaged = |reason: String| MetricsError::Cloud { path: path.into(), reason };
    let reader = Reader::from_path(path).map_err(|e| damaged(e.to_string()))?;
    let header = reader.header();
    if header.number_of_points() == 0 {
        return Err(damaged("it holds no points".into()));
    }
    let crs = |reason: &str| MetricsError::CloudCrs { path: path.into(), reason: reason.into() };
    let epsg = epsg.or_else(|| epsg_of_cloud(header)).ok_or_else(|| crs("its CRS is not stated"))?;
    if !is_metric_map(epsg) {
        return Err(crs(&format!("EPSG:{epsg} is no map projection in metres")));
    }
    Ok((reader, epsg))
}

/// The points on a grid: heights in metres, NaN in cells without points; classes if any point has one.
///
/// Points that are withheld or classified as noise are left out.
///
/// # Errors
/// As [`open`]'s, which takes `epsg`; [`MetricsError::Cloud`] for damaged points.
pub(super) fn read(
    path: &Path,
    epsg: Option<u32>,
    grid: MapGrid,
) -> Result<(Surface, Option<Vec<u8>>), MetricsError> {
    let (mut reader, epsg) = open(path, epsg)?;
    let damaged = |reason: String| MetricsError::Cloud { path: path.into(), reason };
    let expected = reader.header().number_of_points();
    let transform = (epsg != grid.epsg).then(|| Transform::new(epsg, grid.epsg)).transpose()?;
    let mut height = Plane::filled(grid.width, grid.height, f32::NAN);
    let mut classes = vec![0u8; height.data.len()];
    let mut read = 0;
    loop {
        let points = reader.read_points(CHUNK).map_err(|e| damaged(e.to_string()))?;
        let before = read;
        for point in points.points() {
            let point = point.map_err(|e| damaged(e.to_string()))?;
            read += 1;
            let noise = [Classification::LowPoint, Classification::HighNoise];
            if point.is_withheld || noise.contains(&point.classification) {
                continue;
            }
            let (x, y) = transform.map_or((point.x, point.y), |t| t.convert(point.x, point.y));
            let (col, row) = ((x - grid.west) / grid.cell, (grid.north - y) / grid.cell);
            let inside = (0.0..grid.width as f64).contains(&col) && (0.0..grid.height as f64).contains(&row);
            if !inside || !point.z.is_finite() {
                continue;
            }
            let i = row as usize * grid.width + col as usize;
            let z = point.z as f32;
            if height.data[i].is_nan() || z > height.data[i] {
                height.data[i] = z;
                classes[i] = u8::from(point.classification);
            }
        }
        if read == before {
            break;
        }
    }
    if read < expected {
        return Err(damaged(format!("it ends after {read} of {expected} points")));
    }
    // 0 and 1 stand for points that nobody classified.
    let classes = classes.iter().any(|c| *c > 1).then_some(classes);
    let surface = Surface {
        path: path.into(),
        grid,
        height,
        vertical: None,
        undeclared_nodata: 0,
        converted_from: None,
    };
    Ok((surface, classes))
}
