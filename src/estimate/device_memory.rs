//! Memory of a training on a GPU, from the sizes of its arrays (`src/splat/gpu`).

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

/// Bytes of a splat with its moments, gradient and place in the order: with the harmonics of photographs, and without.
const SPLAT_BYTES: [f64; 2] = [825.0, 285.0];
/// Bytes of a splat in a render, and of each of the tiles that it touches there: photographs compose three features, satellite views
/// four.
const IMAGE_BYTES: f64 = 68.0;
const PAIR_BYTES: [f64; 2] = [57.0, 61.0];
/// Bytes of a pixel of the largest view, of the image from the sun, and of a pixel of any view.
const VIEW_PIXEL_BYTES: [f64; 2] = [64.0, 164.0];
const SUN_PIXEL_BYTES: f64 = 36.0;
const STORED_PIXEL_BYTES: f64 = 4.0;
/// Renders of an iteration on a satellite view: itself, from the sun, and the virtual view.
const RENDERS: f64 = 3.0;

/// Tiles of each splat in each render for which there is room at first: of photographs, and of satellite views.
pub const TILES_OF_SPLAT: [u32; 2] = [12, 4];

impl DeviceTraining {
    /// Bytes of the training of photographs with harmonics.
    #[must_use]
    pub fn photograph_bytes(&self) -> f64 {
        self.bytes(0, 1.0)
    }

    /// Bytes of the training of a satellite scene.
    #[must_use]
    pub fn satellite_bytes(&self) -> f64 {
        self.bytes(1, RENDERS)
    }

    fn bytes(&self, kind: usize, renders: f64) -> f64 {
        let of_render = IMAGE_BYTES + PAIR_BYTES[kind] * f64::from(TILES_OF_SPLAT[kind]);
        self.splats * (SPLAT_BYTES[kind] + renders * of_render)
            + VIEW_PIXEL_BYTES[kind] * self.pixels
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
        assert!(
            (photographs.photograph_bytes() / 1e9 - 2.4).abs() < 0.1,
            "{}",
            photographs.photograph_bytes()
        );
    }
}
