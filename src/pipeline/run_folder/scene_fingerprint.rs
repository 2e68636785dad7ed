//! What of a scene an adjustment depends on.

use super::super::PipelineError;
use super::stage::{Fingerprint, hash, hash_file};
use crate::io::vsi;
use crate::scene::{Scene, sources_of};
use serde_json::Value;
use std::collections::BTreeMap;

/// Fields of a scene and of its views that options set, and other names a user knows them by.
const SCENE_FIELDS: [(&str, &str); 10] = [
    ("aoi", "--aoi"),
    ("transfer_function", "--gamma"),
    ("name", "names of the views"),
    ("window", "windows of the images (--aoi)"),
    ("bands", "--bands"),
    ("stretch_percent", "--stretch"),
    ("rpc", "cameras"),
    ("rpc_source", "files of the cameras (--rpcs)"),
    ("sun", "suns (--sun)"),
    ("role", "roles (test.txt)"),
];
/// Longest text of a field that is kept as text; longer ones are hashed.
const SHOWN_LENGTH: usize = 200;

/// Hashes of the images and masks, and all other fields of a scene. Paths may change, the content of files may not.
pub fn scene_fingerprint(scene: &Scene) -> Result<Fingerprint, PipelineError> {
    let mut out = Fingerprint::new();
    let mut content = scene.clone();
    content.warnings.clear();
    // The options that set them are part of the fingerprint of an adjustment.
    content.heights = None;
    for view in &mut content.views {
        // Which pixels are valid may be declared in a file beside the image as well. All pixels are read to find out, which an
        // image on the network is too far away for.
        let valid = if vsi::is_remote(&view.image) { None } else { view.valid_pixels_digest()? };
        if let Some(digest) = valid {
            out.insert(format!("valid pixels {}", view.name), digest);
        }
        for (i, source) in sources_of(&view.image).iter().enumerate() {
            out.insert(format!("image {}, source {}", view.name, i + 1), hash_file(source));
        }
        out.insert(format!("image {}", view.name), hash_file(&std::mem::take(&mut view.image)));
        if let Some(mask) = view.mask.take() {
            out.insert(format!("mask {}", view.name), hash_file(&mask));
        }
    }
    out.extend(scene_fields(&content)?);
    Ok(out)
}

/// The fields of a scene by what a user calls them: as text where that is short, else as a hash.
fn scene_fields(scene: &Scene) -> Result<Fingerprint, PipelineError> {
    let mut out = Fingerprint::new();
    let mut insert = |field: &str, value: String| {
        let name = SCENE_FIELDS.iter().find(|f| f.0 == field).map_or(field, |f| f.1);
        out.insert(name.into(), if value.len() > SHOWN_LENGTH { hash(value.as_bytes()) } else { value });
    };
    let json =
        serde_json::to_value(scene).map_err(|source| PipelineError::Json { what: "the scene", source })?;
    let by_name = json.as_object().into_iter().flatten();
    for (field, value) in by_name.filter(|f| f.0 != "views") {
        insert(field, value.to_string());
    }
    let mut by_field = BTreeMap::<&str, Vec<(&Value, &Value)>>::new();
    for view in json["views"].as_array().into_iter().flatten() {
        for (field, value) in view.as_object().into_iter().flatten() {
            by_field.entry(field).or_default().push((&view["name"], value));
        }
    }
    for (field, values) in by_field {
        let first = values[0].1;
        let is_common = values.len() == scene.views.len() && values.iter().all(|v| v.1 == first);
        let all: Vec<String> = values.iter().map(|(view, value)| format!("{view}: {value}")).collect();
        insert(field, if is_common { first.to_string() } else { all.join(", ") });
    }
    Ok(out)
}
