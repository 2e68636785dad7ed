//! Splats for tests of formats.

use crate::splat::splats::{Splats, unit_quaternion};

/// Splats within 20 m, of all opacities, colours, sizes and orientations.
pub fn some(n: usize, degree: usize, is_flat: bool) -> Splats {
    let value = |i: usize, k: usize| ((i * 7919 + k * 104_729 + 17) % 1009) as f32 / 1009.0;
    let mut splats = Splats::default();
    for i in 0..n {
        let position = [0, 1, 2].map(|k| 40.0 * value(i, k) - 20.0);
        splats.push(position, 1.0, 0.02 + 0.96 * value(i, 3), [4, 5, 6].map(|k| value(i, k)));
        splats.log_scale[i] = [7, 8, 9].map(|k| 4.0 * value(i, k) - 3.0);
        splats.rotation[i] = unit_quaternion([10, 11, 12, 13].map(|k| value(i, k) - 0.5));
    }
    if degree > 0 {
        let used = (degree + 1) * (degree + 1) - 1;
        let of = |i: usize, k: usize| if k % 15 < used { value(i, 14 + k) - 0.5 } else { 0.0 };
        splats.f_rest = (0..n).map(|i| std::array::from_fn(|k| of(i, k))).collect();
    }
    if is_flat {
        splats.flatten();
    }
    splats
}

/// Asserts that positions, colours, logarithms of scales and coefficients differ by no more than the given numbers, and
/// opacities and orientations by no more than bytes and ten bits allow.
pub fn assert_near(a: &Splats, b: &Splats, [position, color, log_scale, harmonics]: [f32; 4]) {
    let largest = |a: &[f32], b: &[f32]| {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    let opacities = |s: &Splats| -> Vec<f32> {
        s.opacity_logit.iter().map(|o| crate::splat::splats::sigmoid(o[0])).collect()
    };
    let found = [
        largest(a.position.as_flattened(), b.position.as_flattened()) / position,
        largest(a.f_dc.as_flattened(), b.f_dc.as_flattened()) / color,
        largest(a.log_scale.as_flattened(), b.log_scale.as_flattened()) / log_scale,
        largest(a.f_rest.as_flattened(), b.f_rest.as_flattened()) / harmonics,
        largest(&opacities(a), &opacities(b)) / 0.004,
    ];
    assert!(found.iter().all(|v| *v <= 1.0), "{found:?}");
    for (a, b) in a.rotation.iter().zip(&b.rotation) {
        let cos: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        assert!(cos.abs() > 1.0 - 1e-5, "{a:?} {b:?}");
    }
}
