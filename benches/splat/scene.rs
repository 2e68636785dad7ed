//! A simulated town of splats with the sizes and opacities of trained splats.
//!
//! Quartiles after 5,000 iterations on JAX_068 (140 k splats, 0.35 m pixels): smallest axis 0.05, 0.12, 0.29 m;
//! middle axis 0.27, 0.52, 1.0 m; largest axis 0.7, 1.2, 2.0 m; opacity 0.01, 0.03, 0.09, with 5 % above 0.6.

use satgs::affine::ViewCamera;
use satgs::random::CounterRng;
use satgs::splat::splats::Splats;

/// Pixels per metre.
const SCALE: f64 = 2.9;
/// Median of the standard deviation along each axis, metres, and standard deviation of its logarithm.
const AXES: [(f64, f64); 3] = [(0.12, 1.3), (0.52, 1.0), (1.2, 0.8)];
/// Numbers of splats and pixels for which the axes have the sizes of JAX_068.
const SPLATS: f64 = 100e3;
const PIXELS: f64 = 640e3;
/// Height of the highest building, metres.
const HIGHEST_M: f64 = 25.0;

/// Side of a square image with about this number of pixels, pixels.
pub fn side(pixels: f64) -> usize {
    pixels.sqrt().round() as usize
}

/// A camera that looks down at the town obliquely.
pub fn camera(pixels: f64) -> ViewCamera {
    let middle = 0.5 * side(pixels) as f64;
    ViewCamera::affine([[SCALE, 0.02, -0.9], [0.02, -SCALE, 0.6]], [middle; 2])
}

/// Height of the town's surface at a place, metres: blocks of 20 m, half of them with a building.
fn height(x: f64, y: f64, seed: u64) -> f64 {
    let block = |v: f64| (v / 20.0).floor() as i64 as u64;
    let mut draw = CounterRng::new(seed, 1, block(x), block(y));
    if draw.uniform() < 0.5 { HIGHEST_M * draw.uniform() } else { 0.0 }
}

/// A number of splats over an image of this number of pixels. The fewer there are the larger they are, so that they cover
/// the image equally.
pub fn town(splats: usize, pixels: f64, seed: u64) -> Splats {
    let half_m = 0.5 * side(pixels) as f64 / SCALE;
    let spread = ((pixels / PIXELS) / (splats as f64 / SPLATS)).sqrt();
    let mut out = Splats::zeros(splats);
    for i in 0..splats {
        let mut draw = CounterRng::new(seed, 0, 0, i as u64);
        let [x, y] = [0; 2].map(|_| half_m * (2.0 * draw.uniform() - 1.0));
        let z = height(x, y, seed) + 0.3 * draw.normal();
        out.position[i] = [x, y, z].map(|v| v as f32);
        let lengths = AXES.map(|(median, deviation)| (spread * median).ln() + deviation * draw.normal());
        out.log_scale[i] = lengths.map(|v| v as f32);
        out.rotation[i] = [0; 4].map(|_| draw.normal() as f32);
        // One in ten is opaque; the others are of low opacity, as most splats are after training.
        let logit = if draw.uniform() < 0.1 { 1.0 + 2.0 * draw.normal() } else { 1.3 * draw.normal() - 3.6 };
        out.opacity_logit[i][0] = logit as f32;
        out.f_dc[i] = [0; 3].map(|_| draw.normal() as f32);
    }
    out
}
