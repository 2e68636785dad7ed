//! The page of a run of tiles.

use super::TilesError;
use super::colour::TileColors;
use super::done::Done;
use super::mosaicked::Mosaicked;
use super::plan::Plan;
use super::seams::Seam;
use crate::io::{MapGrid, write_file};
use crate::pipeline::PipelineError;
use crate::report;
use crate::run_files::{DSM, PAGE};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Figures that the seams of a mosaic should not exceed: median and 95th percentile of the steps in metres, share of the
/// cells that differ by more than 1 m, difference of grey values after the correction, of 255.
const BARS: [f64; 4] = [0.10, 0.25, 0.03, 2.0];
/// Steps up to which a seam is drawn in a colour, metres, and the colours; red for larger ones, grey without a step.
const STEP_COLORS: [(f64, &str); 3] = [(0.05, "#009e73"), (0.10, "#f0e442"), (0.25, "#e69f00")];
const LARGEST_STEP_COLOR: &str = "#d7191c";
const NO_STEP_COLOR: &str = "#999999";

/// Writes the page; returns its path.
pub(super) fn write_page(
    run: &Path,
    plan: &Plan,
    summary: &Mosaicked,
    seams: &[Seam],
    colors: &TileColors,
) -> Result<PathBuf, TilesError> {
    let adjustment = report::adjustment(run).map_err(PipelineError::from)?;
    let sections = [
        ("result", "Result", report::result(run).map_err(PipelineError::from)?),
        ("surface", "Surface", report::surface(run).map_err(PipelineError::from)?),
        ("seams", "Seams", seam_section(run, summary, seams, colors)?),
        ("tiles", "Tiles", tile_section(run, plan, summary)),
        ("scores", "Scores", report::scores(run).map_err(PipelineError::from)?),
        ("adjustment", "Adjustment", adjustment),
        ("commands", "Versions and commands", report::commands(run).map_err(PipelineError::from)?),
    ];
    let notes: Vec<String> = plan.require_current(run).err().iter().map(TilesError::chain).collect();
    let path = run.join(PAGE);
    write_file(&path, report::page(run, &notes, &sections))?;
    Ok(path)
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".into(), |v| format!("{v:.digits$}"))
}

fn seam_section(
    run: &Path,
    summary: &Mosaicked,
    seams: &[Seam],
    colors: &TileColors,
) -> Result<String, TilesError> {
    let s = &summary.seams;
    let row = |name: &str, value: Option<f64>, digits: usize, bar: Option<f64>| {
        let verdict = value.zip(bar).map_or("–", |(v, bar)| if v <= bar { "yes" } else { "no" });
        vec![name.into(), number(value, digits), number(bar, digits), verdict.into()]
    };
    let rows = [
        row("median over the seams of |median height difference|, m", s.step_m, 3, Some(BARS[0])),
        row("95th percentile of the same, m", s.step_p95_m, 3, Some(BARS[1])),
        row("share of the cells that differ by more than 1 m", s.over_1m, 4, Some(BARS[2])),
        row(
            "median over the seams of |median difference of grey values| before correction, of 255",
            s.ortho_before,
            1,
            None,
        ),
        row("the same after correction", s.ortho_after, 1, Some(BARS[3])),
        row("median absolute difference of grey values in a cell, of 255", s.ortho_spread, 1, None),
    ];
    let mut out = format!("<p>{} seams between {} tiles.</p>\n", s.seams, summary.tiles);
    out.push_str(&report::table("Seams", &["figure", "value", "limit", "within limit"], rows.into_iter()));
    let (bands, grid) = report::map_of_page(&run.join(DSM))?;
    let picture = report::shaded(&bands[0], &grid, "Hillshade of the mosaic with the seams")?;
    let limits: Vec<String> = STEP_COLORS.iter().map(|(limit, _)| format!("{limit:.2}")).collect();
    let _ = writeln!(
        out,
        "<figure><div style=\"position:relative;max-width:{}px\">{picture}{}</div><figcaption>Steps at the seams: green, \
         yellow and orange up to {} m, red above; grey where tiles have no common cell.</figcaption></figure>",
        grid.width,
        lines(seams, &grid),
        limits.join(", ")
    );
    let mut largest: Vec<&Seam> = seams.iter().collect();
    largest.sort_by(|a, b| {
        b.median_m.map(f64::abs).unwrap_or(0.0).total_cmp(&a.median_m.map(f64::abs).unwrap_or(0.0))
    });
    let rows = largest.into_iter().map(|seam| {
        let color = colors.step(seam);
        vec![
            seam.tiles.join(", "),
            number(seam.median_m, 3),
            number(seam.nmad_m, 3),
            number(seam.over_1m, 4),
            seam.cells.to_string(),
            number(color.map(|c| c.before), 1),
            number(color.map(|c| c.after), 1),
        ]
    });
    let head = ["tiles", "step m", "NMAD m", ">1 m", "cells", "grey before", "grey after"];
    let table = report::table("Seams by step", &head, rows);
    let _ = writeln!(out, "<details><summary>All seams, largest step first</summary>\n{table}</details>");
    Ok(out)
}

/// The seams as lines over a picture of a grid.
fn lines(seams: &[Seam], grid: &MapGrid) -> String {
    let mut out = format!(
        "<svg viewBox=\"0 0 {} {}\" preserveAspectRatio=\"none\" aria-hidden=\"true\" \
         style=\"position:absolute;inset:0;width:100%;height:100%\">\n",
        grid.width, grid.height
    );
    for seam in seams {
        let [a, b] =
            seam.line.map(|[east, north]| [(east - grid.west) / grid.cell, (grid.north - north) / grid.cell]);
        let within = |step: f64| STEP_COLORS.iter().find(|(limit, _)| step.abs() <= *limit);
        let color =
            seam.median_m.map_or(NO_STEP_COLOR, |step| within(step).map_or(LARGEST_STEP_COLOR, |c| c.1));
        let _ = writeln!(
            out,
            "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"{color}\" stroke-width=\"3\"/>",
            a[0], a[1], b[0], b[1]
        );
    }
    out.push_str("</svg>");
    out
}

fn tile_section(run: &Path, plan: &Plan, summary: &Mosaicked) -> String {
    let rows = plan.tiles.iter().map(|tile| {
        let failed = summary.failed.iter().find(|f| f.id == tile.id);
        let done = Done::of_tile(run, tile).filter(|_| failed.is_none());
        let done = done.as_ref();
        vec![
            tile.id.clone(),
            failed.map_or_else(|| "done".into(), |f| f.reason.clone()),
            tile.views.len().to_string(),
            number(done.map(|d| d.splats as f64), 0),
            number(Some(tile.cost.seconds_2core), 0),
            number(done.map(|d| d.seconds), 0),
            number(Some(tile.cost.memory_mb), 0),
            number(done.and_then(|d| d.peak_memory_mb), 0),
        ]
    });
    let head =
        ["tile", "state", "views", "splats", "predicted s", "measured s", "predicted MB", "measured MB"];
    report::table("Tiles", &head, rows)
}
