//! Lists of views: a TOML file, or a STAC Item or ItemCollection.
//!
//! Paths in a list are relative to the folder of the list, or URLs that GDAL reads ([`vsi::from_url`]).

use super::files::read_text;
use super::sidecar::Sidecars;
use super::source::{files_beside, no_rpc, view};
use super::{Aoi, Role, SceneError, Sun, View};
use crate::io::vsi;
use crate::rpc::formats::iso_date;
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

/// One view of a list.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    image: PathBuf,
    /// RPC file; without it, the RPC is searched beside and in the image.
    rpc: Option<PathBuf>,
    name: Option<String>,
    /// Azimuth and elevation, degrees.
    sun: Option<[f64; 2]>,
    /// ISO 8601.
    acquired: Option<String>,
    /// Raster of the size of the image, 0 at pixels without valid data.
    mask: Option<PathBuf>,
    #[serde(default)]
    test: bool,
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
        (stac_entries(&json).map_err(wrong)?, None)
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

impl Entry {
    /// Reads the view. `list` is the file that names it, for messages; paths are relative to `folder`.
    fn view(
        self,
        list: &Path,
        folder: &Path,
        trust_rpc: bool,
        warnings: &mut Vec<String>,
    ) -> Result<View, SceneError> {
        let wrong = |reason: String| SceneError::List { path: list.into(), reason };
        for file in [Some(&self.image), self.rpc.as_ref(), self.mask.as_ref()].into_iter().flatten() {
            let text = file.to_string_lossy();
            if let Some((scheme, _)) = text.split_once("://")
                && !vsi::is_virtual(file)
                && vsi::from_url(&text).is_none()
            {
                return Err(wrong(format!(
                    "`{text}`: URLs of `{scheme}` cannot be read; known are https, http, ftp, s3, gs, az and file"
                )));
            }
        }
        let image = vsi::join(folder, &self.image);
        let sidecars = match &self.rpc {
            Some(rpc) => Sidecars::with_camera(vsi::join(folder, rpc), &image, &files_beside(&image)?),
            None => Sidecars::of(&image, &files_beside(&image)?),
        };
        let mut view = view(&image, &sidecars, trust_rpc, warnings)?.ok_or_else(|| no_rpc(&image))?;
        if let Some([azimuth, elevation]) = self.sun {
            let sun = Sun::new(azimuth, elevation);
            view.sun = Some(sun.ok_or_else(|| {
                wrong(format!("sun = [{azimuth}, {elevation}] is not an azimuth and an elevation in degrees"))
            })?);
        }
        view.name = self.name.unwrap_or(view.name);
        if view.name.is_empty() || view.name.contains(['/', '\\']) {
            return Err(wrong(format!("the name `{}` cannot be used as a file name", view.name)));
        }
        if let Some(time) = self.acquired {
            let date = iso_date(&time).ok_or_else(|| wrong(format!("`{time}` is not an ISO 8601 date")));
            view.acquired = Some(date?);
        }
        view.role = if self.test { Role::Test } else { Role::Train };
        if let Some(mask) = self.mask {
            view.set_mask(vsi::join(folder, &mask))?;
        }
        Ok(view)
    }
}

/// The views of a STAC Item, or of the Items of an ItemCollection.
fn stac_entries(json: &Value) -> Result<Vec<Entry>, String> {
    match json.get("type").and_then(Value::as_str) {
        Some("Feature") => Ok(vec![stac_entry(json)?]),
        Some("FeatureCollection") => {
            let items = json.get("features").and_then(Value::as_array).ok_or("it has no `features`")?;
            items.iter().map(stac_entry).collect()
        }
        _ => Err("it is neither a STAC Item nor an ItemCollection".into()),
    }
}

fn stac_entry(item: &Value) -> Result<Entry, String> {
    let id = item.get("id").and_then(Value::as_str).unwrap_or("?");
    let assets =
        item.get("assets").and_then(Value::as_object).ok_or(format!("item `{id}` has no `assets`"))?;
    let href = |name: &str| {
        let asset = assets.iter().find(|(key, asset)| {
            let roles = asset.get("roles").and_then(Value::as_array);
            key.as_str() == name || roles.is_some_and(|r| r.iter().any(|role| role.as_str() == Some(name)))
        });
        asset.and_then(|(_, asset)| asset.get("href")?.as_str())
    };
    let image = ["image", "data", "visual"].iter().find_map(|n| href(n));
    let image = image.ok_or(format!("item `{id}` has no asset with the role `data`"))?;
    let property = |name: &str| item.get("properties")?.get(name);
    let angle = |name| property(name).and_then(Value::as_f64);
    Ok(Entry {
        image: image.into(),
        rpc: href("rpc").map(Into::into),
        name: Some(id.into()),
        sun: angle("view:sun_azimuth").zip(angle("view:sun_elevation")).map(|(a, e)| [a, e]),
        acquired: property("datetime").and_then(Value::as_str).map(str::to_owned),
        mask: href("data-mask").map(Into::into),
        test: false,
    })
}
