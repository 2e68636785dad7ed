//! Simd of f32 in the processor's registers.

use super::{MAX_LANES, Simd, SimdKernel, SimdReal, compress_eight};
use pulp::Simd as PulpSimd;

/// `N` registers of f32.
#[derive(Clone, Copy)]
pub(super) struct Registers<S, const N: usize>(pub(super) S);

impl SimdReal for f32 {
    #[inline]
    fn dispatch(kernel: impl SimdKernel<f32>) {
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

impl<S: Processor, K: SimdKernel<f32>, const N: usize> pulp::NullaryFnOnce for Compiled<S, K, N> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        self.1.run(Registers::<S, N>(self.0));
    }
}

/// Of every four lanes, lane `j` of row `k` and lane `k` of row `j` exchanged, by three of `$s`'s instructions.
#[cfg(target_arch = "x86_64")]
macro_rules! turn_fours {
    ($s:expr, $rows:ident, $low:ident, $high:ident, $shuffle:ident) => {{
        let (mut pairs, mut out) = ($rows, $rows);
        // Rows 2i and 2i + 1 in turns: lanes 0 and 1 of each four, then lanes 2 and 3.
        for i in 0..2 {
            let (x, y) = (pulp::cast($rows[2 * i][0]), pulp::cast($rows[2 * i + 1][0]));
            pairs[i] = [pulp::cast($s.$low(x, y)); N];
            pairs[2 + i] = [pulp::cast($s.$high(x, y)); N];
        }
        for k in 0..2 {
            let (x, y) = (pulp::cast(pairs[2 * k][0]), pulp::cast(pairs[2 * k + 1][0]));
            out[2 * k] = [pulp::cast($s.$shuffle::<0b01_00_01_00>(x, y)); N];
            out[2 * k + 1] = [pulp::cast($s.$shuffle::<0b11_10_11_10>(x, y)); N];
        }
        out
    }};
}

/// What `pulp` has no common name for.
pub(super) trait Processor: PulpSimd {
    /// `1 / a`, from the processor's estimate where it has one, by a step of Newton's.
    #[inline(always)]
    fn reciprocal(self, a: Self::f32s) -> Self::f32s {
        self.div_f32s(self.splat_f32s(1.0), a)
    }

    /// As bits, the first lane lowest.
    #[inline(always)]
    fn bitmask(self, a: Self::m32s) -> u32 {
        let ones = [self.select_f32s(a, self.splat_f32s(1.0), self.splat_f32s(0.0))];
        let lanes: &[f32] = pulp::bytemuck::cast_slice(&ones);
        lanes.iter().enumerate().fold(0, |bits, (i, one)| bits | u32::from(*one > 0.0) << i)
    }

    /// [`Simd::compress`], of up to eight lanes.
    #[inline(always)]
    fn compress<const N: usize>(self, a: [Self::m32s; N], first: u8, places: &mut [u8]) -> usize {
        const { assert!(N * Self::F32_LANES <= 8) };
        let mut bits = 0;
        for k in 0..N {
            bits |= self.bitmask(a[k]) << (k * Self::F32_LANES);
        }
        compress_eight(bits as u8, first, places)
    }

    /// `a` where it holds, else zero.
    #[inline(always)]
    fn select_or_zero(self, mask: Self::m32s, a: Self::f32s) -> Self::f32s {
        self.select_f32s(mask, a, self.splat_f32s(0.0))
    }

    /// Square root of positive numbers, relative error below 4e-4.
    #[inline(always)]
    fn sqrt_approx(self, a: Self::f32s) -> Self::f32s {
        self.sqrt_f32s(a)
    }

    /// The lower halves of both, and the upper halves.
    #[inline(always)]
    fn concat_halves<const N: usize>(self, a: [Self::f32s; N], b: [Self::f32s; N]) -> [[Self::f32s; N]; 2] {
        let mut out = [a, b];
        let (a, b): (&[f32], &[f32]) = (pulp::bytemuck::cast_slice(&a), pulp::bytemuck::cast_slice(&b));
        let half = a.len() / 2;
        for (k, out) in out.iter_mut().enumerate() {
            let (first, second) = pulp::bytemuck::cast_slice_mut(out).split_at_mut(half);
            first.copy_from_slice(&a[k * half..][..half]);
            second.copy_from_slice(&b[k * half..][..half]);
        }
        out
    }

    /// Of sixteen lanes the first and third four of both, and the second and fourth.
    #[inline(always)]
    fn interleave_quarters<const N: usize>(
        self,
        a: [Self::f32s; N],
        b: [Self::f32s; N],
    ) -> [[Self::f32s; N]; 2] {
        [a, b]
    }

    /// Eight lanes from each array, as far as `N` registers go.
    #[inline(always)]
    fn load_eights<const N: usize>(self, [first, _]: [&[f32; 8]; 2]) -> [Self::f32s; N] {
        first_registers(self, first)
    }

    /// What [`Processor::load_eights`] reads.
    #[inline(always)]
    fn store_eights<const N: usize>(self, a: [Self::f32s; N], [first, _]: [&mut [f32; 8]; 2]) {
        first.copy_from_slice(pulp::bytemuck::cast_slice(&a));
    }

    /// Of every four lanes, lane `j` of row `k` and lane `k` of row `j` exchanged.
    #[inline(always)]
    fn transpose_fours<const N: usize>(self, rows: [[Self::f32s; N]; 4]) -> [[Self::f32s; N]; 4] {
        let mut out = rows;
        for j in 0..4 {
            let row: &[f32] = pulp::bytemuck::cast_slice(&rows[j]);
            for k in 0..4 {
                let turned: &mut [f32] = pulp::bytemuck::cast_slice_mut(&mut out[k]);
                for first in (0..row.len()).step_by(4) {
                    turned[first + j] = row[first + k];
                }
            }
        }
        out
    }

    /// Of every eight lanes, the upper four of `a` and the lower four of `b` exchanged.
    #[inline(always)]
    fn exchange_fours<const N: usize>(self, a: [Self::f32s; N], b: [Self::f32s; N]) -> [[Self::f32s; N]; 2] {
        let mut out = [a, b];
        let (a, b): (&[f32], &[f32]) = (pulp::bytemuck::cast_slice(&a), pulp::bytemuck::cast_slice(&b));
        for first in (0..a.len()).step_by(8) {
            let lower: &mut [f32] = pulp::bytemuck::cast_slice_mut(&mut out[0]);
            lower[first + 4..][..4].copy_from_slice(&b[first..][..4]);
            let upper: &mut [f32] = pulp::bytemuck::cast_slice_mut(&mut out[1]);
            upper[first..][..4].copy_from_slice(&a[first + 4..][..4]);
        }
        out
    }

    /// Of every eight lanes, lane `j` of row `k` and lane `k` of row `j` exchanged.
    #[inline(always)]
    fn transpose_eights<const N: usize>(self, rows: [[Self::f32s; N]; 8]) -> [[Self::f32s; N]; 8] {
        let low = self.transpose_fours([rows[0], rows[1], rows[2], rows[3]]);
        let high = self.transpose_fours([rows[4], rows[5], rows[6], rows[7]]);
        let mut out = rows;
        for k in 0..4 {
            [out[k], out[4 + k]] = self.exchange_fours(low[k], high[k]);
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
    fn bitmask(self, a: Self::m32s) -> u32 {
        self.avx._mm256_movemask_ps(pulp::cast(a)) as u32
    }
    #[inline(always)]
    fn sqrt_approx(self, a: Self::f32s) -> Self::f32s {
        self.mul_f32s(a, pulp::cast(self.avx._mm256_rsqrt_ps(pulp::cast(a))))
    }
    #[inline(always)]
    fn select_or_zero(self, mask: Self::m32s, a: Self::f32s) -> Self::f32s {
        pulp::cast(self.avx._mm256_and_ps(pulp::cast(mask), pulp::cast(a)))
    }
    #[inline(always)]
    fn concat_halves<const N: usize>(self, a: [Self::f32s; N], b: [Self::f32s; N]) -> [[Self::f32s; N]; 2] {
        const { assert!(N == 1) };
        let (a, b) = (pulp::cast(a[0]), pulp::cast(b[0]));
        [
            [pulp::cast(self.avx._mm256_permute2f128_ps::<0x20>(a, b)); N],
            [pulp::cast(self.avx._mm256_permute2f128_ps::<0x31>(a, b)); N],
        ]
    }
    #[inline(always)]
    fn transpose_fours<const N: usize>(self, rows: [[Self::f32s; N]; 4]) -> [[Self::f32s; N]; 4] {
        const { assert!(N == 1) };
        turn_fours!(self.avx, rows, _mm256_unpacklo_ps, _mm256_unpackhi_ps, _mm256_shuffle_ps)
    }
    #[inline(always)]
    fn exchange_fours<const N: usize>(self, a: [Self::f32s; N], b: [Self::f32s; N]) -> [[Self::f32s; N]; 2] {
        self.concat_halves(a, b)
    }
}

#[cfg(target_arch = "x86_64")]
impl Processor for pulp::x86::V4 {
    #[inline(always)]
    fn reciprocal(self, a: Self::f32s) -> Self::f32s {
        self.refine(pulp::cast(self.avx512f._mm512_rcp14_ps(pulp::cast(a))), a)
    }
    #[inline(always)]
    fn bitmask(self, a: Self::m32s) -> u32 {
        u32::from(a.0)
    }
    #[inline(always)]
    fn compress<const N: usize>(self, a: [Self::m32s; N], first: u8, places: &mut [u8]) -> usize {
        const { assert!(N == 1) };
        let count = pulp::u32x16(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        let vector = self.add_u32s(self.splat_u32s(first.into()), count);
        let listed = self.avx512f._mm512_maskz_compress_epi32(a[0].0, pulp::cast(vector));
        let bytes: [u8; MAX_LANES] = pulp::cast(self.avx512f._mm512_cvtepi32_epi8(listed));
        places[..MAX_LANES].copy_from_slice(&bytes);
        a[0].0.count_ones() as usize
    }
    #[inline(always)]
    fn sqrt_approx(self, a: Self::f32s) -> Self::f32s {
        self.mul_f32s(a, pulp::cast(self.avx512f._mm512_rsqrt14_ps(pulp::cast(a))))
    }
    #[inline(always)]
    fn concat_halves<const N: usize>(self, a: [Self::f32s; N], b: [Self::f32s; N]) -> [[Self::f32s; N]; 2] {
        const { assert!(N == 1) };
        let (a, b) = (pulp::cast(a[0]), pulp::cast(b[0]));
        [
            [pulp::cast(self.avx512f._mm512_shuffle_f32x4::<0b01_00_01_00>(a, b)); N],
            [pulp::cast(self.avx512f._mm512_shuffle_f32x4::<0b11_10_11_10>(a, b)); N],
        ]
    }
    #[inline(always)]
    fn interleave_quarters<const N: usize>(
        self,
        a: [Self::f32s; N],
        b: [Self::f32s; N],
    ) -> [[Self::f32s; N]; 2] {
        const { assert!(N == 1) };
        let (a, b) = (pulp::cast(a[0]), pulp::cast(b[0]));
        [
            [pulp::cast(self.avx512f._mm512_shuffle_f32x4::<0b10_00_10_00>(a, b)); N],
            [pulp::cast(self.avx512f._mm512_shuffle_f32x4::<0b11_01_11_01>(a, b)); N],
        ]
    }
    #[inline(always)]
    fn load_eights<const N: usize>(self, eights: [&[f32; 8]; 2]) -> [Self::f32s; N] {
        const { assert!(N == 1) };
        let low = self.avx512f._mm512_castpd256_pd512(pulp::cast(first_of::<pulp::f32x8>(eights[0])));
        let high = pulp::cast(first_of::<pulp::f32x8>(eights[1]));
        [pulp::cast(self.avx512f._mm512_insertf64x4::<1>(low, high)); N]
    }
    #[inline(always)]
    fn store_eights<const N: usize>(self, a: [Self::f32s; N], eights: [&mut [f32; 8]; 2]) {
        const { assert!(N == 1) };
        let lanes: &[f32] = pulp::bytemuck::cast_slice(&a);
        for (eight, lanes) in eights.into_iter().zip(lanes.chunks(8)) {
            eight.copy_from_slice(lanes);
        }
    }
    #[inline(always)]
    fn transpose_fours<const N: usize>(self, rows: [[Self::f32s; N]; 4]) -> [[Self::f32s; N]; 4] {
        const { assert!(N == 1) };
        turn_fours!(self.avx512f, rows, _mm512_unpacklo_ps, _mm512_unpackhi_ps, _mm512_shuffle_ps)
    }
    #[inline(always)]
    fn exchange_fours<const N: usize>(self, a: [Self::f32s; N], b: [Self::f32s; N]) -> [[Self::f32s; N]; 2] {
        const { assert!(N == 1) };
        let (a, b) = (pulp::cast(a[0]), pulp::cast(b[0]));
        // Quarters 0 and 2 of both, then quarters 1 and 3.
        let even = pulp::cast(pulp::u64x8(0, 1, 8, 9, 4, 5, 12, 13));
        let odd = pulp::cast(pulp::u64x8(2, 3, 10, 11, 6, 7, 14, 15));
        [
            [pulp::cast(self.avx512f._mm512_permutex2var_pd(a, even, b)); N],
            [pulp::cast(self.avx512f._mm512_permutex2var_pd(a, odd, b)); N],
        ]
    }
}

/// Registers from the first of these lanes.
#[inline(always)]
fn first_registers<S: PulpSimd, const N: usize>(_: S, lanes: &[f32]) -> [S::f32s; N] {
    let registers = S::as_simd_f32s(lanes).0;
    let mut out = [registers[0]; N];
    out.copy_from_slice(&registers[..N]);
    out
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

impl<S: Processor, const N: usize> Simd for Registers<S, N> {
    const WIDTH: usize = N * S::F32_LANES;
    type Scalar = f32;
    type Vector = [S::f32s; N];
    type Mask = [S::m32s; N];

    #[inline(always)]
    fn broadcast(self, value: f32) -> Self::Vector {
        [self.0.splat_f32s(value); N]
    }
    #[inline(always)]
    fn load(self, values: &[f32]) -> Self::Vector {
        let registers = S::as_simd_f32s(&values[..Self::WIDTH]).0;
        each!(k: registers[k])
    }
    #[inline(always)]
    fn store(self, a: Self::Vector, places: &mut [f32]) {
        S::as_mut_simd_f32s(&mut places[..Self::WIDTH]).0.copy_from_slice(&a);
    }
    #[inline(always)]
    fn concat_halves(self, a: Self::Vector, b: Self::Vector) -> [Self::Vector; 2] {
        self.0.concat_halves(a, b)
    }
    #[inline(always)]
    fn interleave_quarters(self, a: Self::Vector, b: Self::Vector) -> [Self::Vector; 2] {
        self.0.interleave_quarters(a, b)
    }
    #[inline(always)]
    fn load_eights(self, eights: [&[f32; 8]; 2]) -> Self::Vector {
        self.0.load_eights(eights)
    }
    #[inline(always)]
    fn store_eights(self, a: Self::Vector, eights: [&mut [f32; 8]; 2]) {
        self.0.store_eights(a, eights);
    }
    #[inline(always)]
    fn transpose_fours(self, rows: [Self::Vector; 4]) -> [Self::Vector; 4] {
        self.0.transpose_fours(rows)
    }
    #[inline(always)]
    fn transpose_eights(self, rows: [Self::Vector; 8]) -> [Self::Vector; 8] {
        self.0.transpose_eights(rows)
    }
    #[inline(always)]
    fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.add_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn sub(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.sub_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn mul(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.mul_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn div(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.div_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn reciprocal(self, a: Self::Vector) -> Self::Vector {
        each!(k: self.0.reciprocal(a[k]))
    }
    #[inline(always)]
    fn mul_add(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector {
        each!(k: self.0.mul_add_e_f32s(a[k], b[k], c[k]))
    }
    #[inline(always)]
    fn min(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.min_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn max(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.max_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn sqrt(self, a: Self::Vector) -> Self::Vector {
        each!(k: self.0.sqrt_f32s(a[k]))
    }
    #[inline(always)]
    fn sqrt_approx(self, a: Self::Vector) -> Self::Vector {
        each!(k: self.0.sqrt_approx(a[k]))
    }
    #[inline(always)]
    fn exp2(self, a: Self::Vector, constants: &[Self::Vector; 7]) -> Self::Vector {
        each!(k: exp2(self.0, a[k], std::array::from_fn(|c| constants[c][k])))
    }
    #[inline(always)]
    fn log2(self, a: Self::Vector) -> Self::Vector {
        each!(k: log2(self.0, a[k]))
    }
    #[inline(always)]
    fn sum(self, a: Self::Vector) -> f32 {
        let mut sum = a[0];
        for k in 1..N {
            sum = self.0.add_f32s(sum, a[k]);
        }
        self.0.reduce_sum_f32s(sum)
    }
    #[inline(always)]
    fn floor(self, a: Self::Vector) -> Self::Vector {
        each!(k: floor(self.0, a[k]))
    }
    #[inline(always)]
    fn store_whole(self, a: Self::Vector, places: &mut [u32; MAX_LANES]) {
        let places = S::as_mut_simd_u32s(&mut places[..Self::WIDTH]).0;
        for k in 0..N {
            places[k] = whole(self.0, a[k]);
        }
    }
    #[inline(always)]
    fn greater_equal(self, a: Self::Vector, b: Self::Vector) -> Self::Mask {
        each!(k: self.0.greater_than_or_equal_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn greater_than(self, a: Self::Vector, b: Self::Vector) -> Self::Mask {
        each!(k: self.0.greater_than_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        each!(k: self.0.and_m32s(a[k], b[k]))
    }
    #[inline(always)]
    fn compress(self, a: Self::Mask, first: u8, places: &mut [u8]) -> usize {
        self.0.compress(a, first, places)
    }
    #[inline(always)]
    fn bitmask(self, a: Self::Mask) -> u32 {
        let mut bits = 0;
        for k in 0..N {
            bits |= self.0.bitmask(a[k]) << (k * S::F32_LANES);
        }
        bits
    }
    #[inline(always)]
    fn select_or_zero(self, mask: Self::Mask, a: Self::Vector) -> Self::Vector {
        each!(k: self.0.select_or_zero(mask[k], a[k]))
    }
}

/// Two to a power, relative error below 3e-7: the nearest whole power by the exponent bits, the rest by a polynomial.
#[inline(always)]
fn exp2<S: PulpSimd>(s: S, a: S::f32s, [round, c0, c1, c2, c3, c4, c5]: [S::f32s; 7]) -> S::f32s {
    // Adding 1.5 * 2^23 rounds to a whole number, which then stands in the low bits.
    let shifted = s.add_f32s(a, round);
    let f = s.sub_f32s(a, s.sub_f32s(shifted, round));
    // In pairs, which do not wait for each other (Estrin).
    let square = s.mul_f32s(f, f);
    let (low, middle) = (s.mul_add_e_f32s(c1, f, c0), s.mul_add_e_f32s(c3, f, c2));
    let high = s.mul_add_e_f32s(c5, f, c4);
    let p = s.mul_add_e_f32s(s.mul_add_e_f32s(high, square, middle), square, low);
    let power = s.wrapping_dyn_shl_u32s(s.transmute_u32s_f32s(shifted), s.splat_u32s(23));
    s.transmute_f32s_u32s(s.add_u32s(s.transmute_u32s_f32s(p), power))
}

/// Binary logarithm of positive normal numbers, error below 3e-7 or 3e-7 of it: the power by the exponent bits, the
/// mantissa `m` in [√½, √2] by the series of the inverse hyperbolic tangent of `(m - 1) / (m + 1)`.
#[inline(always)]
fn log2<S: PulpSimd>(s: S, a: S::f32s) -> S::f32s {
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
    s.sub_f32s(nearest, s.select_or_zero(s.greater_than_f32s(nearest, a), s.splat_f32s(1.0)))
}

/// Whole numbers between 0 and 2^22, as such.
#[inline(always)]
fn whole<S: PulpSimd>(s: S, a: S::f32s) -> S::u32s {
    let bits = s.transmute_u32s_f32s(s.add_f32s(a, s.splat_f32s(ONES)));
    s.and_u32s(bits, s.splat_u32s(0x007F_FFFF))
}
