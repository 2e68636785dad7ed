//! Sixteen numbers at once, as the kernels compute: in vector registers, or in an array where there are none.

use super::real::Real;
use num_traits::Zero;
use pulp::Simd;
use std::ops::{Add, AddAssign, Mul, Sub};

/// Numbers in a [`Row`].
pub const LANES: usize = 16;

/// A kernel that is compiled for every kind of lanes.
pub trait Kernel<T> {
    /// Runs with these lanes.
    fn run<L: Lanes<Number = T>>(self, lanes: L);
}

/// A number that has lanes.
pub trait Lanewise: Real {
    /// Runs the kernel with the best lanes of the processor at hand.
    fn dispatch(kernel: impl Kernel<Self>);
}

/// Instructions for sixteen numbers.
pub trait Lanes: Copy {
    /// What a lane holds.
    type Number: Real;
    /// Sixteen of them.
    type Numbers: Copy;
    /// Sixteen truths.
    type Truths: Copy;

    /// The same number in every lane.
    fn splat(self, value: Self::Number) -> Self::Numbers;
    /// From memory.
    fn load(self, values: &[Self::Number; LANES]) -> Self::Numbers;
    /// To memory.
    fn store(self, a: Self::Numbers) -> [Self::Number; LANES];
    /// `a + b`.
    fn add(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// `a - b`.
    fn sub(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// `a b`.
    fn mul(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// `a / b`.
    fn div(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// `a b + c`, fused where that is fast.
    fn mul_add(self, a: Self::Numbers, b: Self::Numbers, c: Self::Numbers) -> Self::Numbers;
    /// The lesser.
    fn min(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// The greater.
    fn max(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// Two to a power between -126 and 126; anything, but no trap, beyond.
    fn exp2(self, a: Self::Numbers) -> Self::Numbers;
    /// Sum of the lanes, in an order that only depends on the processor.
    fn sum(self, a: Self::Numbers) -> Self::Number;
    /// `a >= b`.
    fn at_least(self, a: Self::Numbers, b: Self::Numbers) -> Self::Truths;
    /// Both.
    fn and(self, a: Self::Truths, b: Self::Truths) -> Self::Truths;
    /// Whether any holds.
    fn any(self, a: Self::Truths) -> bool;
    /// `a` where it holds, else zero.
    fn keep(self, truths: Self::Truths, a: Self::Numbers) -> Self::Numbers;
}

/// Sixteen numbers and the instructions to compute with them. Aligned to a cache line: a register is loaded at once.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub struct Row<L: Lanes> {
    lanes: L,
    numbers: L::Numbers,
}

/// What is true of the lanes of a [`Row`].
#[derive(Clone, Copy)]
pub struct Mask<L: Lanes> {
    lanes: L,
    truths: L::Truths,
}

impl<L: Lanes> Row<L> {
    /// The same number in every lane.
    #[inline(always)]
    pub fn splat(lanes: L, value: L::Number) -> Self {
        Self { lanes, numbers: lanes.splat(value) }
    }

    /// From memory.
    #[inline(always)]
    pub fn load(lanes: L, values: &[L::Number; LANES]) -> Self {
        Self { lanes, numbers: lanes.load(values) }
    }

    /// To memory.
    #[inline(always)]
    pub fn store(self) -> [L::Number; LANES] {
        self.lanes.store(self.numbers)
    }

    /// `self * b + c`.
    #[inline(always)]
    pub fn mul_add(self, b: Self, c: Self) -> Self {
        Self { numbers: self.lanes.mul_add(self.numbers, b.numbers, c.numbers), ..self }
    }

    /// The lesser, lane by lane.
    #[inline(always)]
    pub fn min(self, b: Self) -> Self {
        Self { numbers: self.lanes.min(self.numbers, b.numbers), ..self }
    }

    /// The greater, lane by lane.
    #[inline(always)]
    pub fn max(self, b: Self) -> Self {
        Self { numbers: self.lanes.max(self.numbers, b.numbers), ..self }
    }

    /// `self / b`.
    #[inline(always)]
    pub fn over(self, b: Self) -> Self {
        Self { numbers: self.lanes.div(self.numbers, b.numbers), ..self }
    }

    /// Two to this power.
    #[inline(always)]
    pub fn exp2(self) -> Self {
        Self { numbers: self.lanes.exp2(self.numbers), ..self }
    }

    /// Sum of the lanes.
    #[inline(always)]
    pub fn sum(self) -> L::Number {
        self.lanes.sum(self.numbers)
    }

    /// Where it is `b` or more.
    #[inline(always)]
    pub fn at_least(self, b: Self) -> Mask<L> {
        Mask { lanes: self.lanes, truths: self.lanes.at_least(self.numbers, b.numbers) }
    }

    /// Zero where the mask does not hold.
    #[inline(always)]
    pub fn keep(self, mask: Mask<L>) -> Self {
        Self { numbers: self.lanes.keep(mask.truths, self.numbers), ..self }
    }
}

/// Each of some numbers in every lane.
#[inline(always)]
pub fn splat_each<L: Lanes, const C: usize>(lanes: L, values: [L::Number; C]) -> [Row<L>; C] {
    let mut out = [Row::splat(lanes, L::Number::zero()); C];
    for c in 0..C {
        out[c] = Row::splat(lanes, values[c]);
    }
    out
}

/// The sum of each row's lanes.
#[inline(always)]
pub fn sum_each<L: Lanes, const C: usize>(rows: [Row<L>; C]) -> [L::Number; C] {
    let mut out = [L::Number::zero(); C];
    for c in 0..C {
        out[c] = rows[c].sum();
    }
    out
}

impl<L: Lanes> Mask<L> {
    /// Where both hold.
    #[inline(always)]
    pub fn and(self, b: Self) -> Self {
        Self { truths: self.lanes.and(self.truths, b.truths), ..self }
    }

    /// Whether it holds anywhere.
    #[inline(always)]
    pub fn any(self) -> bool {
        self.lanes.any(self.truths)
    }
}

impl<L: Lanes> Add for Row<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { numbers: self.lanes.add(self.numbers, b.numbers), ..self }
    }
}

impl<L: Lanes> AddAssign for Row<L> {
    #[inline(always)]
    fn add_assign(&mut self, b: Self) {
        *self = *self + b;
    }
}

impl<L: Lanes> Sub for Row<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { numbers: self.lanes.sub(self.numbers, b.numbers), ..self }
    }
}

impl<L: Lanes> Mul for Row<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self { numbers: self.lanes.mul(self.numbers, b.numbers), ..self }
    }
}

/// `N` registers of f32.
#[derive(Clone, Copy)]
struct Registers<S, const N: usize>(S);

impl Lanewise for f32 {
    #[inline]
    fn dispatch(kernel: impl Kernel<f32>) {
        match pulp::Arch::new() {
            #[cfg(target_arch = "x86_64")]
            pulp::Arch::V4(s) => Simd::vectorize(s, Compiled::<_, 1>(kernel)),
            #[cfg(target_arch = "x86_64")]
            pulp::Arch::V3(s) => Simd::vectorize(s, Compiled::<_, 2>(kernel)),
            #[cfg(target_arch = "aarch64")]
            pulp::Arch::Neon(s) => Simd::vectorize(s, Compiled::<_, 4>(kernel)),
            _ => kernel.run(Registers::<_, LANES>(pulp::Scalar::new())),
        }
    }
}

/// A kernel within the instructions' reach.
struct Compiled<K, const N: usize>(K);

impl<K: Kernel<f32>, const N: usize> pulp::WithSimd for Compiled<K, N> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.0.run(Registers::<S, N>(simd));
    }
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

impl<S: Simd, const N: usize> Lanes for Registers<S, N> {
    type Number = f32;
    type Numbers = [S::f32s; N];
    type Truths = [S::m32s; N];

    #[inline(always)]
    fn splat(self, value: f32) -> Self::Numbers {
        [self.0.splat_f32s(value); N]
    }
    #[inline(always)]
    fn load(self, values: &[f32; LANES]) -> Self::Numbers {
        let registers = S::as_simd_f32s(values).0;
        each!(k: registers[k])
    }
    #[inline(always)]
    fn store(self, a: Self::Numbers) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        S::as_mut_simd_f32s(&mut out).0.copy_from_slice(&a);
        out
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
    fn exp2(self, a: Self::Numbers) -> Self::Numbers {
        each!(k: exp2(self.0, a[k]))
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
    fn at_least(self, a: Self::Numbers, b: Self::Numbers) -> Self::Truths {
        each!(k: self.0.greater_than_or_equal_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn and(self, a: Self::Truths, b: Self::Truths) -> Self::Truths {
        each!(k: self.0.and_m32s(a[k], b[k]))
    }
    #[inline(always)]
    fn any(self, a: Self::Truths) -> bool {
        let mut either = a[0];
        for k in 1..N {
            either = self.0.or_m32s(either, a[k]);
        }
        self.0.first_true_m32s(either) < S::F32_LANES
    }
    #[inline(always)]
    fn keep(self, truths: Self::Truths, a: Self::Numbers) -> Self::Numbers {
        each!(k: self.0.select_f32s(truths[k], a[k], self.0.splat_f32s(0.0)))
    }
}

/// Two to a power, relative error below 3e-7: the nearest whole power by the exponent bits, the rest by a polynomial.
#[inline(always)]
fn exp2<S: Simd>(s: S, a: S::f32s) -> S::f32s {
    // Adding 1.5 * 2^23 rounds to a whole number, which then stands in the low bits.
    let round = s.splat_f32s(12_582_912.0);
    // Taylor coefficients of 2^f, f in [-1/2, 1/2]: (ln 2)^k / k!.
    const C: [f32; 7] = [
        1.0,
        std::f32::consts::LN_2,
        0.240_226_5,
        0.055_504_11,
        0.009_618_129,
        0.001_333_355_8,
        0.000_154_035_3,
    ];
    let shifted = s.add_f32s(a, round);
    let f = s.sub_f32s(a, s.sub_f32s(shifted, round));
    let mut p = s.splat_f32s(C[6]);
    for k in (0..6).rev() {
        p = s.mul_add_e_f32s(p, f, s.splat_f32s(C[k]));
    }
    let power = s.wrapping_dyn_shl_u32s(s.transmute_u32s_f32s(shifted), s.splat_u32s(23));
    s.transmute_f32s_u32s(s.add_u32s(s.transmute_u32s_f32s(p), power))
}

/// f64 in an array: gradients are checked with it.
#[derive(Clone, Copy)]
struct Exact;

impl Lanewise for f64 {
    fn dispatch(kernel: impl Kernel<f64>) {
        kernel.run(Exact);
    }
}

impl Lanes for Exact {
    type Number = f64;
    type Numbers = [f64; LANES];
    type Truths = [bool; LANES];

    fn splat(self, value: f64) -> [f64; LANES] {
        [value; LANES]
    }
    fn load(self, values: &[f64; LANES]) -> [f64; LANES] {
        *values
    }
    fn store(self, a: [f64; LANES]) -> [f64; LANES] {
        a
    }
    fn add(self, a: [f64; LANES], b: [f64; LANES]) -> [f64; LANES] {
        std::array::from_fn(|i| a[i] + b[i])
    }
    fn sub(self, a: [f64; LANES], b: [f64; LANES]) -> [f64; LANES] {
        std::array::from_fn(|i| a[i] - b[i])
    }
    fn mul(self, a: [f64; LANES], b: [f64; LANES]) -> [f64; LANES] {
        std::array::from_fn(|i| a[i] * b[i])
    }
    fn div(self, a: [f64; LANES], b: [f64; LANES]) -> [f64; LANES] {
        std::array::from_fn(|i| a[i] / b[i])
    }
    fn mul_add(self, a: [f64; LANES], b: [f64; LANES], c: [f64; LANES]) -> [f64; LANES] {
        std::array::from_fn(|i| a[i] * b[i] + c[i])
    }
    fn min(self, a: [f64; LANES], b: [f64; LANES]) -> [f64; LANES] {
        std::array::from_fn(|i| a[i].min(b[i]))
    }
    fn max(self, a: [f64; LANES], b: [f64; LANES]) -> [f64; LANES] {
        std::array::from_fn(|i| a[i].max(b[i]))
    }
    fn exp2(self, a: [f64; LANES]) -> [f64; LANES] {
        a.map(f64::exp2)
    }
    fn sum(self, a: [f64; LANES]) -> f64 {
        a.iter().sum()
    }
    fn at_least(self, a: [f64; LANES], b: [f64; LANES]) -> [bool; LANES] {
        std::array::from_fn(|i| a[i] >= b[i])
    }
    fn and(self, a: [bool; LANES], b: [bool; LANES]) -> [bool; LANES] {
        std::array::from_fn(|i| a[i] && b[i])
    }
    fn any(self, a: [bool; LANES]) -> bool {
        a.contains(&true)
    }
    fn keep(self, truths: [bool; LANES], a: [f64; LANES]) -> [f64; LANES] {
        std::array::from_fn(|i| if truths[i] { a[i] } else { 0.0 })
    }
}
