//! What long work tells its caller while it runs: the library prints nothing.
//!
//! The command line turns events into progress bars and log lines, tests into assertions.

/// One thing that happened.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A stage begins; `total` steps are expected (0: unknown).
    Started {
        /// What the stage does, as a user would say it: `matching pairs`.
        stage: &'static str,
        /// Number of steps, 0 when unknown.
        total: u64,
    },
    /// `done` steps of the current stage are complete.
    Advanced {
        /// Steps done so far.
        done: u64,
        /// Figures of the moment, e.g. `loss 0.031, 93 k splats`; may be empty.
        status: String,
    },
    /// The current stage is over.
    Finished,
    /// Worth a line in the log.
    Note(String),
    /// Something is off but work goes on; said once per cause.
    Warning(String),
}

/// Receives events; called from one thread at a time.
pub type Sink<'a> = &'a dyn Fn(Event);

/// Drops every event.
pub fn ignore(_: Event) {}
