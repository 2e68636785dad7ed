//! Why a command failed, and whose fault that is.

use crate::affine::{FitError, SiteSceneError};
use crate::bundle::BundleError;
use crate::changes::ChangesError;
use crate::checkpoint::CheckpointError;
use crate::coregister::CoregisterError;
use crate::export::ExportError;
use crate::fault::ErrorKind;
use crate::frame::FrameError;
use crate::io::{CloudError, RasterError, ReadError, VectorError, VerticalError, WriteError};
use crate::mesh::MeshError;
use crate::metrics::MetricsError;
use crate::mvs::MatchError;
use crate::nn::features::FeatureError;
use crate::nn::lpips::LpipsError;
use crate::perspective::PerspectiveError;
use crate::predict::PredictError;
use crate::predict::learn::LearnError;
use crate::prior::PriorError;
use crate::progress::Interrupted;
use crate::report::ReportError;
use crate::rpc::formats::FormatError;
use crate::scene::SceneError;
use crate::simulate::SimulateError;
use crate::splat::appearance::satgs::AppearanceError;
use crate::splat::backend::BackendError;
use crate::splat::ply::PlyError;
use crate::splat::recipe::RecipeError;
use crate::viewer::ViewerError;
use std::path::PathBuf;

/// The message of an error with those of all its causes, as one sentence.
#[must_use]
pub fn message_with_causes(error: &dyn std::error::Error) -> String {
    let mut message = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        let text = cause.to_string();
        if !message.contains(&text) {
            message = format!("{message}: {text}");
        }
        source = cause.source();
    }
    message
}

/// Why a command failed.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum PipelineError {
    /// An option is out of its range.
    #[error("`{option}` is {found}, expected {expected}")]
    Option {
        /// Name of the option, as on the command line.
        option: &'static str,
        /// The given value.
        found: String,
        /// The accepted values.
        expected: &'static str,
    },
    /// Another process or call works in the run folder.
    #[error("another satgs is at work in `{run}`")]
    #[diagnostic(help("wait until it is done, or give this one another folder"))]
    Locked {
        /// The run folder.
        run: PathBuf,
    },
    /// A stage is there already, made from other input or with other options.
    #[error("`{folder}` was made with other options or input: {differences}")]
    #[diagnostic(help("{hint}"))]
    Changed {
        /// Folder of the stage.
        folder: PathBuf,
        /// Options and inputs that differ, with both values.
        differences: String,
        /// What to do about it.
        hint: String,
    },
    /// A file of the run folder is missing or damaged.
    #[error("{source}")]
    #[diagnostic(help("{made_by}"))]
    RunFile {
        /// The file, and why it cannot be read.
        source: ReadError,
        /// The command that makes it.
        made_by: &'static str,
    },
    /// A value cannot be written as JSON.
    #[error("{what} cannot be written as JSON: {source}")]
    Json {
        /// The value.
        what: &'static str,
        /// The encoder's error.
        source: serde_json::Error,
    },
    /// An image that the run was made from is no longer where it was.
    #[error("the run was made from `{image}`, which does not exist any more")]
    #[diagnostic(help("`satgs ba SCENE -o RUN` tells the run where its images have moved to"))]
    ImageMoved {
        /// The image.
        image: PathBuf,
    },
    /// Training is to resume from a checkpoint that does not exist.
    #[error("`{path}` does not exist")]
    #[diagnostic(help("without --resume training starts from the beginning"))]
    NoCheckpoint {
        /// The checkpoint.
        path: PathBuf,
    },
    /// Training was interrupted; its checkpoint is written.
    #[error("interrupted after {iterations} iterations")]
    #[diagnostic(help("the same command continues from `{}`", checkpoint.display()))]
    TrainingInterrupted {
        /// Iterations that are done.
        iterations: usize,
        /// The checkpoint.
        checkpoint: PathBuf,
    },
    /// The run's training is not complete.
    #[error("`{run}` holds a training that is not complete")]
    #[diagnostic(help("`satgs train RUN` completes it"))]
    TrainingIncomplete {
        /// The run folder.
        run: PathBuf,
    },
    /// The run is cut into tiles, and the command works on one area.
    #[error("`{run}` is planned as several tiles, each of which is a run of its own")]
    #[diagnostic(help("`{}` is the folder of one tile, which can be given in place of the run", example.display()))]
    OfTiles {
        /// The run folder.
        run: PathBuf,
        /// The folder of a tile.
        example: PathBuf,
    },
    /// The folder is a tile, which only the plan's jobs may change.
    #[error("`{folder}` is a tile of `{run}`, with whose other tiles it must agree")]
    #[diagnostic(help(
        "`satgs plan SCENE -o RUN --overwrite` with other options, or `satgs run`, makes all tiles again"
    ))]
    Tile {
        /// The folder of the tile.
        folder: PathBuf,
        /// The run that it belongs to.
        run: PathBuf,
    },
    /// Tiles cannot be moved.
    #[error("`{run}` belongs to a run of several tiles, which `satgs align` does not move")]
    #[diagnostic(help("ground control points (--gcps) or --dem-sigma fix its datum in the adjustment"))]
    TilesNotMoved {
        /// The run folder, or that of a tile.
        run: PathBuf,
    },
    /// The confidence is not that of the surface model.
    #[error(
        "`{path}` is not the confidence of `{dsm}`: it has other cells, or no band with the number of views"
    )]
    #[diagnostic(help("`satgs dsm` writes confidence.tif beside dsm.tif"))]
    OtherCells {
        /// The file of the confidence.
        path: PathBuf,
        /// The surface model.
        dsm: PathBuf,
    },
    /// The run is of a perspective scene, for which the command does not exist.
    #[error("`{run}` is the run of a perspective scene, on which this command does not work")]
    #[diagnostic(help("train, render --like VIEW, nvs-eval, report and, with a georeference, dsm do"))]
    OfPerspective {
        /// The run folder.
        run: PathBuf,
    },
    /// The run is of a satellite scene.
    #[error("`{run}` is the run of a satellite scene, not of a perspective one")]
    #[diagnostic(help("choose another run folder, or leave out options of perspective scenes"))]
    OfSatellites {
        /// The run folder.
        run: PathBuf,
    },
    /// The splats have no normals.
    #[error("the splats of `{run}` are ellipsoids, which have no normals")]
    #[diagnostic(help("train with --primitive 2d, or a perspective scene with --recipe 2dgs or indoor"))]
    NoNormals {
        /// The run folder.
        run: PathBuf,
    },
    /// The recipe is for satellite scenes.
    #[error("recipe `{recipe}` is for satellite scenes, this scene is a perspective one")]
    #[diagnostic(help("--recipe 3dgs, 2dgs and indoor train perspective scenes"))]
    RecipeOfSatellites {
        /// Name of the recipe.
        recipe: String,
    },
    /// The recipe is for perspective scenes.
    #[error("recipe `{recipe}` is for perspective scenes, this scene is a satellite one")]
    #[diagnostic(help("--recipe best, baeogs and eogs train satellite scenes"))]
    RecipeOfPerspective {
        /// Name of the recipe.
        recipe: String,
    },
    /// An option that runs of perspective scenes do not have.
    #[error("{option}: runs of perspective scenes are rendered from their views only")]
    #[diagnostic(help("--like VIEW renders what a view sees"))]
    OnlyViews {
        /// The option.
        option: &'static str,
    },
    /// Points or images are of something else than the cameras of a scene.
    #[error("{what} do not belong to the cameras of the scene: {reason}")]
    #[diagnostic(help("{cause}"))]
    Elsewhere {
        /// The points or images.
        what: String,
        /// What was measured.
        reason: String,
        /// What may have caused it.
        cause: &'static str,
    },
    /// A map is to be made of a scene whose place on Earth is not known.
    #[error("`{run}` has no georeference, which a surface model needs")]
    #[diagnostic(help("`satgs run SCENE -o RUN --georef exif|FILE` trains the scene at its place on Earth"))]
    NoGeoreference {
        /// The run folder.
        run: PathBuf,
    },
    /// The adjustment has no sparse points.
    #[error("`{run}` has no sparse points")]
    #[diagnostic(help("`satgs ba` makes them"))]
    NoSparsePoints {
        /// The run folder.
        run: PathBuf,
    },
    /// The run has no view of this name.
    #[error("the run has no view `{name}`")]
    #[diagnostic(help("its views are {views}"))]
    NoView {
        /// The name.
        name: String,
        /// The names that exist.
        views: String,
    },
    /// `scene.json` and `cameras.json` do not hold the same views.
    #[error("`{run}/scene.json` has no view `{name}` with the camera that `{run}/cameras.json` has")]
    #[diagnostic(help("`satgs train RUN --overwrite` writes cameras.json again"))]
    ViewNotInScene {
        /// The run folder.
        run: PathBuf,
        /// The view.
        name: String,
    },
    /// The run has no test views.
    #[error("the run has no test view")]
    #[diagnostic(help(
        "`test.txt` beside the images names views to hold back; --view NAME scores one that was trained on"
    ))]
    NoTestView,
    /// A view of which shadows are needed has no usable sun.
    #[error("view `{name}` has no usable sun, which its shadows depend on")]
    #[diagnostic(help(
        "the metadata beside the image state the sun; `satgs info SCENE` shows what was read"
    ))]
    NoSun {
        /// The view.
        name: String,
    },
    /// A date is needed that is not known.
    #[error("view `{name}` has no acquisition date, or no training view has one")]
    #[diagnostic(help("`--protocol full` and `--protocol half` need no dates"))]
    NoDate {
        /// The view.
        name: String,
    },
    /// The run has no trained colours.
    #[error("`{run}` has no colours for {what}")]
    #[diagnostic(help("`satgs train RUN --recipe satgs --overwrite` trains them"))]
    NoTrainedColors {
        /// The run.
        run: PathBuf,
        /// What they are needed for.
        what: &'static str,
    },
    /// The visibility of a view's pixels is not known.
    #[error("`{run}` has no visibility of the pixels of view `{name}`")]
    #[diagnostic(help("training views of recipe `satgs` have one"))]
    NoVisibility {
        /// The run.
        run: PathBuf,
        /// The view.
        name: String,
    },
    /// Too few training views have a date for colours in between.
    #[error(
        "`{run}`: fewer than two training views have a date, so that there are no colours for another one"
    )]
    #[diagnostic(help("`--appearance VIEW` takes the colours of a view"))]
    NoSeason {
        /// The run.
        run: PathBuf,
    },
    /// A view has no valid pixels inside the area.
    #[error("view `{name}` has no valid pixels to score")]
    #[diagnostic(help("`satgs info SCENE` shows the valid pixels of every view"))]
    NothingToScore {
        /// The view.
        name: String,
    },
    /// The raster of `--like` is in another CRS than the run.
    #[error("the grid of --like is in EPSG:{grid}, the run in EPSG:{run}")]
    #[diagnostic(help("`gdalwarp -t_srs EPSG:{run}` reprojects the raster"))]
    GridCrs {
        /// EPSG code of the grid.
        grid: u32,
        /// EPSG code of the run.
        run: u32,
    },
    /// The output grid has too many cells.
    #[error("a grid of {width} x {height} cells is too large")]
    #[diagnostic(help("a larger --resolution gives fewer cells"))]
    GridSize {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// A geoid's grid does not cover the run.
    #[error("the grid of `{name}` has no geoid undulation at this site")]
    #[diagnostic(help("EGM96 and EGM2008 grids of the whole Earth come with PROJ's data"))]
    NoUndulation {
        /// The vertical reference.
        name: String,
    },
    /// The run's sparse points would be overwritten.
    #[error("--points: `{path}` holds the run's sparse points")]
    #[diagnostic(help("choose another file name"))]
    PointsTaken {
        /// The file.
        path: PathBuf,
    },
    /// An output exists.
    #[error("`{path}` exists")]
    #[diagnostic(help("--overwrite replaces it, another output keeps both"))]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The name of an image does not end in a known format.
    #[error("`{path}` is not the name of an image that can be written")]
    #[diagnostic(help("the name ends in .png or .tif"))]
    ImageFormat {
        /// The file.
        path: PathBuf,
    },
    /// A view or sun direction is too near to the horizon.
    #[error("{option}: {elevation_deg}° above the horizon is not between {lowest_deg}° and 90°")]
    #[diagnostic(help("--view AZIMUTH,OFF_NADIR, --sun AZIMUTH,ELEVATION, in degrees"))]
    Direction {
        /// The option.
        option: &'static str,
        /// The elevation that was asked for.
        elevation_deg: f64,
        /// The lowest accepted elevation.
        lowest_deg: f64,
    },
    /// The caller's [`Progress`](crate::progress::Progress) asked to stop.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Interrupted(#[from] Interrupted),
    /// See [`WriteError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
    /// See [`RasterError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    /// See [`VectorError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Vector(#[from] VectorError),
    /// See [`CloudError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Cloud(#[from] CloudError),
    /// See [`VerticalError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    VerticalReference(#[from] VerticalError),
    /// See [`FrameError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
    /// See [`FormatError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Rpc(#[from] FormatError),
    /// See [`SceneError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scene(#[from] SceneError),
    /// See [`PerspectiveError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Perspective(#[from] PerspectiveError),
    /// See [`PriorError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Prior(#[from] PriorError),
    /// See [`SimulateError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Simulate(#[from] SimulateError),
    /// See [`BundleError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Bundle(#[from] BundleError),
    /// See [`FitError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Fit(#[from] FitError),
    /// See [`SiteSceneError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Site(#[from] SiteSceneError),
    /// See [`MatchError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Match(#[from] MatchError),
    /// See [`RecipeError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Recipe(#[from] RecipeError),
    /// See [`CheckpointError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// See [`PlyError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Ply(#[from] PlyError),
    /// See [`AppearanceError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Appearance(#[from] AppearanceError),
    /// See [`FeatureError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Feature(#[from] FeatureError),
    /// See [`LpipsError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Lpips(#[from] LpipsError),
    /// See [`BackendError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Backend(#[from] BackendError),
    /// See [`MeshError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Mesh(#[from] MeshError),
    /// See [`MetricsError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Metrics(#[from] MetricsError),
    /// See [`CoregisterError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Coregister(#[from] CoregisterError),
    /// See [`ChangesError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Changes(#[from] ChangesError),
    /// See [`ReportError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Report(#[from] ReportError),
    /// See [`ViewerError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Viewer(#[from] ViewerError),
    /// See [`ExportError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Export(#[from] ExportError),
    /// A file of points cannot be used.
    #[error("`{path}` cannot be used as points: {reason}")]
    #[diagnostic(help(
        "expected a point cloud (.laz, .las, .ply) or a surface model (.tif) in a map projection in metres, with its CRS"
    ))]
    Points {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The folder for a prediction holds files that are not of a prediction.
    #[error("`{folder}` holds files that are not of a prediction")]
    #[diagnostic(help("-o takes a new folder, or one that `satgs predict` made"))]
    OtherFiles {
        /// The folder.
        folder: PathBuf,
    },
    /// See [`PredictError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Predict(#[from] PredictError),
    /// See [`LearnError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Learn(#[from] LearnError),
}

impl PipelineError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Interrupted(_) | Self::TrainingInterrupted { .. } => ErrorKind::Interrupted,
            Self::Json { .. } => ErrorKind::Failed,
            Self::Write(e) => e.kind(),
            Self::Raster(e) => e.kind(),
            Self::Scene(e) => e.kind(),
            Self::Perspective(e) => e.kind(),
            Self::Prior(e) => e.kind(),
            Self::Simulate(e) => e.kind(),
            Self::Bundle(e) => e.kind(),
            Self::Match(e) => e.kind(),
            Self::Site(e) => e.kind(),
            Self::Feature(e) => e.kind(),
            Self::Backend(e) => e.kind(),
            Self::Mesh(e) => e.kind(),
            Self::Metrics(e) => e.kind(),
            Self::Coregister(e) => e.kind(),
            Self::Changes(e) => e.kind(),
            Self::Report(e) => e.kind(),
            Self::Viewer(e) => e.kind(),
            Self::Predict(e) => e.kind(),
            Self::Learn(e) => e.kind(),
            // Errors of input alone.
            Self::Option { .. }
            | Self::Locked { .. }
            | Self::Changed { .. }
            | Self::RunFile { .. }
            | Self::ImageMoved { .. }
            | Self::NoCheckpoint { .. }
            | Self::TrainingIncomplete { .. }
            | Self::OfTiles { .. }
            | Self::Tile { .. }
            | Self::TilesNotMoved { .. }
            | Self::OtherCells { .. }
            | Self::OfPerspective { .. }
            | Self::OfSatellites { .. }
            | Self::NoNormals { .. }
            | Self::RecipeOfSatellites { .. }
            | Self::RecipeOfPerspective { .. }
            | Self::OnlyViews { .. }
            | Self::Elsewhere { .. }
            | Self::NoGeoreference { .. }
            | Self::NoSparsePoints { .. }
            | Self::NoView { .. }
            | Self::ViewNotInScene { .. }
            | Self::NoTestView
            | Self::NoSun { .. }
            | Self::NoDate { .. }
            | Self::NoTrainedColors { .. }
            | Self::NoVisibility { .. }
            | Self::NoSeason { .. }
            | Self::NothingToScore { .. }
            | Self::GridCrs { .. }
            | Self::GridSize { .. }
            | Self::NoUndulation { .. }
            | Self::PointsTaken { .. }
            | Self::Exists { .. }
            | Self::ImageFormat { .. }
            | Self::Direction { .. }
            | Self::Vector(_)
            | Self::Cloud(_)
            | Self::VerticalReference(_)
            | Self::Frame(_)
            | Self::Rpc(_)
            | Self::Fit(_)
            | Self::Recipe(_)
            | Self::Checkpoint(_)
            | Self::Ply(_)
            | Self::Appearance(_)
            | Self::Lpips(_)
            | Self::Export(_)
            | Self::Points { .. }
            | Self::OtherFiles { .. } => ErrorKind::Input,
        }
    }
}
