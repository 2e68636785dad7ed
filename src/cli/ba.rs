//! `satgs ba`: bundle adjustment.

use super::run_folder::{read_scene, write_json};
use super::scene_args::SceneArgs;
use super::stage::{Fingerprint, Stage, hash, hash_file, or_none};
use super::{Failure, Ui, align, parse_metres, run_lock};
use crate::bundle::{
    Adjustment, HeightPrior, LeftOut, Model, Options, Report, adjust, check_control, read_control,
};
use crate::io::Vertical;
use crate::run_files::{ADJUSTMENT, ADJUSTMENT_REPORT, SCENE, SPARSE_POINTS};
use crate::scene::{Dem, Scene, sources_of};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Correct the RPCs by bundle adjustment: RUN/ba/rpcs, points.laz and .ply, tie_points.csv and .gpkg, report.json,
/// pictures
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
    /// What its heights count from: `ellipsoid`, EGM84, EGM96, EGM2008 or a geoid grid (.gtx, .tif of PROJ) [default: as its
    /// CRS or VERTICAL_REFERENCE says]
    #[arg(long, value_name = "REFERENCE", requires = "dem")]
    dem_vertical: Option<String>,
    /// Hold the height of the scene by the elevation model, to so many metres (SRTM 10, Copernicus 5); what stands above it
    /// counts little [default: heights are those of the delivered cameras]
    #[arg(long, value_name = "METRES", requires = "dem", conflicts_with = "fixed", value_parser = parse_metres)]
    dem_sigma: Option<f64>,
    /// What is corrected: `shift` (images up to 8,000 pixels a side, and any small --aoi), `shift-scale`, or `affine`;
    /// the latter two are for whole scenes: a crop of one is too small to tell a drift from noise
    #[arg(long, value_name = "MODEL", default_value = "shift", value_parser = parse_model)]
    model: Model,
    /// Surveyed points, which then fix the datum: CSV with the columns lon,lat,h,image,col,row,sigma_xy_m,sigma_h_m,sigma_px
    #[arg(long, value_name = "FILE")]
    gcps: Option<PathBuf>,
    /// View whose RPC is trusted and not corrected: the datum is its own; may be given several times
    #[arg(long, value_name = "VIEW", conflicts_with = "fixed")]
    reference: Vec<String>,
    /// Leave the RPCs as they are: tracks, points, and a report of how well they agree
    #[arg(long)]
    fixed: bool,
    /// Redo what RUN holds, of the same or of other input and options
    #[arg(long)]
    overwrite: bool,
}

/// Fields of a scene and of its views that options set, and other names a user knows them by.
const SCENE_FIELDS: [(&str, &str); 10] = [
    ("aoi", "--aoi"),
    ("tone", "--gamma"),
    ("name", "names of the views"),
    ("window", "windows of the images (--aoi)"),
    ("bands", "--bands"),
    ("stretch_percent", "--stretch"),
    ("rpc", "cameras"),
    ("rpc_source", "files of the cameras (--rpcs)"),
    ("sun", "suns (--sun)"),
    ("role", "roles (test.txt)"),
];
/// Longest text of a field that is shown when it differs.
const SHOWN_LENGTH: usize = 200;

fn parse_range(text: &str) -> Result<(f64, f64), String> {
    let numbers =
        text.split_once(',').and_then(|(a, b)| Some((a.trim().parse().ok()?, b.trim().parse().ok()?)));
    numbers.ok_or_else(|| format!("`{text}` is not LOW,HIGH"))
}

fn parse_model(text: &str) -> Result<Model, String> {
    match text {
        "shift" => Ok(Model::Shift),
        "shift-scale" => Ok(Model::ShiftScale),
        "affine" => Ok(Model::Affine),
        _ => Err("expected `shift`, `shift-scale` or `affine`".into()),
    }
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

    /// The elevation model, if there is one.
    fn dem(&self, scene: &Scene) -> Result<Option<Dem>, Failure> {
        let Some(dem) = &self.dem else { return Ok(None) };
        let vertical = self.dem_vertical.as_deref().map(Vertical::read).transpose()?;
        Ok(Some(scene.dem(dem, vertical.as_ref())?))
    }

    fn fingerprint(&self, scene: &Scene, heights: Option<(f64, f64)>) -> Fingerprint {
        let mut out = Fingerprint::new();
        // Paths may move; what is in the files may not.
        let mut content = scene.clone();
        content.warnings.clear();
        for view in &mut content.views {
            // What is no image may be told beside the image as well.
            if let Ok(Some(valid)) = view.valid_pixels() {
                out.insert(format!("valid pixels {}", view.name), valid.digest());
            }
            for (i, source) in sources_of(&view.image).iter().enumerate() {
                out.insert(format!("image {}, source {}", view.name, i + 1), hash_file(source));
            }
            out.insert(format!("image {}", view.name), hash_file(&std::mem::take(&mut view.image)));
            if let Some(mask) = view.mask.take() {
                out.insert(format!("mask {}", view.name), hash_file(&mask));
            }
        }
        out.extend(scene_fields(&content));
        out.insert("--height-range".into(), or_none(heights.map(|(low, high)| format!("{low},{high}"))));
        out.insert("--fixed".into(), self.fixed.to_string());
        out.insert("--model".into(), format!("{:?}", self.model));
        if !self.reference.is_empty() {
            out.insert("--reference".into(), self.reference.join(", "));
        }
        if let (Some(dem), Some(sigma_m)) = (&self.dem, self.dem_sigma) {
            out.insert("--dem".into(), hash_file(dem));
            out.insert("--dem-sigma".into(), sigma_m.to_string());
            out.insert("--dem-vertical".into(), or_none(self.dem_vertical.as_ref()));
        }
        if let Some(gcps) = &self.gcps {
            out.insert("--gcps".into(), hash_file(gcps));
        }
        out
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    require_all(&args.output, &adjust_run(args, ui)?)
}

/// Views that were left out make an adjustment partial.
pub fn require_all(run: &Path, left_out: &[LeftOut]) -> Result<(), Failure> {
    if left_out.is_empty() {
        return Ok(());
    }
    let names: Vec<String> = left_out.iter().map(|(name, _)| format!("`{name}`")).collect();
    let message = format!("adjusted without {}", names.join(", "));
    let report = run.join(ADJUSTMENT).join(ADJUSTMENT_REPORT);
    Err(Failure::partial(message, format!("`{}` says why; all else is complete", report.display())))
}

/// Adjusts a run folder, unless that is done already. Gives the views that were left out.
pub fn adjust_run(args: &Args, ui: &Ui) -> Result<Vec<LeftOut>, Failure> {
    let scene = args.scene.read(args.height_range, ui)?;
    let dem = args.dem(&scene)?;
    let heights = dem.as_ref().map(Dem::heights_to_search).or(args.height_range);
    refuse_output_inside(&args.output, args.scene.path())?;
    run_lock::make_and_lock(&args.output)?;
    let folder = args.output.join(ADJUSTMENT);
    let outputs = vec![args.output.join(SCENE), folder.join(ADJUSTMENT_REPORT), folder.join(SPARSE_POINTS)];
    let stage = Stage::new(&args.output, ADJUSTMENT, outputs, args.fingerprint(&scene, heights));
    let keypoints = folder.join("keypoints");
    if stage.is_done(args.overwrite)? {
        forget(&keypoints);
        find_files_again(&args.output, &scene)?;
        ui.note(&format!("`{}` is adjusted already", args.output.display()));
        let report = Adjustment::read(&folder)?.report;
        let seconds = stage.summary().map(|s| s["seconds"].clone()).unwrap_or_default();
        ui.repeat_summary("ba", Some(summary(&report, seconds)));
        return Ok(report.left_out);
    }
    stage.require_writable()?;
    let started = std::time::Instant::now();
    let control = args.gcps.as_deref().map(read_control).transpose()?.unwrap_or_default();
    if let Some(path) = &args.gcps {
        check_control(path, &control, &scene)?;
    }
    let options = Options {
        fixed: args.fixed,
        model: args.model,
        height_range: heights,
        control,
        reference: args.reference.clone(),
        height_prior: dem.zip(args.dem_sigma).map(|(dem, sigma_m)| HeightPrior { dem, sigma_m }),
        keypoints: Some(keypoints.clone()),
    };
    let adjustment = adjust(&scene, &options, ui)?;
    let used = Scene {
        views: scene.views.into_iter().filter(|v| adjustment.cameras.iter().any(|c| c.0 == v.name)).collect(),
        ..scene
    };
    adjustment.write(&folder, &used)?;
    align::forget(&args.output)?;
    write_json(&args.output.join(SCENE), &used)?;
    let seconds = started.elapsed().as_secs_f64();
    // The rest of the summary is the report, which alignment changes.
    stage.complete(&serde_json::json!({ "seconds": seconds }))?;
    forget(&keypoints);
    let text = format!("{}adjusted in {seconds:.1} s", adjustment.report.table());
    ui.summary("ba", &text, summary(&adjustment.report, seconds.into()));
    Ok(adjustment.report.left_out)
}

/// What `--json` says of an adjustment.
fn summary(report: &Report, seconds: Value) -> Value {
    let mut json = serde_json::to_value(report).unwrap_or_default();
    json["seconds"] = seconds;
    json
}

/// What a scene holds beside its files, by what a user calls it: as text where that is short, else as a hash.
fn scene_fields(scene: &Scene) -> Fingerprint {
    let mut out = Fingerprint::new();
    let mut insert = |field: &str, value: String| {
        let name = SCENE_FIELDS.iter().find(|f| f.0 == field).map_or(field, |f| f.1);
        out.insert(name.into(), if value.len() > SHOWN_LENGTH { hash(value.as_bytes()) } else { value });
    };
    let Ok(Value::Object(fields)) = serde_json::to_value(scene) else { return out };
    for (field, value) in fields.iter().filter(|f| f.0 != "views") {
        insert(field, value.to_string());
    }
    let mut by_field = BTreeMap::<&str, Vec<(&Value, &Value)>>::new();
    for view in fields["views"].as_array().into_iter().flatten() {
        for (field, value) in view.as_object().into_iter().flatten() {
            by_field.entry(field).or_default().push((&view["name"], value));
        }
    }
    for (field, values) in by_field {
        let first = values[0].1;
        let is_common = values.len() == scene.views.len() && values.iter().all(|v| v.1 == first);
        let all: Vec<String> = values.iter().map(|(view, value)| format!("{view}: {value}")).collect();
        insert(field, if is_common { first.to_string() } else { all.join(", ") });
    }
    out
}

/// Tells an adjusted run where the scene's images are by now: they may have moved.
fn find_files_again(run: &Path, scene: &Scene) -> Result<(), Failure> {
    let before = read_scene(run)?;
    let mut used = before.clone();
    for view in &mut used.views {
        if let Some(now) = scene.views.iter().find(|v| v.name == view.name) {
            (view.image, view.mask) = (now.image.clone(), now.mask.clone());
        }
    }
    if used == before { Ok(()) } else { write_json(&run.join(SCENE), &used) }
}

/// Removes keypoints that an adjustment kept; what is left behind does no harm.
fn forget(keypoints: &Path) {
    let _ = std::fs::remove_dir_all(keypoints);
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
