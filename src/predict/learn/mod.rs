//! Training of the network on simulated towns.
//!
//! A round takes a town, draws a cloud of its surface with the errors of stereo matching, and prepares samples from it: tiles with
//! the numbers that the network takes, and the images to compare renders with. The samples of the last rounds are kept, and a
//! number of steps is made with samples drawn from these. The learning rate follows one cycle (Smith & Topin 2019): the
//! rate rises for three tenths of the steps and falls to nearly zero. The loss is that of 3DGS for pixels in sunlight, and a pull
//! to the exact surface where it is smooth.
//!
//! Everything follows from the configuration: an interrupted training goes on from its last round and gives the same model.

mod config;
mod error;
mod points;
mod sample;
mod surface;
mod town;

pub use config::LearnConfig;
pub use error::LearnError;

use super::Model;
use super::model::ModelContent;
use super::network::NetworkEvaluation;
use crate::checkpoint;
use crate::io::{Chart, WriteError, write_atomically, write_file};
use crate::nn::adam::{Adam, AdamRule};
use crate::progress::{Event, NoProgress, Progress};
use crate::random::CounterRng;
use crate::simulate::{Relief, SimulateOptions};
use crate::splat::backend::stopwatch::Stopwatch;
use crate::splat::loss::LossWeights;
use crate::splat::objective::Gradient;
use sample::{Sample, objective, predicted, samples, squared_error};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use town::Town;

/// Purpose of the random numbers.
const DRAW_STEP: u64 = 54;
/// Kind of the checkpoint's file.
const CHECKPOINT: &str = "satgs learn 2";
/// Weight of the pull to the exact surface.
const SURFACE_WEIGHT: f64 = 0.2;
/// Number of tiles of a validation town.
const VALIDATION_TILES: usize = 3;
/// Seeds of towns for validation begin here: none of them is learned from.
const VALIDATION_SEED: u64 = 1 << 60;
/// Parts of the points of the clouds by which a trained model is scored.
const SHARES: [f64; 5] = [1.0, 0.3, 0.1, 0.03, 0.01];
/// Parts of the points of the two clouds of a validation town.
const VALIDATION_SHARES: [f64; 2] = [1.0, 0.05];
/// Number of the clouds for validation.
const VALIDATION_CLOUD: u64 = 1 << 40;

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

/// What an interrupted training goes on from.
#[derive(Serialize, Deserialize)]
struct State {
    config: LearnConfig,
    rounds: usize,
    parameters: Vec<f32>,
    adam: Adam,
    log: Vec<LearnLine>,
}

/// Trains a model and writes it to `out`. `folder` keeps the towns, a checkpoint, the log `learn.csv`, scores of unseen towns by the
/// part of the points (`points.csv`), and their curves; a training that is there goes on.
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
    let validation = validation_samples(config, folder, VALIDATION_SHARES, progress)?;
    progress.event(Event::Started { stage: "training the network", total: config.rounds as u64 });
    progress.event(Event::Resumable(true));
    let mut kept: VecDeque<Vec<Sample>> = VecDeque::new();
    // A complete training needs no samples.
    let is_complete = state.rounds == config.rounds;
    let first = if is_complete { config.rounds } else { state.rounds.saturating_sub(config.kept_rounds - 1) };
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
        if samples.is_empty() {
            return Err(LearnError::NoSamples { round: round + 1 });
        }
        let (rate, loss) = state.round(round, &samples)?;
        let is_last = round + 1 == config.rounds;
        let is_validated = is_last || (round + 1).is_multiple_of(config.validate_every);
        let model = state.model();
        let scores = (is_validated && validation.iter().all(|samples| !samples.is_empty()))
            .then(|| validate(&model, &validation));
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
    progress.event(Event::Resumable(false));
    progress.event(Event::Finished);
    write_log(&folder.join("learn.csv"), &state.log)?;
    curves(&state.log).write(&folder.join("curves.svg"))?;
    let by_share = scores_by_share(&state.model(), config, folder, progress)?;
    write_scores_by_share(&folder.join("points.csv"), &by_share)?;
    curves_by_share(&by_share).write(&folder.join("points.svg"))?;
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

/// A town of the folder, which is simulated if it is not there. The name has the options, so that towns of others are not taken.
fn load_town(config: &LearnConfig, folder: &Path, seed: u64) -> Result<Arc<Town>, LearnError> {
    let options = config.town(seed);
    let SimulateOptions { views, size_px, gsd_m, relief, .. } = options;
    let relief = if relief == Relief::Hilly { "hilly" } else { "rolling" };
    let folder = folder.join(format!("towns/{seed}-{views}x{size_px}px-{gsd_m}m-{relief}"));
    Ok(Arc::new(Town::load(&folder, &options, config.transfer_function(seed)?, &NoProgress)?))
}

/// The samples of a round.
fn round_samples(config: &LearnConfig, folder: &Path, round: usize) -> Result<Vec<Sample>, LearnError> {
    let seed = config.seed.wrapping_mul(1 << 16) + (round % config.towns) as u64;
    let town = load_town(config, folder, seed)?;
    let share = points::draw_share(config.seed, round as u64);
    Ok(samples(&town, &config.sampling, config.seed, round as u64, share, config.tiles)?)
}

/// The samples of unseen towns, for each part of the points.
fn validation_samples<const N: usize>(
    config: &LearnConfig,
    folder: &Path,
    shares: [f64; N],
    progress: &dyn Progress,
) -> Result<[Vec<Sample>; N], LearnError> {
    let mut out = std::array::from_fn(|_| Vec::new());
    let total = config.validation_towns as u64;
    progress.event(Event::Started { stage: "preparing towns for validation", total });
    for k in 0..config.validation_towns as u64 {
        progress.check()?;
        let town = load_town(config, folder, VALIDATION_SEED + k)?;
        for (own, share) in out.iter_mut().zip(shares) {
            let cloud = VALIDATION_CLOUD + k;
            own.extend(samples(&town, &config.sampling, config.seed, cloud, share, VALIDATION_TILES)?);
        }
        progress.event(Event::Advanced { done: k + 1, status: String::new() });
    }
    progress.event(Event::Finished);
    Ok(out)
}

/// Scores of a model.
fn validate(model: &Model, validation: &[Vec<Sample>; 2]) -> Validation {
    let [dense, sparse] = validation.each_ref().map(|samples| mean_psnr_db(model, samples));
    Validation { dense, sparse }
}

/// Mean peak signal-to-noise ratios of some samples in dB: of the prediction, of isotropic and of flat splats of the same points.
fn mean_psnr_db(model: &Model, samples: &[Sample]) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for sample in samples {
        let splats = [&predicted(model, sample), &sample.references[0], &sample.references[1]];
        for (sum, splats) in sums.iter_mut().zip(splats) {
            *sum -= 10.0 * squared_error(sample, splats).log10() / samples.len() as f64;
        }
    }
    sums
}

/// The scores of unseen towns for each of [`SHARES`].
fn scores_by_share(
    model: &Model,
    config: &LearnConfig,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Vec<(f64, [f64; 3])>, LearnError> {
    let samples = validation_samples(config, folder, SHARES, progress)?;
    let scored = SHARES.iter().zip(&samples).filter(|(_, samples)| !samples.is_empty());
    Ok(scored.map(|(share, samples)| (*share, mean_psnr_db(model, samples))).collect())
}

fn write_scores_by_share(path: &Path, scores: &[(f64, [f64; 3])]) -> Result<(), WriteError> {
    let row = |(share, [network, isotropic, flat]): &(f64, [f64; 3])| {
        format!("{share},{network:.3},{isotropic:.3},{flat:.3}\n")
    };
    let header = "share_of_points,psnr_db,psnr_isotropic_db,psnr_flat_db\n";
    write_file(path, header.to_owned() + &scores.iter().map(row).collect::<String>())
}

/// Curves of the scores over the logarithm of the part of the points.
fn curves_by_share(scores: &[(f64, [f64; 3])]) -> Chart {
    let line = |name: &str, k: usize| {
        (name.to_owned(), scores.iter().map(|(share, psnr)| (share.log10(), psnr[k])).collect())
    };
    Chart {
        title: "Unseen towns, fewer points".into(),
        x: "decimal logarithm of the part of the points".into(),
        y: "PSNR, dB".into(),
        lines: vec![line("network", 0), line("isotropic splats", 1), line("flat splats", 2)],
    }
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
        let weights = LossWeights::default().with(&[("surface_prior", SURFACE_WEIGHT)])?;
        let mut evaluation = NetworkEvaluation::new(&self.config.network);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Colours that know no sun cannot show the targets exactly: the aim is the gain over splats without a network.
    #[test]
    fn a_single_tile_is_learned_far_better_than_splats_without_a_network_show_it() {
        let config = LearnConfig { rounds: 8, steps: 48, size_px: 160, views: 6, ..LearnConfig::default() };
        let folder = tempfile::tempdir().unwrap();
        let town = load_town(&config, folder.path(), 5).unwrap();
        let samples = samples(&town, &config.sampling, 1, 0, 1.0, 1).unwrap();
        assert_eq!(samples.len(), 1);
        let mut state = State::new(&config);
        let untrained = mean_psnr_db(&state.model(), &samples)[0];
        let losses: Vec<f64> =
            (0..config.rounds).map(|round| state.round(round, &[&samples[0]]).unwrap().1).collect();
        let [learned, isotropic, flat] = mean_psnr_db(&state.model(), &samples);
        assert!(losses[7] < 0.8 * losses[0], "{losses:?}");
        assert!(
            learned > flat.max(isotropic) + 4.0 && learned > untrained + 2.5,
            "{untrained:.2} dB untrained, {learned:.2} learned, {isotropic:.2} isotropic, {flat:.2} flat"
        );
    }
}
