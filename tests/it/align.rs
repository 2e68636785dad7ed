//! `satgs align` through the binary: known shifts, surveyed points, bad references.

use crate::common::satgs;
use satgs::bundle::Adjustment;
use satgs::frame::{Geodetic, Pixel, Point, SiteGrid};
use satgs::io::{Cog, Grid2, ImageFile, MapGrid, write_moved};
use satgs::rpc::{Rpc, formats};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// How near a known shift must be found, metres.
const TOLERANCE_M: f64 = 0.1;
/// Bytes of what an aligned run must not change again.
const FILES: [&str; 4] = ["ba/points.laz", "ba/tie_points.csv", "ba/rpcs/VIEW_01.json", "align.json"];

struct Run {
    _folder: tempfile::TempDir,
    scene: PathBuf,
    run: PathBuf,
    truth: PathBuf,
}

impl Run {
    /// An adjusted run of a simulated town.
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (scene, run) = (folder.path().join("scene"), folder.path().join("run"));
        succeeds(&["simulate", scene.to_str().unwrap(), "--size", "300", "--views", "6", "-q"]);
        succeeds(&["ba", scene.to_str().unwrap(), "-o", run.to_str().unwrap(), "-q"]);
        let truth = scene.join("truth/TOWN_DSM.tif");
        Self { _folder: folder, scene, run, truth }
    }

    fn align(&self, to: &Path) -> std::process::Output {
        satgs(&["align", self.run.to_str().unwrap(), "--to", to.to_str().unwrap()])
    }

    fn aligned(&self, to: &Path) -> String {
        succeeds(&["align", self.run.to_str().unwrap(), "--to", to.to_str().unwrap()])
    }

    fn places(&self) -> Vec<Point<Geodetic>> {
        Adjustment::read_with_observations(&self.run.join("ba")).unwrap().positions()
    }

    fn camera(&self, folder: &str, view: &str) -> Rpc {
        let base = if folder == "ba/rpcs" { &self.run } else { &self.scene };
        formats::read(&base.join(folder).join(format!("{view}.json"))).unwrap().rpc
    }

    fn bytes(&self) -> Vec<Option<Vec<u8>>> {
        FILES.map(|f| std::fs::read(self.run.join(f)).ok()).into()
    }
}

fn succeeds(args: &[&str]) -> String {
    let output = satgs(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned()
}

/// Metres east, north and up on the map.
fn moved(from: Point<Geodetic>, to: Point<Geodetic>) -> [f64; 3] {
    let map = SiteGrid::at(from).unwrap();
    (map.utm_from_geodetic(to) - map.utm_from_geodetic(from)).xyz()
}

fn assert_near(found: [f64; 3], expected: [f64; 3], tolerance: f64) {
    for k in 0..3 {
        assert!((found[k] - expected[k]).abs() < tolerance, "{found:?} is not {expected:?}");
    }
}

#[test]
fn alignment_moves_all_files_of_a_run_and_is_idempotent() {
    let r = Run::new();
    assert!(r.aligned(&r.truth).contains("moved"));
    let before = r.places();
    let camera_before = r.camera("ba/rpcs", "VIEW_01");

    let again = r.bytes();
    assert!(r.aligned(&r.truth).contains("is aligned already"));
    assert_eq!(r.bytes(), again);

    let shift = [3.25, -6.5, 11.0];
    let elsewhere = r.scene.join("elsewhere.tif");
    write_moved(&r.truth, &elsewhere, shift).unwrap();
    r.aligned(&elsewhere);
    let after = r.places();
    for (a, b) in before.iter().zip(&after) {
        assert_near(moved(*a, *b), shift, TOLERANCE_M);
    }
    // The camera sees at a moved point what it saw there before.
    let camera = r.camera("ba/rpcs", "VIEW_01");
    for (a, b) in before.iter().zip(&after).take(50) {
        assert!(camera.project(*b).distance(camera_before.project(*a)) < 0.02);
    }

    r.aligned(&r.truth);
    for (a, b) in before.iter().zip(&r.places()) {
        assert_near(moved(*a, *b), [0.0; 3], 0.01);
    }
    let record: Value =
        serde_json::from_str(&std::fs::read_to_string(r.run.join("align.json")).unwrap()).unwrap();
    assert!((record["shift"]["up_m"].as_f64().unwrap() + 11.0).abs() < TOLERANCE_M, "{record}");
    assert!(record["total"]["up_m"].as_f64().unwrap().abs() < 10.0, "{record}");
    assert_eq!(record["reference"], r.truth.to_str().unwrap());
    let report = std::fs::read_to_string(r.run.join("ba/report.json")).unwrap();
    assert!(report.contains("aligned to"), "{report}");

    // Adjusted anew, it is not aligned any more.
    succeeds(&[
        "ba",
        r.scene.to_str().unwrap(),
        "-o",
        r.run.to_str().unwrap(),
        "--fixed",
        "--overwrite",
        "-q",
    ]);
    assert!(!r.run.join("align.json").exists());
}

#[test]
fn a_reference_above_a_geoid_is_converted_before_alignment() {
    let Ok(egm96) = satgs::io::VerticalReference::read("EGM96") else { return };
    let r = Run::new();
    r.aligned(&r.truth);
    let before = r.places();
    let up = egm96.undulation_m(before[0].lon_deg(), before[0].lat_deg());
    let file = ImageFile::open(&r.truth).unwrap();
    let (grid, mut raster) = (file.map_grid().unwrap(), file.read(1).unwrap());
    raster.data.iter_mut().for_each(|v| *v -= up as f32);
    let reference = r.scene.join("egm96.tif");
    let item = |name: &str| [("VERTICAL_REFERENCE", name.to_owned())];
    let write = |metadata: &[(&str, String)], heights_from| {
        let cog = Cog { grid, metadata, heights_from };
        cog.write_f32(&reference, &[("height", "m", &raster)]).unwrap();
    };
    write(&[], Some(&egm96));
    r.aligned(&reference);
    write(&item("EGM96"), None);
    r.aligned(&reference);
    for (a, b) in before.iter().zip(&r.places()) {
        assert_near(moved(*a, *b), [0.0; 3], TOLERANCE_M);
    }
    write(&item("NAVD88"), None);
    let output = r.align(&reference);
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.code() == Some(2) && text.contains("NAVD88") && text.contains("--vertical"),
        "{text}"
    );
}

#[test]
fn a_run_is_aligned_to_surveyed_points() {
    let r = Run::new();
    let views = ["VIEW_01", "VIEW_02", "VIEW_03"];
    let mut csv = String::from("lon,lat,h,image,col,row,sigma_xy_m,sigma_h_m,sigma_px\n");
    let truth = views.map(|v| r.camera("truth/rpcs", v));
    for px in [[100.0, 120.0], [200.0, 90.0], [150.0, 210.0]] {
        let place = truth[0].localize(Pixel::new(px[0], px[1]), 160.0).unwrap();
        let [lon, lat, h] = place.xyz();
        for (view, camera) in views.iter().zip(&truth) {
            let seen = camera.project(place);
            csv += &format!("{lon:.12},{lat:.12},{h},{view},{},{},0.1,0.1,0.3\n", seen.col, seen.row);
        }
    }
    let gcps = r.scene.join("gcps.csv");
    std::fs::write(&gcps, csv).unwrap();
    r.aligned(&gcps);
    for view in views {
        let place = r.camera("truth/rpcs", view).localize(Pixel::new(150.0, 150.0), 160.0).unwrap();
        let off = r.camera("ba/rpcs", view).project(place).distance(Pixel::new(150.0, 150.0));
        assert!(off < 0.3, "{view} is {off:.3} px off");
    }
    assert!(r.aligned(&gcps).contains("is aligned already"));
}

#[test]
fn a_bad_reference_changes_nothing() {
    let r = Run::new();
    let before = r.bytes();
    let file = |name: &str| r.scene.join(name);
    let grid = ImageFile::open(&r.truth).unwrap().map_grid().unwrap();
    let write = |name: &str, grid: MapGrid, value: f32| {
        let raster = Grid2::filled(grid.width, grid.height, value);
        let cog = Cog { grid, metadata: &[], heights_from: None };
        cog.write_f32(&file(name), &[("height", "m", &raster)]).unwrap();
    };
    write_moved(&r.truth, &file("away.tif"), [50_000.0, 0.0, 0.0]).unwrap();
    write("degrees.tif", MapGrid { epsg: 4326, west: 5.0, north: 44.0, cell: 0.01, ..grid }, 100.0);
    write("nothing.tif", grid, f32::NAN);
    std::fs::write(file("text.tif"), "no raster").unwrap();
    std::fs::write(file("gcps.csv"), "lon,lat\n1,2\n").unwrap();
    for (name, words) in [
        ("away.tif", "lie on heights of"),
        ("degrees.tif", "CRS is in degrees"),
        ("nothing.tif", "lie on heights of"),
        ("text.tif", "text.tif"),
        ("absent.laz", "absent.laz"),
        ("gcps.csv", "gcps.csv"),
    ] {
        let output = r.align(&file(name));
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{name}: {text}");
        assert!(text.contains(words), "{name}: {text}");
    }
    assert_eq!(r.bytes(), before);
    let left: Vec<_> = std::fs::read_dir(&r.run).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 2, "{left:?}");
    let nowhere = satgs(&["align", r.scene.to_str().unwrap(), "--to", r.truth.to_str().unwrap()]);
    assert_eq!(nowhere.status.code(), Some(2));
}

#[test]
fn later_stages_finish_an_interrupted_alignment() {
    let folder = tempfile::tempdir().unwrap();
    let waiting = folder.path().join("align.pending/ba");
    for command in ["train", "dsm"] {
        std::fs::create_dir_all(&waiting).unwrap();
        std::fs::write(waiting.join("report.json"), command).unwrap();
        assert!(!satgs(&[command, folder.path().to_str().unwrap()]).status.success(), "there are no images");
        assert_eq!(std::fs::read_to_string(folder.path().join("ba/report.json")).unwrap(), command);
        assert!(!folder.path().join("align.pending").exists());
    }
}
