//! The results of the stages of a run, as they become complete.

use crate::metrics::Evaluation;
use crate::pipeline::{Adjusted, DsmSummary, NvsScores, Outcome, Trained};
use crate::tiles::{Mosaicked, Plan};
use std::path::PathBuf;

/// The result of one stage.
#[derive(Debug)]
pub enum StageResult {
    /// The adjustment is complete.
    Adjusted(Adjusted),
    /// The training is complete.
    Trained(Outcome<Trained>),
    /// Views that were held back are scored.
    Scored(NvsScores),
    /// The surface model is rendered.
    Dsm(Outcome<DsmSummary>),
    /// The tiles of a large area are planned.
    Planned(Outcome<Plan>),
    /// The tiles are blended into one surface.
    Mosaicked(Outcome<Mosaicked>),
    /// The surface model is scored.
    Evaluated(Box<Evaluation>),
    /// The report is written to this file.
    Reported(PathBuf),
}
