//! Times of an iteration's stages as tables for `docs/performance.md`, each the fastest of several runs.
//!
//! `cargo bench --bench splat [-- THREADS... RUN/splats.ply]` measures with one and two threads if no numbers are given, and
//! with simulated splats ([`scene::town`]) if no file of trained splats is given. With the word `room` it measures an iteration
//! on a photograph instead ([`room`]).

#![allow(clippy::print_stdout)]

mod room;
mod scene;

use glam::{DQuat, DVec3};
use rayon::ThreadPoolBuilder;
use satgs::camera::QuadraticKernel;
use satgs::splat::adam::SplatAdam;
use satgs::splat::appearance::satgs::Cube;
use satgs::splat::appearance::{Appearance, AppearanceKind, ModelParameters};
use satgs::splat::loss::photometric::Photometric;
use satgs::splat::loss::{LossWeights, TermInputs, terms};
use satgs::splat::primitive::PrimitiveKind;
use satgs::splat::raster::{FrameCamera, Image, LOW_PASS_PX2, Rasterizer, SortedSplats, SplatGradient};
use satgs::splat::satellite::{Gradient, SatelliteObjective, SatelliteStep};
use satgs::splat::sheared_camera::{ShearedCamera, SunView};
use satgs::splat::splats::{PerGroup, Splats};
use satgs::splat::state::TrainingState;
use satgs::splat::stopwatch::Stopwatch;
use std::time::Instant;

/// Smallest number of runs, of which the fastest counts.
const RUNS: usize = 7;
/// Shortest total time of the runs, so that a moment in which the machine is busy otherwise does not count.
const RUNS_MS: f64 = 500.0;
/// Lowest and highest altitude of the scene, metres.
const ALTITUDES: (f64, f64) = (-3.0, 30.0);
/// Rates of simple AVX-512 kernels with one thread, forward and backward, 10⁹ splat-pixel pairs per second.
const KERNEL_RATES: [f64; 2] = [3.6, 1.65];

/// A line of the table.
struct Line {
    splats: usize,
    pixels: f64,
    /// Splat-pixel pairs with an alpha of at least 1/255.
    pairs: f64,
    /// Splat-pixel pairs that are computed: whole blocks up to early termination.
    computed: f64,
    /// Milliseconds of each column of the table.
    sort: f64,
    project: f64,
    bin: f64,
    forward: f64,
    backward: f64,
    gather: f64,
    ssim: f64,
    adam: f64,
    one: f64,
    three: f64,
    /// Stages of the iteration with three renders.
    stages: String,
}

/// Time of the fastest run, milliseconds.
fn fastest_ms(mut run: impl FnMut()) -> f64 {
    let mut once = || {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64() * 1e3
    };
    once();
    let (mut fastest, mut runs, mut total) = (f64::INFINITY, 0, 0.0);
    while runs < RUNS || total < RUNS_MS {
        let ms = once();
        (fastest, runs, total) = (fastest.min(ms), runs + 1, total + ms);
    }
    fastest
}

/// Number of splat-pixel pairs with an alpha of at least 1/255, without early termination: the sum of the ellipses' areas.
fn contributing_pairs(splats: &Splats, camera: &FrameCamera<QuadraticKernel<f32>>) -> f64 {
    let m = camera.kernel.linear.map(|l| l.map(f64::from));
    let area = |i: usize| {
        let [w, x, y, z] = splats.rotation[i].map(f64::from);
        let site_from_splat = DQuat::from_xyzw(x, y, z, w).normalize();
        let scale = DVec3::from_array(splats.log_scale[i].map(|s| f64::from(s).exp()));
        let [col, row] = m.map(|line| site_from_splat.inverse() * DVec3::from_array(line) * scale);
        let det = (col.length_squared() + LOW_PASS_PX2) * (row.length_squared() + LOW_PASS_PX2)
            - col.dot(row).powi(2);
        let opacity = 1.0 / (1.0 + (-f64::from(splats.opacity_logit[i][0])).exp());
        std::f64::consts::TAU * (255.0 * opacity).ln().max(0.0) * det.sqrt()
    };
    (0..splats.len()).map(area).sum()
}

fn noise(width: usize, height: usize, channels: usize) -> Image<f32> {
    let mut out = Image::zeros(width, height, channels);
    for (i, v) in out.data.iter_mut().enumerate() {
        *v = 0.5 + 0.5 * (i as f32 * 0.37).sin();
    }
    out
}

fn measure(splats: Splats, pixels: f64) -> Line {
    // Training stores the splats in this order.
    let splats = TrainingState::start(splats, AppearanceKind::Affine, 1, 0).splats;
    let count = splats.len();
    let side = scene::side(pixels);
    let affine = scene::camera(pixels);
    let camera = FrameCamera::<QuadraticKernel<f32>>::new(&affine, side, side);
    let pairs = contributing_pairs(&splats, &camera);

    let mut sorted = SortedSplats::default();
    let sort = fastest_ms(|| sorted.update(&splats));
    let features: Vec<[f32; 4]> = sorted
        .order()
        .iter()
        .map(|&i| {
            let [r, g, b] = splats.f_dc[i as usize];
            [r, g, b, splats.position[i as usize][2]]
        })
        .collect();
    let mut raster = Rasterizer::<f32, 4>::default();
    let project = fastest_ms(|| raster.project(&sorted, &camera));
    let bin = fastest_ms(|| raster.bin(&features));
    let forward = fastest_ms(|| raster.draw([0.0; 4]));
    let computed = raster.computed_pairs() as f64;
    let by_pixel = noise(side, side, 4);
    let mut gradients = vec![SplatGradient::default(); count];
    let mut by_feature = vec![[0.0; 4]; count];
    let backward = fastest_ms(|| raster.pixels_backward(&by_pixel));
    let gather = fastest_ms(|| raster.gather(&sorted, &mut gradients, &mut by_feature));

    let target = noise(side, side, 3);
    let mut picture = target.clone();
    picture.data.reverse();
    let mut photometric = Photometric::default();
    let ssim = fastest_ms(|| {
        photometric.compare(&picture, &target);
    });

    let rates = PerGroup {
        position: 1e-9,
        f_dc: 1e-9,
        opacity_logit: 1e-9,
        log_scale: 1e-9,
        rotation: 1e-9,
        f_rest: 0.0,
    };
    let mut adam = SplatAdam::new(&splats);
    let mut trained = splats.clone();
    let mut gradient = Gradient { splats: splats.clone(), ..Gradient::default() };
    let adam_time = fastest_ms(|| adam.step(&mut trained, &gradient.splats, &rates));

    let size = (side, side);
    let mut input = SatelliteStep {
        camera,
        target: &target,
        valid: &[],
        visibility: None,
        crop: None,
        sun: None,
        virtual_view: None,
        background: [0.3; 3],
        floor: ALTITUDES.0 as f32,
        anchored: &[],
    };
    let named = [
        ("opacity", 0.01),
        ("consistency_altitude", 0.1),
        ("consistency_color", 0.1),
        ("shadow_entropy", 0.01),
    ];
    let weights = LossWeights::of(&named).expect("the terms are registered");
    let mut objective = SatelliteObjective::<f32>::new(
        PrimitiveKind::Ellipsoid,
        AppearanceKind::Affine.model(Cube::default()),
        terms(TermInputs::default()),
    );
    let values = Appearance::default().values;
    let appearance = ModelParameters { shared: &[], view: &values };
    let mut iteration = |input: &SatelliteStep<f32>| {
        let mut run = |watch: &mut Stopwatch| {
            watch.begin();
            objective.evaluate(&trained, appearance, input, &weights, &mut gradient, watch);
            adam.step(&mut trained, &gradient.splats, &rates);
            watch.lap("splats", "Adam");
        };
        // The first run allocates the buffers.
        run(&mut Stopwatch::default());
        let mut watch = Stopwatch::default();
        (fastest_ms(|| run(&mut watch)), watch.table())
    };
    let (one, _) = iteration(&input);
    input.sun = Some(SunView::new(&affine, size, [1.7, -2.1], ALTITUDES));
    input.virtual_view = Some(ShearedCamera::virtual_view(&affine, size, [0.4, 0.3]));
    let (three, stages) = iteration(&input);
    let adam = adam_time;
    Line {
        splats: count,
        pixels,
        pairs,
        computed,
        sort,
        project,
        bin,
        forward,
        backward,
        gather,
        ssim,
        adam,
        one,
        three,
        stages,
    }
}

impl Line {
    /// Rates for this number of pairs, forward and backward, 10⁹ per second.
    fn rates(&self, pairs: f64) -> [f64; 2] {
        [self.forward, self.backward].map(|ms| pairs / ms * 1e-6)
    }

    fn head(&self) -> String {
        format!("| {:.0} k | {:.2} |", self.splats as f64 * 1e-3, self.pixels * 1e-6)
    }

    fn print(&self) {
        let [forward_rate, backward_rate] = self.rates(self.computed);
        println!(
            "{} {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {forward_rate:.2} | {:.1} | {backward_rate:.2} | {:.1} \
             | {:.1} | {:.1} | {:.0} | {:.0} |",
            self.head(),
            self.pairs * 1e-6,
            self.computed * 1e-6,
            self.sort,
            self.project,
            self.bin,
            self.forward,
            self.backward,
            self.gather,
            self.ssim,
            self.adam,
            self.one,
            self.three,
        );
    }
}

fn table(threads: usize, trained: Option<&Splats>) -> Vec<Line> {
    println!("\n{threads} thread(s), milliseconds:\n");
    println!(
        "| splats | MP | M pairs | computed | sort | project | bin | forward | G/s | backward | G/s | gather | SSIM \
         | Adam | one render | three |\n|{}",
        "---|".repeat(16)
    );
    let towns = [(50, 0.64), (100, 0.64), (250, 0.64), (1000, 0.64), (100, 0.25), (100, 2.5)];
    let print = |line: Line| {
        line.print();
        line
    };
    match trained {
        Some(splats) => vec![print(measure(splats.clone(), 0.64e6))],
        None => towns
            .map(|(thousands, megapixels)| {
                let pixels = megapixels * 1e6;
                print(measure(scene::town(thousands * 1000, pixels, 1), pixels))
            })
            .into(),
    }
}

/// Prints by how much the lowest rate of computed pairs is below the highest, over scenes of the same image size and over
/// scenes with the same number of splats.
fn print_evenness(counts: &[usize], tables: &[Vec<Line>]) {
    println!("\nLowest rate of computed pairs, relative to the highest:\n");
    println!("| threads | scenes | forward | backward |\n|---|---|---|---|");
    for (threads, table) in counts.iter().zip(tables) {
        let of_size = |l: &&Line| l.pixels == 0.64e6;
        let of_splats = |l: &&Line| l.splats == 100_000;
        for (name, is_alike) in [("0.64 MP", &of_size as &dyn Fn(&&Line) -> bool), ("100 k", &of_splats)] {
            let alike = || table.iter().filter(is_alike);
            let below = |k: usize| {
                let rates = || alike().map(|l| l.rates(l.computed)[k]);
                100.0 * (1.0 - rates().fold(f64::INFINITY, f64::min) / rates().fold(0.0, f64::max))
            };
            println!("| {threads} | {name} | {:.0} % | {:.0} % |", below(0), below(1));
        }
    }
}

fn main() {
    let threads_given: Vec<usize> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    let trained = std::env::args()
        .find(|a| a.ends_with(".ply"))
        .map(|path| satgs::splat::ply::read(path.as_ref()).expect("splats are read"));
    let counts = if threads_given.is_empty() { vec![1, 2] } else { threads_given };
    if std::env::args().any(|a| a == "room") {
        for &threads in &counts {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            pool.install(|| room::print(threads));
        }
        return;
    }
    let mut tables = Vec::new();
    for &threads in &counts {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
        tables.push(pool.install(|| table(threads, trained.as_ref())));
    }
    println!(
        "\nSpeed-up with threads; rate of computed pairs relative to simple AVX-512 kernels; rate of pairs above the alpha cut-off, G/s:\n"
    );
    println!(
        "| splats | MP | threads | one render | three | forward | backward | visible forward | backward |\n|{}",
        "---|".repeat(9)
    );
    for (threads, table) in counts.iter().zip(&tables) {
        for (line, base) in table.iter().zip(&tables[0]) {
            let ([forward, backward], counted) = (line.rates(line.computed), line.rates(line.pairs));
            let share = |rate: f64, k: usize| 100.0 * rate / (KERNEL_RATES[k] * *threads as f64);
            println!(
                "{} {threads} | {:.2} | {:.2} | {:.0} % | {:.0} % | {:.2} | {:.2} |",
                line.head(),
                base.one / line.one,
                base.three / line.three,
                share(forward, 0),
                share(backward, 1),
                counted[0],
                counted[1],
            );
        }
    }
    if trained.is_none() {
        print_evenness(&counts, &tables);
    }
    for (threads, table) in counts.iter().zip(&tables) {
        let line = table.get(1).unwrap_or(&table[0]);
        println!("\nThree renders, {} {threads} thread(s), on average:\n\n{}", line.head(), line.stages);
    }
}
