//! Points, vectors and pixels whose frame is part of their type, without cost at run time.
//!
//! Code that mixes frames does not compile. Each example that does not compile is followed by one that does and differs in
//! one token.
//!
//! A UTM point is not a site point:
//! ```compile_fail,E0308
//! use satgs::frame::{Point, Site, Utm};
//! fn altitude(p: Point<Site>) -> f64 { p.z() }
//! altitude(Point::<Utm>::new(1.0, 2.0, 3.0));
//! ```
//! ```
//! use satgs::frame::{Point, Site, Utm};
//! fn altitude(p: Point<Site>) -> f64 { p.z() }
//! altitude(Point::<Site>::new(1.0, 2.0, 3.0));
//! ```
//! A corner pixel is not a centre pixel:
//! ```compile_fail,E0308
//! use satgs::frame::{CenterPx, CornerPx, Pixel};
//! fn localize(_: Pixel<CenterPx>) {}
//! localize(Pixel::<CornerPx>::new(0.5, 0.5));
//! ```
//! ```
//! use satgs::frame::{CenterPx, CornerPx, Pixel};
//! fn localize(_: Pixel<CenterPx>) {}
//! localize(Pixel::<CenterPx>::new(0.5, 0.5));
//! ```
//! Two points have a difference but no sum:
//! ```compile_fail,E0369
//! use satgs::frame::{Point, Site};
//! let p = Point::<Site>::new(0.0, 0.0, 0.0);
//! let _ = p + p;
//! ```
//! ```
//! use satgs::frame::{Point, Site};
//! let p = Point::<Site>::new(0.0, 0.0, 0.0);
//! let _ = p - p;
//! ```

use serde::{Deserialize, Serialize};
use std::marker::PhantomData;
use std::ops::{Add, Sub};

/// A coordinate frame.
pub trait Frame: Copy + 'static {
    /// Name used in messages and files.
    const NAME: &'static str;
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct $name;
        impl Frame for $name { const NAME: &'static str = stringify!($name); }
    )*};
}

frames! {
    /// WGS 84 longitude and latitude in degrees, height in metres above the ellipsoid.
    Geodetic,
    /// Easting, northing and ellipsoidal height in metres; the zone is in [`super::SiteGrid`].
    Utm,
    /// Metres east and north along the map grid and up, from the site's origin.
    Site,
    /// Earth-centred, earth-fixed metres of WGS 84 (EPSG:4978).
    Ecef,
    /// Pixels; (0, 0) is the centre of the top-left pixel (RPC, Maxar).
    CenterPx,
    /// Pixels; (0, 0) is the outer corner of the top-left pixel (GDAL geotransforms, COLMAP).
    CornerPx,
}

/// A 3-D position in frame `F`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Point<F: Frame>([f64; 3], #[serde(skip)] PhantomData<F>);

/// A 3-D displacement in frame `F`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vector<F: Frame>([f64; 3], PhantomData<F>);

/// An image position, (column, row), in frame `F`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel<F: Frame> {
    /// Column: right is positive.
    pub col: f64,
    /// Row: down is positive.
    pub row: f64,
    frame: PhantomData<F>,
}

impl<F: Frame> Point<F> {
    /// A point from its coordinates, in the order and units of the frame `F`.
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self([x, y, z], PhantomData)
    }
    /// The coordinates, in the order and units of the frame `F`.
    #[must_use]
    pub const fn xyz(self) -> [f64; 3] {
        self.0
    }
    /// First coordinate: east, or longitude.
    #[must_use]
    pub const fn x(self) -> f64 {
        self.0[0]
    }
    /// Second coordinate: north, or latitude.
    #[must_use]
    pub const fn y(self) -> f64 {
        self.0[1]
    }
    /// Third coordinate: up, or height.
    #[must_use]
    pub const fn z(self) -> f64 {
        self.0[2]
    }
    /// The point with its third coordinate, height or altitude, replaced by `z`.
    #[must_use]
    pub const fn at_height(self, z: f64) -> Self {
        Self::new(self.0[0], self.0[1], z)
    }
    /// Whether every coordinate is a finite number.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.0.iter().all(|c| c.is_finite())
    }
}

impl Point<Geodetic> {
    /// Longitude in degrees.
    #[must_use]
    pub const fn lon_deg(self) -> f64 {
        self.0[0]
    }
    /// Latitude in degrees.
    #[must_use]
    pub const fn lat_deg(self) -> f64 {
        self.0[1]
    }
    /// Height above the WGS 84 ellipsoid in metres.
    #[must_use]
    pub const fn height_m(self) -> f64 {
        self.0[2]
    }
}

impl<F: Frame> Vector<F> {
    /// A displacement from its components, in the order and units of the frame `F`.
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self([x, y, z], PhantomData)
    }
    /// The components, in the order and units of the frame `F`.
    #[must_use]
    pub const fn xyz(self) -> [f64; 3] {
        self.0
    }
    /// Euclidean length, in the unit of the frame.
    #[must_use]
    pub fn norm(self) -> f64 {
        self.dot(self).sqrt()
    }
    /// Scalar product with `o`.
    #[must_use]
    pub fn dot(self, o: Self) -> f64 {
        self.0.iter().zip(o.0).map(|(a, b)| a * b).sum()
    }
}

impl<F: Frame> Sub for Point<F> {
    type Output = Vector<F>;
    fn sub(self, o: Self) -> Vector<F> {
        Vector(std::array::from_fn(|i| self.0[i] - o.0[i]), PhantomData)
    }
}

impl<F: Frame> Add<Vector<F>> for Point<F> {
    type Output = Self;
    fn add(self, v: Vector<F>) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + v.0[i]), PhantomData)
    }
}

impl<F: Frame> Pixel<F> {
    /// An image position from its column and row, pixels.
    #[must_use]
    pub const fn new(col: f64, row: f64) -> Self {
        Self { col, row, frame: PhantomData }
    }
    /// Euclidean distance to `o`, pixels.
    #[must_use]
    pub fn distance(self, o: Self) -> f64 {
        (self.col - o.col).hypot(self.row - o.row)
    }
}

impl From<Pixel<CenterPx>> for Pixel<CornerPx> {
    fn from(p: Pixel<CenterPx>) -> Self {
        Self::new(p.col + 0.5, p.row + 0.5)
    }
}

impl From<Pixel<CornerPx>> for Pixel<CenterPx> {
    fn from(p: Pixel<CornerPx>) -> Self {
        Self::new(p.col - 0.5, p.row - 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_pixels_have_the_size_of_their_coordinates() {
        assert_eq!(size_of::<Point<Site>>(), 24);
        assert_eq!(size_of::<Pixel<CenterPx>>(), 16);
    }

    #[test]
    fn pixel_round_trip_is_exact() {
        let p = Pixel::<CenterPx>::new(0.0, 0.0);
        let q: Pixel<CornerPx> = p.into();
        assert_eq!((q.col, q.row), (0.5, 0.5));
        assert_eq!(Pixel::<CenterPx>::from(q), p);
    }
}
