//! Sections of the page of a perspective scene.

use super::ReportError;
use super::pictures::img_of_file;
use super::sections::{missing, read_if_present, table};
use crate::io::{ReadError, escape_xml};
use crate::perspective::ColorRegistration;
use crate::run_files::{PRIOR_PICTURES, SCENE, START};
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

/// Whether the run is of a perspective scene, by the content of its `scene.json`.
pub(super) fn is_perspective(run: &Path) -> Result<bool, ReportError> {
    Ok(read_if_present::<Value>(&run.join(SCENE))?.is_some_and(|scene| scene["kind"] == "perspective"))
}

/// The views: how the scene was read, and a table.
pub(super) fn views(run: &Path) -> Result<String, ReportError> {
    let Some(scene) = read_if_present::<Value>(&run.join(SCENE))? else {
        return Ok(missing("run SCENE -o RUN"));
    };
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let views = scene["views"].as_array().cloned().unwrap_or_default();
    let mut out = format!(
        "<p>{} views ({}), {} points{}. {}</p>\n",
        views.len(),
        escape_xml(&text(&scene["layout"])),
        scene["points"],
        match scene["options"]["downsampling"].as_u64() {
            Some(factor) if factor > 1 => format!("; images at 1/{factor} of their size"),
            _ => String::new(),
        },
        match scene["georeference"]["grid"]["epsg"].as_u64() {
            Some(epsg) => format!("Positions are in metres of EPSG:{epsg}."),
            None => "Positions are in the frame of the scene's own files.".to_owned(),
        }
    );
    if let Ok(registration) = serde_json::from_value::<ColorRegistration>(scene["registration"].clone()) {
        let _ = writeln!(out, "<p class=\"note\">{}</p>", escape_xml(&registration.to_string()));
    }
    for skipped in scene["skipped"].as_array().into_iter().flatten() {
        let (name, reason) = (text(&skipped[0]), text(&skipped[1]));
        let _ =
            writeln!(out, "<p class=\"note\">Left out: {}, {}</p>", escape_xml(&name), escape_xml(&reason));
    }
    let rows = views.iter().map(|view| {
        let role = if view["role"] == "test" { "test" } else { "training" };
        let size = format!("{} x {}", view["size"][0], view["size"][1]);
        vec![text(&view["name"]), size, role.to_owned()]
    });
    out.push_str(&table("Views", &["view", "pixels", "used for"], rows));
    Ok(out)
}

/// The depths that training started from, and the pseudo-views that show where no view sees anything.
pub(super) fn start(run: &Path) -> Result<String, ReportError> {
    figures(&run.join(START), |stem| {
        if stem.starts_with("pseudo-") {
            "points of the views, holes (purple), and depths with the holes filled (near is light)"
        } else {
            "aligned depths (near is light), and their local correction (red: farther, blue: nearer; 10 % in full colour)"
        }
    })
}

/// Priors beside what was trained.
pub(super) fn priors(run: &Path) -> Result<String, ReportError> {
    figures(
        &run.join(PRIOR_PICTURES),
        |_| "image, rendered depths and those of the prior (near is light), rendered normals and those of the prior",
    )
}

/// The pictures of a folder in the order of their names, with what they show.
fn figures(folder: &Path, shown: impl Fn(&str) -> &'static str) -> Result<String, ReportError> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .map_err(|e| ReadError::new(folder, e))?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.ends_with(".png"))
        .collect();
    names.sort();
    let mut out = String::new();
    for name in names {
        let stem = name.trim_end_matches(".png");
        let alt = format!("{stem}: {}", shown(stem));
        let picture = img_of_file(&folder.join(&name), &alt)?;
        let _ = writeln!(out, "<figure>{picture}<figcaption>{}</figcaption></figure>", escape_xml(&alt));
    }
    Ok(out)
}
