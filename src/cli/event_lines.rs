//! Progress events as lines of JSON on standard output, for programs that start satgs.

use super::{CliError, Ui};
use crate::progress::{Event, Progress};
use serde_json::{Value, json};

/// Prints every event as one JSON object a line, and passes it on.
pub struct EventLines<'a> {
    ui: &'a Ui<'a>,
}

impl<'a> EventLines<'a> {
    /// Events go to standard output and to the user.
    pub fn new(ui: &'a Ui<'a>) -> Self {
        Self { ui }
    }

    /// Prints the summary of a job, which is the last line.
    pub fn summary(&self, summary: &Value) -> Result<(), CliError> {
        self.ui.print_line(&json!({ "event": "summary", "summary": summary }).to_string());
        self.ui.require_output()
    }
}

impl Progress for EventLines<'_> {
    fn event(&self, event: Event) {
        let line = match &event {
            Event::Started { stage, total } => json!({ "event": "started", "stage": stage, "total": total }),
            Event::Advanced { done, status } => {
                json!({ "event": "advanced", "done": done, "status": status })
            }
            Event::Finished => json!({ "event": "finished" }),
            Event::Resumable(is_resumable) => json!({ "event": "resumable", "value": is_resumable }),
            Event::Note(text) => json!({ "event": "note", "text": text }),
            Event::Warning(text) => json!({ "event": "warning", "text": text }),
        };
        self.ui.print_line(&line.to_string());
        self.ui.event(event);
    }

    fn is_cancelled(&self) -> bool {
        self.ui.is_cancelled()
    }
}
