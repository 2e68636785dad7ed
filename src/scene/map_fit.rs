//! Comparison of the map projection of an image with its RPC.

use crate::frame::{CenterPx, CornerPx, Pixel, Point};
use crate::io::ImageFile;
use crate::rpc::Rpc;

/// Largest distance, as a fraction of the image size, between the pixels of a map and the projections of their map
/// positions by an RPC that belongs to the map, as in ortho-ready products (Maxar OR2A).
const OWN_GRID: f64 = 0.002;
/// The same distance in pixels; the larger of the two counts.
const OWN_GRID_PX: f64 = 4.0;
/// Number of steps of the ternary search over heights; each keeps two thirds of the range.
const STEPS: usize = 40;

/// Relation between the map projection of an image and an RPC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum MapFit {
    /// The image has no map projection.
    NoMap,
    /// At some height, the camera projects the map positions of the corners and the centre to their pixels: the RPC
    /// belongs to the map.
    OwnGrid,
    /// It does not: the image was orthorectified with the RPC, or its map position is approximate.
    Other {
        /// Largest distance over the five positions at the height with the smallest one, pixels.
        distance_px: f64,
        /// Whether this distance is at most half of the longer side of the image, so that both show the same place.
        is_near: bool,
    },
}

/// Compares the geotransform of an image with a camera, at its corners and its centre on a level plane.
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
    // The largest distance is nearly a convex function of height, so that a ternary search finds its minimum.
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

/// The corners and the centre of an image.
pub(super) fn five_places((width, height): (usize, usize)) -> [Pixel<CornerPx>; 5] {
    let (w, h) = (width as f64, height as f64);
    [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h), (0.5 * w, 0.5 * h)].map(|(col, row)| Pixel::new(col, row))
}
