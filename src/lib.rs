//! Satellite photogrammetry with Gaussian splats: from images with RPC cameras to georeferenced surface models.
//!
//! A rational polynomial camera (RPC) is how vendors of satellite images describe the way from the ground to a pixel.
//! This crate corrects such cameras by bundle adjustment, matches the images to a first surface, trains Gaussian splats
//! on the images under the sun's shadows, and renders a digital surface model (DSM) and an orthophoto from them. The
//! command `satgs` is a thin layer above [`pipeline`].
//!
//! # Where to start
//!
//! | to | use |
//! |---|---|
//! | run a stage as the command line does, on a run folder | [`pipeline`]: [`adjust`](pipeline::adjust), [`train`](pipeline::train), [`dsm`](pipeline::dsm), [`evaluate`](pipeline::evaluate) |
//! | run all stages of a scene of any kind and size | [`run`](mod@run) |
//! | show progress, or stop long work | [`progress::Progress`] |
//! | read a folder of images, its cameras and suns | [`scene::read`], [`scene::Scene`], [`scene::View`] |
//! | read an RPC of any vendor, project and localise points | [`scene::read_camera`], [`rpc::Rpc`], [`rpc::formats`] |
//! | adjust cameras without writing files | [`bundle::adjust`], [`bundle::Adjustment`] |
//! | approximate an RPC by an affine or quadratic camera | [`affine::fit`](affine::fit()), [`affine::ViewCamera`], [`affine::SiteScene`] |
//! | match images to a surface (plane sweep, semi-global matching) | [`mvs::PlaneSweep`], [`mvs::MatchedSurface`] |
//! | train and render splats | [`splat::train`], [`splat::raster`], [`splat::ply`] |
//! | predict splats from a cloud of points and the images that show it | [`predict`](mod@predict) |
//! | render a DSM, an orthophoto, points or a mesh | [`dsm`](mod@dsm) |
//! | read photographs with pinhole cameras, COLMAP models | [`perspective::PerspectiveScene`], [`perspective::colmap`] |
//! | fuse depth maps to a mesh, read and write meshes | [`mesh`](mod@mesh) |
//! | compare a DSM with lidar | [`metrics::evaluate`], [`metrics::Truth`] |
//! | make a scene with a known answer | [`simulate::simulate`], [`simulate::simulate_room`], [`simulate::simulate_aerial`] |
//! | convert between geodetic, UTM and site coordinates | [`frame`] |
//! | read and write rasters, point clouds and vectors | [`io`] |
//!
//! # Example
//!
//! ```no_run
//! use satgs::pipeline::{AdjustOptions, DsmOptions, TrainOptions, adjust, dsm, train};
//! use satgs::progress::NoProgress;
//! use satgs::scene::{self, ReadOptions};
//! use std::path::Path;
//!
//! let scene = scene::read(Path::new("images"), &ReadOptions::default())?;
//! let run = Path::new("run");
//! let adjusted = adjust(&scene, &AdjustOptions::default(), run, &NoProgress)?;
//! println!("{}", adjusted.report.table());
//! train(run, &TrainOptions::default(), &NoProgress)?;
//! dsm(run, &DsmOptions::default(), &NoProgress)?; // run/dsm.tif
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! More are in the folder `examples`.
//!
//! # Features
//!
//! `cli` (default): the module `cli` and the binary `satgs`. Without it the library builds without clap, indicatif,
//! signal-hook and tracing-subscriber.
//!
//! `gpu`: [`splat`]'s module `gpu`, training on GPUs of any vendor by wgpu.
//!
//! # Layers
//!
//! The modules stand in layers; each imports only from those above it in this list. Coordinates have a type for each
//! frame, angles are degrees, lengths metres, and heights count from the WGS 84 ellipsoid unless stated otherwise. Errors
//! are one enum a module; [`pipeline::PipelineError`] holds those of the stages. The library prints nothing.

#![cfg_attr(docsrs, feature(doc_cfg))]

pub mod fault;
pub mod random;
pub mod stats;
pub mod simd;
pub mod progress;
pub mod run_files;
pub mod frame;
pub mod io;
pub mod checkpoint;
pub mod nn;
pub mod rpc;
pub mod scene;
pub mod simulate;
pub mod bundle;
pub mod camera;
pub mod affine;
pub mod perspective;
pub mod mvs;
pub mod prior;
pub mod splat;
pub mod estimate;
pub mod predict;
pub mod mesh;
pub mod dsm;
pub mod metrics;
pub mod coregister;
pub mod changes;
pub mod report;
pub mod viewer;
pub mod export;
pub mod pipeline;
pub mod tiles;
pub mod run;
#[cfg(feature = "cli")]
#[cfg_attr(docsrs, doc(cfg(feature = "cli")))]
pub mod cli;
