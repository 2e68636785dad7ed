//! `satgs info --devices` of a program without GPUs.

use super::{CliError, Ui};
use crate::pipeline::PipelineError;
use crate::splat::backend::BackendError;

/// Says that the program is built without GPUs.
pub fn run(_: &Ui) -> Result<(), CliError> {
    Err(PipelineError::from(BackendError::NoGpuSupport).into())
}
