//! Times of the kernels of an iteration on a GPU, with the bytes and operations that follow from their sizes.
//!
//! `cargo bench --features gpu --bench gpu [-- [gpu:N] [SPLATS WIDTH HEIGHT]...]` measures 120,000 and a million splats in images of
//! 0.6 and 5 MP, unless it is told otherwise, on the first GPU. A room of ellipsoids with harmonics of degree 3 is seen from its middle.

#![allow(clippy::print_stdout)]

use glam::{DMat3, DVec2, DVec3};
use satgs::io::Grid2;
use satgs::perspective::PinholeCamera;
use satgs::random::CounterRng;
use satgs::splat::backend::{DensifyPlan, StepPlan, TrainingBackend, Wait};
use satgs::splat::gpu::{DevicePhotographs, GpuBackend, GpuDevice, Measured};
use satgs::splat::loss::{LossWeights, SurfaceDepth};
use satgs::splat::pinhole::PinholeView;
use satgs::splat::recipe::NetworkRates;
use satgs::splat::splats::{PerGroup, Splats};
use satgs::splat::state::TrainingState;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Half sides of the room, metres.
const ROOM_M: [f64; 3] = [3.0, 3.0, 1.5];
/// Iterations of which the mean time counts, and measured ones of which the median counts.
const ITERATIONS: u32 = 20;
const MEASURED: usize = 5;

fn splats(n: usize) -> Splats {
    let mut out = Splats::zeros(n);
    out.f_rest.resize(n, [0.0; 45]);
    // The walls are covered as well by few splats as by many.
    let scale = (0.02 * (3e5 / n as f64).sqrt()).ln();
    for i in 0..n {
        let mut draw = CounterRng::new(1, 0, 0, i as u64);
        let mut p = ROOM_M.map(|half| half * (2.0 * draw.uniform() - 1.0));
        let axis = draw.below(3);
        p[axis] = ROOM_M[axis] * p[axis].signum() + 0.02 * draw.normal();
        out.position[i] = p.map(|v| v as f32);
        out.log_scale[i] = [0; 3].map(|_| (scale + 0.6 * draw.normal()) as f32);
        out.rotation[i] = [0; 4].map(|_| draw.normal() as f32);
        out.opacity_logit[i][0] = (2.0 * draw.normal() - 1.0) as f32;
        out.f_dc[i] = [0; 3].map(|_| draw.normal() as f32);
        out.f_rest[i] = [0; 45].map(|_| 0.1 * draw.normal() as f32);
    }
    out
}

fn view(size: (usize, usize)) -> PinholeView {
    let camera = PinholeCamera {
        cam_from_site: DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X).transpose(),
        center: DVec3::new(-2.5, 0.3, 0.1),
        focal: DVec2::splat(0.9 * size.0 as f64),
        principal: DVec2::new(0.5 * size.0 as f64, 0.5 * size.1 as f64),
        size,
    };
    let plane = Grid2::from_fn(size.0, size.1, |col, row| ((col * 31 + row * 17) % 256) as f32 / 255.0);
    PinholeView::new("photograph".into(), camera, &[plane.clone(), plane.clone(), plane])
}

fn plan(iteration: u32) -> StepPlan {
    StepPlan {
        iteration,
        view: 0,
        level: 0,
        shadows: false,
        virtual_shear: None,
        background: [0.0; 3],
        random_background: [0.0; 3],
        weights: LossWeights::default(),
        opacity_divisor: None,
        sh_degree: 3,
        surface: SurfaceDepth::Mean,
        rates: PerGroup::default(),
        appearance_rate: 0.0,
        network_rates: NetworkRates::default(),
        densify: DensifyPlan::default(),
        crop: None,
        visibility: None,
        seed: 0,
    }
}

/// Bytes that a kernel reads and writes, and its floating-point operations, once each.
fn work(kernel: &str, n: f64, pixels: f64, of: &Measured) -> (f64, f64) {
    let (pairs, evaluated) = (f64::from(of.pairs), of.evaluated as f64);
    match kernel {
        "project" => (n * (64.0 + 180.0 + 64.0 + 8.0), n * 450.0),
        "pair_counts" | "pair_emit" => (n * 72.0 + pairs * 6.0, n * 60.0),
        "tile_ranges" => (pairs * 12.0, 0.0),
        "forward" => (pairs * 72.0 + pixels * 16.0, evaluated * 12.0),
        "ssim_forward" => (pixels * (3.0 * 20.0 + 36.0), pixels * 3.0 * 300.0),
        "ssim_backward" => (pixels * (3.0 * 20.0 + 36.0 + 12.0), pixels * 3.0 * 160.0),
        "backward" => (pairs * (72.0 + 36.0) + pixels * 28.0, evaluated * 40.0),
        "gather" => (n * (64.0 + 180.0 + 64.0 + 64.0 + 16.0) + pairs * 36.0, n * 700.0),
        "step_rest" => (n * (6.0 * 180.0 + 128.0), n * 45.0 * 12.0),
        "step_core" => (n * 64.0 * 7.0, n * 14.0 * 12.0),
        _ => (0.0, 0.0),
    }
}

fn measure(number: Option<usize>, n: usize, size: (usize, usize)) -> Result<(), Box<dyn std::error::Error>> {
    let gpu = GpuDevice::open(number)?;
    let name = gpu.info.name.clone();
    let state = TrainingState::start(splats(n), Default::default(), 0, 0);
    let mut backend = GpuBackend::new(gpu, Arc::new(vec![view(size)]), state)?;
    let mut reports = Vec::new();
    let mut run = |backend: &mut GpuBackend<DevicePhotographs>, iterations| {
        let started = Instant::now();
        (1..=iterations).try_for_each(|i| backend.submit(&plan(i)))?;
        backend.reports(Wait::ForAll, &mut reports)?;
        Ok::<_, Box<dyn std::error::Error>>(started.elapsed() / iterations)
    };
    run(&mut backend, 2)?;
    let iteration = run(&mut backend, ITERATIONS)?;
    let mut measured = (0..MEASURED).map(|_| backend.measure(&plan(1))).collect::<Result<Vec<_>, _>>()?;
    let sum = |m: &Measured| m.kernels.iter().map(|k| k.1).sum::<Duration>();
    measured.sort_by_key(sum);
    let middle = &measured[MEASURED / 2];
    let mut kernels = BTreeMap::<&str, (u32, Duration)>::new();
    for (name, time) in &middle.kernels {
        let kernel = kernels.entry(name).or_default();
        *kernel = (kernel.0 + 1, kernel.1 + *time);
    }
    let pixels = (size.0 * size.1) as f64;
    println!(
        "\n{name}: {n} splats, {} x {} pixels: {:.3} ms an iteration; {:.3} ms in {} dispatches; {} pairs of splats and tiles, \
         {:.0} M evaluations\n",
        size.0,
        size.1,
        iteration.as_secs_f64() * 1e3,
        sum(middle).as_secs_f64() * 1e3,
        middle.kernels.len(),
        middle.pairs,
        middle.evaluated as f64 / 1e6
    );
    println!("| kernel | dispatches | ms | MB | GB/s | GFLOP | GFLOP/s |\n|---|---|---|---|---|---|---|");
    for (kernel, (count, time)) in kernels {
        let (bytes, operations) = work(kernel, n as f64, pixels, middle);
        let seconds = time.as_secs_f64().max(1e-9);
        println!(
            "| {kernel} | {count} | {:.3} | {:.1} | {:.0} | {:.2} | {:.0} |",
            seconds * 1e3,
            bytes / 1e6,
            bytes / 1e9 / seconds,
            operations / 1e9,
            operations / 1e9 / seconds
        );
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let number = words.iter().find_map(|word| word.strip_prefix("gpu:")?.parse().ok());
    let numbers: Vec<usize> = words.iter().filter_map(|word| word.parse().ok()).collect();
    let asked = numbers.as_chunks::<3>().0.iter().map(|[n, width, height]| (*n, (*width, *height)));
    let mut scenes: Vec<_> = asked.collect();
    if scenes.is_empty() {
        scenes = vec![
            (120_000, (960, 640)),
            (120_000, (2560, 1960)),
            (1_000_000, (960, 640)),
            (1_000_000, (2560, 1960)),
        ];
    }
    scenes.into_iter().try_for_each(|(n, size)| measure(number, n, size))
}
