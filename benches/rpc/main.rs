//! Points a second on one thread, fastest of several runs: `cargo bench --bench rpc`.
//!
//! A million points in an area of 1024² pixels of a 30,000² image, heights from point to point; localisation starts
//! from nothing and ends when every point is right to 1e-8 px, which is checked.

#![allow(clippy::print_stdout)]

use satgs::frame::{Pixel, Point};
use satgs::rpc::{Axis, GroundBatch, PixelBatch, Rpc, RpcCoefficients, RpcError};
use std::time::Instant;

const POINTS: usize = 1_000_000;
/// Runs of which the fastest counts.
const RUNS: usize = 15;

/// A full image of 0.5 m pixels with every term in play.
fn camera() -> Result<Rpc, RpcError> {
    let poly = |seed: f64, lead: [f64; 4]| {
        std::array::from_fn(|i| if i < 4 { lead[i] } else { 1e-4 * ((i as f64 + 1.0) * seed).sin() })
    };
    Rpc::new(RpcCoefficients {
        col: Axis { offset: 15_000.0, scale: 15_000.0 },
        row: Axis { offset: 15_000.0, scale: 15_000.0 },
        lon: Axis { offset: 5.44, scale: 0.093 },
        lat: Axis { offset: 43.26, scale: 0.067 },
        height: Axis { offset: 190.0, scale: 500.0 },
        col_num: poly(1.3, [0.002, 1.0, 0.01, 0.06]),
        col_den: poly(2.1, [1.0, 0.001, -0.002, 0.0005]),
        row_num: poly(0.7, [-0.001, 0.02, -1.0, 0.04]),
        row_den: poly(3.3, [1.0, -0.0015, 0.001, -0.0007]),
        err_bias_m: None,
        err_rand_m: None,
    })
}

fn millions_a_second(mut run: impl FnMut()) -> f64 {
    let mut fastest = f64::INFINITY;
    for _ in 0..RUNS {
        let start = Instant::now();
        run();
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    1e-6 * POINTS as f64 / fastest
}

fn main() -> Result<(), RpcError> {
    let rpc = camera()?;
    let place = |i: usize, step: f64| (i as f64 * step).fract();
    let pixels = PixelBatch {
        col: (0..POINTS).map(|i| 9000.0 + 1024.0 * place(i, 0.618_034)).collect(),
        row: (0..POINTS).map(|i| 21_000.0 + 1024.0 * place(i, 0.754_878)).collect(),
    };
    let heights: Vec<f64> = (0..POINTS).map(|i| 100.0 + 200.0 * place(i, 0.569_840)).collect();
    let (mut ground, mut seen) = (GroundBatch::default(), PixelBatch::default());
    let localized = millions_a_second(|| rpc.localize_batch(&pixels, &heights, &mut ground));
    let projected = millions_a_second(|| rpc.project_batch(&ground, &mut seen));
    let mut worst = 0.0f64;
    for i in 0..POINTS {
        let p = Point::new(ground.lon_deg[i], ground.lat_deg[i], ground.height_m[i]);
        let px = Pixel::new(pixels.col[i], pixels.row[i]);
        worst = worst.max(rpc.project(p).distance(px)).max(px.distance(Pixel::new(seen.col[i], seen.row[i])));
    }
    println!("projections    {projected:6.1} million a second");
    println!("localisations  {localized:6.1} million a second, worst {worst:.1e} px");
    assert!(worst < 1e-8, "a point is {worst} px off");
    Ok(())
}
