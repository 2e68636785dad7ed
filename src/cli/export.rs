//! `satgs export`: a run in the forms that other programs read.

use super::{CliError, Ui, ending};
use crate::export::{GltfCompression, PlyVariant};
use crate::perspective::colmap::Format;
use crate::pipeline::{ExportedTileset, ExportedViews, SplatExport, export_colmap, export_splats};
use crate::tiles::export_scene_tileset;
use std::fmt::Write;
use std::path::PathBuf;

/// Export a run for other programs: a COLMAP project, splats in the formats of viewers, 3D Tiles for globes
///
/// --colmap writes images/, sparse/0/ (cameras, images, points3D) and georef.json, which COLMAP, gsplat, Brush and nerfstudio open.
/// Satellite views become pinhole cameras far away on their lines of sight, with images resampled to square pixels and cropped to
/// the area; their coordinates are metres east, north and up from the run's origin; `satgs ba` is enough. Photographs are written
/// undistorted, at the size of the training.
///
/// --ply, --compressed-ply, --spz and --gltf write the splats, in the colours of the orthophoto, and NAME.georef.json with
/// EPSG code and origin. Axes are x east, y north, z up in PLY files, and x east, y up, z south in SPZ and glTF; the unit is
/// metres. `satgs info FILE` shows what they contain.
///
/// --3dtiles writes tileset.json and its tiles for CesiumJS and other globes, also for a RUN of several tiles.
#[derive(clap::Args, Clone, Debug)]
#[command(group = clap::ArgGroup::new("form").required(true))]
pub struct Args {
    /// Run folder of `satgs ba` or `satgs train`
    run: PathBuf,
    /// Write a COLMAP project into this folder, which must be empty or new
    #[arg(long, value_name = "DIR", group = "form")]
    colmap: Option<PathBuf>,
    /// Files of the COLMAP model
    #[arg(long, value_enum, default_value = "bin", conflicts_with_all = ["ply", "compressed_ply", "spz", "gltf", "tiles3d"])]
    format: FileFormat,
    /// Write the splats to this .ply file with all columns of 3DGS
    #[arg(long, value_name = "FILE", group = "form", value_parser = ending(&["ply"]))]
    ply: Option<PathBuf>,
    /// Write the splats to this compressed PLY file (PlayCanvas, SuperSplat: they expect NAME.compressed.ply)
    #[arg(long, value_name = "FILE", group = "form", value_parser = ending(&["ply"]))]
    compressed_ply: Option<PathBuf>,
    /// Axes of --ply and --compressed-ply
    #[arg(long, value_enum, default_value = "3dgs", conflicts_with_all = ["colmap", "spz", "gltf", "tiles3d"])]
    variant: Variant,
    /// Write the splats to this .spz file (version 3; positions in steps of at most 0.24 mm within 2 km of the origin)
    #[arg(long, value_name = "FILE", group = "form", value_parser = ending(&["spz"]))]
    spz: Option<PathBuf>,
    /// Write the splats to this .glb file with KHR_gaussian_splatting
    #[arg(long, value_name = "FILE", group = "form", value_parser = ending(&["glb"]))]
    gltf: Option<PathBuf>,
    /// Compress the splats of --gltf as SPZ (KHR_gaussian_splatting_compression_spz_2)
    #[arg(long, conflicts_with_all = ["colmap", "ply", "compressed_ply", "spz", "tiles3d"])]
    compress: bool,
    /// Write 3D Tiles 1.1 into this folder, which must be empty or new: tiles of splats with levels of detail, on the globe
    #[arg(long = "3dtiles", value_name = "DIR", group = "form")]
    tiles3d: Option<PathBuf>,
    /// Copyright notice for --gltf and --3dtiles, which globes display
    #[arg(long, value_name = "TEXT", conflicts_with_all = ["colmap", "ply", "compressed_ply", "spz"])]
    copyright: Option<String>,
    /// Replace the file, or what an earlier export wrote into the folder
    #[arg(long)]
    overwrite: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum FileFormat {
    /// cameras.bin, images.bin, points3D.bin
    Bin,
    /// cameras.txt, images.txt, points3D.txt
    Text,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Variant {
    /// All 62 columns of 3DGS, z up as in the run
    #[value(name = "3dgs")]
    Full,
    /// The same with x east, y down, z north: upright in viewers of COLMAP scenes
    YDown,
}

impl Variant {
    fn ply(self) -> PlyVariant {
        match self {
            Self::Full => PlyVariant::Full,
            Self::YDown => PlyVariant::YDown,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    if let Some(folder) = &args.colmap {
        let format = match args.format {
            FileFormat::Bin => Format::Binary,
            FileFormat::Text => Format::Text,
        };
        let exported = export_colmap(&args.run, folder, format, args.overwrite, ui)?;
        return ui.summary("export", Some(&table(&exported)), &exported);
    }
    let copyright = args.copyright.clone();
    if let Some(folder) = &args.tiles3d {
        let copyright = copyright.as_deref();
        let exported = export_scene_tileset(&args.run, folder, copyright, args.overwrite, ui)?;
        let ExportedTileset { tileset, tiles, levels, splats, bytes } = &exported;
        let megabytes = *bytes as f64 / 1e6;
        let text = format!(
            "{}: {tiles} tiles, {levels} levels of detail, {splats} splats, {megabytes:.1} MB",
            tileset.display()
        );
        return ui.summary("export", Some(&text), &exported);
    }
    let compression = if args.compress { GltfCompression::Spz } else { GltfCompression::None };
    let Some((file, form)) = [
        (&args.ply, SplatExport::Ply(args.variant.ply())),
        (&args.compressed_ply, SplatExport::CompressedPly(args.variant.ply())),
        (&args.spz, SplatExport::Spz),
        (&args.gltf, SplatExport::Gltf { compression, copyright }),
    ]
    .into_iter()
    .find_map(|(file, form)| Some((file.as_ref()?, form))) else {
        return Ok(());
    };
    let exported = export_splats(&args.run, file, &form, args.overwrite)?;
    let megabytes = exported.bytes as f64 / 1e6;
    let mut text = format!("{}, {} splats, {megabytes:.1} MB", exported.file.display(), exported.splats);
    if let Some(step) = exported.step {
        let _ = write!(text, ", positions in steps of {:.2} mm", 1000.0 * step);
    }
    ui.summary("export", Some(&text), &exported)
}

fn table(exported: &ExportedViews) -> String {
    let heads = ["image", "size", "distance km", "rms px", "max px"];
    let mut text =
        format!("{:28} {:>11} {:>11} {:>7} {:>7}\n", heads[0], heads[1], heads[2], heads[3], heads[4]);
    for v in &exported.views {
        let size = format!("{} x {}", v.size.0, v.size.1);
        let fit = v.fit.map_or_else(String::new, |fit| {
            format!(" {:11.1} {:7.3} {:7.3}", fit.distance_m / 1000.0, fit.rms_px, fit.max_px)
        });
        let _ =
            writeln!(text, "{:28} {size:>11}{fit}{}", v.image, if v.is_test { "  held back" } else { "" });
    }
    if exported.views.iter().all(|v| v.fit.is_none()) {
        text.clear();
    }
    for name in &exported.left_out {
        let _ = writeln!(text, "{name:28} left out: it does not show the area");
    }
    let reprojection =
        exported.reprojection_px.map_or_else(String::new, |px| format!(", reprojection error {px:.2} px"));
    let (folder, views, points) = (exported.folder.display(), exported.views.len(), exported.points);
    let _ = write!(text, "{folder}: {views} views, {points} points{reprojection}");
    text
}
