//! SIMD: kernels compute with 8 or 16 numbers at once, in vector registers (AVX-512, AVX2, NEON) or in arrays.
//!
//! A kernel is written once over [`Simd`] and compiled for each instruction set ([`SimdKernel`]). In f32 it trains; in
//! f64 the same code is checked against central differences.

mod f64_array;
mod real;
mod registers;

pub use real::Real;

use num_traits::Zero;
use std::ops::{Add, AddAssign, Div, Mul, Sub};

/// Largest number of lanes of a [`SimdVec`].
pub const MAX_LANES: usize = 16;

/// Numbers that can be added, subtracted and multiplied: scalars and vectors.
pub trait Arithmetic: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {}

impl<N: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>> Arithmetic for N {}

/// A computation that is compiled for every instruction set.
pub trait SimdKernel<T> {
    /// Runs with this instruction set.
    fn run<S: Simd<Scalar = T>>(self, simd: S);
}

/// A scalar that kernels can be compiled for: f32 or f64.
pub trait SimdReal: Real {
    /// Runs the kernel with the best instruction set of the processor.
    fn dispatch(kernel: impl SimdKernel<Self>);
}

/// An instruction set: operations on vectors of [`Simd::WIDTH`] scalars.
pub trait Simd: Copy {
    /// Lanes of a vector: 8 or [`MAX_LANES`].
    const WIDTH: usize;
    /// A lane.
    type Scalar: Real;
    /// All lanes.
    type Vector: Copy;
    /// A boolean for each lane.
    type Mask: Copy;

    /// The same number in every lane.
    fn broadcast(self, value: Self::Scalar) -> Self::Vector;
    /// Reads the first [`Simd::WIDTH`] values.
    fn load(self, values: &[Self::Scalar]) -> Self::Vector;
    /// Writes to the first [`Simd::WIDTH`] places.
    fn store(self, a: Self::Vector, places: &mut [Self::Scalar]);
    /// The lower halves of `a` and `b` as one vector, and the upper halves as another.
    fn concat_halves(self, a: Self::Vector, b: Self::Vector) -> [Self::Vector; 2];
    /// With 16 lanes: quarters 0 and 2 of `a` and `b` interleaved as one vector, quarters 1 and 3 as another.
    fn interleave_quarters(self, a: Self::Vector, b: Self::Vector) -> [Self::Vector; 2];
    /// Eight lanes from the first array and, with 16 lanes, eight from the second.
    fn load_eights(self, eights: [&[Self::Scalar; 8]; 2]) -> Self::Vector;
    /// What [`Simd::load_eights`] reads.
    fn store_eights(self, a: Self::Vector, eights: [&mut [Self::Scalar; 8]; 2]);
    /// Transposes every 4 x 4 block: within each group of four lanes, lane `j` of vector `k` and lane `k` of vector `j` change
    /// places.
    fn transpose_fours(self, rows: [Self::Vector; 4]) -> [Self::Vector; 4];
    /// Transposes every 8 x 8 block: within each group of eight lanes, lane `j` of vector `k` and lane `k` of vector `j` change
    /// places.
    fn transpose_eights(self, rows: [Self::Vector; 8]) -> [Self::Vector; 8];
    /// `a + b`.
    fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a - b`.
    fn sub(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a b`.
    fn mul(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a / b`.
    fn div(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `1 / a`, exact to one or two units in the last place.
    fn reciprocal(self, a: Self::Vector) -> Self::Vector;
    /// `a b + c`, fused where that is fast.
    fn mul_add(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;
    /// The lesser.
    fn min(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// The greater.
    fn max(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// Square root.
    fn sqrt(self, a: Self::Vector) -> Self::Vector;
    /// Square root of positive numbers, relative error below 4e-4.
    fn sqrt_approx(self, a: Self::Vector) -> Self::Vector;
    /// Two to a power between -126 and 126; anything, but no trap, beyond. `constants` are those of `EXP2`.
    fn exp2(self, a: Self::Vector, constants: &[Self::Vector; 7]) -> Self::Vector;
    /// Binary logarithm of positive numbers.
    fn log2(self, a: Self::Vector) -> Self::Vector;
    /// Sum of the lanes, in an order that only depends on the processor.
    fn sum(self, a: Self::Vector) -> Self::Scalar;
    /// The whole part of numbers between 0 and 2^22.
    fn floor(self, a: Self::Vector) -> Self::Vector;
    /// Whole numbers between 0 and 2^22, to the first of these places.
    fn store_whole(self, a: Self::Vector, places: &mut [u32; MAX_LANES]);
    /// `a >= b`.
    fn greater_equal(self, a: Self::Vector, b: Self::Vector) -> Self::Mask;
    /// `a > b`.
    fn greater_than(self, a: Self::Vector, b: Self::Vector) -> Self::Mask;
    /// Both.
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// One bit a lane, the first lane lowest.
    fn bitmask(self, a: Self::Mask) -> u32;
    /// Writes `first` plus the index of each true lane to the start of `places`, which has at least [`MAX_LANES`] elements, and
    /// returns how many there are. Elements after them are unspecified.
    fn compress(self, a: Self::Mask, first: u8, places: &mut [u8]) -> usize;
    /// `a` where the mask is true, else zero.
    fn select_or_zero(self, mask: Self::Mask, a: Self::Vector) -> Self::Vector;
}

/// A vector of scalars with its instruction set. It is aligned, so that a register is loaded in one access.
#[derive(Clone, Copy)]
#[repr(align(32))]
pub struct SimdVec<S: Simd> {
    simd: S,
    vector: S::Vector,
}

/// A boolean for each lane of a [`SimdVec`].
#[derive(Clone, Copy)]
pub struct SimdMask<S: Simd> {
    simd: S,
    mask: S::Mask,
}

impl<S: Simd> SimdVec<S> {
    /// The same number in every lane.
    #[inline(always)]
    pub fn broadcast(simd: S, value: S::Scalar) -> Self {
        Self { simd, vector: simd.broadcast(value) }
    }

    /// Reads the first lanes of a slice that has at least [`Simd::WIDTH`] values.
    #[inline(always)]
    pub fn load(simd: S, values: &[S::Scalar]) -> Self {
        Self { simd, vector: simd.load(values) }
    }

    /// Eight lanes from the first array and, with 16 lanes, eight from the second.
    #[inline(always)]
    pub fn load_eights(simd: S, eights: [&[S::Scalar; 8]; 2]) -> Self {
        Self { simd, vector: simd.load_eights(eights) }
    }

    /// The lower halves of `a` and `b` as one vector, and the upper halves as another.
    #[inline(always)]
    fn concat_halves(self, b: Self) -> [Self; 2] {
        vectors_from(self.simd, self.simd.concat_halves(self.vector, b.vector))
    }

    /// With 16 lanes: quarters 0 and 2 of `a` and `b` interleaved as one vector, quarters 1 and 3 as another.
    #[inline(always)]
    fn interleave_quarters(self, b: Self) -> [Self; 2] {
        vectors_from(self.simd, self.simd.interleave_quarters(self.vector, b.vector))
    }

    /// What [`SimdVec::load_eights`] reads.
    #[inline(always)]
    pub fn store_eights(self, eights: [&mut [S::Scalar; 8]; 2]) {
        self.simd.store_eights(self.vector, eights);
    }

    /// The index of each lane: 0, 1, 2, ...
    #[inline(always)]
    pub fn lane_indices(simd: S) -> Self {
        let mut values = [S::Scalar::zero(); MAX_LANES];
        for (i, v) in values.iter_mut().enumerate() {
            *v = S::Scalar::from_f64(i as f64);
        }
        Self::load(simd, &values)
    }

    /// Reads from index `start` of a slice on; lanes beyond its end are zero.
    #[inline(always)]
    pub fn load_from(simd: S, slice: &[S::Scalar], start: usize) -> Self {
        match slice[start..].get(..S::WIDTH) {
            Some(values) => Self::load(simd, values),
            None => Self::load(simd, &load_end(&slice[start..])),
        }
    }

    /// Writes from index `start` of a slice on; lanes beyond its end are dropped.
    #[inline(always)]
    pub fn store_to(self, slice: &mut [S::Scalar], start: usize) {
        match slice[start..].get_mut(..S::WIDTH) {
            Some(places) => self.simd.store(self.vector, places),
            None => {
                let mut values = [S::Scalar::zero(); MAX_LANES];
                self.simd.store(self.vector, &mut values);
                store_end(&mut slice[start..], &values);
            }
        }
    }

    /// `self * b + c`.
    #[inline(always)]
    pub fn mul_add(self, b: Self, c: Self) -> Self {
        Self { vector: self.simd.mul_add(self.vector, b.vector, c.vector), ..self }
    }

    /// The lesser, lane by lane.
    #[inline(always)]
    pub fn min(self, b: Self) -> Self {
        Self { vector: self.simd.min(self.vector, b.vector), ..self }
    }

    /// The greater, lane by lane.
    #[inline(always)]
    pub fn max(self, b: Self) -> Self {
        Self { vector: self.simd.max(self.vector, b.vector), ..self }
    }

    /// Reciprocal, exact to one or two units in the last place; faster than a division.
    #[inline(always)]
    pub fn reciprocal(self) -> Self {
        Self { vector: self.simd.reciprocal(self.vector), ..self }
    }

    /// Absolute value.
    #[inline(always)]
    pub fn abs(self) -> Self {
        let negative = Self::broadcast(self.simd, S::Scalar::zero()) - self;
        self.max(negative)
    }

    /// -1, 0 or 1.
    #[inline(always)]
    pub fn sign(self) -> Self {
        let (zero, one) = (
            Self::broadcast(self.simd, S::Scalar::zero()),
            Self::broadcast(self.simd, S::Scalar::from_f64(1.0)),
        );
        one.select_or_zero(self.greater_than(zero)) - one.select_or_zero(zero.greater_than(self))
    }

    /// Square root.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self { vector: self.simd.sqrt(self.vector), ..self }
    }

    /// Square root of positive numbers, relative error below 4e-4; faster.
    #[inline(always)]
    pub fn sqrt_approx(self) -> Self {
        Self { vector: self.simd.sqrt_approx(self.vector), ..self }
    }

    /// Two to this power.
    #[inline(always)]
    pub fn exp2(self) -> Self {
        self.exp2_with(&Exp2::new(self.simd))
    }

    /// Two to this power.
    #[inline(always)]
    pub fn exp2_with(self, constants: &Exp2<S>) -> Self {
        Self { vector: self.simd.exp2(self.vector, &constants.vector), ..self }
    }

    /// e to this power, no less than 2^-126 and no more than 2^126.
    #[inline(always)]
    pub fn exp(self) -> Self {
        let broadcast = |v: f64| Self::broadcast(self.simd, S::Scalar::from_f64(v));
        (self * broadcast(std::f64::consts::LOG2_E)).max(broadcast(-126.0)).min(broadcast(126.0)).exp2()
    }

    /// Binary logarithm.
    #[inline(always)]
    pub fn log2(self) -> Self {
        Self { vector: self.simd.log2(self.vector), ..self }
    }

    /// Sum of the lanes.
    #[inline(always)]
    pub fn sum(self) -> S::Scalar {
        self.simd.sum(self.vector)
    }

    /// The whole part of numbers between 0 and 2^22.
    #[inline(always)]
    pub fn floor(self) -> Self {
        Self { vector: self.simd.floor(self.vector), ..self }
    }

    /// Whole numbers between 0 and 2^22, to the first of these places.
    #[inline(always)]
    pub fn store_whole(self, places: &mut [u32; MAX_LANES]) {
        self.simd.store_whole(self.vector, places);
    }

    /// `self >= b`, lane by lane.
    #[inline(always)]
    pub fn greater_equal(self, b: Self) -> SimdMask<S> {
        SimdMask { simd: self.simd, mask: self.simd.greater_equal(self.vector, b.vector) }
    }

    /// `self > b`, lane by lane.
    #[inline(always)]
    pub fn greater_than(self, b: Self) -> SimdMask<S> {
        SimdMask { simd: self.simd, mask: self.simd.greater_than(self.vector, b.vector) }
    }

    /// Zero where `mask` is false.
    #[inline(always)]
    pub fn select_or_zero(self, mask: SimdMask<S>) -> Self {
        Self { vector: self.simd.select_or_zero(mask.mask, self.vector), ..self }
    }
}

/// Not inlined, so that loops over whole vectors keep their registers.
#[cold]
#[inline(never)]
fn load_end<T: Real>(end: &[T]) -> [T; MAX_LANES] {
    let mut values = [T::zero(); MAX_LANES];
    values[..end.len()].copy_from_slice(end);
    values
}

#[cold]
#[inline(never)]
fn store_end<T: Real>(end: &mut [T], values: &[T; MAX_LANES]) {
    end.copy_from_slice(&values[..end.len()]);
}

/// Broadcasts each of these scalars.
#[inline(always)]
pub fn broadcast_each<S: Simd, const C: usize>(simd: S, values: [S::Scalar; C]) -> [SimdVec<S>; C] {
    let mut out = [SimdVec::broadcast(simd, S::Scalar::zero()); C];
    for c in 0..C {
        out[c] = SimdVec::broadcast(simd, values[c]);
    }
    out
}

/// Transposes every 4 x 4 block: within each group of four lanes, lane `j` of vector `k` and lane `k` of vector `j` change
/// places.
#[inline(always)]
pub fn transpose_fours<S: Simd>(rows: [SimdVec<S>; 4]) -> [SimdVec<S>; 4] {
    let simd = rows[0].simd;
    vectors_from(simd, simd.transpose_fours(raw(rows)))
}

/// Transposes every 8 x 8 block: within each group of eight lanes, lane `j` of vector `k` and lane `k` of vector `j` change
/// places.
#[inline(always)]
pub fn transpose_eights<S: Simd>(rows: [SimdVec<S>; 8]) -> [SimdVec<S>; 8] {
    let simd = rows[0].simd;
    vectors_from(simd, simd.transpose_eights(raw(rows)))
}

/// Transposes eight vectors to arrays: for each lane its eight scalars.
#[inline(always)]
pub fn arrays_of_lanes<S: Simd>(rows: [SimdVec<S>; 8]) -> [[S::Scalar; 8]; MAX_LANES] {
    let mut out = [[S::Scalar::zero(); 8]; MAX_LANES];
    let (low, high) = out.split_at_mut(8);
    for (row, (low, high)) in transpose_eights(rows).into_iter().zip(low.iter_mut().zip(high)) {
        row.store_eights([low, high]);
    }
    out
}

/// Four blocks of pixels side by side, four columns wide, from the lines of sixteen pixels through them, one after the
/// other.
#[inline(always)]
pub fn blocks_of_lines<S: Simd>([a, b, c, d]: [SimdVec<S>; 4]) -> [SimdVec<S>; 4] {
    if S::WIDTH == MAX_LANES {
        // Four blocks of four lines of four pixels: the same exchange.
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
        (low_left.interleave_quarters(low_right), high_left.interleave_quarters(high_right));
    [first, second, third, fourth]
}

/// Sums over groups of four lanes: sixteen sums, four of each vector, in one vector of 16 lanes or two of 8 (with 16 lanes
/// both are the same).
#[inline(always)]
pub fn sum_fours<S: Simd>([a, b, c, d]: [SimdVec<S>; 4]) -> [SimdVec<S>; 2] {
    let ([low, high], [low_after, high_after]) = (a.concat_halves(b), c.concat_halves(d));
    let sums = [low + high, low_after + high_after];
    if S::WIDTH < MAX_LANES {
        return sums;
    }
    let [even, odd] = sums[0].interleave_quarters(sums[1]);
    [even + odd; 2]
}

#[inline(always)]
fn raw<S: Simd, const C: usize>(rows: [SimdVec<S>; C]) -> [S::Vector; C] {
    let mut out = [rows[0].vector; C];
    for c in 1..C {
        out[c] = rows[c].vector;
    }
    out
}

#[inline(always)]
fn vectors_from<S: Simd, const C: usize>(simd: S, vector: [S::Vector; C]) -> [SimdVec<S>; C] {
    let mut out = [SimdVec { simd, vector: vector[0] }; C];
    for c in 1..C {
        out[c].vector = vector[c];
    }
    out
}

impl<S: Simd> SimdMask<S> {
    /// True in the first `count` lanes: the rest of a line that ends within a vector.
    #[inline(always)]
    pub fn first(simd: S, count: usize) -> Self {
        SimdVec::broadcast(simd, S::Scalar::from_f64(count as f64)).greater_than(SimdVec::lane_indices(simd))
    }

    /// True where both are.
    #[inline(always)]
    pub fn and(self, b: Self) -> Self {
        Self { mask: self.simd.and(self.mask, b.mask), ..self }
    }

    /// One bit a lane, the first lane lowest.
    #[inline(always)]
    pub fn bitmask(self) -> u32 {
        self.simd.bitmask(self.mask)
    }

    /// Writes `first` plus the index of each true lane to the start of `places`, which has at least [`MAX_LANES`] elements, and
    /// returns how many there are. Elements after them are unspecified.
    #[inline(always)]
    pub fn compress(self, first: u8, places: &mut [u8]) -> usize {
        self.simd.compress(self.mask, first, places)
    }

    /// Whether any lane is true.
    #[inline(always)]
    pub fn any(self) -> bool {
        self.bitmask() != 0
    }
}

impl<S: Simd> Add for SimdVec<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { vector: self.simd.add(self.vector, b.vector), ..self }
    }
}

impl<S: Simd> AddAssign for SimdVec<S> {
    #[inline(always)]
    fn add_assign(&mut self, b: Self) {
        *self = *self + b;
    }
}

impl<S: Simd> Sub for SimdVec<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { vector: self.simd.sub(self.vector, b.vector), ..self }
    }
}

impl<S: Simd> Mul for SimdVec<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self { vector: self.simd.mul(self.vector, b.vector), ..self }
    }
}

impl<S: Simd> Div for SimdVec<S> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        Self { vector: self.simd.div(self.vector, b.vector), ..self }
    }
}

/// Indices of the bits that are set, lowest first.
#[inline(always)]
pub fn set_bits(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (bits != 0).then(|| {
            // The remainder tells the compiler what holds anyway: no place lies beyond.
            let place = bits.trailing_zeros() as usize % u32::BITS as usize;
            bits &= bits - 1;
            place
        })
    })
}

/// What [`Simd::exp2`] takes: 1.5 * 2^23, the coefficients of a polynomial that interpolates 2^f in the Chebyshev
/// nodes of [-1/2, 1/2].
const EXP2: [f32; 7] = [
    12_582_912.0,
    1.000_000_1,
    std::f32::consts::LN_2,
    0.240_221_07,
    0.055_503_57,
    0.009_676_032,
    0.001_339_086_3,
];

/// The constants of [`SimdVec::exp2_with`], broadcast once for a whole kernel.
pub struct Exp2<S: Simd> {
    vector: [S::Vector; 7],
}

impl<S: Simd> Exp2<S> {
    /// Broadcasts the constants.
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let mut vector = [simd.broadcast(S::Scalar::zero()); 7];
        for k in 0..7 {
            vector[k] = simd.broadcast(S::Scalar::from_f64(f64::from(EXP2[k])));
        }
        Self { vector }
    }
}

/// The byte 1, eight times.
const ONES: u64 = 0x0101_0101_0101_0101;

/// For each byte the indices of its set bits, one byte each, lowest first.
const PLACES: [u64; 256] = {
    let mut table = [0; 256];
    let mut set = 0;
    while set < 256 {
        let (mut place, mut count) = (0, 0);
        while place < 8 {
            if set >> place & 1 == 1 {
                table[set] |= place << (8 * count);
                count += 1;
            }
            place += 1;
        }
        set += 1;
    }
    table
};

/// [`Simd::compress`] of eight lanes: a table knows where the bits of a byte are.
#[inline(always)]
fn compress_eight(bits: u8, first: u8, places: &mut [u8]) -> usize {
    let vector = PLACES[usize::from(bits)] + u64::from(first) * ONES;
    places[..8].copy_from_slice(&vector.to_le_bytes());
    bits.count_ones() as usize
}

#[cfg(test)]
mod tests;
