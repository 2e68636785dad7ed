//! Coregistration of a run to a reference: `satgs align`.

use super::datum::warn_of_shift;
use super::relocation::{self, RECORD, Record};
use super::report::renew_report;
use super::run_folder::tiled::{require_no_tile, require_one_area};
use super::{PipelineError, RunLock, read_scene};
use crate::bundle::{Adjustment, check_control, control_pairs, read_control, stated_accuracy_m};
use crate::coregister::{Coregistration, to_control, to_surface};
use crate::frame::{Geodetic, Point, SiteGrid, Utm};
use crate::io::{MapGrid, VerticalReference, check_writable};
use crate::metrics::{HeightRaster, Truth, TruthOptions};
use crate::progress::{Event, Progress};
use crate::run_files::{ADJUSTMENT, CHECKPOINT, DSM, TRAIN_STAGE};
use crate::scene::Scene;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Smaller shifts are not applied, metres.
const NO_SHIFT_M: f64 = 0.01;
/// Cell of the grid that lidar points are put on, and how far it reaches beyond the run's, metres.
const LIDAR_CELL_M: f64 = 0.5;
const MARGIN_M: f64 = 40.0;

/// What to align to.
#[derive(Clone, Debug, Default)]
pub struct AlignOptions {
    /// A surface model on a map in metres, lidar points (.las, .laz), or ground control points (.csv).
    pub reference: PathBuf,
    /// Vertical reference of its heights: `ellipsoid`, a geoid model or a geoid's grid; by default what the file says,
    /// else the ellipsoid.
    pub vertical: Option<String>,
    /// EPSG code of a point cloud that does not state its own.
    pub epsg: Option<u32>,
}

/// The shift to a reference.
#[derive(Clone, Debug, Serialize)]
pub struct Aligned {
    /// The reference.
    pub reference: PathBuf,
    /// The shift and what it leaves.
    pub alignment: Coregistration,
    /// Whether the run was moved: shifts below a centimetre are not applied.
    #[serde(skip)]
    pub was_moved: bool,
}

/// Aligns a run to a reference: one shift (east, north, up) of everything that it holds, all files or none.
///
/// # Errors
/// [`PipelineError`]: the run is not adjusted, is in use or its training is not complete, the reference cannot be read
/// or is of another place, a file cannot be written.
pub fn align(run: &Path, options: &AlignOptions, progress: &dyn Progress) -> Result<Aligned, PipelineError> {
    let _lock = RunLock::existing(run)?;
    relocation::finish_locked(run)?;
    if require_one_area(run).and_then(|()| require_no_tile(run)).is_err() {
        return Err(PipelineError::TilesNotMoved { run: run.into() });
    }
    let scene = read_scene(run)?;
    check_writable(&run.join(RECORD))?;
    if run.join(TRAIN_STAGE).join(CHECKPOINT).exists() {
        return Err(PipelineError::TrainingIncomplete { run: run.into() });
    }
    let adjustment = Adjustment::read_with_observations(&run.join(ADJUSTMENT))?;
    let at = adjustment.points.first().map(|p| p.position);
    let at = at.ok_or_else(|| PipelineError::NoSparsePoints { run: run.into() })?;
    let map = SiteGrid::at(at)?;
    let alignment = find_shift(run, options, &scene, &adjustment, &map, progress)?;
    progress.check()?;
    warn_of_shift(&format!("`{}`", options.reference.display()), &alignment.shift, at, progress);
    let left_out = alignment.fit.as_ref().and_then(|fit| fit.left_out_text());
    let left_out =
        left_out.map(|names| format!("points that disagree with the others are left out: {names}"));
    for warning in alignment.open_text().into_iter().chain(left_out) {
        progress.event(Event::Warning(warning));
    }
    let was_moved = alignment.shift.length_m() >= NO_SHIFT_M;
    if was_moved {
        let before = Record::read(run)?;
        let total = before.map_or(alignment.shift, |b| alignment.shift.after(&b.total));
        let step = alignment.shift.on_ground(&map, at);
        let record = Record { reference: options.reference.clone(), last: alignment.clone(), total };
        relocation::relocate(run, &scene, adjustment, step, &record, progress)?;
        renew_report(run)?;
    }
    Ok(Aligned { reference: options.reference.clone(), alignment, was_moved })
}

/// The shift from the run to the reference.
fn find_shift(
    run: &Path,
    options: &AlignOptions,
    scene: &Scene,
    ours: &Adjustment,
    map: &SiteGrid,
    progress: &dyn Progress,
) -> Result<Coregistration, PipelineError> {
    if options.reference.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) {
        let control = read_control(&options.reference)?;
        check_control(&options.reference, &control, scene)?;
        let pairs = control_pairs(&control, scene, ours)?;
        return Ok(to_control(&pairs, stated_accuracy_m(&control), map, &options.reference)?);
    }
    let (points, epsg) = points(run, &ours.positions(), map)?;
    let corner = |of: fn(Point<Utm>) -> f64| {
        let values = points.iter().map(|p| of(*p));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)))
    };
    let ((w, e), (s, n)) = (corner(Point::x), corner(Point::y));
    let around = (w - MARGIN_M, s - MARGIN_M, e + MARGIN_M, n + MARGIN_M);
    let truth_options = TruthOptions {
        vertical: options.vertical.as_deref().map(VerticalReference::read).transpose()?,
        epsg: options.epsg,
        ..TruthOptions::default()
    };
    let mut reference =
        Truth::read(&options.reference, &truth_options, &MapGrid::covering(epsg, around, LIDAR_CELL_M))?;
    if reference.surface.vertical.is_none() {
        progress.event(Event::Note(format!(
            "`{}` does not state its vertical reference: ellipsoidal heights are assumed, --vertical sets another",
            options.reference.display()
        )));
    }
    let lifted = reference.surface.to_ellipsoid()?;
    for note in lifted
        .iter()
        .chain(truth_options.vertical.is_some().then_some(&reference.notes).into_iter().flatten())
    {
        progress.event(Event::Note(note.clone()));
    }
    Ok(to_surface(&points, epsg, &reference.surface)?)
}

/// The run's surface: the cells of dsm.tif, else the sparse points; above the ellipsoid, with their map's EPSG code.
fn points(
    run: &Path,
    sparse: &[Point<Geodetic>],
    map: &SiteGrid,
) -> Result<(Vec<Point<Utm>>, u32), PipelineError> {
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
