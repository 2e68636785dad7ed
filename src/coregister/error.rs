//! Why a scene cannot be brought to a reference.

use crate::fault::ErrorKind;
use crate::frame::FrameError;
use crate::metrics::MetricsError;
use crate::stats::FitQuality;
use std::path::PathBuf;

/// Half the side of the grid of shifts that is searched, metres.
pub(super) const REACH_M: f64 = 24.0;
/// Smallest number of points on the reference.
pub(super) const FEWEST: usize = 100;

/// Why no translation was found.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum CoregisterError {
    /// Too few points lie on the reference.
    #[error("{common} of the run's points lie on heights of `{reference}`, {FEWEST} are needed")]
    #[diagnostic(help(
        "does the reference show the same place, is its CRS right, and does it hold heights?"
    ))]
    NoOverlap {
        /// The reference.
        reference: PathBuf,
        /// Points that lie on it.
        common: usize,
    },
    /// The best shift lies at the limit of the search.
    #[error("the best shift to `{reference}` lies at the limit of the search, {REACH_M} m")]
    #[diagnostic(help("does it show the same place, and buildings or relief?"))]
    TooFar {
        /// The reference.
        reference: PathBuf,
    },
    /// No ground control point is observed in two views.
    #[error("no point of `{reference}` is observed in two views of the run")]
    #[diagnostic(help("a point needs a line for each of two images or more"))]
    NoControl {
        /// The reference.
        reference: PathBuf,
    },
    /// Surveyed points do not agree on a shift.
    #[error(
        "the points of `{reference}` do not agree on a shift: half of them are {left_m:.1} m or more from it ({quality})"
    )]
    #[diagnostic(help(
        "are their coordinates, heights and pixels those of the same points, and the images those of the run?"
    ))]
    ControlDisagrees {
        /// The reference.
        reference: PathBuf,
        /// Median distance, metres.
        left_m: f64,
        /// How the points agree.
        quality: FitQuality,
    },
    /// The reference cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Reference(#[from] MetricsError),
    /// The coordinate systems cannot be transformed into each other.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
}

impl CoregisterError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Reference(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}
