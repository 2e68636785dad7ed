//! The page of a run that trains: `satgs view --live`.

use super::page_layers::{add_splats, add_tie_points};
use super::page_splats::PageSplats;
use super::run_folder::perspective_manifest;
use super::run_folder::tiled::require_one_area;
use super::view::{add_photographs, add_satellites, encoded, scope_of, title_of, view_page};
use super::{PerspectiveCameras, PipelineError, TrainedCameras};
use crate::io::read_json;
use crate::progress::{Event, Progress};
use crate::run_files::{CHECKPOINT, CHECKPOINT_CAMERAS, DSM, SPLATS, TRAIN_STAGE};
use crate::splat::state::TrainingState;
use crate::splat::train::checkpoint::Checkpoint;
use crate::viewer::{LiveState, PageScope, ViewerError, ViewerPage, bind, serve};
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

/// How often it looks for a new checkpoint.
const POLL: Duration = Duration::from_millis(500);

/// Serves the page of a run while it trains, as [`serve_page`](super::serve_page): the splats of each checkpoint, and at the end
/// the results. Waits for the first checkpoint before it calls `started`.
///
/// # Errors
/// [`PipelineError`]: there is no such folder, it is of several tiles, the port is in use, the first page cannot be made.
/// [`PipelineError::Interrupted`] at the end.
pub fn serve_live_page(
    run: &Path,
    port: Option<u16>,
    started: impl FnOnce(&str) -> Result<(), PipelineError>,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    if !run.is_dir() {
        return Err(ViewerError::NoSplats { run: run.into() }.into());
    }
    require_one_area(run)?;
    let (listener, address) = bind(port)?;
    let mut watched = Watched { run, seen: Vec::new(), version: 0 };
    if watched.stamps().iter().all(Option::is_none) {
        progress.event(Event::Note(format!("waiting for the first checkpoint of `{}`", run.display())));
    }
    let first = loop {
        progress.check()?;
        match watched.changed()? {
            Some(page) => break page,
            None => std::thread::sleep(POLL),
        }
    };
    started(&address)?;
    let page = Mutex::new(Arc::new(first));
    let is_over = AtomicBool::new(false);
    std::thread::scope(|threads| {
        threads.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                // A run whose files are just being replaced is looked at again when they are.
                if let Ok(Some(next)) = watched.changed() {
                    *page.lock().unwrap_or_else(PoisonError::into_inner) = Arc::new(next);
                }
                std::thread::sleep(POLL);
            }
        });
        let current = || page.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let ended = serve(&listener, &current, progress);
        is_over.store(true, Ordering::Relaxed);
        Ok(ended?)
    })
}

/// A run folder, and what was seen of it.
struct Watched<'a> {
    run: &'a Path,
    seen: Vec<Option<SystemTime>>,
    version: u64,
}

impl Watched<'_> {
    fn in_training(&self, name: &str) -> PathBuf {
        self.run.join(TRAIN_STAGE).join(name)
    }

    /// When the files that are shown were written.
    fn stamps(&self) -> Vec<Option<SystemTime>> {
        let files = [self.in_training(CHECKPOINT), self.run.join(SPLATS), self.run.join(DSM)];
        files.iter().map(|file| file.metadata().and_then(|m| m.modified()).ok()).collect()
    }

    /// The page, if there is something to show that was not shown before.
    fn changed(&mut self) -> Result<Option<ViewerPage>, PipelineError> {
        let stamps = self.stamps();
        if stamps == self.seen || stamps.iter().all(Option::is_none) {
            return Ok(None);
        }
        self.version += 1;
        let page = match stamps[0] {
            Some(_) => self.page_of_checkpoint()?,
            None if stamps[1].is_none() => return Ok(None),
            None => {
                let mut page = view_page(self.run)?;
                page.live = Some(LiveState::new(self.version, 0, &[]));
                page
            }
        };
        self.seen = stamps;
        Ok(Some(page))
    }

    fn page_of_checkpoint(&self) -> Result<ViewerPage, PipelineError> {
        let Checkpoint { log, state, .. } = Checkpoint::read(&self.in_training(CHECKPOINT))?;
        let (mut page, iterations) = if perspective_manifest::is_run(self.run) {
            self.photographs(state.into_owned())?
        } else {
            self.satellites(state.into_owned())?
        };
        let losses: Vec<f64> = log.iter().map(|line| line.loss).collect();
        page.live = Some(LiveState::new(self.version, iterations, &losses));
        Ok(page)
    }

    /// The page of a training of satellite images, and its number of iterations.
    fn satellites(&self, state: TrainingState) -> Result<(ViewerPage, u32), PipelineError> {
        let mut cameras: TrainedCameras = self.cameras()?;
        for ((_, own), (trained, _)) in cameras.appearances.iter_mut().zip(state.appearances) {
            *own = trained;
        }
        let splats = cameras.shown(state.splats);
        let setup = &cameras.setup;
        let scope = PageScope::of_area(setup.area);
        let mut page = ViewerPage::new(title_of(self.run), Some(&setup.site), scope);
        let encode = |splats: &_| encoded(splats, Some(&setup.site));
        add_splats(&mut page, PageSplats::new(&splats, scope, &self.prefix(), encode));
        add_tie_points(&mut page, self.run, setup)?;
        add_satellites(&mut page, setup);
        Ok((page, cameras.recipe.iterations))
    }

    /// The page of a training of photographs, and its number of iterations.
    fn photographs(&self, state: TrainingState) -> Result<(ViewerPage, u32), PipelineError> {
        let cameras: PerspectiveCameras = self.cameras()?;
        let splats = cameras.working_frame().leave_splats(state.splats);
        let scope = scope_of(&splats, &cameras);
        let mut page = ViewerPage::new(title_of(self.run), cameras.site.as_ref(), scope);
        let encode = |splats: &_| encoded(splats, cameras.site.as_ref());
        add_splats(&mut page, PageSplats::new(&splats, scope, &self.prefix(), encode));
        add_photographs(&mut page, &cameras, scope);
        Ok((page, cameras.recipe.iterations))
    }

    fn cameras<T: DeserializeOwned>(&self) -> Result<T, PipelineError> {
        let made_by = "`satgs train RUN` makes it when training begins";
        let path = self.in_training(CHECKPOINT_CAMERAS);
        read_json(&path).map_err(|source| PipelineError::RunFile { source, made_by })
    }

    /// What names of the files of this version begin with.
    fn prefix(&self) -> String {
        format!("v{}-", self.version)
    }
}
