//! `satgs ba`.

use super::{Failure, Ui};

/// (to be written)
#[derive(clap::Args)]
pub struct Args {}

/// Runs the command.
pub fn run(_args: &Args, _ui: &Ui) -> Result<(), Failure> {
    Err(Failure::input("not there yet", "soon"))
}
