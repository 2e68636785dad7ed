//! Vectors of scalars, with operators.

use super::exp2::Exp2;
use super::{MAX_LANES, Real, Simd};
use num_traits::Zero;
use std::ops::{Add, AddAssign, Div, Mul, Sub};

/// Numbers that can be added, subtracted and multiplied: scalars and vectors.
pub trait Arithmetic: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {}

impl<N: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>> Arithmetic for N {}

/// A vector of [`Simd::WIDTH`] scalars, with its instruction set. It is aligned, so that one instruction
/// loads a register.
#[derive(Clone, Copy)]
#[repr(align(32))]
pub struct SimdVec<S: Simd> {
    pub(super) simd: S,
    pub(super) vector: S::Vector,
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

    /// Reads eight lanes from the first array and, with 16 lanes, the other eight from the second.
    #[inline(always)]
    pub fn load_eights(simd: S, eights: [&[S::Scalar; 8]; 2]) -> Self {
        Self { simd, vector: simd.load_eights(eights) }
    }

    /// The lower halves of `a` and `b` as one vector, and the upper halves as another.
    #[inline(always)]
    pub(super) fn concat_halves(self, b: Self) -> [Self; 2] {
        from_raw(self.simd, self.simd.concat_halves(self.vector, b.vector))
    }

    /// Separates even and odd groups of four lanes ([`Simd::deinterleave_quarters`]).
    #[inline(always)]
    pub(super) fn deinterleave_quarters(self, b: Self) -> [Self; 2] {
        from_raw(self.simd, self.simd.deinterleave_quarters(self.vector, b.vector))
    }

    /// Writes the lanes to the places from which [`SimdVec::load_eights`] reads them.
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

    /// Reads the elements of a slice from index `start` on; lanes beyond its end are zero.
    #[inline(always)]
    pub fn load_from(simd: S, slice: &[S::Scalar], start: usize) -> Self {
        match slice[start..].get(..S::WIDTH) {
            Some(values) => Self::load(simd, values),
            None => Self::load(simd, &load_end(&slice[start..])),
        }
    }

    /// Writes to the elements of a slice from index `start` on; lanes beyond its end are dropped.
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

    /// The smaller, lane by lane.
    #[inline(always)]
    pub fn min(self, b: Self) -> Self {
        Self { vector: self.simd.min(self.vector, b.vector), ..self }
    }

    /// The greater, lane by lane.
    #[inline(always)]
    pub fn max(self, b: Self) -> Self {
        Self { vector: self.simd.max(self.vector, b.vector), ..self }
    }

    /// Reciprocal, with an error of at most two units in the last place; faster than a division.
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

    /// The sign: -1, 0 or 1; 0 for NaN.
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

    /// Approximate square root of positive numbers, with a relative error below 4e-4; faster than [`SimdVec::sqrt`].
    #[inline(always)]
    pub fn sqrt_approx(self) -> Self {
        Self { vector: self.simd.sqrt_approx(self.vector), ..self }
    }

    /// `2^self`, for values between -126 and 126, with a relative error below 3e-7.
    #[inline(always)]
    pub fn exp2(self) -> Self {
        self.exp2_with(&Exp2::new(self.simd))
    }

    /// [`SimdVec::exp2`] with constants that were broadcast before.
    #[inline(always)]
    pub fn exp2_with(self, constants: &Exp2<S>) -> Self {
        Self { vector: self.simd.exp2(self.vector, &constants.constants), ..self }
    }

    /// `e^self`, clamped to the range from 2^-126 to 2^126.
    #[inline(always)]
    pub fn exp(self) -> Self {
        let broadcast = |v: f64| Self::broadcast(self.simd, S::Scalar::from_f64(v));
        (self * broadcast(std::f64::consts::LOG2_E)).max(broadcast(-126.0)).min(broadcast(126.0)).exp2()
    }

    /// Binary logarithm of positive numbers; the error is below 3e-7, absolute or relative.
    #[inline(always)]
    pub fn log2(self) -> Self {
        Self { vector: self.simd.log2(self.vector), ..self }
    }

    /// Sum of the lanes.
    #[inline(always)]
    pub fn sum(self) -> S::Scalar {
        self.simd.sum(self.vector)
    }

    /// The largest whole number not above each lane, for values between 0 and 2^22.
    #[inline(always)]
    pub fn floor(self) -> Self {
        Self { vector: self.simd.floor(self.vector), ..self }
    }

    /// Writes whole numbers between 0 and 2^22 as u32 to the first [`Simd::WIDTH`] values of an array.
    #[inline(always)]
    pub fn store_u32(self, values: &mut [u32; MAX_LANES]) {
        self.simd.store_u32(self.vector, values);
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

    /// The lanes for which `mask` is true, zero in the others.
    #[inline(always)]
    pub fn select_or_zero(self, mask: SimdMask<S>) -> Self {
        Self { vector: self.simd.select_or_zero(mask.mask, self.vector), ..self }
    }
}

/// The last, incomplete vector of a slice, filled up with zeros. Not inlined, so that loops over whole
/// vectors keep their registers.
#[cold]
#[inline(never)]
fn load_end<T: Real>(end: &[T]) -> [T; MAX_LANES] {
    let mut values = [T::zero(); MAX_LANES];
    values[..end.len()].copy_from_slice(end);
    values
}

/// Writes the last, incomplete vector of a slice. Not inlined, as [`load_end`].
#[cold]
#[inline(never)]
fn store_end<T: Real>(end: &mut [T], values: &[T; MAX_LANES]) {
    end.copy_from_slice(&values[..end.len()]);
}

/// Broadcasts each scalar of an array.
#[inline(always)]
pub fn broadcast_each<S: Simd, const C: usize>(simd: S, values: [S::Scalar; C]) -> [SimdVec<S>; C] {
    let mut out = [SimdVec::broadcast(simd, S::Scalar::zero()); C];
    for c in 0..C {
        out[c] = SimdVec::broadcast(simd, values[c]);
    }
    out
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

impl<S: Simd> SimdMask<S> {
    /// True in the first `count` lanes, for a line that ends within a vector.
    #[inline(always)]
    pub fn first(simd: S, count: usize) -> Self {
        SimdVec::broadcast(simd, S::Scalar::from_f64(count as f64)).greater_than(SimdVec::lane_indices(simd))
    }

    /// True in the lanes where both masks are.
    #[inline(always)]
    pub fn and(self, b: Self) -> Self {
        Self { mask: self.simd.and(self.mask, b.mask), ..self }
    }

    /// The mask as an integer with one bit for each lane, the lowest bit for the first.
    #[inline(always)]
    pub fn bitmask(self) -> u32 {
        self.simd.bitmask(self.mask)
    }

    /// Writes `first` plus the index of each true lane to `indices`, in ascending order, and returns the
    /// number of true lanes. `indices` has at least [`MAX_LANES`] elements, of which those after the written
    /// ones are unspecified.
    #[inline(always)]
    pub fn compress(self, first: u8, indices: &mut [u8]) -> usize {
        self.simd.compress(self.mask, first, indices)
    }

    /// Whether any lane is true.
    #[inline(always)]
    pub fn any(self) -> bool {
        self.bitmask() != 0
    }
}

/// The vectors of an array without their instruction set.
#[inline(always)]
pub(super) fn to_raw<S: Simd, const C: usize>(rows: [SimdVec<S>; C]) -> [S::Vector; C] {
    let mut out = [rows[0].vector; C];
    for c in 1..C {
        out[c] = rows[c].vector;
    }
    out
}

/// Vectors from what [`to_raw`] returns.
#[inline(always)]
pub(super) fn from_raw<S: Simd, const C: usize>(simd: S, vector: [S::Vector; C]) -> [SimdVec<S>; C] {
    let mut out = [SimdVec { simd, vector: vector[0] }; C];
    for c in 1..C {
        out[c].vector = vector[c];
    }
    out
}
