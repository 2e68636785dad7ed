//! `satgs nvs-eval`: scores of rendered images against images that were held back.

use super::{CliError, Ui};
use crate::pipeline::{NvsOptions, NvsScores, Protocol, nvs_eval};
use std::fmt::Write;
use std::path::PathBuf;

/// Score rendered images of a trained run against images that were held back from training: PSNR and SSIM
///
/// Each test view is rendered with its own camera and sun, and compared with its image. Colours of satellite images differ between
/// dates: in runs of recipe `satgs`, --protocol chooses those of the rendering; in other runs, the colours of the reference view are
/// fitted linearly to the left half of the image, and the right half is scored. Photographs are scored on whole images, as
/// displayed, without a fit of colours.
///
/// SSIM has a window of 11 x 11 pixels, SSIM 3 one of 3 x 3, as in the code of Sat-NeRF.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Run folder of `satgs train`
    run: PathBuf,
    /// Score this view, even if it was trained on; repeatable [default: all test views]
    #[arg(long, value_name = "NAME")]
    view: Vec<String>,
    /// How the colours of a view are chosen [default: full for runs of recipe satgs, else half]
    #[arg(long, value_enum)]
    protocol: Option<ProtocolArg>,
    /// Network for the perceptual distance LPIPS (safetensors, made by scripts/fetch-weights); papers use AlexNet [default: no
    /// LPIPS]
    #[arg(long, value_name = "FILE")]
    lpips: Option<PathBuf>,
}

/// [`Protocol`] on the command line.
#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum ProtocolArg {
    /// Fitted on the whole image, which is scored (as in the paper)
    Full,
    /// Fitted on the left half; the right half is scored
    Half,
    /// Those of the training view taken at the nearest time
    Nearest,
}

impl From<ProtocolArg> for Protocol {
    fn from(arg: ProtocolArg) -> Self {
        match arg {
            ProtocolArg::Full => Self::Full,
            ProtocolArg::Half => Self::Half,
            ProtocolArg::Nearest => Self::Nearest,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let options = NvsOptions {
        views: args.view.clone(),
        protocol: args.protocol.map(Protocol::from),
        lpips: args.lpips.clone(),
    };
    let scores = nvs_eval(&args.run, &options, ui)?;
    show(&scores, ui)
}

/// The scores of parts that training views see and do not see; empty if no view has them.
fn parts_text(scores: &NvsScores) -> String {
    let parts: Vec<_> = scores.views.iter().filter_map(|v| Some((&v.view, v.parts?))).collect();
    if parts.is_empty() {
        return String::new();
    }
    let mut text = format!("\n{:24} {:>9} {:>12} {:>12}\n", "view", "unseen %", "unseen dB", "seen dB");
    let number = |v: Option<f64>| v.map_or_else(|| "–".into(), |v| format!("{v:.2}"));
    for (name, p) in parts {
        let (unseen, seen) = (number(p.unseen_psnr_db), number(p.seen_psnr_db));
        let _ = writeln!(text, "{name:24} {:9.1} {unseen:>12} {seen:>12}", 100.0 * p.unseen_share);
    }
    text
}

/// Shows scores of views.
pub fn show(scores: &NvsScores, ui: &Ui) -> Result<(), CliError> {
    let head = ["view", "PSNR dB", "SSIM", "SSIM 3", "LPIPS", "pixels"];
    let mut text = format!(
        "{:24} {:>9} {:>7} {:>7} {:>7} {:>10}\n",
        head[0], head[1], head[2], head[3], head[4], head[5]
    );
    let views = scores.views.iter().map(|v| (v.view.as_str(), &v.score));
    for (name, s) in views.chain(scores.mean.as_ref().map(|mean| ("mean", mean))) {
        let lpips = s.lpips.map_or_else(|| "–".into(), |d| format!("{d:.3}"));
        let (psnr, ssim, ssim_3px, pixels) = (s.psnr_db, s.ssim, s.ssim_3px, s.pixels);
        let _ = writeln!(text, "{name:24} {psnr:9.2} {ssim:7.3} {ssim_3px:7.3} {lpips:>7} {pixels:10}");
    }
    text += &parts_text(scores);
    ui.summary("nvs-eval", Some(text.trim_end()), scores)
}
