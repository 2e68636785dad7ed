//! Operations that differ between processors and that `pulp` has no common name for.

use super::MAX_LANES;
use super::compress::compress_eight;
use pulp::Simd as PulpSimd;

/// Transposes every 4 x 4 block of lanes by three kinds of instructions of `$s`.
#[cfg(target_arch = "x86_64")]
macro_rules! transpose_fours {
    ($s:expr, $rows:ident, $low:ident, $high:ident, $shuffle:ident) => {{
        let (mut pairs, mut out) = ($rows, $rows);
        // Interleaves vectors 2i and 2i + 1: lanes 0 and 1 of each group of four, then lanes 2 and 3.
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

/// Operations with a default that all processors support, and faster ones for some.
pub(super) trait Processor: PulpSimd {
    /// `1 / a`: where the processor has an estimate, one step of Newton's method improves it.
    #[inline(always)]
    fn reciprocal(self, a: Self::f32s) -> Self::f32s {
        self.div_f32s(self.splat_f32s(1.0), a)
    }

    /// The mask as an integer with one bit for each lane, the lowest bit for the first.
    #[inline(always)]
    fn bitmask(self, a: Self::m32s) -> u32 {
        let ones = [self.select_f32s(a, self.splat_f32s(1.0), self.splat_f32s(0.0))];
        let lanes: &[f32] = pulp::bytemuck::cast_slice(&ones);
        lanes.iter().enumerate().fold(0, |bits, (i, one)| bits | u32::from(*one > 0.0) << i)
    }

    /// [`Simd::compress`](super::Simd::compress); the default is for up to eight lanes.
    #[inline(always)]
    fn compress<const N: usize>(self, a: [Self::m32s; N], first: u8, indices: &mut [u8]) -> usize {
        const { assert!(N * Self::F32_LANES <= 8) };
        let mut bits = 0;
        for k in 0..N {
            bits |= self.bitmask(a[k]) << (k * Self::F32_LANES);
        }
        compress_eight(bits as u8, first, indices)
    }

    /// `a` where the mask is true, else zero.
    #[inline(always)]
    fn select_or_zero(self, mask: Self::m32s, a: Self::f32s) -> Self::f32s {
        self.select_f32s(mask, a, self.splat_f32s(0.0))
    }

    /// Approximate square root of positive numbers, with a relative error below 4e-4.
    #[inline(always)]
    fn sqrt_approx(self, a: Self::f32s) -> Self::f32s {
        self.sqrt_f32s(a)
    }

    /// The lower halves of `a` and `b` as one vector, and the upper halves as another.
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

    /// [`Simd::deinterleave_quarters`](super::Simd::deinterleave_quarters); the default is for eight lanes.
    #[inline(always)]
    fn deinterleave_quarters<const N: usize>(
        self,
        a: [Self::f32s; N],
        b: [Self::f32s; N],
    ) -> [[Self::f32s; N]; 2] {
        [a, b]
    }

    /// [`Simd::load_eights`](super::Simd::load_eights); the default is for eight lanes.
    #[inline(always)]
    fn load_eights<const N: usize>(self, [first, _]: [&[f32; 8]; 2]) -> [Self::f32s; N] {
        first_registers(self, first)
    }

    /// Writes the lanes to the places from which [`Processor::load_eights`] reads them.
    #[inline(always)]
    fn store_eights<const N: usize>(self, a: [Self::f32s; N], [first, _]: [&mut [f32; 8]; 2]) {
        first.copy_from_slice(pulp::bytemuck::cast_slice(&a));
    }

    /// Transposes every 4 x 4 block of lanes ([`Simd::transpose_fours`](super::Simd::transpose_fours)).
    #[inline(always)]
    fn transpose_fours<const N: usize>(self, rows: [[Self::f32s; N]; 4]) -> [[Self::f32s; N]; 4] {
        let mut out = rows;
        for j in 0..4 {
            let row: &[f32] = pulp::bytemuck::cast_slice(&rows[j]);
            for k in 0..4 {
                let transposed: &mut [f32] = pulp::bytemuck::cast_slice_mut(&mut out[k]);
                for first in (0..row.len()).step_by(4) {
                    transposed[first + j] = row[first + k];
                }
            }
        }
        out
    }

    /// Exchanges, in every group of eight lanes, the upper four of `a` with the lower four of `b`.
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

    /// Transposes every 8 x 8 block of lanes ([`Simd::transpose_eights`](super::Simd::transpose_eights)).
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

    /// Improves an estimate of `1 / a` by one step of Newton's method.
    #[inline(always)]
    fn refined_reciprocal(self, estimate: Self::f32s, a: Self::f32s) -> Self::f32s {
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
        self.refined_reciprocal(pulp::cast(self.avx._mm256_rcp_ps(pulp::cast(a))), a)
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
        transpose_fours!(self.avx, rows, _mm256_unpacklo_ps, _mm256_unpackhi_ps, _mm256_shuffle_ps)
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
        self.refined_reciprocal(pulp::cast(self.avx512f._mm512_rcp14_ps(pulp::cast(a))), a)
    }
    #[inline(always)]
    fn bitmask(self, a: Self::m32s) -> u32 {
        u32::from(a.0)
    }
    #[inline(always)]
    fn compress<const N: usize>(self, a: [Self::m32s; N], first: u8, indices: &mut [u8]) -> usize {
        const { assert!(N == 1) };
        let count = pulp::u32x16(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        let vector = self.add_u32s(self.splat_u32s(first.into()), count);
        let listed = self.avx512f._mm512_maskz_compress_epi32(a[0].0, pulp::cast(vector));
        let bytes: [u8; MAX_LANES] = pulp::cast(self.avx512f._mm512_cvtepi32_epi8(listed));
        indices[..MAX_LANES].copy_from_slice(&bytes);
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
    fn deinterleave_quarters<const N: usize>(
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
        transpose_fours!(self.avx512f, rows, _mm512_unpacklo_ps, _mm512_unpackhi_ps, _mm512_shuffle_ps)
    }
    #[inline(always)]
    fn exchange_fours<const N: usize>(self, a: [Self::f32s; N], b: [Self::f32s; N]) -> [[Self::f32s; N]; 2] {
        const { assert!(N == 1) };
        let (a, b) = (pulp::cast(a[0]), pulp::cast(b[0]));
        // Groups of four lanes 0 and 2 of both vectors, then groups 1 and 3.
        let even = pulp::cast(pulp::u64x8(0, 1, 8, 9, 4, 5, 12, 13));
        let odd = pulp::cast(pulp::u64x8(2, 3, 10, 11, 6, 7, 14, 15));
        [
            [pulp::cast(self.avx512f._mm512_permutex2var_pd(a, even, b)); N],
            [pulp::cast(self.avx512f._mm512_permutex2var_pd(a, odd, b)); N],
        ]
    }
}

/// `N` registers from the start of a slice.
#[inline(always)]
fn first_registers<S: PulpSimd, const N: usize>(_: S, lanes: &[f32]) -> [S::f32s; N] {
    let registers = S::as_simd_f32s(lanes).0;
    let mut out = [registers[0]; N];
    out.copy_from_slice(&registers[..N]);
    out
}

/// A register from the start of a slice.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn first_of<R: pulp::bytemuck::Pod>(slice: &[f32]) -> R {
    pulp::bytemuck::cast_slice(&slice[..size_of::<R>() / size_of::<f32>()])[0]
}
