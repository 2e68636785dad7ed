//! The relation between encoded pixel values and linear radiance.

use crate::io::Grid2;
use serde::{Deserialize, Serialize};

/// A power law between encoded pixel values and linear ones: `linear = white · encoded^gamma`.
///
/// Shadows and blends of surfaces add up in linear values. Images made for display hold encoded values, with a gamma
/// near 2.2; for images of raw sensor counts the function is the identity (gamma 1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Stored")]
pub struct TransferFunction {
    gamma: f32,
    /// Linear value of encoded 1.
    white: f32,
}

/// A transfer function as it is stored in files.
#[derive(Deserialize)]
struct Stored {
    gamma: f32,
    #[serde(default = "one")]
    white: f32,
}

fn one() -> f32 {
    1.0
}

impl TryFrom<Stored> for TransferFunction {
    type Error = String;

    fn try_from(Stored { gamma, white }: Stored) -> Result<Self, String> {
        let function = Self::new(gamma)
            .ok_or(format!("transfer_function.gamma = {gamma} is outside of the range 1 to 4"))?;
        if !(white.is_finite() && white > 0.0) {
            return Err(format!("transfer_function.white = {white} is not a positive number"));
        }
        Ok(Self { white, ..function })
    }
}

impl Default for TransferFunction {
    /// The identity.
    fn default() -> Self {
        Self { gamma: 1.0, white: 1.0 }
    }
}

impl TransferFunction {
    /// That of images which are processed for display: a gamma of 2.2.
    pub const DISPLAY: Self = Self { gamma: 2.2, white: 1.0 };

    /// The function with the exponent `gamma`; none unless it is from 1 to 4.
    #[must_use]
    pub fn new(gamma: f32) -> Option<Self> {
        (1.0..=4.0).contains(&gamma).then_some(Self { gamma, white: 1.0 })
    }

    /// The exponent, to six decimals.
    #[must_use]
    pub fn gamma(&self) -> f64 {
        (1e6 * f64::from(self.gamma)).round() / 1e6
    }

    /// Whether encoded and linear values are the same.
    #[must_use]
    pub fn is_linear(&self) -> bool {
        self.gamma == 1.0
    }

    /// The function with another linear value of encoded 1; the identity is returned unchanged.
    #[must_use]
    pub fn with_white(self, white: f32) -> Self {
        if self.is_linear() { self } else { Self { white, ..self } }
    }

    /// The linear value of an encoded one; negative values keep their sign.
    #[must_use]
    pub fn linear(self, encoded: f32) -> f32 {
        self.white * encoded.abs().powf(self.gamma).copysign(encoded)
    }

    /// The encoded value of a linear one; negative values keep their sign.
    #[must_use]
    pub fn encoded(self, linear: f32) -> f32 {
        (linear.abs() / self.white).powf(self.gamma.recip()).copysign(linear)
    }

    /// Replaces the linear values of image bands by encoded ones.
    pub fn encode(self, bands: &mut [Grid2]) {
        bands.iter_mut().flat_map(|band| &mut band.data).for_each(|v| *v = self.encoded(*v));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_undoes_linearising_and_gamma_1_is_the_identity() {
        let function = TransferFunction::new(2.2).unwrap();
        for v in [0.0, 0.003, 0.2, 0.9, 1.0, 1.3] {
            assert!((function.encoded(function.linear(v)) - v).abs() < 1e-6, "{v}");
            assert_eq!(TransferFunction::default().linear(v), v);
            assert_eq!(TransferFunction::default().encoded(v), v);
        }
        assert!((function.linear(0.5) - 0.5f32.powf(2.2)).abs() < 1e-7);
        assert_eq!(
            [function.linear(-0.1), function.encoded(-0.1)],
            [-function.linear(0.1), -function.encoded(0.1)]
        );
        let dark = function.with_white(0.4);
        assert!((dark.linear(0.5) - 0.4 * function.linear(0.5)).abs() < 1e-7);
        assert!((dark.encoded(dark.linear(0.7)) - 0.7).abs() < 1e-6);
        assert_eq!(TransferFunction::default().with_white(0.4), TransferFunction::default());
        let mut bands = [Grid2::filled(2, 1, f32::NAN), Grid2::filled(2, 1, 1.0)];
        function.encode(&mut bands);
        assert!(bands[0].data[0].is_nan() && (bands[1].data[1] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn exponents_outside_of_1_to_4_are_refused() {
        for gamma in [0.0, 0.99, 4.1, -2.2, f32::NAN, f32::INFINITY] {
            assert_eq!(TransferFunction::new(gamma), None);
        }
    }

    #[test]
    fn a_round_trip_through_json_keeps_the_function_and_invalid_values_are_refused() {
        let function = TransferFunction::new(2.2).unwrap().with_white(0.4);
        assert_eq!(
            serde_json::from_str::<TransferFunction>(&serde_json::to_string(&function).unwrap()).unwrap(),
            function
        );
        assert_eq!(
            serde_json::from_str::<TransferFunction>(r#"{"gamma": 2.2}"#).unwrap(),
            TransferFunction::new(2.2).unwrap()
        );
        for (text, field) in [
            (r#"{"gamma": 0}"#, "transfer_function.gamma = 0"),
            (r#"{"gamma": 2, "white": -1}"#, "transfer_function.white = -1"),
        ] {
            let error = serde_json::from_str::<TransferFunction>(text).unwrap_err().to_string();
            assert!(error.contains(field), "{error}");
        }
    }
}
