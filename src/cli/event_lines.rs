//! Progress events as lines of JSON on standard output, for programs that start satgs.

use crate::progress::Event;
use serde_json::{Value, json};

/// An event as one JSON object.
pub fn event_line(event: &Event) -> Value {
    match event {
        Event::Started { stage, total } => json!({ "event": "started", "stage": stage, "total": total }),
        Event::Advanced { done, status } => json!({ "event": "advanced", "done": done, "status": status }),
        Event::Finished => json!({ "event": "finished" }),
        Event::Resumable(is_resumable) => json!({ "event": "resumable", "value": is_resumable }),
        Event::Note(text) => json!({ "event": "note", "text": text }),
        Event::Warning(text) => json!({ "event": "warning", "text": text }),
    }
}

/// The summary of a command, which is the last line.
pub fn summary_line(summary: &Value) -> Value {
    json!({ "event": "summary", "summary": summary })
}
