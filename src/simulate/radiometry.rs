//! From radiance to the grey levels of an image: exposure, colour cast, haze, noise.

use super::keyed_rng::KeyedRng;
use super::options::BitDepth;

/// Irradiance of a horizontal surface by the sky, relative to that of a surface perpendicular to the sun.
const SKY: [f64; 3] = [0.25, 0.275, 0.32];

/// Exposure of images of 16 bits relative to that of 8 bits: snow in the sun is not saturated.
const WIDE_EXPOSURE: f64 = 0.55;
/// Noise of images of 16 bits relative to that of 8 bits, both as shares of white: 4 to 10 of 4,095 levels.
const WIDE_NOISE: f64 = 0.35;

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
    /// The highest grey level.
    pub(super) white: u16,
}

impl Radiometry {
    /// The radiometry of a view of this depth; `sun` is the unit vector to the sun on the map.
    pub(super) fn new(rng: KeyedRng, sun: [f64; 3], depth: BitDepth) -> Self {
        let eight = Self::of_eight_bits(rng, sun);
        match depth {
            BitDepth::Eight => eight,
            BitDepth::Sixteen => {
                let white = depth.white();
                let levels = f64::from(white) / f64::from(eight.white);
                Self {
                    gain: eight.gain.map(|g| g * levels * WIDE_EXPOSURE),
                    offset: eight.offset.map(|o| o * levels * WIDE_EXPOSURE),
                    noise: eight.noise * levels * WIDE_NOISE,
                    white,
                    ..eight
                }
            }
        }
    }

    fn of_eight_bits(rng: KeyedRng, sun: [f64; 3]) -> Self {
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
            white: BitDepth::Eight.white(),
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
    pub(super) fn level(&self, band: usize, radiance: f64, noise: f64) -> u16 {
        let level = self.offset[band] + self.gain[band] * radiance + noise;
        // The value 0 is not used, because some readers take it for nodata.
        level.round().clamp(1.0, f64::from(self.white)) as u16
    }

    /// A grey level in eight bits.
    pub(super) fn in_eight_bits(&self, level: u16) -> u8 {
        let eight = u32::from(BitDepth::Eight.white());
        (u32::from(level) * eight / u32::from(self.white)) as u8
    }
}
