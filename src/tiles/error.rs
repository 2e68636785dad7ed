//! Why a plan, a tile job or a mosaic failed.

use crate::io::{RasterError, ReadError, VectorError, WriteError};
use crate::pipeline::{ErrorKind, PipelineError, message_with_causes};
use std::path::PathBuf;

/// Why a plan, a tile job or a mosaic failed.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum TilesError {
    /// A file of the run folder is missing or damaged.
    #[error("{source}")]
    #[diagnostic(help("{made_by}"))]
    RunFile {
        /// The file, and why it cannot be read.
        source: ReadError,
        /// The command that makes it.
        made_by: &'static str,
    },
    /// The area reaches too far out of the UTM zone that it is planned in.
    #[error(
        "the area reaches {off_deg:.1}° from the central meridian of its map projection, EPSG:{epsg}; \
         {farthest_deg}° are allowed"
    )]
    #[diagnostic(help("cut it into parts from west to east, and give each its own --aoi and run folder"))]
    OutOfZone {
        /// EPSG code of the UTM zone.
        epsg: u32,
        /// Largest distance from its central meridian, degrees of longitude.
        off_deg: f64,
        /// Largest distance that is allowed, degrees.
        farthest_deg: f64,
    },
    /// No tile is seen by enough views.
    #[error("no part of the area is seen by {least} training views")]
    #[diagnostic(help("`satgs info SCENE` shows where the views lie; --aoi chooses another area"))]
    NoViews {
        /// The number of views that a tile needs.
        least: usize,
    },
    /// Even the smallest tile needs more memory than it may.
    #[error("a tile needs {needed_mb:.0} MB of memory, --max-memory is {limit_mb:.0} MB")]
    #[diagnostic(help(
        "a smaller --overlap and fewer views reduce it; a machine with more memory allows a larger limit"
    ))]
    Memory {
        /// Memory of the smallest tiles, megabytes.
        needed_mb: f64,
        /// The limit, megabytes.
        limit_mb: f64,
    },
    /// The run was adjusted again after it was planned.
    #[error("`{run}/tiles.json` was planned from another adjustment than `{run}/ba` holds now")]
    #[diagnostic(help("`satgs plan SCENE -o RUN --overwrite` plans again"))]
    OtherAdjustment {
        /// The run folder.
        run: PathBuf,
    },
    /// The plan names a view that the scene does not have.
    #[error("tile `{id}` of tiles.json names view `{view}`, which scene.json does not have")]
    #[diagnostic(help("`satgs plan SCENE -o RUN --overwrite` plans again"))]
    NoView {
        /// The tile.
        id: String,
        /// The view.
        view: String,
    },
    /// A window of the plan lies outside of its image.
    #[error("tile `{id}` of tiles.json: the window of view `{view}` is not inside its image")]
    #[diagnostic(help("`satgs plan SCENE -o RUN --overwrite` plans again"))]
    Window {
        /// The tile.
        id: String,
        /// The view.
        view: String,
    },
    /// A file that training reads has changed since the tiles were planned with it.
    #[error("`{path}` is missing or another file than tiles.json was planned with")]
    #[diagnostic(help("`satgs plan SCENE -o RUN --overwrite` plans with it"))]
    OtherFile {
        /// The file.
        path: PathBuf,
    },
    /// The machine has less memory or disk than a tile needs.
    #[error("tile `{id}` needs {needed_mb:.0} MB of {what}, this machine has {available_mb:.0} MB")]
    #[diagnostic(help(
        "a larger machine can do it; `satgs plan` makes smaller tiles by --core or --max-memory"
    ))]
    Resources {
        /// The tile.
        id: String,
        /// Memory or disk space.
        what: &'static str,
        /// What the tile needs, megabytes.
        needed_mb: f64,
        /// What there is, megabytes.
        available_mb: f64,
    },
    /// An option of areas of one tile.
    #[error("{option} is for areas of one tile, and this one is cut into several")]
    #[diagnostic(help("{instead}; a larger --core cuts fewer tiles"))]
    OneTileOnly {
        /// The option.
        option: &'static str,
        /// What does the same for several tiles.
        instead: &'static str,
    },
    /// Some tiles failed; everything else is complete.
    #[error("these tiles failed, and the mosaic has no data there: {failed}")]
    #[diagnostic(help("`satgs tile status RUN` tells why; the same command tries them again"))]
    Partial {
        /// IDs of the tiles.
        failed: String,
    },
    /// All tiles failed.
    #[error("all tiles failed; the first: {}", first.chain())]
    AllFailed {
        /// Why the first tile failed.
        first: Box<TilesError>,
    },
    /// The run folder holds the training of the area as a whole.
    #[error("`{run}` holds a training of the whole area, which tiles would replace")]
    #[diagnostic(help("another -o keeps both"))]
    WholeRun {
        /// The run folder.
        run: PathBuf,
    },
    /// Another job makes the same tile or mosaic.
    #[error("another satgs is at work in `{folder}`")]
    #[diagnostic(help("wait until it is done: what it has made is kept"))]
    AtWork {
        /// The folder.
        folder: PathBuf,
    },
    /// The content of `tiles.json` is not that of a plan.
    #[error("`{run}/tiles.json`: {reason}")]
    #[diagnostic(help("`satgs plan SCENE -o RUN --overwrite` plans again"))]
    Damaged {
        /// The run folder.
        run: PathBuf,
        /// What is wrong, with the field.
        reason: String,
    },
    /// The plan has no such tile.
    #[error("the plan has no tile `{id}`")]
    #[diagnostic(help("`satgs tile status RUN` lists the tiles"))]
    NoTile {
        /// The ID.
        id: String,
    },
    /// A tile that is needed is not done.
    #[error(
        "tile `{id}` is not done: `{file}` or a file that it lists is missing, or it was made from another plan"
    )]
    #[diagnostic(help("`satgs tile run RUN {id}` makes the tile"))]
    NotDone {
        /// The tile.
        id: String,
        /// Its `done.json`.
        file: PathBuf,
    },
    /// A raster of a tile has not the grid that the plan gives it.
    #[error("`{file}` does not have the cells that the plan gives the tile")]
    #[diagnostic(help("remove `RUN/tiles/{id}`, then `satgs tile run RUN {id}` makes the tile again"))]
    Grid {
        /// The tile.
        id: String,
        /// The raster.
        file: PathBuf,
    },
    /// The cores are not in rows and columns, or are too small.
    #[error("tiles `{a}` and `{b}` cannot be blended: {reason}")]
    #[diagnostic(help("`satgs plan SCENE -o RUN` makes a plan that can"))]
    Cores {
        /// A tile.
        a: String,
        /// Its neighbour.
        b: String,
        /// What is wrong.
        reason: &'static str,
    },
    /// No tile is done, so that there is no mosaic.
    #[error("no tile of `{run}` is done")]
    #[diagnostic(help("`satgs tile run RUN ID` makes a tile"))]
    NothingDone {
        /// The run folder.
        run: PathBuf,
    },
    /// See [`PipelineError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Pipeline(#[from] PipelineError),
}

impl TilesError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Pipeline(e) => e.kind(),
            Self::AllFailed { first } => first.kind(),
            // The same call succeeds when the other job is done.
            Self::AtWork { .. } => ErrorKind::Failed,
            Self::Resources { .. } => ErrorKind::Resources,
            Self::NotDone { .. } | Self::NothingDone { .. } => ErrorKind::Failed,
            _ => ErrorKind::Input,
        }
    }
}

impl TilesError {
    /// The error of a file that was just written and cannot be read: not the input is wrong.
    pub(super) fn of_own_file(source: ReadError) -> Self {
        WriteError { path: source.path, cause: source.cause }.into()
    }

    /// The error of a folder that could not be locked for a job.
    pub(super) fn of_lock(error: PipelineError) -> Self {
        match error {
            PipelineError::Locked { run } => Self::AtWork { folder: run },
            error => error.into(),
        }
    }

    /// The message with those of all causes, as one sentence.
    #[must_use]
    pub fn chain(&self) -> String {
        message_with_causes(self)
    }
}

impl From<WriteError> for TilesError {
    fn from(e: WriteError) -> Self {
        Self::Pipeline(e.into())
    }
}

impl From<RasterError> for TilesError {
    fn from(e: RasterError) -> Self {
        Self::Pipeline(e.into())
    }
}

impl From<VectorError> for TilesError {
    fn from(e: VectorError) -> Self {
        Self::Pipeline(e.into())
    }
}
