//! The job of one tile: an ordinary training and surface on the tile's box of ground.

use super::done::{Done, Failure, seal, tile_folder};
use super::error::TilesError;
use super::plan::{Plan, PlannedFile, Tile, TileSurface, TileTraining};
use super::resources::free_disk_mb;
use crate::affine::SiteFrame;
use crate::bundle::Adjustment;
use crate::frame::{Point, SiteGrid, Utm};
use crate::io::{Window, WriteError, available_memory_mb, peak_memory_mb, read_json, remove_if_there};
use crate::io::{reset_peak_memory, write_json};
use crate::pipeline::{
    DsmOptions, ErrorKind, Fingerprint, Outcome, PipelineError, RunLock, Stage, TrainOptions, dsm_locked,
    read_scene, train_locked,
};
use crate::progress::{Event, Progress};
use crate::run_files::{
    ADJUSTMENT, ADJUSTMENT_REPORT, CAMERAS, CONFIDENCE, DONE, DSM, FAILURE, ORTHO, SCENE, SPARSE_POINTS,
    SPLATS, STAGE,
};
use crate::scene::{Scene, View};
use crate::splat::backend::DeviceChoice;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Files of a tile that `done.json` lists.
const FILES: [&str; 5] = [SPLATS, CAMERAS, DSM, ORTHO, CONFIDENCE];
/// Record of what is being made in a tile's folder.
const INPUT: &str = "input.json";
/// Megabytes of disk that a tile needs, as a share of its memory: checkpoints and products.
const DISK_SHARE: f64 = 0.5;
/// Metres around a splat box in which sparse points are kept.
const POINTS_MARGIN_M: f64 = 1.0;

/// What a tile's folder is being made from.
#[derive(Serialize, Deserialize)]
struct Input {
    input_hash: String,
}

/// Trains and renders one tile, unless that was done with the same input; continues from its checkpoint.
///
/// Writes `RUN/tiles/ID`, and `done.json` in it last.
///
/// # Errors
/// [`TilesError`]: there is no plan or no such tile in it, the run was adjusted again since, memory or disk do not suffice,
/// another job works on the tile; also the errors of training and of the surface. A failure is recorded in the tile's
/// folder as `failed.json`.
pub fn run_tile(
    run: &Path,
    id: &str,
    checkpoint_every: u32,
    progress: &dyn Progress,
) -> Result<Outcome<Done>, TilesError> {
    let plan = Plan::read(run)?;
    plan.require_current(run)?;
    let tile = plan.tile(id).ok_or_else(|| TilesError::NoTile { id: id.into() })?;
    let folder = tile_folder(run, id);
    if let Some(done) = Done::of_tile(run, tile) {
        progress.event(Event::Note(format!("tile `{id}` is done already")));
        return Ok(Outcome::Kept(Some(done)));
    }
    let job = Job { run, plan: &plan, tile, folder, checkpoint_every };
    let _lock = RunLock::make(&job.folder).map_err(TilesError::of_lock)?;
    let made = job.make(progress);
    let noted = match &made {
        Ok(_) => remove_if_there(&job.folder.join(FAILURE)).map_err(TilesError::from),
        // Whoever interrupts a job starts it again; nothing has failed.
        Err(e) if e.kind() == ErrorKind::Interrupted => Ok(()),
        Err(e) => Failure { reason: e.chain() }.write(&job.folder),
    };
    // The failure itself matters more than that it cannot be recorded, on a full disk for instance.
    if let Err(e) = noted {
        progress.event(Event::Warning(e.chain()));
    }
    made.map(Outcome::Made)
}

struct Job<'a> {
    run: &'a Path,
    plan: &'a Plan,
    tile: &'a Tile,
    folder: PathBuf,
    checkpoint_every: u32,
}

impl Job<'_> {
    fn make(&self, progress: &dyn Progress) -> Result<Done, TilesError> {
        self.require_resources()?;
        let started = std::time::Instant::now();
        reset_peak_memory();
        self.set_up(progress)?;
        let trained = train_locked(&self.folder, &self.train_options()?, progress, &mut |_| Ok(()))?;
        let trained = trained.summary();
        dsm_locked(&self.folder, &self.dsm_options(), progress)?;
        let done = Done {
            input_hash: self.tile.input_hash.clone(),
            satgs: env!("CARGO_PKG_VERSION").into(),
            seconds: trained.map_or(0.0, |t| t.seconds).max(started.elapsed().as_secs_f64()),
            peak_memory_mb: peak_memory_mb(),
            splats: trained.map_or(0, |t| t.splats),
            files: seal(&self.folder, &FILES.map(String::from)).map_err(TilesError::of_own_file)?,
        };
        done.write(&self.folder)?;
        Ok(done)
    }

    /// An error if the machine has less memory or disk than the tile needs.
    fn require_resources(&self) -> Result<(), TilesError> {
        let needed_mb = self.tile.cost.memory_mb;
        let short = |what, available_mb: Option<f64>, needed_mb: f64| match available_mb {
            Some(available_mb) if available_mb < needed_mb => {
                Err(TilesError::Resources { id: self.tile.id.clone(), what, needed_mb, available_mb })
            }
            _ => Ok(()),
        };
        short("memory", available_memory_mb(), needed_mb)?;
        short("disk space", free_disk_mb(&self.folder), DISK_SHARE * needed_mb)
    }

    /// Makes the tile's run folder: its part of the scene and of the adjustment.
    ///
    /// An interrupted job of the same input is continued. Everything else that is there is removed: what was made from other
    /// input, and a complete tile whose files have changed since.
    fn set_up(&self, progress: &dyn Progress) -> Result<(), TilesError> {
        let record = self.folder.join(INPUT);
        let before: Option<Input> = read_json(&record).ok();
        let is_same = before.is_some_and(|input| input.input_hash == self.tile.input_hash);
        let was_done = self.folder.join(DONE).exists();
        if is_same && !was_done && self.folder.join(ADJUSTMENT).join(STAGE).exists() {
            return Ok(());
        }
        if is_same && was_done {
            let id = &self.tile.id;
            let text = format!("tile `{id}`: its files are not those that done.json names; it is made again");
            progress.event(Event::Warning(text));
        }
        clear(&self.folder)?;
        let (scene, adjustment) = self.part()?;
        write_json(&self.folder.join(SCENE), &scene)?;
        let ba = self.folder.join(ADJUSTMENT);
        adjustment.write_result(&ba, &scene).map_err(PipelineError::from)?;
        write_json(&record, &Input { input_hash: self.tile.input_hash.clone() })?;
        let outputs = vec![self.folder.join(SCENE), ba.join(ADJUSTMENT_REPORT), ba.join(SPARSE_POINTS)];
        let made_from = Fingerprint::from([("tile".into(), self.tile.input_hash.clone())]);
        Ok(Stage::new(&self.folder, ADJUSTMENT, outputs, made_from).complete_as("satgs tile run", &())?)
    }

    /// The tile's views, cropped to their windows, and the adjustment of these views and of the points in the box.
    fn part(&self) -> Result<(Scene, Adjustment), TilesError> {
        let whole = read_scene(self.run)?;
        let mut adjustment = Adjustment::read(&self.run.join(ADJUSTMENT)).map_err(PipelineError::from)?;
        let rpcs = adjustment.cameras_of(&whole).map_err(PipelineError::from)?;
        let mut views = Vec::new();
        for planned in &self.tile.views {
            let found = whole.views.iter().zip(&rpcs).find(|(view, _)| view.name == planned.name);
            let (view, rpc) = found
                .ok_or_else(|| TilesError::NoView { id: self.tile.id.clone(), view: planned.name.clone() })?;
            let view = View { rpc: rpc.clone(), stretch: planned.stretch, ..view.clone() };
            let outside = || TilesError::Window { id: self.tile.id.clone(), view: planned.name.clone() };
            views.push(view.cropped(within(&view, Window::from(planned)).ok_or_else(outside)?));
        }
        let [w, s, e, n] = self.tile.splat_box;
        let m = POINTS_MARGIN_M;
        let site = self.site();
        adjustment.keep(
            |name| self.tile.views.iter().any(|view| view.name == name),
            |place| {
                let p = site.utm_from_geodetic(place);
                (w - m..=e + m).contains(&p.x()) && (s - m..=n + m).contains(&p.y())
            },
        );
        let scene = Scene { views, aoi: None, warnings: Vec::new(), ..whole };
        Ok((scene, adjustment))
    }

    fn site(&self) -> SiteGrid {
        let [w, s, e, n] = self.tile.core;
        let origin: Point<Utm> =
            Point::new((0.5 * (w + e)).round(), (0.5 * (s + n)).round(), self.plan.origin_height_m);
        SiteGrid { epsg: self.plan.epsg, origin }
    }

    fn train_options(&self) -> Result<TrainOptions, TilesError> {
        let site = self.site();
        let ([w, s, e, n], [x, y, z]) = (self.tile.splat_box, site.origin.xyz());
        let above = |[low, high]: [f64; 2]| (low - z, high - z);
        let frame = SiteFrame {
            site,
            area: (w - x, s - y, e - x, n - y),
            altitudes: above(self.tile.heights_m),
            searched: above(self.tile.searched_m),
            reference: Some(self.tile.reference.clone()),
        };
        // All fields are named, so that none is forgotten.
        let TileTraining {
            recipe: _,
            recipe_hash: _,
            iterations,
            no_splats,
            seed,
            predict,
            snapshots,
            features,
            lpips,
        } = &self.plan.train;
        let path = |file: &Option<PlannedFile>| file.as_ref().map(PlannedFile::require_same).transpose();
        Ok(TrainOptions {
            recipe: self.plan.recipe_in(self.run),
            iterations: *iterations,
            no_splats: *no_splats,
            seed: *seed,
            predict: *predict,
            snapshots: *snapshots,
            features: path(features)?,
            lpips: path(lpips)?,
            checkpoint_every: self.checkpoint_every,
            frame: Some(frame),
            // Several tiles may train at a time.
            device: DeviceChoice::Cpu,
            ..TrainOptions::default()
        })
    }

    fn dsm_options(&self) -> DsmOptions {
        let (w, s, e, n) = self.plan.overlap_grid(self.tile).bounds();
        let TileSurface { vertical, vertical_hash: _, fill_m, no_fill } = &self.plan.surface;
        DsmOptions {
            resolution_m: self.plan.resolution_m,
            area: Some((w, s, e, n)),
            vertical: vertical.clone(),
            fill_m: *fill_m,
            no_fill: *no_fill,
            ..DsmOptions::default()
        }
    }
}

/// A window of the whole image in pixels of the view's used part; none if it is not inside.
fn within(view: &View, whole: Window) -> Option<Window> {
    let used = view.window.unwrap_or(Window { col: 0, row: 0, width: view.width, height: view.height });
    let (col, row) = (whole.col.checked_sub(used.col)?, whole.row.checked_sub(used.row)?);
    let is_inside = whole.width > 0
        && whole.height > 0
        && col.checked_add(whole.width)? <= used.width
        && row.checked_add(whole.height)? <= used.height;
    is_inside.then_some(Window { col, row, ..whole })
}

/// Removes what an earlier job left in a tile's folder, but for its lock.
fn clear(folder: &Path) -> Result<(), TilesError> {
    let failed = |e: std::io::Error| WriteError::new(folder, e);
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.ends_with(crate::run_files::LOCK) {
            continue;
        }
        let removed =
            if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
        removed.map_err(|e| WriteError::new(&path, e))?;
    }
    Ok(())
}
