//! `satgs nvs-eval`: scores of rendered images against images that were held back.

use super::{CliError, Ui};
use crate::pipeline::{NvsScores, nvs_eval};
use std::fmt::Write;
use std::path::PathBuf;

/// Score novel views of a trained run against images that were held back from training (listed in the scene's
/// test.txt): PSNR and SSIM
///
/// Each test view is rendered with its own camera and sun, in the colours of the reference view. A linear change of
/// colours is fitted on the left half of the image, and the right half is scored. Of perspective scenes whole images are scored,
/// as displayed, without a change of colours.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Run folder of `satgs train`
    run: PathBuf,
    /// Score this view, even if it was trained on; repeatable [default: all test views]
    #[arg(long, value_name = "NAME")]
    view: Vec<String>,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let scores = nvs_eval(&args.run, &args.view, ui)?;
    show(&scores, ui)
}

/// Shows scores of views.
pub fn show(scores: &NvsScores, ui: &Ui) -> Result<(), CliError> {
    let mut text = format!("{:24} {:>9} {:>7} {:>10}\n", "view", "PSNR dB", "SSIM", "pixels");
    let views = scores.views.iter().map(|v| (v.view.as_str(), &v.score));
    for (name, s) in views.chain(scores.mean.as_ref().map(|mean| ("mean", mean))) {
        let _ = writeln!(text, "{name:24} {:9.2} {:7.3} {:10}", s.psnr_db, s.ssim, s.pixels);
    }
    ui.summary("nvs-eval", Some(text.trim_end()), scores)
}
