//! Names of the files in a run's folder, which one stage writes and others read.

/// The scene as read.
pub const SCENE: &str = "scene.json";
/// Folder of the adjustment.
pub const ADJUSTMENT: &str = "ba";
/// The adjustment's figures, in its folder.
pub const ADJUSTMENT_REPORT: &str = "report.json";
/// The adjusted tie points, in its folder.
pub const SPARSE_POINTS: &str = "points.laz";
/// Site and cameras in its frame, with each view's radiometry.
pub const CAMERAS: &str = "cameras.json";
/// Folder of the training.
pub const TRAIN_STAGE: &str = "train";
/// What an interrupted training continues from, in the folder of a training.
pub const CHECKPOINT: &str = "checkpoint.bin";
/// The cameras of a training that is not complete, beside its checkpoint.
pub const CHECKPOINT_CAMERAS: &str = "cameras.json";
/// Folder of the parts of an unfinished matching, in the folder of a stage.
pub const MATCHING: &str = "matching";
/// Log of a training, one line an iteration, in such a folder.
pub const TRAINING_LOG: &str = "train.csv";
/// Curves of the log, in such a folder.
pub const TRAINING_CURVES: &str = "curves.svg";
/// Folder of pictures of the training's progress, in such a folder.
pub const SNAPSHOTS: &str = "snapshots";
/// Folder of pictures of the aligned depths and pseudo-views from which the training of photographs started.
pub const START: &str = "train/start";
/// Folder of pictures of priors beside the rendered depths and normals of photographs.
pub const PRIOR_PICTURES: &str = "train/priors";
/// Folder of the depth and normal maps that a network or a command made of the images.
pub const PRIORS: &str = "priors";
/// Folder of a prediction of splats.
pub const PREDICT_STAGE: &str = "predict";
/// The splats that were predicted from points, from which training continues; colours are linear, for photographs as displayed.
pub const PREDICTED: &str = "predict/splats.ply";
/// The colour models of the views that were found with them.
pub const PREDICTED_LIGHTS: &str = "predict/lights.json";
/// The trained splats.
pub const SPLATS: &str = "splats.ply";
/// The trained surface, matched with the views.
pub const SURFACE: &str = "train/surface.tif";
/// The splats of the training for heights, where a training of colours follows.
pub const HEIGHT_SPLATS: &str = "train/splats.ply";
/// The trained colours for novel views: networks, embeddings, and the splats' colours before them.
pub const APPEARANCE: &str = "appearance.safetensors";
/// Folder of the training of colours.
pub const APPEARANCE_STAGE: &str = "appearance";
/// The surface that training started on.
pub const FIRST_SURFACE: &str = "train/first_surface.tif";
/// The surface model.
pub const DSM: &str = "dsm.tif";
/// The orthophoto.
pub const ORTHO: &str = "ortho.tif";
/// Opacity, spread of altitudes and number of views of every cell.
pub const CONFIDENCE: &str = "confidence.tif";
/// The products as a STAC Item.
pub const ITEM: &str = "item.json";
/// QGIS layers of the products, in the run's folder.
pub const LAYERS: &str = "layers.qlr";
/// The surface model in relief.
pub const HILLSHADE: &str = "hillshade.tif";
/// The bare ground.
pub const GROUND: &str = "dtm.tif";
/// Heights of the surface model above the bare ground.
pub const ABOVE_GROUND: &str = "ndsm.tif";
/// The mesh, by format.
pub const MESHES: [&str; 2] = ["mesh.glb", "mesh.ply"];
/// Folder of what `satgs view` keeps of large runs: the splats from coarse to fine.
pub const VIEW: &str = "view";
/// Folder of the scores.
pub const EVALUATION: &str = "eval";
/// Scores of the views of a perspective scene that were held back.
pub const NVS_SCORES: &str = "eval/nvs.json";
/// Folder of comparisons of such views with their renders.
pub const NVS_PICTURES: &str = "eval/nvs";
/// The scores, in such a folder.
pub const METRICS: &str = "metrics.json";
/// The map of errors, in such a folder.
pub const ERROR_MAP: &str = "error.tif";
/// What a stage was made from, in its folder.
pub const STAGE: &str = "stage.json";
/// What a stage said when it was made, in its folder.
pub const SUMMARY: &str = "summary.json";
/// Which products beside the rasters were made of the surface.
pub const PRODUCTS: &str = "dsm/products.json";
/// The plan of the tiles of a scene larger than one tile.
pub const PLAN: &str = "tiles.json";
/// Folder of the tiles; each is a run folder.
pub const TILES: &str = "tiles";
/// Written last by a tile job, in the tile's folder: what it was made from, and its files.
pub const DONE: &str = "done.json";
/// Written by a tile job that failed, in the tile's folder: the reason.
pub const FAILURE: &str = "failed.json";
/// Folder of the blended cores of the tiles.
pub const MOSAIC: &str = "mosaic";
/// Corrections of the tiles' colours.
pub const COLORS: &str = "colour.json";
/// The seams between tiles, with the differences there.
pub const SEAMS: &str = "seams.gpkg";
/// The tiles that failed.
pub const FAILED: &str = "failed.gpkg";
/// Locked while a command works in the folder.
pub const LOCK: &str = ".lock";
/// The page that shows all of it.
pub const PAGE: &str = "report.html";
