//! Rendering of DSMs from splats.

use super::altitude::{altitudes, median, sampled};
use super::nadir::nadir_camera;
use super::{Confidence, Dsm};
use crate::frame::SiteGrid;
use crate::io::{Grid2, MapGrid};
use crate::mvs::MatchedSurface;
use crate::splat::appearance::Appearance;
use crate::splat::raster::{FrameCamera, Image, Rasterizer, SortedSplats};
use crate::splat::splats::{Splats, color_from_f_dc};
use rayon::prelude::*;

/// Source of the heights of a DSM.
#[derive(Clone, Copy, Debug)]
pub enum HeightsFrom<'a> {
    /// The surface that was matched in the views before training.
    Matched(&'a MatchedSurface),
    /// The splats, by [`RayHeight::Median`](crate::splat::recipe::RayHeight::Median) of three by three samples per
    /// cell; nodata where the accumulated opacity is below one half.
    Median,
    /// The splats, by [`RayHeight::Mean`](crate::splat::recipe::RayHeight::Mean); nodata where no splat is.
    Mean {
        /// Altitude of the background behind the splats, metres above the origin of the site.
        floor: f32,
    },
}

/// Renders splats on a map grid. The numbers of views in the confidence are NaN until [`Dsm::count_views`] is called.
#[must_use]
pub fn render(
    splats: &Splats,
    site: &SiteGrid,
    grid: MapGrid,
    reference: &Appearance,
    heights: HeightsFrom,
) -> Dsm {
    let mut prepared = SortedSplats::default();
    prepared.update(splats);
    let feature = |&i: &u32| {
        let ([r, g, b], z) = (color_from_f_dc(splats.f_dc[i as usize]), splats.position[i as usize][2]);
        [r, g, b, z, z * z]
    };
    let features: Vec<[f32; 5]> = prepared.order().iter().map(feature).collect();
    let camera = FrameCamera::new(&nadir_camera(&grid, site), grid.width, grid.height);
    let mut rasterizer = Rasterizer::<f32, 5>::default();
    let image = rasterizer.render(&prepared, &features, &camera, [0.0; 5]);
    let mut height = match heights {
        HeightsFrom::Matched(surface) => resampled(surface, &grid),
        HeightsFrom::Median => altitudes(splats, site, &grid),
        HeightsFrom::Mean { floor } => mean_around(&with_floor(image, floor)),
    };
    height.data.iter_mut().for_each(|z| *z += site.origin.z() as f32);
    let mut colors: [Grid2; 3] = std::array::from_fn(|c| image.plane(c));
    let (mut spread, square, mut opacity) = (image.plane(3), image.plane(4), image.plane(5));
    let sunlit = reference.sunlit();
    for i in 0..height.data.len() {
        let opaque = 1.0 - opacity.data[i];
        let mean = spread.data[i] / opaque;
        spread.data[i] = (square.data[i] / opaque - mean * mean).max(0.0).sqrt();
        opacity.data[i] = opaque;
        let lit = sunlit(std::array::from_fn(|c| colors[c].data[i] / opaque));
        for (raster, v) in colors.iter_mut().zip(lit) {
            raster.data[i] = if height.data[i].is_nan() { f32::NAN } else { v };
        }
    }
    let views = Grid2::filled(grid.width, grid.height, f32::NAN);
    let confidence = Confidence { opacity, spread, views, height_of_pixel_m: 0.0 };
    Dsm { grid, height, colors, confidence, metadata: Vec::new() }
}

/// Mean altitudes of a rendering, in which the remaining transmittance has the altitude `floor`; NaN where no splat was
/// drawn.
fn with_floor(image: &Image<f32>, floor: f32) -> Grid2 {
    let (mut altitude, through) = (image.plane(3), image.plane(5));
    for (z, through) in altitude.data.iter_mut().zip(&through.data) {
        *z = if *through < 1.0 { *z + through * floor } else { f32::NAN };
    }
    altitude
}

/// The mean of each cell and its eight neighbours, the smoothing of the published DSMs; NaN cells stay NaN.
fn mean_around(raster: &Grid2) -> Grid2 {
    Grid2::from_fn(raster.width, raster.height, |col, row| {
        let center = raster.at(col, row);
        let (mut sum, mut count) = (0.0, 0.0);
        for r in row.saturating_sub(1)..raster.height.min(row + 2) {
            for c in col.saturating_sub(1)..raster.width.min(col + 2) {
                let z = raster.at(c, r);
                if !z.is_nan() {
                    (sum, count) = (sum + z, count + 1.0);
                }
            }
        }
        if center.is_nan() { center } else { sum / count }
    })
}

/// Altitudes of a matched surface in the cells of a grid: medians of samples, NaN where most samples have none.
fn resampled(surface: &MatchedSurface, grid: &MapGrid) -> Grid2 {
    let fine = sampled(grid);
    let altitude_at = |col: usize, row: usize| {
        let p = surface.grid.corner_px_from_utm(fine.cell_center(col, row));
        surface.altitude.get(p.col.floor() as i64, p.row.floor() as i64)
    };
    let (width, side) = (grid.width, fine.width / grid.width);
    let mut out = Grid2::filled(width, grid.height, f32::NAN);
    out.data.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
        let mut values = Vec::new();
        for (col, altitude) in line.iter_mut().enumerate() {
            *altitude = median(&mut values, |c, r| altitude_at(col * side + c, row * side + r));
        }
    });
    out
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::frame::Point;

    /// A level surface 10 m high, in cells of half a metre.
    pub(in crate::dsm) fn flat_surface(width: usize, height: usize) -> (Dsm, SiteGrid) {
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.0, 3_357_600.0, 10.0) };
        let grid = MapGrid { epsg: 32617, west: 436_190.0, north: 3_357_610.0, cell: 0.5, width, height };
        let raster = |value| Grid2::filled(width, height, value);
        let confidence = Confidence {
            opacity: raster(1.0),
            spread: raster(0.0),
            views: raster(f32::NAN),
            height_of_pixel_m: 0.0,
        };
        (
            Dsm {
                grid,
                height: raster(10.0),
                colors: [raster(0.1), raster(0.5), raster(1.0)],
                confidence,
                metadata: Vec::new(),
            },
            site,
        )
    }

    /// A plane of splats is tilted in two opposite directions. Higher splats partly cover lower ones, so that a slope is
    /// rendered slightly too high in both directions; half the difference is free of this bias and must be exact.
    #[test]
    fn a_tilted_plane_keeps_its_heights_and_its_position() {
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_200.25, 3_357_600.75, 10.0) };
        let grid =
            MapGrid { epsg: 32617, west: 436_190.0, north: 3_357_610.0, cell: 0.5, width: 41, height: 37 };
        let tilted = |sign: f32| {
            let mut g = Splats::default();
            for i in -80..=80 {
                for j in -80..=80 {
                    let (x, y) = (i as f32 * 0.25, j as f32 * 0.25);
                    g.push([x, y, sign * (0.2 * x - 0.1 * y)], 0.15, 0.95, [0.2, 0.4, 0.6]);
                }
            }
            render(&g, &site, grid, &Appearance::default(), HeightsFrom::Median)
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
        let mut g = Splats::default();
        g.push([0.0, 0.0, 5.0], 0.5, 0.9, [0.5; 3]);
        let surface = render(&g, &site, grid, &Appearance::default(), HeightsFrom::Median);
        assert!(surface.height.at(0, 0).is_nan());
        assert!((surface.height.at(20, 20) - 15.0).abs() < 0.1);
    }

    #[test]
    fn mean_heights_give_transmitted_light_the_altitude_of_the_floor() {
        let (Dsm { grid, .. }, site) = flat_surface(40, 40);
        let mut g = Splats::default();
        g.push([0.0, 0.0, 5.0], 0.5, 0.5, [0.5; 3]);
        let surface = render(&g, &site, grid, &Appearance::default(), HeightsFrom::Mean { floor: -3.0 });
        let nine = (0..9).map(|k| surface.confidence.opacity.at(19 + k % 3, 19 + k / 3));
        let opacity = nine.sum::<f32>() / 9.0;
        assert!(opacity > 0.1 && opacity < 0.5, "{opacity}");
        let expected = 10.0 + 5.0 * opacity - 3.0 * (1.0 - opacity);
        assert!((surface.height.at(20, 20) - expected).abs() < 1e-4, "{}", surface.height.at(20, 20));
        assert!(surface.height.at(0, 0).is_nan());
    }
}
