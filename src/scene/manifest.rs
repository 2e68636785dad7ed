//! Lists of views: a TOML file, or a STAC Item or ItemCollection (`stac.rs`).
//!
//! Paths in a list are relative to the folder of the list, or URLs that GDAL reads ([`vsi::from_url`]).

use super::files::read_text;
use super::listed::Entry;
use super::{Aoi, SceneError, View, stac};
use crate::io::vsi;
use serde::Deserialize;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Content of a TOML list.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Listed {
    /// West, south, east, north in degrees, or a GeoJSON file.
    aoi: Option<ListedAoi>,
    #[serde(default, rename = "view")]
    views: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum ListedAoi {
    Box([f64; 4]),
    File(PathBuf),
}

/// Reads the views of a list, and its area of interest if it has one.
pub(super) fn read(
    path: &Path,
    trust_rpc: bool,
    warnings: &mut Vec<String>,
) -> Result<(Vec<View>, Option<Aoi>), SceneError> {
    let text = read_text(path)?;
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let wrong = |reason: String| SceneError::List { path: path.into(), reason };
    let (entries, aoi) = if text.trim_start().starts_with('{') {
        let json: Value = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
        (stac::entries(&json, folder, warnings).map_err(wrong)?, None)
    } else {
        let listed: Listed =
            toml::from_str(&text).map_err(|e| wrong(e.to_string().trim().replace('\n', " ")))?;
        let aoi = match listed.aoi {
            Some(ListedAoi::Box(area)) => Some(Aoi::from_box(area)?),
            Some(ListedAoi::File(file)) => Some(Aoi::from_geojson(&vsi::join(folder, &file))?),
            None => None,
        };
        (listed.views, aoi)
    };
    let views =
        entries.into_iter().map(|e| e.view(path, folder, trust_rpc, warnings)).collect::<Result<_, _>>()?;
    Ok((views, aoi))
}
