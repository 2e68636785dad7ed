//! Lidar points (LAS, LAZ) as a height raster: the highest point of every cell, with its class.

use super::{HeightRaster, MetricsError};
use crate::frame::Transform;
use crate::io::{CloudError, Grid2, HeightSystem, MapGrid, epsg_of_cloud, is_metric_map, read_points};
use las::Reader;
use rayon::prelude::*;
use std::path::Path;

/// Whether the name of a file is that of a point cloud.
pub(super) fn is_cloud(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("las") || e.eq_ignore_ascii_case("laz"))
}

/// Opens a point cloud and returns its CRS; `epsg` is used where the file states none.
///
/// # Errors
/// [`MetricsError::Cloud`] for a file that is empty or damaged, [`MetricsError::CloudCrs`] when its CRS is not known or
/// not in metres.
pub(super) fn open(path: &Path, epsg: Option<u32>) -> Result<(Reader, u32), MetricsError> {
    let damaged = |cause: las::Error| CloudError::Read { path: path.into(), cause };
    let reader = Reader::from_path(path).map_err(damaged)?;
    let header = reader.header();
    if header.number_of_points() == 0 {
        return Err(CloudError::Empty { path: path.into() }.into());
    }
    let crs = |reason: &str| MetricsError::CloudCrs { path: path.into(), reason: reason.into() };
    let epsg = epsg.or_else(|| epsg_of_cloud(header)).ok_or_else(|| crs("its CRS is not stated"))?;
    if !is_metric_map(epsg) {
        return Err(crs(&format!("EPSG:{epsg} is no map projection in metres")));
    }
    Ok((reader, epsg))
}

/// The points on a grid: heights in metres, NaN in cells without points; classes if any point is classified.
///
/// Points that are withheld or classified as noise are left out.
///
/// # Errors
/// The errors of [`open`], which takes `epsg`; [`MetricsError::Cloud`] for damaged points.
pub(super) fn read(
    path: &Path,
    epsg: Option<u32>,
    grid: MapGrid,
) -> Result<(HeightRaster, Option<Vec<u8>>), MetricsError> {
    let (mut reader, epsg) = open(path, epsg)?;
    let system = HeightSystem::of_cloud(reader.header());
    let transform = (epsg != grid.epsg).then(|| Transform::new(epsg, grid.epsg)).transpose()?;
    let mut height = Grid2::filled(grid.width, grid.height, f32::NAN);
    let mut classes = vec![0u8; height.data.len()];
    read_points(path, &mut reader, |point| {
        let (x, y) = transform.map_or((point.x, point.y), |t| t.convert(point.x, point.y));
        let (col, row) = ((x - grid.west) / grid.cell, (grid.north - y) / grid.cell);
        let inside = (0.0..grid.width as f64).contains(&col) && (0.0..grid.height as f64).contains(&row);
        if !inside || !point.z.is_finite() {
            return;
        }
        let i = row as usize * grid.width + col as usize;
        let z = (point.z * system.metres) as f32;
        if height.data[i].is_nan() || z > height.data[i] {
            height.data[i] = z;
            classes[i] = u8::from(point.classification);
        }
    })?;
    // 0 and 1 stand for points that nobody classified.
    let classes = classes.iter().any(|c| *c > 1).then_some(classes);
    let surface = HeightRaster {
        path: path.into(),
        grid,
        height,
        converted_from: system.converted_from(),
        vertical: system.from,
        undeclared_nodata: 0,
    };
    Ok((surface, classes))
}

/// A note about isolated high cells, as birds and unclassified noise make them.
pub(super) fn stray_note(surface: &HeightRaster) -> Option<String> {
    let strays = strays(&surface.height);
    (strays > 0).then(|| {
        format!(
            "`{}`: {strays} cells stand {STRAY_M} m or more above all around them: birds or noise that is not \
             classified? --mask leaves them out, or a filter of PDAL",
            surface.path.display()
        )
    })
}

/// Height above all neighbours, metres, from which a cell counts as isolated; no object on the ground is as high and as
/// thin.
const STRAY_M: f32 = 20.0;
/// Radius of the neighbourhood, cells, and the number of neighbours that must have heights.
const STRAY_REACH: i64 = 3;
const STRAY_NEIGHBOURS: usize = 8;

/// Number of isolated cells.
fn strays(height: &Grid2) -> usize {
    let is_stray = |i: usize| {
        let (col, row) = ((i % height.width) as i64, (i / height.width) as i64);
        let z = height.data[i];
        let around = (-STRAY_REACH..=STRAY_REACH)
            .flat_map(|dy| (-STRAY_REACH..=STRAY_REACH).map(move |dx| (dx, dy)))
            .filter(|d| *d != (0, 0))
            .map(|(dx, dy)| height.get(col + dx, row + dy))
            .filter(|v| !v.is_nan());
        let mut n = 0;
        for v in around {
            if z - v < STRAY_M {
                return false;
            }
            n += 1;
        }
        n >= STRAY_NEIGHBOURS
    };
    (0..height.data.len()).into_par_iter().filter(|i| !height.data[*i].is_nan() && is_stray(*i)).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bird_is_pointed_out_and_a_tower_is_not() {
        let town = |c: usize, r: usize| match (c, r) {
            (20, 20) => 90.0,
            (40..46, 30..36) => 80.0,
            _ => (c % 7) as f32,
        };
        assert_eq!(strays(&Grid2::from_fn(60, 60, town)), 1);
    }
}
