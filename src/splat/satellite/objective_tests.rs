//! The gradient of the whole loss (rasteriser, shadows, colour model and all terms) is compared with central differences.

use super::PrimitiveKind;
use super::*;
use crate::affine::ViewCamera;
use crate::frame::{Point, SiteGrid};
use crate::io::{Grid2, MapGrid};
use crate::mvs::MatchedSurface;
use crate::nn::hash_grid::HashGrid;
use crate::nn::mlp::Mlp;
use crate::random::CounterRng;
use crate::splat::appearance::satgs::{Cube, Networks, SatGs};
use crate::splat::appearance::{Appearance, AppearanceKind};
use crate::splat::differences::{TOLERANCE, disagreement};
use crate::splat::loss::Prior;
use crate::splat::loss::{TermInputs, column_names, terms};
use crate::splat::splats::GROUPS;
use std::sync::Arc;

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

fn weights() -> LossWeights {
    let named = [
        ("opacity", 0.1),
        ("consistency_altitude", 0.7),
        ("consistency_color", 0.9),
        ("shadow_entropy", 0.5),
        ("surface_prior", 0.8),
    ];
    LossWeights::of(&named).unwrap()
}

/// A surface 1 m above the site's origin, with a weight in its western half only.
fn prior() -> Arc<Prior> {
    let site = SiteGrid { epsg: 32617, origin: Point::new(1000.0, 2000.0, 10.0) };
    let grid = MapGrid { epsg: 32617, west: 990.0, north: 2010.0, cell: 10.0, width: 2, height: 2 };
    let altitude = Grid2::filled(2, 2, 1.0);
    let prior_weight = Grid2 { width: 2, height: 2, data: vec![1.0, 0.0, 0.7, 0.0] };
    let score = altitude.clone();
    Arc::new(Prior::new(&MatchedSurface { site, grid, altitude, score, prior_weight }))
}

struct Scene<T: Real> {
    target: Image<T>,
    valid: Vec<bool>,
    objective: SatelliteObjective<T>,
    has_sun: bool,
    has_virtual_view: bool,
    quadratic: [[f64; 6]; 2],
    /// Parameters of the colour model that all views share.
    shared: Vec<T>,
    weights: LossWeights,
    visibility: Option<Image<T>>,
}

/// The objective with EOGS's colour model.
fn affine<T: SimdReal>(primitive: PrimitiveKind, prior: Option<&Arc<Prior>>) -> SatelliteObjective<T> {
    SatelliteObjective::new(
        primitive,
        AppearanceKind::Affine.model(Cube::default()),
        terms(TermInputs { prior: prior.cloned(), lpips: None }),
    )
}

impl<T: SimdReal> Scene<T> {
    fn new() -> Self {
        let mut scene = Self {
            target: Image::default(),
            valid: Vec::new(),
            objective: affine(PrimitiveKind::Ellipsoid, Some(&prior())),
            has_sun: true,
            has_virtual_view: true,
            quadratic: Default::default(),
            shared: Vec::new(),
            weights: weights(),
            visibility: None,
        };
        scene.resize(27, 25);
        for masked in [40, 41, 300] {
            scene.valid[masked] = false;
            for c in 0..3 {
                *scene.target.at_mut(c, masked % 27, masked / 27) = T::zero();
            }
        }
        scene
    }

    /// Replaces the target by an image of another size, whose pixels are all valid.
    fn resize(&mut self, width: usize, height: usize) {
        let mut draw = CounterRng::new(9, 0, 0, 0);
        self.target = Image::zeros(width, height, 3);
        self.target.data.iter_mut().for_each(|v| *v = T::from_f64(draw.uniform()));
        self.valid = vec![true; width * height];
    }

    fn evaluate(&mut self, g: &Splats<T>, a: &Appearance<T>) -> (Losses, Gradient<T>) {
        let size @ (width, height) = (self.target.width, self.target.height);
        let offset = [width as f64 / 2.0 - 0.2, height as f64 / 2.0 - 0.7];
        let linear = [[2.3, 0.2, 0.5], [0.3, -2.2, 0.7]];
        let camera = ViewCamera { linear, offset, quadratic: self.quadratic };
        let input = SatelliteStep {
            camera: FrameCamera::new(&camera, width, height),
            target: &self.target,
            valid: &self.valid,
            sun: self.has_sun.then(|| SunView::new(&camera, size, [1.7, -1.1], (-5.0, 4.0))),
            virtual_view: self
                .has_virtual_view
                .then(|| ShearedCamera::virtual_view(&camera, size, [-0.4, 0.3])),
            crop: Some([0.3, 0.8]),
            visibility: self.visibility.as_ref(),
            background: [0.3, 0.8, 0.1].map(T::from_f64),
            floor: T::from_f64(-5.0),
            anchored: &[],
        };
        let mut gradient = Gradient::default();
        let losses = self.objective.evaluate(
            g,
            ModelParameters { shared: &self.shared, view: &a.values },
            &input,
            &self.weights,
            &mut gradient,
            &mut Stopwatch::default(),
        );
        (losses, gradient)
    }
}

fn to_f32(a: &Appearance<f64>) -> Appearance {
    Appearance { kind: a.kind, values: a.values.iter().map(|v| *v as f32).collect() }
}

fn appearance() -> Appearance<f64> {
    let mut draw = CounterRng::new(4, 0, 0, 0);
    let mut a = Appearance::start(AppearanceKind::Affine, 0, 0);
    a.values.iter_mut().for_each(|v| *v += 0.2 * draw.uniform());
    a
}

/// Largest difference between a derivative and its difference quotient, relative to `largest`. Parameters at kinks are left out,
/// and may be one in ten at most.
fn worst<F: FnMut(usize, f64) -> f64>(analytic: &[f64], largest: f64, mut at: F) -> f64 {
    let mut worst: f64 = 0.0;
    let mut left_out = 0;
    for (k, exact) in analytic.iter().enumerate() {
        match disagreement(*exact, largest, TOLERANCE, |e| at(k, e)) {
            Some(off) => worst = worst.max(off),
            None => left_out += 1,
        }
    }
    assert!(left_out * 10 <= analytic.len(), "{left_out} of {} at kinks", analytic.len());
    worst
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.abs()))
}

#[test]
fn every_gradient_agrees_with_central_differences_in_f64() {
    let curved = [[0.02, -0.01, 0.015, 0.01, 0.02, -0.03], [-0.01, 0.02, 0.01, -0.02, 0.015, 0.01]];
    for quadratic in [Default::default(), curved] {
        check_gradients(Scene { quadratic, ..Scene::new() }, &splats(45, 1));
    }
}

#[test]
fn every_gradient_of_discs_agrees_with_central_differences_in_f64() {
    let objective = affine(PrimitiveKind::Disc, Some(&prior()));
    let mut discs = splats(45, 1);
    discs.flatten();
    check_gradients(Scene { objective, ..Scene::new() }, &discs);
}

/// Networks of the shape of SatGS's that are small enough to check.
fn small_networks() -> Networks {
    let grid = HashGrid { levels: 2, log2_entries: 6, cells: [3, 9] };
    let mut networks = Networks { grid, ..Networks::default() };
    networks.tone.inputs = networks.grid.outputs() / 2 + 3;
    networks.shadow.inputs = networks.grid.outputs() + 1;
    networks.tone.hidden = vec![6, 5];
    networks.shadow.hidden = vec![5];
    networks.sky.hidden = vec![4];
    networks
}

/// A scene with SatGS's colour model, whose parameters are random.
fn satgs_scene(named: &[(&str, f64)]) -> (Scene<f64>, Appearance<f64>) {
    let networks = small_networks();
    let mut draw = CounterRng::new(11, 0, 0, 0);
    let mut normal = |n: usize| -> Vec<f64> { (0..n).map(|_| 0.4 * draw.normal()).collect() };
    let (shared, values) = (normal(networks.parameters()), normal(networks.embedding));
    let model = SatGs::new(networks, Cube { corner: [-7.0, -6.0, -2.0], side_m: 14.0 });
    let objective =
        SatelliteObjective::new(PrimitiveKind::Ellipsoid, Box::new(model), terms(TermInputs::default()));
    let weights = LossWeights::of(named).unwrap();
    let scene = Scene { objective, shared, weights, has_virtual_view: false, ..Scene::new() };
    (scene, Appearance { kind: AppearanceKind::SatGs, values })
}

#[test]
fn gradients_by_satgs_s_networks_and_embedding_agree_with_central_differences_in_f64() {
    let named = [("sun_visibility", 0.7), ("dark_tones", 0.9), ("bright_shadows", 0.5)];
    let (mut scene, a) = satgs_scene(&named);
    let g = splats(45, 1);
    let (losses, gradient) = scene.evaluate(&g, &a);
    for name in ["sun_visibility", "dark_tones", "bright_shadows"] {
        let column = column_names().position(|n| n == name).unwrap();
        assert!(losses.columns[column] > 0.0, "{name}");
    }
    let shared = scene.shared.clone();
    for range in small_networks().ranges() {
        let by = &gradient.shared[range.clone()];
        assert!(largest(by) > 0.0, "{range:?}");
        let w = worst(by, largest(by), |k, e| {
            scene.shared.clone_from(&shared);
            scene.shared[range.start + k] += e;
            scene.evaluate(&g, &a).0.total
        });
        assert!(w < TOLERANCE, "{range:?}: {w:e}");
    }
    scene.shared = shared;
    let w = worst(&gradient.appearance, largest(&gradient.appearance), |k, e| {
        let mut moved = a.clone();
        moved.values[k] += e;
        scene.evaluate(&g, &moved).0.total
    });
    assert!(w < TOLERANCE, "embedding: {w:e}");
}

/// The inputs of the networks count as constants, so that the weights of those that follow from the splats are zero, and the term
/// of the visibility of the sun is left out.
#[test]
fn gradients_by_splats_agree_with_central_differences_in_f64_with_satgs_s_colours() {
    let (mut scene, a) = satgs_scene(&[("dark_tones", 0.9)]);
    let networks = small_networks();
    let [tables, tone, shadow, _] = networks.ranges();
    scene.shared[tables].fill(0.0);
    let rows = |mlp: &Mlp| (mlp.inputs + mlp.shared, mlp.hidden[0]);
    let (stride, count) = rows(&networks.tone);
    scene.shared[tone].chunks_mut(stride).take(count).for_each(|row| row[..3].fill(0.0));
    let (stride, count) = rows(&networks.shadow);
    scene.shared[shadow].chunks_mut(stride).take(count).for_each(|row| row[networks.grid.outputs()] = 0.0);
    let g = splats(45, 1);
    let (_, gradient) = scene.evaluate(&g, &a);
    for group in 0..GROUPS {
        let analytic = gradient.splats.groups()[group].to_vec();
        let w = worst(&analytic, largest(&analytic), |k, e| {
            let mut moved = g.clone();
            moved.groups_mut()[group][k] += e;
            scene.evaluate(&moved, &a).0.total
        });
        assert!(w < TOLERANCE, "group {group}: {w:e}");
    }
}

#[test]
fn every_gradient_agrees_with_central_differences_in_f64_where_some_pixels_are_less_visible() {
    let mut visibility = Image::zeros(27, 25, 1);
    let mut draw = CounterRng::new(21, 0, 0, 0);
    visibility.data.iter_mut().for_each(|v| *v = draw.uniform());
    check_gradients(Scene { visibility: Some(visibility), ..Scene::new() }, &splats(45, 1));
}

fn check_gradients(mut scene: Scene<f64>, g: &Splats<f64>) {
    let a = appearance();
    let (losses, gradient) = scene.evaluate(g, &a);
    // The first five are of perspective views of discs, the others of colour models that separate light and colours.
    let absent = [
        "normal_consistency",
        "depth_distortion",
        "depth_prior",
        "depth_smoothness",
        "normal_prior",
        "sun_visibility",
        "dark_tones",
        "bright_shadows",
        "perceptual",
        "color_statistics",
    ];
    for (name, value) in column_names().zip(losses.columns) {
        assert_eq!(value > 0.0, !absent.contains(&name), "{name}");
    }
    for group in 0..GROUPS {
        let analytic = gradient.splats.groups()[group].to_vec();
        let w = worst(&analytic, largest(&analytic), |k, e| {
            let mut moved = g.clone();
            moved.groups_mut()[group][k] += e;
            scene.evaluate(&moved, &a).0.total
        });
        assert!(w < TOLERANCE, "group {group}: {w:e}");
    }
    let w = worst(&gradient.appearance, largest(&gradient.appearance), |k, e| {
        let mut moved = a.clone();
        moved.values[k] += e;
        scene.evaluate(g, &moved).0.total
    });
    assert!(w < TOLERANCE, "appearance: {w:e}");
}

#[test]
fn f32_agrees_with_f64() {
    for seed in 0..5 {
        let (g, a) = (splats(60, seed), appearance());
        let (_, exact) = Scene::new().evaluate(&g, &a);
        let (_, fast) = Scene::new().evaluate(&g.narrow(), &to_f32(&a));
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
fn f32_agrees_with_f64_for_images_of_any_size_with_reused_buffers() {
    let (g, a) = (splats(60, 3), appearance());
    let (narrow_splats, narrow_appearance) = (g.narrow(), to_f32(&a));
    let mut used = Scene::<f32>::new();
    let mut case = 0;
    for width in [17, 1, 2, 7, 8, 9, 15, 16, 20] {
        for height in [20, 1, 3] {
            let mut fresh = Scene::<f64>::new();
            used.resize(width, height);
            fresh.resize(width, height);
            case += 1;
            (used.has_sun, used.has_virtual_view) = (case % 2 == 0, case % 3 == 0);
            (fresh.has_sun, fresh.has_virtual_view) = (used.has_sun, used.has_virtual_view);
            let (exact, fast) = (fresh.evaluate(&g, &a), used.evaluate(&narrow_splats, &narrow_appearance));
            let name = format!("{width} x {height}, {} {}", used.has_sun, used.has_virtual_view);
            assert!((exact.0.total - fast.0.total).abs() < 1e-4, "{name}");
            assert_agree(&exact.1, &fast.1, &name);
        }
    }
}

#[test]
fn a_block_casts_a_shadow_of_the_right_length() {
    // A floor of splats at 0 m, a block of them at 4 m; sun from the east at 45 degrees: 4 m of shadow to the west.
    let mut g = Splats::<f64>::default();
    for i in -24..=24 {
        for j in -24..=24 {
            let (x, y) = (f64::from(i) * 0.25, f64::from(j) * 0.25);
            g.push([x, y, if x.abs() < 0.6 && y.abs() < 0.6 { 4.0 } else { 0.0 }], 0.2, 0.97, [0.5; 3]);
        }
    }
    let camera = ViewCamera::affine([[4.0, 0.0, 0.0], [0.0, -4.0, 0.0]], [23.5, 23.5]);
    let size = (48, 48);
    let shear = camera.shear_towards(crate::frame::Vector::new(1.0, 0.0, 1.0));
    let target = Image::zeros(48, 48, 3);
    let input = SatelliteStep {
        camera: FrameCamera::new(&camera, 48, 48),
        target: &target,
        valid: &[],
        sun: Some(SunView::new(&camera, size, shear, (-1.0, 6.0))),
        visibility: None,
        crop: None,
        virtual_view: None,
        background: [0.0; 3],
        floor: -1.0,
        anchored: &[],
    };
    let mut objective = affine(PrimitiveKind::Ellipsoid, None);
    let values = Appearance::start(AppearanceKind::Affine, 0, 0).values;
    let values = ModelParameters { shared: &[], view: &values };
    objective.evaluate(&g, values, &input, &weights(), &mut Gradient::default(), &mut Stopwatch::default());
    let red = |x: f64| objective.picture().at(0, (23.5 + 4.0 * x).round() as usize, 23);
    assert!(red(-4.0) < 0.2, "in the shadow: {}", red(-4.0));
    assert!(red(-5.5) > 0.4, "beyond it: {}", red(-5.5));
    assert!(red(3.0) > 0.4, "on the sunny side: {}", red(3.0));
}
