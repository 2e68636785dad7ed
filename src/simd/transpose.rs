//! Transposition and rearrangement of the lanes of several vectors.

use super::vector::{SimdVec, from_raw, to_raw};
use super::{MAX_LANES, Simd};
use num_traits::Zero;

/// Transposes every 4 x 4 block: within each group of four lanes, lane `j` of vector `k` and lane `k` of
/// vector `j` change places.
#[inline(always)]
pub fn transpose_fours<S: Simd>(rows: [SimdVec<S>; 4]) -> [SimdVec<S>; 4] {
    let simd = rows[0].simd;
    from_raw(simd, simd.transpose_fours(to_raw(rows)))
}

/// Transposes every 8 x 8 block: within each group of eight lanes, lane `j` of vector `k` and lane `k` of
/// vector `j` change places.
#[inline(always)]
pub fn transpose_eights<S: Simd>(rows: [SimdVec<S>; 8]) -> [SimdVec<S>; 8] {
    let simd = rows[0].simd;
    from_raw(simd, simd.transpose_eights(to_raw(rows)))
}

/// Transposes eight vectors to one array for each lane, which holds the lane of each vector. With 8 lanes the
/// second half of the arrays is zero.
#[inline(always)]
pub fn arrays_of_lanes<S: Simd>(rows: [SimdVec<S>; 8]) -> [[S::Scalar; 8]; MAX_LANES] {
    let mut out = [[S::Scalar::zero(); 8]; MAX_LANES];
    let (low, high) = out.split_at_mut(8);
    for (row, (low, high)) in transpose_eights(rows).into_iter().zip(low.iter_mut().zip(high)) {
        row.store_eights([low, high]);
    }
    out
}

/// Rearranges four vectors of pixels from lines to blocks.
///
/// The vectors hold consecutive lines of 16 pixels, one after the other: four lines with 16 lanes, two with
/// 8. The results are the four blocks of pixels side by side, each four columns wide, with its lines one
/// after the other.
#[inline(always)]
pub fn blocks_of_lines<S: Simd>([a, b, c, d]: [SimdVec<S>; 4]) -> [SimdVec<S>; 4] {
    if S::WIDTH == MAX_LANES {
        // Four blocks of four lines of four pixels: the rearrangement is its own inverse.
        return lines_of_blocks([a, b, c, d]);
    }
    let ([first, second], [third, fourth]) = (a.concat_halves(c), b.concat_halves(d));
    [first, second, third, fourth]
}

/// The inverse of [`blocks_of_lines`].
#[inline(always)]
pub fn lines_of_blocks<S: Simd>([a, b, c, d]: [SimdVec<S>; 4]) -> [SimdVec<S>; 4] {
    let ([low_left, high_left], [low_right, high_right]) = (a.concat_halves(b), c.concat_halves(d));
    if S::WIDTH < MAX_LANES {
        return [low_left, low_right, high_left, high_right];
    }
    let ([first, second], [third, fourth]) =
        (low_left.deinterleave_quarters(low_right), high_left.deinterleave_quarters(high_right));
    [first, second, third, fourth]
}

/// Adds up the groups of four lanes of each of four vectors, which gives four sums for each. With 16 lanes,
/// both results are the same vector, with the sums of `a`, `b`, `c` and `d`; with 8 lanes, the first holds
/// those of `a` and `b`, the second those of `c` and `d`.
#[inline(always)]
pub fn sum_fours<S: Simd>([a, b, c, d]: [SimdVec<S>; 4]) -> [SimdVec<S>; 2] {
    let ([low, high], [low_after, high_after]) = (a.concat_halves(b), c.concat_halves(d));
    let sums = [low + high, low_after + high_after];
    if S::WIDTH < MAX_LANES {
        return sums;
    }
    let [even, odd] = sums[0].deinterleave_quarters(sums[1]);
    [even + odd; 2]
}
