//! How a command ends when it is not complete: one line, perhaps a hint, an exit code.

use crate::pipeline::{ErrorKind, PipelineError, message_with_causes};
use crate::run::RunError;
use crate::tiles::TilesError;
use miette::Diagnostic;

/// Exit codes of commands that are not complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ExitStatus {
    /// The work failed though its input may be right.
    Failed = 1,
    /// The input or the usage is wrong.
    WrongInput = 2,
    /// A part of the work is done.
    Partial = 3,
    /// The machine has too little memory or disk for the work. 75 is EX_TEMPFAIL of sysexits.h.
    Resources = 75,
    /// The work was interrupted and can be resumed.
    Interrupted = 130,
}

impl From<ErrorKind> for ExitStatus {
    fn from(kind: ErrorKind) -> Self {
        match kind {
            ErrorKind::Input => Self::WrongInput,
            ErrorKind::Failed => Self::Failed,
            ErrorKind::Resources => Self::Resources,
            ErrorKind::Interrupted => Self::Interrupted,
        }
    }
}

/// Why a command is not complete.
#[derive(Debug)]
pub struct CliError {
    /// What happened, naming file and field.
    pub message: String,
    /// What the user can do about it.
    pub hint: Option<String>,
    /// The exit code.
    pub status: ExitStatus,
}

impl CliError {
    /// Wrong input or usage.
    #[must_use]
    pub fn input(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { message: message.into(), hint: Some(hint.into()), status: ExitStatus::WrongInput }
    }

    /// Work that is done except for a part.
    #[must_use]
    pub fn partial(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { message: message.into(), hint: Some(hint.into()), status: ExitStatus::Partial }
    }

    /// Work that failed, with nothing that the user could do about it.
    #[must_use]
    pub fn failed(message: impl Into<String>) -> Self {
        Self { message: message.into(), hint: None, status: ExitStatus::Failed }
    }

    /// Whether the rest of the work is done.
    #[must_use]
    pub fn is_partial(&self) -> bool {
        self.status == ExitStatus::Partial
    }
}

impl From<RunError> for CliError {
    fn from(error: RunError) -> Self {
        match error {
            RunError::Pipeline(e) => e.into(),
            RunError::Tiles(e) => (*e).into(),
        }
    }
}

impl From<TilesError> for CliError {
    fn from(error: TilesError) -> Self {
        let is_partial = matches!(error, TilesError::Partial { .. });
        let status = if is_partial { ExitStatus::Partial } else { error.kind().into() };
        Self { message: error.chain(), hint: error.help().map(|h| h.to_string()), status }
    }
}

/// Any error of the library: its hint is the diagnostic's help.
impl<E> From<E> for CliError
where
    PipelineError: From<E>,
{
    fn from(error: E) -> Self {
        let error = PipelineError::from(error);
        let message = message_with_causes(&error);
        let hint = error.help().map(|h| h.to_string());
        Self { message, hint, status: error.kind().into() }
    }
}
