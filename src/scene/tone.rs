//! How brightness as it is stored stands for light.

use crate::io::Grid2;
use serde::{Deserialize, Serialize};

/// The power of brightness, from 0 to 1, that is proportional to light: shadows and blends of surfaces add up in light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Stored")]
pub struct Tone {
    gamma: f32,
    /// Light of white.
    white: f32,
}

/// A tone as a file has it.
#[derive(Deserialize)]
struct Stored {
    gamma: f32,
    #[serde(default = "one")]
    white: f32,
}

fn one() -> f32 {
    1.0
}

impl TryFrom<Stored> for Tone {
    type Error = String;

    fn try_from(Stored { gamma, white }: Stored) -> Result<Self, String> {
        let tone = Self::new(gamma).ok_or(format!("tone.gamma = {gamma} is not from 1 to 4"))?;
        if !(white.is_finite() && white > 0.0) {
            return Err(format!("tone.white = {white} is no light"));
        }
        Ok(Self { white, ..tone })
    }
}

impl Default for Tone {
    /// Brightness is light.
    fn default() -> Self {
        Self { gamma: 1.0, white: 1.0 }
    }
}

impl Tone {
    /// A tone with this exponent; none unless it is from 1 to 4.
    #[must_use]
    pub fn new(gamma: f32) -> Option<Self> {
        (1.0..=4.0).contains(&gamma).then_some(Self { gamma, white: 1.0 })
    }

    /// Whether brightness is light.
    #[must_use]
    pub fn is_linear(&self) -> bool {
        self.gamma == 1.0
    }

    /// With another light of white, unless brightness is light as it is.
    #[must_use]
    pub fn with_white(self, white: f32) -> Self {
        if self.is_linear() { self } else { Self { white, ..self } }
    }

    /// The light that a brightness stands for; what is less than none keeps its sign.
    #[must_use]
    pub fn light(self, brightness: f32) -> f32 {
        self.white * brightness.abs().powf(self.gamma).copysign(brightness)
    }

    /// The brightness that stands for a light.
    #[must_use]
    pub fn brightness(self, light: f32) -> f32 {
        (light.abs() / self.white).powf(self.gamma.recip()).copysign(light)
    }

    /// Makes planes of light planes of brightness.
    pub fn show(self, planes: &mut [Grid2]) {
        planes.iter_mut().flat_map(|p| &mut p.data).for_each(|v| *v = self.brightness(*v));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_comes_back_from_its_light_and_linear_brightness_is_light() {
        let tone = Tone::new(2.2).unwrap();
        for v in [0.0, 0.003, 0.2, 0.9, 1.0, 1.3] {
            assert!((tone.brightness(tone.light(v)) - v).abs() < 1e-6, "{v}");
            assert_eq!(Tone::default().light(v), v);
            assert_eq!(Tone::default().brightness(v), v);
        }
        assert!((tone.light(0.5) - 0.5f32.powf(2.2)).abs() < 1e-7);
        assert_eq!([tone.light(-0.1), tone.brightness(-0.1)], [-tone.light(0.1), -tone.brightness(0.1)]);
        let dark = tone.with_white(0.4);
        assert!((dark.light(0.5) - 0.4 * tone.light(0.5)).abs() < 1e-7);
        assert!((dark.brightness(dark.light(0.7)) - 0.7).abs() < 1e-6);
        assert_eq!(Tone::default().with_white(0.4), Tone::default());
        let mut planes = [Grid2::filled(2, 1, f32::NAN), Grid2::filled(2, 1, 1.0)];
        tone.show(&mut planes);
        assert!(planes[0].data[0].is_nan() && (planes[1].data[1] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn no_other_exponents_are_taken() {
        for gamma in [0.0, 0.99, 4.1, -2.2, f32::NAN, f32::INFINITY] {
            assert_eq!(Tone::new(gamma), None);
        }
    }

    #[test]
    fn files_keep_a_tone_and_hold_no_impossible_one() {
        let tone = Tone::new(2.2).unwrap().with_white(0.4);
        assert_eq!(serde_json::from_str::<Tone>(&serde_json::to_string(&tone).unwrap()).unwrap(), tone);
        assert_eq!(serde_json::from_str::<Tone>(r#"{"gamma": 2.2}"#).unwrap(), Tone::new(2.2).unwrap());
        for (text, field) in
            [(r#"{"gamma": 0}"#, "tone.gamma = 0"), (r#"{"gamma": 2, "white": -1}"#, "tone.white = -1")]
        {
            let error = serde_json::from_str::<Tone>(text).unwrap_err().to_string();
            assert!(error.contains(field), "{error}");
        }
    }
}
