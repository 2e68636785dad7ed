//! The sections of the page; each is made from the files of one stage.

use super::figures::FIGURES;
use super::pictures::{img, map_of_page, rgb_of, shaded};
use super::{ReportError, SCORE_NOTE, ScoreTable, expected_error_text, map, score_tables};
use crate::bundle::{ADJUSTMENT_FIGURES, Report};
use crate::dsm::{CellCounts, VIEWS_BAND};
use crate::io::{Chart, Grid2, MapGrid, ReadError, escape_xml, read_json};
use crate::metrics::{error_picture, onto_grid};
use crate::run_files::{
    ADJUSTMENT, ADJUSTMENT_REPORT, CONFIDENCE, DSM, ERROR_MAP, EVALUATION, METRICS, SCENE, STAGE,
    TRAIN_STAGE, TRAINING_LOG,
};
use crate::scene::{Role, Scene};
use serde::de::DeserializeOwned;
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

/// Longest side of a thumbnail, pixels.
const THUMBNAIL: usize = 240;
/// Largest number of points of a curve; more are averaged in groups.
const CURVE_POINTS: usize = 240;
/// Stages that write a record of their command and inputs.
const STAGES: [&str; 3] = [ADJUSTMENT, TRAIN_STAGE, "dsm"];

/// The views: thumbnails, table of angles, sky plot.
pub(super) fn inputs(run: &Path) -> Result<String, ReportError> {
    let Some(scene) = read_if_present::<Scene>(&run.join(SCENE))? else {
        return Ok(missing("ba SCENE -o RUN"));
    };
    let (low, high) = scene.height_range();
    let mut out =
        format!("<p>{} views, heights searched from {low:.0} to {high:.0} m.</p>\n", scene.views.len());
    for warning in &scene.warnings {
        let _ = writeln!(out, "<p class=\"note\">{}</p>", escape_xml(warning));
    }
    out.push_str("<div class=\"thumbnails\">\n");
    for view in &scene.views {
        let name = escape_xml(&view.name);
        // The images may have been moved since the run.
        let picture = match view.thumbnail(THUMBNAIL) {
            Ok(colors) => {
                let (w, h) = (colors[0].width, colors[0].height);
                img(w, h, &rgb_of(&colors), &format!("Image {}", view.name), "")?
            }
            Err(_) => format!(
                "<p class=\"note\">`{}` cannot be read</p>",
                escape_xml(&view.image.display().to_string())
            ),
        };
        let _ = writeln!(out, "<figure>{picture}<figcaption>{name}</figcaption></figure>");
    }
    out.push_str("</div>\n");
    let rows = scene.views.iter().map(|view| {
        let sun = view.sun.map(|s| (degrees(s.azimuth_deg), degrees(s.elevation_deg))).unwrap_or_default();
        let seen =
            view.direction_deg(0.5 * (low + high)).map(|(a, z)| (degrees(a), degrees(z))).unwrap_or_default();
        let role = if view.role == Role::Test { "test" } else { "training" };
        let size = format!("{} x {}", view.width, view.height);
        let acquired = view.acquired.clone().unwrap_or_default();
        vec![view.name.clone(), acquired, size, seen.0, seen.1, sun.0, sun.1, role.into()]
    });
    let head =
        ["view", "acquired", "pixels", "azimuth", "off-nadir", "sun azimuth", "sun elevation", "used for"];
    out.push_str(&table("Views", &head, rows));
    if let Ok([ground, sky]) = scene.overlap().and_then(|overlap| scene.skyplots(&overlap)) {
        let _ = writeln!(
            out,
            "<div class=\"charts\">\n<figure>{}<figcaption>Footprints of the views (blue) and the area of interest \
             (green)</figcaption></figure>\n<figure>{}<figcaption>The sky above the scene, with the zenith in the middle: \
             satellites are blue, hollow for test views, suns are orange</figcaption></figure>\n</div>",
            ground.svg("footprints of the views on the ground"),
            sky.svg("directions to satellites and suns in the sky")
        );
    }
    Ok(out)
}

/// Residuals of the bundle adjustment of a run, as HTML.
///
/// # Errors
/// [`ReportError`] if a file is damaged.
pub fn adjustment(run: &Path) -> Result<String, ReportError> {
    let Some(report) = read_if_present::<Report>(&run.join(ADJUSTMENT).join(ADJUSTMENT_REPORT))? else {
        return Ok(missing("ba SCENE -o RUN"));
    };
    let mut out = format!(
        "<p>{} tracks, {} observations; mean reprojection error {:.3} px before, {:.3} px after. Datum: {}.</p>\n",
        report.tracks,
        report.observations,
        report.mean_before_px,
        report.mean_px,
        escape_xml(&report.gauge)
    );
    let rows = report.views.iter().map(|v| {
        let px = [v.mean_before_px, v.mean_px, v.rms_px, v.shift_px[0], v.shift_px[1]];
        let numbers = px.iter().map(|n| format!("{n:.3}"));
        [v.name.clone(), v.observations.to_string()].into_iter().chain(numbers).collect()
    });
    let head = ["view", "points", "before px", "after px", "RMS px", "shift col px", "shift row px"];
    out.push_str(&table("Residuals", &head, rows));
    let captions = [
        "Residuals of the tie points in each view, enlarged 40 times",
        "",
        "Views on a circle: the darker a line, the more tie points two views share",
        "",
    ];
    out.push_str("<div class=\"charts\">\n");
    for (name, caption) in ADJUSTMENT_FIGURES.iter().zip(captions) {
        let Ok(svg) = std::fs::read_to_string(run.join(ADJUSTMENT).join(name)) else { continue };
        let caption =
            if caption.is_empty() { String::new() } else { format!("<figcaption>{caption}</figcaption>") };
        let _ = writeln!(out, "<figure>{svg}{caption}</figure>");
    }
    out.push_str("</div>\n");
    for (view, reason) in &report.left_out {
        let _ = writeln!(out, "<p class=\"note\">Left out: {}, {}</p>", escape_xml(view), escape_xml(reason));
    }
    Ok(out)
}

/// Curves of the training.
pub(super) fn training(run: &Path) -> Result<String, ReportError> {
    let path = run.join(TRAIN_STAGE).join(TRAINING_LOG);
    if !path.exists() {
        return Ok(missing("train RUN"));
    }
    let damaged = |e: csv::Error| ReadError::new(&path, e);
    let mut reader = csv::Reader::from_path(&path).map_err(damaged)?;
    let names: Vec<String> = reader.headers().map_err(damaged)?.iter().map(str::to_owned).collect();
    let lines = reader.records().collect::<Result<Vec<_>, _>>().map_err(damaged)?;
    let numbers = |name: &str| -> Vec<f64> {
        let column = names.iter().position(|n| n == name);
        let number = |line: &csv::StringRecord| line.get(column?)?.parse().ok();
        lines.iter().map(|l| number(l).unwrap_or(f64::NAN)).collect()
    };
    let iterations = numbers("iteration");
    let curve = |name: &str| -> Vec<(f64, f64)> {
        let block = lines.len().div_ceil(CURVE_POINTS).max(1);
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        iterations.chunks(block).zip(numbers(name).chunks(block)).map(|(i, v)| (mean(i), mean(v))).collect()
    };
    let chart = |title: &str, y: &str, lines: &[(&str, &str)]| Chart {
        title: title.into(),
        x: "iteration".into(),
        y: y.into(),
        lines: lines.iter().map(|(name, column)| ((*name).to_owned(), curve(column))).collect(),
    };
    let charts = [
        chart("Loss", "loss, mean absolute colour difference", &[("loss", "loss"), ("L1", "l1")]),
        chart("Structural similarity", "SSIM", &[("SSIM", "ssim")]),
        chart("Splats", "number", &[("splats", "splats")]),
    ];
    let (seconds, splats) = (numbers("seconds"), numbers("splats"));
    let last = |v: &[f64]| v.last().copied().unwrap_or(f64::NAN);
    Ok(format!(
        "<p>{} iterations in {:.0} s, {:.0} splats.</p>\n{}",
        lines.len(),
        last(&seconds),
        last(&splats),
        figures(charts.iter().filter_map(Chart::svg))
    ))
}

/// What the surface model of a run rests on, as HTML: extent, shares and map of confirmed and filled cells.
///
/// # Errors
/// [`ReportError`] if a raster cannot be read.
pub fn surface(run: &Path) -> Result<String, ReportError> {
    let path = run.join(DSM);
    if !path.exists() {
        return Ok(missing("dsm RUN"));
    }
    let (bands, grid) = map_of_page(&path)?;
    let height = &bands[0];
    let (low, high) =
        height.valid().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let confidence = run.join(CONFIDENCE);
    let counts = CellCounts::of_files(&path, &confidence)?;
    let (west, south, east, north) = grid.bounds();
    let mut out = format!(
        "<p>EPSG:{}, {west:.1} to {east:.1} m east, {south:.1} to {north:.1} m north; heights from {low:.1} to {high:.1} m; \
         {}.</p>\n",
        grid.epsg,
        counts.text(),
    );
    if counts.confirmed.is_some() {
        let (confidence, of) = map_of_page(&confidence)?;
        if let Some(views) = confidence.get(VIEWS_BAND - 1).filter(|_| of == grid) {
            let _ = writeln!(out, "<div class=\"maps\">\n{}</div>", map::confidence(height, views, &grid)?);
        }
    }
    Ok(out)
}

/// Scores: error map over the surface, tables, figures.
pub fn scores(run: &Path) -> Result<String, ReportError> {
    let folder = run.join(EVALUATION);
    let Some(scores) = read_if_present::<Value>(&folder.join(METRICS))? else {
        return Ok(missing("run SCENE -o RUN --truth DSM"));
    };
    let mut out = String::new();
    let (dsm, errors) = (run.join(DSM), folder.join(ERROR_MAP));
    if dsm.exists() && errors.exists() {
        let ((surface, from), (errors, grid)) = (map_of_page(&dsm)?, map_of_page(&errors)?);
        if let Ok((surface, _)) = onto_grid(&surface[0], &from, &grid) {
            out.push_str(&slider(&surface, &errors[0], &grid)?);
        }
    }
    for ScoreTable { name, head, rows } in score_tables(&scores) {
        out.push_str(&table(name, head, rows.into_iter()));
    }
    for text in [expected_error_text(&scores), Some(SCORE_NOTE.into())].into_iter().flatten() {
        let _ = writeln!(out, "<p class=\"note\">{}.</p>", escape_xml(&text));
    }
    for note in scores["notes"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        let _ = writeln!(out, "<p class=\"note\">{}</p>", escape_xml(note));
    }
    out.push_str(&figures(FIGURES.iter().filter_map(|name| std::fs::read_to_string(folder.join(name)).ok())));
    Ok(out)
}

/// Version, command and inputs of every stage, as HTML.
///
/// # Errors
/// [`ReportError`] if a record is damaged.
pub fn commands(run: &Path) -> Result<String, ReportError> {
    let mut out = String::new();
    for stage in STAGES {
        let Some(record) = read_if_present::<Value>(&run.join(stage).join(STAGE))? else { continue };
        let text = |key: &str| escape_xml(record[key].as_str().unwrap_or("not recorded"));
        let made_from = record["made_from"].as_object().into_iter().flatten();
        let rows = made_from.map(|(k, v)| vec![k.clone(), v.as_str().unwrap_or_default().to_owned()]);
        let _ = writeln!(
            out,
            "<h3>{stage}</h3>\n<p>satgs {}: <code>{}</code></p>\n<details><summary>Inputs and options</summary>\n{}</details>",
            text("satgs"),
            text("command"),
            table(&format!("Inputs and options of {stage}"), &["input or option", "value or hash"], rows)
        );
    }
    Ok(out)
}

fn slider(surface: &Grid2, errors: &Grid2, grid: &MapGrid) -> Result<String, ReportError> {
    let picture = error_picture(errors);
    let alt = "Height errors after registration xyz: red where the prediction is too high, blue where it is too low";
    let scale = error_picture(&Grid2::from_fn(61, 2, |col, _| 0.1 * (col as f32 - 30.0)));
    Ok(format!(
        "<figure class=\"compare\" style=\"--at:50%\">\n<div class=\"pair\">{}{}<span class=\"edge\"></span></div>\n\
         <input type=\"range\" min=\"0\" max=\"100\" value=\"50\" aria-label=\"Position of the border between surface and error \
         map\">\n<div class=\"scale\"><span>3 m too low</span>{}<span>3 m too high</span></div>\n<figcaption>Left: hillshade of \
         the surface; right: its errors against the truth after registration xyz; grey cells are not scored.</figcaption>\n</figure>\n",
        shaded(surface, grid, "Hillshade of the surface model on the truth's grid")?,
        img(picture.width, picture.height, &picture.data, alt, "over")?,
        img(
            scale.width,
            scale.height,
            &scale.data,
            "Colour scale of errors from -3 m, blue, to +3 m, red",
            ""
        )?
    ))
}

fn figures(svgs: impl Iterator<Item = String>) -> String {
    let all: String = svgs.map(|svg| format!("<figure>{svg}</figure>\n")).collect();
    format!("<div class=\"charts\">\n{all}</div>\n")
}

/// A table as HTML. `name` describes it for screen readers; each row has as many cells as `head`.
#[must_use]
pub fn table(name: &str, head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let cells = |tag: &str, texts: &mut dyn Iterator<Item = String>| -> String {
        let end = tag.split(' ').next().unwrap_or(tag);
        texts.map(|t| format!("<{tag}>{}</{end}>", escape_xml(&t))).collect()
    };
    let head = cells("th scope=\"col\"", &mut head.iter().map(|h| (*h).to_owned()));
    let rows: String = rows.map(|r| format!("<tr>{}</tr>\n", cells("td", &mut r.into_iter()))).collect();
    format!(
        "<section class=\"table\" aria-label=\"{name}\" tabindex=\"0\"><table>\n<thead><tr>{head}</tr></thead>\n\
         <tbody>\n{rows}</tbody>\n</table></section>\n"
    )
}

fn degrees(angle: f64) -> String {
    format!("{angle:.1}°")
}

pub(super) fn missing(command: &str) -> String {
    format!("<p class=\"note\">Not available yet: <code>satgs {command}</code> computes it.</p>\n")
}

/// A JSON file of the run; none if the file does not exist.
pub(super) fn read_if_present<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, ReportError> {
    if path.exists() { Ok(Some(read_json(path)?)) } else { Ok(None) }
}
