//! The commands as calls: the words of a command line in, the figures of its stages out.

use crate::error::exception;
use crate::work;
use pyo3::prelude::*;
use satgs::cli::{self, CliError, ExitStatus, StageSummary};
use satgs::pipeline::PipelineError;
use std::ffi::OsString;

/// Name of a stage; its figures as JSON, none if their record has gone; whether it was complete before.
type Figures = (String, Option<String>, bool);

/// Runs the command of these words, which are those after the program's name, and hands its events to `progress`.
#[pyfunction]
pub fn call(py: Python<'_>, words: Vec<OsString>, progress: Py<PyAny>) -> PyResult<Vec<Figures>> {
    let summaries = work::run(py, &progress, |progress| cli::call(words, progress))?;
    let figures = |s: StageSummary| (s.stage, s.figures.map(|figures| figures.to_string()), s.was_complete);
    Ok(summaries.into_iter().map(figures).collect())
}

/// The arguments of all commands as JSON.
#[pyfunction]
pub fn arguments() -> String {
    cli::arguments().to_string()
}

/// Sets the number of threads of all later work, once and before any work.
#[pyfunction]
pub fn set_threads(py: Python<'_>, threads: i64) -> PyResult<()> {
    let expected = "a number from 1 on";
    let Some(threads) = usize::try_from(threads).ok().filter(|threads| *threads > 0) else {
        let error = PipelineError::Option { option: "threads", found: threads.to_string(), expected };
        return Err(exception(py, error));
    };
    let built = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    built.map_err(|_| {
        let error = CliError {
            message: "satgs has begun to work: the number of threads is settled".into(),
            hint: Some(
                "call satgs.set_threads before any other call, or set RAYON_NUM_THREADS before Python starts"
                    .into(),
            ),
            status: ExitStatus::Failed,
        };
        exception(py, error)
    })
}

/// Runs the command line with these words, the first of which is the program's name; returns the exit code.
#[pyfunction]
pub fn command(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| cli::run_command_line(words))
}
