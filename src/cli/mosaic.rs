//! `satgs mosaic`: tiles to one surface model and one orthophoto.

use super::tile::JobArgs;
use super::{CliError, Ui};
use crate::pipeline::Outcome;
use crate::progress::Progress;
use crate::run_files::{DSM, FAILED, ORTHO};
use crate::tiles::{Mosaicked, mosaic};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Join the tiles of a plan: writes RUN/dsm.tif, ortho.tif, confidence.tif, seams.gpkg and report.html
///
/// Blends tiles first that are not blended yet. Tiles that are not done are nodata; failed.gpkg has their outlines and reasons.
/// seams.gpkg has the differences of heights and colours along every seam.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Run folder of `satgs plan`
    run: PathBuf,
    #[command(flatten)]
    job: JobArgs,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let job = |progress: &dyn Progress| Ok(mosaic(&args.run, progress)?);
    let outcome = args.job.supervised(ui, "mosaic", job, |m| text(&args.run, m))?;
    match outcome.summary() {
        Some(m) if !m.failed.is_empty() => {
            let ids: Vec<&str> = m.failed.iter().map(|tile| tile.id.as_str()).collect();
            let message = format!("the mosaic has no data in {}", ids.join(", "));
            ui.partial(message, format!("`{}` gives the reasons", args.run.join(FAILED).display()))
        }
        _ => Ok(()),
    }
}

/// Shows the summary of a mosaic.
pub fn show(run: &Path, outcome: &Outcome<Mosaicked>, ui: &Ui) -> Result<(), CliError> {
    ui.outcome("mosaic", outcome, |m| text(run, m))
}

fn text(run: &Path, m: &Mosaicked) -> String {
    format!("{}\n{}\n{}\n{}", seams(m), m.cells.text(), run.join(DSM).display(), run.join(ORTHO).display())
}

/// The number of tiles, and the differences at their seams.
fn seams(m: &Mosaicked) -> String {
    let (mut out, s) = (format!("{} tiles joined", m.tiles), &m.seams);
    if let (Some(step), Some(p95), Some(over)) = (s.step_m, s.step_p95_m, s.over_1m) {
        let over = 100.0 * over;
        // Writing to a string cannot fail.
        let _ = write!(
            out,
            "\n{} seams: steps of {step:.2} m (median), {p95:.2} m (95 %); {over:.1} % of the cells differ by more than 1 m",
            s.seams
        );
    }
    if let (Some(before), Some(after), Some(spread)) = (s.ortho_before, s.ortho_after, s.ortho_spread) {
        let _ = write!(
            out,
            "\nsteps of the colours: {before:.1} of 255 (median), {after:.1} after correction; a cell differs by {spread:.1}"
        );
    }
    out
}
