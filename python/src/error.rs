//! Failures of the library as the exceptions of `satgs.errors`.

use pyo3::prelude::*;
use satgs::cli::{CliError, ExitStatus};

/// The exception for a failure: its class follows from whose fault the failure is, its message holds the causes.
pub fn exception(py: Python<'_>, error: impl Into<CliError>) -> PyErr {
    let CliError { message, hint, status } = error.into();
    let class = match status {
        ExitStatus::WrongInput => "InputError",
        ExitStatus::Interrupted => return pyo3::exceptions::PyKeyboardInterrupt::new_err(message),
        ExitStatus::Partial => "PartialError",
        ExitStatus::Failed | ExitStatus::Resources => "FailedError",
    };
    let made = py.import("satgs.errors").and_then(|errors| errors.getattr(class)?.call1((message, hint)));
    made.map_or_else(|failure| failure, PyErr::from_value)
}
