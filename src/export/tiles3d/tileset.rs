//! `tileset.json`, and the files of tiles.

use super::super::splat_gltf::{SPLATTING, SPZ};
use super::super::{Axes, ExportError, GltfCompression, GltfScene, splat_gltf};
use super::TileNode;
use crate::export::packing::bounds;
use crate::frame::LevelFrame;
use crate::mesh::gltf;
use crate::splat::splats::Splats;
use crate::{frame::SiteGrid, io::read_json};
use serde::Serialize;
use serde_json::{Value, json};
use std::path::Path;

/// Version of 3D Tiles.
const VERSION: &str = "1.1";
/// Error of a page without the tileset, in extents of the root: more than that of any tile.
const WHOLE: f64 = 0.25;

/// The file of a tile, of splats in the level frame; positions are relative to the middle of the tile.
///
/// # Errors
/// As [`splat_gltf::encode`].
pub fn content(splats: &Splats, copyright: Option<&str>) -> Result<Vec<u8>, ExportError> {
    let (low, high) = bounds(&splats.position);
    let middle: [f32; 3] = std::array::from_fn(|k| (0.5 * (low[k] + high[k])).round());
    let mut relative = splats.clone();
    for position in &mut relative.position {
        *position = std::array::from_fn(|k| position[k] - middle[k]);
    }
    // Viewers turn the y axis of glTF, which points up, to the z axis of 3D Tiles.
    let [x, y, z] = middle.map(f64::from);
    let copyright = copyright.map(str::to_owned);
    let scene = GltfScene { translation: [x, z, -y], site: None, copyright };
    splat_gltf::encode(&Axes::EastUpSouth.from_site(relative), GltfCompression::Spz, &scene)
}

/// The content of `tileset.json`; `uri` gives the file of a tile by its name.
#[must_use]
pub fn document(
    root: &TileNode,
    level: &LevelFrame,
    site: &SiteGrid,
    copyright: Option<&str>,
    uri: &dyn Fn(&str) -> String,
) -> Value {
    let mut extras =
        json!({ "generator": concat!("satgs ", env!("CARGO_PKG_VERSION")), "site": gltf::place(site) });
    if let Some(copyright) = copyright {
        extras["copyright"] = json!(copyright);
    }
    let mut tile = tile(root, uri);
    tile["transform"] = json!(level.ecef_from_level());
    tile["refine"] = json!("REPLACE");
    let [low, high] = root.bounds;
    let extent = (0..3).map(|k| f64::from(high[k] - low[k])).fold(0.0, f64::max);
    json!({
        "asset": { "version": VERSION, "extras": extras },
        "geometricError": root.error_m.max(WHOLE * extent),
        "extensionsUsed": ["3DTILES_content_gltf"],
        "extensions": { "3DTILES_content_gltf": {
            "extensionsUsed": [SPLATTING, SPZ], "extensionsRequired": [SPLATTING, SPZ],
        } },
        "root": tile,
    })
}

fn tile(node: &TileNode, uri: &dyn Fn(&str) -> String) -> Value {
    let [low, high] = node.bounds.map(|corner| corner.map(f64::from));
    let middle: [f64; 3] = std::array::from_fn(|k| 0.5 * (low[k] + high[k]));
    let half: [f64; 3] = std::array::from_fn(|k| 0.5 * (high[k] - low[k]));
    let [x, y, z] = middle;
    let mut tile = json!({
        "boundingVolume": { "box": [x, y, z, half[0], 0.0, 0.0, 0.0, half[1], 0.0, 0.0, 0.0, half[2]] },
        "geometricError": node.error_m,
        "content": { "uri": uri(&node.id) },
    });
    if !node.children.is_empty() {
        tile["children"] = node.children.iter().map(|child| self::tile(child, uri)).collect();
    }
    tile
}

/// What a tileset says of itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TilesetInfo {
    /// Version of 3D Tiles.
    pub version: String,
    /// Number of tiles, and of levels.
    pub tiles: usize,
    /// Number of levels.
    pub levels: usize,
    /// Error of the root, metres.
    pub error_m: f64,
    /// Earth-centred coordinates of the origin of the root's frame (EPSG:4978), metres.
    pub origin_ecef: Option<[f64; 3]>,
    /// To whom it is credited.
    pub copyright: Option<String>,
}

impl TilesetInfo {
    /// Reads a `tileset.json`.
    ///
    /// # Errors
    /// [`ExportError::Tileset`] if it cannot be read, is no tileset or of another version than 1.0 and 1.1.
    pub fn read(path: &Path) -> Result<Self, ExportError> {
        let refused = |reason: String| ExportError::Tileset { path: path.into(), reason };
        let document: Value = read_json(path).map_err(|e| refused(e.to_string()))?;
        let version =
            document["asset"]["version"].as_str().ok_or_else(|| refused("it has no asset.version".into()))?;
        if !["1.0", VERSION].contains(&version) {
            return Err(refused(format!("it is of version {version} of 3D Tiles, expected 1.0 or 1.1")));
        }
        let root = &document["root"];
        let error_m = root["geometricError"].as_f64();
        let error_m = error_m.ok_or_else(|| refused("its root has no geometricError".into()))?;
        let (mut tiles, mut levels, mut row) = (0, 0, vec![root]);
        while !row.is_empty() {
            tiles += row.len();
            levels += 1;
            row = row.iter().flat_map(|tile| tile["children"].as_array().into_iter().flatten()).collect();
        }
        let number = |k: usize| root["transform"][k].as_f64();
        let origin = || Some([number(12)?, number(13)?, number(14)?]);
        let copyright = document["asset"]["extras"]["copyright"].as_str().map(str::to_owned);
        Ok(Self { version: version.into(), tiles, levels, error_m, origin_ecef: origin(), copyright })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::test_splats::some;
    use crate::export::tiles3d::subtree;
    use crate::frame::Point;

    #[test]
    fn a_tileset_says_where_it_stands_and_what_it_holds() {
        let site = SiteGrid::at(Point::new(-81.66, 30.35, -20.0)).unwrap();
        let level = LevelFrame::at(Point::new(-81.66, 30.35, -20.0));
        let (root, _) = subtree::<()>(some(500, 0, false), "r", &mut |_, _| Ok(())).unwrap();
        let document = document(&root, &level, &site, Some("us"), &|id| format!("tiles/{id}.glb"));
        assert_eq!(document["root"]["content"]["uri"], "tiles/r.glb");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tileset.json");
        let write = |document: &Value| std::fs::write(&path, document.to_string()).unwrap();
        write(&document);
        let info = TilesetInfo::read(&path).unwrap();
        assert_eq!((info.tiles, info.levels, info.copyright.as_deref()), (1, 1, Some("us")));
        let origin = LevelFrame::ecef_from_geodetic(Point::new(-81.66, 30.35, -20.0)).xyz();
        assert!(info.origin_ecef.unwrap().iter().zip(origin).all(|(a, b)| (a - b).abs() < 1e-6));
        let mut other = document.clone();
        other["asset"]["version"] = json!("2.0");
        write(&other);
        assert!(TilesetInfo::read(&path).unwrap_err().to_string().contains("version 2.0"));
        write(&json!([1, 2]));
        assert!(TilesetInfo::read(&path).unwrap_err().to_string().contains("asset.version"));
    }

    #[test]
    fn the_content_of_a_tile_comes_back_where_it_was() {
        let mut splats = some(100, 1, false);
        splats.position.iter_mut().for_each(|p| *p = [p[0] + 5000.0, p[1] - 3000.0, p[2] + 40.0]);
        let (read, _) = splat_gltf::decode(&content(&splats, None).unwrap()).unwrap();
        let back = Axes::EastUpSouth.to_site(read);
        let far = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
        assert!(splats.position.iter().zip(&back.position).all(|(a, b)| far(a, b) < 1e-3));
    }
}
