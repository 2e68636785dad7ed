//! `satgs dsm-eval` with wrong input: exit code 2, a message that names the file, a hint, nothing written.

// Helpers of tests are tests.
#![allow(clippy::unwrap_used)]

use satgs::raster::{Cog, MapGrid, Plane};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder with a prediction, a truth with its classes, and an output folder that should stay empty.
struct Desk {
    folder: tempfile::TempDir,
}

const GRID: MapGrid =
    MapGrid { epsg: 32617, west: 436_000.0, north: 3_357_100.0, cell: 0.5, width: 60, height: 60 };

fn relief() -> Plane {
    Plane::from_fn(60, 60, |c, r| (c / 9 * 3 + r / 7 * 2) as f32 + 0.1 * c as f32)
}

impl Desk {
    fn new() -> Self {
        let desk = Self { folder: tempfile::tempdir().unwrap() };
        desk.height("dsm.tif", GRID, &relief());
        desk.height("TOWN_DSM.tif", GRID, &relief());
        desk.classes("TOWN_CLS.tif", GRID, vec![2; 3600]);
        desk
    }
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
    fn height(&self, name: &str, grid: MapGrid, plane: &Plane) {
        let cog = Cog { grid, metadata: &[], heights_from: None };
        cog.write_f32(&self.path(name), &[("height", "m", plane)]).unwrap();
    }
    fn classes(&self, name: &str, grid: MapGrid, codes: Vec<u8>) {
        Cog { grid, metadata: &[], heights_from: None }
            .write_u8(&self.path(name), vec![codes], None)
            .unwrap();
    }
    /// A truth as DFC2019 ships it: pixels without a place, and a text file.
    fn truth_with_txt(&self, text: Option<&str>) {
        let pixels: Vec<u8> = (0..3600u32).map(|i| (i % 251) as u8).collect();
        let image = satgs::raster::SensorImage { width: 60, height: 60, rpc: &[], metadata: &[] };
        image.write_u8(&self.path("PLAIN_DSM.tif"), vec![pixels]).unwrap();
        if let Some(text) = text {
            std::fs::write(self.path("PLAIN_DSM.txt"), text).unwrap();
        }
    }
    fn eval(&self, truth: &str, more: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_satgs"))
            .arg("dsm-eval")
            .args([self.path("dsm.tif"), self.path(truth)])
            .arg("-o")
            .arg(self.path("eval"))
            .args(more)
            .output()
            .unwrap()
    }
    fn refused(&self, truth: &str, more: &[&str], words: &[&str]) {
        let output = self.eval(truth, more);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains("error: ") && stderr.contains("hint: "), "{stderr}");
        for word in words {
            assert!(stderr.contains(word), "`{word}` is missing in: {stderr}");
        }
        assert!(output.stdout.is_empty());
        assert_eq!(files(&self.path("eval")), 0, "{stderr}");
    }
}

fn files(folder: &Path) -> usize {
    std::fs::read_dir(folder).map_or(0, Iterator::count)
}

#[test]
fn good_input_is_scored() {
    let desk = Desk::new();
    let output = desk.eval("TOWN_DSM.tif", &["--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let scores: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(scores["verdicts"][2]["mae_m"], 0.0);
    assert_eq!(scores["verdicts"][0]["by_class"]["2"]["cells"], 3600);
    assert_eq!(files(&desk.path("eval")), 3);
}

#[test]
fn truth_elsewhere_does_not_overlap() {
    let desk = Desk::new();
    desk.height("far.tif", MapGrid { west: 440_000.0, ..GRID }, &relief());
    desk.refused("far.tif", &[], &["dsm.tif", "far.tif", "do not overlap", "0 common cells", "440000"]);
}

#[test]
fn fewer_than_100_common_cells_do_not_overlap() {
    let desk = Desk::new();
    desk.height(
        "corner.tif",
        MapGrid { west: GRID.west + 25.5, north: GRID.north - 25.5, ..GRID },
        &relief(),
    );
    desk.refused("corner.tif", &[], &["do not overlap", "81 common cells", "100 are needed"]);
}

#[test]
fn nothing_but_nodata_or_water_does_not_overlap() {
    let desk = Desk::new();
    desk.height("empty.tif", GRID, &Plane::filled(60, 60, f32::NAN));
    desk.refused("empty.tif", &[], &["do not overlap", "0 cells of land"]);
    desk.height("undeclared.tif", GRID, &Plane::filled(60, 60, -9999.0));
    desk.refused("undeclared.tif", &[], &["do not overlap", "0 cells of land"]);
    desk.classes("TOWN_CLS.tif", GRID, vec![9; 3600]);
    desk.refused("TOWN_DSM.tif", &[], &["do not overlap", "0 common cells"]);
}

#[test]
fn truth_in_degrees_is_refused_by_name() {
    let desk = Desk::new();
    let degrees = MapGrid { epsg: 4326, west: -81.66, north: 30.35, cell: 5e-6, ..GRID };
    desk.height("degrees.tif", degrees, &relief());
    desk.refused("degrees.tif", &[], &["degrees.tif", "in degrees", "gdalwarp -t_srs EPSG:32617"]);
}

#[test]
fn classes_of_another_size_are_refused_with_both_sizes() {
    let desk = Desk::new();
    desk.classes("TOWN_CLS.tif", MapGrid { width: 50, height: 40, ..GRID }, vec![2; 2000]);
    desk.refused("TOWN_DSM.tif", &[], &["TOWN_CLS.tif", "50 x 40", "60 x 60", "--classes"]);
    desk.classes("mine.tif", MapGrid { width: 30, ..GRID }, vec![2; 1800]);
    let mine = desk.path("mine.tif");
    desk.refused("TOWN_DSM.tif", &["--classes", mine.to_str().unwrap()], &["mine.tif", "30 x 60"]);
}

#[test]
fn a_wrong_text_file_is_named() {
    for (text, words) in [
        ("436000 3357070 60", "holds 3 numbers"),
        ("436000 north 60 0.5", "`north` is not a number"),
        ("3357070 436000 60 0.5", "is no UTM easting and northing"),
        ("436000 3357070 512 0.5", "says 512 x 512 cells, the raster is 60 x 60"),
        ("436000 3357070 60 0", "resolution"),
        ("", "holds 0 numbers"),
    ] {
        let desk = Desk::new();
        desk.truth_with_txt(Some(text));
        desk.refused("PLAIN_DSM.tif", &[], &["PLAIN_DSM.txt", words, "four numbers"]);
    }
}

#[test]
fn a_missing_text_file_is_named() {
    let desk = Desk::new();
    desk.truth_with_txt(None);
    desk.refused("PLAIN_DSM.tif", &[], &["PLAIN_DSM.tif", "PLAIN_DSM.txt", "does not exist", "lower-left"]);
}

#[test]
fn a_missing_truth_is_named() {
    Desk::new().refused("none.tif", &[], &["none.tif", "No such file"]);
}

#[test]
fn existing_output_stays_unless_told_otherwise() {
    let desk = Desk::new();
    std::fs::create_dir(desk.path("eval")).unwrap();
    std::fs::write(desk.path("eval/error.tif"), "mine").unwrap();
    let output = desk.eval("TOWN_DSM.tif", &[]);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("error.tif` exists") && stderr.contains("--overwrite"), "{stderr}");
    assert_eq!(std::fs::read_to_string(desk.path("eval/error.tif")).unwrap(), "mine");
    assert_eq!(files(&desk.path("eval")), 1);
    assert!(desk.eval("TOWN_DSM.tif", &["--overwrite"]).status.success());
    assert_eq!(files(&desk.path("eval")), 3);
}
