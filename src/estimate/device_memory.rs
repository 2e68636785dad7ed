//! Memory of a training on a GPU, from the sizes of its arrays (`src/splat/gpu`).

use crate::splat::primitive::PrimitiveKind;

/// What a training holds on a device.
#[derive(Clone, Copy, Debug)]
pub struct DeviceTraining {
    /// Number of splats.
    pub splats: f64,
    /// Pixels of the largest view.
    pub pixels: f64,
    /// Pixels of all views.
    pub all_pixels: f64,
    /// Pixels of the largest image from the sun; zero of photographs.
    pub sun_pixels: f64,
}

/// What differs between kinds of trainings, bytes.
struct KindBytes {
    /// Of a splat with its moments, gradient and place in the order.
    splat: f64,
    /// Of a splat in a render.
    image: f64,
    /// Of each of the tiles that it touches there.
    pair: f64,
    /// Of a pixel of the largest view.
    view_pixel: f64,
    /// Tiles of each splat for which there is room at first.
    tiles: u32,
}

/// Photographs have harmonics, and compose three features of ellipsoids.
const PHOTOGRAPHS: KindBytes =
    KindBytes { splat: 825.0, image: 68.0, pair: 57.0, view_pixel: 64.0, tiles: TILES_OF_SPLAT[0] };
/// Discs have planes, from which sums follow, and compose depths and normals too.
const PHOTOGRAPHS_WITH_DISCS: KindBytes =
    KindBytes { image: 116.0, pair: 89.0, view_pixel: 100.0, ..PHOTOGRAPHS };
/// Satellite views compose four features.
const SATELLITES: KindBytes =
    KindBytes { splat: 285.0, image: 68.0, pair: 61.0, view_pixel: 164.0, tiles: TILES_OF_SPLAT[1] };
/// Bytes of a pixel of the image from the sun, and of a pixel of any view.
const SUN_PIXEL_BYTES: f64 = 36.0;
const STORED_PIXEL_BYTES: f64 = 4.0;
/// Renders of an iteration on a satellite view: itself, from the sun, and the virtual view.
const RENDERS: f64 = 3.0;

/// Tiles of each splat in each render for which there is room at first: of photographs, and of satellite views.
pub const TILES_OF_SPLAT: [u32; 2] = [12, 4];

impl DeviceTraining {
    /// Bytes of the training of photographs with harmonics.
    #[must_use]
    pub fn photograph_bytes(&self, primitive: PrimitiveKind) -> f64 {
        let kind = match primitive {
            PrimitiveKind::Ellipsoid => PHOTOGRAPHS,
            PrimitiveKind::Disc => PHOTOGRAPHS_WITH_DISCS,
        };
        self.bytes(&kind, 1.0)
    }

    /// Bytes of the training of a satellite scene.
    #[must_use]
    pub fn satellite_bytes(&self) -> f64 {
        self.bytes(&SATELLITES, RENDERS)
    }

    fn bytes(&self, kind: &KindBytes, renders: f64) -> f64 {
        let of_render = kind.image + kind.pair * f64::from(kind.tiles);
        self.splats * (kind.splat + renders * of_render)
            + kind.view_pixel * self.pixels
            + SUN_PIXEL_BYTES * self.sun_pixels
            + STORED_PIXEL_BYTES * self.all_pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_million_splats_take_what_the_guide_says() {
        let training = DeviceTraining { splats: 1e6, pixels: 5e6, all_pixels: 1e8, sun_pixels: 8e6 };
        assert!((training.satellite_bytes() / 1e9 - 2.7).abs() < 0.05, "{}", training.satellite_bytes());
        let photographs = DeviceTraining { pixels: 1e6, all_pixels: 2e8, sun_pixels: 0.0, ..training };
        for (primitive, gigabytes) in [(PrimitiveKind::Ellipsoid, 2.4), (PrimitiveKind::Disc, 2.9)] {
            let bytes = photographs.photograph_bytes(primitive);
            assert!((bytes / 1e9 - gigabytes).abs() < 0.1, "{bytes}");
        }
    }
}
