//! Colours that depend on the direction of view: real spherical harmonics to degree 3, as 3DGS has them.
//!
//! With the unit vector `d` from the camera's centre to the splat's, a channel of the splat's colour is
//! `max(0, 0.5 + Σ c_k B_k(d))`. The first coefficient is `f_dc`, whose basis function is constant; the other fifteen are
//! `f_rest`, in the order of 3DGS: degree by degree, and in a degree from the lowest order to the highest. The gradient has a
//! part by the position, since the direction changes with it.

use super::splats::{SH_C0, Splats, color_from_f_dc, f_dc_gradient};
use crate::simd::{
    Arithmetic, MAX_LANES, Real, Simd, SimdKernel, SimdMask, SimdReal, SimdVec, arrays_of_lanes,
    broadcast_each,
};
use rayon::prelude::*;

/// Highest degree.
pub const MAX_DEGREE: usize = 3;
/// Number of coefficients of a colour channel in `f_rest`.
const REST: usize = 15;
/// The same, filled up to whole vectors.
const PADDED: usize = MAX_LANES;
/// Number of splats that one task works on.
const PIECE: usize = 64 * MAX_LANES;

/// Factor of the basis functions of degree 1; those of degrees 2 and 3 follow.
pub const C1: f64 = 0.488_602_511_902_919_9;
/// See [`C1`].
pub const C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
/// See [`C1`].
pub const C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_8,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];

/// From where splats are seen, and how many of their coefficients count.
#[derive(Clone, Copy, Debug)]
pub struct SeenFrom<T> {
    /// The camera's centre, site metres.
    pub center: [T; 3],
    /// Degree of the spherical harmonics that are used, at most [`MAX_DEGREE`]; those above count as zero.
    pub degree: usize,
}

impl<T: Real> SeenFrom<T> {
    /// Number of coefficients of a channel in `f_rest` that count.
    fn used(&self) -> usize {
        coefficients_used(self.degree)
    }
}

/// Number of coefficients of a channel in `f_rest` that count at a degree.
#[must_use]
pub fn coefficients_used(degree: usize) -> usize {
    let degree = degree.min(MAX_DEGREE);
    (degree + 1) * (degree + 1) - 1
}

/// Computes the colour of each splat.
pub fn colors<T: SimdReal>(splats: &Splats<T>, from: &SeenFrom<T>, colors: &mut Vec<[T; 3]>) {
    colors.resize(splats.len(), [T::zero(); 3]);
    colors.par_chunks_mut(PIECE).enumerate().for_each(|(k, colors)| {
        T::dispatch(Colors { splats, from, first: k * PIECE, colors });
    });
}

/// The gradient of [`colors()`]: writes the derivatives with respect to `f_dc` and `f_rest` and adds those with respect to the
/// positions, from those with respect to the colours. `gradient` has as many splats and the same groups as `splats`.
pub fn colors_backward<T: SimdReal>(
    splats: &Splats<T>,
    from: &SeenFrom<T>,
    colors: &[[T; 3]],
    by_colors: &[[T; 3]],
    gradient: &mut Splats<T>,
) {
    let run = |k: usize, position: &mut [[T; 3]], f_dc: &mut [[T; 3]], f_rest: &mut [[T; 3 * REST]]| {
        let first = k * PIECE;
        let range = first..first + position.len();
        let (colors, by_colors) = (&colors[range.clone()], &by_colors[range]);
        T::dispatch(ColorsBackward { splats, from, first, colors, by_colors, position, f_dc, f_rest });
    };
    let (position, f_dc) = (gradient.position.par_chunks_mut(PIECE), gradient.f_dc.par_chunks_mut(PIECE));
    if splats.f_rest.is_empty() {
        position.zip(f_dc).enumerate().for_each(|(k, (position, f_dc))| run(k, position, f_dc, &mut []));
    } else {
        let outputs = position.zip(f_dc).zip(gradient.f_rest.par_chunks_mut(PIECE)).enumerate();
        outputs.for_each(|(k, ((position, f_dc), f_rest))| run(k, position, f_dc, f_rest));
    }
}

/// The splats as they look from so far away that all are seen in one direction, a unit vector from the observer to them:
/// their colours no longer depend on the direction.
#[must_use]
pub fn seen_along(mut splats: Splats, direction: [f64; 3]) -> Splats {
    let basis = basis_of(direction);
    for (f_dc, rest) in splats.f_dc.iter_mut().zip(&splats.f_rest) {
        for (f, rest) in f_dc.iter_mut().zip(rest.as_chunks::<REST>().0) {
            let sum: f64 = basis.iter().zip(rest).map(|(b, c)| b * f64::from(*c)).sum();
            *f += (sum / SH_C0) as f32;
        }
    }
    splats.f_rest.clear();
    splats
}

/// The fifteen basis functions above degree 0 for a unit vector, in the order of `f_rest`.
pub(super) fn basis_of(direction: [f64; 3]) -> [f64; REST] {
    basis(direction, &Factors::plain())
}

/// The numbers of the basis functions: scalars, or vectors with the same value in each lane.
struct Factors<N> {
    c1: [N; 2],
    c2: [N; 5],
    c3: [N; 7],
    two: N,
    three: N,
    four: N,
}

impl Factors<f64> {
    fn plain() -> Self {
        Self { c1: [-C1, C1], c2: C2, c3: C3, two: 2.0, three: 3.0, four: 4.0 }
    }
}

impl<S: Simd> Factors<SimdVec<S>> {
    #[inline(always)]
    fn broadcast(simd: S) -> Self {
        let plain = Factors::plain();
        let [two, three, four] =
            broadcast_each(simd, [plain.two, plain.three, plain.four].map(Real::from_f64));
        Self {
            c1: broadcast_each(simd, plain.c1.map(Real::from_f64)),
            c2: broadcast_each(simd, plain.c2.map(Real::from_f64)),
            c3: broadcast_each(simd, plain.c3.map(Real::from_f64)),
            two,
            three,
            four,
        }
    }
}

/// The fifteen basis functions above degree 0 for a unit vector.
#[inline(always)]
fn basis<N: Arithmetic>([x, y, z]: [N; 3], f: &Factors<N>) -> [N; REST] {
    let (xx, yy, zz, xy) = (x * x, y * y, z * z, x * y);
    let (c1, c2, c3) = (&f.c1, &f.c2, &f.c3);
    let four_zz_less = f.four * zz - xx - yy;
    [
        c1[0] * y,
        c1[1] * z,
        c1[0] * x,
        c2[0] * xy,
        c2[1] * y * z,
        c2[2] * (f.two * zz - xx - yy),
        c2[3] * x * z,
        c2[4] * (xx - yy),
        c3[0] * y * (f.three * xx - yy),
        c3[1] * xy * z,
        c3[2] * y * four_zz_less,
        c3[3] * z * (f.two * zz - f.three * (xx + yy)),
        c3[4] * x * four_zz_less,
        c3[5] * z * (xx - yy),
        c3[6] * x * (xx - f.three * yy),
    ]
}

/// The derivatives by the unit vector of the sum of the basis functions with the weights `w`.
#[inline(always)]
fn by_direction<N: Arithmetic>([x, y, z]: [N; 3], mut w: [N; REST], f: &Factors<N>) -> [N; 3] {
    let (xx, yy, zz, xy, yz, xz) = (x * x, y * y, z * z, x * y, y * z, x * z);
    let (two, three, four) = (f.two, f.three, f.four);
    let (six, eight) = (two * three, two * four);
    for k in 0..3 {
        w[k] = w[k] * f.c1[k % 2];
    }
    for k in 0..5 {
        w[3 + k] = w[3 + k] * f.c2[k];
    }
    for k in 0..7 {
        w[8 + k] = w[8 + k] * f.c3[k];
    }
    let by_x = w[2]
        + y * w[3]
        + z * w[6]
        + two * x * (w[7] - w[5])
        + six * (xy * w[8] - xz * w[11])
        + yz * w[9]
        + (four * zz - three * xx - yy) * w[12]
        + three * (xx - yy) * w[14]
        + two * (xz * w[13] - xy * w[10]);
    let by_y = w[0] + x * w[3] + z * w[4] - two * y * (w[5] + w[7])
        + three * (xx - yy) * w[8]
        + xz * w[9]
        + (four * zz - xx - three * yy) * w[10]
        - six * (yz * w[11] + xy * w[14])
        - two * (xy * w[12] + yz * w[13]);
    let by_z = w[1]
        + y * w[4]
        + four * z * w[5]
        + x * w[6]
        + xy * w[9]
        + eight * (yz * w[10] + xz * w[12])
        + (six * zz - three * (xx + yy)) * w[11]
        + (xx - yy) * w[13];
    [by_x, by_y, by_z]
}

/// Unit vectors from the centre of the camera to splats, one in each lane, and the reciprocals of the distances.
#[inline(always)]
fn directions<S: Simd>(
    simd: S,
    position: &[[S::Scalar; 3]],
    center: [S::Scalar; 3],
) -> ([SimdVec<S>; 3], SimdVec<S>) {
    let mut axes = [[S::Scalar::from_f64(1.0); MAX_LANES]; 3];
    for (i, p) in position.iter().enumerate() {
        for k in 0..3 {
            axes[k][i] = p[k] - center[k];
        }
    }
    let [x, y, z] =
        [SimdVec::load(simd, &axes[0]), SimdVec::load(simd, &axes[1]), SimdVec::load(simd, &axes[2])];
    let least = SimdVec::broadcast(simd, S::Scalar::from_f64(1e-24));
    let inverse = (x * x + y * y + z * z).max(least).sqrt().reciprocal();
    ([x * inverse, y * inverse, z * inverse], inverse)
}

/// The basis functions of each lane, zero for those that are not used.
#[inline(always)]
fn basis_rows<S: Simd>(simd: S, direction: [SimdVec<S>; 3], used: usize) -> [[S::Scalar; PADDED]; MAX_LANES] {
    let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
    let all = basis(direction, &Factors::broadcast(simd));
    let mut halves = [[zero; 8]; 2];
    for k in 0..used {
        halves[k / 8][k % 8] = all[k];
    }
    let (low, high) = (arrays_of_lanes(halves[0]), arrays_of_lanes(halves[1]));
    let mut out = [[S::Scalar::from_f64(0.0); PADDED]; MAX_LANES];
    for (row, (low, high)) in out.iter_mut().zip(low.iter().zip(&high)) {
        row[..8].copy_from_slice(low);
        row[8..].copy_from_slice(high);
    }
    out
}

/// The coefficients of a channel that starts at an index of the flat `f_rest`, from the `k`-th on; zero beyond its end.
#[inline(always)]
fn channel<S: Simd>(simd: S, rest: &[S::Scalar], start: usize, k: usize, own: SimdMask<S>) -> SimdVec<S> {
    SimdVec::load_from(simd, rest, start + k).select_or_zero(own)
}

/// For each vector of a channel's coefficients, the lanes that belong to it.
#[inline(always)]
fn own_lanes<S: Simd>(simd: S) -> [SimdMask<S>; 2] {
    [SimdMask::first(simd, REST), SimdMask::first(simd, REST.saturating_sub(S::WIDTH))]
}

/// The colours of the splats with indices from `first` on.
struct Colors<'a, T> {
    splats: &'a Splats<T>,
    from: &'a SeenFrom<T>,
    first: usize,
    colors: &'a mut [[T; 3]],
}

impl<T: SimdReal> SimdKernel<T> for Colors<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { splats, from, .. } = self;
        let rest = splats.f_rest.as_flattened();
        let used = if rest.is_empty() { 0 } else { from.used() };
        let (zero, own) = (SimdVec::broadcast(simd, T::zero()), own_lanes(simd));
        for (block, colors) in self.colors.chunks_mut(S::WIDTH).enumerate() {
            let first = self.first + block * S::WIDTH;
            for (i, color) in colors.iter_mut().enumerate() {
                *color = color_from_f_dc(splats.f_dc[first + i]);
            }
            if used > 0 {
                let (direction, _) =
                    directions(simd, &splats.position[first..first + colors.len()], from.center);
                let rows = basis_rows(simd, direction, used);
                for (i, color) in colors.iter_mut().enumerate() {
                    for c in 0..3 {
                        let start = ((first + i) * 3 + c) * REST;
                        let mut sum = zero;
                        for (j, k) in (0..PADDED).step_by(S::WIDTH).enumerate() {
                            let basis = SimdVec::load(simd, &rows[i][k..]);
                            sum = basis.mul_add(channel(simd, rest, start, k, own[j]), sum);
                        }
                        color[c] = color[c] + sum.sum();
                    }
                }
            }
            colors.iter_mut().for_each(|color| *color = color.map(|v| v.max(T::zero())));
        }
    }
}

/// The gradient of [`Colors`]; `f_rest` is empty for splats without coefficients.
struct ColorsBackward<'a, T> {
    splats: &'a Splats<T>,
    from: &'a SeenFrom<T>,
    first: usize,
    colors: &'a [[T; 3]],
    by_colors: &'a [[T; 3]],
    position: &'a mut [[T; 3]],
    f_dc: &'a mut [[T; 3]],
    f_rest: &'a mut [[T; 3 * REST]],
}

impl<T: SimdReal> SimdKernel<T> for ColorsBackward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { splats, from, .. } = self;
        let rest = splats.f_rest.as_flattened();
        let by_rest = self.f_rest.as_flattened_mut();
        let factors = Factors::broadcast(simd);
        let used = if rest.is_empty() { 0 } else { from.used() };
        let (zero, own) = (SimdVec::broadcast(simd, T::zero()), own_lanes(simd));
        for start in (0..self.colors.len()).step_by(S::WIDTH) {
            let (first, count) = (self.first + start, S::WIDTH.min(self.colors.len() - start));
            let (direction, inverse) = directions(simd, &splats.position[first..first + count], from.center);
            let rows = basis_rows(simd, direction, used);
            // The weights of the basis functions, lane by lane.
            let mut weights = [[T::zero(); MAX_LANES]; PADDED];
            for i in 0..count {
                // Colours that are clamped at zero have no derivative.
                let (color, by) = (self.colors[start + i], self.by_colors[start + i]);
                let by: [T; 3] = [0, 1, 2].map(|c| if color[c] > T::zero() { by[c] } else { T::zero() });
                self.f_dc[start + i] = f_dc_gradient(by);
                if by_rest.is_empty() {
                    continue;
                }
                if by == [T::zero(); 3] {
                    by_rest[(start + i) * 3 * REST..][..3 * REST].fill(T::zero());
                    continue;
                }
                let mut weight = [zero; 2];
                for c in 0..3 {
                    let by = SimdVec::broadcast(simd, by[c]);
                    let (from, to) = (((first + i) * 3 + c) * REST, ((start + i) * 3 + c) * REST);
                    for (j, k) in (0..PADDED).step_by(S::WIDTH).enumerate() {
                        let basis = SimdVec::load(simd, &rows[i][k..]);
                        weight[j] = by.mul_add(channel(simd, rest, from, k, own[j]), weight[j]);
                        // The last lane belongs to the next channel, which is written later.
                        (by * basis).store_to(by_rest, to + k);
                    }
                }
                let mut lanes = [T::zero(); PADDED];
                for (j, k) in (0..PADDED).step_by(S::WIDTH).enumerate() {
                    weight[j].store_to(&mut lanes, k);
                }
                for k in 0..used {
                    weights[k][i] = lanes[k];
                }
            }
            if used == 0 {
                continue;
            }
            let mut w = [zero; REST];
            for k in 0..used {
                w[k] = SimdVec::load(simd, &weights[k]);
            }
            let by = by_direction(direction, w, &factors);
            let along = by[0] * direction[0] + by[1] * direction[1] + by[2] * direction[2];
            for k in 0..3 {
                let mut by_position = [T::zero(); MAX_LANES];
                ((by[k] - direction[k] * along) * inverse).store_to(&mut by_position, 0);
                for i in 0..count {
                    let place = &mut self.position[start + i][k];
                    *place = *place + by_position[i];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;

    fn scene(n: usize) -> Splats<f64> {
        let mut out = Splats::<f64>::zeros(n);
        out.f_rest.resize(n, [0.0; 45]);
        for (g, group) in out.groups_mut().into_iter().enumerate() {
            for (i, v) in group.iter_mut().enumerate() {
                *v = 1.5 * CounterRng::new(3, g as u64, 0, i as u64).normal();
            }
        }
        out
    }

    fn from(degree: usize) -> SeenFrom<f64> {
        SeenFrom { center: [3.0, -2.0, 1.5], degree }
    }

    /// A loss that is linear in the colours.
    fn weight(i: usize, c: usize) -> f64 {
        ((7 * i + 3 * c) as f64).sin()
    }

    fn loss(splats: &Splats<f64>, degree: usize) -> f64 {
        let mut found = Vec::new();
        colors(splats, &from(degree), &mut found);
        found.iter().enumerate().flat_map(|(i, rgb)| (0..3).map(move |c| weight(i, c) * rgb[c])).sum()
    }

    #[test]
    fn the_gradient_agrees_with_central_differences() {
        // More splats than a vector has lanes, and no multiple of them.
        for (n, degree) in [(21, 0), (21, 1), (5, 2), (37, 3)] {
            let splats = scene(n);
            let mut found = Vec::new();
            colors(&splats, &from(degree), &mut found);
            assert!(degree < 3 || found.as_flattened().contains(&0.0), "some are clamped");
            let by: Vec<[f64; 3]> = (0..n).map(|i| [0, 1, 2].map(|c| weight(i, c))).collect();
            let mut gradient = Splats::default();
            gradient.resize_like(&splats);
            gradient.f_rest.fill([9.0; 45]);
            colors_backward(&splats, &from(degree), &found, &by, &mut gradient);
            for group in 0..3 {
                for k in 0..splats.groups()[group].len() {
                    let shifted = |e: f64| {
                        let mut s = splats.clone();
                        s.groups_mut()[group][k] += e;
                        loss(&s, degree)
                    };
                    let expected = (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
                    let value = gradient.groups()[group][k];
                    assert!(
                        (value - expected).abs() < 1e-6 * expected.abs().max(1.0),
                        "degree {degree}, group {group}, {k}: {value} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_basis_functions_are_orthonormal() {
        // Sums over directions that are even over the sphere (a Fibonacci lattice).
        let n = 20_000;
        let mut products = [[0.0; REST]; REST];
        for i in 0..n {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
            let (sin, cos) = (f64::from(i) * 2.399_963_229_728_653).sin_cos();
            let radius = (1.0 - z * z).sqrt();
            let b = basis([radius * cos, radius * sin, z], &Factors::plain());
            for j in 0..REST {
                for k in 0..REST {
                    products[j][k] += 4.0 * std::f64::consts::PI / f64::from(n) * b[j] * b[k];
                }
            }
        }
        for (j, row) in products.iter().enumerate() {
            for (k, p) in row.iter().enumerate() {
                let expected = if j == k { 1.0 } else { 0.0 };
                assert!((p - expected).abs() < 2e-3, "{j} {k}: {p}");
            }
        }
    }

    #[test]
    fn f32_agrees_with_f64_and_splats_seen_from_afar_with_those_seen_along_one_direction() {
        let splats = scene(50);
        let (mut exact, mut fast, mut flat) = (Vec::new(), Vec::new(), Vec::new());
        colors(&splats, &from(3), &mut exact);
        let center = from(3).center.map(|v| v as f32);
        colors(&splats.narrow(), &SeenFrom { center, degree: 3 }, &mut fast);
        for (a, b) in exact.as_flattened().iter().zip(fast.as_flattened()) {
            assert!((a - f64::from(*b)).abs() < 1e-4, "{a} {b}");
        }
        let far = SeenFrom { center: [0.0, 6e6, 8e6], degree: 3 };
        colors(&splats.narrow(), &far, &mut fast);
        let baked = seen_along(splats.narrow(), [0.0, -0.6, -0.8]);
        assert!(baked.f_rest.is_empty());
        colors(&baked, &SeenFrom { center, degree: 3 }, &mut flat);
        for (a, b) in fast.as_flattened().iter().zip(flat.as_flattened()) {
            assert!((a - b).abs() < 1e-4, "{a} {b}");
        }
    }

    #[test]
    fn a_splat_with_values_that_are_not_finite_changes_no_other() {
        let sound = scene(3).narrow();
        let seen = SeenFrom { center: [3.0, -2.0, 1.5], degree: 3 };
        let mut expected = Vec::new();
        colors(&sound, &seen, &mut expected);
        let mut broken = sound;
        broken.f_rest[1] = [f32::NAN; 45];
        broken.position[1] = [f32::INFINITY; 3];
        let mut found = Vec::new();
        colors(&broken, &seen, &mut found);
        assert!(found[0] == expected[0] && found[2] == expected[2]);
        let mut gradient = Splats::default();
        gradient.resize_like(&broken);
        colors_backward(&broken, &seen, &found, &[[1.0; 3]; 3], &mut gradient);
        assert!([0, 2].iter().all(|i| gradient.position[*i].iter().all(|v| v.is_finite())));
    }
}
