//! `satgs align`: one shift that brings everything a run holds to a reference.

use super::run_folder::{TrainedCameras, read_json, read_scene, write_json};
use super::stage::Stage;
use super::{Failure, Ui, run_lock};
use crate::bundle::{Adjustment, check_control, control_pairs, read_control};
use crate::coregister::{Coregistration, Shift, to_control, to_surface};
use crate::frame::{Geodetic, Point, SiteGrid, Utm};
use crate::io::{MapGrid, VerticalReference, WriteError, check_writable, write_moved};
use crate::metrics::{HeightRaster, Truth, TruthOptions};
use crate::run_files::{
    ADJUSTMENT, CAMERAS, CHECKPOINT, CONFIDENCE, DSM, FIRST_SURFACE, HILLSHADE, ORTHO, SPLATS, SURFACE,
};
use crate::scene::Scene;
use crate::splat::ply;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Move a run to where a reference says it is: one shift east, north and up for everything it holds
///
/// Finds the shift from RUN/dsm.tif, or from the sparse points of a run that has none, and applies it to the corrected
/// RPCs, points and tie points of RUN/ba, to cameras.json, the splats, the surfaces of RUN/train, dsm.tif, ortho.tif,
/// confidence.tif and hillshade.tif: all of them or none. RUN/align.json says how far. Scores in RUN/eval and files made elsewhere
/// (--points, --mesh, pictures) stay as they are; `satgs dsm RUN` makes the surface anew on whole cells.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Folder that `satgs ba -o RUN` made, and perhaps later stages filled
    run: PathBuf,
    /// A surface model (any GDAL raster on a map in metres, DFC2019's .tif with its .txt), lidar points (.las, .laz), or
    /// surveyed points (.csv, as `satgs ba --gcps` takes them)
    #[arg(long, value_name = "REFERENCE")]
    to: PathBuf,
    /// What the reference's heights count from: `ellipsoid`, EGM84, EGM96, EGM2008 or a geoid grid (.gtx, .tif of PROJ)
    /// [default: as its CRS or VERTICAL_REFERENCE says, else the ellipsoid]
    #[arg(long, value_name = "REFERENCE")]
    vertical: Option<String>,
    /// EPSG code of lidar points whose file does not tell
    #[arg(long, value_name = "EPSG")]
    crs: Option<u32>,
}

/// The record, in the run's folder, and where what is moved waits until all of it is there.
const RECORD: &str = "align.json";
const PENDING: &str = "align.pending";
/// Rasters that move, those whose first band holds heights, and the others.
const HEIGHTS: [&str; 3] = [DSM, SURFACE, FIRST_SURFACE];
const MAPS: [&str; 3] = [ORTHO, CONFIDENCE, HILLSHADE];
/// Smaller shifts are none, metres.
const NO_SHIFT_M: f64 = 0.01;
/// Cell of the grid that lidar points are put on, and how far it reaches beyond the run's, metres.
const LIDAR_CELL_M: f64 = 0.5;
const MARGIN_M: f64 = 40.0;

/// `RUN/align.json`.
#[derive(Serialize, Deserialize)]
struct Record {
    /// What the run was moved to last.
    reference: PathBuf,
    /// How, and what is left.
    #[serde(flatten)]
    last: Coregistration,
    /// All shifts since the adjustment together.
    total: Shift,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    let run = &args.run;
    run_lock::lock(run)?;
    finish(run)?;
    let scene = read_scene(run)?;
    check_writable(&run.join(RECORD))?;
    if run.join(CHECKPOINT).exists() {
        let message = format!("`{}` holds a training that is not complete", run.display());
        return Err(Failure::input(message, "`satgs train RUN` completes it"));
    }
    let adjustment = Adjustment::read_with_observations(&run.join(ADJUSTMENT))?;
    let at = adjustment.points.first().map(|p| p.position);
    let at = at.ok_or_else(|| Failure::input("the run has no sparse points", "`satgs ba` makes them"))?;
    let map = SiteGrid::at(at)?;
    let found = alignment(args, &scene, &adjustment, &map, ui)?;

    let Shift { east_m, north_m, up_m } = found.shift;
    let text = format!(
        "{east_m:+.3} m east, {north_m:+.3} m north, {up_m:+.3} m up, from {} points; {:.2} m are left in the median",
        found.points, found.left_m
    );
    let json = serde_json::json!({ "reference": args.to, "alignment": found });
    if found.shift.length_m() < NO_SHIFT_M {
        ui.summary("align", &format!("`{}` is aligned already: {text}", run.display()), json);
        return Ok(());
    }
    let before =
        run.join(RECORD).exists().then(|| read_json::<Record>(&run.join(RECORD), "remove it")).transpose()?;
    let total = before.map_or(found.shift, |b| found.shift.after(&b.total));
    let record = Record { reference: args.to.clone(), last: found, total };
    let pending =
        tempfile::Builder::new().prefix(".satgs-align-").tempdir_in(run).map_err(|e| failed(run, e))?;
    stage(run, pending.path(), &scene, adjustment, found.shift.on_ground(&map, at), &record)?;
    // The one step that decides: before it nothing has moved, after it all will.
    let pending = pending.keep();
    std::fs::rename(&pending, run.join(PENDING)).map_err(|e| failed(run, e))?;
    finish(run)?;
    ui.summary("align", &format!("moved {text}"), json);
    Ok(())
}

/// The shift from the run to the reference.
fn alignment(
    args: &Args,
    scene: &Scene,
    ours: &Adjustment,
    map: &SiteGrid,
    ui: &Ui,
) -> Result<Coregistration, Failure> {
    if args.to.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) {
        let control = read_control(&args.to)?;
        check_control(&args.to, &control, scene)?;
        let pairs = control_pairs(&control, scene, ours)?;
        return Ok(to_control(&pairs, map, &args.to)?);
    }
    let (points, epsg) = points(&args.run, &ours.positions(), map)?;
    let corner = |of: fn(Point<Utm>) -> f64| {
        let values = points.iter().map(|p| of(*p));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
    };
    let ((w, e), (s, n)) = (corner(Point::x), corner(Point::y));
    let around = (w - MARGIN_M, s - MARGIN_M, e + MARGIN_M, n + MARGIN_M);
    let options = TruthOptions {
        vertical: args.vertical.as_deref().map(VerticalReference::read).transpose()?,
        epsg: args.crs,
        ..TruthOptions::default()
    };
    let mut reference = Truth::read(&args.to, &options, &MapGrid::covering(epsg, around, LIDAR_CELL_M))?;
    if reference.surface.vertical.is_none() {
        ui.note(&format!(
            "`{}` does not say what its heights count from: the ellipsoid is assumed, --vertical tells",
            args.to.display()
        ));
    }
    let lifted = reference.surface.to_ellipsoid()?;
    for note in
        lifted.iter().chain(options.vertical.is_some().then_some(&reference.notes).into_iter().flatten())
    {
        ui.note(note);
    }
    Ok(to_surface(&points, epsg, &reference.surface)?)
}

/// The run's surface: the cells of dsm.tif, else the sparse points; above the ellipsoid, with their map's EPSG code.
fn points(run: &Path, sparse: &[Point<Geodetic>], map: &SiteGrid) -> Result<(Vec<Point<Utm>>, u32), Failure> {
    let path = run.join(DSM);
    if !path.exists() {
        return Ok((sparse.iter().map(|p| map.utm_from_geodetic(*p)).collect(), map.epsg));
    }
    let HeightRaster { grid, height, vertical, .. } = HeightRaster::read(&path)?;
    let vertical = VerticalReference::read(vertical.as_deref().unwrap_or("ellipsoid"))?;
    let middle = SiteGrid { epsg: grid.epsg, ..*map }
        .geodetic_from_utm(grid.cell_center(grid.width / 2, grid.height / 2));
    // A geoid is level over a run's area to centimetres.
    let up = vertical.undulation_m(middle.lon_deg(), middle.lat_deg());
    let cells = height.data.iter().enumerate().filter(|(_, z)| !z.is_nan());
    let points = cells
        .map(|(i, z)| grid.cell_center(i % grid.width, i / grid.width).at_height(f64::from(*z) + up))
        .collect();
    Ok((points, grid.epsg))
}

/// Writes everything the run holds, moved, into a folder of the same layout.
fn stage(
    run: &Path,
    to: &Path,
    scene: &Scene,
    adjustment: Adjustment,
    step: [f64; 3],
    record: &Record,
) -> Result<(), Failure> {
    let shift = record.last.shift;
    let mut adjustment = adjustment.moved_on_ground(step);
    adjustment.report.gauge = format!("aligned to {}", record.reference.display());
    for c in &mut adjustment.report.control {
        c.moved_m = std::array::from_fn(|k| c.moved_m[k] + shift.enu()[k]);
    }
    adjustment.write(&to.join(ADJUSTMENT), scene)?;
    if run.join(CAMERAS).exists() {
        let mut cameras = TrainedCameras::read(run)?;
        let origin = cameras.setup.site.origin;
        let [x, y, z] = origin.xyz();
        cameras.setup.site.origin = Point::new(x + shift.east_m, y + shift.north_m, z + shift.up_m);
        write_json(&to.join(CAMERAS), &cameras)?;
        let splats = ply::read(&run.join(SPLATS))?;
        ply::write(&to.join(SPLATS), &splats, &cameras.setup.site)?;
    }
    let heights = HEIGHTS.iter().map(|name| (name, shift.enu()));
    let maps = MAPS.iter().map(|name| (name, [shift.east_m, shift.north_m, 0.0]));
    for (name, by) in heights.chain(maps).filter(|(name, _)| run.join(name).exists()) {
        write_moved(&run.join(name), &to.join(name), by)?;
    }
    write_json(&to.join(RECORD), record)
}

/// Forgets that a run was aligned, for it is adjusted anew.
pub(super) fn forget(run: &Path) -> Result<(), Failure> {
    let gone = [std::fs::remove_file(run.join(RECORD)), std::fs::remove_dir_all(run.join(PENDING))];
    let refused = gone.into_iter().filter_map(Result::err).find(|e| e.kind() != std::io::ErrorKind::NotFound);
    refused.map_or(Ok(()), |e| Err(failed(run, e)))
}

/// Puts what waits in its place, also what an interrupted command left.
pub(super) fn finish(run: &Path) -> Result<(), Failure> {
    let pending = run.join(PENDING);
    if !pending.exists() {
        return Ok(());
    }
    // Another command may be about to do this.
    run_lock::lock(run)?;
    if !pending.exists() {
        return Ok(());
    }
    // The surface is to be made anew on whole cells the next time somebody asks for it.
    Stage::new(run, "dsm", Vec::new(), Default::default()).forget()?;
    put(&pending, run).map_err(|e| failed(run, e))?;
    std::fs::remove_dir_all(&pending).map_err(|e| failed(run, e))
}

/// Moves the files of a folder into another, over those that are there.
fn put(from: &Path, to: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(from)? {
        let (entry, target) = entry.map(|e| (e.path(), to.join(e.file_name())))?;
        if entry.is_dir() {
            std::fs::create_dir_all(&target)?;
            put(&entry, &target)?;
        } else {
            std::fs::rename(&entry, &target)?;
        }
    }
    Ok(())
}

fn failed(run: &Path, error: std::io::Error) -> Failure {
    WriteError::new(run, error).into()
}
