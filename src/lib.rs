//! Satellite photogrammetry with Gaussian splats: RPC images in, georeferenced surface models out.
//!
//! The modules stand in layers; each imports only from those above it in this list, `cli` from all.

pub mod stats;
pub mod random;
pub mod simd;
pub mod progress;
pub mod run_files;
pub mod frame;
pub mod io;
pub mod checkpoint;
pub mod rpc;
pub mod scene;
pub mod simulate;
pub mod bundle;
pub mod affine;
pub mod mvs;
pub mod splat;
pub mod dsm;
pub mod metrics;
pub mod coregister;
pub mod report;
pub mod pipeline;
pub mod cli;
