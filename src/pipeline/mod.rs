//! The commands as library calls: one function a command, which works on a run folder.
//!
//! A run folder holds what one stage writes and the next ones read; [`run_files`](crate::run_files) has the names.
//! [`adjust`] starts one from a [`Scene`](crate::scene::Scene), [`train`], [`dsm`], [`evaluate`], [`render`],
//! [`nvs_eval`], [`mesh()`], [`align`], [`report`], [`write_page`] and [`export_colmap`] work on it;
//! [`run`](crate::run::run()) calls the main stages in a row. [`prior_maps`] makes maps that training takes. Options are plain
//! structs whose [`Default`] is what the command line takes without arguments, results are plain structs that serialise
//! to what `satgs COMMAND --json` prints, and all errors are [`PipelineError`]s. Long work reports to a
//! [`Progress`](crate::progress::Progress), which can also stop it.
//!
//! A stage that is complete and was made from the same input and options is kept; one that was made from others is
//! [`PipelineError::Changed`], unless `overwrite` is set. One call at a time works in a run folder: a [`RunLock`] keeps
//! out others, also those of other processes.

mod adjust;
mod align;
mod changes;
mod colmap_folder;
mod datum;
mod depth_views;
mod dsm;
mod error;
mod evaluate;
mod export;
mod export_folder;
mod export_splats;
mod export_tileset;
mod exported;
mod gpu_support;
mod live_page;
mod mesh;
mod mesh_eval;
mod mesh_sources;
mod nvs_eval;
mod nvs_scores;
mod outdated;
mod page_layers;
mod page_splats;
mod perspective;
mod photographs;
mod predict;
mod prior_maps;
mod product_lists;
mod products;
mod relocation;
mod render;
mod render_options;
mod report;
mod run_folder;
mod satellite;
mod scene_points;
mod surface_source;
mod train;
mod train_options;
mod trained;
mod training_device;
mod training_stage;
mod view;

pub use crate::fault::ErrorKind;
pub(crate) use adjust::adjust_locked;
pub use adjust::{AdjustOptions, Adjusted, DemOptions, adjust};
pub use align::{AlignOptions, Aligned, align};
pub use changes::{ChangesOptions, changes};
pub use dsm::{DsmOptions, DsmSummary, dsm};
pub(crate) use dsm::{before_training as surface_before_training, dsm_locked};
pub use error::{PipelineError, message_with_causes};
pub use evaluate::{EvaluateOptions, evaluate};
pub use export::export_colmap;
pub use export_splats::{SplatExport, export_splats};
pub use export_tileset::{TilesetPart, export_tileset};
pub use exported::{ExportedSplats, ExportedTileset, ExportedView, ExportedViews, PinholeFit};
pub use live_page::serve_live_page;
pub use mesh::{MeshOptions, MeshSummary, mesh};
pub use mesh_eval::{MeshAlignment, MeshEvalOptions, MeshEvaluation, mesh_eval};
pub use nvs_eval::nvs_eval;
pub(crate) use nvs_eval::nvs_eval_locked;
pub use nvs_scores::{NvsOptions, NvsScores, Protocol, ViewScore};
pub(crate) use outdated::after_surface;
pub(crate) use perspective::train_scene;
pub(crate) use photographs::tell_of_scene;
pub use predict::{ENDINGS as POINT_ENDINGS, PredictOptions, Predicted, Untrained, predict};
pub use prior_maps::{PriorMapOptions, PriorMapSummary, prior_maps};
pub(crate) use product_lists::list_products;
pub use render::render;
pub use render_options::{Colors, Moment, RenderOptions, RenderSummary, Viewpoint};
pub use report::report;
pub use run_folder::lock::RunLock;
pub use run_folder::perspective_cameras::{PerspectiveCameras, TrainedPhoto};
pub use run_folder::perspective_manifest::PerspectiveManifest;
pub use run_folder::satellite_cameras::{TrainedCameras, read_scene};
pub use run_folder::stage::Outcome;
pub(crate) use run_folder::stage::{Fingerprint, Stage, hash, hash_file, made_from, or_none};
pub(crate) use surface_source::KnownSurface;
pub use train::train;
pub(crate) use train::train_locked;
pub use train_options::TrainOptions;
pub use trained::{Trained, TrainedColors};
pub use view::{WrittenPage, serve_page, view_page, write_page};
