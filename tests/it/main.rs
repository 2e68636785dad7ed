//! All integration tests in one binary, a module a subject: one link instead of forty.
//!
//! `cargo test --test it resume` runs the tests of `resume.rs`. `tests/memory.rs` stands apart because it replaces the
//! allocator of its process.

// Helpers of tests are tests, and skipped tests say so on standard output.
#![allow(clippy::unwrap_used, clippy::print_stdout)]
// Examples that show the same town are modules of `examples`, each with its own copy of it.
#![allow(clippy::duplicate_mod)]

mod common;

mod align;
mod bad_dsm_eval;
mod bad_inputs;
mod bare_ground;
mod bundle_cells;
mod bundle_inputs;
mod bundle_real;
mod bundle_simulated;
mod bytes;
mod camera_choice;
mod changes;
mod circles;
mod display_gamma;
mod error_kinds;
mod examples;
mod export;
mod guide;
mod help;
mod inputs;
mod interrupted_matching;
mod layers;
mod matched_photographs;
mod mesh;
mod metrics_peer;
mod names;
mod next_steps;
mod object_stores;
mod perspective_faults;
mod perspective_scenes;
mod perspective_training;
mod photograph_cameras;
mod pipeline;
mod predict;
mod prior;
mod products;
mod quadratic_cameras;
mod real_scenes;
mod resume;
mod rpc_command;
mod rpc_oracles;
mod rpc_peers;
mod scene_geometry;
mod scene_lists;
mod season_colors;
mod simulated_photographs;
mod simulated_surfaces;
mod splat_formats;
mod surface_first;
mod tiles;
mod validity;
mod view;
mod whole_run;
