//! Report of a run as one self-contained HTML page: the result first, then scores, surface, inputs, residuals, training, commands.
//!
//! The page is made from the files in the run's folder. A section whose stage has not run yet names the command that runs
//! it.

mod figures;
mod held_back;
mod map;
mod photographs;
mod pictures;
mod result;
mod score_table;
mod sections;

pub use figures::{FIGURES, figures};
pub use pictures::{map_of_page, shaded};
pub use result::result;
pub use score_table::{SCORE_NOTE, ScoreTable, expected_error_text, score_tables};
pub use sections::{adjustment, commands, scores, surface, table};

use crate::fault::ErrorKind;
use crate::io::{RasterError, ReadError, WriteError, escape_xml, write_file};
use crate::run_files::{DSM, NVS_SCORES, PAGE, PRIOR_PICTURES, SCENE, START};
use std::path::{Path, PathBuf};

/// Why a report could not be written.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum ReportError {
    /// The folder is not that of a run.
    #[error("`{run}` holds no run: `{run}/{SCENE}` does not exist")]
    #[diagnostic(help("`satgs run SCENE -o RUN` creates a run"))]
    NoRun {
        /// The folder.
        run: PathBuf,
    },
    /// A JSON file of the run cannot be read.
    #[error(transparent)]
    #[diagnostic(help("the command that wrote the file writes it again with --overwrite"))]
    Read(#[from] ReadError),
    /// A raster of the run could not be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    /// The page could not be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
}

impl ReportError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Raster(e) => e.kind(),
            Self::Write(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}

/// Writes `report.html` to the folder of a run and returns its path. `outdated` says which stages were made of what has been
/// replaced since.
///
/// # Errors
/// [`ReportError`] if the folder holds no run, a file of the run is damaged, or the page cannot be written.
pub fn write(run: &Path, outdated: &[String]) -> Result<PathBuf, ReportError> {
    if !run.join(SCENE).exists() {
        return Err(ReportError::NoRun { run: run.into() });
    }
    let sections = if photographs::is_perspective(run)? { of_photographs(run)? } else { of_satellites(run)? };
    let path = run.join(PAGE);
    write_file(&path, page(run, outdated, &sections))?;
    Ok(path)
}

/// ID, title and content of a section.
type Section = (&'static str, &'static str, String);

fn of_satellites(run: &Path) -> Result<Vec<Section>, ReportError> {
    let mut sections = vec![
        ("result", "Result", result::result(run)?),
        ("scores", "Scores", sections::scores(run)?),
        ("surface", "Surface", sections::surface(run)?),
        ("inputs", "Inputs", sections::inputs(run)?),
        ("adjustment", "Adjustment", sections::adjustment(run)?),
        ("training", "Training", sections::training(run)?),
    ];
    if run.join(NVS_SCORES).exists() {
        sections.insert(3, ("views", "Novel views", held_back::held_back(run)?));
    }
    sections.push(("commands", "Versions and commands", sections::commands(run)?));
    Ok(sections)
}

fn of_photographs(run: &Path) -> Result<Vec<Section>, ReportError> {
    let mut sections = vec![
        ("result", "Result", result::result(run)?),
        ("views", "Views held back", held_back::held_back(run)?),
        ("inputs", "Inputs", photographs::views(run)?),
        ("training", "Training", sections::training(run)?),
    ];
    if run.join(START).exists() {
        sections.insert(3, ("start", "Aligned depths", photographs::start(run)?));
    }
    if run.join(PRIOR_PICTURES).exists() {
        sections.push(("priors", "Priors", photographs::priors(run)?));
    }
    if run.join(DSM).exists() {
        sections.push(("surface", "Surface", sections::surface(run)?));
    }
    sections.push(("commands", "Versions and commands", sections::commands(run)?));
    Ok(sections)
}

/// The text of a page that shows a run folder; each section has an ID, a title and a content as HTML. `notes` stand above them.
/// The page needs no other file.
#[must_use]
pub fn page(run: &Path, notes: &[String], sections: &[(&str, &str, String)]) -> String {
    let name = run.canonicalize().ok().and_then(|r| Some(r.file_name()?.to_string_lossy().into_owned()));
    let name = escape_xml(&name.unwrap_or_else(|| "run".into()));
    let notes: String =
        notes.iter().map(|note| format!("<p class=\"note\">{}</p>\n", escape_xml(note))).collect();
    let links: String =
        sections.iter().map(|(id, title, _)| format!("<a href=\"#{id}\">{title}</a>\n")).collect();
    let body: String = sections
        .iter()
        .map(|(id, title, html)| format!("<section id=\"{id}\">\n<h2>{title}</h2>\n{html}</section>\n"))
        .collect();
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; \
         style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{name}: satgs</title>\n<style>\n{}</style>\n</head>\n<body>\n\
         <header>\n<h1>{name}</h1>\n<p>Made by satgs {}</p>\n\
         <nav aria-label=\"Sections\">\n{links}</nav>\n</header>\n<main>\n{notes}{body}</main>\n\
         <script>\n{}</script>\n</body>\n</html>\n",
        include_str!("page.css"),
        env!("CARGO_PKG_VERSION"),
        include_str!("page.js"),
    )
}
