//! What the user sees: progress bars on a terminal, log lines, the summary, the error.

use super::event_lines::{event_line, summary_line};
use super::scene_kind::Given;
use super::{CliError, Common, ExitStatus, interrupt};
use crate::pipeline::Outcome;
use crate::progress::{Event, Progress};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Without a terminal a long stage still says where it is, this often.
const LINE_EVERY: Duration = Duration::from_secs(60);

/// The user's side of a command, or that of a program that calls it.
pub struct Ui<'a> {
    common: Common,
    given: Given,
    /// The program that called the command: it receives what a user would see.
    caller: Option<&'a dyn Progress>,
    summaries: Mutex<Vec<StageSummary>>,
    stage: Mutex<Option<Stage>>,
    /// Why standard output did not take everything.
    lost: Mutex<Option<std::io::Error>>,
}

/// What a command says of a stage when it is complete.
#[derive(Clone, Debug)]
pub struct StageSummary {
    /// Name of the command that makes the stage.
    pub stage: String,
    /// Its figures; none if the stage was complete, and the record of its figures is gone.
    pub figures: Option<serde_json::Value>,
    /// Whether the stage was complete before.
    pub was_complete: bool,
}

struct Stage {
    name: &'static str,
    started: Instant,
    last_line: Instant,
    bar: ProgressBar,
}

impl<'a> Ui<'a> {
    /// From the options every command has, and those that were typed. A user sees what the command says, unless a program
    /// has called it.
    #[must_use]
    pub(super) fn new(common: &Common, given: Given, caller: Option<&'a dyn Progress>) -> Self {
        Self {
            common: common.clone(),
            given,
            caller,
            summaries: Mutex::default(),
            stage: Mutex::new(None),
            lost: Mutex::new(None),
        }
    }

    /// The options that were typed.
    pub(super) fn given(&self) -> &Given {
        &self.given
    }

    /// Starts logging and the thread pool, and takes Ctrl-C over.
    pub(super) fn set_up(&self) -> Result<(), CliError> {
        let level = match (self.common.quiet, self.common.verbose) {
            (true, _) => tracing::Level::ERROR,
            (_, 0) => tracing::Level::WARN,
            (_, 1) => tracing::Level::INFO,
            _ => tracing::Level::DEBUG,
        };
        // Fails only if a logger is there already, which is as good.
        let _ = tracing_subscriber::fmt()
            .with_max_level(level)
            .with_writer(std::io::stderr)
            .with_ansi(may_color())
            .with_target(false)
            .without_time()
            .try_init();
        interrupt::install();
        if let Some(n) = self.common.threads {
            rayon::ThreadPoolBuilder::new()
                .num_threads(n.into())
                .build_global()
                .map_err(|e| CliError::failed(e.to_string()))?;
        }
        Ok(())
    }

    /// The summary of a stage: the text is printed now; with `--json`, `json` at the end.
    pub fn summary(
        &self,
        stage: &str,
        text: Option<&str>,
        json: &impl serde::Serialize,
    ) -> Result<(), CliError> {
        self.summary_of(stage, text, json, false)
    }

    /// As [`Ui::summary`], of a stage that may have been complete before, which the text says too.
    pub fn summary_of(
        &self,
        stage: &str,
        text: Option<&str>,
        json: &impl serde::Serialize,
        was_complete: bool,
    ) -> Result<(), CliError> {
        let Common { json: as_json, events, quiet, .. } = self.common;
        let is_shown = self.caller.is_none() && !as_json && !events && !quiet;
        if let Some(text) = text.filter(|_| is_shown) {
            self.print_out(text);
        }
        self.record(stage, Some(super::json(json)?), was_complete);
        Ok(())
    }

    /// The summary of a stage that was kept, if there is a record of it: only `--json` prints it.
    pub fn kept(&self, stage: &str, json: Option<&impl serde::Serialize>) -> Result<(), CliError> {
        self.record(stage, json.map(super::json).transpose()?, true);
        Ok(())
    }

    fn record(&self, stage: &str, figures: Option<serde_json::Value>, was_complete: bool) {
        let summary = StageSummary { stage: stage.into(), figures, was_complete };
        locked(&self.summaries).push(summary);
    }

    /// The work is done but for a part: an error of the command, a warning of a call, whose result says it too.
    pub(super) fn partial(&self, message: String, hint: String) -> Result<(), CliError> {
        let Some(caller) = self.caller else { return Err(CliError::partial(message, hint)) };
        caller.event(Event::Warning(format!("{message}; {hint}")));
        Ok(())
    }

    /// The summary of a stage that may have been kept: then only `--json` prints it, if it is there.
    pub fn outcome<T: serde::Serialize>(
        &self,
        stage: &str,
        outcome: &Outcome<T>,
        text: impl Fn(&T) -> String,
    ) -> Result<(), CliError> {
        match outcome {
            Outcome::Made(summary) => self.summary(stage, Some(&text(summary)), summary),
            Outcome::Kept(summary) => self.kept(stage, summary.as_ref()),
        }
    }

    /// With `--json` or `--events`, prints the one stage's summary, or all stages' by name.
    pub(super) fn finish_json(&self) {
        let summaries = self.take_summaries();
        if self.common.json || self.common.events {
            let known = summaries.into_iter().filter_map(|s| Some((s.stage, s.figures?)));
            let summaries: serde_json::Map<_, _> = known.collect();
            let only = (summaries.len() == 1).then(|| summaries.values().next().cloned()).flatten();
            let all = only.unwrap_or(serde_json::Value::Object(summaries));
            let line = if self.common.events { summary_line(&all) } else { all };
            self.print_out(&line.to_string());
        }
    }

    /// The summaries of all stages, in the order in which they were complete.
    pub(super) fn take_summaries(&self) -> Vec<StageSummary> {
        std::mem::take(&mut *locked(&self.summaries))
    }

    /// Prints a line on standard output, whatever else is asked for.
    pub(super) fn print_line(&self, text: &str) {
        match self.caller {
            Some(caller) => caller.event(Event::Note(text.into())),
            None => self.print_out(text),
        }
    }

    fn print_out(&self, text: &str) {
        let mut out = std::io::stdout().lock();
        if let Err(e) = writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush()) {
            locked(&self.lost).get_or_insert(e);
        }
    }

    /// An error if standard output did not take what was printed. A closed pipe (`| head`) is the reader's choice.
    pub(super) fn require_output(&self) -> Result<(), CliError> {
        locked(&self.lost).take().map_or(Ok(()), output_lost)
    }

    pub(super) fn report(&self, error: &CliError) {
        self.finish();
        self.line(&format!("error: {}", error.message));
        if let Some(hint) = &error.hint {
            self.line(&format!("hint: {hint}"));
        }
    }

    fn start(&self, name: &'static str, total: u64) {
        self.finish();
        let terminal = std::io::stderr().is_terminal() && !self.common.quiet;
        let target = if terminal { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target((total > 0).then_some(total), target);
        let template = if total > 0 {
            "{prefix:>24} [{bar:30}] {pos}/{len} {elapsed}<{eta} {msg}"
        } else {
            "{prefix:>24} {spinner} {elapsed} {msg}"
        };
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_prefix(name);
        let now = Instant::now();
        *locked(&self.stage) = Some(Stage { name, started: now, last_line: now, bar });
    }

    fn advance(&self, done: u64, status: String) {
        let mut stage = locked(&self.stage);
        let Some(stage) = stage.as_mut() else { return };
        let first = stage.bar.position() == 0;
        stage.bar.set_position(done);
        if first {
            // Resumed work has done its first steps in no time.
            stage.bar.reset_eta();
        }
        if stage.bar.is_hidden() && stage.last_line.elapsed() > LINE_EVERY && !self.common.quiet {
            stage.last_line = Instant::now();
            let left = |total| format!("/{total}, {} left,", HumanDuration(stage.bar.eta()));
            let total = stage.bar.length().map_or_else(String::new, left);
            let _ = writeln!(std::io::stderr(), "{}: {done}{total} {status}", stage.name);
        }
        stage.bar.set_message(status);
    }

    fn finish(&self) {
        if let Some(stage) = locked(&self.stage).take() {
            stage.bar.finish_and_clear();
            tracing::info!("{}: {:.1} s", stage.name, stage.started.elapsed().as_secs_f64());
        }
    }

    fn line(&self, text: &str) {
        match locked(&self.stage).as_ref() {
            Some(stage) if !stage.bar.is_hidden() => stage.bar.suspend(|| {
                let _ = writeln!(std::io::stderr(), "{text}");
            }),
            _ => {
                let _ = writeln!(std::io::stderr(), "{text}");
            }
        }
    }
}

impl Progress for Ui<'_> {
    fn event(&self, event: Event) {
        if let Some(caller) = self.caller {
            return caller.event(event);
        }
        if self.common.events {
            self.print_out(&event_line(&event).to_string());
        }
        match event {
            Event::Started { stage, total } => self.start(stage, total),
            Event::Advanced { done, status } => self.advance(done, status),
            Event::Finished => self.finish(),
            Event::Resumable(is_resumable) => interrupt::set_resumable(is_resumable),
            Event::Note(text) => {
                if !self.common.quiet {
                    self.line(&text);
                }
            }
            Event::Warning(text) => {
                if !self.common.quiet {
                    self.line(&format!("warning: {text}"));
                }
            }
        }
    }

    fn is_cancelled(&self) -> bool {
        self.caller.map_or_else(interrupt::is_requested, Progress::is_cancelled)
    }
}

/// What a mutex guards, also after a panic of another thread.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The error of a standard output that cannot be written.
pub(super) fn output_lost(error: std::io::Error) -> Result<(), CliError> {
    if error.kind() == std::io::ErrorKind::BrokenPipe {
        return Ok(());
    }
    Err(CliError {
        message: format!("standard output could not be written: {error}"),
        hint: Some("all files are complete".into()),
        status: ExitStatus::Failed,
    })
}

/// Whether lines of the log may be coloured: on a terminal, unless the user has said `NO_COLOR`.
fn may_color() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|v| !v.is_empty());
    std::io::stderr().is_terminal() && !is_set("NO_COLOR")
}
