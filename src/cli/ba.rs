//! `satgs ba`: bundle adjustment.

use super::scene_args::SceneArgs;
use super::stage::{Fingerprint, Stage, hash, hash_file};
use super::train::write_json;
use super::{Failure, Ui};
use crate::bundle::{Options, adjust};
use crate::raster::Vertical;
use crate::scene::Scene;
use std::path::{Path, PathBuf};

/// Correct the RPCs by bundle adjustment: RUN/ba/rpcs, RUN/ba/points.laz, RUN/ba/report.json
///
/// Finds keypoints, matches them along the epipolar segments between two heights, joins them to tracks and adjusts
/// one shift a view. The corrected RPCs are exact (the shift goes into the offsets) and fit any stereo pipeline.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "adjustment")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Folder for everything this run makes
    #[arg(short, long, value_name = "RUN")]
    output: PathBuf,
    /// Lowest and highest height to search, metres above the ellipsoid [default: what the images' metadata tell]
    #[arg(long, value_name = "LOW,HIGH", value_parser = parse_range, allow_hyphen_values = true)]
    height_range: Option<(f64, f64)>,
    /// Elevation model that tells the heights to search, from 20 m below its lowest to 80 m above its highest
    #[arg(long, value_name = "FILE", conflicts_with = "height_range")]
    dem: Option<PathBuf>,
    /// What the model's heights count from: `ellipsoid`, or a geoid grid (.gtx, .tif of PROJ) [default: what it says]
    #[arg(long, value_name = "ellipsoid|GRID", requires = "dem")]
    dem_vertical: Option<String>,
    /// Leave the RPCs as they are: only tracks, points and the report
    #[arg(long)]
    fixed: bool,
    /// Redo what RUN holds of other input or options
    #[arg(long)]
    overwrite: bool,
}

fn parse_range(text: &str) -> Result<(f64, f64), String> {
    let numbers =
        text.split_once(',').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    numbers.ok_or_else(|| format!("`{text}` is not LOW,HIGH"))
}

impl Args {
    /// The run folder.
    pub fn output(&self) -> &Path {
        &self.output
    }

    /// Whether to redo what is there.
    pub fn overwrite(&self) -> bool {
        self.overwrite
    }

    /// The heights to search: the user's, else the elevation model's.
    fn heights(&self, scene: &Scene) -> Result<Option<(f64, f64)>, Failure> {
        let Some(dem) = &self.dem else { return Ok(self.height_range) };
        let vertical = self.dem_vertical.as_deref().map(Vertical::read).transpose()?;
        Ok(Some(scene.heights_from_dem(dem, vertical.as_ref())?))
    }

    fn fingerprint(&self, scene: &Scene, heights: Option<(f64, f64)>) -> Fingerprint {
        let mut out = Fingerprint::new();
        // Paths may move; what is in the files may not.
        let mut content = scene.clone();
        content.warnings.clear();
        for view in &mut content.views {
            out.insert(format!("image {}", view.name), hash_file(&std::mem::take(&mut view.image)));
            if let Some(mask) = view.mask.take() {
                out.insert(format!("mask {}", view.name), hash_file(&mask));
            }
        }
        let text = serde_json::to_string(&content).unwrap_or_default();
        out.insert("cameras, suns, roles".into(), hash(text.as_bytes()));
        out.insert("--height-range".into(), format!("{heights:?}"));
        out.insert("--fixed".into(), self.fixed.to_string());
        out
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    let scene = args.scene.read(args.height_range, ui)?;
    let heights = args.heights(&scene)?;
    refuse_output_inside(&args.output, args.scene.path())?;
    let stage = Stage::new(
        &args.output,
        "ba",
        &["scene.json", "ba/report.json", "ba/points.laz"],
        args.fingerprint(&scene, heights),
    );
    if stage.is_done(args.overwrite)? {
        ui.note(&format!("`{}` is adjusted already", args.output.display()));
        return Ok(());
    }
    let started = std::time::Instant::now();
    let options = Options { fixed: args.fixed, height_range: heights };
    let adjustment = adjust(&scene, &options, &|e| ui.show(e))?;
    let used = Scene {
        views: scene.views.into_iter().filter(|v| adjustment.cameras.iter().any(|c| c.0 == v.name)).collect(),
        ..scene
    };
    adjustment.write(&args.output.join("ba"), &used)?;
    write_json(&args.output.join("scene.json"), &used)?;
    stage.complete()?;
    let seconds = started.elapsed().as_secs_f64();
    let text = format!("{}adjusted in {seconds:.1} s", adjustment.report.table());
    let mut json = serde_json::to_value(&adjustment.report).unwrap_or_default();
    json["seconds"] = seconds.into();
    ui.summary("ba", &text, json);
    Ok(())
}

/// A run folder among the images would be read as part of the scene the next time.
fn refuse_output_inside(output: &Path, scene: &Path) -> Result<(), Failure> {
    let absolute = |p: &Path| std::fs::canonicalize(p).ok();
    let same = absolute(output).is_some_and(|o| Some(o) == absolute(scene));
    if same {
        let message = format!("the output `{}` is the scene itself", output.display());
        return Err(Failure::input(message, "-o takes another folder"));
    }
    Ok(())
}
