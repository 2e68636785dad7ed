//! The mosaic of tiles that differ in colour, and of tiles of which some failed.

use super::cut::BANDS;
use super::made_tests::{Made, noise, town};
use super::{Failure, TilesError, mosaic, tile_folder};
use crate::io::{HeightSystem, ImageFile};
use crate::pipeline::Outcome;
use crate::progress::NoProgress;
use crate::run_files::{CONFIDENCE, DONE, DSM, FAILED, ORTHO, PAGE, SEAMS};
use std::path::Path;

/// The gain of a tile's colours.
fn gain(col: usize, row: usize) -> f32 {
    [1.0, 0.85, 1.15, 0.9][(col + 2 * row) % 4]
}

/// A surface that all tiles see in their own colours.
fn tinted(col: usize, row: usize, c: i64, r: i64) -> [f32; BANDS] {
    let truth = 60.0 + 100.0 * noise(1, [c / 3, r / 3, 0, 0]);
    let seen = |band: f32| (truth * gain(col, row) + band).round().clamp(1.0, 255.0);
    [10.0 + 0.01 * c as f32, seen(0.0), seen(10.0), seen(20.0), 0.9, 0.1, 5.0, 0.2]
}

fn made(run: &Path) -> super::Mosaicked {
    match mosaic(run, &NoProgress).unwrap() {
        Outcome::Made(summary) => summary,
        Outcome::Kept(_) => panic!("it is kept"),
    }
}

#[test]
fn tiles_of_different_colours_become_one_orthophoto_and_heights_stay() {
    let tiles = Made { columns: &[40, 40], rows: &[40, 40], at: &tinted };
    let folder = tempfile::tempdir().unwrap();
    tiles.write(folder.path());
    let summary = made(folder.path());
    assert_eq!((summary.tiles, summary.seams.seams), (4, 4));
    assert!(summary.seams.ortho_before.unwrap() > 10.0, "{:?}", summary.seams);
    assert!(summary.seams.ortho_after.unwrap() <= 2.0, "{:?}", summary.seams);
    let open = |name: &str| ImageFile::open(&folder.path().join(name)).unwrap();
    let heights = open(DSM).read(1).unwrap();
    for (k, h) in heights.data.iter().enumerate() {
        assert!((h - (10.0 + 0.01 * (k % 80) as f32)).abs() < 1e-4);
    }
    // All cells are those of one tile's colours, up to a common gain and the rounding of colours.
    let red = open(ORTHO).read(1).unwrap();
    let truth = |k: usize| 60.0 + 100.0 * noise(1, [(k % 80) as i64 / 3, (k / 80) as i64 / 3, 0, 0]);
    let mut ratios: Vec<f32> = red.data.iter().enumerate().map(|(k, v)| v / truth(k)).collect();
    ratios.sort_by(f32::total_cmp);
    let [low, middle, high] = [0.05, 0.5, 0.95].map(|q| ratios[(q * (ratios.len() - 1) as f64) as usize]);
    assert!((high - low) / middle < 0.04, "{low} {middle} {high}");
}

#[test]
fn the_mosaic_is_written_as_the_rasters_of_a_single_run_are() {
    let tiles = Made { columns: &[40, 32], rows: &[40], at: &town(1) };
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    tiles.write(run);
    let summary = made(run);
    for name in [DSM, ORTHO, CONFIDENCE] {
        let whole = ImageFile::open(&run.join(name)).unwrap();
        let tile = ImageFile::open(&tile_folder(run, "x000_y000").join(name)).unwrap();
        assert!(whole.map_grid().unwrap().is_same(&summary.grid, 1e-6));
        let written = |file: &ImageFile| {
            let domain = file.metadata_domain("").into_iter().filter(|item| item.0 != "INPUTS");
            (domain.collect::<Vec<_>>(), file.unit(1).unwrap(), file.bands(), file.bit_depth())
        };
        assert_eq!(written(&whole), written(&tile), "{name}");
        assert_eq!(whole.metadata("INPUTS", "").as_deref(), Some("v00, v01, v02"));
        assert_eq!(whole.metadata("LAYOUT", "IMAGE_STRUCTURE").as_deref(), Some("COG"));
        for band in 1..=whole.bands() {
            let [a, b] = [&whole, &tile].map(|f| f.band(band).unwrap());
            assert_eq!(format!("{a:?}"), format!("{b:?}"));
        }
    }
    let dsm = ImageFile::open(&run.join(DSM)).unwrap();
    assert_eq!(HeightSystem::of_raster(&dsm).unwrap().from.as_deref(), Some("ellipsoid"));
    assert!(std::fs::read_to_string(run.join("dsm.qml")).unwrap().contains("singlebandpseudocolor"));
    let page = std::fs::read_to_string(run.join(PAGE)).unwrap();
    for text in ["Hillshade of the mosaic", "x001_y000", "95th percentile", "<path d=\"M40.0"] {
        assert!(page.contains(text), "{text}");
    }
    assert!(!page.contains("http:") && !page.contains("https:"), "the page needs nothing else");
}

#[test]
fn failed_tiles_are_without_data_and_named_until_they_are_done() {
    let tiles = Made { columns: &[24, 24], rows: &[24, 24], at: &town(2) };
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path();
    tiles.write(run);
    let failed = tile_folder(run, "x001_y000");
    let done = std::fs::read(failed.join(DONE)).unwrap();
    std::fs::remove_file(failed.join(DONE)).unwrap();
    Failure { reason: "an image cannot be read".into() }.write(&failed).unwrap();
    let summary = made(run);
    assert_eq!((summary.tiles, summary.failed.len()), (3, 1));
    assert_eq!(summary.failed[0].reason, "an image cannot be read");
    let heights = ImageFile::open(&run.join(DSM)).unwrap().read(1).unwrap();
    let missing = |col: usize, row: usize| heights.at(col, row).is_nan();
    let in_core = (24..48).flat_map(|row| (24..48).map(move |col| (col, row)));
    assert!(in_core.clone().all(|(col, row)| missing(col, row)));
    let others =
        (0..48usize).flat_map(|row| (0..48).map(move |col| (col, row))).filter(|&(c, r)| c < 24 || r < 24);
    assert!((others.filter(|&(col, row)| missing(col, row)).count() as f64) < 0.05 * 1728.0);
    assert!(run.join(FAILED).exists() && run.join(SEAMS).exists());
    assert_eq!(mosaic(run, &NoProgress).unwrap(), Outcome::Kept(Some(summary)));

    std::fs::write(failed.join(DONE), done).unwrap();
    let complete = made(run);
    assert_eq!((complete.tiles, complete.failed.len(), complete.seams.seams), (4, 0, 4));
    assert!(!run.join(FAILED).exists());
}

#[test]
fn a_mosaic_of_nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = Made { columns: &[24], rows: &[24], at: &town(2) };
    tiles.write(folder.path());
    std::fs::remove_file(tile_folder(folder.path(), "x000_y000").join(DONE)).unwrap();
    assert!(matches!(mosaic(folder.path(), &NoProgress).unwrap_err(), TilesError::NothingDone { .. }));
}
