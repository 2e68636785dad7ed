//! Depths and normals as networks give them: the exact ones with smooth errors.

use crate::simulate::keyed_rng::KeyedRng;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Largest share by which the warp changes a value.
const WARP: f64 = 0.1;
/// Wavelength of the warp, as a share of the side of the image.
const WARP_WAVELENGTH: f64 = 0.4;
/// Largest component of the vector that is added to a normal; turns normals by 10 degrees on average.
const BEND: f64 = 0.32;
/// Wavelength of the errors of normals, as a share of the side of the image.
const BEND_WAVELENGTH: f64 = 0.12;

/// The affine map from inverse depths to the values of a prior, before they are warped.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DisparityMap {
    /// Value per inverse metre.
    pub scale: f64,
    /// Value at infinity.
    pub offset: f64,
}

/// Disparities of a square map of exact depths: `(scale / depth + offset) * (1 + warp)`. They are about 0.2 at the largest
/// and 1 at the smallest depth of the image, as networks give them that know no scale.
pub(super) fn disparities(depths: &[f32], size_px: usize, rng: KeyedRng) -> (Vec<f32>, DisparityMap) {
    let inverse = |depth: &f32| 1.0 / f64::from(*depth);
    let known = depths.iter().filter(|d| d.is_finite()).map(inverse);
    let (low, high) = known.fold((f64::INFINITY, 0.0f64), |(low, high), d| (low.min(d), high.max(d)));
    let (least, most) = (rng.key(1).uniform_in(0.15, 0.3), rng.key(2).uniform_in(0.8, 1.2));
    let scale = (most - least) / (high - low).max(f64::MIN_POSITIVE);
    let map = DisparityMap { scale, offset: least - scale * low };
    let waves = Waves { rng: rng.key(3), wavelength_px: WARP_WAVELENGTH * size_px as f64 };
    let value = |(k, depth): (usize, &f32)| {
        let warp = WARP * waves.at(k % size_px, k / size_px);
        ((map.scale * inverse(depth) + map.offset) * (1.0 + warp)) as f32
    };
    (depths.iter().enumerate().map(value).collect(), map)
}

/// Unit normals of a square map with smooth errors of about 10 degrees.
pub(super) fn bent_normals(normals: &[f32], size_px: usize, rng: KeyedRng) -> Vec<f32> {
    let waves =
        [1, 2, 3].map(|key| Waves { rng: rng.key(key), wavelength_px: BEND_WAVELENGTH * size_px as f64 });
    let bent = |(k, normal): (usize, &[f32])| {
        let error = waves.each_ref().map(|waves| BEND * waves.at(k % size_px, k / size_px));
        let normal = DVec3::from_array(std::array::from_fn(|i| f64::from(normal[i])));
        (normal + DVec3::from_array(error)).normalize().as_vec3().to_array()
    };
    normals.chunks_exact(3).enumerate().flat_map(bent).collect()
}

/// Smooth noise over an image, within ±1.
struct Waves {
    rng: KeyedRng,
    wavelength_px: f64,
}

impl Waves {
    fn at(&self, col: usize, row: usize) -> f64 {
        let place = |i: usize| (i as f64 + 0.5) / self.wavelength_px;
        2.0 * self.rng.value_noise(place(col), place(row)) - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disparities_are_within_a_tenth_of_an_affine_map_of_the_inverse_depth() {
        let depths: Vec<f32> = (0..64 * 64).map(|k| 1.0 + (k % 64) as f32 * 0.05).collect();
        let (values, map) = disparities(&depths, 64, KeyedRng::new(4));
        let ratios = || {
            depths.iter().zip(&values).map(|(d, v)| f64::from(*v) / (map.scale / f64::from(*d) + map.offset))
        };
        assert!(ratios().all(|r| (r - 1.0).abs() <= WARP + 1e-6));
        assert!(ratios().fold(0.0, |most: f64, r| most.max((r - 1.0).abs())) > 0.05);
        assert!(values.iter().all(|v| (0.1..1.4).contains(v)));
    }

    #[test]
    fn normals_are_turned_by_about_ten_degrees() {
        let normals = [0.0f32, 0.6, -0.8].repeat(128 * 128);
        let bent = bent_normals(&normals, 128, KeyedRng::new(4));
        let angle = |n: &[f32]| {
            let cosine = 0.6 * f64::from(n[1]) - 0.8 * f64::from(n[2]);
            cosine.clamp(-1.0, 1.0).acos().to_degrees()
        };
        let mean_deg = bent.chunks_exact(3).map(angle).sum::<f64>() / (128.0 * 128.0);
        assert!((8.0..12.0).contains(&mean_deg), "{mean_deg}");
    }
}
