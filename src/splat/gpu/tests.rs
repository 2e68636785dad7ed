//! The device against the processor, on the same inputs. Without a device the tests say that they are skipped, unless
//! `SATGS_REQUIRE_GPU=1` is set.

use super::arrays::REPORT;
use super::device::GpuDevice;
use super::photographs::DevicePhotographs;
use super::sort::{SIZES, Sort, SortKernels, sizes_of};
use super::splats::{CORE, DeviceSplats, unpack};
use super::submission::submit;
use super::views::DeviceViews;
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use crate::random::CounterRng;
use crate::splat::backend::{DensifyPlan, StepPlan};
use crate::splat::loss::{LossWeights, SurfaceDepth, TermInputs, terms};
use crate::splat::pinhole::{EllipsoidObjective, NEAREST, PinholeStep, PinholeView};
use crate::splat::raster::{Image, MIN_TRANSMITTANCE};
use crate::splat::recipe::NetworkRates;
use crate::splat::seen_gradient::SeenGradient;
use crate::splat::splats::{GROUP_INFO, PerGroup, SH_C0, Splats};
use crate::splat::state::TrainingState;
use crate::splat::stopwatch::Stopwatch;
use glam::{DMat3, DVec2, DVec3};
use std::sync::Arc;

/// The first device, or none with a line that says so.
#[allow(clippy::print_stdout)]
pub fn device() -> Option<GpuDevice> {
    match GpuDevice::open(Some(0)) {
        Ok(gpu) => Some(gpu),
        Err(e) if std::env::var_os("SATGS_REQUIRE_GPU").is_some() => panic!("{e}"),
        Err(e) => {
            println!("skipped: {e}");
            None
        }
    }
}

/// A camera that looks at the origin from 12 m away, under an angle.
pub fn camera(size: (usize, usize), angle: f64) -> PinholeCamera {
    let cam_from_site = DMat3::from_rotation_x(2.7) * DMat3::from_rotation_z(angle);
    let focal = 0.9 * size.0.max(size.1) as f64;
    PinholeCamera {
        cam_from_site,
        center: cam_from_site.transpose() * DVec3::new(0.3, -0.4, -12.0),
        focal: DVec2::new(focal, 0.97 * focal),
        principal: DVec2::new(0.5 * size.0 as f64 + 0.3, 0.5 * size.1 as f64 - 0.8),
        size,
    }
}

/// Random splats, opaque enough to hide each other, with harmonics of degree 3; some lie behind the camera or outside of its image.
pub fn scene(n: usize, opacity: f32) -> Splats {
    let mut out = Splats::zeros(n);
    out.f_rest.resize(n, [0.0; 45]);
    for i in 0..n {
        let mut draw = CounterRng::new(7, 0, 0, i as u64);
        let mut u = |low: f64, high: f64| (low + (high - low) * draw.uniform()) as f32;
        out.position[i] = [u(-5.0, 5.0), u(-5.0, 5.0), u(-3.0, 3.0)];
        if i % 50 == 7 {
            out.position[i] = out.position[i].map(|v| 8.0 * v);
        }
        out.log_scale[i] = [u(-2.5, 0.0), u(-2.5, 0.0), u(-2.5, 0.0)];
        out.rotation[i] = [u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0)];
        out.opacity_logit[i] = [opacity + u(-2.0, 2.0)];
        out.f_dc[i] = [u(-1.0, 1.5), u(-1.0, 1.5), u(-1.0, 1.5)];
        out.f_rest[i] = std::array::from_fn(|_| u(-0.15, 0.15));
    }
    out
}

/// A photograph of smooth colours with some pixels without data.
fn photograph(camera: PinholeCamera) -> PinholeView {
    let (width, height) = camera.size;
    let plane = |k: usize| {
        Grid2::from_fn(width, height, |col, row| match (col * 7 + row * 3) % 97 {
            0 => f32::NAN,
            _ => 0.5 + 0.4 * (0.21 * col as f32 + 0.13 * row as f32 + k as f32).sin(),
        })
    };
    PinholeView::new("photograph".into(), camera, &[plane(0), plane(1), plane(2)])
}

const BACKGROUND: [f32; 3] = [0.2, 0.7, 0.4];
const BY_OPACITY: f64 = 3e-6;
/// Coefficients of the harmonics that count.
const DEGREE: usize = 2;

/// Largest difference of pixels that are not opaque.
const PIXEL_TOLERANCE: f32 = 2e-5;
/// Largest difference of gradients in norm, without and with opaque pixels: such a pixel is complete on the device where its
/// transmittance falls below the least, on the processor where that of its whole block does.
const GRADIENT_TOLERANCE: [f64; 2] = [1e-4, 1e-3];
/// Sizes of images, numbers of splats and mean logits of their opacities.
const SCENES: [((usize, usize), usize, f32); 6] = [
    ((64, 64), 2000, -3.0),
    ((17, 33), 300, 0.0),
    ((1, 1), 100, 1.0),
    ((70, 40), 1500, 2.0),
    ((33, 16), 0, 0.0),
    ((2100, 20), 500, 0.0),
];

/// What a device computes of one view.
struct OnDevice {
    frame: Vec<[f32; 4]>,
    gradient: Splats,
    seen: Vec<bool>,
    report: [u32; REPORT],
    statistics: Vec<(f32, u32)>,
}

/// The plan of an iteration whose learning rates are zero.
pub fn plan(weights: LossWeights) -> StepPlan {
    StepPlan {
        iteration: 1,
        view: 0,
        level: 0,
        shadows: false,
        virtual_shear: None,
        background: BACKGROUND,
        random_background: BACKGROUND,
        weights,
        opacity_divisor: None,
        sh_degree: DEGREE,
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

/// Derivatives of all splats, which the view may show, and the report of an iteration whose learning rates are zero; `state` is the one
/// after it.
pub struct Step {
    pub gradient: Splats,
    pub seen: Vec<bool>,
    pub report: [u32; REPORT],
}

/// Runs an iteration with room for so many pairs.
pub fn step<V: DeviceViews>(
    gpu: &GpuDevice,
    views: &mut V,
    state: &mut TrainingState,
    plan: &StepPlan,
    pairs: u32,
) -> Step {
    let n = state.splats.len();
    let on_device = DeviceSplats::new(gpu, n, !state.splats.f_rest.is_empty()).unwrap();
    let mut arrays = views.arrays(gpu, on_device, pairs).unwrap();
    V::common(&arrays).splats.write(gpu, state);
    V::common(&arrays).order.write_count(gpu, n);
    views.write_state(gpu, &mut arrays, state).unwrap();
    let uniform = views.uniform(state, plan, 1);
    let report = gpu.staging(REPORT as u64);
    submit(gpu, views, (&arrays, &uniform), &report);
    let report = gpu.read_staging(&report, REPORT).unwrap().try_into().unwrap();
    let common = V::common(&arrays);
    let core = gpu.read_numbers(&common.order.gradient, n * CORE).unwrap();
    let mut gradient = Splats::zeros(n);
    unpack(&core, &mut gradient);
    gradient.f_dc.iter_mut().for_each(|by| *by = by.map(|v| SH_C0 as f32 * v));
    common.splats.read(gpu, state).unwrap();
    views.read_state(gpu, &arrays, state).unwrap();
    // The first moment is a tenth of the gradient.
    gradient.f_rest = state.adam.first.f_rest.iter().map(|m| m.map(|v| v / (1.0 - 0.9))).collect();
    let seen = core.as_chunks::<CORE>().0.iter().map(|words| words[7] > 0.0).collect();
    Step { gradient, seen, report }
}

/// An iteration on a photograph.
fn on_device(gpu: &GpuDevice, splats: &Splats, view: &PinholeView, pairs: u32) -> OnDevice {
    let mut state = TrainingState::start(splats.clone(), Default::default(), 0, 0);
    let mut views = DevicePhotographs::new(gpu, Arc::new(vec![view.clone()])).unwrap();
    let plan = plan(LossWeights::of(&[("opacity_sum", BY_OPACITY)]).unwrap());
    let Step { gradient, seen, report } = step(gpu, &mut views, &mut state, &plan, pairs);
    let (width, height) = view.camera.size;
    let frame = gpu.read_numbers(views.frame(), 4 * width * height).unwrap();
    let statistics = state.statistics.sums().collect();
    OnDevice { frame: frame.as_chunks().0.to_vec(), gradient, seen, report, statistics }
}

/// The same on the processor: the render, the derivatives of all splats, which the view may show, and the loss.
fn on_processor(splats: &Splats, view: &PinholeView) -> (Image<f32>, Splats, Vec<bool>, [f64; 2]) {
    let state = TrainingState::start(splats.clone(), Default::default(), 0, 0);
    let (mut target, mut valid) = (Image::default(), Vec::new());
    view.load(BACKGROUND, &mut target, &mut valid);
    let input = PinholeStep {
        camera: &view.camera,
        nearest: NEAREST,
        target: &target,
        valid: &valid,
        priors: None,
        anchored: &[],
        background: BACKGROUND,
        sh_degree: DEGREE,
        surface: SurfaceDepth::Mean,
    };
    let weights = LossWeights::of(&[("opacity_sum", BY_OPACITY)]).unwrap();
    let mut objective = EllipsoidObjective::<f32>::new(terms(TermInputs::default()));
    let mut gradient = SeenGradient::default();
    let mut watch = Stopwatch::default();
    let losses = objective.evaluate(&state.splats, &input, &weights, &mut gradient, &mut watch);
    let mut seen = vec![false; splats.len()];
    gradient.indices.iter().for_each(|i| seen[*i as usize] = true);
    let all = gradient.of_all(&state.splats);
    (objective.view().clone(), all, seen, [losses.columns[0], losses.columns[1]])
}

#[test]
fn the_sort_is_that_of_the_processor() {
    let Some(gpu) = device() else { return };
    let kernels = SortKernels::new(&gpu);
    for n in [0usize, 1, 255, 1024, 1025, 70_001] {
        let keys: Vec<u32> = (0..n as u32).map(|i| i.wrapping_mul(2_654_435_761) & 0x3F0F_F00F).collect();
        let sizes = gpu.sizes("sizes", SIZES).unwrap();
        gpu.write(&sizes, &sizes_of(n));
        let sort = Sort::new(&gpu, &kernels, &sizes, n as u64).unwrap();
        gpu.write(&sort.keys, &keys);
        gpu.write(&sort.values, &(0..n as u32).collect::<Vec<_>>());
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            sort.on(4, n as u64).for_each(|dispatch| dispatch.run(&mut pass));
        }
        gpu.queue.submit([encoder.finish()]);
        let mut expected: Vec<u32> = (0..n as u32).collect();
        expected.sort_by_key(|i| keys[*i as usize]);
        assert_eq!(gpu.read(sort.sorted(4).1, n).unwrap(), expected, "{n}");
    }
}

#[test]
fn renders_and_losses_are_those_of_the_processor() {
    let Some(gpu) = device() else { return };
    for (size, n, opacity) in SCENES {
        let (splats, view) = (scene(n, opacity), photograph(camera(size, 0.4)));
        let device = on_device(&gpu, &splats, &view, 100_000);
        let (image, _, seen, losses) = on_processor(&splats, &view);
        assert_eq!(device.seen, seen, "{size:?}");
        let (mut off, mut largest) = (0, 0.0f32);
        // An opaque pixel is complete here; the processor goes on until its whole block of pixels is.
        let beyond = MIN_TRANSMITTANCE as f32 * image.data.iter().fold(1.0, |m: f32, v| m.max(*v));
        for row in 0..size.1 {
            for col in 0..size.0 {
                let found = device.frame[row * size.0 + col];
                let expected = [0, 1, 2, 4].map(|c| image.at(c, col, row));
                let worst = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                let is_opaque = expected[3] < MIN_TRANSMITTANCE as f32;
                largest = largest.max(worst);
                off += usize::from(worst > PIXEL_TOLERANCE + if is_opaque { beyond } else { 0.0 });
            }
        }
        assert!(off * 1000 <= size.0 * size.1 && largest < 1.0 / 255.0, "{size:?}: {off} {largest:e}");
        let values = (3 * size.0 * size.1) as f64;
        let share = valid_share(&view);
        if share == 0.0 {
            continue;
        }
        let l1 = f64::from(f32::from_bits(device.report[4])) / values / share;
        let ssim = (f64::from(f32::from_bits(device.report[3])) / values - (1.0 - share)) / share;
        assert!((l1 - losses[0]).abs() < 1e-5 && (ssim - losses[1]).abs() < 1e-5, "{l1} {ssim} {losses:?}");
    }
}

/// Share of the pixels with data.
fn valid_share(view: &PinholeView) -> f64 {
    let (width, height) = view.camera.size;
    let has_data = |i: usize| view.pixel(i % width, i / width).is_some();
    (0..width * height).filter(|i| has_data(*i)).count() as f64 / (width * height) as f64
}

#[test]
fn gradients_are_those_of_the_processor() {
    let Some(gpu) = device() else { return };
    for (size, n, opacity) in SCENES {
        let (splats, view) = (scene(n, opacity), photograph(camera(size, 0.4)));
        let device = on_device(&gpu, &splats, &view, 100_000);
        let (_, expected, _, _) = on_processor(&splats, &view);
        let has_opaque = device.frame.iter().any(|pixel| pixel[3] < MIN_TRANSMITTANCE as f32);
        let tolerance = GRADIENT_TOLERANCE[usize::from(has_opaque)];
        for ((found, expected), info) in
            device.gradient.groups().into_iter().zip(expected.groups()).zip(GROUP_INFO)
        {
            let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
            let difference = norm(&mut found.iter().zip(expected).map(|(a, b)| f64::from(a - b)));
            let length = norm(&mut expected.iter().map(|v| f64::from(*v)));
            assert!(difference <= tolerance * length, "{size:?} {}: {difference:e} of {length:e}", info.name);
        }
        let seen = device.statistics.iter().filter(|(_, views)| *views == 1).count();
        assert!(seen >= n / 20 && device.statistics.iter().all(|(sum, views)| *views == 1 || *sum == 0.0));
    }
}

#[test]
fn one_splat_over_the_whole_image_and_splats_on_one_plane_are_as_on_the_processor() {
    let Some(gpu) = device() else { return };
    let view = photograph(camera((45, 70), 0.0));
    let mut large = scene(1, 1.0);
    large.position[0] = [0.0; 3];
    large.log_scale[0] = [2.0; 3];
    let mut plane = scene(600, 0.0);
    let forward = view.camera.cam_from_site.row(2);
    for position in &mut plane.position {
        let p = DVec3::from_array(position.map(f64::from));
        *position = (p - forward * forward.dot(p)).to_array().map(|v| v as f32);
    }
    for splats in [large, plane] {
        let device = on_device(&gpu, &splats, &view, 100_000);
        let (image, ..) = on_processor(&splats, &view);
        // The order of depths on one plane is that of rounding; the transmittance does not depend on it.
        let pixels = (0..70).flat_map(|row| (0..45).map(move |col| (col, row)));
        let worst = pixels.map(|(col, row)| (device.frame[row * 45 + col][3] - image.at(4, col, row)).abs());
        let worst = worst.fold(0.0, f32::max);
        assert!(worst < PIXEL_TOLERANCE + MIN_TRANSMITTANCE as f32, "{worst}");
    }
}

#[test]
fn values_that_are_not_finite_reach_no_other_splat() {
    let Some(gpu) = device() else { return };
    let (sound, view) = (scene(300, 0.0), photograph(camera((40, 30), 0.2)));
    let mut broken = sound.clone();
    broken.position[3] = [f32::NAN; 3];
    broken.log_scale[5] = [f32::INFINITY; 3];
    broken.rotation[8] = [f32::NAN; 4];
    broken.opacity_logit[13] = [f32::NAN];
    let device = on_device(&gpu, &broken, &view, 100_000);
    assert!(device.frame.iter().flatten().all(|v| v.is_finite()));
    let is_sound = |i: usize| ![3, 5, 8, 13].contains(&i);
    let gradient = &device.gradient;
    assert!((0..300).filter(|i| is_sound(*i)).all(|i| gradient.position[i].iter().all(|v| v.is_finite())));
}
