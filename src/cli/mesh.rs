//! `satgs mesh`: a mesh of a run or of a scene with depth maps.

use super::{CliError, Ui, ending, parse_metres};
use crate::pipeline::{MeshOptions, MeshSummary, mesh};
use std::path::PathBuf;

/// Make a mesh (.ply, .obj or .glb) of a trained run, with walls and colours, or of a scene with depth maps
///
/// Depth maps are fused to a truncated signed distance function (TSDF) in voxels, of which the zero
/// surface is taken by marching cubes; the 50 largest pieces of at least 50 triangles are kept.
/// Of a satellite run the maps are the altitudes of its splats in each training view and from straight
/// above; the mesh is georeferenced: coordinates are metres from the site's origin, which stands in
/// FILE.georef.json beside the mesh. Of a run of photographs they are the depths of its splats in each
/// training view, of a scene with depth maps these.
///
///   input                   voxel                   truncation  greatest depth
///   satellite run           0.5 m                   2 m
///   RGB-D or ScanNet++
///   scene, run of it        0.02 m                  0.08 m      5 m
///   photographs from inside
///   a scene                 95 % quantile of the    4 voxels    scene: 99.9 % of the depths are smaller
///                           depths / 250                        run: 95 % of them
///   other perspective ones  greatest depth / 1024   4 voxels    2 x nearest camera to the place all look at
///
///   satgs mesh run -o town.glb
///   satgs mesh kitchen -o reference.ply --voxel 0.01
#[derive(clap::Args, Clone, Debug)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// Run folder of `satgs train`, or a scene with depth maps
    #[arg(value_name = "RUN_OR_SCENE")]
    input: PathBuf,
    /// The mesh
    #[arg(short, long, value_name = "FILE", value_parser = ending(&["ply", "obj", "glb"]))]
    output: PathBuf,
    /// Side of a voxel, metres [default: see above]
    #[arg(long, value_name = "METRES", value_parser = parse_metres)]
    voxel: Option<f64>,
    /// Distance from a surface up to which a depth map tells of it, metres [default: 4 voxels]
    #[arg(long, value_name = "METRES", value_parser = parse_metres)]
    truncation: Option<f64>,
    /// Leave out depths beyond this, metres [default: see above]; not for satellite runs
    #[arg(long, value_name = "METRES", value_parser = parse_metres)]
    depth_max: Option<f64>,
    /// Replace the mesh if it exists
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let options = MeshOptions {
        voxel_m: args.voxel,
        truncation_m: args.truncation,
        depth_max_m: args.depth_max,
        overwrite: args.overwrite,
    };
    let summary = mesh(&args.input, &args.output, &options, ui)?;
    ui.summary("mesh", Some(&text(&summary)), &summary)
}

fn text(s: &MeshSummary) -> String {
    let limit = match (s.depth_max_m, s.depths_beyond) {
        (Some(most), Some(share)) => {
            let beyond = if share > 0.0 { format!("{:.1} %", 100.0 * share) } else { "none".into() };
            format!(", depths up to {most:.2} m ({beyond} of them are beyond)")
        }
        _ => String::new(),
    };
    format!(
        "{}: {} vertices, {} triangles in {} pieces ({} smaller ones left out)\n{} depth maps, voxels of {} m, \
         truncation {} m, {:.0} MB{limit}",
        s.output.display(),
        s.vertices,
        s.triangles,
        s.pieces,
        s.pieces_left_out,
        s.depth_maps,
        s.voxel_m,
        s.truncation_m,
        s.volume_mb
    )
}
