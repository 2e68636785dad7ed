//! How a model is trained.

use super::error::LearnError;
use crate::io::read_text;
use crate::predict::SplatSampling;
use crate::predict::network::SplatNetwork;
use crate::scene::TransferFunction;
use crate::simulate::{Relief, SimulateOptions, Terrain};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Number of images of a town that renders are compared with.
const TARGETS: usize = 4;
/// Of one cycle: the part of the steps with a rising rate, and the first and last rate relative to the largest (PyTorch).
const RISING: f64 = 0.3;
const FIRST_RATE: f64 = 1.0 / 25.0;
const LAST_RATE: f64 = 1.0 / 25e4;

/// How a model is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LearnConfig {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Number of towns to learn from. Photographs have no use for this, for `size_px`, `gsd_m`, `gamma` and `validation_towns`, and
    /// the network and the spacings are those of the model that is trained further.
    pub towns: usize,
    /// Number of rounds.
    pub rounds: usize,
    /// Number of tiles of a round.
    pub tiles: usize,
    /// Number of steps of a round.
    pub steps: usize,
    /// Number of rounds whose tiles are kept.
    pub kept_rounds: usize,
    /// Largest learning rate.
    pub rate: f64,
    /// Columns and rows of the images.
    pub size_px: usize,
    /// Number of images of a town or of photographs to predict from.
    pub views: usize,
    /// Ground sampling distances of the images, metres, which towns take in turn.
    pub gsd_m: Vec<f64>,
    /// Display gammas that the images are taken to have, which pairs of towns take in turn: scenes then have contrasts of several kinds.
    pub gamma: Vec<f32>,
    /// Number of towns for validation, after every so many rounds.
    pub validation_towns: usize,
    /// Number of rounds between validations.
    pub validate_every: usize,
    /// Shape of the network. Its number of image features is that of those that are there.
    pub network: SplatNetwork,
    /// Spacings of points.
    pub sampling: SplatSampling,
}

impl Default for LearnConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            towns: 40,
            rounds: 320,
            tiles: 6,
            steps: 64,
            kept_rounds: 24,
            rate: 3e-3,
            size_px: 320,
            views: 8,
            gsd_m: vec![0.5, 0.35],
            gamma: vec![1.0, 2.2],
            validation_towns: 3,
            validate_every: 20,
            network: SplatNetwork::default(),
            sampling: SplatSampling::default(),
        }
    }
}

impl LearnConfig {
    /// That of training a model further on photographs: with a fifth of the rounds, as in Point2GS (§4.1), where the rate is a third.
    /// On RedKitchen of 7-Scenes a third is as good for many points (17.8 dB; 17.7 to 17.9 with the whole rate) and worse for few (1 % of
    /// them: 15.4; 15.6 to 15.9).
    #[must_use]
    pub fn of_photographs() -> Self {
        let towns = Self::default();
        Self { rounds: towns.rounds / 5, validate_every: 8, ..towns }
    }

    /// This configuration, with what a TOML file replaces.
    ///
    /// # Errors
    /// [`LearnError::ConfigFile`] if it cannot be read or has other fields.
    pub fn with_file(&self, path: &Path) -> Result<Self, LearnError> {
        let failed = |reason: String| LearnError::ConfigFile { path: path.into(), reason };
        let invalid = |e: toml::de::Error| failed(e.to_string().trim_end().to_owned());
        let text = read_text(path).map_err(|e| failed(e.cause.to_string()))?;
        let mut all: toml::Table = toml::from_str(&self.to_toml()).map_err(invalid)?;
        replace(&mut all, toml::from_str(&text).map_err(invalid)?);
        all.try_into().map_err(invalid)
    }

    /// The configuration as TOML.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// Checks that every number is in its range.
    pub(super) fn check(&self) -> Result<(), LearnError> {
        let counts = [
            ("towns", self.towns),
            ("rounds", self.rounds),
            ("tiles", self.tiles),
            ("steps", self.steps),
            ("kept_rounds", self.kept_rounds),
            ("validate_every", self.validate_every),
        ];
        // More towns would have the seeds of another `seed`.
        if self.towns > 1 << 16 {
            let found = self.towns.to_string();
            return Err(LearnError::Config { field: "towns", found, expected: "1 to 65536" });
        }
        for (field, n) in counts {
            if !(1..=1_000_000).contains(&n) {
                return Err(LearnError::Config { field, found: n.to_string(), expected: "1 to 1000000" });
            }
        }
        let lengths = [
            ("rate", self.rate, 1e-9..=1.0, "more than 0, at most 1"),
            ("sampling.spacing_m", self.sampling.spacing_m, 0.1..=10.0, "0.1 to 10 metres"),
            ("sampling.key_spacing_m", self.sampling.key_spacing_m, 0.1..=50.0, "0.1 to 50 metres"),
        ];
        for (field, value, range, expected) in lengths {
            if !range.contains(&value) {
                return Err(LearnError::Config { field, found: value.to_string(), expected });
            }
        }
        for (field, is_empty) in [("gsd_m", self.gsd_m.is_empty()), ("gamma", self.gamma.is_empty())] {
            if is_empty {
                let found = "an empty list".into();
                return Err(LearnError::Config { field, found, expected: "at least one number" });
            }
        }
        if !self.network.is_sound() {
            let found = format!("{:?}", self.network);
            let expected = "a width of 4 to 512, divisible by 4";
            return Err(LearnError::Config { field: "network", found, expected });
        }
        // Of the lists, towns take one after the other.
        for seed in 0..2 * (self.gsd_m.len() + self.gamma.len()) as u64 {
            self.transfer_function(seed)?;
            self.town(seed).check()?;
        }
        Ok(())
    }

    /// The simulation of the town with this seed.
    pub(super) fn town(&self, seed: u64) -> SimulateOptions {
        let relief = if seed % 5 == 3 { Relief::Hilly } else { Relief::Rolling };
        SimulateOptions {
            seed,
            views: self.views,
            size_px: self.size_px,
            gsd_m: self.gsd_m[seed as usize % self.gsd_m.len()],
            terrain: Terrain::Town(relief),
            held_out: TARGETS,
            overwrite: true,
            ..SimulateOptions::default()
        }
    }

    /// How the images of the town with this seed encode light.
    pub(super) fn transfer_function(&self, seed: u64) -> Result<TransferFunction, LearnError> {
        let gamma = self.gamma[(seed / 2) as usize % self.gamma.len()];
        let wrong = || LearnError::Config { field: "gamma", found: gamma.to_string(), expected: "1 to 4" };
        TransferFunction::new(gamma).ok_or_else(wrong)
    }

    /// Learning rate of a step.
    pub(super) fn rate_of(&self, step: usize) -> f64 {
        let all = (self.rounds * self.steps) as f64;
        let done = step as f64 / all;
        let cosine = |from: f64, to: f64, part: f64| {
            to + 0.5 * (from - to) * (1.0 + (std::f64::consts::PI * part).cos())
        };
        self.rate
            * if done < RISING {
                cosine(FIRST_RATE, 1.0, done / RISING)
            } else {
                cosine(1.0, LAST_RATE, (done - RISING) / (1.0 - RISING))
            }
    }

    /// What a model of this training says of its origin.
    pub(in crate::predict) fn origin(&self) -> String {
        let config = serde_json::to_string(self).unwrap_or_default();
        format!("satgs {} learn, configuration {config}", env!("CARGO_PKG_VERSION"))
    }
}

/// Replaces the values of a table, and of those in it, by those of another.
fn replace(table: &mut toml::Table, other: toml::Table) {
    for (key, value) in other {
        match (table.get_mut(&key), value) {
            (Some(toml::Value::Table(own)), toml::Value::Table(other)) => replace(own, other),
            (_, value) => drop(table.insert(key, value)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_file_does_not_name_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("learn.toml");
        let base = LearnConfig::of_photographs();
        std::fs::write(&path, "seed = 7\n[sampling]\nspacing_m = 0.25\n").unwrap();
        let sampling = SplatSampling { spacing_m: 0.25, ..base.sampling };
        assert_eq!(base.with_file(&path).unwrap(), LearnConfig { seed: 7, sampling, ..base.clone() });
        std::fs::write(&path, "steps = 4\nseeds = 7\n").unwrap();
        let text = base.with_file(&path).unwrap_err().to_string();
        assert!(text.contains("learn.toml") && text.contains("`seeds`"), "{text}");
        std::fs::write(&path, "steps = 4\nseed = \n").unwrap();
        let text = base.with_file(&path).unwrap_err().to_string();
        assert!(text.contains("line 2"), "{text}");
    }
}
