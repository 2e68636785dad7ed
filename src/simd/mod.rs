//! Eight or sixteen numbers at once, as the kernels compute: in a vector register, or in an array where there is none.

mod exact;
mod real;
mod registers;

pub use real::Real;

use num_traits::Zero;
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
    /// The lower halves of both, and the upper halves.
    fn halves(self, a: Self::Numbers, b: Self::Numbers) -> [Self::Numbers; 2];
    /// Of sixteen lanes the first and third four of both, and the second and fourth.
    fn quarters(self, a: Self::Numbers, b: Self::Numbers) -> [Self::Numbers; 2];
    /// Eight lanes from each array, as far as the row goes.
    fn load_eights(self, eights: [&[Self::Number; 8]; 2]) -> Self::Numbers;
    /// What [`Lanes::load_eights`] reads.
    fn store_eights(self, a: Self::Numbers, eights: [&mut [Self::Number; 8]; 2]);
    /// Of every four lanes, lane `j` of row `k` and lane `k` of row `j` exchanged.
    fn transpose_fours(self, rows: [Self::Numbers; 4]) -> [Self::Numbers; 4];
    /// Of every eight lanes, lane `j` of row `k` and lane `k` of row `j` exchanged.
    fn transpose_eights(self, rows: [Self::Numbers; 8]) -> [Self::Numbers; 8];
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
    /// Square root of positive numbers, relative error below 4e-4.
    fn rough_sqrt(self, a: Self::Numbers) -> Self::Numbers;
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
    /// Numbers of the lanes in which it holds, counted from `first` on, to the first of at least [`LANES`] places; gives how
    /// many they are. What is left in the places after them is anything.
    fn list(self, a: Self::Truths, first: u8, places: &mut [u8]) -> usize;
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

    /// Eight lanes from each array, as far as the row goes.
    #[inline(always)]
    pub fn load_eights(lanes: L, eights: [&[L::Number; 8]; 2]) -> Self {
        Self { lanes, numbers: lanes.load_eights(eights) }
    }

    /// The lower halves of both, and the upper halves.
    #[inline(always)]
    fn halves(self, b: Self) -> [Self; 2] {
        rows_of(self.lanes, self.lanes.halves(self.numbers, b.numbers))
    }

    /// Of sixteen lanes the first and third four of both, and the second and fourth.
    #[inline(always)]
    fn quarters(self, b: Self) -> [Self; 2] {
        rows_of(self.lanes, self.lanes.quarters(self.numbers, b.numbers))
    }

    /// What [`Row::load_eights`] reads.
    #[inline(always)]
    pub fn store_eights(self, eights: [&mut [L::Number; 8]; 2]) {
        self.lanes.store_eights(self.numbers, eights);
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

    /// Square root of positive numbers, relative error below 4e-4; faster.
    #[inline(always)]
    pub fn rough_sqrt(self) -> Self {
        Self { numbers: self.lanes.rough_sqrt(self.numbers), ..self }
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

/// Of every four lanes, lane `j` of row `k` and lane `k` of row `j` exchanged.
#[inline(always)]
pub fn transpose_fours<L: Lanes>(rows: [Row<L>; 4]) -> [Row<L>; 4] {
    let lanes = rows[0].lanes;
    rows_of(lanes, lanes.transpose_fours(numbers_of(rows)))
}

/// Of every eight lanes, lane `j` of row `k` and lane `k` of row `j` exchanged.
#[inline(always)]
pub fn transpose_eights<L: Lanes>(rows: [Row<L>; 8]) -> [Row<L>; 8] {
    let lanes = rows[0].lanes;
    rows_of(lanes, lanes.transpose_eights(numbers_of(rows)))
}

/// Eight rows as arrays: of each lane its eight numbers.
#[inline(always)]
pub fn arrays_of_lanes<L: Lanes>(rows: [Row<L>; 8]) -> [[L::Number; 8]; LANES] {
    let mut out = [[L::Number::zero(); 8]; LANES];
    let (low, high) = out.split_at_mut(8);
    for (row, (low, high)) in transpose_eights(rows).into_iter().zip(low.iter_mut().zip(high)) {
        row.store_eights([low, high]);
    }
    out
}

/// Four blocks of pixels side by side, four columns wide, from the lines of sixteen pixels through them, one after the
/// other.
#[inline(always)]
pub fn blocks_of_lines<L: Lanes>([a, b, c, d]: [Row<L>; 4]) -> [Row<L>; 4] {
    if L::WIDTH == LANES {
        // Four blocks of four lines of four pixels: the same exchange.
        return lines_of_blocks([a, b, c, d]);
    }
    let ([first, second], [third, fourth]) = (a.halves(c), b.halves(d));
    [first, second, third, fourth]
}

/// What [`blocks_of_lines`] takes.
#[inline(always)]
pub fn lines_of_blocks<L: Lanes>([a, b, c, d]: [Row<L>; 4]) -> [Row<L>; 4] {
    let ([low_left, high_left], [low_right, high_right]) = (a.halves(b), c.halves(d));
    if L::WIDTH < LANES {
        return [low_left, low_right, high_left, high_right];
    }
    let ([first, second], [third, fourth]) = (low_left.quarters(low_right), high_left.quarters(high_right));
    [first, second, third, fourth]
}

/// Sixteen numbers in as many rows as hold them, the rest of two left over: from each of `rows` four sums over its
/// fours.
#[inline(always)]
pub fn sum_fours<L: Lanes>([a, b, c, d]: [Row<L>; 4]) -> [Row<L>; 2] {
    let ([low, high], [low_after, high_after]) = (a.halves(b), c.halves(d));
    let sums = [low + high, low_after + high_after];
    if L::WIDTH < LANES {
        return sums;
    }
    let [even, odd] = sums[0].quarters(sums[1]);
    [even + odd; 2]
}

#[inline(always)]
fn numbers_of<L: Lanes, const C: usize>(rows: [Row<L>; C]) -> [L::Numbers; C] {
    let mut out = [rows[0].numbers; C];
    for c in 1..C {
        out[c] = rows[c].numbers;
    }
    out
}

#[inline(always)]
fn rows_of<L: Lanes, const C: usize>(lanes: L, numbers: [L::Numbers; C]) -> [Row<L>; C] {
    let mut out = [Row { lanes, numbers: numbers[0] }; C];
    for c in 1..C {
        out[c].numbers = numbers[c];
    }
    out
}

impl<L: Lanes> Mask<L> {
    /// The first `count` lanes: those that what is left of a line still fills.
    #[inline(always)]
    pub fn first(lanes: L, count: usize) -> Self {
        Row::splat(lanes, L::Number::of(count as f64)).above(Row::numbers(lanes))
    }

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

    /// Numbers of the lanes in which it holds, counted from `first` on, to the first of at least [`LANES`] places; gives how
    /// many they are. What is left in the places after them is anything.
    #[inline(always)]
    pub fn list(self, first: u8, places: &mut [u8]) -> usize {
        self.lanes.list(self.truths, first, places)
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

/// The places of the bits that are set, lowest first.
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

/// A one in every byte.
const ONES: u64 = 0x0101_0101_0101_0101;

/// The places of a byte's set bits, a byte each, lowest first.
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

/// [`Lanes::list`] of eight lanes: a table knows where the bits of a byte are.
#[inline(always)]
fn list_eight(bits: u8, first: u8, places: &mut [u8]) -> usize {
    let numbers = PLACES[usize::from(bits)] + u64::from(first) * ONES;
    places[..8].copy_from_slice(&numbers.to_le_bytes());
    bits.count_ones() as usize
}

#[cfg(test)]
mod tests;
