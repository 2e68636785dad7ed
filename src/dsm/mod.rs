//! From splats to georeferenced rasters: a surface model and an orthophoto on a map grid.
//!
//! The camera looks straight down and its pixels are the grid's cells: no point cloud, no resampling. A cell's
//! height is the median of its samples', each the altitude at which half of the light is gone; cells through which
//! most light passes are nodata.

mod altitude;

use crate::affine::AffineCamera;
use crate::event::Sink;
use crate::frame::SiteGrid;
use crate::raster::{Cog, MapGrid, Plane, RasterError};
use crate::splat::appearance::Appearance;
use crate::splat::gaussians::{Gaussians, SH_C0};
use crate::splat::raster::{FrameCamera, Prepared, Rasterizer};
use crate::splat::sweep::{Sweep, SweptSurface};
use rayon::prelude::*;
use std::path::Path;

use altitude::{altitudes, median, sampled};

/// What a look straight down gives.
pub struct Surface {
    /// The grid.
    pub grid: MapGrid,
    /// Ellipsoidal heights in metres; NaN where nothing was seen.
    pub height: Plane,
    /// Colours in the reference view's radiometry, sunlit, 0 to 1; NaN where nothing was seen.
    pub colors: [Plane; 3],
}

/// The camera that looks straight down on a grid.
#[must_use]
pub fn nadir_camera(grid: &MapGrid, site: &SiteGrid) -> AffineCamera {
    let scale = grid.cell.recip();
    let [east, north, _] = site.origin.xyz();
    AffineCamera {
        linear: [[scale, 0.0, 0.0], [0.0, -scale, 0.0]],
        offset: [(east - grid.west) * scale - 0.5, (grid.north - north) * scale - 0.5],
    }
}

/// Renders splats on a grid.
#[must_use]
pub fn render(splats: &Gaussians, site: &SiteGrid, grid: MapGrid, reference: &Appearance) -> Surface {
    let mut prepared = Prepared::default();
    prepared.update(splats);
    let mut height = altitudes(splats, site, &grid);
    height.data.iter_mut().for_each(|z| *z += site.origin.z() as f32);
    let color = |v: f32| v * SH_C0 as f32 + 0.5;
    let features: Vec<[f32; 3]> =
        prepared.order().iter().map(|&i| splats.f_dc[i as usize].map(color)).collect();
    let camera = FrameCamera::new(&nadir_camera(&grid, site), grid.width, grid.height);
    let mut rasterizer = Rasterizer::<f32, 3>::default();
    let image = rasterizer.render(&prepared, &features, &camera, [0.0; 3]);
    let mut colors: [Plane; 3] = std::array::from_fn(|c| image.plane(c));
    let transmittance = image.plane(3);
    for i in 0..height.data.len() {
        let opaque = 1.0 - transmittance.data[i];
        let lit = reference.sunlit(std::array::from_fn(|c| colors[c].data[i] / opaque));
        for (plane, v) in colors.iter_mut().zip(lit) {
            plane.data[i] = if height.data[i].is_nan() { f32::NAN } else { v };
        }
    }
    Surface { grid, height, colors }
}

impl Surface {
    /// Matches the views once more, near the surface of the splats it was rendered from: its edges become as sharp as
    /// the images are.
    pub fn sharpen(&mut self, splats: &Gaussians, site: &SiteGrid, sweep: &Sweep, events: Sink) {
        let prior = altitudes(splats, site, &sweep.grid());
        self.take(&sweep.sharpen(&prior, &sweep.run(events)));
    }

    /// Takes the heights of a swept surface where it has any.
    fn take(&mut self, swept: &SweptSurface) {
        let fine = sampled(&self.grid);
        let origin = swept.site.origin.z() as f32;
        let height_at = |col: usize, row: usize| {
            let p = swept.grid.corner_px_from_utm(fine.cell_center(col, row));
            swept.altitude.get(p.col.floor() as i64, p.row.floor() as i64) + origin
        };
        let (width, side) = (self.grid.width, fine.width / self.grid.width);
        self.height.data.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
            let mut values = Vec::new();
            for (col, own) in line.iter_mut().enumerate() {
                let height = median(&mut values, |c, r| height_at(col * side + c, row * side + r));
                if !height.is_nan() {
                    *own = height;
                }
            }
        });
    }

    /// Writes the heights as a Cloud-Optimized GeoTIFF: float32, metres, NaN nodata.
    ///
    /// # Errors
    /// [`RasterError::Write`].
    pub fn write_dsm(&self, path: &Path) -> Result<(), RasterError> {
        self.cog(&[("VERTICAL_REFERENCE", "WGS 84 ellipsoid".into())]).write_f32(path, &[&self.height], "m")
    }

    /// Writes the colours as an 8-bit Cloud-Optimized GeoTIFF; 0 is nodata.
    ///
    /// # Errors
    /// [`RasterError::Write`].
    pub fn write_ortho(&self, path: &Path) -> Result<(), RasterError> {
        let byte = |v: &f32| if v.is_nan() { 0 } else { (v.clamp(0.0, 1.0) * 254.0).round() as u8 + 1 };
        let bands = self.colors.iter().map(|p| p.data.iter().map(byte).collect()).collect();
        self.cog(&[]).write_u8(path, bands, Some(0.0))
    }

    fn cog<'a>(&self, metadata: &'a [(&'a str, String)]) -> Cog<'a> {
        Cog { grid: self.grid, metadata }
    }
}

/// Relief lit from the north-west, 0 to 255; nodata is white.
#[must_use]
pub fn hillshade(height: &Plane, cell_m: f64) -> Vec<u8> {
    // Unit vector towards a light at azimuth 315°, elevation 45°, the cartographers' convention.
    let light = [-0.5f32, 0.5, std::f32::consts::FRAC_1_SQRT_2];
    let cell = cell_m as f32;
    let at = |c: i64, r: i64| {
        height.get(c.clamp(0, height.width as i64 - 1), r.clamp(0, height.height as i64 - 1))
    };
    let mut out = Vec::with_capacity(height.data.len());
    for row in 0..height.height as i64 {
        for col in 0..height.width as i64 {
            let east = (at(col + 1, row) - at(col - 1, row)) / (2.0 * cell);
            let north = (at(col, row - 1) - at(col, row + 1)) / (2.0 * cell);
            let shade =
                (light[2] - light[0] * east - light[1] * north) / (1.0 + east * east + north * north).sqrt();
            out.push(if shade.is_nan() { 255 } else { (shade.clamp(0.0, 1.0) * 254.0) as u8 });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Point;

    /// A plane of splats, tilted one way and the other. Higher neighbours hide lower ones, so that a slope is seen a
    /// little high whichever way it falls; half the difference is free of that and must be exact at cell centres.
    #[test]
    fn a_tilted_plane_keeps_its_heights_and_its_place() {
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.25, 3_357_600.75, 10.0) };
        let grid =
            MapGrid { epsg: 32617, west: 436_190.0, north: 3_357_610.0, cell: 0.5, width: 41, height: 37 };
        let tilted = |sign: f32| {
            let mut g = Gaussians::default();
            for i in -80..=80 {
                for j in -80..=80 {
                    let (x, y) = (i as f32 * 0.25, j as f32 * 0.25);
                    g.push([x, y, sign * (0.2 * x - 0.1 * y)], 0.15, 0.95, [0.2, 0.4, 0.6]);
                }
            }
            render(&g, &site, grid, &Appearance::default())
        };
        let (up, down) = (tilted(1.0), tilted(-1.0));
        for row in 3..34 {
            for col in 3..38 {
                let p = site.site_from_utm(grid.cell_center(col, row)).xyz();
                let expected = 0.2 * p[0] - 0.1 * p[1];
                let (a, b) = (f64::from(up.height.at(col, row)), f64::from(down.height.at(col, row)));
                assert!((0.5 * (a - b) - expected).abs() < 0.01, "{col} {row}: {a} {b} {expected}");
                assert!((0.5 * (a + b) - 10.0).abs() < 0.15, "{col} {row}: {a} {b}");
            }
        }
        assert!((up.colors[2].at(20, 20) - 0.6).abs() < 1e-3);
    }

    #[test]
    fn cells_without_splats_are_nodata() {
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.0, 3_357_600.0, 10.0) };
        let grid =
            MapGrid { epsg: 32617, west: 436_190.0, north: 3_357_610.0, cell: 0.5, width: 40, height: 40 };
        let mut g = Gaussians::default();
        g.push([0.0, 0.0, 5.0], 0.5, 0.9, [0.5; 3]);
        let surface = render(&g, &site, grid, &Appearance::default());
        assert!(surface.height.at(0, 0).is_nan());
        assert!((surface.height.at(20, 20) - 15.0).abs() < 0.1);
    }
}
