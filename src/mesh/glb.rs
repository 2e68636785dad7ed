//! Meshes as binary glTF 2.0, which browsers, Blender and game engines open.
//!
//! Coordinates are those of the mesh; a rotation of the node turns its upward direction to the y axis, which points up in
//! glTF. Positions have single precision: those far from the origin, as on a map, are relative to a place that the node's
//! translation brings back. The place on Earth is in the `extras` of the scene.

use super::TriangleMesh;
use super::gltf::{self, GltfData};
use glam::{DQuat, DVec3};
use serde_json::json;

/// The file of a mesh; none above 4 GiB.
pub(super) fn bytes(mesh: &TriangleMesh) -> Option<Vec<u8>> {
    let mut data = GltfData::default();
    let offset = if mesh.is_far() { middle(mesh) } else { DVec3::ZERO };
    let relative = |p: &[f64; 3]| (DVec3::from_array(*p) - offset).as_vec3().to_array();
    let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(relative).collect();
    let mut attributes = json!({ "POSITION": data.positions(&positions) });
    if !mesh.normals.is_empty() {
        attributes["NORMAL"] = json!(data.floats(&mesh.normals));
    }
    // Colours hold the light of the images: shading would darken them once more.
    let is_colored = !mesh.colors.is_empty();
    if is_colored {
        attributes["COLOR_0"] = json!(data.colors(&linear(&mesh.colors)));
    }
    let mut material = json!({ "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 } });
    if is_colored {
        material["extensions"] = json!({ "KHR_materials_unlit": {} });
    }
    let indices = data.triangles(&mesh.triangles);
    let up = DVec3::from_array(mesh.up).try_normalize().unwrap_or(DVec3::Z);
    let rotation = DQuat::from_rotation_arc(up, DVec3::Y);
    let mut document = json!({
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{
            "mesh": 0, "name": "surface", "extras": { "axes": "run" },
            "rotation": rotation.to_array(),
        }],
        "meshes": [{ "primitives": [{ "attributes": attributes, "indices": indices, "material": 0 }] }],
        "materials": [material],
    });
    if offset != DVec3::ZERO {
        document["nodes"][0]["translation"] = json!((rotation * offset).to_array());
    }
    if is_colored {
        document["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    }
    if let Some(site) = &mesh.site {
        document["scenes"][0]["extras"] = gltf::place(site);
    }
    data.into_file(document)
}

/// The middle of a mesh on whole units.
fn middle(mesh: &TriangleMesh) -> DVec3 {
    mesh.bounds().map_or(DVec3::ZERO, |[low, high]| (0.5 * (DVec3::from(low) + DVec3::from(high))).round())
}

/// Linear colours as glTF has them in vertices, from colours encoded for display (sRGB, IEC 61966-2-1).
fn linear(colors: &[[u8; 3]]) -> Vec<[u16; 4]> {
    let table: Vec<u16> = (0..=255u8)
        .map(|v| {
            let v = f64::from(v) / 255.0;
            let light = if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
            (light * f64::from(u16::MAX)).round() as u16
        })
        .collect();
    let of = |v: u8| table[usize::from(v)];
    colors.iter().map(|[r, g, b]| [of(*r), of(*g), of(*b), u16::MAX]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::file::tests::tetrahedron;

    #[test]
    fn a_file_holds_all_vertices_and_stands_upright() {
        let glb = bytes(&tetrahedron()).unwrap();
        let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&glb[..4], word(4), word(8)), (&b"glTF"[..], 2, glb.len()));
        let text = word(12);
        let json: serde_json::Value = serde_json::from_slice(&glb[20..20 + text]).unwrap();
        assert_eq!(word(20 + text) + 28 + text, glb.len());
        let counts: Vec<u64> =
            json["accessors"].as_array().unwrap().iter().map(|a| a["count"].as_u64().unwrap()).collect();
        assert_eq!(counts, [4, 4, 4, 12]);
        let rotation: [f64; 4] = serde_json::from_value(json["nodes"][0]["rotation"].clone()).unwrap();
        let up = DQuat::from_array(rotation) * DVec3::Z;
        assert!((up - DVec3::Y).length() < 1e-9, "{up}");
        // Buffer views of numbers must be aligned, and all must lie inside.
        for view in json["bufferViews"].as_array().unwrap() {
            let [from, length] = ["byteOffset", "byteLength"].map(|k| view[k].as_u64().unwrap() as usize);
            assert!(from % 4 == 0 && from + length <= word(20 + text));
        }
    }

    #[test]
    fn coordinates_of_a_map_are_relative_to_the_translation_of_the_node() {
        let mut mesh = tetrahedron();
        mesh.up = [0.0, -0.6, 0.8];
        mesh.vertices.iter_mut().for_each(|p| *p = [p[0] + 448_263.123, p[1] + 5_412_345.456, p[2] + 12.5]);
        let glb = bytes(&mesh).unwrap();
        let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
        let json: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
        let node = |key: &str| json["nodes"][0][key].clone();
        let translation = DVec3::from_array(serde_json::from_value(node("translation")).unwrap());
        let rotation = DQuat::from_array(serde_json::from_value(node("rotation")).unwrap());
        let float = |k: usize| f32::from_le_bytes(glb[28 + length + 4 * k..][..4].try_into().unwrap());
        for (i, p) in mesh.vertices.iter().enumerate() {
            let stored = DVec3::from_array(std::array::from_fn(|k| f64::from(float(3 * i + k))));
            let shown = rotation * DVec3::from_array(*p);
            assert!((rotation * stored + translation - shown).length() < 1e-6, "{stored} {shown}");
        }
    }

    #[test]
    fn colours_of_vertices_are_linear() {
        assert_eq!(linear(&[[0, 188, 255]]), [[0, 32_957, 65_535, 65_535]]);
    }
}
