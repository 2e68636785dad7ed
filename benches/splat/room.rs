//! An iteration on a photograph of 640 x 480 pixels: a simulated room of 300,000 splats with spherical harmonics of degree 3,
//! of which the camera sees about a third; ellipsoids, and discs with all loss terms.

use super::{fastest_ms, noise};
use glam::{DMat3, DVec2, DVec3};
use satgs::perspective::PinholeCamera;
use satgs::random::CounterRng;
use satgs::splat::adam::SplatAdam;
use satgs::splat::loss::{LossWeights, SurfaceDepth, TermInputs, terms};
use satgs::splat::pinhole::{NEAREST, PinholeStep, objective};
use satgs::splat::seen_gradient::SeenGradient;
use satgs::splat::splats::{PerGroup, Splats};
use satgs::splat::stopwatch::Stopwatch;

const SPLATS: usize = 300_000;
const SIZE: (usize, usize) = (640, 480);
/// Half sides of the room, metres.
const ROOM_M: [f64; 3] = [3.0, 3.0, 1.5];
/// Medians of the scales along the axes, metres, and the standard deviation of their logarithms.
const AXES: [(f64, f64); 3] = [(0.012, 0.6), (0.025, 0.6), (0.003, 0.8)];

/// Splats on the walls, the floor and the ceiling of the room, and in its middle.
fn splats() -> Splats {
    let mut out = Splats::zeros(SPLATS);
    out.f_rest.resize(SPLATS, [0.0; 45]);
    for i in 0..SPLATS {
        let mut draw = CounterRng::new(1, 0, 0, i as u64);
        let mut p = ROOM_M.map(|half| half * (2.0 * draw.uniform() - 1.0));
        if draw.uniform() < 0.8 {
            let axis = draw.below(3);
            p[axis] = ROOM_M[axis] * p[axis].signum() + 0.02 * draw.normal();
        } else {
            p = p.map(|v| 0.5 * v);
        }
        out.position[i] = p.map(|v| v as f32);
        out.log_scale[i] = AXES.map(|(median, deviation)| (median.ln() + deviation * draw.normal()) as f32);
        out.rotation[i] = [0; 4].map(|_| draw.normal() as f32);
        out.opacity_logit[i][0] = (2.0 * draw.normal() - 1.0) as f32;
        out.f_dc[i] = [0; 3].map(|_| draw.normal() as f32);
        out.f_rest[i] = [0; 45].map(|_| 0.1 * draw.normal() as f32);
    }
    out
}

/// Prints the time of an iteration and of its parts, for ellipsoids and for discs.
pub fn print(threads: usize) {
    let ellipsoids = print_for(splats(), "ellipsoids", &[], threads);
    let mut discs = splats();
    discs.flatten();
    let weights = [("normal_consistency", 0.05), ("depth_distortion", 10.0)];
    let discs = print_for(discs, "discs", &weights, threads);
    println!("\ndiscs take {:.2} times as long as ellipsoids", discs / ellipsoids);
}

fn print_for(splats: Splats, name: &str, weights: &[(&str, f64)], threads: usize) -> f64 {
    let weights = LossWeights::of(weights).expect("weights of registered terms");
    let cam_from_site = DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X).transpose();
    let camera = PinholeCamera {
        cam_from_site,
        center: DVec3::new(-2.5, 0.3, 0.1),
        focal: DVec2::splat(585.0),
        principal: DVec2::new(319.5, 239.5),
        size: SIZE,
    };
    let target = noise(SIZE.0, SIZE.1, 3);
    let input = PinholeStep {
        anchored: &[],
        camera: &camera,
        nearest: NEAREST,
        target: &target,
        valid: &[],
        priors: None,
        background: [0.0; 3],
        sh_degree: 3,
        surface: SurfaceDepth::Mean,
    };
    let rates = PerGroup {
        position: 1e-9,
        f_dc: 1e-9,
        opacity_logit: 1e-9,
        log_scale: 1e-9,
        rotation: 1e-9,
        f_rest: 1e-9,
    };
    let mut objective = objective::<f32>(splats.primitive(), terms(TermInputs::default()));
    let (mut adam, mut trained, mut gradient) = (SplatAdam::new(&splats), splats, SeenGradient::default());
    let mut step = |watch: &mut Stopwatch| {
        watch.begin();
        objective.evaluate(&trained, &input, &weights, &mut gradient, watch);
        watch.lap("splats", "end");
        adam.step_seen(&mut trained, &gradient, &rates);
        watch.lap("splats", "Adam");
    };
    // The first run allocates the buffers.
    step(&mut Stopwatch::default());
    let mut watch = Stopwatch::default();
    let ms = fastest_ms(|| step(&mut watch));
    println!(
        "\nPhotograph of {} x {} pixels, {} k {name} of degree 3, {threads} thread(s): {ms:.1} ms; on average:\n\n{}",
        SIZE.0,
        SIZE.1,
        SPLATS / 1000,
        watch.table()
    );
    ms
}
