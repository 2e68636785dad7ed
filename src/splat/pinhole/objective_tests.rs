//! Tests of the loss of an iteration on a photograph.

use super::super::working_frame::NEAREST;
use super::*;
use crate::io::Grid2;
use crate::prior::{DepthKind, DepthPrior, NormalPrior, ViewPriors};
use crate::random::CounterRng;
use crate::splat::differences::disagreement;
use crate::splat::loss::{TermInputs, terms};
use crate::splat::splats::{GROUP_INFO, GROUPS};
use glam::{DMat3, DVec2, DVec3};

/// Largest difference between derivatives and difference quotients, relative to the largest derivative of a group.
const TOLERANCE: f64 = 2e-6;

fn camera() -> PinholeCamera {
    let cam_from_site = DMat3::from_rotation_x(2.7) * DMat3::from_rotation_z(0.4);
    let center = cam_from_site.transpose() * DVec3::new(0.3, -0.4, -20.0);
    PinholeCamera {
        cam_from_site,
        center,
        focal: DVec2::new(55.0, 52.0),
        principal: DVec2::new(18.3, 16.8),
        size: (37, 35),
    }
}

fn scene(n: usize) -> Splats<f64> {
    let mut out = Splats::<f64>::zeros(n);
    out.f_rest.resize(n, [0.0; 45]);
    let spread = [5.0, 0.8, 0.2, 0.8, 0.4, 0.6];
    for (g, (group, spread)) in out.groups_mut().into_iter().zip(spread).enumerate() {
        for (i, v) in group.iter_mut().enumerate() {
            *v = spread * (2.0 * CounterRng::new(11, g as u64, 0, i as u64).uniform() - 1.0);
        }
    }
    out
}

fn target() -> (Image<f64>, Vec<bool>) {
    let (width, height) = camera().size;
    let mut image = Image::zeros(width, height, 3);
    let valid: Vec<bool> = (0..width * height).map(|i| i % 7 != 3).collect();
    for row in 0..height {
        for col in 0..width {
            for c in 0..3 {
                let value = 0.5 + 0.4 * ((col * (c + 1)) as f64 * 0.31).sin() * (row as f64 * 0.23).cos();
                *image.at_mut(c, col, row) = if valid[row * width + col] { value } else { 0.0 };
            }
        }
    }
    (image, valid)
}

/// Compares the derivatives of the whole loss with central differences.
fn compare_with_differences(
    mut objective: Box<dyn AnyPinholeObjective<f64>>,
    splats: &Splats<f64>,
    weights: &LossWeights,
    priors: Option<&PriorTargets>,
) {
    let (camera, (target, valid)) = (camera(), target());
    let (background, sh_degree, surface) = ([0.1, 0.2, 0.3], 3, SurfaceDepth::Mean);
    let (target, valid) = (&target, &valid[..]);
    let input = PinholeStep {
        camera: &camera,
        nearest: NEAREST,
        target,
        valid,
        priors,
        anchored: &[],
        background,
        sh_degree,
        surface,
    };
    let (mut gradient, mut watch) = (SeenGradient::default(), Stopwatch::default());
    let losses = objective.evaluate(splats, &input, weights, &mut gradient, &mut watch);
    let seen = (0..gradient.indices.len()).filter(|i| objective.mean2d_gradient(*i).is_some()).count();
    let gradient = gradient.of_all(splats);
    assert!(losses.total > 0.1 && seen > 30);
    let mut unused = SeenGradient::default();
    let mut loss = |s: &Splats<f64>| {
        objective.evaluate(s, &input, weights, &mut unused, &mut Stopwatch::default()).total
    };
    for group in 0..GROUPS {
        let (name, values) = (GROUP_INFO[group].name, gradient.groups()[group]);
        let largest = values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        assert!(largest > 0.0, "{name}");
        let (mut asked, mut compared) = (0, 0);
        for k in (0..values.len()).step_by(if name == "f_rest" { 13 } else { 1 }) {
            let value = |e: f64| {
                let mut moved = splats.clone();
                moved.groups_mut()[group][k] += e;
                loss(&moved)
            };
            asked += 1;
            // The loss jumps where a splat's alpha crosses the cut-off, and bends where colours are equal.
            let Some(off) = disagreement(values[k], largest, TOLERANCE, value) else { continue };
            compared += 1;
            assert!(off < TOLERANCE, "{name} {k}: {} is {off} off", values[k]);
        }
        assert!(compared * 10 > asked * 7, "{name}: {compared} of {asked}");
    }
}

#[test]
fn gradients_of_the_whole_loss_agree_with_central_differences() {
    let weights = LossWeights::of(&[("opacity", 0.05), ("opacity_sum", 0.003)]).unwrap();
    let objective = objective(PrimitiveKind::Ellipsoid, terms(TermInputs::default()));
    compare_with_differences(objective, &scene(40), &weights, None);
}

#[test]
fn gradients_of_ellipsoids_with_measured_depths_agree_with_central_differences() {
    let objective = objective(PrimitiveKind::Ellipsoid, terms(TermInputs::default()));
    let priors = PriorTargets::new(priors(DepthKind::Measured), &camera());
    let weights = LossWeights::of(&[("depth_prior", 3.0), ("depth_smoothness", 2.0)]).unwrap();
    compare_with_differences(objective, &scene(40), &weights, Some(&priors));
}

/// Random priors of the tests' camera, with a tenth of the pixels unknown.
fn priors(kind: DepthKind) -> ViewPriors {
    let (width, height) = camera().size;
    let mut draw = CounterRng::new(5, 0, 0, 0);
    let mut plane = |low: f64| {
        Grid2::from_fn(width, height, |_, _| match draw.uniform() {
            u if u < 0.1 => f32::NAN,
            u => (low + u) as f32,
        })
    };
    // Measured depths are those of the scene.
    let depth =
        Some(DepthPrior { values: plane(if kind == DepthKind::Measured { 19.5 } else { 0.0 }), kind });
    ViewPriors { depth, normal: Some(NormalPrior { planes: [-0.5, -0.5, -1.5].map(&mut plane) }) }
}

fn compare_with_priors(kind: DepthKind, weights: &[(&str, f64)]) {
    let mut splats = scene(40);
    splats.flatten();
    let objective = objective(PrimitiveKind::Disc, terms(TermInputs::default()));
    let priors = PriorTargets::new(priors(kind), &camera());
    compare_with_differences(objective, &splats, &LossWeights::of(weights).unwrap(), Some(&priors));
}

#[test]
fn gradients_of_discs_with_priors_of_depths_and_normals_agree_with_central_differences() {
    compare_with_priors(DepthKind::Relative, &[("depth_prior", 3.0), ("normal_prior", 3.0)]);
}

#[test]
fn gradients_of_smooth_discs_with_a_prior_of_disparity_agree_with_central_differences() {
    compare_with_priors(DepthKind::Disparity, &[("depth_prior", 3.0), ("depth_smoothness", 2.0)]);
}

#[test]
fn gradients_of_discs_with_measured_depths_and_distortion_agree_with_central_differences() {
    compare_with_priors(DepthKind::Measured, &[("depth_prior", 3.0), ("depth_distortion", 500.0)]);
}

#[test]
fn the_depth_of_a_lonely_opaque_splat_is_its_distance_along_the_axis() {
    let camera = camera();
    let at = camera.center + camera.cam_from_site.transpose() * DVec3::new(0.5, -0.2, 12.0);
    let mut splats = Splats::<f64>::default();
    splats.push(at.to_array(), 0.3, 0.9, [0.2, 0.4, 0.6]);
    let none = Image::default();
    let input = PinholeStep {
        anchored: &[],
        camera: &camera,
        nearest: NEAREST,
        target: &none,
        valid: &[],
        priors: None,
        background: [0.0; 3],
        sh_degree: 3,
        surface: SurfaceDepth::Mean,
    };
    let mut objective = EllipsoidObjective::<f64>::new(TermSet::default());
    objective.forward(&splats, &input, &mut Stopwatch::default());
    let px = camera.project(crate::frame::Point::new(at.x, at.y, at.z)).unwrap();
    let (col, row) = (px.col.round() as usize, px.row.round() as usize);
    let (view, opaque) = (objective.view(), 1.0 - objective.view().at(4, col, row));
    assert!(opaque > 0.5 && (view.at(3, col, row) / opaque - 12.0).abs() < 1e-9);
    assert!((view.at(2, col, row) / opaque - 0.6).abs() < 1e-9);
}

/// Splats on all sides of the camera, from a millimetre to half a metre in size, some nearly transparent.
fn splats_around(camera: &PinholeCamera, kind: PrimitiveKind) -> Splats<f64> {
    let mut out = Splats::<f64>::default();
    for i in 0..4000 {
        let mut draw = CounterRng::new(8, 0, 0, i);
        let offset: [f64; 3] = std::array::from_fn(|_| 12.0 * (2.0 * draw.uniform() - 1.0));
        let place = camera.center + DVec3::from_array(offset) * draw.uniform();
        out.push(place.to_array(), 1.0, 0.001 + 0.998 * draw.uniform().powi(3), [0.5; 3]);
        out.log_scale[i as usize] = std::array::from_fn(|_| 6.5 * draw.uniform() - 7.0);
        out.rotation[i as usize] = std::array::from_fn(|_| draw.normal());
    }
    if kind == PrimitiveKind::Disc {
        out.flatten();
    }
    out
}

#[test]
fn selection_leaves_out_no_splat_that_the_image_shows_and_most_of_the_others() {
    let (camera, none) = (camera(), Image::default());
    for kind in [PrimitiveKind::Ellipsoid, PrimitiveKind::Disc] {
        let splats = splats_around(&camera, kind);
        let weights = LossWeights::default();
        // Where splats are anchored, all take part.
        let anchored = [Anchoring { splat: 1, anchor: 0 }];
        let [all, seen] = [&anchored[..], &[]].map(|anchored| {
            let input = PinholeStep {
                anchored,
                camera: &camera,
                nearest: NEAREST,
                target: &none,
                valid: &[],
                priors: None,
                background: [0.0; 3],
                sh_degree: 0,
                surface: SurfaceDepth::Mean,
            };
            let mut objective = objective(kind, TermSet::default());
            let mut gradient = SeenGradient::default();
            objective.evaluate(&splats, &input, &weights, &mut gradient, &mut Stopwatch::default());
            let shown =
                (0..gradient.indices.len()).filter(|place| objective.mean2d_gradient(*place).is_some());
            let shown: Vec<u32> = shown.map(|place| gradient.indices[place]).collect();
            (gradient.indices, shown)
        });
        assert_eq!(all.0.len(), splats.len());
        assert!(all.1 == seen.1, "{kind:?}: {} are shown, {} of them selected", all.1.len(), seen.1.len());
        assert!(
            seen.1.len() > 100 && 3 * seen.0.len() < splats.len(),
            "{kind:?}: {} selected, {} shown",
            seen.0.len(),
            seen.1.len()
        );
    }
}
