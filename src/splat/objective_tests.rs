//! The whole loss against central differences: rasteriser, shadows, radiometry, consistency, entropy, opacity.

use super::*;
use crate::splat::random::Draw;

fn splats(n: usize, seed: u64) -> Gaussians<f64> {
    let mut d = Draw::new(seed, 0, 0, 0);
    let mut u = |lo: f64, hi: f64| lo + (hi - lo) * d.uniform();
    let mut g = Gaussians::default();
    for _ in 0..n {
        g.position.push([u(-6.0, 6.0), u(-5.0, 5.0), u(-1.0, 3.0)]);
        g.log_scale.push([u(-0.5, 0.7), u(-0.5, 0.7), u(-0.5, 0.7)]);
        g.rotation.push([u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0)]);
        g.logit.push(u(-1.0, 2.0));
        g.f_dc.push([u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0)]);
    }
    g
}

const WEIGHTS: LossWeights =
    LossWeights { opacity: 0.1, consistency_altitude: 0.7, consistency_color: 0.9, shadow_entropy: 0.5 };

struct Setup<T: Real> {
    truth: Layers<T>,
    valid: Vec<bool>,
    objective: Objective<T>,
}

impl<T: Lanewise> Setup<T> {
    fn new() -> Self {
        let mut draw = Draw::new(9, 0, 0, 0);
        let mut truth = Layers::zeros(27, 25, 3);
        truth.data.iter_mut().for_each(|v| *v = T::of(draw.uniform()));
        let mut valid = vec![true; 27 * 25];
        for masked in [40, 41, 300] {
            valid[masked] = false;
            for c in 0..3 {
                *truth.at_mut(c, masked % 27, masked / 27) = T::zero();
            }
        }
        Self { truth, valid, objective: Objective::default() }
    }

    fn evaluate(&mut self, g: &Gaussians<T>, a: &Appearance<T>) -> (f64, Gradient<T>) {
        let camera = AffineCamera { linear: [[2.3, 0.2, 0.5], [0.3, -2.2, 0.7]], offset: [13.3, 11.8] };
        let size = (27, 25);
        let shot = Shot {
            camera: FrameCamera::new(&camera, 27, 25),
            truth: &self.truth,
            valid: &self.valid,
            sun: Some(Sheared::sun(&camera, size, [1.7, -1.1], (-5.0, 4.0))),
            virtual_view: Some(Sheared::virtual_view(&camera, size, [-0.4, 0.3])),
            background: [0.3, 0.8, 0.1].map(T::of),
            floor: T::of(-5.0),
        };
        let mut gradient = Gradient::default();
        let losses = self.objective.evaluate(g, a, &shot, &WEIGHTS, &mut gradient, &mut Stopwatch::default());
        (losses.total, gradient)
    }
}

fn appearance() -> Appearance<f64> {
    let mut draw = Draw::new(4, 0, 0, 0);
    let mut a = Appearance::default();
    a.values.iter_mut().for_each(|v| *v += 0.2 * draw.uniform());
    a
}

/// Largest disagreement of a derivative with its difference quotient, relative to `largest`; quotients of two
/// steps that differ stand at a kink or cut-off and are left out, but at most one in ten.
fn worst<F: FnMut(usize, f64) -> f64>(analytic: &[f64], largest: f64, mut at: F) -> f64 {
    let mut worst: f64 = 0.0;
    let mut left_out = 0;
    for (k, exact) in analytic.iter().enumerate() {
        let mut quotient = |e: f64| (at(k, e) - at(k, -e)) / (2.0 * e);
        let (q, q2) = (quotient(1e-6), quotient(2e-6));
        if (q - q2).abs() > 1e-6 * largest {
            left_out += 1;
            continue;
        }
        worst = worst.max((q - exact).abs() / largest);
    }
    assert!(left_out * 10 <= analytic.len(), "{left_out} of {} at kinks", analytic.len());
    worst
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.abs()))
}

#[test]
fn every_gradient_agrees_with_central_differences_in_f64() {
    let mut setup = Setup::new();
    let (g, a) = (splats(45, 1), appearance());
    let (_, gradient) = setup.evaluate(&g, &a);
    for group in 0..5 {
        let analytic = gradient.splats.groups()[group].to_vec();
        let w = worst(&analytic, largest(&analytic), |k, e| {
            let mut moved = g.clone();
            moved.groups_mut()[group][k] += e;
            setup.evaluate(&moved, &a).0
        });
        assert!(w < 1e-6, "group {group}: {w:e}");
    }
    let w = worst(&gradient.appearance, largest(&gradient.appearance), |k, e| {
        let mut moved = a;
        moved.values[k] += e;
        setup.evaluate(&g, &moved).0
    });
    assert!(w < 1e-6, "appearance: {w:e}");
}

#[test]
fn f32_agrees_with_f64() {
    for seed in 0..5 {
        let (g, a) = (splats(60, seed), appearance());
        let (_, exact) = Setup::new().evaluate(&g, &a);
        let narrow = Gaussians {
            position: g.position.iter().map(|v| v.map(|x| x as f32)).collect(),
            log_scale: g.log_scale.iter().map(|v| v.map(|x| x as f32)).collect(),
            rotation: g.rotation.iter().map(|v| v.map(|x| x as f32)).collect(),
            logit: g.logit.iter().map(|x| *x as f32).collect(),
            f_dc: g.f_dc.iter().map(|v| v.map(|x| x as f32)).collect(),
        };
        let (_, fast) = Setup::new().evaluate(&narrow, &Appearance { values: a.values.map(|v| v as f32) });
        for (k, (x, y)) in exact.splats.groups().iter().zip(fast.splats.groups()).enumerate() {
            let worst = x.iter().zip(y).map(|(x, y)| (x - f64::from(*y)).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-3 * largest(x), "seed {seed} group {k}: {worst:e} of {:e}", largest(x));
        }
        let pairs = exact.appearance.iter().zip(fast.appearance);
        let worst = pairs.map(|(x, y)| (x - f64::from(y)).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-3 * largest(&exact.appearance), "appearance {worst:e}");
    }
}

#[test]
fn a_box_darkens_what_lies_behind_it_from_the_sun() {
    // A floor of splats at 0 m, a block of them at 4 m; sun from the east at 45 degrees: 4 m of shadow to the west.
    let mut g = Gaussians::<f64>::default();
    for i in -24..=24 {
        for j in -24..=24 {
            let (x, y) = (f64::from(i) * 0.25, f64::from(j) * 0.25);
            g.push([x, y, if x.abs() < 0.6 && y.abs() < 0.6 { 4.0 } else { 0.0 }], 0.2, 0.97, [0.5; 3]);
        }
    }
    let camera = AffineCamera { linear: [[4.0, 0.0, 0.0], [0.0, -4.0, 0.0]], offset: [23.5, 23.5] };
    let size = (48, 48);
    let shear = camera.shear_towards(crate::frame::Vector::new(1.0, 0.0, 1.0));
    let truth = Layers::zeros(48, 48, 3);
    let shot = Shot {
        camera: FrameCamera::new(&camera, 48, 48),
        truth: &truth,
        valid: &[],
        sun: Some(Sheared::sun(&camera, size, shear, (-1.0, 6.0))),
        virtual_view: None,
        background: [0.0; 3],
        floor: -1.0,
    };
    let mut objective = Objective::default();
    let appearance = Appearance::default();
    objective.evaluate(&g, &appearance, &shot, &WEIGHTS, &mut Gradient::default(), &mut Stopwatch::default());
    let brightness = |x: f64| objective.picture().at(0, (23.5 + 4.0 * x).round() as usize, 23);
    assert!(brightness(-4.0) < 0.2, "in the shadow: {}", brightness(-4.0));
    assert!(brightness(-5.5) > 0.4, "beyond it: {}", brightness(-5.5));
    assert!(brightness(3.0) > 0.4, "on the sunny side: {}", brightness(3.0));
}
