//! The bare ground of surface models against what is known: the ground of simulated towns, and lidar of JAX_068.

use super::metrics_peer::{jax_068, lidar};
use satgs::dsm::bare_ground;
use satgs::io::{Grid2, ImageFile};
use satgs::metrics::HeightRaster;
use satgs::progress::NoProgress;
use satgs::simulate::{Relief, SimulateOptions, Terrain, simulate};
use satgs::stats::median;
use std::path::Path;

const GROUND: u8 = 2;
const TREES: u8 = 5;
const BUILDING: u8 = 6;

fn read(path: &Path) -> Grid2 {
    ImageFile::open(path).unwrap().read(1).unwrap()
}

/// Mean absolute differences from the true ground on ground, under buildings and under trees, metres.
fn errors(found: &Grid2, truth: &Grid2, classes: &[u8]) -> [f32; 3] {
    [GROUND, BUILDING, TREES].map(|class| {
        let cells = classes.iter().zip(found.data.iter().zip(&truth.data)).filter(|(c, _)| **c == class);
        let known = cells.map(|(_, (a, b))| (a - b).abs()).filter(|error| !error.is_nan());
        let (sum, count) = known.fold((0.0, 0.0), |(sum, count), error| (sum + error, count + 1.0));
        sum / count
    })
}

fn errors_of_town(seed: u64, relief: Relief, size_px: usize) -> [f32; 3] {
    let folder = tempfile::tempdir().unwrap();
    let terrain = Terrain::Town(relief);
    let options = SimulateOptions { seed, terrain, size_px, views: 2, ..SimulateOptions::default() };
    simulate(folder.path(), &options, &NoProgress).unwrap();
    let truth = |what: &str| read(&folder.path().join(format!("truth/TOWN_{what}.tif")));
    let classes: Vec<u8> = truth("CLS").data.iter().map(|class| *class as u8).collect();
    errors(&bare_ground(&truth("DSM"), options.gsd_m), &truth("DTM"), &classes)
}

#[test]
fn the_ground_of_a_town_on_hills_is_found() {
    let [ground, buildings, trees] = errors_of_town(11, Relief::Hilly, 128);
    assert!(ground < 0.1 && buildings < 1.0 && trees < 0.5, "{ground} {buildings} {trees}");
}

#[test]
fn the_ground_of_jax_068_is_found_under_its_halls() {
    let Some(scene) = jax_068() else { return };
    let truth = lidar(&scene);
    let classes = truth.classes.unwrap();
    let surface = truth.surface.height;
    let ground = ground_near(&surface, &classes);
    let of_lidar = errors(&bare_ground(&surface, 0.5), &ground, &classes);
    println!("lidar: MAE on ground, under buildings, under trees: {of_lidar:.2?} m");
    assert!(of_lidar[0] < 0.5 && of_lidar[1] < 1.5 && of_lidar[2] < 1.5, "{of_lidar:?}");

    // A surface model that another program reconstructed from the images, on the same grid.
    let images = HeightRaster::read(&scene.join("peer_s2p_dsm.tif")).unwrap().height;
    let mut found = bare_ground(&images, 0.5);
    // The offset is that of the surfaces, so that ground that is found too low is an error.
    let offset = images.data.iter().zip(&surface.data).zip(&classes).filter(|(_, class)| **class == GROUND);
    let offset = offset.map(|((a, b), _)| f64::from(a - b)).filter(|d| !d.is_nan()).collect();
    let offset = median(offset).unwrap() as f32;
    found.data.iter_mut().for_each(|z| *z -= offset);
    let of_images = errors(&found, &ground, &classes);
    println!("images: MAE on ground, under buildings, under trees: {of_images:.2?} m");
    assert!(of_images[0] < 1.0 && of_images[1] < 3.0, "{of_images:?}");
}

/// The surface on ground; elsewhere the height of the nearest ground that is two cells from anything else.
fn ground_near(surface: &Grid2, classes: &[u8]) -> Grid2 {
    let (width, height) = (surface.width as i64, surface.height as i64);
    let is_ground = |col: i64, row: i64| {
        let inside = (0..width).contains(&col) && (0..height).contains(&row);
        !inside || classes[(row * width + col) as usize] == GROUND
    };
    let is_open = |i: &usize| {
        let (col, row) = (*i as i64 % width, *i as i64 / width);
        (-2..=2).all(|r| (-2..=2).all(|c| is_ground(col + c, row + r))) && !surface.data[*i].is_nan()
    };
    let mut out = Grid2::filled(surface.width, surface.height, f32::NAN);
    let mut front: Vec<usize> = (0..classes.len()).filter(is_open).collect();
    front.iter().for_each(|i| out.data[*i] = surface.data[*i]);
    while !front.is_empty() {
        let mut next = Vec::new();
        for i in front {
            let (col, row) = (i as i64 % width, i as i64 / width);
            for (c, r) in [(col - 1, row), (col + 1, row), (col, row - 1), (col, row + 1)] {
                if (0..width).contains(&c) && (0..height).contains(&r) {
                    let k = (r * width + c) as usize;
                    if out.data[k].is_nan() {
                        out.data[k] = out.data[i];
                        next.push(k);
                    }
                }
            }
        }
        front = next;
    }
    let on_ground = classes.iter().zip(&surface.data).enumerate();
    on_ground.filter(|(_, (class, _))| **class == GROUND).for_each(|(i, (_, z))| out.data[i] = *z);
    out
}

/// The figures of `docs/guide/outputs.md`: `cargo test --release --test it -- --ignored --nocapture bare_ground`.
#[test]
#[ignore = "it prints the figures of the guide, of towns of full size"]
fn figures_of_the_guide() {
    for relief in [Relief::Rolling, Relief::Hilly] {
        for seed in [11, 12] {
            println!("{relief:?} {seed}: {:.3?} m", errors_of_town(seed, relief, 400));
        }
    }
    let large = Grid2::from_fn(4000, 4000, |col, row| {
        let is_house = col % 60 < 25 && row % 50 < 20;
        (0.01 * col as f32).sin() * 10.0 + if is_house { 8.0 } else { 0.0 }
    });
    let start = std::time::Instant::now();
    let ground = bare_ground(&large, 0.5);
    assert_eq!(ground.valid().count(), 16_000_000);
    println!("4000 x 4000 cells: {:.1} s", start.elapsed().as_secs_f64());
}
