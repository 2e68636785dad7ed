//! Lanes of f32 in the processor's registers.

use super::{Kernel, LANES, Lanes, Lanewise};
use pulp::Simd;

/// `N` registers of f32.
#[derive(Clone, Copy)]
pub(super) struct Registers<S, const N: usize>(pub(super) S);

impl Lanewise for f32 {
    #[inline]
    fn dispatch(kernel: impl Kernel<f32>) {
        match pulp::Arch::new() {
            #[cfg(target_arch = "x86_64")]
            pulp::Arch::V4(s) => s.vectorize(Compiled::<_, _, 1>(s, kernel)),
            #[cfg(target_arch = "x86_64")]
            pulp::Arch::V3(s) => s.vectorize(Compiled::<_, _, 1>(s, kernel)),
            #[cfg(target_arch = "aarch64")]
            pulp::Arch::Neon(s) => s.vectorize(Compiled::<_, _, 2>(s, kernel)),
            _ => kernel.run(Registers::<_, 8>(pulp::Scalar::new())),
        }
    }
}

/// A kernel within the instructions' reach.
pub(super) struct Compiled<S, K, const N: usize>(pub(super) S, pub(super) K);

impl<S: Processor, K: Kernel<f32>, const N: usize> pulp::NullaryFnOnce for Compiled<S, K, N> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        self.1.run(Registers::<S, N>(self.0));
    }
}

/// What `pulp` has no common name for.
pub(super) trait Processor: Simd {
    /// `1 / a`, from the processor's estimate where it has one, by a step of Newton's.
    #[inline(always)]
    fn reciprocal(self, a: Self::f32s) -> Self::f32s {
        self.div_f32s(self.splat_f32s(1.0), a)
    }

    /// As bits, the first lane lowest.
    #[inline(always)]
    fn bits(self, a: Self::m32s) -> u32 {
        let ones = [self.select_f32s(a, self.splat_f32s(1.0), self.splat_f32s(0.0))];
        let lanes: &[f32] = pulp::bytemuck::cast_slice(&ones);
        lanes.iter().enumerate().fold(0, |bits, (i, one)| bits | u32::from(*one > 0.0) << i)
    }

    /// `a` where it holds, else zero.
    #[inline(always)]
    fn keep(self, truths: Self::m32s, a: Self::f32s) -> Self::f32s {
        self.select_f32s(truths, a, self.splat_f32s(0.0))
    }

    /// Half of the lanes from the first of `low`, half from the first of `high`.
    #[inline(always)]
    fn load_halves(self, low: &[f32], high: &[f32]) -> Self::f32s {
        let half = Self::F32_LANES / 2;
        let mut values = [0.0; LANES];
        values[..half].copy_from_slice(&low[..half]);
        values[half..2 * half].copy_from_slice(&high[..half]);
        Self::as_simd_f32s(&values[..Self::F32_LANES]).0[0]
    }

    /// What [`Processor::load_halves`] reads.
    #[inline(always)]
    fn store_halves(self, a: Self::f32s, low: &mut [f32], high: &mut [f32]) {
        let half = Self::F32_LANES / 2;
        let values = [a];
        let values: &[f32] = pulp::bytemuck::cast_slice(&values);
        low[..half].copy_from_slice(&values[..half]);
        high[..half].copy_from_slice(&values[half..]);
    }

    /// Square root of positive numbers, relative error below 4e-4.
    #[inline(always)]
    fn rough_sqrt(self, a: Self::f32s) -> Self::f32s {
        self.sqrt_f32s(a)
    }

    /// The sum of each row's lanes.
    #[inline(always)]
    fn sums<const C: usize>(self, rows: [Self::f32s; C]) -> [f32; C] {
        let mut out = [0.0; C];
        for c in 0..C {
            out[c] = self.reduce_sum_f32s(rows[c]);
        }
        out
    }

    #[inline(always)]
    fn refine(self, estimate: Self::f32s, a: Self::f32s) -> Self::f32s {
        let error = self.negate_mul_add_e_f32s(estimate, a, self.splat_f32s(1.0));
        self.mul_add_e_f32s(estimate, error, estimate)
    }
}

impl Processor for pulp::Scalar {}

#[cfg(target_arch = "aarch64")]
impl Processor for pulp::aarch64::Neon {}

#[cfg(target_arch = "x86_64")]
impl Processor for pulp::x86::V3 {
    #[inline(always)]
    fn reciprocal(self, a: Self::f32s) -> Self::f32s {
        self.refine(pulp::cast(self.avx._mm256_rcp_ps(pulp::cast(a))), a)
    }
    #[inline(always)]
    fn bits(self, a: Self::m32s) -> u32 {
        self.avx._mm256_movemask_ps(pulp::cast(a)) as u32
    }
    // A register that is written in two parts and read at once would wait for both to reach the cache.
    #[inline(always)]
    fn load_halves(self, low: &[f32], high: &[f32]) -> Self::f32s {
        let low = self.avx._mm256_castps128_ps256(pulp::cast(first_of::<pulp::f32x4>(low)));
        pulp::cast(self.avx._mm256_insertf128_ps::<1>(low, pulp::cast(first_of::<pulp::f32x4>(high))))
    }
    #[inline(always)]
    fn rough_sqrt(self, a: Self::f32s) -> Self::f32s {
        self.mul_f32s(a, pulp::cast(self.avx._mm256_rsqrt_ps(pulp::cast(a))))
    }
    #[inline(always)]
    fn keep(self, truths: Self::m32s, a: Self::f32s) -> Self::f32s {
        pulp::cast(self.avx._mm256_and_ps(pulp::cast(truths), pulp::cast(a)))
    }
}

#[cfg(target_arch = "x86_64")]
impl Processor for pulp::x86::V4 {
    #[inline(always)]
    fn reciprocal(self, a: Self::f32s) -> Self::f32s {
        self.refine(pulp::cast(self.avx512f._mm512_rcp14_ps(pulp::cast(a))), a)
    }
    #[inline(always)]
    fn bits(self, a: Self::m32s) -> u32 {
        u32::from(a.0)
    }
    #[inline(always)]
    fn load_halves(self, low: &[f32], high: &[f32]) -> Self::f32s {
        let low = self.avx512f._mm512_castpd256_pd512(pulp::cast(first_of::<pulp::f32x8>(low)));
        pulp::cast(self.avx512f._mm512_insertf64x4::<1>(low, pulp::cast(first_of::<pulp::f32x8>(high))))
    }
    #[inline(always)]
    fn rough_sqrt(self, a: Self::f32s) -> Self::f32s {
        self.mul_f32s(a, pulp::cast(self.avx512f._mm512_rsqrt14_ps(pulp::cast(a))))
    }
    /// Rows are folded two by two, so that half as many shuffles do.
    #[inline(always)]
    fn sums<const C: usize>(self, rows: [Self::f32s; C]) -> [f32; C] {
        const { assert!(C <= LANES) };
        let s = self.avx512f;
        let mut parts = [self.splat_f32s(0.0); LANES];
        parts[..C].copy_from_slice(&rows);
        // Row 2i in the lower half, row 2i + 1 in the upper one; what stands beyond the last row does not matter.
        for i in 0..C.div_ceil(2) {
            let (x, y) = (pulp::cast(parts[2 * i]), pulp::cast(parts[2 * i + 1]));
            let low = s._mm512_insertf64x4::<1>(x, s._mm512_castpd512_pd256(y));
            let high = s._mm512_shuffle_f64x2::<0b11_10_11_10>(x, y);
            parts[i] = self.add_f32s(pulp::cast(low), pulp::cast(high));
        }
        // Rows 4i to 4i + 3 in a quarter each.
        for i in 0..C.div_ceil(4) {
            let (x, y) = (pulp::cast(parts[2 * i]), pulp::cast(parts[2 * i + 1]));
            let even = s._mm512_shuffle_f32x4::<0b10_00_10_00>(x, y);
            let odd = s._mm512_shuffle_f32x4::<0b11_01_11_01>(x, y);
            parts[i] = self.add_f32s(pulp::cast(even), pulp::cast(odd));
        }
        // Within quarter q rows q, q + 4, ...: two numbers of each, then one.
        for rows in [8, 16] {
            for i in 0..C.div_ceil(rows) {
                let (x, y) = (pulp::cast(parts[2 * i]), pulp::cast(parts[2 * i + 1]));
                let even = s._mm512_shuffle_ps::<0b10_00_10_00>(x, y);
                let odd = s._mm512_shuffle_ps::<0b11_01_11_01>(x, y);
                parts[i] = self.add_f32s(pulp::cast(even), pulp::cast(odd));
            }
        }
        let sums = [parts[0]];
        let sums: &[f32] = pulp::bytemuck::cast_slice(&sums);
        let mut out = [0.0; C];
        for c in 0..C {
            out[c] = sums[c % 4 * 4 + c / 4];
        }
        out
    }
}

/// The first numbers of a slice.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn first_of<R: pulp::bytemuck::Pod>(slice: &[f32]) -> R {
    pulp::bytemuck::cast_slice(&slice[..size_of::<R>() / size_of::<f32>()])[0]
}

/// An array of a value for every register `k`. Closures would stand outside the instructions' reach.
macro_rules! each {
    ($k:ident: $value:expr) => {{
        let $k = 0;
        let mut out = [$value; N];
        for $k in 1..N {
            out[$k] = $value;
        }
        out
    }};
}

impl<S: Processor, const N: usize> Lanes for Registers<S, N> {
    const WIDTH: usize = N * S::F32_LANES;
    type Number = f32;
    type Numbers = [S::f32s; N];
    type Truths = [S::m32s; N];

    #[inline(always)]
    fn splat(self, value: f32) -> Self::Numbers {
        [self.0.splat_f32s(value); N]
    }
    #[inline(always)]
    fn load(self, values: &[f32]) -> Self::Numbers {
        let registers = S::as_simd_f32s(&values[..Self::WIDTH]).0;
        each!(k: registers[k])
    }
    #[inline(always)]
    fn store(self, a: Self::Numbers, places: &mut [f32]) {
        S::as_mut_simd_f32s(&mut places[..Self::WIDTH]).0.copy_from_slice(&a);
    }
    #[inline(always)]
    fn load_halves(self, low: &[f32], high: &[f32]) -> Self::Numbers {
        if N == 1 {
            return [self.0.load_halves(low, high); N];
        }
        let (low, high) = (S::as_simd_f32s(low).0, S::as_simd_f32s(high).0);
        each!(k: if k < N / 2 { low[k] } else { high[k - N / 2] })
    }
    #[inline(always)]
    fn store_halves(self, a: Self::Numbers, low: &mut [f32], high: &mut [f32]) {
        if N == 1 {
            return self.0.store_halves(a[0], low, high);
        }
        S::as_mut_simd_f32s(low).0[..N / 2].copy_from_slice(&a[..N / 2]);
        S::as_mut_simd_f32s(high).0[..N / 2].copy_from_slice(&a[N / 2..]);
    }
    #[inline(always)]
    fn add(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.add_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn sub(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.sub_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn mul(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.mul_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn div(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.div_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn reciprocal(self, a: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.reciprocal(a[k]))
    }
    #[inline(always)]
    fn mul_add(self, a: Self::Numbers, b: Self::Numbers, c: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.mul_add_e_f32s(a[k], b[k], c[k]))
    }
    #[inline(always)]
    fn min(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.min_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn max(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.max_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn sqrt(self, a: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.sqrt_f32s(a[k]))
    }
    #[inline(always)]
    fn rough_sqrt(self, a: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.rough_sqrt(a[k]))
    }
    #[inline(always)]
    fn exp2(self, a: Self::Numbers, constants: &[Self::Numbers; 7]) -> Self::Numbers {
        each!(k: exp2(self.0, a[k], std::array::from_fn(|c| constants[c][k])))
    }
    #[inline(always)]
    fn log2(self, a: Self::Numbers) -> Self::Numbers {
        each!(k: log2(self.0, a[k]))
    }
    #[inline(always)]
    fn sum(self, a: Self::Numbers) -> f32 {
        let mut sum = a[0];
        for k in 1..N {
            sum = self.0.add_f32s(sum, a[k]);
        }
        self.0.reduce_sum_f32s(sum)
    }
    #[inline(always)]
    fn sums<const C: usize>(self, rows: [Self::Numbers; C]) -> [f32; C] {
        let mut folded = [self.0.splat_f32s(0.0); C];
        for c in 0..C {
            folded[c] = rows[c][0];
            for k in 1..N {
                folded[c] = self.0.add_f32s(folded[c], rows[c][k]);
            }
        }
        self.0.sums(folded)
    }
    #[inline(always)]
    fn floor(self, a: Self::Numbers) -> Self::Numbers {
        each!(k: floor(self.0, a[k]))
    }
    #[inline(always)]
    fn store_whole(self, a: Self::Numbers, places: &mut [u32; LANES]) {
        let places = S::as_mut_simd_u32s(&mut places[..Self::WIDTH]).0;
        for k in 0..N {
            places[k] = whole(self.0, a[k]);
        }
    }
    #[inline(always)]
    fn at_least(self, a: Self::Numbers, b: Self::Numbers) -> Self::Truths {
        each!(k: self.0.greater_than_or_equal_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn above(self, a: Self::Numbers, b: Self::Numbers) -> Self::Truths {
        each!(k: self.0.greater_than_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn and(self, a: Self::Truths, b: Self::Truths) -> Self::Truths {
        each!(k: self.0.and_m32s(a[k], b[k]))
    }
    #[inline(always)]
    fn bits(self, a: Self::Truths) -> u32 {
        let mut bits = 0;
        for k in 0..N {
            bits |= self.0.bits(a[k]) << (k * S::F32_LANES);
        }
        bits
    }
    #[inline(always)]
    fn keep(self, truths: Self::Truths, a: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.keep(truths[k], a[k]))
    }
}

/// Two to a power, relative error below 3e-7: the nearest whole power by the exponent bits, the rest by a polynomial.
#[inline(always)]
fn exp2<S: Simd>(s: S, a: S::f32s, [round, c0, c1, c2, c3, c4, c5]: [S::f32s; 7]) -> S::f32s {
    // Adding 1.5 * 2^23 rounds to a whole number, which then stands in the low bits.
    let shifted = s.add_f32s(a, round);
    let f = s.sub_f32s(a, s.sub_f32s(shifted, round));
    let mut p = c5;
    for c in [c4, c3, c2, c1, c0] {
        p = s.mul_add_e_f32s(p, f, c);
    }
    let power = s.wrapping_dyn_shl_u32s(s.transmute_u32s_f32s(shifted), s.splat_u32s(23));
    s.transmute_f32s_u32s(s.add_u32s(s.transmute_u32s_f32s(p), power))
}

/// Binary logarithm of positive normal numbers, error below 3e-7 or 3e-7 of it: the power by the exponent bits, the
/// mantissa `m` in [√½, √2] by the series of the inverse hyperbolic tangent of `(m - 1) / (m + 1)`.
#[inline(always)]
fn log2<S: Simd>(s: S, a: S::f32s) -> S::f32s {
    const ROOT_HALF: u32 = std::f32::consts::FRAC_1_SQRT_2.to_bits();
    let bits = s.add_u32s(s.transmute_u32s_f32s(a), s.splat_u32s(1f32.to_bits() - ROOT_HALF));
    let power = s.wrapping_dyn_shr_u32s(bits, s.splat_u32s(23));
    let mantissa = s.add_u32s(s.and_u32s(bits, s.splat_u32s(0x007F_FFFF)), s.splat_u32s(ROOT_HALF));
    let m = s.transmute_f32s_u32s(mantissa);
    let whole = s.sub_f32s(
        s.transmute_f32s_u32s(s.or_u32s(power, s.splat_u32s(ONES.to_bits()))),
        s.splat_f32s(ONES + 127.0),
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

/// 2^23, whose last place is one.
const ONES: f32 = 8_388_608.0;

/// The whole part of numbers between 0 and 2^22: rounded to the nearest whole number, one less where that is more.
#[inline(always)]
fn floor<S: Processor>(s: S, a: S::f32s) -> S::f32s {
    let ones = s.splat_f32s(ONES);
    let nearest = s.sub_f32s(s.add_f32s(a, ones), ones);
    s.sub_f32s(nearest, s.keep(s.greater_than_f32s(nearest, a), s.splat_f32s(1.0)))
}

/// Whole numbers between 0 and 2^22, as such.
#[inline(always)]
fn whole<S: Simd>(s: S, a: S::f32s) -> S::u32s {
    let bits = s.transmute_u32s_f32s(s.add_f32s(a, s.splat_f32s(ONES)));
    s.and_u32s(bits, s.splat_u32s(0x007F_FFFF))
}
