//! Heights that are searched: what stands far above the tie points or lies far below them, wide ranges, the option.

use super::input;
use crate::common::{refused, succeeds, text};
use satgs::frame::{Geodetic, Point, SiteGrid};
use satgs::io::ImageFile;
use std::path::Path;

pub const FOLDERS: &[&str] = &["tower_lost", "wide_height_range"];

/// Side of the part of a roof that is looked at, metres: a cell less than the roof on each side.
const ROOF_M: f64 = 6.0;

/// Values of a band of a raster of a run, in a square around a place that lies so many metres east and north of the middle of
/// the simulated scenes.
fn around(run: &Path, file: &str, band: usize, [east, north]: [f64; 2]) -> Vec<f32> {
    let raster = ImageFile::open(&run.join(file)).unwrap();
    let grid = raster.map_grid().unwrap();
    let values = raster.read(band).unwrap();
    let middle: Point<Geodetic> = Point::new(5.5, 43.3, 150.0);
    let [x, y, _] = SiteGrid::at(middle).unwrap().origin.xyz();
    let mut out = Vec::new();
    for row in 0..grid.height {
        for col in 0..grid.width {
            let p = grid.cell_center(col, row);
            let is_near = |a: f64, b: f64| (a - b).abs() <= 0.5 * ROOF_M;
            if is_near(p.x(), x + east) && is_near(p.y(), y + north) {
                out.push(values.at(col, row));
            }
        }
    }
    out
}

fn median(mut values: Vec<f32>) -> f32 {
    values.sort_by(f32::total_cmp);
    values[values.len() / 2]
}

#[test]
fn a_tower_without_tie_points_stands_and_the_option_bounds_the_search() {
    let Some(folder) = input("tower_lost") else { return };
    let out = tempfile::tempdir().unwrap();
    let scene = folder.join("scene");
    let run = |name: &str, range: Option<&str>| {
        let path = out.path().join(name);
        let mut args =
            vec!["run", scene.to_str().unwrap(), "-o", path.to_str().unwrap(), "--iterations", "5"];
        args.extend(range.iter().flat_map(|range| ["--height-range", range]));
        let said = text(&succeeds(&args));
        (path, said)
    };
    let roof = [5.0, -5.0];
    let (tower, said) = run("tower", None);
    assert!(said.contains("heights searched: ") && said.contains(" to 230 m, from the RPCs"), "{said}");
    let height = median(around(&tower, "dsm.tif", 1, roof));
    assert!((height - 195.0).abs() < 1.0, "the roof is at {height} m");
    let views = median(around(&tower, "confidence.tif", 3, roof));
    assert!(views >= 2.0, "{views} views confirm the roof");
    let ground = median(around(&tower, "dsm.tif", 1, [-25.0, 20.0]));
    assert!((ground - 150.0).abs() < 2.0, "the ground is at {ground} m");

    let (cut, said) = run("cut", Some("140,165"));
    assert!(said.contains("heights searched: 140 to 165 m, from --height-range"), "{said}");
    let highest = around(&cut, "dsm.tif", 1, roof).into_iter().fold(f32::NEG_INFINITY, f32::max);
    assert!(highest <= 166.0, "the option bounds the heights: {highest}");
}

#[test]
fn a_range_of_rpcs_that_is_too_wide_to_match_is_named_with_its_remedy() {
    let Some(folder) = input("wide_height_range") else { return };
    let out = tempfile::tempdir().unwrap();
    let (scene, run) = (folder.join("scene"), out.path().join("run"));
    let ba = ["ba", scene.to_str().unwrap(), "-o", run.to_str().unwrap()];
    refused(&ba, 2, &["-9000 to 9000 m", "narrower --height-range"]);
    succeeds(&[&ba[..], &["--height-range", "100,220"]].concat());
    let info = succeeds(&["info", scene.to_str().unwrap()]);
    let said = String::from_utf8_lossy(&info.stdout).into_owned() + &text(&info);
    assert!(said.contains("heights searched: -9000 to 9000 m, from the RPCs"), "{said}");
}

/// Rust files of a folder and of those in it.
fn sources(folder: &Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let files = entries.flat_map(|path| if path.is_dir() { sources(&path) } else { vec![path] });
    files.filter(|path| path.extension().is_some_and(|end| end == "rs")).collect()
}

/// Whoever intersects footprints at one height misses views of ground that is far above or below it:
/// `scene::Footprints` asks at every height of the range.
#[test]
fn one_place_decides_what_two_views_share() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    // Ground that many views see, at one height that was chosen by what they share; cells of ground.
    let may = ["scene/footprint.rs", "scene/shared_ground.rs", "bundle/cell_grid.rs"].map(|f| source.join(f));
    for file in sources(&source) {
        let code = std::fs::read_to_string(&file).unwrap();
        let meets =
            code.contains(".intersection(") && (code.contains("footprint(") || code.contains("outline("));
        assert!(!meets || may.contains(&file), "{} intersects footprints of its own", file.display());
    }
}
