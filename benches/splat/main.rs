//! Times of an iteration's stages, fastest of several runs, as tables for `docs/performance.md`:
//! `cargo bench --bench splat [-- THREADS... RUN/splats.ply]`, one and two threads if none are given; trained splats
//! instead of the town where a file is given.

#![allow(clippy::print_stdout)]

mod scene;

use glam::{DQuat, DVec3};
use rayon::ThreadPoolBuilder;
use satgs::camera::AffineKernel;
use satgs::splat::adam::SplatAdam;
use satgs::splat::appearance::{Appearance, AppearanceKind};
use satgs::splat::backend::stopwatch::Stopwatch;
use satgs::splat::loss::photometric::Photometric;
use satgs::splat::loss::{LossWeights, terms};
use satgs::splat::objective::{Gradient, Objective, ShearedCamera, StepInput};
use satgs::splat::raster::{FrameCamera, Image, LOW_PASS_PX2, Rasterizer, SortedSplats, SplatGradient};
use satgs::splat::splats::{PerGroup, Splats};
use satgs::splat::state::TrainingState;
use std::time::Instant;

/// Least number of runs of which the fastest counts.
const RUNS: usize = 7;
/// They last at least so long, or a moment in which the machine had other work would count.
const RUNS_MS: f64 = 500.0;
const ALTITUDES: (f64, f64) = (-3.0, 30.0);
/// What plain AVX-512 kernels compute with one thread, forward and backward, G pairs/s.
const KERNEL_RATES: [f64; 2] = [3.6, 1.65];

/// A line of the table.
struct Line {
    splats: usize,
    pixels: f64,
    /// Pairs that count: alpha of at least 1/255.
    pairs: f64,
    /// Pairs that are computed: whole blocks, but for hidden ones.
    computed: f64,
    /// Milliseconds by column.
    prepare: f64,
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

/// Pixels with alpha of at least 1/255 over all splats, were none hidden: the areas of their ellipses.
fn contributing_pairs(splats: &Splats, camera: &FrameCamera<AffineKernel<f32>>) -> f64 {
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

fn measure(gaussians: Splats, pixels: f64) -> Line {
    // In the order in which training stores splats.
    let gaussians = TrainingState::start(gaussians, AppearanceKind::Affine, 1).splats;
    let splats = gaussians.len();
    let side = scene::side(pixels);
    let affine = scene::camera(pixels);
    let camera = FrameCamera::<AffineKernel<f32>>::new(&affine, side, side);
    let pairs = contributing_pairs(&gaussians, &camera);

    let mut prepared = SortedSplats::default();
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
    let project = fastest_ms(|| raster.project(&prepared, &camera));
    let bin = fastest_ms(|| raster.bin(&features));
    let forward = fastest_ms(|| raster.draw([0.0; 4]));
    let computed = raster.computed_pairs() as f64;
    let by_pixel = noise(side, side, 4);
    let mut shared = vec![SplatGradient::default(); splats];
    let mut by_feature = vec![[0.0; 4]; splats];
    let backward = fastest_ms(|| raster.pixels_backward(&by_pixel));
    let gather = fastest_ms(|| raster.gather(&prepared, &mut shared, &mut by_feature));

    let truth = noise(side, side, 3);
    let mut picture = truth.clone();
    picture.data.reverse();
    let mut photometric = Photometric::default();
    let ssim = fastest_ms(|| {
        photometric.compare(&picture, &truth);
    });

    let rates = PerGroup { position: 1e-9, f_dc: 1e-9, opacity_logit: 1e-9, log_scale: 1e-9, rotation: 1e-9 };
    let mut adam = SplatAdam::new(splats);
    let mut trained = gaussians.clone();
    let mut gradient = Gradient { splats: gaussians.clone(), ..Gradient::default() };
    let adam_time = fastest_ms(|| adam.step(&mut trained, &gradient.splats, &rates));

    let size = (side, side);
    let mut shot = StepInput {
        camera,
        target: &truth,
        valid: &[],
        sun: None,
        virtual_view: None,
        background: [0.3; 3],
        floor: ALTITUDES.0 as f32,
    };
    let named = [
        ("opacity", 0.01),
        ("consistency_altitude", 0.1),
        ("consistency_color", 0.1),
        ("shadow_entropy", 0.01),
    ];
    let weights = LossWeights::of(&named).expect("terms that there are");
    let mut objective = Objective::<f32>::new(AppearanceKind::Affine, terms(None));
    let appearance = Appearance::default().values;
    let mut iteration = |shot: &StepInput<f32>| {
        let mut run = |watch: &mut Stopwatch| {
            watch.begin();
            objective.evaluate(&trained, &appearance, shot, &weights, &mut gradient, watch);
            adam.step(&mut trained, &gradient.splats, &rates);
            watch.lap("splats", "Adam");
        };
        // The first makes room for what all others use again.
        run(&mut Stopwatch::default());
        let mut watch = Stopwatch::default();
        (fastest_ms(|| run(&mut watch)), watch.table())
    };
    let (one, _) = iteration(&shot);
    shot.sun = Some(ShearedCamera::sun(&affine, size, [1.7, -2.1], ALTITUDES));
    shot.virtual_view = Some(ShearedCamera::virtual_view(&affine, size, [0.4, 0.3]));
    let (three, stages) = iteration(&shot);
    let adam = adam_time;
    Line {
        splats,
        pixels,
        pairs,
        computed,
        prepare,
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
    /// So many pairs in G/s, forward and backward.
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
            self.prepare,
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
        "| splats | MP | M pairs | computed | prepare | project | bin | forward | G/s | backward | G/s | gather | SSIM \
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

/// How far the least rate of computed pairs lies below the greatest, over scenes of one size and of as many splats.
fn print_evenness(counts: &[usize], tables: &[Vec<Line>]) {
    println!("\nLeast rate of computed pairs, below the greatest:\n");
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
    let asked: Vec<usize> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    let trained = std::env::args()
        .find(|a| a.ends_with(".ply"))
        .map(|path| satgs::splat::ply::read(path.as_ref()).expect("splats are read"));
    let counts = if asked.is_empty() { vec![1, 2] } else { asked };
    let mut tables = Vec::new();
    for &threads in &counts {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
        tables.push(pool.install(|| table(threads, trained.as_ref())));
    }
    println!(
        "\nSpeed-up by threads; pairs computed beside what plain AVX-512 kernels compute; pairs that count, G/s:\n"
    );
    println!(
        "| splats | MP | threads | one render | three | forward | backward | counted forward | backward |\n|{}",
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
