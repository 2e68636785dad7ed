//! Long work beside Python: a thread of its own works without Python's lock, and the calling thread hands its events to
//! the caller's function and looks for signals.

use crate::error::exception;
use pyo3::prelude::*;
use satgs::cli::{CliError, ExitStatus};
use satgs::progress::{Event, Progress};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

/// How often the calling thread looks for signals while no event comes.
const SIGNALS_EVERY: Duration = Duration::from_millis(50);
/// Number of events that may wait for the caller's function; the work waits for it beyond that.
const WAITING_EVENTS: usize = 16;
/// As much as the main thread of a program has, bytes.
const STACK: usize = 8 << 20;

/// What the work reports to.
struct Reporter<'a> {
    events: SyncSender<Event>,
    is_cancelled: &'a AtomicBool,
}

impl Progress for Reporter<'_> {
    fn event(&self, event: Event) {
        // The receiver outlives the work.
        let _ = self.events.send(event);
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Relaxed)
    }
}

/// Runs `work`; `callback` is called with every event as an object of `satgs.events`, in the calling thread.
///
/// An exception of a signal's handler, such as `KeyboardInterrupt`, or of `callback` asks the work to stop, which leaves
/// a checkpoint where it can, and is raised when the work has ended.
///
/// # Errors
/// That exception, or that of the work's failure.
pub fn run<T: Send, E: Into<CliError> + Send>(
    py: Python<'_>,
    callback: &Py<PyAny>,
    work: impl FnOnce(&dyn Progress) -> Result<T, E> + Send,
) -> PyResult<T> {
    let is_cancelled = AtomicBool::new(false);
    let (sender, events) = sync_channel(WAITING_EVENTS);
    let is_cancelled = &is_cancelled;
    let reporter = Reporter { events: sender, is_cancelled };
    let (raised, outcome) = py.detach(move || {
        let mut raised: Option<PyErr> = None;
        let outcome = std::thread::scope(|scope| {
            let thread = std::thread::Builder::new().name("satgs".into()).stack_size(STACK);
            // The thread owns the sender, so that the events end with the work.
            let thread = thread.spawn_scoped(scope, move || work(&reporter))?;
            loop {
                let first = match events.recv_timeout(SIGNALS_EVERY) {
                    Ok(event) => Some(event),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                let waiting = first.into_iter().chain(events.try_iter());
                if raised.is_some() {
                    waiting.for_each(drop);
                    continue;
                }
                if let Err(e) = Python::attach(|py| tell(py, callback, waiting)) {
                    is_cancelled.store(true, Relaxed);
                    raised = Some(e);
                }
            }
            Ok(thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        });
        (raised, outcome)
    });
    let outcome = outcome.map_err(|e: std::io::Error| {
        exception(py, CliError::failed(format!("a thread for the work cannot be started: {e}")))
    })?;
    let outcome: Result<T, CliError> = outcome.map_err(E::into);
    match (raised, outcome) {
        (None, Ok(result)) => Ok(result),
        (None, Err(failure)) => Err(exception(py, failure)),
        (Some(raised), outcome) => {
            // A checkpoint that could not be written, for example, is told too.
            if let Err(failure) = outcome
                && failure.status != ExitStatus::Interrupted
                && raised.cause(py).is_none()
            {
                raised.set_cause(py, Some(exception(py, failure)));
            }
            Err(raised)
        }
    }
}

/// Looks for signals and calls the caller's function with events.
fn tell(py: Python<'_>, callback: &Py<PyAny>, events: impl Iterator<Item = Event>) -> PyResult<()> {
    py.check_signals()?;
    let classes = py.import("satgs.events")?;
    for event in events {
        let event = match event {
            Event::Started { stage, total } => classes.getattr("Started")?.call1((stage, total)),
            Event::Advanced { done, status } => classes.getattr("Advanced")?.call1((done, status)),
            Event::Finished => classes.getattr("Finished")?.call0(),
            Event::Resumable(is_resumable) => classes.getattr("Resumable")?.call1((is_resumable,)),
            Event::Note(text) => classes.getattr("Note")?.call1((text,)),
            Event::Warning(text) => classes.getattr("Warning")?.call1((text,)),
            _ => continue,
        }?;
        callback.call1(py, (event,))?;
    }
    Ok(())
}
