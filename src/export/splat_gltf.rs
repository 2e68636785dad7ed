//! Splats as binary glTF 2.0 with `KHR_gaussian_splatting`, as ratified: linear scales, opacities, coefficients of spherical
//! harmonics in the colour space of displays. `KHR_gaussian_splatting_compression_spz_2` (draft) holds them as SPZ instead,
//! whose coordinates are those of the file, as CesiumJS reads them.
//!
//! <https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Khronos/KHR_gaussian_splatting>

use super::packing::{OF_CHANNEL, bounds, coefficients};
use super::{ExportError, spz};
use crate::frame::{Point, SiteGrid};
use crate::mesh::gltf::{self, GltfData};
use crate::splat::harmonics_turn::degree;
use crate::splat::primitive::FLAT_LOG_SCALE;
use crate::splat::splats::{Splats, logit, sigmoid, unit_quaternion};
use serde_json::{Value, json};

/// The extensions.
pub const SPLATTING: &str = "KHR_gaussian_splatting";
/// The one that holds splats as SPZ.
pub const SPZ: &str = "KHR_gaussian_splatting_compression_spz_2";
/// Opacities of glTF may be 0 or 1, whose logits are infinite.
const OPACITY_MARGIN: f32 = 1e-6;

/// How the splats of a glTF file are held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GltfCompression {
    /// As numbers of single precision.
    #[default]
    None,
    /// As SPZ.
    Spz,
}

/// What a glTF file of splats says beside them.
#[derive(Clone, Debug, Default)]
pub struct GltfScene {
    /// Where the splats' origin lies, in the axes of the file.
    pub translation: [f64; 3],
    /// The frame of the coordinates.
    pub site: Option<SiteGrid>,
    /// To whom the splats are credited.
    pub copyright: Option<String>,
}

/// The file of splats whose axes are those of glTF ([`Axes::EastUpSouth`](super::Axes)).
///
/// # Errors
/// [`ExportError::TooMany`] above 4 GiB, [`ExportError::TooWide`].
pub fn encode(
    splats: &Splats,
    compression: GltfCompression,
    scene: &GltfScene,
) -> Result<Vec<u8>, ExportError> {
    let mut data = GltfData::default();
    let degree = degree(splats);
    let n = splats.len();
    let own = |name: &str| format!("{SPLATTING}:{name}");
    let harmonics = (1..=degree).flat_map(|l| (0..=2 * l).map(move |m| (l, m)));
    let mut splatting = json!({ "kernel": "ellipse", "colorSpace": "srgb_rec709_display" });
    let mut attributes = json!({});
    let mut extensions = vec![SPLATTING];
    match compression {
        GltfCompression::None => {
            attributes["POSITION"] = json!(data.positions(&splats.position));
            let rotations: Vec<[f32; 4]> = splats.rotation.iter().map(|q| xyzw(*q)).collect();
            attributes[own("ROTATION")] = json!(data.floats(&rotations));
            let scales: Vec<[f32; 3]> = splats.log_scale.iter().map(|s| s.map(f32::exp)).collect();
            attributes[own("SCALE")] = json!(data.floats(&scales));
            let opacities: Vec<f32> = splats.opacity_logit.iter().map(|o| sigmoid(o[0])).collect();
            attributes[own("OPACITY")] = json!(data.scalars(&opacities));
            attributes[own("SH_DEGREE_0_COEF_0")] = json!(data.floats(&splats.f_dc));
            for (l, m) in harmonics {
                let k = coefficients(l - 1) + m;
                let values: Vec<[f32; 3]> =
                    splats.f_rest.iter().map(|rest| [0, 1, 2].map(|c| rest[OF_CHANNEL * c + k])).collect();
                attributes[own(&format!("SH_DEGREE_{l}_COEF_{m}"))] = json!(data.floats(&values));
            }
        }
        GltfCompression::Spz => {
            let view = data.file(&spz::encode(splats)?);
            let (low, high) = bounds(&splats.position);
            attributes["POSITION"] = json!(data.declared_positions(n, [low, high]));
            attributes["COLOR_0"] = json!(data.declared_colors(n));
            attributes[own("SCALE")] = json!(data.declared_floats(n, 3));
            attributes[own("ROTATION")] = json!(data.declared_floats(n, 4));
            for (l, m) in harmonics {
                attributes[own(&format!("SH_DEGREE_{l}_COEF_{m}"))] = json!(data.declared_floats(n, 3));
            }
            splatting["extensions"] = json!({ SPZ: { "bufferView": view } });
            extensions.push(SPZ);
        }
    }
    let mut document = json!({
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "splats" }],
        "meshes": [{ "primitives": [{
            "mode": 0, "attributes": attributes, "extensions": { SPLATTING: splatting },
        }] }],
        "extensionsUsed": extensions,
    });
    if compression == GltfCompression::Spz {
        document["extensionsRequired"] = json!(extensions);
    }
    // CesiumJS (1.140) reads the place of splats from the matrix of the node alone, and needs one.
    let [x, y, z] = scene.translation;
    document["nodes"][0]["matrix"] =
        json!([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0]);
    if let Some(site) = &scene.site {
        document["scenes"][0]["extras"] = gltf::place(site);
    }
    if let Some(copyright) = &scene.copyright {
        document["asset"]["copyright"] = json!(copyright);
    }
    data.into_file(document).ok_or(ExportError::TooMany { splats: n })
}

fn xyzw(rotation: [f32; 4]) -> [f32; 4] {
    let [w, x, y, z] = unit_quaternion(rotation);
    // Readers take the length as it is: a splat without a direction is not turned.
    if [w, x, y, z] == [0.0; 4] { [0.0, 0.0, 0.0, 1.0] } else { [x, y, z, w] }
}

/// Splats from a file, in its axes, and the site frame that its `extras` name.
///
/// # Errors
/// What is wrong with the file, or what it has that is not supported.
pub fn decode(bytes: &[u8]) -> Result<(Splats, Option<SiteGrid>), String> {
    let (document, binary) = gltf::open(bytes)?;
    let primitives = document["meshes"].as_array().into_iter().flatten();
    let mut primitives = primitives.flat_map(|mesh| mesh["primitives"].as_array().into_iter().flatten());
    let is_splats = |primitive: &&Value| primitive["extensions"][SPLATTING].is_object();
    let primitive = primitives.find(is_splats).ok_or(format!("it has no primitive with {SPLATTING}"))?;
    if primitives.any(|other| is_splats(&other)) {
        return Err("it has several primitives of splats, expected one".into());
    }
    let file = Reader { document: &document, binary, attributes: &primitive["attributes"] };
    let extension = &primitive["extensions"][SPLATTING]["extensions"][SPZ];
    let mut splats = if extension.is_object() {
        spz::decode(file.view(&extension["bufferView"])?)?
    } else {
        file.splats()?
    };
    if let Some(by) = translation(&document)? {
        for position in &mut splats.position {
            *position = std::array::from_fn(|k| (f64::from(position[k]) + by[k]) as f32);
        }
    }
    if splats.position.as_flattened().iter().any(|v| !v.is_finite()) {
        return Err("a splat is moved beyond what single precision holds".into());
    }
    let extras = &document["scenes"][0]["extras"];
    let number = |name: &str| extras[name].as_f64();
    let site = || {
        let epsg = u32::try_from(extras["epsg"].as_u64()?).ok()?;
        Some(SiteGrid {
            epsg,
            origin: Point::new(number("east_m")?, number("north_m")?, number("height_m")?),
        })
    };
    Ok((splats, site()))
}

/// Where the only node of a file is moved to; none if no node is moved.
fn translation(document: &Value) -> Result<Option<[f64; 3]>, String> {
    let nodes = document["nodes"].as_array().map_or(&[][..], Vec::as_slice);
    for moved in ["rotation", "scale"] {
        if nodes.iter().any(|node| !node[moved].is_null()) {
            return Err(format!("a node has a `{moved}`, expected at most a translation"));
        }
    }
    let place = |node: &Value| {
        if node["matrix"].is_null() {
            let by = Some(&node["translation"]).filter(|by| !by.is_null()).cloned();
            return by.map(serde_json::from_value).transpose().map_err(|_| "it is not three numbers");
        }
        let matrix: [f64; 16] =
            serde_json::from_value(node["matrix"].clone()).map_err(|_| "it is not sixteen numbers")?;
        let [linear @ .., x, y, z, _] = matrix;
        if linear != [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
            return Err("it turns or scales, expected at most a translation");
        }
        Ok(Some([x, y, z]))
    };
    let of_node = |reason: &str| format!("the transform of a node is not supported: {reason}");
    let places = nodes.iter().map(place).collect::<Result<Vec<Option<[f64; 3]>>, _>>().map_err(of_node)?;
    match places.as_slice() {
        [only] => Ok(*only),
        several if several.iter().all(Option::is_none) => Ok(None),
        _ => Err("one of several nodes is moved, expected a single node".into()),
    }
}

/// The parts of a file that is read.
struct Reader<'a> {
    document: &'a Value,
    binary: &'a [u8],
    attributes: &'a Value,
}

impl Reader<'_> {
    /// The bytes of a buffer view.
    fn view(&self, index: &Value) -> Result<&[u8], String> {
        let view = &self.document["bufferViews"][index.as_u64().unwrap_or(u64::MAX) as usize];
        let length = view["byteLength"].as_u64().ok_or("a buffer view is missing")? as usize;
        let start = view["byteOffset"].as_u64().unwrap_or(0) as usize;
        if view["byteStride"].is_u64() || view["buffer"].as_u64() != Some(0) {
            return Err("a buffer view has a stride or another buffer, which satgs does not read".into());
        }
        let end = start.checked_add(length);
        end.and_then(|end| self.binary.get(start..end)).ok_or_else(|| "a buffer view is cut off".into())
    }

    /// The numbers of an attribute, which must be of single precision.
    fn floats<const N: usize>(&self, name: &str) -> Result<Vec<[f32; N]>, String> {
        const FLOAT: u64 = 5126;
        let accessor = self.attributes[name].as_u64().ok_or(format!("attribute `{name}` is missing"))?;
        let accessor = &self.document["accessors"][accessor as usize];
        let kind = if N == 1 { "SCALAR".into() } else { format!("VEC{N}") };
        if accessor["componentType"].as_u64() != Some(FLOAT) || accessor["type"] != json!(kind) {
            return Err(format!(
                "attribute `{name}` is not {kind} of single precision, which satgs reads alone"
            ));
        }
        let count = accessor["count"].as_u64().unwrap_or(0) as usize;
        let start = accessor["byteOffset"].as_u64().unwrap_or(0) as usize;
        let bytes = self.view(&accessor["bufferView"])?.get(start..).unwrap_or_default();
        let cut_off = || format!("attribute `{name}` is cut off");
        let length = count.checked_mul(4 * N).ok_or_else(cut_off)?;
        let bytes = bytes.get(..length).ok_or_else(cut_off)?;
        let values: Vec<f32> = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        if values.iter().any(|v| !v.is_finite()) {
            return Err(format!("a value of attribute `{name}` is not finite"));
        }
        Ok(values.as_chunks::<N>().0.to_vec())
    }

    /// The splats of numbers.
    fn splats(&self) -> Result<Splats, String> {
        let own = |name: &str| format!("{SPLATTING}:{name}");
        let position = self.floats::<3>("POSITION")?;
        let n = position.len();
        let mut splats = Splats {
            position,
            f_dc: self.floats(&own("SH_DEGREE_0_COEF_0"))?,
            opacity_logit: self.floats(&own("OPACITY"))?,
            log_scale: self.floats(&own("SCALE"))?,
            rotation: self.floats(&own("ROTATION"))?,
            f_rest: Vec::new(),
        };
        for [opacity] in &mut splats.opacity_logit {
            *opacity = logit(opacity.clamp(OPACITY_MARGIN, 1.0 - OPACITY_MARGIN));
        }
        for scale in splats.log_scale.as_flattened_mut() {
            *scale = scale.ln().max(FLAT_LOG_SCALE);
        }
        for rotation in &mut splats.rotation {
            let [x, y, z, w] = *rotation;
            *rotation = [w, x, y, z];
        }
        for l in 1..=3 {
            for m in 0..=2 * l {
                let name = own(&format!("SH_DEGREE_{l}_COEF_{m}"));
                if self.attributes[&name].is_null() {
                    continue;
                }
                splats.f_rest.resize(n, [0.0; 3 * OF_CHANNEL]);
                let values = self.floats::<3>(&name)?;
                if values.len() != n {
                    return Err(format!("attribute `{name}` has {} values for {n} splats", values.len()));
                }
                for (rest, value) in splats.f_rest.iter_mut().zip(values) {
                    (0..3).for_each(|c| rest[OF_CHANNEL * c + coefficients(l - 1) + m] = value[c]);
                }
            }
        }
        if !splats.is_whole(n) {
            return Err("its attributes have different numbers of splats".into());
        }
        Ok(splats)
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_splats::{assert_near, some};
    use super::*;

    #[test]
    fn splats_come_back_with_their_place() {
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.5, 3_357_611.25, -20.5) };
        for (degree, is_flat) in [(0, false), (0, true), (2, false)] {
            let splats = some(100, degree, is_flat);
            let scene = GltfScene { site: Some(site), copyright: Some("us".into()), ..GltfScene::default() };
            for (compression, within) in [
                (GltfCompression::None, [0.0001, 0.0001, 0.0001, 0.0001]),
                (GltfCompression::Spz, [1.3e-4, 0.014, 0.032, 0.004]),
            ] {
                let bytes = encode(&splats, compression, &scene).unwrap();
                let (read, place) = decode(&bytes).unwrap();
                assert_eq!((place, read.primitive()), (Some(site), splats.primitive()));
                assert_near(&splats, &read, within);
                let moved = GltfScene { translation: [100.0, 0.0, -7.5], ..GltfScene::default() };
                let (moved, place) = decode(&encode(&splats, compression, &moved).unwrap()).unwrap();
                assert_eq!(place, None);
                assert!((moved.position[3][0] - read.position[3][0] - 100.0).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn damaged_files_and_other_scenes_are_refused() {
        for compression in [GltfCompression::None, GltfCompression::Spz] {
            let bytes = encode(&some(60, 1, false), compression, &GltfScene::default()).unwrap();
            for part in 0..50 {
                assert!(decode(&bytes[..bytes.len() * part / 50]).is_err());
            }
        }
        let bytes = encode(&some(60, 1, false), GltfCompression::None, &GltfScene::default()).unwrap();
        let replaced = |from: &str, to: &str| {
            let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
            let mut other = bytes.clone();
            other[at..at + to.len()].copy_from_slice(to.as_bytes());
            decode(&other).unwrap_err()
        };
        assert!(replaced(":OPACITY", ":OTHERTY").contains("OPACITY` is missing"));
        assert!(
            replaced("\"KHR_gaussian_splatting\":{", "\"KHR_gaussian_splatt1ng\":{").contains("no primitive")
        );
        let mut other = bytes.clone();
        other[4] = 1;
        assert!(decode(&other).unwrap_err().contains("version 1"));
    }
}
