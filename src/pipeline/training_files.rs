//! The log of a training as a file.

use super::PipelineError;
use crate::io::{WriteError, write_atomically};
use crate::splat::train::LogLine;
use std::path::Path;

/// Writes a line for each iteration.
pub(super) fn write_log(path: &Path, log: &[LogLine]) -> Result<(), PipelineError> {
    let failed = |reason: String| WriteError::new(path, reason);
    write_atomically(path, |t| {
        let mut writer = csv::Writer::from_path(t).map_err(|e| failed(e.to_string()))?;
        writer.write_record(LogLine::header()).map_err(|e| failed(e.to_string()))?;
        for line in log {
            writer.write_record(line.record()).map_err(|e| failed(e.to_string()))?;
        }
        writer.flush().map_err(|e| failed(e.to_string()))
    })?;
    Ok(())
}
