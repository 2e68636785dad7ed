//! The surface as a textured mesh: binary glTF 2.0, which browsers, Blender and game engines open.
//!
//! The axes of glTF point right, up and towards the viewer; here they point east, up and south, in metres from the centre of
//! the grid at height 0. The map coordinates of this origin are in the `extras` of the glTF scene.

use super::{Dsm, Heights};
use crate::io::{WriteError, png_rgb, write_file};
use crate::mesh::gltf::GltfData;
use serde_json::json;
use std::path::Path;

/// The constant of glTF for textures that are not repeated.
const CLAMP_TO_EDGE: u32 = 33071;
/// Marks vertices that do not exist.
const NONE: u32 = u32::MAX;

impl Dsm {
    /// Writes a mesh of all cells with heights, textured with the orthophoto, as `.glb`. `heights` are those of this DSM.
    ///
    /// # Errors
    /// [`WriteError`], also if the mesh exceeds the 4 GiB that the format can hold.
    pub fn write_mesh(&self, path: &Path, heights: &Heights) -> Result<(), WriteError> {
        let failed = |reason: &str| WriteError::new(path, reason);
        let glb = self.glb(heights).ok_or_else(|| failed("the grid is too large for a mesh"))?;
        write_file(path, glb)
    }

    fn glb(&self, heights: &Heights) -> Option<Vec<u8>> {
        let (grid, z) = (&self.grid, &heights.raster.data);
        let (west, south, east, north) = grid.bounds();
        let center = [0.5 * (west + east), 0.5 * (south + north)];

        let mut vertex = vec![NONE; z.len()];
        let (mut positions, mut places) = (Vec::<[f32; 3]>::new(), Vec::<[f32; 2]>::new());
        for (i, z) in z.iter().enumerate().filter(|(_, z)| !z.is_nan()) {
            let (col, row) = (i % grid.width, i / grid.width);
            let p = grid.cell_center(col, row);
            vertex[i] = u32::try_from(positions.len()).ok()?;
            positions.push([(p.x() - center[0]) as f32, *z, (center[1] - p.y()) as f32]);
            places.push([(col as f32 + 0.5) / grid.width as f32, (row as f32 + 0.5) / grid.height as f32]);
        }
        let mut triangles = Vec::<[u32; 3]>::new();
        for row in 1..grid.height {
            for col in 1..grid.width {
                let i = row * grid.width + col;
                let [a, b, c, d] = [i - grid.width - 1, i - grid.width, i - 1, i].map(|k| vertex[k]);
                let faces = [[a, c, b], [b, c, d]];
                triangles.extend(faces.into_iter().filter(|f| !f.contains(&NONE)));
            }
        }
        let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0).round() as u8;
        let pixels = (0..z.len()).flat_map(|i| self.colors.each_ref().map(|c| byte(c.data[i])));
        let texture = png_rgb(grid.width, grid.height, &pixels.collect::<Vec<u8>>()).ok()?;

        let mut data = GltfData::default();
        let position = data.positions(&positions);
        let place = data.floats(&places);
        let indices = data.triangles(&triangles);
        let image = data.file(&texture);
        data.into_file(json!({
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{ "nodes": [0], "extras": {
                "epsg": grid.epsg, "east_m": center[0], "north_m": center[1], "vertical": heights.above.name(),
            } }],
            "nodes": [{ "mesh": 0, "name": "surface" }],
            "meshes": [{ "primitives": [{
                "attributes": { "POSITION": position, "TEXCOORD_0": place }, "indices": indices, "material": 0,
            }] }],
            "materials": [{
                "pbrMetallicRoughness": {
                    "baseColorTexture": { "index": 0 }, "metallicFactor": 0.0, "roughnessFactor": 1.0,
                },
                "extensions": { "KHR_materials_unlit": {} },
            }],
            "textures": [{ "source": 0, "sampler": 0 }],
            "samplers": [{ "wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE }],
            "images": [{ "bufferView": image, "mimeType": "image/png" }],
        }))
    }
}

#[cfg(test)]
mod tests {
    use crate::dsm::render::tests::flat_surface;
    use crate::io::VerticalReference;

    #[test]
    fn a_mesh_covers_all_cells_with_heights() {
        let (mut surface, _) = flat_surface(5, 4);
        surface.height.data[7] = f32::NAN;
        let glb = surface.glb(&surface.heights_above(&VerticalReference::Ellipsoid)).unwrap();
        let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&glb[..4], word(4), word(8)), (&b"glTF"[..], 2, glb.len()));
        let text = word(12);
        let json: serde_json::Value = serde_json::from_slice(&glb[20..20 + text]).unwrap();
        let count = |k: usize| json["accessors"][k]["count"].as_u64().unwrap();
        // Of the 4 x 3 quads of two triangles each, six triangles touch the hole and are left out.
        assert_eq!((count(0), count(2)), (19, 3 * (24 - 6)));
        assert_eq!(word(20 + text) + 28 + text, glb.len());
        assert_eq!(json["accessors"][0]["max"][0], 1.0);
    }
}
