//! From radiance to the grey levels of an image: exposure, colour cast, haze, noise.

use super::keyed_rng::KeyedRng;

/// Irradiance of a horizontal surface by the sky, relative to that of a surface perpendicular to the sun.
const SKY: [f64; 3] = [0.25, 0.275, 0.32];

/// Radiometry of a view.
#[derive(Clone, Debug)]
pub(super) struct Radiometry {
    /// Unit vector to the sun on the map.
    pub(super) sun: [f64; 3],
    /// Grey levels per unit of radiance, by band.
    pub(super) gain: [f64; 3],
    /// Grey level of black (haze), by band.
    pub(super) offset: [f64; 3],
    /// Standard deviation of the noise, grey levels.
    pub(super) noise: f64,
}

impl Radiometry {
    /// The radiometry of a view; `sun` is the unit vector to the sun on the map.
    pub(super) fn new(rng: KeyedRng, sun: [f64; 3]) -> Self {
        // The exposure follows the light on level ground; gains and haze of the bands vary between days.
        let exposure = 255.0 * 1.3 / (sun[2] + 0.27) * rng.key(1).uniform_in(0.85, 1.15);
        let cast = [rng.key(2).uniform_in(0.94, 1.08), 1.0, rng.key(3).uniform_in(0.92, 1.08)];
        let haze = rng.key(4).uniform_in(2.0, 16.0);
        let warmth = [1.0, 0.98, 0.92];
        Self {
            sun,
            gain: std::array::from_fn(|k| exposure * cast[k] * warmth[k]),
            offset: [0.75 * haze, 0.9 * haze, 1.25 * haze],
            noise: rng.key(5).uniform_in(0.8, 1.8),
        }
    }

    /// The same without noise.
    pub(super) fn without_noise(self) -> Self {
        Self { noise: 0.0, ..self }
    }

    /// Irradiance, by band, of a surface with the given normal; `direct` is that by the sun.
    pub(super) fn irradiance(direct: f64, normal: [f64; 3]) -> [f64; 3] {
        let open_sky = 0.5 + 0.5 * normal[2];
        SKY.map(|sky| direct + sky * open_sky)
    }

    /// Grey level of a radiance in a band; `noise` is added to it.
    pub(super) fn level(&self, band: usize, radiance: f64, noise: f64) -> u8 {
        let level = self.offset[band] + self.gain[band] * radiance + noise;
        // The value 0 is not used, because some readers take it for nodata.
        level.round().clamp(1.0, 255.0) as u8
    }
}
