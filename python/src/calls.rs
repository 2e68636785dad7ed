//! The calls of `satgs::pipeline` and `satgs::tiles`. Their results go to Python as the JSON that the commands print with `--json`, from
//! which `satgs.results` makes objects.

use crate::error::exception;
use crate::options::{AdjustArgs, DsmArgs, RunArgs, SceneArgs, TrainArgs, TruthArgs};
use crate::work;
use pyo3::prelude::*;
use satgs::cli::{CliError, ExitStatus};
use satgs::pipeline::{self, Outcome, PipelineError, StageResult};
use satgs::progress::{Event, Progress};
use satgs::scene::Scene;
use satgs::tiles::{self, SceneResult, TilesError};
use serde::Serialize;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A result as JSON, none if the record of a stage that was complete has gone; and whether it was complete before.
type Figures = (Option<String>, bool);

#[pyfunction]
pub fn adjust(
    py: Python<'_>,
    scene: PathBuf,
    run: PathBuf,
    options: Bound<'_, PyAny>,
    progress: Py<PyAny>,
) -> PyResult<Figures> {
    let (reading, adjusting): (SceneArgs, AdjustArgs) = (options.extract()?, options.extract()?);
    work::run(py, &progress, |progress| {
        let options = adjusting.options()?;
        let adjusted = pipeline::adjust(&read(&scene, &reading, progress)?, &options, &run, progress)?;
        Ok::<_, PipelineError>((Some(json(&adjusted)?), adjusted.was_complete))
    })
}

#[pyfunction]
pub fn train(py: Python<'_>, run: PathBuf, options: TrainArgs, progress: Py<PyAny>) -> PyResult<Figures> {
    work::run(py, &progress, |progress| figures(&pipeline::train(&run, &options.options()?, progress)?))
}

#[pyfunction]
pub fn dsm(py: Python<'_>, run: PathBuf, options: DsmArgs, progress: Py<PyAny>) -> PyResult<Figures> {
    let options = options.options();
    work::run(py, &progress, |progress| {
        options.check(&run)?;
        figures(&pipeline::dsm(&run, &options, progress)?)
    })
}

#[pyfunction]
pub fn compare(
    py: Python<'_>,
    dsm: PathBuf,
    truth: PathBuf,
    output: Option<PathBuf>,
    options: TruthArgs,
    progress: Py<PyAny>,
) -> PyResult<String> {
    let options = options.options();
    work::run(py, &progress, |progress| {
        json(&pipeline::evaluate(&dsm, &truth, &options, output.as_deref(), progress)?)
    })
}

/// The results of all stages, by the names of the commands; that of `report` is the path of the page.
#[pyfunction]
pub fn run(
    py: Python<'_>,
    scene: PathBuf,
    run: PathBuf,
    options: Bound<'_, PyAny>,
    progress: Py<PyAny>,
) -> PyResult<Vec<(&'static str, Figures)>> {
    let (reading, stages): (SceneArgs, RunArgs) = (options.extract()?, options.extract()?);
    work::run(py, &progress, |progress| {
        let options = stages.options()?;
        options.check(&run)?;
        let scene = read(&scene, &reading, progress)?;
        let mut results = Vec::new();
        tiles::run(&scene, &options, &run, progress, &mut |result| results.push(stage(&result)))?;
        Ok::<_, TilesError>(results.into_iter().collect::<Result<_, PipelineError>>()?)
    })
}

/// Sets the number of threads of all later work, once and before any work.
#[pyfunction]
pub fn set_threads(py: Python<'_>, threads: usize) -> PyResult<()> {
    let expected = "a number from 1 on";
    if threads == 0 {
        let error = PipelineError::Option { option: "threads", found: "0".into(), expected };
        return Err(exception(py, error));
    }
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
    py.detach(|| satgs::cli::run_command_line(words))
}

/// Reads a scene and reports its warnings.
fn read(path: &Path, options: &SceneArgs, progress: &dyn Progress) -> Result<Scene, PipelineError> {
    let scene = options.read(path)?;
    for warning in &scene.warnings {
        progress.event(Event::Warning(warning.clone()));
    }
    Ok(scene)
}

fn stage(result: &SceneResult) -> Result<(&'static str, Figures), PipelineError> {
    Ok(match result {
        SceneResult::Planned(outcome) => ("plan", figures(outcome)?),
        SceneResult::Mosaicked(outcome) => ("mosaic", figures(outcome)?),
        SceneResult::Stage(StageResult::Adjusted(adjusted)) => {
            ("ba", (Some(json(adjusted)?), adjusted.was_complete))
        }
        SceneResult::Stage(StageResult::Trained(outcome)) => ("train", figures(outcome)?),
        SceneResult::Stage(StageResult::Scored(scores)) => ("nvs-eval", (Some(json(scores)?), false)),
        SceneResult::Stage(StageResult::Dsm(outcome)) => ("dsm", figures(outcome)?),
        SceneResult::Stage(StageResult::Evaluated(evaluation)) => {
            ("dsm-eval", (Some(json(evaluation)?), false))
        }
        SceneResult::Stage(StageResult::Reported(page)) => {
            ("report", (Some(page.to_string_lossy().into_owned()), false))
        }
    })
}

fn figures<T: Serialize>(outcome: &Outcome<T>) -> Result<Figures, PipelineError> {
    let was_complete = matches!(outcome, Outcome::Kept(_));
    Ok((outcome.summary().map(json).transpose()?, was_complete))
}

fn json(result: &impl Serialize) -> Result<String, PipelineError> {
    serde_json::to_string(result).map_err(|source| PipelineError::Json { what: "the result", source })
}
