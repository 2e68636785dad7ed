//! How long work reports what it does and is asked to stop. The library itself prints nothing.
//!
//! The command line turns events into progress bars and log lines, and Ctrl-C into a request to stop; a test records
//! the events with [`Recorder`].

use std::sync::{Mutex, PoisonError};

/// One thing that happened during long work.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A step of the work begins.
    Started {
        /// What the step does, as a user would say it: `matching pairs`.
        stage: &'static str,
        /// Number of units of work, 0 when unknown.
        total: u64,
    },
    /// `done` units of the current step are complete.
    Advanced {
        /// Units done so far.
        done: u64,
        /// Figures of the moment, e.g. `loss 0.031, 93000 splats`; may be empty.
        status: String,
    },
    /// The current step is complete.
    Finished,
    /// Whether work that is asked to stop from here on leaves a checkpoint. It does not before the first such event.
    Resumable(bool),
    /// Information for the user.
    Note(String),
    /// A problem that does not stop the work; reported once for each cause.
    Warning(String),
}

/// Receives the events of long work and can ask it to stop.
///
/// Events come from one thread at a time, in order. The work asks [`is_cancelled`](Progress::is_cancelled) between its
/// units (iterations, pairs, images), never inside one, and then returns an error that stands for [`Interrupted`].
pub trait Progress: Sync {
    /// Receives an event.
    fn event(&self, event: Event);

    /// Whether the work should stop.
    fn is_cancelled(&self) -> bool {
        false
    }

    /// [`Interrupted`] if the work should stop.
    ///
    /// # Errors
    /// [`Interrupted`].
    fn check(&self) -> Result<(), Interrupted> {
        if self.is_cancelled() { Err(Interrupted) } else { Ok(()) }
    }
}

/// The work was asked to stop by its [`Progress`], and stopped before it was complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error, miette::Diagnostic)]
#[error("interrupted")]
#[diagnostic(help("what is done is kept: the same command continues"))]
pub struct Interrupted;

/// Drops every event and never asks to stop.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn event(&self, _: Event) {}
}

/// When a [`Recorder`] asks to stop.
type CancelAt = Box<dyn Fn(&Event) -> bool + Send + Sync>;

/// Keeps all events, and asks to stop once one of them fulfils a condition: for tests.
#[derive(Default)]
pub struct Recorder {
    seen: Mutex<Seen>,
    cancel_at: Option<CancelAt>,
}

#[derive(Default)]
struct Seen {
    events: Vec<Event>,
    is_cancelled: bool,
}

impl Recorder {
    /// A recorder that asks to stop from the first event on for which `cancel_at` is true.
    #[must_use]
    pub fn cancelling(cancel_at: impl Fn(&Event) -> bool + Send + Sync + 'static) -> Self {
        Self { cancel_at: Some(Box::new(cancel_at)), ..Self::default() }
    }

    /// The events so far.
    #[must_use]
    pub fn events(&self) -> Vec<Event> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner).events.clone()
    }
}

impl Progress for Recorder {
    fn event(&self, event: Event) {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        seen.is_cancelled |= self.cancel_at.as_ref().is_some_and(|cancels| cancels(&event));
        seen.events.push(event);
    }

    fn is_cancelled(&self) -> bool {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner).is_cancelled
    }
}
