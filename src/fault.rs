//! Whose fault a failure is. Every enum of errors tells it by a method `kind`, unless all its errors are of the input.

/// Whose fault a failure is, which decides the exit code of the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// The input or an option is wrong: the same call fails again.
    Input,
    /// The input may be right, but the work failed: a file could not be written, a solver did not converge.
    Failed,
    /// The machine has less memory or disk than the work needs: another machine may do it.
    Resources,
    /// The caller asked to stop.
    Interrupted,
}
