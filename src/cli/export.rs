//! `satgs export`: a run in the forms that other programs read.

use super::{CliError, Ui, ending};
use crate::export::PlyVariant;
use crate::perspective::colmap::Format;
use crate::pipeline::{ExportedViews, export_colmap, export_ply};
use std::fmt::Write;
use std::path::PathBuf;

/// Export a run for other programs: a COLMAP project, or splats in another variant of PLY
///
/// --colmap writes images/, sparse/0/ (cameras, images, points3D) and georef.json. Satellite views become pinhole cameras
/// far away on their lines of sight, with images resampled to square pixels and cropped to the area; photographs are written
/// without distortion, as they were trained on. COLMAP, gsplat, Brush and nerfstudio open them. Coordinates are metres east,
/// north and up from the run's origin. A satellite run needs no more than `satgs ba`.
#[derive(clap::Args, Clone, Debug)]
#[command(group = clap::ArgGroup::new("form").required(true))]
pub struct Args {
    /// Run folder of `satgs ba` or `satgs train`
    run: PathBuf,
    /// Write a COLMAP project into this folder, which must be empty or new
    #[arg(long, value_name = "DIR", group = "form")]
    colmap: Option<PathBuf>,
    /// Files of the COLMAP model
    #[arg(long, value_enum, default_value = "bin", conflicts_with = "ply")]
    format: FileFormat,
    /// Write the splats, in the colours of the orthophoto, to this file
    #[arg(long, value_name = "FILE", group = "form", value_parser = ending(&["ply"]))]
    ply: Option<PathBuf>,
    /// Columns and axes of the splats
    #[arg(long, value_enum, default_value = "3dgs", conflicts_with = "colmap")]
    variant: Variant,
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
    /// The same with y down (x east, z north), which viewers of COLMAP scenes show upright
    YDown,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    if let Some(file) = &args.ply {
        let variant = match args.variant {
            Variant::Full => PlyVariant::Full,
            Variant::YDown => PlyVariant::YDown,
        };
        let ply = export_ply(&args.run, file, variant, args.overwrite)?;
        let megabytes = ply.bytes as f64 / 1e6;
        let text = format!("{}, {} splats, {megabytes:.1} MB", ply.file.display(), ply.splats);
        return ui.summary("export", Some(&text), &ply);
    }
    let Some(folder) = &args.colmap else { return Ok(()) };
    let format = match args.format {
        FileFormat::Bin => Format::Binary,
        FileFormat::Text => Format::Text,
    };
    let exported = export_colmap(&args.run, folder, format, args.overwrite, ui)?;
    ui.summary("export", Some(&table(&exported)), &exported)
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
