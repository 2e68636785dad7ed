//! The whole loss against central differences: rasteriser, shadows, radiometry, consistency, entropy, opacity.

use super::*;
use crate::random::CounterRng;
use crate::splat::splats::GROUPS;

fn splats(n: usize, seed: u64) -> Splats<f64> {
    let mut d = CounterRng::new(seed, 0, 0, 0);
    let mut u = |lo: f64, hi: f64| lo + (hi - lo) * d.uniform();
    let mut g = Splats::default();
    for _ in 0..n {
        g.position.push([u(-6.0, 6.0), u(-5.0, 5.0), u(-1.0, 3.0)]);
        g.log_scale.push([u(-0.5, 0.7), u(-0.5, 0.7), u(-0.5, 0.7)]);
        g.rotation.push([u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0)]);
        g.opacity_logit.push([u(-1.0, 2.0)]);
        g.f_dc.push([u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0)]);
    }
    g
}

const WEIGHTS: LossWeights =
    LossWeights { opacity: 0.1, consistency_altitude: 0.7, consistency_color: 0.9, shadow_entropy: 0.5 };

struct SiteScene<T: Real> {
    truth: Image<T>,
    valid: Vec<bool>,
    objective: Objective<T>,
    has_sun: bool,
    has_virtual_view: bool,
}

impl<T: SimdReal> SiteScene<T> {
    fn new() -> Self {
        let mut setup = Self {
            truth: Image::default(),
            valid: Vec::new(),
            objective: Objective::default(),
            has_sun: true,
            has_virtual_view: true,
        };
        setup.resize(27, 25);
        for masked in [40, 41, 300] {
            setup.valid[masked] = false;
            for c in 0..3 {
                *setup.truth.at_mut(c, masked % 27, masked / 27) = T::zero();
            }
        }
        setup
    }

    /// Looks at an image of another size; all of its pixels count.
    fn resize(&mut self, width: usize, height: usize) {
        let mut draw = CounterRng::new(9, 0, 0, 0);
        self.truth = Image::zeros(width, height, 3);
        self.truth.data.iter_mut().for_each(|v| *v = T::from_f64(draw.uniform()));
        self.valid = vec![true; width * height];
    }

    fn evaluate(&mut self, g: &Splats<T>, a: &Appearance<T>) -> (Losses, Gradient<T>) {
        let size @ (width, height) = (self.truth.width, self.truth.height);
        let offset = [width as f64 / 2.0 - 0.2, height as f64 / 2.0 - 0.7];
        let camera = AffineCamera { linear: [[2.3, 0.2, 0.5], [0.3, -2.2, 0.7]], offset };
        let shot = StepInput {
            camera: FrameCamera::new(&camera, width, height),
            truth: &self.truth,
            valid: &self.valid,
            sun: self.has_sun.then(|| ShearedCamera::sun(&camera, size, [1.7, -1.1], (-5.0, 4.0))),
            virtual_view: self
                .has_virtual_view
                .then(|| ShearedCamera::virtual_view(&camera, size, [-0.4, 0.3])),
            background: [0.3, 0.8, 0.1].map(T::from_f64),
            floor: T::from_f64(-5.0),
        };
        let mut gradient = Gradient::default();
        let losses = self.objective.evaluate(g, a, &shot, &WEIGHTS, &mut gradient, &mut Stopwatch::default());
        (losses, gradient)
    }
}

fn appearance() -> Appearance<f64> {
    let mut draw = CounterRng::new(4, 0, 0, 0);
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
    let mut setup = SiteScene::new();
    let (g, a) = (splats(45, 1), appearance());
    let (losses, gradient) = setup.evaluate(&g, &a);
    let Losses { consistency_altitude, consistency_color, shadow_entropy, .. } = losses;
    assert!(consistency_altitude > 0.0 && consistency_color > 0.0 && shadow_entropy > 0.0);
    for group in 0..GROUPS {
        let analytic = gradient.splats.groups()[group].to_vec();
        let w = worst(&analytic, largest(&analytic), |k, e| {
            let mut moved = g.clone();
            moved.groups_mut()[group][k] += e;
            setup.evaluate(&moved, &a).0.total
        });
        assert!(w < 1e-6, "group {group}: {w:e}");
    }
    let w = worst(&gradient.appearance, largest(&gradient.appearance), |k, e| {
        let mut moved = a;
        moved.values[k] += e;
        setup.evaluate(&g, &moved).0.total
    });
    assert!(w < 1e-6, "appearance: {w:e}");
}

#[test]
fn f32_agrees_with_f64() {
    for seed in 0..5 {
        let (g, a) = (splats(60, seed), appearance());
        let (_, exact) = SiteScene::new().evaluate(&g, &a);
        let (_, fast) =
            SiteScene::new().evaluate(&g.narrow(), &Appearance { values: a.values.map(|v| v as f32) });
        assert_agree(&exact, &fast, &format!("seed {seed}"));
    }
}

fn assert_agree(exact: &Gradient<f64>, fast: &Gradient<f32>, case: &str) {
    let pairs = exact.splats.groups().into_iter().zip(fast.splats.groups());
    for (group, (x, y)) in pairs.chain([(&exact.appearance[..], &fast.appearance[..])]).enumerate() {
        let worst = x.iter().zip(y).map(|(x, y)| (x - f64::from(*y)).abs()).fold(0.0, f64::max);
        assert!(worst <= 1e-3 * largest(x), "{case} group {group}: {worst:e} of {:e}", largest(x));
    }
}

#[test]
fn images_of_any_size_agree_whatever_was_looked_at_before() {
    let (g, a) = (splats(60, 3), appearance());
    let (few, radiometry) = (g.narrow(), Appearance { values: a.values.map(|v| v as f32) });
    let mut used = SiteScene::<f32>::new();
    let mut case = 0;
    for width in [17, 1, 2, 7, 8, 9, 15, 16, 20] {
        for height in [20, 1, 3] {
            let mut fresh = SiteScene::<f64>::new();
            used.resize(width, height);
            fresh.resize(width, height);
            case += 1;
            (used.has_sun, used.has_virtual_view) = (case % 2 == 0, case % 3 == 0);
            (fresh.has_sun, fresh.has_virtual_view) = (used.has_sun, used.has_virtual_view);
            let (exact, fast) = (fresh.evaluate(&g, &a), used.evaluate(&few, &radiometry));
            let name = format!("{width} x {height}, {} {}", used.has_sun, used.has_virtual_view);
            assert!((exact.0.total - fast.0.total).abs() < 1e-4, "{name}");
            assert_agree(&exact.1, &fast.1, &name);
        }
    }
}

#[test]
fn a_box_darkens_what_lies_behind_it_from_the_sun() {
    // A floor of splats at 0 m, a block of them at 4 m; sun from the east at 45 degrees: 4 m of shadow to the west.
    let mut g = Splats::<f64>::default();
    for i in -24..=24 {
        for j in -24..=24 {
            let (x, y) = (f64::from(i) * 0.25, f64::from(j) * 0.25);
            g.push([x, y, if x.abs() < 0.6 && y.abs() < 0.6 { 4.0 } else { 0.0 }], 0.2, 0.97, [0.5; 3]);
        }
    }
    let camera = AffineCamera { linear: [[4.0, 0.0, 0.0], [0.0, -4.0, 0.0]], offset: [23.5, 23.5] };
    let size = (48, 48);
    let shear = camera.shear_towards(crate::frame::Vector::new(1.0, 0.0, 1.0));
    let truth = Image::zeros(48, 48, 3);
    let shot = StepInput {
        camera: FrameCamera::new(&camera, 48, 48),
        truth: &truth,
        valid: &[],
        sun: Some(ShearedCamera::sun(&camera, size, shear, (-1.0, 6.0))),
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
