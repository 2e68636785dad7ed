//! `satgs ba`: bundle adjustment.

use super::perspective_args::PerspectiveArgs;
use super::scene_args::SceneArgs;
use super::{CliError, Ui, parse_metres};
use crate::bundle::{CorrectionModel, LeftOut};
use crate::pipeline::{AdjustOptions, Adjusted, DemOptions, adjust};
use crate::run::AnyScene;
use crate::run_files::{ADJUSTMENT, ADJUSTMENT_REPORT};
use crate::scene::Scene;
use std::path::{Path, PathBuf};

/// Correct the RPC cameras by bundle adjustment: writes RUN/ba
///
/// Detects SIFT keypoints, matches them along epipolar curves within the height range, links matches into tracks, and estimates a
/// shift of each image (--model). RUN/ba gets the corrected RPCs (rpcs/, a JSON and a _RPC.TXT file per view,
/// the shift added to the offsets), sparse points (points.laz, points.ply), tie points
/// (tie_points.csv, tie_points.gpkg), plots of the residuals, and report.json.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "adjustment")]
pub struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Run folder: the folder for all results
    #[arg(short, long, value_name = "RUN")]
    output: PathBuf,
    /// Lowest and highest height of tie points and of the surface, metres above the ellipsoid
    ///
    /// [default: from --dem, else from the images' metadata, else from the RPCs; the surface is then searched from at most 100 m
    /// below to 200 m above the tie points]
    #[arg(
        long, value_name = "LOW,HIGH", value_parser = parse_range, allow_hyphen_values = true,
        help_heading = "Matching"
    )]
    height_range: Option<(f64, f64)>,
    /// Elevation model that gives the height range
    ///
    /// It replaces --height-range: from 20 m below its lowest to 80 m above its highest height.
    #[arg(long, value_name = "FILE", conflicts_with = "height_range", help_heading = "Matching")]
    dem: Option<PathBuf>,
    /// Vertical reference of the elevation model: `ellipsoid`, EGM84, EGM96, EGM2008 or a geoid grid (.gtx, .tif of PROJ)
    /// [default: as its CRS or VERTICAL_REFERENCE says]
    #[arg(
        long,
        value_name = "REFERENCE",
        requires = "dem",
        help_heading = "Matching",
        hide_short_help = true
    )]
    dem_vertical: Option<String>,
    /// Tie the height of the scene to the elevation model, with this standard deviation, metres
    ///
    /// Use 10 for SRTM, 5 for Copernicus. Points far above the model, such as roofs, get little weight [default: the height is that of
    /// the delivered RPCs].
    #[arg(
        long, value_name = "METRES", requires = "dem", conflicts_with = "fixed", value_parser = parse_metres, help_heading = "Cameras",
        hide_short_help = true
    )]
    dem_sigma: Option<f64>,
    /// Correction of each camera: `shift`, `shift-scale` or `affine`
    ///
    /// `shift` suits images up to 8,000 pixels a side and any small --aoi. The others also correct the drift of whole scenes; crops
    /// are too small to tell a drift from noise.
    #[arg(
        long, value_name = "MODEL", default_value = "shift", value_parser = parse_model, help_heading = "Cameras",
        hide_short_help = true
    )]
    model: CorrectionModel,
    /// Ground control points that fix the position of the scene
    ///
    /// A CSV file with the columns lon,lat,h,image,col,row,sigma_xy_m,sigma_h_m,sigma_px.
    #[arg(long, value_name = "FILE", help_heading = "Cameras")]
    gcps: Option<PathBuf>,
    /// View whose RPC is not corrected and defines the datum; repeatable
    #[arg(
        long,
        value_name = "VIEW",
        conflicts_with = "fixed",
        help_heading = "Cameras",
        hide_short_help = true
    )]
    reference: Vec<String>,
    /// Do not correct the RPCs: compute tie points, and report how well the RPCs agree
    #[arg(long, help_heading = "Cameras", hide_short_help = true)]
    fixed: bool,
    /// Compute again, and replace results that are there
    ///
    /// By default, results of the same input and options are kept, and results of others are an error.
    #[arg(long)]
    overwrite: bool,
}

fn parse_range(text: &str) -> Result<(f64, f64), String> {
    let numbers =
        text.split_once(',').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    numbers.ok_or_else(|| "expected LOW,HIGH in metres, e.g. -20,80".to_owned())
}

fn parse_model(text: &str) -> Result<CorrectionModel, String> {
    match text {
        "shift" => Ok(CorrectionModel::Shift),
        "shift-scale" => Ok(CorrectionModel::ShiftScale),
        "affine" => Ok(CorrectionModel::Affine),
        _ => Err("expected `shift`, `shift-scale` or `affine`".into()),
    }
}

impl Args {
    /// The run folder.
    pub fn output(&self) -> &Path {
        &self.output
    }

    /// Whether to replace what is there.
    pub fn overwrite(&self) -> bool {
        self.overwrite
    }

    /// Reads a satellite scene and shows its warnings.
    pub fn read(&self, ui: &Ui) -> Result<Scene, CliError> {
        self.refuse_output_inside()?;
        self.scene.read(self.height_range, ui)
    }

    /// Whether the scene is one of photographs.
    pub fn is_of_photographs(&self) -> bool {
        self.scene.is_of_photographs()
    }

    /// Reads a scene of either kind and shows its warnings.
    pub fn read_any(&self, of_photographs: &PerspectiveArgs, ui: &Ui) -> Result<AnyScene, CliError> {
        self.refuse_output_inside()?;
        self.scene.read_any(of_photographs, self.height_range, ui)
    }

    /// A run folder among the images would be read as part of the scene the next time.
    fn refuse_output_inside(&self) -> Result<(), CliError> {
        let absolute = |p: &Path| std::fs::canonicalize(p).ok();
        let is_same = absolute(&self.output).is_some_and(|o| Some(o) == absolute(self.scene.path()));
        if is_same {
            let message = format!("the output `{}` is the scene itself", self.output.display());
            return Err(CliError::input(message, "choose another folder for -o"));
        }
        Ok(())
    }

    /// The options as the library takes them.
    pub fn options(&self) -> AdjustOptions {
        let dem = |path: &PathBuf| DemOptions {
            path: path.clone(),
            vertical: self.dem_vertical.clone(),
            sigma_m: self.dem_sigma,
        };
        AdjustOptions {
            model: self.model,
            fixed: self.fixed,
            height_range: self.height_range,
            dem: self.dem.as_ref().map(dem),
            gcps: self.gcps.clone(),
            reference_views: self.reference.clone(),
            overwrite: self.overwrite,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let scene = args.read(ui)?;
    let adjusted = adjust(&scene, &args.options(), &args.output, ui)?;
    show(&adjusted, ui)?;
    require_all(&args.output, adjusted.left_out(), ui)
}

/// Shows the summary of an adjustment.
pub fn show(adjusted: &Adjusted, ui: &Ui) -> Result<(), CliError> {
    if adjusted.was_complete {
        return ui.kept("ba", Some(adjusted));
    }
    let text = adjusted.seconds.map(|seconds| {
        format!("{}display gamma {}; adjusted in {seconds:.1} s", adjusted.report.table(), adjusted.gamma)
    });
    ui.summary("ba", text.as_deref(), adjusted)
}

/// Views that were left out make an adjustment partial.
pub fn require_all(run: &Path, left_out: &[LeftOut], ui: &Ui) -> Result<(), CliError> {
    if left_out.is_empty() {
        return Ok(());
    }
    let names: Vec<String> = left_out.iter().map(|(name, _)| format!("`{name}`")).collect();
    let message = format!("adjusted without {}", names.join(", "));
    let report = run.join(ADJUSTMENT).join(ADJUSTMENT_REPORT);
    let hint = format!("`{}` gives the reasons; everything else is complete", report.display());
    ui.partial(message, hint)
}
