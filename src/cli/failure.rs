//! How a command fails: one line, perhaps a hint, an exit code.

use miette::Diagnostic;

/// Exit code of work that failed though its input was right.
const FAILED: u8 = 1;
/// Exit code of wrong input or usage.
const WRONG_INPUT: u8 = 2;
/// Exit code of work of which a part is done.
const PARTIAL: u8 = 3;
/// Exit code of work that was interrupted and can be resumed.
pub(super) const INTERRUPTED: u8 = 130;

/// Why a command did not complete.
#[derive(Debug)]
pub struct Failure {
    /// What happened, naming file and field.
    pub message: String,
    /// What the user can do about it.
    pub hint: Option<String>,
    /// 1 failed, 2 input or usage wrong, 3 partial, 130 interrupted.
    pub exit_code: u8,
}

impl Failure {
    /// Work that was asked to stop, and how it goes on.
    #[must_use]
    pub fn interrupted(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { message: message.into(), hint: Some(hint.into()), exit_code: INTERRUPTED }
    }

    /// Wrong input or usage.
    #[must_use]
    pub fn input(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { message: message.into(), hint: Some(hint.into()), exit_code: WRONG_INPUT }
    }

    /// Work that is done but for a part.
    #[must_use]
    pub fn partial(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { message: message.into(), hint: Some(hint.into()), exit_code: PARTIAL }
    }

    /// Whether the rest of the work is done.
    #[must_use]
    pub fn is_partial(&self) -> bool {
        self.exit_code == PARTIAL
    }
}

/// Library errors carry their hint as `help` and, unless the input is to blame, a code: `satgs::failed` or
/// `satgs::interrupted`.
impl<E: Diagnostic> From<E> for Failure {
    fn from(error: E) -> Self {
        let mut message = error.to_string();
        let mut source = std::error::Error::source(&error);
        while let Some(cause) = source {
            let cause_text = cause.to_string();
            if !message.contains(&cause_text) {
                message = format!("{message}: {cause_text}");
            }
            source = cause.source();
        }
        let exit_code = match error.code().map(|c| c.to_string()).as_deref() {
            Some("satgs::failed") => FAILED,
            Some("satgs::interrupted") => INTERRUPTED,
            _ => WRONG_INPUT,
        };
        Self { message, hint: error.help().map(|h| h.to_string()), exit_code }
    }
}
