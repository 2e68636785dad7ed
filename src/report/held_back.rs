//! The section of views that were held back from training.

use super::ReportError;
use super::pictures::img_of_file;
use super::sections::{read_if_present, table};
use crate::io::escape_xml;
use crate::run_files::{NVS_PICTURES, NVS_SCORES};
use serde_json::Value;
use std::fmt::Write;
use std::path::Path;

/// Views that were held back: scores, and pictures of image, render and difference.
pub(super) fn held_back(run: &Path) -> Result<String, ReportError> {
    let Some(scores) = read_if_present::<Value>(&run.join(NVS_SCORES))? else {
        return Ok("<p class=\"note\">No view was held back.</p>\n".to_owned());
    };
    let number =
        |value: &Value, digits: usize| value.as_f64().map_or("–".into(), |v| format!("{v:.digits$}"));
    let row = |name: &str, score: &Value| {
        vec![
            name.to_owned(),
            number(&score["psnr_db"], 2),
            number(&score["ssim"], 3),
            number(&score["ssim_3px"], 3),
            number(&score["lpips"], 3),
            number(&score["pixels"], 0),
        ]
    };
    let views = scores["views"].as_array().cloned().unwrap_or_default();
    let name = |view: &Value| view["view"].as_str().unwrap_or_default().to_owned();
    let rows = views.iter().map(|view| row(&name(view), &view["score"]));
    let rows = rows.chain([row("mean", &scores["mean"])]);
    let head = ["view", "PSNR dB", "SSIM", "SSIM 3", "LPIPS", "pixels"];
    let mut out = table("Scores of views that were held back", &head, rows);
    let shown = match scores["protocol"].as_str() {
        Some(protocol) => {
            let _ = writeln!(out, "<p>Protocol: {}.</p>", escape_xml(protocol));
            "image, rendering, difference (white is none), share of sunlight"
        }
        None => "image, rendering, difference (white is none)",
    };
    for (i, view) in views.iter().enumerate() {
        let path = run.join(format!("{NVS_PICTURES}/{i:04}.png"));
        let name = name(view);
        let alt = format!("Image of {name}, its render, and their difference");
        if let Some(picture) = path.exists().then(|| img_of_file(&path, &alt)).transpose()? {
            let _ = writeln!(
                out,
                "<figure>{picture}<figcaption>{}: {shown}</figcaption></figure>",
                escape_xml(&name)
            );
        }
    }
    Ok(out)
}
