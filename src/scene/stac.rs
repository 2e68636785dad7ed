//! STAC Items (<https://github.com/radiantearth/stac-spec>) as entries of a list of views.

use super::files::has_extension;
use super::listed::Entry;
use crate::io::vsi;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Names and roles of the asset that is the image, the first ones preferred.
const IMAGE: [&str; 3] = ["image", "data", "visual"];
/// Endings of files that are no images, of assets that state no type.
const NO_IMAGES: [&str; 6] = ["json", "geojson", "xml", "txt", "imd", "rpb"];

/// The views of a STAC Item, or of the Items of an ItemCollection, in a folder. Warns where an Item has several images.
pub(super) fn entries(json: &Value, folder: &Path, warnings: &mut Vec<String>) -> Result<Vec<Entry>, String> {
    match json.get("type").and_then(Value::as_str) {
        Some("Feature") => Ok(vec![entry(json, folder, warnings)?]),
        Some("FeatureCollection") => {
            let items = json.get("features").and_then(Value::as_array).ok_or("it has no `features`")?;
            items.iter().map(|item| entry(item, folder, warnings)).collect()
        }
        _ => Err("it is neither a STAC Item nor an ItemCollection".into()),
    }
}

fn entry(item: &Value, folder: &Path, warnings: &mut Vec<String>) -> Result<Entry, String> {
    let id = item.get("id").and_then(Value::as_str).unwrap_or("?");
    let assets =
        item.get("assets").and_then(Value::as_object).ok_or(format!("item `{id}` has no `assets`"))?;
    let images = IMAGE.iter().map(|name| of_role(assets, name));
    let images = images
        .map(|found| found.into_iter().filter(|(_, asset)| is_image(asset)).collect::<Vec<_>>())
        .find(|found| !found.is_empty())
        .ok_or(format!(
            "item `{id}` has no image: an asset of type image/… with the name or role `data`; it has {}",
            described(assets)
        ))?;
    // Matching wants the sharpest band.
    let (name, image) =
        *images.iter().find(|(name, asset)| is_panchromatic(name, asset)).unwrap_or(&images[0]);
    if images.len() > 1 {
        let others: Vec<&str> = images.iter().map(|(key, _)| *key).filter(|key| *key != name).collect();
        warnings.push(format!(
            "item `{id}`: of several images `{name}` is used, not {}; a TOML list names others",
            others.join(", ")
        ));
    }
    let first = |name: &str| of_role(assets, name).first().and_then(|(_, asset)| href(asset, folder));
    let property = |name: &str| item.get("properties")?.get(name);
    let angle = |name| property(name).and_then(Value::as_f64);
    Ok(Entry {
        image: href(image, folder).ok_or(format!("asset `{name}` of item `{id}` has no `href`"))?,
        rpc: first("rpc"),
        name: Some(id.into()),
        sun: angle("view:sun_azimuth").zip(angle("view:sun_elevation")).map(|(a, e)| [a, e]),
        acquired: property("datetime").and_then(Value::as_str).map(str::to_owned),
        mask: first("data-mask"),
        test: false,
    })
}

/// Assets of a name, else those that have it as a role.
fn of_role<'a>(assets: &'a Map<String, Value>, name: &str) -> Vec<(&'a str, &'a Value)> {
    if let Some((key, asset)) = assets.get_key_value(name) {
        return vec![(key.as_str(), asset)];
    }
    let has_role = |asset: &Value| {
        let roles = asset.get("roles").and_then(Value::as_array);
        roles.is_some_and(|r| r.iter().any(|role| role.as_str() == Some(name)))
    };
    assets.iter().filter(|(_, asset)| has_role(asset)).map(|(key, asset)| (key.as_str(), asset)).collect()
}

/// Whether an asset is an image by its type; by the ending of its file where it states no type.
fn is_image(asset: &Value) -> bool {
    match asset.get("type").and_then(Value::as_str) {
        Some(media_type) => media_type.starts_with("image/") || media_type == "application/vnd.nitf",
        None => {
            let path = asset.get("href").and_then(Value::as_str).unwrap_or_default();
            !has_extension(&vsi::from_url(path).unwrap_or_else(|| path.into()), &NO_IMAGES)
        }
    }
}

/// Whether an asset is panchromatic by its name or by its bands (`eo:bands` of STAC 1.0, `bands` of 1.1).
fn is_panchromatic(name: &str, asset: &Value) -> bool {
    let bands = ["eo:bands", "bands"].iter().filter_map(|key| asset.get(*key)?.as_array()).flatten();
    let mut common = bands.filter_map(|band| {
        band.get("common_name").or_else(|| band.get("eo:common_name")).and_then(Value::as_str)
    });
    name.to_lowercase().contains("pan") || common.any(|name| name == "pan")
}

/// The path of an asset. A relative reference to a local file is a URI, in which `%20` is a space, unless a file of that very name is
/// there.
fn href(asset: &Value, folder: &Path) -> Option<PathBuf> {
    let text = asset.get("href")?.as_str()?;
    let is_local = !text.contains("://") && !vsi::is_remote(folder);
    if !is_local || vsi::exists(&vsi::join(folder, Path::new(text))) {
        return Some(text.into());
    }
    Some(vsi::percent_decoded(text).unwrap_or_else(|| text.to_owned()).into())
}

/// Names and types of assets, for a message.
fn described(assets: &Map<String, Value>) -> String {
    let of = |(key, asset): (&String, &Value)| {
        let media_type = asset.get("type").and_then(Value::as_str).unwrap_or("no type");
        format!("`{key}` ({media_type})")
    };
    if assets.is_empty() { "none".into() } else { assets.iter().map(of).collect::<Vec<_>>().join(", ") }
}
