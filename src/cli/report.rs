//! `satgs report`: one page for a whole run.

use super::{Failure, Ui};
use crate::report;
use std::path::{Path, PathBuf};

/// Write RUN/report.html: inputs, residuals, curves, surface, scores and commands on one page
///
/// The page holds everything it shows and opens without a network. What RUN does not hold yet is said to be missing.
#[derive(clap::Args)]
pub struct Args {
    /// Folder that `satgs run` filled, or some of its stages
    run: PathBuf,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    write(&args.run, ui)
}

/// Writes the page and says where it is.
pub(super) fn write(run: &Path, ui: &Ui) -> Result<(), Failure> {
    let page = report::write(run)?;
    let path = page.display().to_string();
    ui.summary("report", &path, serde_json::json!({ "page": path }));
    Ok(())
}
