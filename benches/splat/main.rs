//! Times of an iteration's stages, fastest of several runs, as a table: `cargo bench --bench splat [-- THREADS]`.

#![allow(clippy::print_stdout)]

mod scene;

use rayon::ThreadPoolBuilder;
use satgs::splat::adam::SplatAdam;
use satgs::splat::appearance::Appearance;
use satgs::splat::backend::Snapshot;
use satgs::splat::gaussians::Gaussians;
use satgs::splat::objective::{Gradient, LossWeights, Objective, Sheared, Shot};
use satgs::splat::raster::{FrameCamera, LOW_PASS_PX2, Layers, Prepared, Rasterizer, SplatGradient};
use satgs::splat::ssim::Photometric;
use satgs::splat::stopwatch::Stopwatch;
use std::time::Instant;

/// Runs of which the fastest counts.
const RUNS: usize = 7;
const ALTITUDES: (f64, f64) = (-3.0, 30.0);

fn fastest_ms(mut run: impl FnMut()) -> f64 {
    let mut once = || {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64() * 1e3
    };
    once();
    (0..RUNS).map(|_| once()).fold(f64::INFINITY, f64::min)
}

/// Pixels with alpha of at least 1/255 over all splats, were none hidden: the areas of their ellipses.
fn contributing_pairs(splats: &Gaussians, camera: &FrameCamera<f32>) -> f64 {
    let m = camera.linear.map(|l| l.map(f64::from));
    let area = |i: usize| {
        let (r, _) = satgs::splat::gaussians::rotation_matrix(splats.rotation[i].map(f64::from));
        let axis = |k: usize, row: usize| {
            let length = f64::from(splats.log_scale[i][k]).exp();
            length * (0..3).map(|j| m[row][j] * r[j][k]).sum::<f64>()
        };
        let dot = |a: usize, b: usize| (0..3).map(|k| axis(k, a) * axis(k, b)).sum::<f64>();
        let det = (dot(0, 0) + LOW_PASS_PX2) * (dot(1, 1) + LOW_PASS_PX2) - dot(0, 1).powi(2);
        let opacity = 1.0 / (1.0 + (-f64::from(splats.logit[i])).exp());
        std::f64::consts::TAU * (255.0 * opacity).ln().max(0.0) * det.sqrt()
    };
    (0..splats.len()).map(area).sum()
}

fn noise(width: usize, height: usize, channels: usize) -> Layers<f32> {
    let mut out = Layers::zeros(width, height, channels);
    for (i, v) in out.data.iter_mut().enumerate() {
        *v = 0.5 + 0.5 * (i as f32 * 0.37).sin();
    }
    out
}

fn report(splats: usize, pixels: f64) {
    // In the order in which training stores splats.
    let gaussians = Snapshot::start(scene::town(splats, pixels, 1), 1).splats;
    let side = scene::side(pixels);
    let affine = scene::camera(pixels);
    let camera = FrameCamera::<f32>::new(&affine, side, side);
    let pairs = contributing_pairs(&gaussians, &camera);

    let mut prepared = Prepared::default();
    let prepare = fastest_ms(|| prepared.update(&gaussians));
    let features: Vec<[f32; 4]> = prepared
        .order()
        .iter()
        .map(|&i| {
            let [r, g, b] = gaussians.f_dc[i as usize];
            [r, g, b, gaussians.position[i as usize][2]]
        })
        .collect();
    let mut raster = Rasterizer::<f32, 4>::default();
    let bin = fastest_ms(|| {
        raster.project(&prepared, &camera);
        raster.bin(&features);
    });
    let render = fastest_ms(|| {
        raster.render(&prepared, &features, &camera, [0.0; 4]);
    });
    let by_pixel = noise(side, side, 4);
    let mut shared = vec![SplatGradient::default(); splats];
    let mut by_feature = vec![[0.0; 4]; splats];
    let backward = fastest_ms(|| raster.backward(&by_pixel, &mut shared, &mut by_feature));

    let truth = noise(side, side, 3);
    let mut picture = truth.clone();
    picture.data.reverse();
    let mut photometric = Photometric::default();
    let ssim = fastest_ms(|| {
        photometric.compare(&picture, &truth);
    });

    let rates = [1e-9; 5];
    let mut adam = SplatAdam::new(splats);
    let mut trained = gaussians.clone();
    let mut gradient = Gradient { splats: gaussians.clone(), ..Gradient::default() };
    let adam_ms = fastest_ms(|| adam.step(&mut trained, &gradient.splats, rates));

    let size = (side, side);
    let mut shot = Shot {
        camera,
        truth: &truth,
        valid: &[],
        sun: None,
        virtual_view: None,
        background: [0.3; 3],
        floor: ALTITUDES.0 as f32,
    };
    let weights = LossWeights {
        opacity: 0.01,
        consistency_altitude: 0.1,
        consistency_color: 0.1,
        shadow_entropy: 0.01,
    };
    let mut objective = Objective::<f32>::default();
    let mut watch = Stopwatch::default();
    let mut iteration = |shot: &Shot<f32>| {
        fastest_ms(|| {
            objective.evaluate(&trained, &Appearance::default(), shot, &weights, &mut gradient, &mut watch);
            adam.step(&mut trained, &gradient.splats, rates);
        })
    };
    let one = iteration(&shot);
    shot.sun = Some(Sheared::sun(&affine, size, [1.7, -2.1], ALTITUDES));
    shot.virtual_view = Some(Sheared::virtual_view(&affine, size, [0.4, 0.3]));
    let three = iteration(&shot);

    let rate = |ms: f64| pairs / ms * 1e-6;
    println!(
        "| {:.0} k | {:.2} | {:.1} | {prepare:.1} | {bin:.1} | {:.1} | {:.2} | {backward:.1} | {:.2} | {ssim:.1} \
         | {adam_ms:.1} | {one:.0} | {three:.0} |",
        splats as f64 * 1e-3,
        pixels * 1e-6,
        pairs * 1e-6,
        render - bin,
        rate(render - bin),
        rate(backward),
    );
}

fn main() {
    let threads = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(2);
    ThreadPoolBuilder::new().num_threads(threads).build_global().expect("the first pool");
    println!(
        "| splats | MP | M pairs | prepare | project, bin | forward | G pairs/s | backward | G pairs/s | SSIM | Adam \
         | one render | three |"
    );
    println!("|{}", "---|".repeat(13));
    for splats in [50_000, 100_000, 250_000, 1_000_000] {
        report(splats, 0.64e6);
    }
    for pixels in [0.25e6, 2.5e6] {
        report(100_000, pixels);
    }
}
