//! Whether an image on a map and an RPC belong together.

use crate::frame::{CenterPx, CornerPx, Pixel, Point};
use crate::io::ImageFile;
use crate::rpc::Rpc;

/// A map whose RPC is its own (Maxar's ortho-ready OR2A) is seen at its pixels to this share of its size…
const OWN_GRID: f64 = 0.002;
/// …or to this many pixels.
const OWN_GRID_PX: f64 = 4.0;
/// Steps of the search for the height: each leaves two thirds of the range.
const STEPS: usize = 40;

/// What a map and an RPC have to do with each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum MapFit {
    /// The image is no map.
    NoMap,
    /// At one height the camera sees the corners and the centre at their pixels: the RPC is the map's own.
    OwnGrid,
    /// It does not: the map was made of the RPC's image, or its place is a rough one.
    Other {
        /// Distance of the place that fits worst at the height that fits best, pixels.
        distance_px: f64,
        /// Whether both are of the same place.
        is_near: bool,
    },
}

/// Compares an image's geotransform with a camera at its corners and its centre, all at one height.
pub(super) fn map_fit(image: &ImageFile, rpc: &Rpc) -> MapFit {
    let size = image.size();
    let place = |corner| Some((Pixel::<CenterPx>::from(corner), image.lon_lat(corner)?));
    let Some(places) = five_places(size).into_iter().map(place).collect::<Option<Vec<_>>>() else {
        return MapFit::NoMap;
    };
    let worst = |height_m: f64| {
        let apart =
            places.iter().map(|(px, (lon, lat))| rpc.project(Point::new(*lon, *lat, height_m)).distance(*px));
        apart.map(|d| if d.is_nan() { f64::INFINITY } else { d }).fold(0.0, f64::max)
    };
    // The worst distance over height is convex, but for the small curvature of a camera.
    let (mut low, mut high) = rpc.height_range();
    for _ in 0..STEPS {
        let third = (high - low) / 3.0;
        if worst(low + third) < worst(high - third) { high -= third } else { low += third }
    }
    let distance_px = worst(0.5 * (low + high));
    let side = size.0.max(size.1) as f64;
    if distance_px <= OWN_GRID_PX.max(OWN_GRID * side) {
        return MapFit::OwnGrid;
    }
    MapFit::Other { distance_px, is_near: distance_px <= 0.5 * side }
}

/// An image's corners and centre.
pub(super) fn five_places((width, height): (usize, usize)) -> [Pixel<CornerPx>; 5] {
    let (w, h) = (width as f64, height as f64);
    [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h), (0.5 * w, 0.5 * h)].map(|(col, row)| Pixel::new(col, row))
}
