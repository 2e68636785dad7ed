//! Sections of the page of a perspective scene.

use super::ReportError;
use super::sections::{missing, read_if_present, table};
use crate::io::escape_xml;
use crate::run_files::SCENE;
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
        "<p>{} views ({}), {} points; images at 1/{} of their size. {}</p>\n",
        views.len(),
        escape_xml(&text(&scene["layout"])),
        scene["points"],
        scene["options"]["downsampling"],
        match scene["georeference"]["grid"]["epsg"].as_u64() {
            Some(epsg) => format!("Positions are in metres of EPSG:{epsg}."),
            None => "Positions are in the frame of the scene's own files.".to_owned(),
        }
    );
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
