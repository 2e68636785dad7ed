//! Bundle adjustment of a scene by cells of its ground.

use crate::common::disagreement_px;
use satgs::bundle::{Adjustment, BundleError, BundleOptions, CorrectionModel, adjust};
use satgs::checkpoint::PartStore;
use satgs::frame::{Pixel, Point, SiteGrid};
use satgs::io::SensorImage;
use satgs::progress::{Event, NoProgress, Recorder};
use satgs::random::CounterRng;
use satgs::rpc::{Rpc, formats};
use satgs::scene::{ReadOptions, Scene, read};
use satgs::simulate::{SimulateOptions, simulate};
use std::path::Path;

const SIZE: usize = 400;
/// Side of the cells, metres: two by two of them cover the scene.
const CELL_M: f64 = 130.0;
const CELLS: [&str; 4] = ["x000_y000", "x001_y000", "x000_y001", "x001_y001"];
/// Largest distance of a corrected camera from the true one, pixels, once the common translation is taken out.
const SHIFT_TOLERANCE_PX: f64 = 0.1;
const MOST_TRACKS: usize = 2000;

fn town(views: usize) -> (tempfile::TempDir, Scene) {
    let folder = tempfile::tempdir().unwrap();
    let options = SimulateOptions { size_px: SIZE, views, ..SimulateOptions::default() };
    simulate(folder.path(), &options, &NoProgress).unwrap();
    let scene = read(folder.path(), &ReadOptions::default()).unwrap();
    (folder, scene)
}

fn by_cells() -> BundleOptions {
    BundleOptions { cell_m: Some(CELL_M), ..BundleOptions::default() }
}

fn stored_in(folder: &Path, town: &str) -> BundleOptions {
    BundleOptions { store: Some(PartStore::new(folder, town)), ..by_cells() }
}

fn worst_shift_px(folder: &Path, made: &Adjustment) -> f64 {
    let truth = |name: &str| formats::read(&folder.join(format!("truth/rpcs/{name}.json"))).unwrap().rpc;
    let pairs: Vec<(Rpc, Rpc)> = made.cameras.iter().map(|(name, rpc)| (rpc.clone(), truth(name))).collect();
    let middle = 0.5 * SIZE as f64;
    disagreement_px(&pairs, Pixel::new(middle, middle)).into_iter().fold(0.0, f64::max)
}

/// All files of an adjustment that tell its numbers.
fn files(scene: &Scene, made: &Adjustment) -> [Vec<u8>; 3] {
    let folder = tempfile::tempdir().unwrap();
    made.write(folder.path(), scene).unwrap();
    ["tie_points.csv", "points.ply", "report.json"]
        .map(|name| std::fs::read(folder.path().join(name)).unwrap())
}

/// The cells that were matched, in order.
fn matched(recorder: &Recorder) -> Vec<String> {
    let mut cells: Vec<String> = Vec::new();
    for event in recorder.events() {
        let Event::Advanced { status, .. } = event else { continue };
        if let Some((id, "finding features")) = status.split_once(": ") {
            cells.push(id.into());
        }
    }
    cells
}

/// Replaces what a view shows of the ground within some metres of a place by what `value` says.
fn paint(
    folder: &Path,
    scene: &mut Scene,
    view: usize,
    [east, north]: [f64; 2],
    reach_m: f64,
    value: impl Fn(usize) -> u8,
) {
    let site = SiteGrid::at(scene.center().unwrap()).unwrap();
    let view = &mut scene.views[view];
    let mut pixels: Vec<u8> =
        view.read_colors().unwrap()[0].data.iter().map(|v| (255.0 * v).round() as u8).collect();
    let height_m = view.rpc.center().height_m();
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let px = Pixel::new((i % SIZE) as f64, (i / SIZE) as f64);
        let at = site.utm_from_geodetic(view.rpc.localize(px, height_m).unwrap());
        let off = [at.x() - site.origin.x() - east, at.y() - site.origin.y() - north];
        if off.iter().all(|d| d.abs() <= reach_m) {
            *pixel = value(i);
        }
    }
    let path = folder.join(format!("painted_{}.tif", view.name));
    let image = SensorImage { width: SIZE, height: SIZE, rpc: &[], metadata: &[] };
    image.write_u8(&path, vec![pixels]).unwrap();
    (view.image, view.bands) = (path, vec![1]);
}

#[test]
fn cells_correct_the_cameras_as_well_as_the_whole_scene_at_once() {
    let (folder, scene) = town(10);
    let at_once = adjust(&scene, &BundleOptions::default(), &NoProgress).unwrap();
    assert!(at_once.report.cells.is_empty());
    let whole = worst_shift_px(folder.path(), &at_once);
    let made = adjust(&scene, &by_cells(), &NoProgress).unwrap();
    let worst = worst_shift_px(folder.path(), &made);
    println!("{whole:.3} px at once, {worst:.3} px by cells, {} tracks", made.report.tracks);
    assert_eq!(made.cameras.len(), 10);
    assert!(worst < SHIFT_TOLERANCE_PX && worst < whole + 0.02, "{worst} {whole}");

    let cells = &made.report.cells;
    assert_eq!(cells.iter().map(|c| c.id.as_str()).collect::<Vec<_>>(), CELLS);
    for cell in cells {
        assert!((100..=MOST_TRACKS).contains(&cell.tracks) && cell.rms_px.unwrap() < 0.3, "{cell:?}");
    }
    assert_eq!(cells.iter().map(|c| c.tracks).sum::<usize>(), made.report.tracks);
    // Every quarter of a cell's side has some.
    let site = SiteGrid::at(Point::new(cells[0].center_deg[0], cells[0].center_deg[1], 0.0)).unwrap();
    let mut quarters = [0; 16];
    for p in made.points.iter().map(|p| site.utm_from_geodetic(p.position)) {
        let [x, y] = [p.x() - site.origin.x(), p.y() - site.origin.y()].map(|d| 2.0 + 4.0 * d / CELL_M);
        if (0.0..4.0).contains(&x) && (0.0..4.0).contains(&y) {
            quarters[y as usize * 4 + x as usize] += 1;
        }
    }
    assert!(quarters.iter().filter(|n| **n > 0).count() >= 12, "{quarters:?}");

    let options = BundleOptions { model: CorrectionModel::Affine, ..by_cells() };
    let affine = worst_shift_px(folder.path(), &adjust(&scene, &options, &NoProgress).unwrap());
    assert!(affine < SHIFT_TOLERANCE_PX, "{affine}");
}

#[test]
fn an_interrupted_adjustment_goes_on_with_the_cells_it_has_and_damaged_ones_are_made_again() {
    let (_folder, scene) = town(4);
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let expected = pool(1).install(|| files(&scene, &adjust(&scene, &by_cells(), &NoProgress).unwrap()));

    let stored = tempfile::tempdir().unwrap();
    let options = stored_in(stored.path(), "a town");
    let stop = Recorder::cancelling(|event| matches!(event, Event::Advanced { done: 2, .. }));
    let error = adjust(&scene, &options, &stop).unwrap_err();
    assert!(matches!(error, BundleError::Interrupted(_)), "{error}");
    assert!(stop.events().contains(&Event::Resumable(true)));
    assert_eq!(matched(&stop), CELLS[..2]);

    let rest = Recorder::default();
    let made = pool(3).install(|| adjust(&scene, &options, &rest)).unwrap();
    assert_eq!(matched(&rest), CELLS[2..]);
    assert!(files(&scene, &made) == expected, "the files differ from those of an uninterrupted adjustment");

    let damaged = stored.path().join("cells").join(format!("{}.bin", CELLS[1]));
    let bytes = std::fs::read(&damaged).unwrap();
    std::fs::write(&damaged, &bytes[..bytes.len() / 2]).unwrap();
    let again = Recorder::default();
    let made = adjust(&scene, &options, &again).unwrap();
    assert_eq!(matched(&again), CELLS[1..2]);
    assert!(files(&scene, &made) == expected);
    assert!(std::fs::read(&damaged).unwrap() == bytes);

    // Tie points of other images are found again.
    let other = stored_in(stored.path(), "another town");
    let anew = Recorder::default();
    adjust(&scene, &other, &anew).unwrap();
    assert_eq!(matched(&anew), CELLS);
}

#[test]
fn a_cell_without_texture_is_skipped_and_a_view_with_a_cloud_in_a_cell_is_used_in_the_others() {
    let (folder, mut scene) = town(5);
    for view in 0..5 {
        paint(folder.path(), &mut scene, view, [-100.0, -100.0], 130.0, |_| 90);
    }
    let cloud = |i: usize| (256.0 * CounterRng::new(0, 0, i as u64, 0).uniform()) as u8;
    paint(folder.path(), &mut scene, 2, [100.0, 100.0], 110.0, cloud);
    let recorder = Recorder::default();
    let made = adjust(&scene, &by_cells(), &recorder).unwrap();
    assert_eq!(made.cameras.len(), 5);
    let worst = worst_shift_px(folder.path(), &made);
    assert!(worst < SHIFT_TOLERANCE_PX, "{worst}");
    let cells = &made.report.cells;
    assert!(cells[0].skipped.is_some() && cells[0].tracks == 0 && cells[0].rms_px.is_none(), "{cells:?}");
    assert!(cells[1..].iter().all(|c| c.skipped.is_none() && c.tracks > 50), "{cells:?}");
    let warnings: Vec<String> = recorder
        .events()
        .into_iter()
        .filter_map(|e| if let Event::Warning(text) = e { Some(text) } else { None })
        .collect();
    let [warning] = warnings.as_slice() else { panic!("{warnings:?}") };
    assert!(warning.starts_with("1 of 4 cells of the ground have no tie points: x000_y000 ("), "{warning}");

    for view in 0..5 {
        paint(folder.path(), &mut scene, view, [0.0, 0.0], 1000.0, |_| 90);
    }
    let error = adjust(&scene, &by_cells(), &NoProgress).unwrap_err();
    assert!(matches!(error, BundleError::NoCell { cells: 4, .. }), "{error}");
}
