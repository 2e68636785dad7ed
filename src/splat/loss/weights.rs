//! The weights of the loss's terms, by name.

use super::{TERMS, WEIGHTS};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A weight for each name in [`TERMS`]; zero unless set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "BTreeMap<String, f64>", into = "BTreeMap<String, f64>")]
pub struct LossWeights {
    values: [f64; WEIGHTS],
}

/// A weight that no term has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no loss term has the weight `{name}`, expected one of {}", names().collect::<Vec<_>>().join(", "))]
pub struct WeightError {
    /// Its name.
    pub name: String,
}

/// Names of all weights.
fn names() -> impl Iterator<Item = &'static str> {
    TERMS.iter().flat_map(|term| term.weights.iter().copied())
}

impl LossWeights {
    /// These weights, the others zero.
    ///
    /// # Errors
    /// [`WeightError`].
    pub fn of(named: &[(&str, f64)]) -> Result<Self, WeightError> {
        Self::default().with(named)
    }

    /// The same weights but for these.
    ///
    /// # Errors
    /// [`WeightError`].
    pub fn with(mut self, named: &[(&str, f64)]) -> Result<Self, WeightError> {
        for (name, value) in named {
            *self.place(name)? = *value;
        }
        Ok(self)
    }

    /// Every name with its weight.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        names().zip(self.values)
    }

    /// A weight; zero of a name that no term has.
    #[must_use]
    pub fn get(&self, name: &str) -> f64 {
        self.iter().find(|(n, _)| *n == name).map_or(0.0, |(_, value)| value)
    }

    /// The same weights, those of these names multiplied by a factor.
    #[must_use]
    pub fn scaled(mut self, scaled: &[&str], factor: f64) -> Self {
        for (name, value) in names().zip(&mut self.values) {
            if scaled.contains(&name) {
                *value *= factor;
            }
        }
        self
    }

    /// The weights of each term.
    pub(in crate::splat) fn by_term(&self) -> impl Iterator<Item = &[f64]> {
        let mut rest = &self.values[..];
        TERMS.iter().map(move |term| {
            let (own, others) = rest.split_at(term.weights.len());
            rest = others;
            own
        })
    }

    fn place(&mut self, name: &str) -> Result<&mut f64, WeightError> {
        let place = names().position(|n| n == name);
        place.map(|k| &mut self.values[k]).ok_or_else(|| WeightError { name: name.into() })
    }
}

impl TryFrom<BTreeMap<String, f64>> for LossWeights {
    type Error = WeightError;

    fn try_from(named: BTreeMap<String, f64>) -> Result<Self, WeightError> {
        Self::of(&named.iter().map(|(name, value)| (name.as_str(), *value)).collect::<Vec<_>>())
    }
}

impl From<LossWeights> for BTreeMap<String, f64> {
    fn from(weights: LossWeights) -> Self {
        weights.iter().map(|(name, value)| (name.into(), value)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_set_read_and_scaled_by_name() {
        let weights = LossWeights::of(&[("opacity", 0.5), ("shadow_entropy", 2.0)]).unwrap();
        assert_eq!((weights.get("opacity"), weights.get("consistency_color")), (0.5, 0.0));
        let scaled = weights.scaled(&["opacity"], 3.0);
        assert_eq!((scaled.get("opacity"), scaled.get("shadow_entropy")), (1.5, 2.0));
        assert_eq!(LossWeights::try_from(BTreeMap::from(scaled)), Ok(scaled));
        assert_eq!(weights.by_term().map(<[f64]>::len).sum::<usize>(), WEIGHTS);
        assert!(
            LossWeights::of(&[("opacities", 1.0)]).unwrap_err().to_string().contains("consistency_color")
        );
    }
}
