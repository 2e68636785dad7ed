//! `satgs mosaic`: blended tiles to one surface model and one orthophoto.

use super::{CliError, Ui};
use crate::pipeline::Outcome;
use crate::run_files::{DSM, FAILED, ORTHO};
use crate::tiles::{Mosaicked, mosaic};
use std::path::{Path, PathBuf};

/// Join the blended tiles of a plan: writes RUN/dsm.tif, ortho.tif, confidence.tif, seams.gpkg and report.html
///
/// All tiles must be blended, or have failed: then there is no data there, and failed.gpkg has their outlines and reasons.
/// seams.gpkg has the differences of heights and colours along every seam.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Run folder of `satgs plan`
    run: PathBuf,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    show(&args.run, &mosaic(&args.run, ui)?, ui)
}

/// Shows the summary of a mosaic.
pub fn show(run: &Path, outcome: &Outcome<Mosaicked>, ui: &Ui) -> Result<(), CliError> {
    let text =
        |m: &Mosaicked| format!("{}\n{}\n{}", m.text(), run.join(DSM).display(), run.join(ORTHO).display());
    ui.outcome("mosaic", outcome, text)?;
    match outcome.summary() {
        Some(m) if !m.failed.is_empty() => {
            let message = format!("the mosaic has no data in {}", m.failed.join(", "));
            Err(CliError::partial(message, format!("`{}` gives the reasons", run.join(FAILED).display())))
        }
        _ => Ok(()),
    }
}
