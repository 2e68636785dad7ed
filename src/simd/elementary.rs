//! Elementary functions of vectors of f32.

use super::processor::Processor;
use pulp::Simd as PulpSimd;

/// `2^a` with a relative error below 3e-7: the nearest whole power by the bits of the exponent, the fraction
/// by a polynomial.
#[inline(always)]
pub(super) fn exp2<S: PulpSimd>(s: S, a: S::f32s, [round, c0, c1, c2, c3, c4, c5]: [S::f32s; 7]) -> S::f32s {
    // Adding 1.5 * 2^23 rounds to a whole number, which the lowest bits then hold.
    let shifted = s.add_f32s(a, round);
    let f = s.sub_f32s(a, s.sub_f32s(shifted, round));
    // Estrin's scheme: pairs of terms do not depend on each other.
    let square = s.mul_f32s(f, f);
    let (low, middle) = (s.mul_add_e_f32s(c1, f, c0), s.mul_add_e_f32s(c3, f, c2));
    let high = s.mul_add_e_f32s(c5, f, c4);
    let p = s.mul_add_e_f32s(s.mul_add_e_f32s(high, square, middle), square, low);
    let power = s.wrapping_dyn_shl_u32s(s.transmute_u32s_f32s(shifted), s.splat_u32s(23));
    s.transmute_f32s_u32s(s.add_u32s(s.transmute_u32s_f32s(p), power))
}

/// Binary logarithm of positive normal numbers, with an absolute or relative error below 3e-7: the whole part
/// by the bits of the exponent, the mantissa `m` in [√½, √2] by the series of the inverse hyperbolic tangent
/// of `(m - 1) / (m + 1)`.
#[inline(always)]
pub(super) fn log2<S: PulpSimd>(s: S, a: S::f32s) -> S::f32s {
    const ROOT_HALF: u32 = std::f32::consts::FRAC_1_SQRT_2.to_bits();
    let bits = s.add_u32s(s.transmute_u32s_f32s(a), s.splat_u32s(1f32.to_bits() - ROOT_HALF));
    let power = s.wrapping_dyn_shr_u32s(bits, s.splat_u32s(23));
    let mantissa = s.add_u32s(s.and_u32s(bits, s.splat_u32s(0x007F_FFFF)), s.splat_u32s(ROOT_HALF));
    let m = s.transmute_f32s_u32s(mantissa);
    let whole = s.sub_f32s(
        s.transmute_f32s_u32s(s.or_u32s(power, s.splat_u32s(WHOLE_NUMBERS.to_bits()))),
        s.splat_f32s(WHOLE_NUMBERS + 127.0),
    );
    let one = s.splat_f32s(1.0);
    let t = s.div_f32s(s.sub_f32s(m, one), s.add_f32s(m, one));
    let t2 = s.mul_f32s(t, t);
    let mut p = s.splat_f32s(1.0 / 9.0);
    for k in [7.0, 5.0, 3.0, 1.0] {
        p = s.mul_add_e_f32s(p, t2, s.splat_f32s(1.0 / k));
    }
    s.mul_add_e_f32s(s.mul_f32s(p, t), s.splat_f32s(2.0 * std::f32::consts::LOG2_E), whole)
}

/// 2^23: f32 of this size are whole numbers.
const WHOLE_NUMBERS: f32 = 8_388_608.0;

/// The largest whole number not above `a`, for `a` between 0 and 2^22: the nearest whole number, minus 1 if
/// that is larger than `a`.
#[inline(always)]
pub(super) fn floor<S: Processor>(s: S, a: S::f32s) -> S::f32s {
    let ones = s.splat_f32s(WHOLE_NUMBERS);
    let nearest = s.sub_f32s(s.add_f32s(a, ones), ones);
    s.sub_f32s(nearest, s.select_or_zero(s.greater_than_f32s(nearest, a), s.splat_f32s(1.0)))
}

/// Whole numbers between 0 and 2^22 as u32.
#[inline(always)]
pub(super) fn to_u32<S: PulpSimd>(s: S, a: S::f32s) -> S::u32s {
    let bits = s.transmute_u32s_f32s(s.add_f32s(a, s.splat_f32s(WHOLE_NUMBERS)));
    s.and_u32s(bits, s.splat_u32s(0x007F_FFFF))
}
