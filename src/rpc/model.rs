//! The RPC00B model of NGA STDI-0002: ratios of cubic polynomials of normalised ground coordinates.
//!
//! With `L`, `P`, `H` the normalised longitude, latitude and height,
//! `row = LINE_OFF + LINE_SCALE * num(L, P, H) / den(L, P, H)`, and the same for the column. The twenty terms are
//! `1, L, P, H, LP, LH, PH, L², P², H², PLH, L³, LP², LH², L²P, P³, PH², L²H, P²H, H³`.

use crate::frame::{CenterPx, Geodetic, Pixel, Point};
use serde::{Deserialize, Serialize};

/// Number of terms of a cubic polynomial in three variables.
pub(super) const TERMS: usize = 20;

/// Half side of the cube of normalised coordinates in which the denominators must not change sign.
const CHECKED_CUBE: f64 = 1.0;

/// Largest normalised coordinate of the validity volume; a little above 1 because files round the scales.
const VALID_CUBE: f64 = 1.01;

/// Half side of the cube of normalised coordinates searched by [`Rpc::smallest_denominator`]: ground beside the
/// validity volume is projected too.
const WIDE_CUBE: f64 = 1.2;

/// Normalisation of a coordinate: `normalised = (value - offset) / scale`, in the unit of the coordinate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Axis {
    /// Value at the centre of the normalised range.
    pub offset: f64,
    /// Half the range; never zero.
    pub scale: f64,
}

/// The coefficients of an RPC, not yet checked. Pixel (0, 0) is the centre of the first pixel; terms are in the order
/// of RPC00B.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RpcCoefficients {
    /// Column (sample) in pixels.
    pub col: Axis,
    /// Row (line) in pixels.
    pub row: Axis,
    /// Longitude in degrees.
    pub lon: Axis,
    /// Latitude in degrees.
    pub lat: Axis,
    /// Ellipsoidal height in metres.
    pub height: Axis,
    /// Numerator of the column.
    pub col_num: [f64; TERMS],
    /// Denominator of the column.
    pub col_den: [f64; TERMS],
    /// Numerator of the row.
    pub row_num: [f64; TERMS],
    /// Denominator of the row.
    pub row_den: [f64; TERMS],
    /// RMS bias error in metres per horizontal axis, if known (`ERR_BIAS`).
    pub err_bias_m: Option<f64>,
    /// RMS random error in metres per horizontal axis, if known (`ERR_RAND`).
    pub err_rand_m: Option<f64>,
}

/// Why coefficients do not form a valid RPC. Errors of file readers add the name of the file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RpcError {
    /// A coefficient is NaN or infinite.
    #[error("RPC field `{field}` is not a finite number")]
    NotFinite {
        /// The field in RPC00B's names.
        field: String,
    },
    /// A scale is zero.
    #[error("RPC field `{field}` is zero")]
    ZeroScale {
        /// The field in RPC00B's names.
        field: &'static str,
    },
    /// The longitude or latitude offset is outside of its range.
    #[error("RPC field `{field}` is {value}, outside ±{limit}")]
    OutOfRange {
        /// The field in RPC00B's names.
        field: &'static str,
        /// The value found, degrees.
        value: f64,
        /// The largest valid magnitude, degrees.
        limit: f64,
    },
    /// A denominator changes sign inside the validity volume, so that the model has a pole there.
    #[error("the denominator of the RPC's {axis} changes sign inside its own volume")]
    Pole {
        /// `column` or `row`.
        axis: &'static str,
    },
}

/// A valid RPC: its coefficients are finite, its scales are not zero, its offsets lie on Earth, and it has no pole
/// inside its validity volume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RpcCoefficients", into = "RpcCoefficients")]
pub struct Rpc(RpcCoefficients);

impl TryFrom<RpcCoefficients> for Rpc {
    type Error = RpcError;
    fn try_from(c: RpcCoefficients) -> Result<Self, RpcError> {
        Self::new(c)
    }
}

impl From<Rpc> for RpcCoefficients {
    fn from(rpc: Rpc) -> Self {
        rpc.0
    }
}

/// Derivatives of (column, row), the two rows, with respect to (longitude, latitude, height), the three columns, in
/// pixels per degree, per degree and per metre.
pub type Jacobian = [[f64; 3]; 2];

impl Rpc {
    /// Checks coefficients.
    ///
    /// # Errors
    /// [`RpcError`] names the first invalid field.
    pub fn new(c: RpcCoefficients) -> Result<Self, RpcError> {
        for (name, axis) in
            [("SAMP", c.col), ("LINE", c.row), ("LONG", c.lon), ("LAT", c.lat), ("HEIGHT", c.height)]
        {
            for (part, value) in [("OFF", axis.offset), ("SCALE", axis.scale)] {
                if !value.is_finite() {
                    return Err(RpcError::NotFinite { field: format!("{name}_{part}") });
                }
            }
        }
        for (field, axis) in [
            ("SAMP_SCALE", c.col),
            ("LINE_SCALE", c.row),
            ("LONG_SCALE", c.lon),
            ("LAT_SCALE", c.lat),
            ("HEIGHT_SCALE", c.height),
        ] {
            if axis.scale == 0.0 {
                return Err(RpcError::ZeroScale { field });
            }
        }
        for (field, axis, limit) in [("LAT_OFF", c.lat, 90.0), ("LONG_OFF", c.lon, 360.0)] {
            if axis.offset.abs() > limit {
                return Err(RpcError::OutOfRange { field, value: axis.offset, limit });
            }
        }
        for (name, terms) in [
            ("SAMP_NUM", &c.col_num),
            ("SAMP_DEN", &c.col_den),
            ("LINE_NUM", &c.row_num),
            ("LINE_DEN", &c.row_den),
        ] {
            if let Some(i) = terms.iter().position(|t| !t.is_finite()) {
                return Err(RpcError::NotFinite { field: format!("{name}_COEFF_{}", i + 1) });
            }
        }
        for (axis, den) in [("column", &c.col_den), ("row", &c.row_den)] {
            if has_pole(den) {
                return Err(RpcError::Pole { axis });
            }
        }
        Ok(Self(c))
    }

    /// The coefficients.
    #[must_use]
    pub const fn coefficients(&self) -> &RpcCoefficients {
        &self.0
    }

    /// The ground point at the centre of the validity volume.
    #[must_use]
    pub const fn center(&self) -> Point<Geodetic> {
        Point::new(self.0.lon.offset, self.0.lat.offset, self.0.height.offset)
    }

    /// Lowest and highest ellipsoidal height of the validity volume, metres.
    #[must_use]
    pub fn height_range(&self) -> (f64, f64) {
        let h = self.0.height;
        (h.offset - h.scale.abs(), h.offset + h.scale.abs())
    }

    /// Image position of a ground point.
    #[must_use]
    pub fn project(&self, p: Point<Geodetic>) -> Pixel<CenterPx> {
        let c = &self.0;
        let m = monomials(self.normalised(p));
        let ratio = |num, den| dot(num, &m) / dot(den, &m);
        Pixel::new(
            c.col.offset + c.col.scale * ratio(&c.col_num, &c.col_den),
            c.row.offset + c.row.scale * ratio(&c.row_num, &c.row_den),
        )
    }

    /// Image position of a ground point, and its derivatives with respect to the ground coordinates.
    #[must_use]
    pub fn project_with_jacobian(&self, p: Point<Geodetic>) -> (Pixel<CenterPx>, Jacobian) {
        let c = &self.0;
        let lph = self.normalised(p);
        let m = monomials(lph);
        let dm = monomial_derivatives(lph);
        let ground_scale = [c.lon.scale, c.lat.scale, c.height.scale];
        let axis = |image: Axis, num, den| {
            let (n, d) = (dot(num, &m), dot(den, &m));
            let ratio = n / d;
            let slope = std::array::from_fn(|k| {
                (dot(num, &dm[k]) - ratio * dot(den, &dm[k])) / d * image.scale / ground_scale[k]
            });
            (image.offset + image.scale * ratio, slope)
        };
        let (col, dcol) = axis(c.col, &c.col_num, &c.col_den);
        let (row, drow) = axis(c.row, &c.row_num, &c.row_den);
        (Pixel::new(col, row), [dcol, drow])
    }

    /// The camera whose projections are shifted by (`d_col`, `d_row`) pixels. Exact: only the offsets change.
    #[must_use]
    pub fn shifted(&self, d_col: f64, d_row: f64) -> Self {
        let mut c = self.0.clone();
        c.col.offset += d_col;
        c.row.offset += d_row;
        Self(c)
    }

    /// The camera translated on the ground: it projects `p + step` to the image position to which this one projects `p`.
    ///
    /// The step is in degrees of longitude, degrees of latitude and metres of height. Exact: only the offsets change.
    #[must_use]
    pub fn moved_on_ground(&self, [lon_deg, lat_deg, height_m]: [f64; 3]) -> Self {
        let mut c = self.0.clone();
        c.lon.offset += lon_deg;
        c.lat.offset += lat_deg;
        c.height.offset += height_m;
        Self(c)
    }

    /// The camera of a crop whose first pixel is the pixel (`col`, `row`) of this image. Exact: only the offsets change.
    #[must_use]
    pub fn cropped(&self, col: usize, row: usize) -> Self {
        self.shifted(-(col as f64), -(row as f64))
    }

    /// Whether a ground point lies in the validity volume, with a tolerance of 1 % of its half size.
    #[must_use]
    pub fn is_valid_at(&self, p: Point<Geodetic>) -> bool {
        self.normalised(p).iter().all(|v| v.abs() <= VALID_CUBE)
    }

    /// The smallest ratio of a denominator to its value at the centre, in a volume 20 % larger than the validity volume.
    ///
    /// A value near or below zero means that the model has a pole there.
    #[must_use]
    pub fn smallest_denominator(&self) -> f64 {
        let least = |den| {
            let at_center = polynomial(den, [0.0; 3]);
            grid_9(WIDE_CUBE).map(|p| polynomial(den, p) / at_center).fold(f64::INFINITY, f64::min)
        };
        least(&self.0.col_den).min(least(&self.0.row_den))
    }

    fn normalised(&self, p: Point<Geodetic>) -> [f64; 3] {
        let c = &self.0;
        let plain = p.lon_deg() - c.lon.offset;
        // Longitude differences are wrapped at the antimeridian. Wrapping rounds and takes time, so it is left out
        // where it changes nothing.
        let d_lon = if plain.abs() <= 180.0 { plain } else { (plain + 540.0).rem_euclid(360.0) - 180.0 };
        [
            d_lon / c.lon.scale,
            (p.lat_deg() - c.lat.offset) / c.lat.scale,
            (p.height_m() - c.height.offset) / c.height.scale,
        ]
    }
}

/// Whether a denominator changes sign on a grid of 9³ nodes over the validity volume.
fn has_pole(den: &[f64; TERMS]) -> bool {
    let at_center = polynomial(den, [0.0; 3]);
    // The comparison is negated so that NaN, from coefficients whose sum overflows, counts as a pole.
    !grid_9(CHECKED_CUBE).all(|p| polynomial(den, p) * at_center > 0.0)
}

/// The nodes of a grid of 9³ nodes over the cube of half side `half`.
fn grid_9(half: f64) -> impl Iterator<Item = [f64; 3]> {
    let node = move |i: i32| half * f64::from(i - 4) / 4.0;
    (0..9 * 9 * 9).map(move |i| [node(i % 9), node(i / 9 % 9), node(i / 81)])
}

fn dot(c: &[f64; TERMS], m: &[f64; TERMS]) -> f64 {
    // Four partial sums: the compiler keeps the order of additions, and in a single sum each addition would wait for
    // the one before.
    let mut sum = [0.0f64; 4];
    for i in 0..TERMS / 4 {
        for k in 0..4 {
            sum[k] += c[4 * i + k] * m[4 * i + k];
        }
    }
    (sum[0] + sum[1]) + (sum[2] + sum[3])
}

/// A polynomial's value at normalised coordinates, its terms in RPC00B's order.
pub(crate) fn polynomial(terms: &[f64; TERMS], place: [f64; 3]) -> f64 {
    dot(terms, &monomials(place))
}

pub(super) fn monomials([l, p, h]: [f64; 3]) -> [f64; TERMS] {
    let (ll, pp, hh, lp, lh, ph) = (l * l, p * p, h * h, l * p, l * h, p * h);
    [
        1.0,
        l,
        p,
        h,
        lp,
        lh,
        ph,
        ll,
        pp,
        hh,
        lp * h,
        ll * l,
        l * pp,
        l * hh,
        ll * p,
        pp * p,
        p * hh,
        ll * h,
        pp * h,
        hh * h,
    ]
}

/// Derivatives of [`monomials`] with respect to L, P and H.
fn monomial_derivatives([l, p, h]: [f64; 3]) -> [[f64; TERMS]; 3] {
    let (ll, pp, hh, lp, lh, ph) = (l * l, p * p, h * h, l * p, l * h, p * h);
    let (z, one) = (0.0, 1.0);
    [
        [z, one, z, z, p, h, z, 2. * l, z, z, ph, 3. * ll, pp, hh, 2. * lp, z, z, 2. * lh, z, z],
        [z, z, one, z, l, z, h, z, 2. * p, z, lh, z, 2. * lp, z, ll, 3. * pp, hh, z, 2. * ph, z],
        [z, z, z, one, z, l, p, z, z, 2. * h, lp, z, z, 2. * lh, z, z, 2. * ph, ll, pp, 3. * hh],
    ]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A made-up camera with every term in play: 0.5 m pixels, 20° off nadir, near Marseille.
    pub(crate) fn synthetic() -> Rpc {
        let term = |i: usize, seed: f64| 1e-3 * ((i as f64 + 1.0) * seed).sin();
        let poly = |seed: f64, lead: [f64; 4]| -> [f64; TERMS] {
            std::array::from_fn(|i| if i < 4 { lead[i] } else { term(i, seed) })
        };
        Rpc::new(RpcCoefficients {
            col: Axis { offset: 511.5, scale: 600.0 },
            row: Axis { offset: 499.5, scale: 600.0 },
            lon: Axis { offset: 5.44, scale: 0.0037 },
            lat: Axis { offset: 43.26, scale: 0.0027 },
            height: Axis { offset: 190.0, scale: 120.0 },
            col_num: poly(1.3, [0.002, 1.0, 0.01, 0.06]),
            col_den: poly(2.1, [1.0, 0.001, -0.002, 0.0005]),
            row_num: poly(0.7, [-0.001, 0.02, -1.0, 0.04]),
            row_den: poly(3.3, [1.0, -0.0015, 0.001, -0.0007]),
            err_bias_m: None,
            err_rand_m: None,
        })
        .unwrap()
    }

    #[test]
    fn jacobian_agrees_with_central_differences() {
        let rpc = synthetic();
        let p = Point::<Geodetic>::new(5.4417, 43.2611, 231.0);
        let (px, jac) = rpc.project_with_jacobian(p);
        assert_eq!(px, rpc.project(p));
        let c = rpc.coefficients();
        for (k, scale) in [c.lon.scale, c.lat.scale, c.height.scale].into_iter().enumerate() {
            let step = 1e-3 * scale;
            let moved = |s: f64| {
                let mut q = p.xyz();
                q[k] += s;
                rpc.project(Point::new(q[0], q[1], q[2]))
            };
            let (a, b) = (moved(step), moved(-step));
            let numeric = [(a.col - b.col) / (2.0 * step), (a.row - b.row) / (2.0 * step)];
            for i in 0..2 {
                assert!((jac[i][k] - numeric[i]).abs() <= 1e-6 * jac[i][k].abs().max(1e-3), "{i} {k}");
            }
        }
    }

    #[test]
    fn shift_moves_every_projection_by_itself() {
        let rpc = synthetic();
        let p = Point::new(5.4391, 43.2604, 150.0);
        let (a, b) = (rpc.project(p), rpc.shifted(1.5, -36.0).project(p));
        assert!((b.col - a.col - 1.5).abs() < 1e-9 && (b.row - a.row + 36.0).abs() < 1e-9);
    }

    #[test]
    fn a_camera_moved_on_the_ground_sees_there_what_it_saw_before() {
        let rpc = synthetic();
        let (p, step) = (Point::new(5.4391, 43.2604, 150.0), [3e-5, -2e-5, 7.0]);
        let q = Point::new(p.lon_deg() + step[0], p.lat_deg() + step[1], p.height_m() + step[2]);
        assert!(rpc.moved_on_ground(step).project(q).distance(rpc.project(p)) < 1e-6);
    }

    #[test]
    fn bad_numbers_are_refused_by_name() {
        let broken = |change: fn(&mut RpcCoefficients)| {
            let mut c = synthetic().coefficients().clone();
            change(&mut c);
            Rpc::new(c).unwrap_err()
        };
        assert_eq!(
            broken(|c| c.row_num[3] = f64::NAN),
            RpcError::NotFinite { field: "LINE_NUM_COEFF_4".into() }
        );
        assert_eq!(broken(|c| c.lat.scale = 0.0), RpcError::ZeroScale { field: "LAT_SCALE" });
        assert!(matches!(broken(|c| c.lat.offset = 145.0), RpcError::OutOfRange { field: "LAT_OFF", .. }));
        assert_eq!(broken(|c| c.col_den[1] = 3.0), RpcError::Pole { axis: "column" });
    }

    #[test]
    fn a_crop_moves_pixels_by_its_origin() {
        let rpc = synthetic();
        let p = Point::new(5.4391, 43.2604, 150.0);
        let (a, b) = (rpc.project(p), rpc.cropped(100, 7).project(p));
        assert!((a.col - b.col - 100.0).abs() < 1e-9 && (a.row - b.row - 7.0).abs() < 1e-9);
    }

    #[test]
    fn the_volume_and_its_weak_denominators_are_known() {
        let rpc = synthetic();
        assert!(rpc.is_valid_at(rpc.center()) && !rpc.is_valid_at(rpc.center().at_height(400.0)));
        assert!(rpc.smallest_denominator() > 0.98);
        let mut c = rpc.coefficients().clone();
        c.col_den[1] = 0.9;
        assert!(Rpc::new(c).unwrap().smallest_denominator() < 0.0);
    }

    #[test]
    fn antimeridian_is_no_border() {
        let mut c = synthetic().coefficients().clone();
        c.lon.offset = 179.999;
        let rpc = Rpc::new(c).unwrap();
        let a = rpc.project(Point::new(180.001, 43.26, 200.0));
        let b = rpc.project(Point::new(-179.999, 43.26, 200.0));
        assert!(a.distance(b) < 1e-6);
    }
}
