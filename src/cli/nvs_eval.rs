//! `satgs nvs-eval`: how well a trained run predicts images that it was not trained on.

use super::render::find;
use super::run_folder::{TrainedCameras, read_scene, require_images};
use super::{Failure, Ui};
use crate::affine::TrainingView;
use crate::scene::Role;
use crate::splat::image_score::score_picture;
use crate::splat::loss::target::TargetImage;
use crate::splat::novel_view::NovelView;
use std::fmt::Write;
use std::path::PathBuf;

/// Score pictures of a trained run against images that were held back: PSNR and SSIM
///
/// Each test view is rendered under its own sun in the reference view's colours. A linear change of colours is fitted on
/// the left half of the image, and the right half is scored.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Folder that `satgs train RUN` filled
    run: PathBuf,
    /// Score this view, trained on or not [default: all test views]
    #[arg(long, value_name = "NAME")]
    view: Vec<String>,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    let scene = read_scene(&args.run)?;
    require_images(&scene)?;
    let cameras = TrainedCameras::read(&args.run)?;
    let setup = &cameras.setup;
    let fitted = if args.view.is_empty() {
        setup.views.iter().filter(|v| v.role == Role::Test).collect()
    } else {
        args.view.iter().map(|name| find(setup, name)).collect::<Result<Vec<_>, _>>()?
    };
    if fitted.is_empty() {
        let hint =
            "`test.txt` beside the images holds views back; --view NAME scores one that was trained on";
        return Err(Failure::input("the run has no test view", hint));
    }
    let splats = cameras.read_splats(&args.run)?;
    let reference = cameras.reference_appearance();
    let mut text = format!("{:24} {:>9} {:>7} {:>10}\n", "view", "PSNR dB", "SSIM", "pixels");
    let mut scores = Vec::new();
    for view in fitted {
        let source = scene.views.iter().find(|v| v.name == view.name);
        let source = source.ok_or_else(|| {
            let message = format!("scene.json has no view `{}`, cameras.json has", view.name);
            Failure::input(message, "`satgs train RUN --overwrite` makes cameras.json anew")
        })?;
        let planes = source.read_colors()?;
        let mut truth = TargetImage::default();
        truth.load(&TrainingView::new(view.name.clone(), view.camera, None, &planes, setup.area), 0);
        let novel = NovelView { camera: view.camera, size: view.size, sun_shear: view.sun_shear };
        let mut picture = novel.picture(&splats, &reference, setup.altitudes);
        // Scored as the images show it.
        setup.tone.show(&mut picture.colors);
        let score = score_picture(&picture.colors, &truth).ok_or_else(|| {
            Failure::input(format!("view `{}` has no pixels to score", view.name), "see `satgs info`")
        })?;
        let _ =
            writeln!(text, "{:24} {:9.2} {:7.3} {:10}", view.name, score.psnr_db, score.ssim, score.pixels);
        scores.push(serde_json::json!({ "view": view.name, "score": score }));
    }
    ui.summary("nvs-eval", text.trim_end(), serde_json::json!({ "views": scores }));
    Ok(())
}
