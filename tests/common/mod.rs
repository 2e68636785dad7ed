//! What several test files need: the folder of real data, a made-up camera, images, the binary.
#![allow(dead_code, clippy::print_stdout, clippy::unwrap_used)]

use satgs::raster::SensorImage;
use satgs::rpc::formats::to_gdal;
use satgs::rpc::{Axis, Rpc, RpcCoefficients};
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
    Command::new(env!("CARGO_BIN_EXE_satgs")).args(args).output().unwrap()
}
