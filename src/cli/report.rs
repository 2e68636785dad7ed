//! `satgs report`: one page for a whole run.

use super::{CliError, Ui};
use crate::tiles::report;
use std::path::{Path, PathBuf};

/// Write RUN/report.html: inputs, residuals, training curves, surface, scores and commands on one page
///
/// The page contains all its pictures and opens without a network connection. Stages that RUN does not hold yet are
/// listed as missing.
#[derive(clap::Args)]
pub struct Args {
    /// Run folder of `satgs run`, or of some of its stages
    run: PathBuf,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    show(&report(&args.run)?, ui)
}

/// Shows where the page is.
pub fn show(page: &Path, ui: &Ui) -> Result<(), CliError> {
    ui.summary("report", Some(&page.display().to_string()), &serde_json::json!({ "page": page }))
}
