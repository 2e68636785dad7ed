//! Point clouds as LAS or LAZ 1.4, with their CRS.

use super::write::write_by;
use super::{CloudError, VerticalReference, WriteError, epsg_of_wkt};
use crate::frame::{Point, Utm};
use gdal::spatial_ref::SpatialRef;
use las::point::{Classification, Format};
use las::{Builder, Color, Reader, Transform, Vector, Writer};
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

/// Resolution of the coordinates, metres.
const RESOLUTION_M: f64 = 0.001;
/// Number of points that are read at a time.
const CHUNK: u64 = 1 << 20;

/// EPSG code of the horizontal CRS of a LAS or LAZ file, from WKT, GeoTIFF keys, or a system identifier `EPSG:CODE`; `None`
/// if the file states none.
#[must_use]
pub fn epsg_of_cloud(header: &las::Header) -> Option<u32> {
    let wkt = header.get_wkt_crs_bytes().map(String::from_utf8_lossy);
    wkt.and_then(|w| epsg_of_wkt(w.trim_end_matches('\0')))
        .or_else(|| {
            let keys = header.get_geotiff_crs().ok().flatten()?;
            // The key 32767 marks a projection without a code.
            keys.get_projected_crs_geo_key_value().filter(|c| *c != 32767).map(u32::from)
        })
        .or_else(|| header.system_identifier().strip_prefix("EPSG:")?.parse().ok())
}

/// Calls `each` for the points of a file from the first on, except for those that are withheld or classified as noise.
///
/// # Errors
/// [`CloudError`] if the file is damaged or ends before the last of the points that its header states.
pub fn read_points(
    path: &Path,
    reader: &mut Reader,
    mut each: impl FnMut(&las::Point),
) -> Result<(), CloudError> {
    let damaged = |cause: las::Error| CloudError::Read { path: path.into(), cause };
    let expected = reader.header().number_of_points();
    let mut found = 0;
    loop {
        let before = found;
        for point in reader.read_points(CHUNK).map_err(damaged)?.points() {
            let point = point.map_err(damaged)?;
            found += 1;
            let noise = [Classification::LowPoint, Classification::HighNoise];
            if !point.is_withheld && !noise.contains(&point.classification) {
                each(&point);
            }
        }
        if found == before {
            break;
        }
    }
    if found < expected { Err(CloudError::CutShort { path: path.into(), found, expected }) } else { Ok(()) }
}

/// The points of a LAS or LAZ file.
#[derive(Clone, Debug, Default)]
pub struct CloudContent {
    /// Coordinates in the CRS of the file.
    pub places: Vec<[f64; 3]>,
    /// Red, green and blue, 0 to 65535; empty if the file has no colours.
    pub colors: Vec<[u16; 3]>,
    /// EPSG code of the horizontal CRS, if the file states one.
    pub epsg: Option<u32>,
}

impl CloudContent {
    /// Reads a file, except for points that are withheld or classified as noise.
    ///
    /// # Errors
    /// As [`read_points`].
    pub fn read(path: &Path) -> Result<Self, CloudError> {
        let mut reader =
            Reader::from_path(path).map_err(|cause| CloudError::Read { path: path.into(), cause })?;
        let mut out = Self { epsg: epsg_of_cloud(reader.header()), ..Self::default() };
        let (places, colors) = (&mut out.places, &mut out.colors);
        read_points(path, &mut reader, |point| {
            places.push([point.x, point.y, point.z]);
            colors.extend(point.color.map(|c| [c.red, c.green, c.blue]));
        })?;
        Ok(out)
    }
}

/// A point of a point cloud.
#[derive(Clone, Copy, Debug)]
pub struct CloudPoint {
    /// Map position, and height above the vertical reference of the cloud, metres.
    pub place: Point<Utm>,
    /// Red, green and blue, 0 to 1.
    pub color: [f32; 3],
    /// Intensity, which the writer of the cloud may use for any value.
    pub intensity: u16,
}

/// A point cloud to be written.
pub struct PointCloud<'a> {
    /// EPSG code of the map's CRS.
    pub epsg: u32,
    /// Vertical reference of the heights.
    pub vertical: &'a VerticalReference,
    /// Offset of the stored coordinates: a point in whole metres near the others.
    pub origin: Point<Utm>,
}

impl PointCloud<'_> {
    /// Writes points as LAS 1.4, compressed (LAZ) if the path ends in `.laz`.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write(&self, path: &Path, points: impl Iterator<Item = CloudPoint>) -> Result<(), WriteError> {
        write_by(path, |temporary| {
            let mut builder = Builder::from((1, 4));
            builder.point_format = Format::new(7)?;
            builder.point_format.is_compressed =
                path.extension().is_some_and(|e| e.eq_ignore_ascii_case("laz"));
            let [x, y, z] = self.origin.xyz().map(|offset| Transform { scale: RESOLUTION_M, offset });
            builder.transforms = Vector { x, y, z };
            builder.generating_software = concat!("satgs ", env!("CARGO_PKG_VERSION")).into();
            // The date is left out, so that the same points give the same bytes on any day.
            builder.date = None;
            let mut header = builder.into_header()?;
            let vertical = self.vertical.epsg().map_or_else(String::new, |code| format!("+{code}"));
            let crs = SpatialRef::from_definition(&format!("EPSG:{}{vertical}", self.epsg))?;
            header.set_wkt_crs(crs.to_wkt()?.into_bytes())?;
            let mut writer = Writer::new(Steady::create(temporary)?, header)?;
            for CloudPoint { place, color, intensity } in points {
                let level = |v: f32| (v.clamp(0.0, 1.0) * f32::from(u16::MAX)).round() as u16;
                let color = Some(Color::new(level(color[0]), level(color[1]), level(color[2])));
                let ([x, y, z], gps_time) = (place.xyz(), Some(0.0));
                writer.write_point(las::Point {
                    x,
                    y,
                    z,
                    color,
                    intensity,
                    gps_time,
                    // Returns are counted from 1 in LAS.
                    return_number: 1,
                    number_of_returns: 1,
                    ..Default::default()
                })?;
            }
            Ok(writer.into_inner()?.finish()?)
        })
    }
}

/// A file that stores its first error and ignores later writes. It is needed because the writer of the crate `las` writes
/// again when it is dropped, and panics if that fails, as on a full disk.
#[derive(Debug)]
struct Steady {
    file: BufWriter<File>,
    failure: Option<std::io::Error>,
    /// Position of the next byte and end of the file as if no write had failed: the crate `laz` subtracts positions.
    place: u64,
    end: u64,
}

impl Steady {
    fn create(path: &Path) -> std::io::Result<Self> {
        Ok(Self { file: BufWriter::new(File::create(path)?), failure: None, place: 0, end: 0 })
    }

    fn remember(&mut self, result: std::io::Result<()>) {
        if let Err(e) = result {
            self.failure.get_or_insert(e);
        }
    }

    /// Returns the first error, if there was one.
    fn finish(mut self) -> std::io::Result<()> {
        self.flush()?;
        self.failure.take().map_or(Ok(()), Err)
    }
}

impl Write for Steady {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if self.failure.is_none() {
            let result = self.file.write_all(bytes);
            self.remember(result);
        }
        self.place += bytes.len() as u64;
        self.end = self.end.max(self.place);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        if self.failure.is_none() {
            let result = self.file.flush();
            self.remember(result);
        }
        Ok(())
    }
}

impl Seek for Steady {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let target = match to {
            SeekFrom::Start(place) => Some(place),
            SeekFrom::Current(by) => self.place.checked_add_signed(by),
            SeekFrom::End(by) => self.end.checked_add_signed(by),
        };
        self.place = target.ok_or(std::io::ErrorKind::InvalidInput)?;
        if self.failure.is_none() {
            // Buffered data are written before the position is changed.
            let result = self.file.seek(SeekFrom::Start(self.place)).map(|_| ());
            self.remember(result);
        }
        Ok(self.place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error_and_no_panic() {
        for is_compressed in [false, true] {
            let mut builder = Builder::from((1, 4));
            builder.point_format.is_compressed = is_compressed;
            let header = builder.into_header().unwrap();
            let mut writer = Writer::new(Steady::create(Path::new("/dev/full")).unwrap(), header).unwrap();
            for i in 0..100_000 {
                let x = f64::from(i % 7919);
                writer.write_point(las::Point { x, ..Default::default() }).unwrap();
            }
            let full = writer.into_inner().unwrap().finish().unwrap_err();
            assert_eq!(full.kind(), std::io::ErrorKind::StorageFull);
        }
    }
}
