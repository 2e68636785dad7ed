//! Eight or sixteen numbers at once, as the kernels compute: in a vector register, or in an array where there is none.

use super::real::Real;
use num_traits::Zero;
use pulp::Simd;
use std::ops::{Add, AddAssign, Mul, Sub};

/// Most numbers in a [`Row`].
pub const LANES: usize = 16;

/// What adds, subtracts and multiplies: a number, or a row of them.
pub trait Ring: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {}

impl<N: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>> Ring for N {}

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

/// Instructions for a row of numbers.
pub trait Lanes: Copy {
    /// Lanes in a row: eight or [`LANES`].
    const WIDTH: usize;
    /// What a lane holds.
    type Number: Real;
    /// A row of them.
    type Numbers: Copy;
    /// A row of truths.
    type Truths: Copy;

    /// The same number in every lane.
    fn splat(self, value: Self::Number) -> Self::Numbers;
    /// The first of these values.
    fn load(self, values: &[Self::Number]) -> Self::Numbers;
    /// To the first of these places.
    fn store(self, a: Self::Numbers, places: &mut [Self::Number]);
    /// `a + b`.
    fn add(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// `a - b`.
    fn sub(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// `a b`.
    fn mul(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// `a / b`.
    fn div(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// `1 / a` to the last bit or two.
    fn reciprocal(self, a: Self::Numbers) -> Self::Numbers;
    /// `a b + c`, fused where that is fast.
    fn mul_add(self, a: Self::Numbers, b: Self::Numbers, c: Self::Numbers) -> Self::Numbers;
    /// The lesser.
    fn min(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// The greater.
    fn max(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// Square root.
    fn sqrt(self, a: Self::Numbers) -> Self::Numbers;
    /// Two to a power between -126 and 126; anything, but no trap, beyond. `constants` are [`EXP2`]'s.
    fn exp2(self, a: Self::Numbers, constants: &[Self::Numbers; 7]) -> Self::Numbers;
    /// Binary logarithm of positive numbers.
    fn log2(self, a: Self::Numbers) -> Self::Numbers;
    /// Sum of the lanes, in an order that only depends on the processor.
    fn sum(self, a: Self::Numbers) -> Self::Number;
    /// The whole part of numbers between 0 and 2^22.
    fn floor(self, a: Self::Numbers) -> Self::Numbers;
    /// Whole numbers between 0 and 2^22, to the first of these places.
    fn store_whole(self, a: Self::Numbers, places: &mut [u32; LANES]);
    /// `a >= b`.
    fn at_least(self, a: Self::Numbers, b: Self::Numbers) -> Self::Truths;
    /// `a > b`.
    fn above(self, a: Self::Numbers, b: Self::Numbers) -> Self::Truths;
    /// Both.
    fn and(self, a: Self::Truths, b: Self::Truths) -> Self::Truths;
    /// As bits, the first lane lowest.
    fn bits(self, a: Self::Truths) -> u32;
    /// `a` where it holds, else zero.
    fn keep(self, truths: Self::Truths, a: Self::Numbers) -> Self::Numbers;
}

/// A number for every lane and the instructions to compute with them. Aligned: a register is loaded at once.
#[derive(Clone, Copy)]
#[repr(align(32))]
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

    /// The first of a slice that is long enough.
    #[inline(always)]
    pub fn load(lanes: L, values: &[L::Number]) -> Self {
        Self { lanes, numbers: lanes.load(values) }
    }

    /// 0, 1, 2, ...
    #[inline(always)]
    pub fn numbers(lanes: L) -> Self {
        let mut values = [L::Number::zero(); LANES];
        for (i, v) in values.iter_mut().enumerate() {
            *v = L::Number::of(i as f64);
        }
        Self::load(lanes, &values)
    }

    /// From a slice's place on; zero beyond its end.
    #[inline(always)]
    pub fn load_from(lanes: L, slice: &[L::Number], start: usize) -> Self {
        match slice[start..].get(..L::WIDTH) {
            Some(values) => Self::load(lanes, values),
            None => Self::load(lanes, &load_end(&slice[start..])),
        }
    }

    /// Into a slice, as far as it goes.
    #[inline(always)]
    pub fn store_to(self, slice: &mut [L::Number], start: usize) {
        match slice[start..].get_mut(..L::WIDTH) {
            Some(places) => self.lanes.store(self.numbers, places),
            None => {
                let mut values = [L::Number::zero(); LANES];
                self.lanes.store(self.numbers, &mut values);
                store_end(&mut slice[start..], &values);
            }
        }
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

    /// One over this, to the last bit or two: faster than to divide.
    #[inline(always)]
    pub fn reciprocal(self) -> Self {
        Self { numbers: self.lanes.reciprocal(self.numbers), ..self }
    }

    /// Without its sign.
    #[inline(always)]
    pub fn abs(self) -> Self {
        let negative = Self::splat(self.lanes, L::Number::zero()) - self;
        self.max(negative)
    }

    /// -1, 0 or 1.
    #[inline(always)]
    pub fn sign(self) -> Self {
        let (zero, one) =
            (Self::splat(self.lanes, L::Number::zero()), Self::splat(self.lanes, L::Number::of(1.0)));
        one.keep(self.above(zero)) - one.keep(zero.above(self))
    }

    /// Square root.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self { numbers: self.lanes.sqrt(self.numbers), ..self }
    }

    /// Two to this power.
    #[inline(always)]
    pub fn exp2(self) -> Self {
        self.exp2_with(&Exp2::new(self.lanes))
    }

    /// Two to this power.
    #[inline(always)]
    pub fn exp2_with(self, constants: &Exp2<L>) -> Self {
        Self { numbers: self.lanes.exp2(self.numbers, &constants.numbers), ..self }
    }

    /// e to this power, no less than 2^-126 and no more than 2^126.
    #[inline(always)]
    pub fn exp(self) -> Self {
        let splat = |v: f64| Self::splat(self.lanes, L::Number::of(v));
        (self * splat(std::f64::consts::LOG2_E)).max(splat(-126.0)).min(splat(126.0)).exp2()
    }

    /// Binary logarithm.
    #[inline(always)]
    pub fn log2(self) -> Self {
        Self { numbers: self.lanes.log2(self.numbers), ..self }
    }

    /// Sum of the lanes.
    #[inline(always)]
    pub fn sum(self) -> L::Number {
        self.lanes.sum(self.numbers)
    }

    /// The whole part of numbers between 0 and 2^22.
    #[inline(always)]
    pub fn floor(self) -> Self {
        Self { numbers: self.lanes.floor(self.numbers), ..self }
    }

    /// Whole numbers between 0 and 2^22, to the first of these places.
    #[inline(always)]
    pub fn store_whole(self, places: &mut [u32; LANES]) {
        self.lanes.store_whole(self.numbers, places);
    }

    /// Where it is `b` or more.
    #[inline(always)]
    pub fn at_least(self, b: Self) -> Mask<L> {
        Mask { lanes: self.lanes, truths: self.lanes.at_least(self.numbers, b.numbers) }
    }

    /// Where it is more than `b`.
    #[inline(always)]
    pub fn above(self, b: Self) -> Mask<L> {
        Mask { lanes: self.lanes, truths: self.lanes.above(self.numbers, b.numbers) }
    }

    /// Zero where the mask does not hold.
    #[inline(always)]
    pub fn keep(self, mask: Mask<L>) -> Self {
        Self { numbers: self.lanes.keep(mask.truths, self.numbers), ..self }
    }
}

/// Not inlined, so that loops over whole rows keep their registers.
#[cold]
#[inline(never)]
fn load_end<T: Real>(end: &[T]) -> [T; LANES] {
    let mut values = [T::zero(); LANES];
    values[..end.len()].copy_from_slice(end);
    values
}

#[cold]
#[inline(never)]
fn store_end<T: Real>(end: &mut [T], values: &[T; LANES]) {
    end.copy_from_slice(&values[..end.len()]);
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

    /// As bits, the first lane lowest.
    #[inline(always)]
    pub fn bits(self) -> u32 {
        self.lanes.bits(self.truths)
    }

    /// Whether it holds anywhere.
    #[inline(always)]
    pub fn any(self) -> bool {
        self.bits() != 0
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
struct Compiled<S, K, const N: usize>(S, K);

impl<S: Processor, K: Kernel<f32>, const N: usize> pulp::NullaryFnOnce for Compiled<S, K, N> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        self.1.run(Registers::<S, N>(self.0));
    }
}

/// What `pulp` has no common name for.
trait Processor: Simd {
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

/// What [`Lanes::exp2`] takes: 1.5 * 2^23, the coefficients of a polynomial that interpolates 2^f in the Chebyshev
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

/// Constants of powers of two, in rows.
pub struct Exp2<L: Lanes> {
    numbers: [L::Numbers; 7],
}

impl<L: Lanes> Exp2<L> {
    /// In every lane.
    #[inline(always)]
    pub fn new(lanes: L) -> Self {
        let mut numbers = [lanes.splat(L::Number::zero()); 7];
        for k in 0..7 {
            numbers[k] = lanes.splat(L::Number::of(f64::from(EXP2[k])));
        }
        Self { numbers }
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

/// f64 in an array: gradients are checked with it.
#[derive(Clone, Copy)]
struct Exact;

impl Lanewise for f64 {
    fn dispatch(kernel: impl Kernel<f64>) {
        kernel.run(Exact);
    }
}

impl Lanes for Exact {
    const WIDTH: usize = 8;
    type Number = f64;
    type Numbers = [f64; 8];
    type Truths = [bool; 8];

    fn splat(self, value: f64) -> [f64; 8] {
        [value; 8]
    }
    fn load(self, values: &[f64]) -> [f64; 8] {
        std::array::from_fn(|i| values[i])
    }
    fn store(self, a: [f64; 8], places: &mut [f64]) {
        places[..8].copy_from_slice(&a);
    }
    fn add(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i] + b[i])
    }
    fn sub(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i] - b[i])
    }
    fn mul(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i] * b[i])
    }
    fn div(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i] / b[i])
    }
    fn reciprocal(self, a: [f64; 8]) -> [f64; 8] {
        a.map(f64::recip)
    }
    fn mul_add(self, a: [f64; 8], b: [f64; 8], c: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i] * b[i] + c[i])
    }
    fn min(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i].min(b[i]))
    }
    fn max(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i].max(b[i]))
    }
    fn sqrt(self, a: [f64; 8]) -> [f64; 8] {
        a.map(f64::sqrt)
    }
    fn exp2(self, a: [f64; 8], _: &[[f64; 8]; 7]) -> [f64; 8] {
        a.map(f64::exp2)
    }
    fn log2(self, a: [f64; 8]) -> [f64; 8] {
        a.map(f64::log2)
    }
    fn sum(self, a: [f64; 8]) -> f64 {
        a.iter().sum()
    }
    fn floor(self, a: [f64; 8]) -> [f64; 8] {
        a.map(f64::floor)
    }
    fn store_whole(self, a: [f64; 8], places: &mut [u32; LANES]) {
        places[..8].copy_from_slice(&a.map(|v| v as u32));
    }
    fn at_least(self, a: [f64; 8], b: [f64; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] >= b[i])
    }
    fn above(self, a: [f64; 8], b: [f64; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] > b[i])
    }
    fn and(self, a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] && b[i])
    }
    fn bits(self, a: [bool; 8]) -> u32 {
        a.iter().enumerate().fold(0, |bits, (i, holds)| bits | u32::from(*holds) << i)
    }
    fn keep(self, truths: [bool; 8], a: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| if truths[i] { a[i] } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Compare;

    fn lane<L: Lanes>(row: Row<L>, k: usize) -> L::Number {
        let mut values = [L::Number::zero(); LANES];
        row.store_to(&mut values, 0);
        values[k]
    }

    impl Kernel<f32> for Compare {
        fn run<L: Lanes<Number = f32>>(self, lanes: L) {
            for i in -1200..1200 {
                let x = i as f32 * 0.01;
                let exact = f64::from(x).exp2();
                let power = Row::splat(lanes, x).exp2();
                assert!((f64::from(lane(power, 3)) - exact).abs() < 3e-7 * exact, "{x}");
                let y = lane(power, 5);
                let error = (f64::from(lane(power.log2(), 7)) - f64::from(y).log2()).abs();
                assert!(error < 3e-7 * f64::from(x.abs().max(1.0)), "{x}: {error:e}");
            }
            for (x, sign) in [(1.5, 1.0), (0.0, 0.0), (-0.25, -1.0), (f32::NAN, 0.0)] {
                let row = Row::splat(lanes, x);
                assert_eq!(lane(row.sign(), 1), sign);
                assert!(x.is_nan() || lane(row.abs(), 4) == x.abs());
                let positive = row.above(Row::splat(lanes, 0.0));
                assert_eq!((lane(row.keep(positive), 3), positive.any()), (x.max(0.0), x > 0.0));
            }
            for x in [0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.5, 7.999_999, 1e6 + 0.5, 4_194_303.5] {
                let whole = Row::splat(lanes, x).floor();
                assert_eq!(lane(whole, 2), x.floor());
                let mut places = [0; LANES];
                whole.store_whole(&mut places);
                assert_eq!(places[6], x as u32);
            }
        }
    }

    #[test]
    fn exponentials_and_logarithms_are_within_3e7_and_all_else_is_exact() {
        f32::dispatch(Compare);
        #[cfg(target_arch = "x86_64")]
        if let Some(s) = pulp::x86::V3::try_new() {
            s.vectorize(Compiled::<_, _, 1>(s, Compare));
        }
        Compare.run(Registers::<_, 8>(pulp::Scalar::new()));
    }

    #[test]
    fn slices_are_read_and_written_to_their_end() {
        let values: Vec<f64> = (0..20).map(f64::from).collect();
        let tail = Row::load_from(Exact, &values, 17);
        assert_eq!([0, 1, 2, 3].map(|k| lane(tail, k)), [17.0, 18.0, 19.0, 0.0]);
        let mut out = [0.0; 18];
        tail.store_to(&mut out, 16);
        assert_eq!(out[15..], [0.0, 17.0, 18.0]);
    }
}
