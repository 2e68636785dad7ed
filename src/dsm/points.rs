//! The surface as a point cloud.

use super::{Dsm, Heights};
use crate::io::{CloudPoint, PointCloud, WriteError};
use std::path::Path;

impl Dsm {
    /// Writes a coloured point for every cell that has a height, as LAS, or as LAZ if the path ends in `.laz`. `heights` are
    /// those of this DSM.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write_points(&self, path: &Path, heights: &Heights) -> Result<(), WriteError> {
        let z = &heights.raster.data;
        let (west, _, _, north) = self.grid.bounds();
        let origin = crate::frame::Point::new(west.floor(), north.floor(), 0.0);
        let seen = (0..z.len()).filter(|&i| !z[i].is_nan());
        let points = seen.map(|i| {
            let place = self.grid.cell_center(i % self.grid.width, i / self.grid.width);
            let color = self.colors.each_ref().map(|c| c.data[i]);
            CloudPoint { place: place.at_height(z[i].into()), color, intensity: 0 }
        });
        PointCloud { epsg: self.grid.epsg, vertical: heights.above, origin }.write(path, points)
    }
}

#[cfg(test)]
mod tests {
    use crate::dsm::render::tests::flat_surface;
    use crate::io::VerticalReference;

    #[test]
    fn every_cell_with_a_height_becomes_a_point_with_its_position_and_colour() {
        let dir = tempfile::tempdir().unwrap();
        let (mut surface, _) = flat_surface(4, 3);
        surface.height.data[5] = f32::NAN;
        for name in ["dsm.laz", "dsm.las"] {
            let path = dir.path().join(name);
            surface.write_points(&path, &surface.heights_above(&VerticalReference::Ellipsoid)).unwrap();
            let mut reader = las::Reader::from_path(&path).unwrap();
            assert_eq!([1, 2].map(|k| reader.header().number_of_points_by_return(k)), [Some(11), None]);
            let crs = String::from_utf8_lossy(reader.header().get_wkt_crs_bytes().unwrap()).into_owned();
            assert!(crs.contains("32617"), "{crs}");
            let all = reader.read_all().unwrap();
            let points: Vec<las::Point> = all.points().map(Result::unwrap).collect();
            assert_eq!(points.len(), 11);
            assert!(points.iter().all(|p| (p.return_number, p.number_of_returns) == (1, 1)));
            assert!((points[5].x - 436_191.25).abs() < 1e-6 && (points[5].z - 10.0).abs() < 1e-6);
            assert_eq!(points[5].color.unwrap().blue, u16::MAX);
        }
    }
}
