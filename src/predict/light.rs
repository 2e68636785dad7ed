//! Colours of positions without the light of the dates on which images were taken.
//!
//! An image shows a colour `c` as `(s + (1 - s) κ) ⊙ (g ⊙ c + o)`, with `s` the share of sunlight: the colour model of training
//! ([`affine`](crate::splat::appearance::affine)) without mixing of channels. [`calibrate`] finds gain `g`, offset `o` and ambient
//! light `κ` of each image from positions that several of them show; [`seen_color`] takes the median of what they show of one.

use super::observer::{ImageObserver, ImageSample};
use crate::splat::appearance::{Appearance, AppearanceKind};
use crate::stats::quantile;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Largest number of positions that images are compared at.
const POSITIONS: usize = 6000;
/// Positions count as seen and as sunlit above the first, as shaded below the second.
const IS_SEEN: f32 = 0.8;
const IS_SHADED: f32 = 0.2;
/// Fewest positions that determine gain and offset, or the ambient light.
const FEWEST: usize = 30;
/// Passes over all images.
const PASSES: usize = 6;
/// Gains and ambient lights outside of these are not believed.
const GAINS: (f64, f64) = (0.2, 5.0);
const AMBIENTS: (f64, f64) = (0.03, 1.0);
/// Ambient light of images without shaded positions.
const AMBIENT: f32 = 0.3;
/// Weight of what a view shows in the shade, against one in sunlight.
const WEIGHT_OF_SHADE: f32 = 0.1;
/// Absolute differences above this linear value count less.
const ROBUST: f64 = 0.05;

/// How an image shows colours.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// Factor of each channel.
    pub gain: [f32; 3],
    /// Added to each channel.
    pub offset: [f32; 3],
    /// Light in the shade, relative to sunlight.
    pub ambient: [f32; 3],
}

impl Default for Light {
    fn default() -> Self {
        Self { gain: [1.0; 3], offset: [0.0; 3], ambient: [AMBIENT; 3] }
    }
}

impl Light {
    /// The colour of what an image shows.
    #[must_use]
    pub fn color(&self, seen: &ImageSample) -> [f32; 3] {
        std::array::from_fn(|k| {
            let light = seen.sunlight + (1.0 - seen.sunlight) * self.ambient[k];
            (seen.color[k] / light - self.offset[k]) / self.gain[k]
        })
    }

    /// The colour model of the image for training and rendering.
    #[must_use]
    pub fn appearance(&self) -> Appearance {
        let ([a, b, c], [x, y, z], [p, q, r]) = (self.gain, self.offset, self.ambient);
        let values = vec![a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c, x, y, z, p, q, r];
        Appearance { kind: AppearanceKind::Affine, values }
    }
}

/// What the images show of a position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SeenColor {
    /// Median colour in full sunlight, weighted by visibility and sunlight; zero if no image shows the position.
    pub color: [f32; 3],
    /// Mean absolute difference from it.
    pub deviation: f32,
    /// Sum of its visibility in all images.
    pub views: f32,
    /// Mean share of sunlight in these.
    pub sunlight: f32,
}

impl SeenColor {
    /// The colour; grey of this brightness if no image shows the position.
    #[must_use]
    pub fn color_or(&self, brightness: f32) -> [f32; 3] {
        if self.views > 0.0 { self.color } else { [brightness; 3] }
    }
}

/// What each image shows of some positions; none where it does not show one.
type Shown = Vec<Vec<Option<ImageSample>>>;

/// The light of each image, so that colours are those of the image `reference` in full sunlight.
#[must_use]
pub fn calibrate(images: &dyn ImageObserver, positions: &[[f64; 3]], reference: usize) -> Vec<Light> {
    let views = images.views();
    let step = positions.len().div_ceil(POSITIONS).max(1);
    let positions: Vec<[f64; 3]> = positions.iter().step_by(step).copied().collect();
    let seen = |p: &[f64; 3]| {
        let seen = |view: usize| images.observe(view, *p).filter(|o| o.visibility > IS_SEEN);
        (0..views).map(seen).collect()
    };
    let seen: Shown = positions.par_iter().map(seen).collect();
    let mut lights = vec![Light::default(); views];
    for _ in 0..PASSES {
        let colors = sunlit_colors(&seen, &lights, 2);
        let fit = |view: usize| with_gain(&seen, &colors, view, lights[view]);
        let fitted: Vec<Light> = (0..views).into_par_iter().map(fit).collect();
        lights = relative_to(&fitted, reference);
    }
    let colors = sunlit_colors(&seen, &lights, 1);
    lights.iter().enumerate().map(|(view, light)| with_ambient(&seen, &colors, view, *light)).collect()
}

fn is_sunlit(sample: &ImageSample) -> bool {
    sample.sunlight > IS_SEEN
}

/// The median colour of each position over the images that show it in sunlight; none if these are fewer than `fewest`.
fn sunlit_colors(seen: &Shown, lights: &[Light], fewest: usize) -> Vec<Option<[f64; 3]>> {
    let median = |seen: &Vec<Option<ImageSample>>| {
        let shown = seen.iter().zip(lights);
        let sunlit = shown.filter_map(|(o, light)| Some(light.color(o.as_ref().filter(|o| is_sunlit(o))?)));
        let colors: Vec<[f32; 3]> = sunlit.collect();
        let of = |k: usize| quantile(colors.iter().map(|c| f64::from(c[k])).collect(), 0.5);
        (colors.len() >= fewest).then(|| Some([of(0)?, of(1)?, of(2)?])).flatten()
    };
    seen.par_iter().map(median).collect()
}

/// The light of a view with gain and offset by which it shows these colours in sunlight.
fn with_gain(seen: &Shown, colors: &[Option<[f64; 3]>], view: usize, mut light: Light) -> Light {
    for k in 0..3 {
        let own = seen.iter().map(|seen| seen[view].as_ref().filter(|o| is_sunlit(o)));
        let both = own.zip(colors).filter_map(|(o, color)| Some(((*color)?[k], f64::from(o?.color[k]))));
        if let Some((gain, offset)) = fit_line(&both.collect::<Vec<_>>(), light.gain[k], light.offset[k]) {
            (light.gain[k], light.offset[k]) = (gain, offset);
        }
    }
    light
}

/// The same lights for colours that are those of the image `reference`.
fn relative_to(lights: &[Light], reference: usize) -> Vec<Light> {
    let Light { gain, offset, .. } = lights[reference];
    let relative = |light: &Light| {
        let mut out = *light;
        for k in 0..3 {
            out.gain[k] = light.gain[k] / gain[k];
            out.offset[k] = light.offset[k] - out.gain[k] * offset[k];
        }
        out
    };
    lights.iter().map(relative).collect()
}

/// The light of a view with the ambient light by which it shows these colours in the shade.
fn with_ambient(seen: &Shown, colors: &[Option<[f64; 3]>], view: usize, mut light: Light) -> Light {
    let shaded = seen.iter().zip(colors).filter_map(|(seen, color)| {
        let o = seen[view].as_ref().filter(|o| o.sunlight < IS_SHADED)?;
        Some((o.color, (*color)?))
    });
    let shaded: Vec<([f32; 3], [f64; 3])> = shaded.collect();
    for k in 0..3 {
        let ratio = |(own, color): &([f32; 3], [f64; 3])| {
            let sunlit = f64::from(light.gain[k]) * color[k] + f64::from(light.offset[k]);
            f64::from(own[k]) / sunlit.max(1e-3)
        };
        let median = quantile(shaded.iter().map(ratio).collect(), 0.5);
        if let Some(ambient) = median.filter(|_| shaded.len() >= FEWEST) {
            light.ambient[k] = ambient.clamp(AMBIENTS.0, AMBIENTS.1) as f32;
        }
    }
    light
}

/// Gain and offset of `y = gain x + offset` by least squares in which values far from the line so far count less.
fn fit_line(pairs: &[(f64, f64)], gain: f32, offset: f32) -> Option<(f32, f32)> {
    if pairs.len() < FEWEST {
        return None;
    }
    let (mut n, mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (x, y) in pairs {
        let residual = y - f64::from(gain) * x - f64::from(offset);
        let weight = 1.0 / (1.0 + (residual / ROBUST).powi(2));
        (n, sx, sy) = (n + weight, sx + weight * x, sy + weight * y);
        (sxx, sxy) = (sxx + weight * x * x, sxy + weight * x * y);
    }
    let spread = n * sxx - sx * sx;
    let gain = (n * sxy - sx * sy) / spread.max(1e-12);
    let is_sound = spread > 1e-6 * n * n && gain > GAINS.0 && gain < GAINS.1;
    is_sound.then(|| (gain as f32, ((sy - gain * sx) / n) as f32))
}

/// The colour of a position.
#[must_use]
pub fn seen_color(images: &dyn ImageObserver, lights: &[Light], position: [f64; 3]) -> SeenColor {
    let mut shown: Vec<([f32; 3], f32)> = Vec::with_capacity(lights.len());
    let (mut views, mut sunlight) = (0.0, 0.0);
    for (view, light) in lights.iter().enumerate() {
        let Some(o) = images.observe(view, position).filter(|o| o.visibility > 1e-3) else { continue };
        views += o.visibility;
        sunlight += o.visibility * o.sunlight;
        let weight = o.visibility * (o.sunlight + WEIGHT_OF_SHADE * (1.0 - o.sunlight));
        shown.push((light.color(&o), weight));
    }
    if shown.is_empty() {
        return SeenColor::default();
    }
    let color: [f32; 3] = std::array::from_fn(|k| weighted_median(&mut shown, k));
    let total: f32 = shown.iter().map(|s| s.1).sum();
    let difference = |rgb: &[f32; 3]| (0..3).map(|k| (rgb[k] - color[k]).abs()).sum::<f32>() / 3.0;
    let deviation = shown.iter().map(|(rgb, weight)| weight * difference(rgb)).sum::<f32>() / total;
    SeenColor { color, deviation, views, sunlight: sunlight / views }
}

/// The weighted median of a channel, between the two middle values where these share the weight.
fn weighted_median(values: &mut [([f32; 3], f32)], channel: usize) -> f32 {
    values.sort_by(|a, b| a.0[channel].total_cmp(&b.0[channel]));
    let half = 0.5 * values.iter().map(|v| v.1).sum::<f32>();
    let mut before = 0.0;
    for (i, (rgb, weight)) in values.iter().enumerate() {
        before += weight;
        if before > half || i + 1 == values.len() {
            return rgb[channel];
        }
        if before == half {
            return 0.5 * (rgb[channel] + values[i + 1].0[channel]);
        }
    }
    0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{CenterPx, Pixel};
    use crate::predict::image_features::FEATURE_MAPS;
    use crate::random::CounterRng;

    /// Images with a known light of positions whose colour and sunlight are drawn by their first coordinate.
    struct Drawn(Vec<Light>);

    fn truth(position: [f64; 3]) -> [f32; 3] {
        let mut draw = CounterRng::new(1, 0, 0, position[0] as u64);
        std::array::from_fn(|_| 0.1 + 0.5 * draw.uniform() as f32)
    }

    impl ImageObserver for Drawn {
        fn views(&self) -> usize {
            self.0.len()
        }

        fn observe(&self, view: usize, position: [f64; 3]) -> Option<ImageSample> {
            let mut draw = CounterRng::new(2, view as u64, 0, position[0] as u64);
            let sunlight = if draw.uniform() < 0.3 { 0.0 } else { 1.0 };
            let (light, color) = (&self.0[view], truth(position));
            let shown = std::array::from_fn(|k| {
                let light_here = sunlight + (1.0 - sunlight) * light.ambient[k];
                light_here * (light.gain[k] * color[k] + light.offset[k]) + 0.003 * draw.normal() as f32
            });
            (draw.uniform() < 0.8).then_some(ImageSample { color: shown, visibility: 1.0, sunlight })
        }

        fn project(&self, _: usize, _: [f64; 3]) -> Option<Pixel<CenterPx>> {
            None
        }

        fn features(&self, _: usize, _: [f64; 3]) -> Option<[f32; FEATURE_MAPS]> {
            None
        }
    }

    #[test]
    fn the_light_of_each_image_and_colours_without_it_are_found() {
        let light = |gain: f32, offset: f32, ambient: f32| Light {
            gain: [gain, 0.9 * gain, 1.1 * gain],
            offset: [offset; 3],
            ambient: [ambient, ambient, 1.2 * ambient],
        };
        let reference = Light { gain: [1.0; 3], offset: [0.0; 3], ambient: [0.3; 3] };
        let images =
            Drawn(vec![light(0.7, 0.05, 0.2), reference, light(1.3, -0.02, 0.4), light(0.9, 0.1, 0.25)]);
        let positions: Vec<[f64; 3]> = (0..3000).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let lights = calibrate(&images, &positions, 1);
        for (found, expected) in lights.iter().zip(&images.0) {
            for k in 0..3 {
                assert!((found.gain[k] - expected.gain[k]).abs() < 0.03, "{found:?} {expected:?}");
                assert!((found.offset[k] - expected.offset[k]).abs() < 0.02, "{found:?} {expected:?}");
                assert!((found.ambient[k] - expected.ambient[k]).abs() < 0.03, "{found:?} {expected:?}");
            }
        }
        let off = |p: &[f64; 3]| {
            (0..3).map(|k| (seen_color(&images, &lights, *p).color[k] - truth(*p)[k]).abs()).sum::<f32>()
                / 3.0
        };
        let error = positions[..300].iter().map(off).sum::<f32>() / 300.0;
        assert!(error < 0.02, "{error}");
    }
}
