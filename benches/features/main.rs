//! Keypoints of 1000² pixels on two threads, and how many of them a warped image shows again:
//! `cargo bench --bench features [-- IMAGE]`, the image being `s2p/input_pair/img_01.tif` of the real data.
//! `scripts/compare-sift` says the same of OpenCV's.

#![allow(clippy::print_stdout)]

use satgs::bundle::{Keypoint, detect};
use satgs::io::{Grid2, ImageFile, Window};
use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::time::Instant;

const SIDE: usize = 1000;
/// Runs of which the fastest counts.
const RUNS: usize = 10;
/// Share of the pixels below black, and above white.
const TAIL: f64 = 0.005;
/// The warp about the image's middle: degrees, and scale.
const TURN_DEG: f64 = 15.0;
const SCALE: f64 = 0.9;
/// Keypoints nearer to the warped image's edge than this need not be seen again, pixels.
const MARGIN_PX: f64 = 20.0;
/// How near a keypoint must be seen again, pixels, and how like in scale.
const NEAR_PX: f64 = 1.5;
const SAME_SCALE: f64 = std::f64::consts::SQRT_2;

/// The top-left part of an image, in [0, 1].
fn image(path: &Path) -> Result<Grid2, Box<dyn std::error::Error>> {
    let mut plane =
        ImageFile::open(path)?.read_window(1, Window { col: 0, row: 0, width: SIDE, height: SIDE })?;
    let mut values: Vec<f32> = plane.valid().collect();
    values.sort_by(f32::total_cmp);
    let at = |share: f64| values[(share * (values.len() - 1) as f64) as usize];
    let (black, white) = (at(TAIL), at(1.0 - TAIL));
    plane.data.iter_mut().for_each(|v| *v = ((*v - black) / (white - black)).clamp(0.0, 1.0));
    Ok(plane)
}

/// Where the warped image shows a place.
fn warped_place([col, row]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = TURN_DEG.to_radians().sin_cos();
    let middle = 0.5 * (SIDE - 1) as f64;
    let (x, y) = (col - middle, row - middle);
    [middle + SCALE * (cos * x - sin * y), middle + SCALE * (sin * x + cos * y)]
}

fn warped(image: &Grid2) -> Grid2 {
    let (sin, cos) = TURN_DEG.to_radians().sin_cos();
    let middle = 0.5 * (SIDE - 1) as f64;
    Grid2::from_fn(SIDE, SIDE, |c, r| {
        let (x, y) = ((c as f64 - middle) / SCALE, (r as f64 - middle) / SCALE);
        let value = image.bilinear(middle + cos * x + sin * y, middle - sin * x + cos * y);
        if value.is_nan() { 0.0 } else { value }
    })
}

/// Places and scales without the copies that differ in direction alone.
fn places(found: &[Keypoint]) -> Vec<([f64; 2], f64)> {
    let mut all: Vec<_> = found.iter().map(|k| ([k.px.col, k.px.row], f64::from(k.scale))).collect();
    all.dedup();
    all
}

fn keypoints(image: &Grid2) -> Vec<Keypoint> {
    let Ok(found) = detect((image.width, image.height), |window| Ok::<_, Infallible>(image.window(window)));
    found
}

/// Share of keypoints that the warped image shows again where they belong, of those that lie in it.
fn repeatability(here: &[([f64; 2], f64)], there: &[([f64; 2], f64)]) -> f64 {
    let inside = MARGIN_PX..SIDE as f64 - MARGIN_PX;
    let (mut again, mut all) = (0, 0);
    for (place, scale) in here {
        let expected = warped_place(*place);
        if !expected.iter().all(|v| inside.contains(v)) {
            continue;
        }
        all += 1;
        let is_again = |(q, s): &([f64; 2], f64)| {
            let ratio = s / (SCALE * scale);
            (q[0] - expected[0]).hypot(q[1] - expected[1]) < NEAR_PX
                && (SAME_SCALE.recip()..=SAME_SCALE).contains(&ratio)
        };
        again += usize::from(there.iter().any(is_again));
    }
    again as f64 / all as f64
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Cargo itself adds options.
    let given = std::env::args().skip(1).find(|a| !a.starts_with('-')).map(PathBuf::from);
    let data = std::env::var_os("SATGS_DATA").map_or("../shared/data".into(), PathBuf::from);
    let path = given.unwrap_or_else(|| data.join("s2p/input_pair/img_01.tif"));
    if !path.exists() {
        println!("skipped: no real data at {}", path.display());
        return Ok(());
    }
    rayon::ThreadPoolBuilder::new().num_threads(2).build_global()?;
    let image = image(&path)?;
    let (mut fastest, mut found) = (f64::INFINITY, Vec::new());
    for _ in 0..RUNS {
        let start = Instant::now();
        found = keypoints(&image);
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    let again = keypoints(&warped(&image));
    println!(
        "satgs: {} keypoints in {:.0} ms, {:.1} % seen again",
        found.len(),
        1e3 * fastest,
        100.0 * repeatability(&places(&found), &places(&again))
    );
    Ok(())
}
