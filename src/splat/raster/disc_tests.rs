//! Renders of discs are compared with closed forms, and their gradients with central differences in f64.

use super::*;
use crate::camera::{CameraKernel, DepthOrder, QuadraticKernel};
use crate::perspective::{PinholeCamera, PinholeKernel};
use crate::random::CounterRng;
use crate::simd::{Real, SimdReal};
use crate::splat::differences::{TOLERANCE, worst_disagreement};
use crate::splat::primitive::{FLAT_LOG_SCALE, PrimitiveKind};
use crate::splat::splats::{GROUPS, Splats, color_from_f_dc, f_dc_gradient};
use glam::{DMat3, DQuat, DVec2, DVec3};

/// Depth up to which pinhole cameras draw nothing.
const NEAREST: f64 = 0.2;
/// Least share of the parameters that must not lie at a jump of the loss (alpha cut-off, median).
const SMOOTH: f64 = 0.8;

const SIZE: (usize, usize) = (37, 35);
const BACKGROUND: [f64; 7] = [0.2, 0.9, 0.4, -4.0, 0.1, 0.3, -0.2];

/// Discs with random orientations around the origin, some metres wide.
fn scene(n: u64, seed: u64) -> Splats<f64> {
    let mut g = Splats::default();
    for i in 0..n {
        let mut draw = CounterRng::new(seed, 0, 0, i);
        let mut u = |lo: f64, hi: f64| lo + (hi - lo) * draw.uniform();
        g.position.push([u(-6.0, 6.0), u(-5.0, 5.0), u(-3.0, 3.0)]);
        g.log_scale.push([u(-0.7, 0.7), u(-0.7, 0.7), FLAT_LOG_SCALE.into()]);
        g.rotation.push([u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0)]);
        g.opacity_logit.push([u(-2.0, 1.0)]);
        g.f_dc.push([u(-1.0, 1.0), u(-1.0, 1.0), u(-1.0, 1.0)]);
    }
    g
}

fn parallel<T: Real>() -> FrameCamera<QuadraticKernel<T>> {
    let camera = crate::affine::ViewCamera::affine([[2.9, 0.2, 0.5], [0.3, -2.8, 0.7]], [18.3, 16.8]);
    FrameCamera::new(&camera, SIZE.0, SIZE.1)
}

/// A camera at this distance from the site's origin that looks down at the scene obliquely.
fn pinhole(distance_m: f64, focal_px: f64) -> PinholeCamera {
    let cam_from_site = DMat3::from_rotation_x(2.7) * DMat3::from_rotation_z(0.4);
    let center = cam_from_site.transpose() * DVec3::new(0.3, -0.4, -distance_m);
    let focal = DVec2::new(focal_px, 0.95 * focal_px);
    PinholeCamera { cam_from_site, center, focal, principal: DVec2::new(18.3, 16.8), size: SIZE }
}

fn perspective<T: Real>(distance_m: f64, focal_px: f64) -> FrameCamera<PinholeKernel<T>> {
    FrameCamera {
        kernel: pinhole(distance_m, focal_px).kernel(NEAREST).without_limits(),
        width: SIZE.0,
        height: SIZE.1,
    }
}

fn sort<T: SimdReal, K: CameraKernel<T>>(g: &Splats<T>, camera: &K) -> SortedSplats<T> {
    let mut sorted = SortedSplats::of(PrimitiveKind::Disc);
    match K::ORDER {
        DepthOrder::Altitude => sorted.update(g),
        DepthOrder::Camera => sorted.update_for(g, camera),
    }
    sorted
}

/// Depth of a position for a camera, as discs need it.
fn depth<T: Real, K: CameraKernel<T>>(camera: &K, position: [T; 3]) -> T {
    let key = camera.depth_key(position);
    if matches!(K::ORDER, DepthOrder::Camera) { -key } else { key }
}

/// Colours, depths and normals by rank.
fn features<T: SimdReal, K: CameraKernel<T>>(
    g: &Splats<T>,
    sorted: &SortedSplats<T>,
    camera: &K,
) -> Vec<[T; 7]> {
    let ranks = sorted.order().iter().enumerate();
    let of = |(rank, &i): (usize, &u32)| {
        let [red, green, blue] = color_from_f_dc(g.f_dc[i as usize]);
        let [x, y, z] = sorted.normal(rank);
        [red, green, blue, depth(camera, g.position[i as usize]), x, y, z]
    };
    ranks.map(of).collect()
}

/// Weights of all planes of all pixels in a linear loss.
fn weights<T: Real>(planes: usize) -> Image<T> {
    let mut w = Image::zeros(SIZE.0, SIZE.1, planes);
    let mut draw = CounterRng::new(77, 0, 0, 0);
    w.data.iter_mut().for_each(|v| *v = T::from_f64(draw.uniform() - 0.4));
    w
}

/// The mapped depth's variance, unlike its moments, does not depend on the reference of a tile: the distortion `A M2 - M1²`
/// and its derivatives by the three planes, for a pixel with these values of the moments and the transmittance.
fn distortion([m1, m2, through]: [f64; 3]) -> (f64, [f64; 3]) {
    let alpha = 1.0 - through;
    (alpha * m2 - m1 * m1, [-2.0 * m1, alpha, -m2])
}

/// Planes of `DiscWithMoments` with seven features.
const PLANES: usize = 11;
const M1: usize = 7;
const M2: usize = 8;
const THROUGH: usize = 9;

/// Loss of a render, and its derivatives by the pixels: linear in features, transmittance and median, plus the weighted
/// distortion.
fn loss_of(image: &Image<f64>) -> (f64, Image<f64>) {
    let mut by: Image<f64> = weights(PLANES);
    let mut sum = 0.0;
    for row in 0..SIZE.1 {
        for col in 0..SIZE.0 {
            let weight = 20.0 * by.at(M1, col, row);
            let (value, slopes) = distortion([M1, M2, THROUGH].map(|p| image.at(p, col, row)));
            for plane in (0..PLANES).filter(|p| ![M1, M2].contains(p)) {
                sum += by.at(plane, col, row) * image.at(plane, col, row);
            }
            sum += weight * value;
            *by.at_mut(M1, col, row) = weight * slopes[0];
            *by.at_mut(M2, col, row) = weight * slopes[1];
            *by.at_mut(THROUGH, col, row) += weight * slopes[2];
        }
    }
    (sum, by)
}

fn loss<K: CameraKernel<f64>>(g: &Splats<f64>, camera: &FrameCamera<K>) -> f64 {
    let sorted = sort(g, &camera.kernel);
    let mut raster = Rasterizer::<f64, 7, K, DiscWithMoments>::default();
    loss_of(raster.render(&sorted, &features(g, &sorted, &camera.kernel), camera, BACKGROUND)).0
}

fn gradient<K: CameraKernel<f64>>(g: &Splats<f64>, camera: &FrameCamera<K>) -> Splats<f64> {
    let sorted = sort(g, &camera.kernel);
    let mut raster = Rasterizer::<f64, 7, K, DiscWithMoments>::default();
    let image = raster.render(&sorted, &features(g, &sorted, &camera.kernel), camera, BACKGROUND);
    let (_, by_pixel) = loss_of(image);
    finish(g, &sorted, raster, &by_pixel, &camera.kernel)
}

fn finish<T: SimdReal, K: CameraKernel<T>, P: Primitive>(
    g: &Splats<T>,
    sorted: &SortedSplats<T>,
    mut raster: Rasterizer<T, 7, K, P>,
    by_pixel: &Image<T>,
    camera: &K,
) -> Splats<T> {
    let n = g.len();
    let mut shared = vec![SplatGradient::default(); n];
    let mut by_feature = vec![[T::zero(); 7]; n];
    raster.backward(sorted, by_pixel, &mut shared, &mut by_feature);
    let mut by_normal: Vec<[T; 3]> = by_feature.iter().map(|by| [by[4], by[5], by[6]]).collect();
    raster.add_normal_gradients(&mut by_normal);
    let mut out = Splats::zeros(n);
    sorted.parameter_gradients(g, &shared, &by_normal, &mut out);
    // The depth is linear in the position.
    let origin = depth(camera, [T::zero(); 3]);
    for i in 0..n {
        let by = by_feature[sorted.rank(i)];
        out.f_dc[i] = f_dc_gradient([by[0], by[1], by[2]]);
        for k in 0..3 {
            let mut unit = [T::zero(); 3];
            unit[k] = T::one();
            out.position[i][k] = out.position[i][k] + by[3] * (depth(camera, unit) - origin);
        }
    }
    out
}

#[test]
fn gradients_of_discs_agree_with_central_differences_in_a_parallel_projection() {
    for seed in 0..3 {
        let g = scene(25, seed);
        let worst = worst_disagreement(&g, &gradient(&g, &parallel()), (1, SMOOTH), |g| loss(g, &parallel()));
        assert!(worst < TOLERANCE, "{worst:e}");
    }
}

#[test]
fn gradients_of_discs_agree_with_central_differences_in_a_perspective_projection() {
    for seed in 0..3 {
        let g = scene(25, seed);
        let camera = perspective(20.0, 55.0);
        let worst = worst_disagreement(&g, &gradient(&g, &camera), (1, SMOOTH), |g| loss(g, &camera));
        assert!(worst < TOLERANCE, "{worst:e}");
    }
}

#[test]
fn gradients_of_unusual_discs_agree_with_central_differences() {
    let camera = perspective(20.0, 55.0);
    let kernel = pinhole(20.0, 55.0);
    let mut g = scene(12, 5);
    let sight = (DVec3::from_array(g.position[0]) - kernel.center).normalize();
    let across = sight.any_orthonormal_vector();
    // Edge-on to the ray, but for a thousandth of a degree.
    let edge = DQuat::from_rotation_arc(DVec3::Z, (across + 2e-5 * sight).normalize());
    g.rotation[0] = [edge.w, edge.x, edge.y, edge.z];
    // Behind the camera, through its plane, huge, and tiny.
    g.position[1] = (kernel.center - 30.0 * sight).to_array();
    g.position[2] = (kernel.center + 1.0 * sight + 0.5 * across).to_array();
    g.log_scale[2][0] = 1.5;
    g.log_scale[3] = [3.0, 3.5, FLAT_LOG_SCALE.into()];
    g.log_scale[4] = [-7.0, -6.0, FLAT_LOG_SCALE.into()];
    let worst = worst_disagreement(&g, &gradient(&g, &camera), (1, SMOOTH), |g| loss(g, &camera));
    assert!(worst < TOLERANCE, "{worst:e}");
}

#[test]
fn f32_kernels_of_discs_agree_with_f64() {
    fn compare<K32: CameraKernel<f32>, K64: CameraKernel<f64>>(
        narrow: &FrameCamera<K32>,
        wide: &FrameCamera<K64>,
    ) {
        let (mut worst, g) = ([0.0f64; GROUPS], scene(200, 4));
        let sorted = sort(&g, &wide.kernel);
        let mut raster = Rasterizer::<f64, 7, K64, Disc>::default();
        raster.render(&sorted, &features(&g, &sorted, &wide.kernel), wide, BACKGROUND);
        let exact = finish(&g, &sorted, raster, &weights(7), &wide.kernel);
        let g = g.narrow();
        let sorted = sort(&g, &narrow.kernel);
        let mut raster = Rasterizer::<f32, 7, K32, Disc>::default();
        let background = BACKGROUND.map(|v| v as f32);
        raster.render(&sorted, &features(&g, &sorted, &narrow.kernel), narrow, background);
        let fast = finish(&g, &sorted, raster, &weights(7), &narrow.kernel);
        for (k, (a, b)) in exact.groups().iter().zip(fast.groups()).enumerate() {
            let largest = a.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            let off = a.iter().zip(b).map(|(x, y)| (x - f64::from(*y)).abs()).fold(0.0, f64::max);
            worst[k] = off / largest.max(f64::MIN_POSITIVE);
        }
        assert!(worst.iter().all(|w| *w < 2e-3), "{worst:?}");
    }
    compare(&parallel::<f32>(), &parallel::<f64>());
    compare(&perspective::<f32>(20.0, 55.0), &perspective::<f64>(20.0, 55.0));
}

/// One disc, its rotation and scales.
fn one_disc(rotation: DQuat, scales: [f64; 2], opacity: f64) -> Splats<f64> {
    let mut g = Splats::default();
    g.push([0.5, -0.25, 2.0], 1.0, opacity, [0.3, 0.6, 0.9]);
    g.rotation[0] = [rotation.w, rotation.x, rotation.y, rotation.z];
    g.log_scale[0] = [scales[0].ln(), scales[1].ln(), FLAT_LOG_SCALE.into()];
    g
}

#[test]
fn rays_of_a_perspective_camera_meet_the_disc_where_geometry_says() {
    // The disc is so large in the image that the low-pass filter changes little.
    let (camera, frame) = (pinhole(20.0, 250.0), perspective::<f64>(20.0, 250.0));
    let rotation = DQuat::from_rotation_x(0.9) * DQuat::from_rotation_z(0.4);
    let g = one_disc(rotation, [1.5, 0.9], 0.7);
    let sorted = sort(&g, &frame.kernel);
    let mut raster = Rasterizer::<f64, 7, _, DiscWithMoments>::default();
    let image = raster.render(&sorted, &features(&g, &sorted, &frame.kernel), &frame, [0.0; 7]);
    let [u, v, n] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| rotation * axis);
    let center = DVec3::from_array(g.position[0]);
    let mut seen = 0;
    for row in 0..SIZE.1 {
        for col in 0..SIZE.0 {
            let px = DVec2::new(col as f64, row as f64);
            let ray = ((px - camera.principal) / camera.focal).extend(1.0);
            let ray = camera.cam_from_site.transpose() * ray;
            let depth = n.dot(center - camera.center) / n.dot(ray);
            let on_disc = camera.center + depth * ray - center;
            let (xi, eta) = (u.dot(on_disc) / 1.5, v.dot(on_disc) / 0.9);
            let alpha = 0.7 * (-0.5 * (xi * xi + eta * eta)).exp();
            let weight = 1.0 - image.at(THROUGH, col, row);
            assert!((weight - alpha).abs() < 0.004, "{col} {row}: {weight} and {alpha}");
            if weight > 0.05 {
                seen += 1;
                let mean = image.at(3, col, row) / weight;
                assert!((mean - depth).abs() < 1e-9, "{mean} and {depth}");
                for k in 0..3 {
                    assert!((image.at(4 + k, col, row) / weight - n[k]).abs() < 1e-9);
                }
                let median = image.at(10, col, row);
                let expected = if weight >= 0.5 { depth } else { 0.0 };
                assert!((median - expected).abs() < 1e-9, "{median} and {expected}");
            }
        }
    }
    assert!(seen > 300, "{seen}");
}

#[test]
fn the_altitude_of_a_disc_in_a_parallel_projection_is_that_of_its_plane() {
    let frame = parallel::<f64>();
    let rotation = DQuat::from_rotation_x(0.6) * DQuat::from_rotation_y(0.3);
    let g = one_disc(rotation, [2.5, 1.9], 0.8);
    let sorted = sort(&g, &frame.kernel);
    let mut raster = Rasterizer::<f64, 7, _, Disc>::default();
    let image = raster.render(&sorted, &features(&g, &sorted, &frame.kernel), &frame, [0.0; 7]);
    let (n, center, m) = (rotation * DVec3::Z, DVec3::from_array(g.position[0]), frame.kernel.linear);
    for row in 0..SIZE.1 {
        for col in 0..SIZE.0 {
            let weight = 1.0 - image.at(7, col, row);
            if weight > 0.05 {
                let z = image.at(3, col, row) / weight;
                // The point at this altitude whose image is the pixel lies in the plane of the disc.
                let px = [
                    col as f64 - frame.kernel.offset[0] - m[0][2] * z,
                    row as f64 - frame.kernel.offset[1] - m[1][2] * z,
                ];
                let det = m[0][0] * m[1][1] - m[0][1] * m[1][0];
                let x = (px[0] * m[1][1] - m[0][1] * px[1]) / det;
                let y = (m[0][0] * px[1] - px[0] * m[1][0]) / det;
                assert!(n.dot(DVec3::new(x, y, z) - center).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn a_perspective_camera_far_away_shows_a_disc_as_a_parallel_one_does() {
    let g = one_disc(DQuat::from_rotation_x(0.5), [1.2, 0.8], 0.9);
    let mut before = f64::INFINITY;
    for distance in [1e3, 1e4, 1e5] {
        let camera = perspective::<f64>(distance, 3.0 * distance);
        let kernel = &camera.kernel;
        let jacobian = CameraKernel::jacobian(kernel, g.position[0]);
        let p = pinhole(distance, 3.0 * distance).project(crate::frame::Point::new(0.5, -0.25, 2.0)).unwrap();
        let at = |k: usize| (0..3).map(|j| jacobian[k][j] * g.position[0][j]).sum::<f64>();
        let offset = [p.col - at(0), p.row - at(1)];
        let affine = FrameCamera {
            kernel: QuadraticKernel { linear: jacobian, offset, ..Default::default() },
            width: SIZE.0,
            height: SIZE.1,
        };
        let render = |image: &Image<f64>| image.data.clone();
        let sorted = sort(&g, kernel);
        let mut raster = Rasterizer::<f64, 7, _, Disc>::default();
        let near = render(raster.render(&sorted, &[[1.0; 7]], &camera, [0.0; 7]));
        let sorted = sort(&g, &affine.kernel);
        let mut raster = Rasterizer::<f64, 7, _, Disc>::default();
        let far = render(raster.render(&sorted, &[[1.0; 7]], &affine, [0.0; 7]));
        let through = |data: &[f64]| -> Vec<f64> {
            data.chunks(SIZE.0).skip(7).step_by(8).flatten().copied().collect()
        };
        let off = through(&near).iter().zip(through(&far)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 0.2 * before && off < 3.0 / distance, "{off} at {distance} m");
        before = off;
    }
}

/// Discs that tile a plane through the origin, tilted around the east axis, seen by a camera.
fn tiled_plane(tilt_deg: f64, spacing_m: f64) -> Splats<f64> {
    let rotation = DQuat::from_rotation_x(tilt_deg.to_radians());
    let mut g = Splats::default();
    for i in -40..=40 {
        for j in -40..=40 {
            let p = rotation * DVec3::new(f64::from(i) * spacing_m, f64::from(j) * spacing_m, 0.0);
            g.push(p.to_array(), spacing_m, 0.9, [0.5; 3]);
            let k = g.len() - 1;
            g.log_scale[k][2] = FLAT_LOG_SCALE.into();
            g.rotation[k] = [rotation.w, rotation.x, rotation.y, rotation.z];
        }
    }
    g
}

#[test]
fn a_plane_of_discs_has_its_exact_depth_and_normal_in_every_pixel() {
    for tilt_deg in [0.0f64, 30.0, 60.0] {
        let g = tiled_plane(tilt_deg, 0.5);
        let n = DQuat::from_rotation_x(tilt_deg.to_radians()) * DVec3::Z;
        let (frame, camera) = (perspective::<f64>(20.0, 55.0), pinhole(20.0, 55.0));
        let sorted = sort(&g, &frame.kernel);
        let mut raster = Rasterizer::<f64, 7, _, DiscWithMoments>::default();
        let image = raster.render(&sorted, &features(&g, &sorted, &frame.kernel), &frame, [0.0; 7]);
        let mut seen = 0;
        for row in 0..SIZE.1 {
            for col in 0..SIZE.0 {
                let weight = 1.0 - image.at(THROUGH, col, row);
                if weight < 0.99 {
                    continue;
                }
                seen += 1;
                let px = DVec2::new(col as f64, row as f64);
                let ray =
                    camera.cam_from_site.transpose() * ((px - camera.principal) / camera.focal).extend(1.0);
                let depth = -n.dot(camera.center) / n.dot(ray);
                assert!((image.at(3, col, row) / weight - depth).abs() < 1e-3, "{tilt_deg}");
                assert!((image.at(10, col, row) - depth).abs() < 1e-3, "{tilt_deg}");
                let normal = DVec3::from_array([4, 5, 6].map(|c| image.at(c, col, row))) / weight;
                assert!(normal.angle_between(n).to_degrees() < 0.1);
            }
        }
        assert!(seen > 500, "{seen} at {tilt_deg}");
    }
}

#[test]
fn no_pixel_of_a_disc_is_lost_by_binning_into_tiles_and_blocks() {
    // Large discs close to the camera, at random angles, in an image and in its part of some columns and rows.
    for i in 0..200 {
        let mut g = scene(1, 1000 + i);
        g.log_scale[0] = [1.4, 0.3, FLAT_LOG_SCALE.into()];
        g.opacity_logit[0][0] = 3.0;
        let camera = perspective::<f64>(14.0, 55.0);
        let moved =
            PinholeCamera { principal: DVec2::new(23.3, 25.8), size: (53, 51), ..pinhole(14.0, 55.0) };
        let sorted = sort(&g, &camera.kernel);
        let mut raster = Rasterizer::<f64, 1, _, Disc>::default();
        let image = raster.render(&sorted, &[[1.0]], &camera, [0.0]).clone();
        let shifted = FrameCamera { kernel: moved.kernel(NEAREST).without_limits(), width: 53, height: 51 };
        let moved = raster.render(&sorted, &[[1.0]], &shifted, [0.0]);
        for row in 0..SIZE.1 {
            for col in 0..SIZE.0 {
                let [a, b] = [image.at(1, col, row), moved.at(1, col + 5, row + 9)];
                assert!((a - b).abs() < 1e-9, "disc {i} at {col} {row}: {a} and {b}");
            }
        }
    }
}
