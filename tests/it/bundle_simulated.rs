//! Bundle adjustment of simulated images against the true cameras, on gentle and on hilly ground.

use crate::common::disagreement_px;
use satgs::bundle::{BundleOptions, HeightPrior, adjust};
use satgs::frame::{Pixel, SiteGrid};
use satgs::io::{Cog, Grid2, MapGrid, VerticalReference};
use satgs::metrics::HeightRaster;
use satgs::progress::NoProgress;
use satgs::rpc::{Rpc, formats};
use satgs::scene::{ReadOptions, Scene, read};
use satgs::simulate::{self, Relief, Terrain, simulate};
use std::path::Path;

/// Largest distance of a corrected camera from the true one, pixels, once the common translation is taken out.
const SHIFT_TOLERANCE_PX: f64 = 0.1;
/// How far all cameras together are put off in height, metres.
const DATUM_OFF_M: f64 = 10.0;
/// Median error of the points' heights when an elevation model of ground holds them, metres: it is the lowest of coarse
/// cells, a metre and more below most of the surface.
const HELD_TO_M: f64 = 2.0;
/// Share of the tracks that it may cost.
const LOST: f64 = 0.03;
/// Side of its cells, metres.
const DEM_CELL_M: f64 = 20.0;

fn worst_shift_px(relief: Relief) -> f64 {
    let folder = tempfile::tempdir().unwrap();
    let options =
        simulate::SimulateOptions { terrain: Terrain::Town(relief), ..simulate::SimulateOptions::default() };
    simulate(folder.path(), &options, &NoProgress).unwrap();
    let scene = read(folder.path(), &ReadOptions::default()).unwrap();
    let made = adjust(&scene, &BundleOptions::default(), &NoProgress).unwrap();
    assert_eq!(made.cameras.len(), options.views);
    let truth = folder.path().join("truth/rpcs");
    let pairs: Vec<(Rpc, Rpc)> = made
        .cameras
        .into_iter()
        .map(|(name, rpc)| (rpc, formats::read(&truth.join(format!("{name}.json"))).unwrap().rpc))
        .collect();
    let middle = options.size_px as f64 / 2.0;
    let worst = disagreement_px(&pairs, Pixel::new(middle, middle)).into_iter().fold(0.0, f64::max);
    println!("{relief:?}: {worst:.3} px");
    worst
}

#[test]
fn shifts_on_gentle_terrain_are_exact_to_a_tenth_of_a_pixel() {
    assert!(worst_shift_px(Relief::Rolling) < SHIFT_TOLERANCE_PX);
}

#[test]
fn shifts_on_hilly_terrain_are_exact_to_a_tenth_of_a_pixel() {
    assert!(worst_shift_px(Relief::Hilly) < SHIFT_TOLERANCE_PX);
}

/// Shifts all cameras so that what they see comes out too high.
fn lift_datum(scene: &mut Scene) {
    let center = scene.center().unwrap();
    let lifted = center.at_height(center.height_m() + DATUM_OFF_M);
    for view in &mut scene.views {
        let (here, there) = (view.rpc.project(center), view.rpc.project(lifted));
        view.rpc = view.rpc.shifted(here.col - there.col, here.row - there.row);
    }
}

/// The lowest of the surface in coarse cells: nearly the ground, as elevation models show it.
fn write_ground(surface: &HeightRaster, path: &Path) {
    let fine = (DEM_CELL_M / surface.grid.cell).round() as usize;
    let (width, height) = (surface.height.width / fine, surface.height.height / fine);
    let lowest = |col: usize, row: usize| {
        let cells = (0..fine * fine).map(|k| surface.height.at(col * fine + k % fine, row * fine + k / fine));
        cells.fold(f32::INFINITY, f32::min)
    };
    let ground = Grid2::from_fn(width, height, lowest);
    let grid = MapGrid { cell: DEM_CELL_M, width, height, ..surface.grid };
    let cog = Cog { grid, metadata: &[], heights_from: Some(&VerticalReference::Ellipsoid) };
    cog.write_f32(path, &[("height", "m", &ground)]).unwrap();
}

#[test]
fn an_elevation_model_fixes_the_height_of_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let made = simulate(folder.path(), &simulate::SimulateOptions::default(), &NoProgress).unwrap();
    let mut scene = read(folder.path(), &ReadOptions::default()).unwrap();
    lift_datum(&mut scene);
    let surface = HeightRaster::read(&made.truth).unwrap();
    let path = folder.path().join("ground.tif");
    write_ground(&surface, &path);
    let dem = scene.dem(&path, None).unwrap();

    let tracks_and_error_m = |height_prior: Option<HeightPrior>| {
        let made =
            adjust(&scene, &BundleOptions { height_prior, ..BundleOptions::default() }, &NoProgress).unwrap();
        println!("{}", made.report.table());
        let site = SiteGrid::at(made.points[0].position).unwrap();
        let above = made.points.iter().map(|p| {
            let px = surface.grid.corner_px_from_utm(site.utm_from_geodetic(p.position));
            p.position.height_m() as f32 - surface.height.get(px.col.floor() as i64, px.row.floor() as i64)
        });
        let error_m =
            satgs::stats::interpolated_quantile(&above.filter(|d| d.is_finite()).collect::<Vec<_>>(), 0.5);
        (made.report.tracks as f64, error_m)
    };
    let (tracks, free) = tracks_and_error_m(None);
    let (kept, held) = tracks_and_error_m(Some(HeightPrior { dem, sigma_m: 3.0 }));
    println!("median error of heights {free:.2} m, with the elevation model {held:.2} m");
    assert!(free > 0.5 * DATUM_OFF_M && held.abs() < HELD_TO_M, "{free} {held}");
    assert!(kept > (1.0 - LOST) * tracks, "{kept} of {tracks} tracks");
}
