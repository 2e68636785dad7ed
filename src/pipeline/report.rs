//! The page of a run: `satgs report`.

use super::PipelineError;
use super::outdated::outdated;
use super::product_lists::list_products;
use crate::report;
use crate::run_files::{PAGE, PLAN};
use std::path::{Path, PathBuf};

/// Writes `RUN/report.html` and returns its path. The page says which stages were made of what has been replaced since.
///
/// # Errors
/// [`PipelineError`] if the folder holds no run, a file of the run is damaged, or the page cannot be written.
pub fn report(run: &Path) -> Result<PathBuf, PipelineError> {
    let page = report::write(run, &outdated(run)?)?;
    // The Item lists the page.
    list_products(run)?;
    Ok(page)
}

/// Rewrites the page, if there is one, and the lists of products after a change of the run. Those of several tiles are written with the
/// mosaic.
pub(super) fn renew_report(run: &Path) -> Result<(), PipelineError> {
    if run.join(PLAN).exists() {
        return Ok(());
    }
    if run.join(PAGE).exists() {
        report(run)?;
    } else {
        list_products(run)?;
    }
    Ok(())
}
