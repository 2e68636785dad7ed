//! `satgs dsm-eval` with wrong input: exit code 2, a message that names the file, a hint, nothing written.

use satgs::frame::{Point, SiteGrid};
use satgs::io::{Cog, Grid2, MapGrid, Outline, VerticalReference, write_outlines};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder with a prediction, a truth with its classes, and an output folder that should stay empty.
struct Desk {
    folder: tempfile::TempDir,
}

const GRID: MapGrid =
    MapGrid { epsg: 32617, west: 436_000.0, north: 3_357_100.0, cell: 0.5, width: 60, height: 60 };

fn relief() -> Grid2 {
    Grid2::from_fn(60, 60, |c, r| (c / 9 * 3 + r / 7 * 2) as f32 + 0.1 * c as f32)
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
    fn height(&self, name: &str, grid: MapGrid, raster: &Grid2) {
        let cog = Cog { grid, metadata: &[], heights_from: None };
        cog.write_f32(&self.path(name), &[("height", "m", raster)]).unwrap();
    }
    fn classes(&self, name: &str, grid: MapGrid, codes: Vec<u8>) {
        Cog { grid, metadata: &[], heights_from: None }
            .write_u8(&self.path(name), vec![codes], None)
            .unwrap();
    }
    /// A truth as DFC2019 ships it: pixels without a place, and a text file.
    fn truth_with_txt(&self, text: Option<&str>) {
        let heights = Grid2::from_fn(60, 60, |col, row| ((row * 60 + col) % 251) as f32);
        let image = satgs::io::SensorImage { width: 60, height: 60, rpc: &[], metadata: &[] };
        image.write_f32(&self.path("PLAIN_DSM.tif"), &[("", "", &heights)]).unwrap();
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
    /// What is said, and the scores.
    fn scored(&self, truth: &str, more: &[&str]) -> (String, Value) {
        let output = self.eval(truth, &[more, &["--json", "--overwrite"]].concat());
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{stderr}");
        (stderr, serde_json::from_slice(&output.stdout).unwrap())
    }
    /// A point cloud: three points in every cell of the relief, of which the middle one is the highest.
    fn points(&self, name: &str, system: &str) {
        let mut builder = las::Builder::from((1, 2));
        builder.point_format.is_compressed = name.ends_with("laz");
        builder.system_identifier = system.into();
        let axis = |offset| las::Transform { scale: 0.001, offset };
        builder.transforms = las::Vector { x: axis(436_000.0), y: axis(3_357_000.0), z: axis(0.0) };
        let mut writer = las::Writer::from_path(self.path(name), builder.into_header().unwrap()).unwrap();
        let relief = relief();
        for i in 0..3600 {
            let (col, row) = (i % 60, i / 60);
            let p = GRID.cell_center(col, row);
            let z = f64::from(relief.at(col, row));
            for (dx, down) in [(-0.1, 3.0), (0.0, 0.0), (0.1, 1.0)] {
                let class = if row < 10 { 9 } else { 2 };
                writer
                    .write_point(las::Point {
                        x: p.x() + dx,
                        y: p.y(),
                        z: z - down,
                        classification: las::point::Classification::new(class).unwrap(),
                        ..las::Point::default()
                    })
                    .unwrap();
            }
            // A bird.
            writer
                .write_point(las::Point {
                    x: p.x(),
                    y: p.y(),
                    z: z + 50.0,
                    classification: las::point::Classification::HighNoise,
                    ..las::Point::default()
                })
                .unwrap();
        }
        writer.close().unwrap();
    }
    /// Longitude and latitude of a place on the grid, metres from its north-western corner.
    fn lon_lat(east: f64, south: f64) -> (f64, f64) {
        let map = SiteGrid { epsg: GRID.epsg, origin: Point::new(0.0, 0.0, 0.0) };
        let p = map.geodetic_from_utm(Point::new(GRID.west + east, GRID.north - south, 0.0));
        (p.lon_deg(), p.lat_deg())
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
    assert_eq!(scores["registered_scores"][2]["mae_m"], 0.0);
    assert_eq!(scores["registered_scores"][0]["breakdown"][0]["name"], "2 ground");
    assert_eq!(scores["registered_scores"][0]["breakdown"][0]["cells"], 3600);
    let names = ["metrics.json", "error.tif", "error.qml", "error.png", "histogram.svg", "cumulative.svg"];
    assert_eq!(files(&desk.path("eval")), names.len());
    assert!(names.iter().all(|name| desk.path("eval").join(name).exists()));
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let desk = Desk::new();
    let shaken = Grid2::from_fn(60, 60, |c, r| {
        if (c * 7 + r * 11) % 23 == 0 { f32::NAN } else { relief().at(c, r) + ((c * r) % 17) as f32 * 0.1 }
    });
    desk.height("dsm.tif", GRID, &shaken);
    let made = |threads| {
        let (_, scores) = desk.scored("TOWN_DSM.tif", &["--threads", threads]);
        (scores, std::fs::read(desk.path("eval/error.tif")).unwrap())
    };
    let one = made("1");
    assert_eq!(one.0["registered_scores"][2]["breakdown"].as_array().unwrap().len(), 3, "{:#}", one.0);
    assert!(one == made("2") && one == made("5"));
}

#[test]
fn a_truth_of_another_place_is_refused() {
    let desk = Desk::new();
    desk.height("far.tif", MapGrid { west: 440_000.0, ..GRID }, &relief());
    desk.refused("far.tif", &[], &["dsm.tif", "far.tif", "do not overlap", "0 common cells", "440000"]);
}

#[test]
fn fewer_than_100_common_cells_are_refused() {
    let desk = Desk::new();
    desk.height(
        "corner.tif",
        MapGrid { west: GRID.west + 25.5, north: GRID.north - 25.5, ..GRID },
        &relief(),
    );
    desk.refused("corner.tif", &[], &["do not overlap", "81 common cells", "100 are needed"]);
}

#[test]
fn a_truth_of_nodata_or_water_alone_is_refused() {
    let desk = Desk::new();
    desk.height("empty.tif", GRID, &Grid2::filled(60, 60, f32::NAN));
    desk.refused("empty.tif", &[], &["do not overlap", "0 cells of land"]);
    desk.height("undeclared.tif", GRID, &Grid2::filled(60, 60, -9999.0));
    desk.refused("undeclared.tif", &[], &["do not overlap", "0 cells of land"]);
    desk.classes("TOWN_CLS.tif", GRID, vec![9; 3600]);
    desk.refused("TOWN_DSM.tif", &[], &["do not overlap", "0 common cells"]);
}

#[test]
fn a_truth_in_degrees_is_refused() {
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
fn classes_and_masks_of_another_place_are_refused() {
    let desk = Desk::new();
    desk.classes("TOWN_CLS.tif", MapGrid { west: GRID.west + 20.0, ..GRID }, vec![2; 3600]);
    desk.refused("TOWN_DSM.tif", &[], &["TOWN_CLS.tif", "does not lie on the grid"]);
    let desk = Desk::new();
    desk.classes("mask.tif", MapGrid { epsg: 32618, ..GRID }, vec![1; 3600]);
    let mask = desk.path("mask.tif");
    let mask = ["--mask", mask.to_str().unwrap()];
    desk.refused("TOWN_DSM.tif", &mask, &["mask.tif", "does not lie on the grid"]);
    desk.classes("mask.tif", MapGrid { width: 30, ..GRID }, vec![1; 1800]);
    desk.refused("TOWN_DSM.tif", &mask, &["mask.tif", "30 x 60", "60 x 60"]);
    desk.classes("mask.tif", GRID, vec![0; 3600]);
    desk.refused("TOWN_DSM.tif", &mask, &["mask.tif", "no cell", "not 0 inside"]);
}

#[test]
fn unknown_classes_give_a_warning() {
    let desk = Desk::new();
    desk.classes("TOWN_CLS.tif", GRID, (0..3600).map(|i| if i % 2 == 0 { 2 } else { 113 }).collect());
    assert!(desk.scored("TOWN_DSM.tif", &[]).0.contains("class codes 113 are unknown in DFC2019"));
}

#[test]
fn a_mask_is_scored_inside_and_outside() {
    let desk = Desk::new();
    // The prediction is 1 m too high in its western third.
    let wrong = Grid2::from_fn(60, 60, |c, r| relief().at(c, r) + if c < 20 { 1.0 } else { 0.0 });
    desk.height("dsm.tif", GRID, &wrong);
    desk.classes("mask.tif", GRID, (0..3600).map(|i| u8::from(i % 60 < 20)).collect());
    let corners = [(0.0, 0.0), (10.0, 0.0), (10.0, 30.0), (0.0, 30.0)];
    let ring = corners.map(|(e, s)| Desk::lon_lat(e, s)).to_vec();
    let outline = Outline { name: "third".into(), ring: ring.clone(), numbers: Vec::new() };
    write_outlines(&desk.path("mask.geojson"), "mask", &[outline]).unwrap();
    for name in ["mask.tif", "mask.geojson"] {
        let mask = desk.path(name);
        let (_, scores) = desk.scored("TOWN_DSM.tif", &["--mask", mask.to_str().unwrap()]);
        let breakdown = scores["registered_scores"][0]["breakdown"].as_array().unwrap();
        let part = |name: &str| breakdown.iter().find(|s| s["name"] == name).unwrap();
        assert_eq!(part("inside mask")["cells"], 1200, "{name}");
        assert_eq!(part("outside mask")["cells"], 2400, "{name}");
        let mae = |name: &str| part(name)["mae_m"].as_f64().unwrap();
        assert!((mae("inside mask") - 1.0).abs() < 1e-5 && mae("outside mask") < 1e-5, "{name}");
    }
    let corners: Vec<String> = ring.iter().chain(ring.first()).map(|(x, y)| format!("{x} {y}")).collect();
    std::fs::write(desk.path("mask.csv"), format!("name,WKT\na,\"POLYGON (({}))\"\n", corners.join(", ")))
        .unwrap();
    std::fs::remove_dir_all(desk.path("eval")).unwrap();
    let mask = desk.path("mask.csv");
    desk.refused("TOWN_DSM.tif", &["--mask", mask.to_str().unwrap()], &["mask.csv", "CRS is not stated"]);
}

#[test]
fn heights_in_feet_are_converted_and_other_units_refused() {
    let desk = Desk::new();
    for (unit, metres) in [("US survey foot", 1200.0 / 3937.0), ("ft", 0.3048)] {
        let mut feet = relief();
        feet.data.iter_mut().for_each(|v| *v /= metres);
        Cog { grid: GRID, metadata: &[], heights_from: None }
            .write_f32(&desk.path("feet.tif"), &[("height", unit, &feet)])
            .unwrap();
        let (said, scores) = desk.scored("feet.tif", &[]);
        assert!(said.contains(unit) && said.contains("converted to metres"), "{said}");
        assert!(scores["registered_scores"][0]["mae_m"].as_f64().unwrap() < 1e-4);
    }
    std::fs::remove_dir_all(desk.path("eval")).unwrap();
    Cog { grid: GRID, metadata: &[], heights_from: None }
        .write_f32(&desk.path("odd.tif"), &[("height", "fathom", &relief())])
        .unwrap();
    desk.refused("odd.tif", &[], &["odd.tif", "fathom", "feet"]);
}

#[test]
fn a_map_in_feet_is_refused() {
    let desk = Desk::new();
    desk.height("florida.tif", MapGrid { epsg: 2236, ..GRID }, &relief());
    desk.refused("florida.tif", &[], &["florida.tif", "not in metres", "gdalwarp -t_srs EPSG:32617"]);
}

#[test]
fn pixel_is_point_and_pixel_is_area_are_georeferenced_alike() {
    let desk = Desk::new();
    let metadata = [("AREA_OR_POINT", "Point".to_owned())];
    let point = Cog { grid: GRID, metadata: &metadata, heights_from: None };
    point.write_f32(&desk.path("point.tif"), &[("height", "m", &relief())]).unwrap();
    assert_eq!(desk.scored("point.tif", &[]).1["registered_scores"][0]["mae_m"], 0.0);
}

#[test]
fn undeclared_nodata_is_left_out_with_a_warning() {
    let desk = Desk::new();
    let mut holes = relief();
    holes.data[..600].fill(-9999.0);
    desk.height("dsm.tif", GRID, &holes);
    let (said, scores) = desk.scored("TOWN_DSM.tif", &[]);
    assert!(said.contains("600 cells of -9999"), "{said}");
    assert_eq!(scores["registered_scores"][0]["mae_m"], 0.0);
    assert_eq!(scores["registered_scores"][0]["predicted"], 3000);
}

#[test]
fn a_geoid_offset_is_suspected_and_converted_on_request() {
    let desk = Desk::new();
    let mut orthometric = relief();
    orthometric.data.iter_mut().for_each(|v| *v += 29.0);
    desk.height("above_geoid.tif", GRID, &orthometric);
    let (said, _) = desk.scored("above_geoid.tif", &[]);
    assert!(said.contains("vertical reference") && said.contains("-29.00 m"), "{said}");
    if VerticalReference::read("EGM96").is_ok() {
        assert!(said.contains("--truth-vertical sets the reference"), "{said}");
    }
    let degrees = MapGrid { epsg: 4326, west: -84.0, north: 32.0, cell: 0.5, width: 8, height: 8 };
    // PROJ asks for this description and unit, if there are any.
    let geoid_grid = |grid: MapGrid, undulation_m: f32| {
        let cog = Cog { grid, metadata: &[], heights_from: None };
        let raster = Grid2::filled(8, 8, undulation_m);
        cog.write_f32(&desk.path("geoid.tif"), &[("geoid_undulation", "metre", &raster)]).unwrap();
    };
    geoid_grid(degrees, -29.0);
    let geoid = desk.path("geoid.tif");
    let (said, scores) = desk.scored("above_geoid.tif", &["--truth-vertical", geoid.to_str().unwrap()]);
    assert!(said.contains("converted from the geoid (geoid.tif) to the ellipsoid"), "{said}");
    assert!(scores["registered_scores"][0]["dz_m"].as_f64().unwrap().abs() < 1e-5);
    std::fs::remove_dir_all(desk.path("eval")).unwrap();
    geoid_grid(MapGrid { west: 10.0, ..degrees }, 45.0);
    desk.refused(
        "above_geoid.tif",
        &["--truth-vertical", geoid.to_str().unwrap()],
        &["above_geoid.tif", "does not cover"],
    );
    let none = ["--truth-vertical", "NAVD88"];
    desk.refused("above_geoid.tif", &none, &["known are `ellipsoid`, EGM84, EGM96, EGM2008"]);
    desk.refused("above_geoid.tif", &none, &["NAVD88"]);
}

#[test]
fn what_proj_cannot_read_is_told_by_satgs_alone() {
    let desk = Desk::new();
    let broken = desk.path("broken.gtx");
    std::fs::write(&broken, "no grid").unwrap();
    for reference in [broken.to_str().unwrap(), "EGM84"] {
        let output = desk.eval("TOWN_DSM.tif", &["--truth-vertical", reference]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!said.contains("proj_create"), "{said}");
        assert!(output.status.success() || said.starts_with("error: "), "{said}");
    }
}

#[test]
fn vertical_references_in_files_are_converted() {
    let desk = Desk::new();
    let (lon, lat) = Desk::lon_lat(15.0, 15.0);
    let Ok(egm96) = VerticalReference::read("EGM96") else { return };
    let geoid_m = egm96.undulation_m(lon, lat);
    let write = |name: &str, from: &VerticalReference, up: f64| {
        let mut raster = relief();
        raster.data.iter_mut().for_each(|v| *v += up as f32);
        let cog = Cog { grid: GRID, metadata: &[], heights_from: Some(from) };
        cog.write_f32(&desk.path(name), &[("height", "m", &raster)]).unwrap();
    };
    write("dsm.tif", &VerticalReference::Ellipsoid, 0.0);
    write("egm96.tif", &egm96, -geoid_m);
    let (said, scores) = desk.scored("egm96.tif", &[]);
    assert!(said.contains("converted to ellipsoidal heights"), "{said}");
    let dz = scores["registered_scores"][0]["dz_m"].as_f64().unwrap();
    assert!(dz.abs() < 0.05, "{dz}");
    // Two that count from the same geoid stay as they are.
    write("dsm.tif", &egm96, 0.0);
    let (said, scores) = desk.scored("egm96.tif", &[]);
    assert!(!said.contains("converted"), "{said}");
    assert!((scores["registered_scores"][0]["dz_m"].as_f64().unwrap() + geoid_m).abs() < 0.05);
}

#[test]
fn points_are_rasterised_to_the_highest_of_every_cell() {
    let desk = Desk::new();
    for name in ["lidar.las", "lidar.laz"] {
        desk.points(name, "EPSG:32617");
        let (said, scores) = desk.scored(name, &[]);
        assert!(said.contains("highest"), "{said}");
        assert_eq!((&scores["land_cells"], &scores["water_cells"]), (&3000.into(), &600.into()));
        assert!(scores["registered_scores"][0]["mae_m"].as_f64().unwrap() < 1e-3, "{scores:#}");
    }
}

#[test]
fn damaged_and_unusable_point_clouds_are_refused() {
    let desk = Desk::new();
    desk.points("lidar.las", "");
    desk.refused("lidar.las", &[], &["lidar.las", "CRS is not stated", "--truth-crs"]);
    desk.refused("lidar.las", &["--truth-crs", "2236"], &["EPSG:2236", "in metres"]);
    // 3600 cells hold four points each; the header promises more.
    let mut bytes = std::fs::read(desk.path("lidar.las")).unwrap();
    bytes[107..111].copy_from_slice(&20_000u32.to_le_bytes());
    std::fs::write(desk.path("short.las"), &bytes).unwrap();
    desk.refused("short.las", &["--truth-crs", "32617"], &["short.las", "complete"]);
    bytes[107..111].copy_from_slice(&0u32.to_le_bytes());
    std::fs::write(desk.path("none.las"), &bytes).unwrap();
    desk.refused("none.las", &["--truth-crs", "32617"], &["none.las", "no points"]);
    std::fs::write(desk.path("noise.laz"), b"LASF and nothing else").unwrap();
    desk.refused("noise.laz", &[], &["noise.laz"]);
    let scores = desk.scored("lidar.las", &["--truth-crs", "32617"]).1;
    assert_eq!(scores["land_cells"], 3000);
}

#[test]
fn a_wrong_text_file_is_named() {
    for (text, words) in [
        ("436000 3357070 60", "holds 3 numbers"),
        ("436000 north 60 0.5", "`north` is not a number"),
        ("3357070 436000 60 0.5", "is not a UTM easting and northing"),
        ("436000 3357070 512 0.5", "states 512 x 512 cells, the raster has 60 x 60"),
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
fn existing_output_is_replaced_only_with_overwrite() {
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
    assert_eq!(files(&desk.path("eval")), 6);
}
