//! SIMD kernels of the RPC model in f64. The instruction set is chosen at run time.

use super::model::TERMS;
use pulp::{Simd, WithSimd};

/// Residual below which a localisation has converged, pixels.
const TOLERANCE_PX: f64 = 0.5e-8;
/// Number of steps with the fixed Jacobian; Newton's method continues with points that have not converged by then.
const MAX_STEPS: usize = 6;

/// Coefficients of an RPC in the layout of the kernels.
#[derive(Clone, Copy)]
pub(super) struct KernelModel {
    /// Numerator and denominator of the column, then of the row; terms in the order of RPC00B.
    pub(super) terms: [[f64; TERMS]; 4],
    /// Offsets of longitude, latitude, height.
    pub(super) ground_offset: [f64; 3],
    /// Their scales.
    pub(super) ground_scale: [f64; 3],
    /// Offsets of column and row.
    pub(super) image_offset: [f64; 2],
    /// Their scales.
    pub(super) image_scale: [f64; 2],
}

/// Cubic polynomials that approximate the ground position as a function of (column, row, height), each normalised to
/// [-1, 1]. They give the starting points of localisation.
#[derive(Clone, Copy)]
pub(super) struct StartPolynomials {
    /// Coefficients of normalised longitude and of normalised latitude.
    pub(super) terms: [[f64; TERMS]; 2],
    /// Centres of the ranges of column, row and height.
    pub(super) offset: [f64; 3],
    /// Half widths of these ranges.
    pub(super) scale: [f64; 3],
    /// Inverse Jacobian at the centre: derivatives of normalised (longitude, latitude) by (column, row), per pixel.
    pub(super) inverse: [[f64; 2]; 2],
}

/// Projects points; all slices have the same length.
pub(super) struct Project<'a> {
    pub(super) model: &'a KernelModel,
    pub(super) lon: &'a [f64],
    pub(super) lat: &'a [f64],
    pub(super) height: &'a [f64],
    pub(super) col: &'a mut [f64],
    pub(super) row: &'a mut [f64],
}

/// Localises points; all slices have the same length. Points that do not converge become NaN.
pub(super) struct Localize<'a> {
    pub(super) model: &'a KernelModel,
    pub(super) start: &'a StartPolynomials,
    pub(super) col: &'a [f64],
    pub(super) row: &'a [f64],
    pub(super) height: &'a [f64],
    pub(super) lon: &'a mut [f64],
    pub(super) lat: &'a mut [f64],
}

/// The coefficients of a polynomial, each broadcast to all SIMD lanes.
type Terms<S> = [<S as Simd>::f64s; TERMS];

#[inline(always)]
fn splat_terms<S: Simd>(simd: S, terms: &[f64; TERMS]) -> Terms<S> {
    // This is a loop over indices because a closure would not be compiled for the wide instruction set.
    let mut out = [simd.splat_f64s(0.0); TERMS];
    for k in 0..TERMS {
        out[k] = simd.splat_f64s(terms[k]);
    }
    out
}

/// A cubic polynomial by Horner's scheme in each variable, with nineteen multiply-adds.
#[inline(always)]
fn cubic<S: Simd>(s: S, c: &Terms<S>, l: S::f64s, p: S::f64s, h: S::f64s) -> S::f64s {
    let of_h = s.mul_add_e_f64s(h, s.mul_add_e_f64s(h, s.mul_add_e_f64s(h, c[19], c[9]), c[3]), c[0]);
    let of_ll = s.mul_add_e_f64s(h, c[17], s.mul_add_e_f64s(l, c[11], c[7]));
    let of_lp = s.mul_add_e_f64s(h, c[10], s.mul_add_e_f64s(l, c[14], c[4]));
    let of_pp = s.mul_add_e_f64s(h, c[18], s.mul_add_e_f64s(p, c[15], s.mul_add_e_f64s(l, c[12], c[8])));
    let of_l = s.mul_add_e_f64s(h, s.mul_add_e_f64s(h, c[13], c[5]), c[1]);
    let of_p = s.mul_add_e_f64s(h, s.mul_add_e_f64s(h, c[16], c[6]), c[2]);
    let of_p = s.mul_add_e_f64s(p, of_pp, s.mul_add_e_f64s(l, of_lp, of_p));
    let of_l = s.mul_add_e_f64s(l, of_ll, of_l);
    s.mul_add_e_f64s(l, of_l, s.mul_add_e_f64s(p, of_p, of_h))
}

/// The coefficients of an RPC, broadcast to all SIMD lanes.
struct Model<S: Simd> {
    terms: [Terms<S>; 4],
    image_offset: [S::f64s; 2],
    image_scale: [S::f64s; 2],
}

impl<S: Simd> Model<S> {
    #[inline(always)]
    fn new(simd: S, m: &KernelModel) -> Self {
        Self {
            terms: [
                splat_terms(simd, &m.terms[0]),
                splat_terms(simd, &m.terms[1]),
                splat_terms(simd, &m.terms[2]),
                splat_terms(simd, &m.terms[3]),
            ],
            image_offset: [simd.splat_f64s(m.image_offset[0]), simd.splat_f64s(m.image_offset[1])],
            image_scale: [simd.splat_f64s(m.image_scale[0]), simd.splat_f64s(m.image_scale[1])],
        }
    }

    /// Column and row of normalised ground coordinates.
    #[inline(always)]
    fn project(&self, s: S, l: S::f64s, p: S::f64s, h: S::f64s) -> [S::f64s; 2] {
        let col_num = cubic(s, &self.terms[0], l, p, h);
        let col_den = cubic(s, &self.terms[1], l, p, h);
        let row_num = cubic(s, &self.terms[2], l, p, h);
        let row_den = cubic(s, &self.terms[3], l, p, h);
        // One division serves both axes.
        let both = s.div_f64s(s.splat_f64s(1.0), s.mul_f64s(col_den, row_den));
        let col = s.mul_f64s(col_num, s.mul_f64s(row_den, both));
        let row = s.mul_f64s(row_num, s.mul_f64s(col_den, both));
        [
            s.mul_add_e_f64s(col, self.image_scale[0], self.image_offset[0]),
            s.mul_add_e_f64s(row, self.image_scale[1], self.image_offset[1]),
        ]
    }
}

/// Projects one register of points at a time. These are methods because closures would not be compiled for the wide
/// instruction set.
struct Projection<S: Simd> {
    model: Model<S>,
    offset: [S::f64s; 3],
    inverse: [S::f64s; 3],
}

impl<S: Simd> Projection<S> {
    #[inline(always)]
    fn new(s: S, m: &KernelModel) -> Self {
        let o = m.ground_offset;
        let i = m.ground_scale;
        Self {
            model: Model::new(s, m),
            offset: [s.splat_f64s(o[0]), s.splat_f64s(o[1]), s.splat_f64s(o[2])],
            inverse: [s.splat_f64s(1.0 / i[0]), s.splat_f64s(1.0 / i[1]), s.splat_f64s(1.0 / i[2])],
        }
    }

    #[inline(always)]
    fn at(&self, s: S, lon: S::f64s, lat: S::f64s, height: S::f64s) -> [S::f64s; 2] {
        let l = s.sub_f64s(lon, self.offset[0]);
        // Longitude differences are wrapped at the antimeridian.
        let (half, turn) = (s.splat_f64s(180.0), s.splat_f64s(360.0));
        let l = s.select_f64s(s.greater_than_f64s(l, half), s.sub_f64s(l, turn), l);
        let l = s.select_f64s(s.less_than_f64s(l, s.neg_f64s(half)), s.add_f64s(l, turn), l);
        let l = s.mul_f64s(l, self.inverse[0]);
        let p = s.mul_f64s(s.sub_f64s(lat, self.offset[1]), self.inverse[1]);
        let h = s.mul_f64s(s.sub_f64s(height, self.offset[2]), self.inverse[2]);
        self.model.project(s, l, p, h)
    }
}

impl WithSimd for Project<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let projection = Projection::new(s, self.model);
        let (lon, lon_rest) = S::as_simd_f64s(self.lon);
        let (lat, lat_rest) = S::as_simd_f64s(self.lat);
        let (height, height_rest) = S::as_simd_f64s(self.height);
        let (col, col_rest) = S::as_mut_simd_f64s(self.col);
        let (row, row_rest) = S::as_mut_simd_f64s(self.row);
        for ((((lon, lat), height), col), row) in lon.iter().zip(lat).zip(height).zip(col).zip(row) {
            [*col, *row] = projection.at(s, *lon, *lat, *height);
        }
        let [lon, lat] = [s.partial_load_f64s(lon_rest), s.partial_load_f64s(lat_rest)];
        let [col, row] = projection.at(s, lon, lat, s.partial_load_f64s(height_rest));
        s.partial_store_f64s(col_rest, col);
        s.partial_store_f64s(row_rest, row);
    }
}

/// Localises one register of points at a time.
struct Localization<S: Simd> {
    model: Model<S>,
    start: [Terms<S>; 2],
    /// Normalisation of column, row and height for the starting polynomials.
    offset: [S::f64s; 3],
    inverse: [S::f64s; 3],
    /// Inverse Jacobian: normalised ground coordinates per pixel.
    step: [[S::f64s; 2]; 2],
    ground_offset: [S::f64s; 3],
    ground_scale: [S::f64s; 3],
    height_inverse: S::f64s,
    tolerance: S::f64s,
}

impl<S: Simd> Localization<S> {
    #[inline(always)]
    fn new(s: S, m: &KernelModel, g: &StartPolynomials) -> Self {
        let (o, i, j) = (g.offset, g.scale, g.inverse);
        let (go, gs) = (m.ground_offset, m.ground_scale);
        Self {
            model: Model::new(s, m),
            start: [splat_terms(s, &g.terms[0]), splat_terms(s, &g.terms[1])],
            offset: [s.splat_f64s(o[0]), s.splat_f64s(o[1]), s.splat_f64s(o[2])],
            inverse: [s.splat_f64s(1.0 / i[0]), s.splat_f64s(1.0 / i[1]), s.splat_f64s(1.0 / i[2])],
            step: [
                [s.splat_f64s(j[0][0]), s.splat_f64s(j[0][1])],
                [s.splat_f64s(j[1][0]), s.splat_f64s(j[1][1])],
            ],
            ground_offset: [s.splat_f64s(go[0]), s.splat_f64s(go[1]), s.splat_f64s(go[2])],
            ground_scale: [s.splat_f64s(gs[0]), s.splat_f64s(gs[1]), s.splat_f64s(gs[2])],
            height_inverse: s.splat_f64s(1.0 / gs[2]),
            tolerance: s.splat_f64s(TOLERANCE_PX),
        }
    }

    #[inline(always)]
    fn at(&self, s: S, col: S::f64s, row: S::f64s, height: S::f64s) -> [S::f64s; 2] {
        let u = s.mul_f64s(s.sub_f64s(col, self.offset[0]), self.inverse[0]);
        let v = s.mul_f64s(s.sub_f64s(row, self.offset[1]), self.inverse[1]);
        let w = s.mul_f64s(s.sub_f64s(height, self.offset[2]), self.inverse[2]);
        let mut l = cubic(s, &self.start[0], u, v, w);
        let mut p = cubic(s, &self.start[1], u, v, w);
        let h = s.mul_f64s(s.sub_f64s(height, self.ground_offset[2]), self.height_inverse);
        let mut found;
        let mut steps = 0;
        loop {
            let [seen_col, seen_row] = self.model.project(s, l, p, h);
            let (a, b) = (s.sub_f64s(col, seen_col), s.sub_f64s(row, seen_row));
            found = s.and_m64s(
                s.less_than_or_equal_f64s(s.abs_f64s(a), self.tolerance),
                s.less_than_or_equal_f64s(s.abs_f64s(b), self.tolerance),
            );
            if steps == MAX_STEPS || s.first_true_m64s(s.not_m64s(found)) == S::F64_LANES {
                break;
            }
            let [[ll, lr], [pl, pr]] = self.step;
            l = s.mul_add_e_f64s(a, ll, s.mul_add_e_f64s(b, lr, l));
            p = s.mul_add_e_f64s(a, pl, s.mul_add_e_f64s(b, pr, p));
            steps += 1;
        }
        let nan = s.splat_f64s(f64::NAN);
        let lon = s.mul_add_e_f64s(l, self.ground_scale[0], self.ground_offset[0]);
        let lat = s.mul_add_e_f64s(p, self.ground_scale[1], self.ground_offset[1]);
        [s.select_f64s(found, lon, nan), s.select_f64s(found, lat, nan)]
    }
}

impl WithSimd for Localize<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let localization = Localization::new(s, self.model, self.start);
        let (col, col_rest) = S::as_simd_f64s(self.col);
        let (row, row_rest) = S::as_simd_f64s(self.row);
        let (height, height_rest) = S::as_simd_f64s(self.height);
        let (lon, lon_rest) = S::as_mut_simd_f64s(self.lon);
        let (lat, lat_rest) = S::as_mut_simd_f64s(self.lat);
        for ((((col, row), height), lon), lat) in col.iter().zip(row).zip(height).zip(lon).zip(lat) {
            [*lon, *lat] = localization.at(s, *col, *row, *height);
        }
        if !col_rest.is_empty() {
            let [col, row] = [s.partial_load_f64s(col_rest), s.partial_load_f64s(row_rest)];
            let [lon, lat] = localization.at(s, col, row, s.partial_load_f64s(height_rest));
            s.partial_store_f64s(lon_rest, lon);
            s.partial_store_f64s(lat_rest, lat);
        }
    }
}
