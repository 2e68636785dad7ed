//! Training of the network on simulated towns.
//!
//! A round takes a town, draws a cloud of its surface with the errors of stereo matching, and prepares samples from it: tiles with
//! the numbers that the network takes, and the images to compare renders with. The samples of the last rounds are kept, and a
//! number of steps is made with samples drawn from these. Learning rate and momentum follow one cycle (Smith & Topin 2019): the
//! rate rises for three tenths of the steps and falls to nearly zero. The loss is that of 3DGS for pixels in sunlight, and a pull
//! to the exact surface where it is smooth.
//!
//! Everything follows from the configuration: an interrupted training goes on from its last round and gives the same model.

mod points;
mod sample;
mod town;

use super::model::ModelContent;
use super::network::{Evaluation, Network};
use super::{Model, PredictError, Sampling};
use crate::affine::SiteSceneError;
use crate::checkpoint::{self, CheckpointError};
use crate::io::{Chart, RasterError, WriteError, write_atomically};
use crate::nn::adam::{Adam, AdamRule};
use crate::progress::{Event, Interrupted, NoProgress, Progress};
use crate::random::CounterRng;
use crate::rpc::formats::FormatError;
use crate::scene::SceneError;
use crate::simulate::{Relief, SimulateError, SimulateOptions};
use crate::splat::backend::stopwatch::Stopwatch;
use crate::splat::loss::LossWeights;
use crate::splat::objective::Gradient;
use sample::{Sample, objective, predicted, samples, squared_error};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use town::Town;

/// Purpose of the random numbers.
const DRAW_STEP: u64 = 54;
/// Kind of the checkpoint's file.
const CHECKPOINT: &str = "satgs learn 1";
/// Of one cycle: the part of the steps with a rising rate, and the first and last rate relative to the largest (PyTorch).
const RISING: f64 = 0.3;
const FIRST_RATE: f64 = 1.0 / 25.0;
const LAST_RATE: f64 = 1.0 / 25e4;
/// Weight of the pull to the exact surface.
const SURFACE_WEIGHT: f64 = 0.05;
/// Number of tiles of a validation town.
const VALIDATION_TILES: usize = 3;
/// Seeds of towns for validation begin here: none of them is learned from.
const VALIDATION_SEED: u64 = 1 << 32;
/// Number of the clouds for validation.
const VALIDATION_CLOUD: u64 = 1 << 40;

/// How a model is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LearnConfig {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Number of towns to learn from.
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
    /// Columns and rows of the images, and their number.
    pub size_px: usize,
    /// Number of images of a town to predict from.
    pub views: usize,
    /// Ground sampling distances of the images, metres, which towns take in turn.
    pub gsd_m: Vec<f64>,
    /// Number of towns for validation, after every so many rounds.
    pub validation_towns: usize,
    /// Number of rounds between validations.
    pub validate_every: usize,
    /// Shape of the network.
    pub network: Network,
    /// Spacings of points.
    pub sampling: Sampling,
}

impl Default for LearnConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            towns: 64,
            rounds: 256,
            tiles: 6,
            steps: 48,
            kept_rounds: 16,
            rate: 3e-3,
            size_px: 320,
            views: 8,
            gsd_m: vec![0.5, 0.35],
            validation_towns: 3,
            validate_every: 16,
            network: Network::default(),
            sampling: Sampling::default(),
        }
    }
}

/// Number of images of a town that renders are compared with.
const TARGETS: usize = 4;

/// Why no model can be trained.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
#[allow(missing_docs)]
pub enum LearnError {
    /// A number of the configuration is out of range.
    #[error("`{field}` is {found}, expected {expected}")]
    Config {
        /// The field.
        field: &'static str,
        /// Its value.
        found: String,
        /// What is possible.
        expected: &'static str,
    },
    /// The file of the configuration cannot be read or has other fields.
    #[error("`{path}` is not a configuration: {reason}")]
    #[diagnostic(help("`satgs learn --print-config` prints one"))]
    ConfigFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The loss is not a finite number.
    #[error("the loss of round {round} is not finite")]
    #[diagnostic(help("a smaller `rate` may help"))]
    NotFinite {
        /// The round.
        round: usize,
    },
    /// There is a training with another configuration.
    #[error("`{path}` belongs to a training with another configuration")]
    #[diagnostic(help("remove the folder, or choose another name for the model"))]
    OtherTraining {
        /// The checkpoint.
        path: PathBuf,
    },
    #[error(transparent)]
    #[diagnostic(transparent)]
    Simulate(#[from] SimulateError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Site(#[from] SiteSceneError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Rpc(#[from] FormatError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Predict(#[from] PredictError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Interrupted(#[from] Interrupted),
}

/// A line of the log: a round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnLine {
    /// Number of the round, from 1.
    pub round: usize,
    /// Learning rate of its last step.
    pub rate: f64,
    /// Mean loss of its steps.
    pub loss: f64,
    /// Scores of the unseen towns, if they were taken.
    pub validation: Option<Validation>,
}

/// Peak signal-to-noise ratios of unseen towns in dB: of the prediction, of isotropic and of flat splats of the same points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// All points.
    pub dense: [f64; 3],
    /// A twentieth of the points.
    pub sparse: [f64; 3],
}

/// Parts of the points of the two clouds of a validation town.
const VALIDATION_SHARES: [f64; 2] = [1.0, 0.05];

/// What an interrupted training goes on from.
#[derive(Serialize, Deserialize)]
struct State {
    config: LearnConfig,
    rounds: usize,
    parameters: Vec<f32>,
    adam: Adam,
    log: Vec<LearnLine>,
}

impl LearnConfig {
    /// Reads a TOML file.
    ///
    /// # Errors
    /// [`LearnError::ConfigFile`] if it cannot be read or has other fields.
    pub fn read(path: &Path) -> Result<Self, LearnError> {
        let failed = |reason: String| LearnError::ConfigFile { path: path.into(), reason };
        let text = std::fs::read_to_string(path).map_err(|e| failed(e.to_string()))?;
        toml::from_str(&text).map_err(|e| failed(e.to_string().trim_end().to_owned()))
    }

    /// The configuration as TOML.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// Checks that every number is in its range.
    fn check(&self) -> Result<(), LearnError> {
        let counts = [
            ("towns", self.towns),
            ("rounds", self.rounds),
            ("tiles", self.tiles),
            ("steps", self.steps),
            ("kept_rounds", self.kept_rounds),
            ("validate_every", self.validate_every),
        ];
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
        if self.gsd_m.is_empty() {
            let found = "an empty list".into();
            return Err(LearnError::Config { field: "gsd_m", found, expected: "metres" });
        }
        if !self.network.is_sound() {
            let found = format!("{:?}", self.network);
            return Err(LearnError::Config {
                field: "network",
                found,
                expected: "a width of 4 to 512, divisible by 4",
            });
        }
        Ok(())
    }

    /// The simulation of the town with this seed.
    fn town(&self, seed: u64) -> SimulateOptions {
        let relief = if seed % 4 == 3 { Relief::Hilly } else { Relief::Rolling };
        SimulateOptions {
            seed,
            views: self.views,
            size_px: self.size_px,
            gsd_m: self.gsd_m[seed as usize % self.gsd_m.len()],
            relief,
            seasons: false,
            cars_percent: None,
            held_out: TARGETS,
            overwrite: true,
        }
    }

    /// Learning rate of a step.
    fn rate_of(&self, step: usize) -> f64 {
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
    fn origin(&self) -> String {
        let config = serde_json::to_string(self).unwrap_or_default();
        format!("satgs {} learn, configuration {config}", env!("CARGO_PKG_VERSION"))
    }
}

/// Trains a model and writes it to `out`. `folder` keeps the towns, a checkpoint, the log `learn.csv` and its curves; a training
/// that is there goes on.
///
/// # Errors
/// [`LearnError`]; after [`LearnError::Interrupted`] the same call goes on.
pub fn learn(
    out: &Path,
    folder: &Path,
    config: &LearnConfig,
    progress: &dyn Progress,
) -> Result<Vec<LearnLine>, LearnError> {
    config.check()?;
    let path = folder.join("checkpoint.bin");
    let mut state = if path.exists() { read_state(&path, config)? } else { State::new(config) };
    progress.event(Event::Started {
        stage: "simulating towns for validation",
        total: config.validation_towns as u64,
    });
    let validation = validation_samples(config, folder, progress)?;
    progress.event(Event::Finished);
    progress.event(Event::Started { stage: "training the network", total: config.rounds as u64 });
    progress.event(Event::Resumable(true));
    let mut kept: VecDeque<Vec<Sample>> = VecDeque::new();
    let first = state.rounds.saturating_sub(config.kept_rounds - 1);
    for round in first..config.rounds {
        progress.check()?;
        kept.push_back(round_samples(config, folder, round)?);
        if kept.len() > config.kept_rounds {
            kept.pop_front();
        }
        // After an interruption only the samples of earlier rounds are made anew.
        if round < state.rounds {
            continue;
        }
        let samples: Vec<&Sample> = kept.iter().flatten().collect();
        let (rate, loss) = state.round(round, &samples)?;
        let is_last = round + 1 == config.rounds;
        let is_validated = is_last || (round + 1).is_multiple_of(config.validate_every);
        let model = state.model();
        let scores = (is_validated && !validation[0].is_empty()).then(|| validate(&model, &validation));
        state.log.push(LearnLine { round: round + 1, rate, loss, validation: scores });
        state.rounds = round + 1;
        checkpoint::write(&path, CHECKPOINT, &state)?;
        let status = match scores {
            Some(Validation { dense, sparse }) => {
                format!("loss {loss:.4}; unseen towns {:.2} dB, few points {:.2} dB", dense[0], sparse[0])
            }
            None => format!("loss {loss:.4}"),
        };
        progress.event(Event::Advanced { done: round as u64 + 1, status });
    }
    progress.event(Event::Finished);
    write_log(&folder.join("learn.csv"), &state.log)?;
    curves(&state.log).write(&folder.join("curves.svg"))?;
    state.model().write(out)?;
    Ok(state.log)
}

fn read_state(path: &Path, config: &LearnConfig) -> Result<State, LearnError> {
    let state: State = checkpoint::read(path, CHECKPOINT)?;
    let fits =
        state.parameters.len() == config.network.parameters() && state.adam.fits(state.parameters.len());
    if state.config == *config && fits {
        Ok(state)
    } else {
        Err(LearnError::OtherTraining { path: path.into() })
    }
}

/// The samples of a round.
fn round_samples(config: &LearnConfig, folder: &Path, round: usize) -> Result<Vec<Sample>, LearnError> {
    let seed = config.seed.wrapping_mul(1 << 16) + (round % config.towns) as u64;
    let town = Town::load(&folder.join(format!("towns/{seed}")), &config.town(seed), &NoProgress)?;
    let share = points::draw_share(config.seed, round as u64);
    Ok(samples(&Arc::new(town), &config.sampling, config.seed, round as u64, share, config.tiles)?)
}

/// The samples of unseen towns, for each of [`VALIDATION_SHARES`].
fn validation_samples(
    config: &LearnConfig,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<[Vec<Sample>; 2], LearnError> {
    let mut out = [Vec::new(), Vec::new()];
    for k in 0..config.validation_towns as u64 {
        progress.check()?;
        let seed = VALIDATION_SEED + k;
        let town = Town::load(&folder.join(format!("towns/{seed}")), &config.town(seed), &NoProgress)?;
        let town = Arc::new(town);
        for (own, share) in out.iter_mut().zip(VALIDATION_SHARES) {
            let cloud = VALIDATION_CLOUD + k;
            own.extend(samples(&town, &config.sampling, config.seed, cloud, share, VALIDATION_TILES)?);
        }
        progress.event(Event::Advanced { done: k + 1, status: String::new() });
    }
    Ok(out)
}

/// Scores of a model.
fn validate(model: &Model, validation: &[Vec<Sample>; 2]) -> Validation {
    let [dense, sparse] = validation.each_ref().map(|samples| {
        let mut sums = [0.0; 3];
        for sample in samples {
            let splats = [&predicted(model, sample), &sample.references[0], &sample.references[1]];
            for (sum, splats) in sums.iter_mut().zip(splats) {
                *sum -= 10.0 * squared_error(sample, splats).log10() / samples.len() as f64;
            }
        }
        sums
    });
    Validation { dense, sparse }
}

impl State {
    fn new(config: &LearnConfig) -> Self {
        let parameters = config.network.start(config.seed);
        Self { config: config.clone(), rounds: 0, parameters, adam: Adam::default(), log: Vec::new() }
    }

    fn model(&self) -> Model {
        let LearnConfig { network, sampling, .. } = self.config.clone();
        let content = ModelContent { network, sampling, origin: self.config.origin() };
        Model { content, parameters: self.parameters.clone() }
    }

    /// Makes the steps of a round; the last learning rate and the mean loss.
    fn round(&mut self, round: usize, samples: &[&Sample]) -> Result<(f64, f64), LearnError> {
        let weights = LossWeights::of(&[("surface_prior", SURFACE_WEIGHT)]).unwrap_or_default();
        let mut evaluation = Evaluation::new(&self.config.network);
        let mut gradient = Gradient::default();
        let mut by_parameters = vec![0.0; self.parameters.len()];
        let (mut rate, mut sum) = (0.0, 0.0);
        for k in 0..self.config.steps {
            let step = round * self.config.steps + k;
            let mut draw = CounterRng::new(self.config.seed, DRAW_STEP, step as u64, 0);
            let sample = samples[draw.below(samples.len())];
            let target = &sample.targets[draw.below(sample.targets.len())];
            let background = std::array::from_fn(|_| draw.uniform() as f32);
            let input = &sample.input.network;
            let outputs = evaluation.forward(&self.parameters, input);
            let splats = sample.head.splats(outputs, &sample.input.bases);
            let loss = objective(&sample.town).evaluate(
                &splats,
                target.parameters(),
                &target.step_input(background, sample.town.altitudes.0 as f32),
                &weights,
                &mut gradient,
                &mut Stopwatch::default(),
            );
            if !loss.total.is_finite() {
                return Err(LearnError::NotFinite { round: round + 1 });
            }
            let by_outputs = sample.head.backward(outputs, &gradient.splats);
            by_parameters.fill(0.0);
            evaluation.backward(&self.parameters, input, &by_outputs, &mut by_parameters);
            rate = self.config.rate_of(step);
            let rule = AdamRule { beta2: 0.99, ..AdamRule::DEFAULT };
            self.adam.step(rule, &mut self.parameters, &by_parameters, rate);
            sum += loss.total;
        }
        Ok((rate, sum / self.config.steps as f64))
    }
}

/// Writes a line for each round.
fn write_log(path: &Path, log: &[LearnLine]) -> Result<(), WriteError> {
    let failed = |reason: String| WriteError::new(path, reason);
    write_atomically(path, |t| {
        let mut writer = csv::Writer::from_path(t).map_err(|e| failed(e.to_string()))?;
        let header = "round,rate,loss,psnr_db,psnr_isotropic_db,psnr_flat_db,few_psnr_db,few_psnr_isotropic_db,few_psnr_flat_db";
        writer.write_record(header.split(',')).map_err(|e| failed(e.to_string()))?;
        for line in log {
            let mut record =
                vec![line.round.to_string(), format!("{:.3e}", line.rate), format!("{:.5}", line.loss)];
            let scores =
                line.validation.map(|v| v.dense.into_iter().chain(v.sparse).map(|db| format!("{db:.3}")));
            match scores {
                Some(scores) => record.extend(scores),
                None => record.resize(record.len() + 6, String::new()),
            }
            writer.write_record(record).map_err(|e| failed(e.to_string()))?;
        }
        writer.flush().map_err(|e| failed(e.to_string()))
    })
}

/// Curves of the scores of unseen towns.
fn curves(log: &[LearnLine]) -> Chart {
    let line = |name: &str, of: fn(&Validation) -> f64| {
        let points = log.iter().filter_map(|l| Some((l.round as f64, of(&l.validation?))));
        (name.to_owned(), points.collect())
    };
    Chart {
        title: "Unseen towns".into(),
        x: "round".into(),
        y: "PSNR, dB".into(),
        lines: vec![
            line("network", |v| v.dense[0]),
            line("flat splats", |v| v.dense[2]),
            line("network, 5 % of the points", |v| v.sparse[0]),
            line("flat splats, 5 % of the points", |v| v.sparse[2]),
        ],
    }
}
