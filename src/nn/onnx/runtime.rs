//! Calls of rten, whose panics become errors.

use super::convert::{converted, data_files};
use super::error::OnnxError;
use super::fault::Fault;
use super::graph::check;
use crate::io::Cause;
use rten::{Model, ModelOptions, NodeId, RunOptions, ThreadPool, Value, ValueOrView};
use std::any::Any;
use std::cell::Cell;
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::path::Path;
use std::sync::{Arc, Once};

/// A network as rten has it, and the threads that it runs on.
pub(super) struct Runtime {
    model: Model,
    threads: Arc<ThreadPool>,
}

impl Runtime {
    /// Reads a file.
    ///
    /// # Errors
    /// [`OnnxError`] if the file cannot be read or is cut short, or if it has operators that rten does not compute.
    pub fn load(path: &Path) -> Result<Self, OnnxError> {
        let bytes = std::fs::read(path).map_err(|cause| OnnxError::Read { path: path.into(), cause })?;
        let fault = |fault| match fault {
            Fault::Damaged { at, reason } => OnnxError::Damaged { path: path.into(), at, reason },
            Fault::CubicResize { node } => OnnxError::CubicResize { path: path.into(), node },
            Fault::Version { found } => OnnxError::Version { path: path.into(), found },
            Fault::Operator { node, op_type, reason } => {
                OnnxError::Operator { path: path.into(), node, op_type, reason }
            }
        };
        check(&bytes).map_err(fault)?;
        let load = match converted(&bytes).map_err(fault)? {
            None => {
                drop(bytes);
                caught(|| Model::load_file(path))
            }
            Some(rewritten) => {
                let options = with_data_files(path, data_files(&bytes).map_err(fault)?);
                drop(bytes);
                caught(|| options.load(rewritten))
            }
        };
        let model = load.map_err(|cause| OnnxError::Load { path: path.into(), cause })?;
        let threads = Arc::new(ThreadPool::with_num_threads(rayon::current_num_threads()));
        Ok(Self { model, threads })
    }

    pub fn model(&self) -> &Model {
        &self.model
    }

    /// An output for some inputs.
    pub fn run(&self, inputs: Vec<(NodeId, ValueOrView)>, output: NodeId) -> Result<Value, Cause> {
        let options = RunOptions::default().with_thread_pool(Some(self.threads.clone()));
        let [output] = caught(|| self.model.run_n(inputs, [output], Some(options)))?;
        Ok(output)
    }
}

/// Options that hold the files with weights beside a model. One that is not there is missed by rten, which names it.
fn with_data_files(path: &Path, names: BTreeSet<&str>) -> ModelOptions {
    let mut options = ModelOptions::with_all_ops();
    for name in names {
        let is_beside = Path::new(name).file_name().is_some_and(|file| file == name);
        if let (true, Ok(content)) = (is_beside, std::fs::read(path.with_file_name(name))) {
            options.external_data(name, content);
        }
    }
    options
}

thread_local! {
    /// Whether this thread is in a call of rten.
    static IS_INSIDE: Cell<bool> = const { Cell::new(false) };
}

/// What rten returns, with its error or the message of its panic as a cause: it indexes and asserts by what the file says, so that a
/// graph whose tensors do not fit each other may panic. The panic is not written to standard error.
pub(super) fn caught<T, E: Into<Cause>>(run: impl FnOnce() -> Result<T, E>) -> Result<T, Cause> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let previous = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !is_of_rten(info) {
                previous(info);
            }
        }));
    });
    IS_INSIDE.set(true);
    let result = catch_unwind(AssertUnwindSafe(run));
    IS_INSIDE.set(false);
    match result {
        Ok(result) => result.map_err(Into::into),
        Err(panic) => Err(format!("its tensors do not fit each other: {}", message(panic.as_ref())).into()),
    }
}

/// Whether a panic is of a call of rten, in this thread or in one of rten's.
fn is_of_rten(info: &PanicHookInfo) -> bool {
    IS_INSIDE.get() || info.location().is_some_and(|place| place.file().contains("rten"))
}

fn message(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("no message")
}
