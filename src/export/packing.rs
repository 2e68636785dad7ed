//! What the compressed formats of splats have in common.

use crate::splat::splats::{Splats, logit};

/// Coefficients of a colour channel in `f_rest`, which holds one channel after the other.
pub(super) const OF_CHANNEL: usize = 15;

/// Number of coefficients of a channel up to a degree, without the constant one.
pub(super) fn coefficients(degree: usize) -> usize {
    (degree + 1) * (degree + 1) - 1
}

/// The logit of an opacity of `0..=255`. Those of 0 and 255 are infinite: a quarter of a step inside stands for them.
pub(super) fn logit_of_byte(byte: u8) -> f32 {
    logit((f32::from(byte) / 255.0).clamp(0.25 / 255.0, 1.0 - 0.25 / 255.0))
}

/// The three components of a unit quaternion beside that of the largest absolute value, which is made positive, and its
/// place.
pub(super) fn smallest_three(q: [f32; 4]) -> (usize, [f32; 3]) {
    let largest = (1..4).fold(0, |best, k| if q[k].abs() > q[best].abs() { k } else { best });
    let sign = if q[largest] < 0.0 { -1.0 } else { 1.0 };
    let mut others = (0..4).filter(|k| *k != largest).map(|k| sign * q[k]);
    (largest, std::array::from_fn(|_| others.next().unwrap_or_default()))
}

/// The inverse of [`smallest_three`].
pub(super) fn from_smallest_three(largest: usize, three: [f32; 3]) -> [f32; 4] {
    let mut others = three.into_iter();
    let missing = (1.0 - three.iter().map(|v| v * v).sum::<f32>()).max(0.0).sqrt();
    std::array::from_fn(|k| if k == largest { missing } else { others.next().unwrap_or_default() })
}

/// Makes splats discs whose third scale is nowhere larger than `smallest`, the least that a format can hold.
pub(super) fn flatten_if_flat(splats: &mut Splats, smallest: f32) {
    if !splats.is_empty() && splats.log_scale.iter().all(|s| s[2] <= smallest) {
        splats.flatten();
    }
}

/// The order of splats along a Z-order curve through their bounds, which has neighbours near each other.
pub(super) fn z_order(positions: &[[f32; 3]]) -> Vec<u32> {
    /// Bits of each coordinate.
    const BITS: u32 = 21;
    let (low, high) = bounds(positions);
    let widest = (0..3).map(|k| high[k] - low[k]).fold(f32::MIN_POSITIVE, f32::max);
    let steps = ((1u32 << BITS) - 1) as f32;
    let code = |p: &[f32; 3]| {
        let cell: [u64; 3] = std::array::from_fn(|k| ((p[k] - low[k]) / widest * steps) as u64);
        (0..BITS).fold(0u64, |code, bit| {
            (0..3).fold(code, |code, k| code | ((cell[k] >> bit) & 1) << (3 * bit + k as u32))
        })
    };
    let mut order: Vec<(u64, u32)> = positions.iter().map(code).zip(0..).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}

/// The corners of the box around positions.
pub(super) fn bounds(positions: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let empty = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    if positions.is_empty() {
        return ([0.0; 3], [0.0; 3]);
    }
    positions.iter().fold(empty, |(low, high), p| {
        (std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k])))
    })
}
