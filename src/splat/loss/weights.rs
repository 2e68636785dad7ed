//! The weights of the loss terms, by name.

use super::{TERMS, WEIGHTS};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A weight for each name in [`TERMS`]; zero if it is not set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "BTreeMap<String, f64>", into = "BTreeMap<String, f64>")]
pub struct LossWeights {
    values: [f64; WEIGHTS],
}

/// A name that no loss term has for a weight.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no loss term has the weight `{name}`, expected one of {}", names().collect::<Vec<_>>().join(", "))]
pub struct WeightError {
    /// The name.
    pub name: String,
}

/// Names of all weights.
fn names() -> impl Iterator<Item = &'static str> {
    TERMS.iter().flat_map(|term| term.weights.iter().copied())
}

impl LossWeights {
    /// The named weights; all others are zero.
    ///
    /// # Errors
    /// [`WeightError`] if no term has a weight of one of the names.
    pub fn of(named: &[(&str, f64)]) -> Result<Self, WeightError> {
        Self::default().with(named)
    }

    /// These weights, with the named ones replaced.
    ///
    /// # Errors
    /// [`WeightError`] if no term has a weight of one of the names.
    pub fn with(mut self, named: &[(&str, f64)]) -> Result<Self, WeightError> {
        for (name, value) in named {
            *self.weight_mut(name)? = *value;
        }
        Ok(self)
    }

    /// All names with their weights.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        names().zip(self.values)
    }

    /// The weight of this name; zero if no term has it.
    #[must_use]
    pub fn get(&self, name: &str) -> f64 {
        self.iter().find(|(n, _)| *n == name).map_or(0.0, |(_, value)| value)
    }

    /// These weights, with those named in `scaled` multiplied by a factor.
    #[must_use]
    pub fn scaled(mut self, scaled: &[&str], factor: f64) -> Self {
        for (name, value) in names().zip(&mut self.values) {
            if scaled.contains(&name) {
                *value *= factor;
            }
        }
        self
    }

    /// The weights of each term, in the order of [`TERMS`].
    pub(in crate::splat) fn by_term(&self) -> impl Iterator<Item = &[f64]> {
        let mut rest = &self.values[..];
        TERMS.iter().map(move |term| {
            let (own, others) = rest.split_at(term.weights.len());
            rest = others;
            own
        })
    }

    fn weight_mut(&mut self, name: &str) -> Result<&mut f64, WeightError> {
        let index = names().position(|n| n == name);
        index.map(|k| &mut self.values[k]).ok_or_else(|| WeightError { name: name.into() })
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
