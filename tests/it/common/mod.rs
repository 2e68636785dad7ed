//! What several test files need: the folder of real data, a made-up camera, images, the binary.
pub mod perspective;
pub mod photographs;
pub mod scenes;
pub mod web_server;

use satgs::frame::{CenterPx, Pixel, Point, SiteGrid};
use satgs::io::SensorImage;
use satgs::rpc::formats::to_gdal;
use satgs::rpc::{Axis, Rpc, RpcCoefficients};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The folder of real data: `SATGS_DATA`, else `../shared/data`; says so when it is absent.
pub fn data_dir() -> Option<PathBuf> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = std::env::var_os("SATGS_DATA").map_or(here, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no real data at {} (SATGS_DATA names another place)", folder.display());
    None
}

/// A camera over Marseille: 0.5 m pixels, leaning east by `lean` pixels a metre.
pub fn camera(lon: f64, lean: f64) -> Rpc {
    let linear = |c: [f64; 4]| std::array::from_fn(|i| if i < 4 { c[i] } else { 0.0 });
    Rpc::new(RpcCoefficients {
        col: Axis { offset: 31.5, scale: 40.0 },
        row: Axis { offset: 31.5, scale: 40.0 },
        lon: Axis { offset: lon, scale: 0.00025 },
        lat: Axis { offset: 43.26, scale: 0.00018 },
        height: Axis { offset: 100.0, scale: 50.0 },
        col_num: linear([0.0, 1.0, 0.0, lean * 50.0 / 40.0]),
        col_den: linear([1.0, 0.0, 0.0, 0.0]),
        row_num: linear([0.0, 0.0, -1.0, 0.0]),
        row_den: linear([1.0, 0.0, 0.0, 0.0]),
        err_bias_m: None,
        err_rand_m: None,
    })
    .unwrap()
}

/// The camera of an image resampled by `factor` (new size / old size), about the outer corner of the first pixel.
pub fn resampled(rpc: &Rpc, factor: f64) -> Rpc {
    let mut c = rpc.coefficients().clone();
    for axis in [&mut c.col, &mut c.row] {
        axis.offset = factor * (axis.offset + 0.5) - 0.5;
        axis.scale *= factor;
    }
    Rpc::new(c).unwrap()
}

/// A 64×64 image of noise with an RPC tag (if `rpc`) and metadata items.
pub fn image(path: &Path, seed: u32, rpc: Option<&Rpc>, items: &[(&str, &str)]) {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(1);
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let pixels: Vec<u8> = (0..64 * 64).map(|_| noise()).collect();
    let metadata: Vec<(String, String)> =
        items.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    let rpc = rpc.map(to_gdal).unwrap_or_default();
    let sensor = SensorImage { width: 64, height: 64, rpc: &rpc, metadata: &metadata };
    sensor.write_u8(path, vec![pixels]).unwrap();
}

/// A folder with two good views, `a.tif` and `b.tif`.
pub fn two_views() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    image(&folder.path().join("a.tif"), 1, Some(&camera(5.44, 0.2)), &[]);
    image(&folder.path().join("b.tif"), 2, Some(&camera(5.44, -0.2)), &[]);
    folder
}

/// Runs `satgs`.
pub fn satgs(args: &[&str]) -> Output {
    satgs_in(Path::new("."), args)
}

/// Runs the binary in a folder.
pub fn satgs_in(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_satgs")).args(args).current_dir(folder).output().unwrap()
}

/// What a command wrote to standard error.
pub fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs `satgs`, which must succeed.
pub fn succeeds(args: &[&str]) -> Output {
    let output = satgs(args);
    assert!(output.status.success(), "{args:?}: {}", text(&output));
    output
}

/// Runs `satgs`, which must end with this code and an error that has these words. Returns the error.
pub fn refused(args: &[&str], code: i32, says: &[&str]) -> String {
    let output = satgs(args);
    let error = text(&output);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {error}");
    says.iter().for_each(|words| assert!(error.contains(words), "{args:?}: no `{words}` in {error}"));
    error
}

/// Path and content of every file of a folder and of those in it.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            all.extend(files(&path));
        } else {
            let bytes = std::fs::read(&path).unwrap();
            all.insert(path, bytes);
        }
    }
    all
}

/// Copies a folder with all it holds.
pub fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let to = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy_folder(&path, &to);
        } else {
            std::fs::copy(&path, &to).unwrap();
        }
    }
}

/// Distance of each camera from its counterpart at a pixel, once the one translation of the ground that tie points
/// leave open is taken out of all.
pub fn disagreement_px(pairs: &[(Rpc, Rpc)], px: Pixel<CenterPx>) -> Vec<f64> {
    let mut rows: Vec<([f64; 3], f64)> = Vec::new();
    for (found, exact) in pairs {
        let center = exact.localize(px, exact.center().height_m()).unwrap();
        let site = SiteGrid::at(center).unwrap();
        let (seen, off) = (exact.project(center), found.project(center));
        // Pixels a metre east, north and up.
        let by = |d: [f64; 3]| {
            let p = exact.project(site.geodetic_from_site(Point::new(d[0], d[1], d[2])));
            [p.col - seen.col, p.row - seen.row]
        };
        let (e, n, u) = (by([1.0, 0.0, 0.0]), by([0.0, 1.0, 0.0]), by([0.0, 0.0, 1.0]));
        for (k, d) in [off.col - seen.col, off.row - seen.row].into_iter().enumerate() {
            rows.push(([e[k], n[k], u[k]], d));
        }
    }
    let a = nalgebra::DMatrix::from_fn(rows.len(), 3, |r, c| rows[r].0[c]);
    let b = nalgebra::DVector::from_fn(rows.len(), |r, _| rows[r].1);
    let t = a.clone().svd(true, true).solve(&b, 1e-12).unwrap();
    let rest = &b - a * t;
    rest.as_slice().chunks(2).map(|d| d[0].hypot(d[1])).collect()
}

/// A map around the ground of [`two_views`].
pub fn dem_grid() -> satgs::io::MapGrid {
    satgs::io::MapGrid {
        epsg: 32631,
        west: 697_900.0,
        north: 4_793_000.0,
        cell: 10.0,
        width: 60,
        height: 300,
    }
}
