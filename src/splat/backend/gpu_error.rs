//! Why a device cannot be used.

use crate::fault::ErrorKind;

/// Why a device cannot be used.
#[derive(Clone, Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum GpuError {
    /// There is none that can train, or none but software.
    #[error("no GPU was found{}", but(found))]
    #[diagnostic(help(
        "`satgs info --devices` lists what drivers offer; gpu:N takes the one of a number, also if it is software"
    ))]
    NoDevice {
        /// Names of the devices that were found.
        found: Vec<String>,
    },
    /// There is no device of this number.
    #[error("there is no device {number}: {count} were found, counted from 0")]
    #[diagnostic(help("`satgs info --devices` lists them"))]
    NoSuchDevice {
        /// The number.
        number: usize,
        /// How many there are.
        count: usize,
    },
    /// The device lacks something that training needs.
    #[error("`{device}` cannot train: it lacks {missing}")]
    Lacks {
        /// Its name.
        device: String,
        /// What it lacks.
        missing: String,
    },
    /// The driver does not open the device.
    #[error("`{device}` cannot be opened: {reason}")]
    Refused {
        /// Its name.
        device: String,
        /// What the driver says.
        reason: String,
    },
    /// The device failed at work, or ran out of memory.
    #[error("`{device}` failed: {reason}")]
    #[diagnostic(help("--device cpu continues from the last checkpoint on the processor"))]
    Failed {
        /// Its name.
        device: String,
        /// What the driver says.
        reason: String,
    },
    /// The device does not compute what the processor does.
    #[error("`{device}` computes wrong losses: {found:?} instead of {expected:?}")]
    #[diagnostic(help("a newer driver may help; --device cpu trains on the processor"))]
    Wrong {
        /// Its name.
        device: String,
        /// The losses of the first iterations.
        found: Vec<f64>,
        /// Those of the processor.
        expected: Vec<f64>,
    },
    /// An array is larger than the device allows.
    #[error("{what} take {} MB in one array, but `{device}` allows {} MB", bytes / 1_000_000, limit / 1_000_000)]
    #[diagnostic(help("fewer splats or smaller images fit; --device cpu has no such limit"))]
    TooLarge {
        /// What the array holds.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// Name of the device.
        device: String,
        /// The largest size that it allows.
        limit: u64,
    },
}

fn but(found: &[String]) -> String {
    if found.is_empty() { String::new() } else { format!(" but {}", found.join(", ")) }
}

impl GpuError {
    /// Whose fault the failure is: of a number that no device has that of the caller, else that of the machine.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::NoDevice { .. } | Self::NoSuchDevice { .. } => ErrorKind::Input,
            _ => ErrorKind::Failed,
        }
    }
}
