//! Training of the network, on simulated towns and then on photographed scenes with depth maps.
//!
//! A round takes a town, draws a cloud of its surface with the errors of stereo matching, and prepares samples from it: tiles with
//! the numbers that the network takes, and the images to compare renders with. The samples of the last rounds are kept, and a
//! number of steps is made with samples drawn from these. The learning rate follows one cycle (Smith & Topin 2019): the
//! rate rises for three tenths of the steps and falls to nearly zero. The loss is that of 3DGS for pixels in sunlight, and a pull
//! to the exact surface where it is smooth. The second phase does the same with points lifted from depth maps, and continues
//! from a trained model.
//!
//! Everything follows from the configuration: an interrupted training continues from its last round and gives the same model.

mod config;
mod data;
mod error;
mod photographed_data;
mod points;
mod surface;
mod town;
mod town_data;

pub use config::LearnConfig;
pub use error::LearnError;
pub use photographed_data::PhotographedScenes;

use super::image_features::FEATURES;
use super::model::ModelContent;
use super::network::{NetworkEvaluation, SplatNetwork};
use super::{ImageNetwork, Model};
use crate::checkpoint;
use crate::io::{Chart, WriteError, write_atomically, write_file};
use crate::nn::adam::{Adam, AdamRule};
use crate::progress::{Event, Progress};
use crate::random::CounterRng;
use data::{Sample, TrainingData};
use photographed_data::PhotographedData;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::path::Path;
use town_data::Towns;

/// Purpose of the random numbers.
const DRAW_STEP: u64 = 54;
/// Kind of the checkpoint's file.
const CHECKPOINT: &str = "satgs learn 4";
/// Parts of the points of the clouds by which a trained model is scored.
const SHARES: [f64; 5] = [1.0, 0.3, 0.1, 0.03, 0.01];
/// Parts of the points of the two clouds of a validation.
const VALIDATION_SHARES: [f64; 2] = [1.0, 0.05];

/// A line of the log: a round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnLine {
    /// Number of the round, from 1.
    pub round: usize,
    /// Learning rate of its last step.
    pub rate: f64,
    /// Mean loss of its steps.
    pub loss: f64,
    /// Scores of what is not learned from, if they were taken.
    pub validation: Option<Validation>,
}

/// Peak signal-to-noise ratios of what is not learned from, in dB: of the prediction, of isotropic and of flat splats of the same points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// All points.
    pub dense: [f64; 3],
    /// A twentieth of the points.
    pub sparse: [f64; 3],
}

/// What an interrupted training continues from.
#[derive(Serialize, Deserialize)]
struct State {
    content: ModelContent,
    /// What tells the data and the parameters at the start from others.
    made_from: String,
    rounds: usize,
    parameters: Vec<f32>,
    adam: Adam,
    log: Vec<LearnLine>,
}

/// Trains a model on simulated towns, with the image features of a network if there is one, and writes it to `out`. `folder` keeps
/// the towns, a checkpoint, the log `learn.csv`, scores of unseen towns by the part of the points (`points.csv`), and their curves; a
/// training in it continues.
///
/// # Errors
/// [`LearnError`]; after [`LearnError::Interrupted`] the same call continues.
pub fn learn(
    out: &Path,
    folder: &Path,
    config: &LearnConfig,
    image_network: Option<&ImageNetwork>,
    progress: &dyn Progress,
) -> Result<Vec<LearnLine>, LearnError> {
    let image_features = image_network.map_or(FEATURES, |n| n.id().features);
    let network = SplatNetwork { image_features, ..config.network.clone() };
    let config = &LearnConfig { network: network.clone(), ..config.clone() };
    config.check()?;
    let parameters = config.network.start(config.seed);
    let content = ModelContent {
        network,
        sampling: config.sampling,
        origin: config.origin(),
        image_network: image_network.map(|n| n.id().hash.clone()),
    };
    train(
        out,
        folder,
        Model { content, parameters },
        &Towns::new(config, folder, image_network),
        config,
        progress,
    )
}

/// Trains a model further on photographed scenes with depth maps, as [`learn`] does on towns. The network and the spacings are those
/// of the model, which must have been trained with the image features of the scenes.
///
/// # Errors
/// As [`learn`].
pub fn learn_from_photographs(
    out: &Path,
    folder: &Path,
    model: Model,
    scenes: &PhotographedScenes,
    config: &LearnConfig,
    progress: &dyn Progress,
) -> Result<Vec<LearnLine>, LearnError> {
    model.content.require(scenes.image_network())?;
    let ModelContent { network, sampling, origin, .. } = &model.content;
    let config = &LearnConfig { network: network.clone(), sampling: *sampling, ..config.clone() };
    config.check()?;
    let origin = format!("{}, photographs of {}, after: {origin}", config.origin(), scenes.describe());
    let model = Model { content: ModelContent { origin, ..model.content }, ..model };
    train(out, folder, model, &PhotographedData { config, scenes }, config, progress)
}

fn train(
    out: &Path,
    folder: &Path,
    model: Model,
    data: &dyn TrainingData,
    config: &LearnConfig,
    progress: &dyn Progress,
) -> Result<Vec<LearnLine>, LearnError> {
    let path = folder.join("checkpoint.bin");
    let start = State::new(model, data);
    let mut state = if path.exists() { read_state(&path, &start)? } else { start };
    let validation = data.validation(&VALIDATION_SHARES, progress)?;
    let is_scored = validation.iter().all(|samples| !samples.is_empty());
    progress.event(Event::Started { stage: "training the network", total: config.rounds as u64 });
    progress.event(Event::Resumable(true));
    let mut kept: VecDeque<Vec<Sample>> = VecDeque::new();
    // A complete training needs no samples.
    let is_complete = state.rounds == config.rounds;
    let first = if is_complete { config.rounds } else { state.rounds.saturating_sub(config.kept_rounds - 1) };
    for round in first..config.rounds {
        progress.check()?;
        kept.push_back(data.samples(round)?);
        if kept.len() > config.kept_rounds {
            kept.pop_front();
        }
        // After an interruption only the samples of earlier rounds are made again.
        if round < state.rounds {
            continue;
        }
        let samples: Vec<&Sample> = kept.iter().flatten().collect();
        if samples.is_empty() {
            return Err(LearnError::NoSamples { round: round + 1 });
        }
        let (rate, loss) = state.round(round, &samples, config)?;
        let is_last = round + 1 == config.rounds;
        let is_validated = is_last || (round + 1).is_multiple_of(config.validate_every);
        let model = state.model();
        let scores = (is_validated && is_scored).then(|| validate(&model, &validation));
        state.log.push(LearnLine { round: round + 1, rate, loss, validation: scores });
        state.rounds = round + 1;
        checkpoint::write(&path, CHECKPOINT, &state)?;
        let status = match scores {
            Some(Validation { dense, sparse }) => {
                let held_back = data.held_back();
                format!("loss {loss:.4}; {held_back} {:.2} dB, few points {:.2} dB", dense[0], sparse[0])
            }
            None => format!("loss {loss:.4}"),
        };
        progress.event(Event::Advanced { done: round as u64 + 1, status });
    }
    progress.event(Event::Resumable(false));
    progress.event(Event::Finished);
    write_log(&folder.join("learn.csv"), &state.log)?;
    curves(&state.log, data.held_back()).write(&folder.join("curves.svg"))?;
    let by_share = scores_by_share(&state.model(), data, progress)?;
    write_scores_by_share(&folder.join("points.csv"), &by_share)?;
    curves_by_share(&by_share, data.held_back()).write(&folder.join("points.svg"))?;
    state.model().write(out)?;
    Ok(state.log)
}

fn read_state(path: &Path, start: &State) -> Result<State, LearnError> {
    let state: State = checkpoint::read(path, CHECKPOINT)?;
    let count = start.parameters.len();
    let fits = state.parameters.len() == count && state.adam.fits(count);
    if state.content == start.content && state.made_from == start.made_from && fits {
        Ok(state)
    } else {
        Err(LearnError::OtherTraining { path: path.into() })
    }
}

/// Scores of a model.
fn validate(model: &Model, validation: &[Vec<Sample>]) -> Validation {
    let [dense, sparse] = [0, 1].map(|k| mean_psnr_db(model, &validation[k]));
    Validation { dense, sparse }
}

/// Mean peak signal-to-noise ratios of some samples in dB: of the prediction, of isotropic and of flat splats of the same points.
fn mean_psnr_db(model: &Model, samples: &[Sample]) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for sample in samples {
        let splats = [&sample.predicted(model), &sample.references[0], &sample.references[1]];
        for (sum, splats) in sums.iter_mut().zip(splats) {
            *sum -= 10.0 * sample.squared_error(splats).log10() / samples.len() as f64;
        }
    }
    sums
}

/// The scores for each of [`SHARES`].
fn scores_by_share(
    model: &Model,
    data: &dyn TrainingData,
    progress: &dyn Progress,
) -> Result<Vec<(f64, [f64; 3])>, LearnError> {
    let samples = data.validation(&SHARES, progress)?;
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
fn curves_by_share(scores: &[(f64, [f64; 3])], held_back: &str) -> Chart {
    let line = |name: &str, k: usize| {
        (name.to_owned(), scores.iter().map(|(share, psnr)| (share.log10(), psnr[k])).collect())
    };
    Chart {
        title: format!("Scores of {held_back}, fewer points"),
        x: "decimal logarithm of the part of the points".into(),
        y: "PSNR, dB".into(),
        lines: vec![line("network", 0), line("isotropic splats", 1), line("flat splats", 2)],
    }
}

impl State {
    fn new(model: Model, data: &dyn TrainingData) -> Self {
        let Model { content, parameters } = model;
        let mut hasher = blake3::Hasher::new();
        for value in &parameters {
            hasher.update(&value.to_le_bytes());
        }
        hasher.update(data.identity().as_bytes());
        let made_from = hasher.finalize().to_hex().to_string();
        Self { content, made_from, rounds: 0, parameters, adam: Adam::default(), log: Vec::new() }
    }

    fn model(&self) -> Model {
        Model { content: self.content.clone(), parameters: self.parameters.clone() }
    }

    /// Makes the steps of a round; the last learning rate and the mean loss.
    fn round(
        &mut self,
        round: usize,
        samples: &[&Sample],
        config: &LearnConfig,
    ) -> Result<(f64, f64), LearnError> {
        let mut evaluation = NetworkEvaluation::new(&config.network);
        let mut by_parameters = vec![0.0; self.parameters.len()];
        let (mut rate, mut sum) = (0.0, 0.0);
        for k in 0..config.steps {
            let step = round * config.steps + k;
            let mut draw = CounterRng::new(config.seed, DRAW_STEP, step as u64, 0);
            let sample = samples[draw.below(samples.len())];
            let target = &sample.targets[draw.below(sample.targets.len())];
            let background = std::array::from_fn(|_| draw.uniform() as f32);
            let input = &sample.input.network;
            let outputs = evaluation.forward(&self.parameters, input);
            let splats = sample.head.splats(outputs, &sample.input.bases);
            let (loss, by_splats) = target.evaluate(&splats, background)?;
            if !loss.is_finite() {
                return Err(LearnError::NotFinite { round: round + 1 });
            }
            let by_outputs = sample.head.backward(outputs, &by_splats);
            by_parameters.fill(0.0);
            evaluation.backward(&self.parameters, input, &by_outputs, &mut by_parameters);
            rate = config.rate_of(step);
            let rule = AdamRule { beta2: 0.99, ..AdamRule::DEFAULT };
            self.adam.step(rule, &mut self.parameters, &by_parameters, rate);
            sum += loss;
        }
        Ok((rate, sum / config.steps as f64))
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

/// Curves of the scores.
fn curves(log: &[LearnLine], held_back: &str) -> Chart {
    let line = |name: &str, of: fn(&Validation) -> f64| {
        let points = log.iter().filter_map(|l| Some((l.round as f64, of(&l.validation?))));
        (name.to_owned(), points.collect())
    };
    Chart {
        title: format!("Scores of {held_back}"),
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
        let towns = Towns::new(&config, folder.path(), None);
        let samples = towns.tiles(&towns.load(5).unwrap(), 0, 1.0, 1).unwrap();
        assert_eq!(samples.len(), 1);
        let content = ModelContent::default();
        let mut state = State::new(Model::untrained(content, config.seed), &towns);
        let untrained = mean_psnr_db(&state.model(), &samples)[0];
        let losses: Vec<f64> =
            (0..config.rounds).map(|round| state.round(round, &[&samples[0]], &config).unwrap().1).collect();
        let [learned, isotropic, flat] = mean_psnr_db(&state.model(), &samples);
        assert!(losses[7] < 0.8 * losses[0], "{losses:?}");
        assert!(
            learned > flat.max(isotropic) + 4.0 && learned > untrained + 2.5,
            "{untrained:.2} dB untrained, {learned:.2} learned, {isotropic:.2} isotropic, {flat:.2} flat"
        );
    }
}
