//! Point clouds as LAS or LAZ 1.4, with their CRS.

use super::{RasterError, Vertical, write_atomically};
use crate::frame::{Point, Utm};
use gdal::spatial_ref::SpatialRef;
use las::{Builder, Color, Transform, Vector, Writer, point::Format};
use std::path::Path;

/// Resolution of the coordinates, metres.
const RESOLUTION_M: f64 = 0.001;

/// Points with colours, on a map.
pub struct PointCloud<'a> {
    /// EPSG code of the map's CRS.
    pub epsg: u32,
    /// What the heights count from.
    pub vertical: &'a Vertical,
    /// A whole-metre point near all others.
    pub origin: Point<Utm>,
}

impl PointCloud<'_> {
    /// Writes points with colours in 0 to 1; compressed if the path ends in `.laz`.
    ///
    /// # Errors
    /// [`RasterError::Write`].
    pub fn write(
        &self,
        path: &Path,
        points: impl Iterator<Item = (Point<Utm>, [f32; 3])>,
    ) -> Result<(), RasterError> {
        let failed = |reason: String| RasterError::Write { path: path.into(), reason };
        let make = |temporary: &Path| -> Result<(), Box<dyn std::error::Error>> {
            let mut builder = Builder::from((1, 4));
            builder.point_format = Format::new(7)?;
            builder.point_format.is_compressed =
                path.extension().is_some_and(|e| e.eq_ignore_ascii_case("laz"));
            let [x, y, z] = self.origin.xyz().map(|offset| Transform { scale: RESOLUTION_M, offset });
            builder.transforms = Vector { x, y, z };
            builder.generating_software = concat!("satgs ", env!("CARGO_PKG_VERSION")).into();
            let mut header = builder.into_header()?;
            let vertical = self.vertical.epsg().map_or_else(String::new, |code| format!("+{code}"));
            let crs = SpatialRef::from_definition(&format!("EPSG:{}{vertical}", self.epsg))?;
            header.set_wkt_crs(crs.to_wkt()?.into_bytes())?;
            let mut writer = Writer::from_path(temporary, header)?;
            for (p, color) in points {
                let [red, green, blue] = color.map(|v| (v.clamp(0.0, 1.0) * f32::from(u16::MAX)) as u16);
                let color = Some(Color { red, green, blue });
                let ([x, y, z], gps_time) = (p.xyz(), Some(0.0));
                writer.write_point(las::Point { x, y, z, color, gps_time, ..las::Point::default() })?;
            }
            Ok(writer.close()?)
        };
        write_atomically(path, |temporary| make(temporary).map_err(|e| failed(e.to_string())))
    }
}
