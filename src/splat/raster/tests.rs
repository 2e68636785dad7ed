//! Gradients are compared with central differences in f64, f32 with f64, and renders with closed forms.

use super::*;
use crate::camera::{CameraKernel, DepthOrder, QuadraticKernel};
use crate::frame::Point;
use crate::perspective::{PinholeCamera, PinholeKernel};
use crate::simd::{Real, SimdReal};
use crate::splat::differences::{TOLERANCE, worst_disagreement};
use crate::splat::edit::Edit;
use crate::splat::splats::{GROUPS, Splats, color_from_f_dc, f_dc_gradient};
use glam::{DMat3, DVec2, DVec3};

/// Depth up to which pinhole cameras draw nothing.
const NEAREST: f64 = 0.2;
/// Least share of the parameters that must not lie at a jump of the loss (alpha cut-off, median).
const SMOOTH: f64 = 0.9;

/// Uniform random numbers in [0, 1) by hashing a counter (SplitMix64).
fn uniform(counter: &mut u64) -> f64 {
    *counter += 1;
    let mut z = counter.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

fn scene(n: usize, seed: u64) -> Splats<f64> {
    let mut counter = seed << 32;
    let mut u = |lo: f64, hi: f64| lo + (hi - lo) * uniform(&mut counter);
    let mut g = Splats::default();
    for _ in 0..n {
        g.position.push([u(-6.0, 6.0), u(-5.0, 5.0), u(-3.0, 3.0)]);
        g.log_scale.push([u(-0.7, 0.7), u(-0.7, 0.7), u(-0.7, 0.7)]);
        g.rotation.push([u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0)]);
        g.opacity_logit.push([u(-2.0, 1.0)]);
        g.f_dc.push([u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0)]);
    }
    g
}

fn camera<T: Real>() -> FrameCamera<QuadraticKernel<T>> {
    let camera = crate::affine::ViewCamera::affine([[2.9, 0.2, 0.5], [0.3, -2.8, 0.7]], [18.3, 16.8]);
    FrameCamera::new(&camera, 37, 35)
}

fn features<T: SimdReal>(g: &Splats<T>, sorted: &SortedSplats<T>) -> Vec<[T; 4]> {
    let of = |&i: &u32| {
        let [red, green, blue] = color_from_f_dc(g.f_dc[i as usize]);
        [red, green, blue, g.position[i as usize][2]]
    };
    sorted.order().iter().map(of).collect()
}

/// Weights of the pixels in a linear loss.
fn weights<T: Real>(width: usize, height: usize) -> Image<T> {
    let mut w = Image::zeros(width, height, 4);
    let mut counter = 77 << 32;
    for v in &mut w.data {
        *v = T::from_f64(uniform(&mut counter) - 0.4);
    }
    w
}

const BACKGROUND: [f64; 4] = [0.2, 0.9, 0.4, -4.0];

/// The splats in the depth order of a camera.
fn sort<T: SimdReal, K: CameraKernel<T>>(g: &Splats<T>, camera: &K) -> SortedSplats<T> {
    let mut sorted = SortedSplats::default();
    match K::ORDER {
        DepthOrder::Altitude => sorted.update(g),
        DepthOrder::Camera => sorted.update_for(g, camera),
    }
    sorted
}

fn loss<K: CameraKernel<f64>>(g: &Splats<f64>, camera: &FrameCamera<K>) -> f64 {
    let sorted = sort(g, &camera.kernel);
    let mut raster = Rasterizer::<f64, 4, K>::default();
    let image = raster.render(&sorted, &features(g, &sorted), camera, BACKGROUND);
    let w: Image<f64> = weights(camera.width, camera.height);
    let mut sum = 0.0;
    for row in 0..camera.height {
        for c in 0..4 {
            sum += image.row(c, row).iter().zip(w.row(c, row)).map(|(a, b)| a * b).sum::<f64>();
        }
    }
    sum
}

fn gradient<T: SimdReal, K: CameraKernel<T>>(g: &Splats<T>, camera: &FrameCamera<K>) -> Splats<T> {
    let sorted = sort(g, &camera.kernel);
    let mut raster = Rasterizer::<T, 4, K>::default();
    let f = features(g, &sorted);
    raster.render(&sorted, &f, camera, BACKGROUND.map(T::from_f64));
    let mut shared = vec![SplatGradient::default(); g.len()];
    let mut by_feature = vec![[T::zero(); 4]; g.len()];
    raster.backward(&sorted, &weights(camera.width, camera.height), &mut shared, &mut by_feature);
    let mut out = Splats::zeros(g.len());
    sorted.parameter_gradients(g, &shared, &[], &mut out);
    for i in 0..g.len() {
        let by = by_feature[sorted.rank(i)];
        out.f_dc[i] = f_dc_gradient([by[0], by[1], by[2]]);
        out.position[i][2] = out.position[i][2] + by[3];
    }
    out
}

#[test]
fn gradients_agree_with_central_differences_in_f64() {
    for seed in 0..3 {
        let g = scene(40, seed);
        let worst = worst_disagreement(&g, &gradient(&g, &camera()), (1, SMOOTH), |g| loss(g, &camera()));
        assert!(worst < TOLERANCE, "{worst:e}");
    }
}

/// A camera 20 m from the site's origin that looks down at the scene obliquely.
fn pinhole() -> PinholeCamera {
    let cam_from_site = DMat3::from_rotation_x(2.7) * DMat3::from_rotation_z(0.4);
    let center = cam_from_site.transpose() * DVec3::new(0.3, -0.4, -20.0);
    let (focal, principal) = (DVec2::new(55.0, 52.0), DVec2::new(18.3, 16.8));
    PinholeCamera { cam_from_site, center, focal, principal, size: (37, 35) }
}

#[test]
fn gradients_of_a_pinhole_camera_agree_with_central_differences() {
    let camera =
        FrameCamera::<PinholeKernel<f64>> { kernel: pinhole().kernel(NEAREST), width: 37, height: 35 };
    for seed in 0..3 {
        let g = scene(40, seed);
        let worst = worst_disagreement(&g, &gradient(&g, &camera), (1, SMOOTH), |g| loss(g, &camera));
        assert!(worst < TOLERANCE, "{worst:e}");
    }
    // The first splats lie outside of the image, where the Jacobian is limited, and behind the camera.
    let mut g = scene(40, 3);
    g.position[0] = [19.0, 3.0, 1.0];
    g.log_scale[0] = [1.8; 3];
    g.position[1] = [0.0, 0.0, 60.0];
    let worst = worst_disagreement(&g, &gradient(&g, &camera), (1, SMOOTH), |g| loss(g, &camera));
    assert!(worst < TOLERANCE, "{worst:e}");
}

#[test]
fn gradients_of_a_quadratic_camera_agree_with_central_differences() {
    let quadratic = [[0.02, -0.01, 0.015, 0.01, 0.02, -0.03], [-0.01, 0.02, 0.01, -0.02, 0.015, 0.01]];
    let kernel = QuadraticKernel::<f64> { quadratic, ..camera::<f64>().kernel };
    let camera = FrameCamera::<QuadraticKernel<f64>> { kernel, width: 37, height: 35 };
    let g = scene(40, 0);
    let worst = worst_disagreement(&g, &gradient(&g, &camera), (1, SMOOTH), |g| loss(g, &camera));
    assert!(worst < TOLERANCE, "{worst:e}");
}

#[test]
fn a_pinhole_kernel_projects_as_its_camera_does_and_sorts_by_distance() {
    let camera = pinhole();
    let frame = FrameCamera::<PinholeKernel<f32>> { kernel: camera.kernel(NEAREST), width: 37, height: 35 };
    let at = |depth: f64| {
        let p =
            camera.center + camera.cam_from_site.transpose() * DVec3::new(0.1 * depth, -0.05 * depth, depth);
        p.to_array()
    };
    let mut splats = Splats::<f32>::default();
    for (depth, rgb) in [(25.0, [0.0, 1.0, 0.0]), (12.0, [1.0, 0.0, 0.0])] {
        splats.push(at(depth).map(|v| v as f32), 0.02 * depth as f32, 0.98, rgb);
    }
    let sorted = sort(&splats, &frame.kernel);
    let mut raster = Rasterizer::<f32, 4, _>::default();
    let image = raster.render(&sorted, &features(&splats, &sorted), &frame, [0.0; 4]);
    let [x, y, z] = at(12.0);
    let px = camera.project(Point::new(x, y, z)).unwrap();
    let (col, row) = (px.col.round() as usize, px.row.round() as usize);
    assert!(image.at(0, col, row) > 0.8 && image.at(1, col, row) < 0.2, "the nearer splat hides the other");
}

#[test]
fn gradients_agree_where_a_tile_has_more_splats_than_one_batch() {
    let mut g = scene(1500, 9);
    for i in 0..g.len() {
        // The opacities are so low that the last splats are still visible.
        g.log_scale[i] = g.log_scale[i].map(|s| s - 0.7);
        g.opacity_logit[i][0] -= 3.0;
    }
    let worst = worst_disagreement(&g, &gradient(&g, &camera()), (131, SMOOTH), |g| loss(g, &camera()));
    assert!(worst < TOLERANCE, "{worst:e}");
}

#[test]
fn the_comparison_detects_a_gradient_that_is_wrong_by_a_thousandth() {
    let g = scene(40, 0);
    let mut broken = gradient(&g, &camera());
    for v in broken.groups_mut()[1].iter_mut() {
        *v *= 1.001;
    }
    assert!(worst_disagreement(&g, &broken, (1, SMOOTH), |g| loss(g, &camera())) > 1e-4);
}

#[test]
fn f32_kernels_agree_with_f64() {
    for seed in 0..10 {
        let g = scene(200, seed);
        let (exact, fast) = (gradient(&g, &camera()), gradient(&g.narrow(), &camera()));
        for (a, b) in exact.groups().iter().zip(fast.groups()) {
            let largest = a.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            let worst = a.iter().zip(b).map(|(x, y)| (x - f64::from(*y)).abs()).fold(0.0, f64::max);
            assert!(worst <= 1e-3 * largest, "{worst} of {largest}");
        }
    }
}

#[test]
fn a_render_does_not_depend_on_earlier_renders_with_the_same_buffers() {
    let (mut sorted, mut raster) = (SortedSplats::default(), Rasterizer::<f32, 4>::default());
    for (n, size) in [(40, 35), (700, 80), (7, 16), (0, 33), (18, 1)] {
        let g = scene(n, 3).narrow();
        let camera = FrameCamera { width: size, height: size, ..camera::<f32>() };
        let mut fresh = SortedSplats::default();
        fresh.update(&g);
        sorted.update(&g);
        let f = features(&g, &fresh);
        let expected = Rasterizer::<f32, 4>::default().render(&fresh, &f, &camera, [0.5; 4]).clone();
        assert_eq!(*raster.render(&sorted, &f, &camera, [0.5; 4]), expected, "{n} splats");
        let opacities = (0..n).map(|rank| f64::from(sorted.opacity(rank))).sum::<f64>();
        assert!((sorted.mean_opacity() - opacities / n.max(1) as f64).abs() < 1e-6);
    }
}

#[test]
fn non_finite_and_huge_parameters_neither_panic_nor_hide_other_splats() {
    let sound = scene(1, 0).narrow();
    let camera = camera::<f32>();
    for group in 0..GROUPS {
        for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
            let mut g = sound.clone();
            g.apply(&Edit::permute(vec![0, 0]));
            let second = g.groups()[group].len() / 2..;
            g.groups_mut()[group][second].fill(wrong);
            let mut sorted = SortedSplats::default();
            sorted.update(&g);
            let (mut raster, f) = (Rasterizer::<f32, 4>::default(), features(&g, &sorted));
            raster.render(&sorted, &f, &camera, [0.0; 4]);
            let (mut shared, mut by_feature) = (vec![SplatGradient::default(); 2], vec![[0.0; 4]; 2]);
            raster.backward(&sorted, &weights(camera.width, camera.height), &mut shared, &mut by_feature);
            let visible = [0, 1].map(|splat| raster.mean2d_gradient(sorted.rank(splat)).is_some());
            // A splat without a finite position is not visible.
            assert!(visible[0] && !(group == 0 && visible[1]), "{wrong} in group {group}: {visible:?}");
        }
    }
}

#[test]
fn the_render_of_one_splat_agrees_with_its_closed_form() {
    let mut g = Splats::default();
    g.push([0.5, -0.25, 2.0], 0.8, 0.7, [0.3, 0.6, 0.9]);
    let mut sorted = SortedSplats::default();
    sorted.update(&g);
    let camera = camera::<f64>();
    let mut raster = Rasterizer::<f64, 4>::default();
    let image = raster.render(&sorted, &features(&g, &sorted), &camera, BACKGROUND);
    let m = camera.kernel.linear;
    let p = g.position[0];
    let mean: [f64; 2] =
        std::array::from_fn(|i| m[i][0] * p[0] + m[i][1] * p[1] + m[i][2] * p[2] + camera.kernel.offset[i]);
    let cov = |i: usize, j: usize| {
        0.64 * (0..3).map(|k| m[i][k] * m[j][k]).sum::<f64>() + if i == j { LOW_PASS_PX2 } else { 0.0 }
    };
    let det = cov(0, 0) * cov(1, 1) - cov(0, 1) * cov(0, 1);
    for row in 0..camera.height {
        for col in 0..camera.width {
            let (dx, dy) = (col as f64 - mean[0], row as f64 - mean[1]);
            let q = (cov(1, 1) * dx * dx - 2.0 * cov(0, 1) * dx * dy + cov(0, 0) * dy * dy) / det;
            let mut alpha = 0.7 * (-0.5 * q).exp();
            if alpha < ALPHA_CUT {
                alpha = 0.0;
            }
            let expected = [0.3, 0.6, 0.9, 2.0];
            for c in 0..4 {
                let value = alpha * expected[c] + (1.0 - alpha) * BACKGROUND[c];
                assert!((image.at(c, col, row) - value).abs() < 1e-9, "{col} {row} {c}");
            }
        }
    }
}

#[test]
fn no_pixel_of_an_ellipse_is_lost_by_binning_into_tiles_and_blocks() {
    // Long thin splats at random angles are rendered by two cameras whose images are shifted against each other.
    let mut counter = 5 << 32;
    for _ in 0..200 {
        let mut g = scene(1, counter);
        counter += 1 << 32;
        g.log_scale[0] = [1.6, -3.0, -3.0];
        g.opacity_logit[0][0] = 3.0;
        let mut sorted = SortedSplats::default();
        sorted.update(&g);
        let camera = camera::<f64>();
        let mut raster = Rasterizer::<f64, 1>::default();
        let image = raster.render(&sorted, &[[1.0]], &camera, [0.0]).clone();
        let mut shifted = camera;
        // The shift by a few pixels changes the tiles and must not change the image.
        shifted.kernel.offset = [camera.kernel.offset[0] + 5.0, camera.kernel.offset[1] + 9.0];
        shifted.width += 16;
        shifted.height += 16;
        let moved = raster.render(&sorted, &[[1.0]], &shifted, [0.0]);
        for row in 0..camera.height {
            for col in 0..camera.width {
                assert!((image.at(0, col, row) - moved.at(0, col + 5, row + 9)).abs() < 1e-9);
            }
        }
    }
}
