//! `satgs plan`: the tiles of a scene that is too large for one training.

use super::{CliError, Ui, ba, parse_metres, train};
use crate::mvs::DSM_CELL_M;
use crate::pipeline::{Outcome, adjust};
use crate::run_files::PLAN;
use crate::splat::recipe::Recipe;
use crate::tiles::{Plan, PlanOptions, TileSurface, plan};
use std::path::Path;

/// Plan the tiles of a large scene: writes RUN/tiles.json with each tile's predicted time and memory
///
/// Adjusts the scene first, unless RUN is adjusted already: tiles need the heights of its sparse points. Then cuts the area into
/// equal tiles of at most --core metres. `satgs run` makes all of them on this machine; on a cluster every tile is one job,
/// `satgs tile run RUN ID`.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: satgs plan scene -o run && jq -r '.tiles[].id' run/tiles.json")]
pub struct Args {
    #[command(flatten)]
    ba: ba::Args,
    #[command(flatten)]
    tiling: Options,
    #[command(flatten)]
    training: train::Options,
    /// Side of a cell of the surface model, metres
    #[arg(
        long, default_value_t = DSM_CELL_M, value_name = "M", value_parser = parse_metres,
        help_heading = "Products"
    )]
    resolution: f64,
    /// Vertical reference of dsm.tif: `ellipsoid`, EGM84, EGM96, EGM2008 or a geoid grid (.gtx, .tif of PROJ) [default: the
    /// ellipsoid]
    #[arg(long, value_name = "REFERENCE", help_heading = "Products")]
    vertical: Option<String>,
    /// Also interpolate across cells without any height, holes up to this width, metres [default: they stay nodata]
    #[arg(long, value_name = "M", help_heading = "Products")]
    fill: Option<f64>,
    /// Leave cells that fewer than two views confirm as nodata [default: they are filled in from the cells around them]
    #[arg(long, conflicts_with = "fill", help_heading = "Products")]
    no_fill: bool,
}

/// How an area is cut.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "tiling")]
pub struct Options {
    /// Largest side of the core of a tile, metres; an area of up to 1.5 times this side is not cut
    #[arg(long, default_value_t = PlanOptions::default().core_m, value_name = "M", value_parser = parse_metres,
        hide_short_help = true, help_heading = "Run")]
    pub core: f64,
    /// Width of the ground around the core that is trained, too, metres; tiles are blended there
    #[arg(long, default_value_t = PlanOptions::default().overlap_m, value_name = "M", value_parser = parse_metres,
        hide_short_help = true, help_heading = "Run")]
    pub overlap: f64,
    /// Memory that the training of a tile may take, such as 3GB [default: no limit]
    ///
    /// Tiles are halved until their predicted memory is below it.
    #[arg(long, value_name = "SIZE", value_parser = parse_megabytes, hide_short_help = true, help_heading = "Run")]
    pub max_memory: Option<f64>,
}

/// A size in bytes with a decimal unit, in megabytes.
fn parse_megabytes(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let digits = text.trim_end_matches(|c: char| c.is_alphabetic()).trim_end();
    let factor = match text[digits.len()..].trim().to_ascii_uppercase().as_str() {
        "MB" | "M" => 1.0,
        "GB" | "G" => 1e3,
        "TB" | "T" => 1e6,
        _ => return Err("expected a number with the unit MB or GB, e.g. 3GB".into()),
    };
    let size = digits.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0);
    size.map(|v| v * factor)
        .ok_or_else(|| "expected a number above 0 with the unit MB or GB, e.g. 3GB".into())
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let (run, overwrite) = (args.ba.output(), args.ba.overwrite());
    let options = PlanOptions {
        core_m: args.tiling.core,
        overlap_m: args.tiling.overlap,
        max_memory_mb: args.tiling.max_memory,
        resolution_m: args.resolution,
        surface: TileSurface {
            vertical: args.vertical.clone(),
            fill_m: args.fill,
            no_fill: args.no_fill,
            ..TileSurface::default()
        },
        train: args.training.options(Recipe::NAMES[0], overwrite),
        overwrite,
    };
    options.check()?;
    let scene = args.ba.read(ui)?;
    let adjusted = adjust(&scene, &args.ba.options(), run, ui)?;
    ba::show(&adjusted, ui)?;
    show(run, &plan(run, &options, ui)?, ui)?;
    ba::require_all(run, adjusted.left_out(), ui)
}

/// Shows the summary of a plan.
pub fn show(run: &Path, outcome: &Outcome<Plan>, ui: &Ui) -> Result<(), CliError> {
    let text = |plan: &Plan| {
        let count = plan.tiles.len();
        let [w, s, e, n] = plan.tiles.first().map_or([0.0; 4], |tile| tile.core);
        let total = plan.total;
        format!(
            "{count} tiles of {:.0} x {:.0} m with an overlap of {} m\n\
             predicted on two cores: {}, at most {:.1} GB of memory, {:.1} GB read\n{}",
            e - w,
            n - s,
            plan.overlap_m,
            duration(total.seconds_2core),
            total.memory_mb / 1e3,
            total.read_mb / 1e3,
            run.join(PLAN).display()
        )
    };
    ui.outcome("plan", outcome, text)
}

/// A duration in the unit that suits it.
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} minutes", s / 60.0),
        s => format!("{:.1} hours", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_a_unit() {
        assert_eq!(parse_megabytes("3GB"), Ok(3000.0));
        assert_eq!(parse_megabytes("512 MB"), Ok(512.0));
        assert_eq!(parse_megabytes("\u{a0}3GB "), Ok(3000.0));
        for wrong in ["3", "GB", "-1GB", "3 parsec", "", "é"] {
            assert!(parse_megabytes(wrong).is_err(), "{wrong}");
        }
    }
}
