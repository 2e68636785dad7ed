//! Binary glTF 2.0 files (`.glb`): the binary data with its views and accessors, and the container.

use crate::frame::SiteGrid;
use serde_json::{Value, json};

/// Constants of glTF for component types and buffer targets.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_BYTE: u32 = 5121;
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

/// The binary data of a file, whose parts the document names by the numbers that the methods return.
#[derive(Default)]
pub struct GltfData {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl GltfData {
    /// Appends positions; returns the number of their accessor.
    pub fn positions(&mut self, positions: &[[f32; 3]]) -> usize {
        let bound = |pick: fn(f32, f32) -> f32, start: f32| {
            positions.iter().fold([start; 3], |m, p| std::array::from_fn(|k| pick(m[k], p[k])))
        };
        let (low, high) = (bound(f32::min, f32::INFINITY), bound(f32::max, f32::NEG_INFINITY));
        let accessor = self.floats(positions);
        self.accessors[accessor]["min"] = json!(low);
        self.accessors[accessor]["max"] = json!(high);
        accessor
    }

    /// Appends vectors of two or three numbers a vertex; returns the number of their accessor.
    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        self.append(values.as_flattened().iter().flat_map(|v| v.to_le_bytes()), Some(VERTICES));
        self.accessor(FLOAT, values.len(), &format!("VEC{N}"))
    }

    /// Appends a number for each vertex; returns the number of their accessor.
    pub fn scalars(&mut self, values: &[f32]) -> usize {
        self.append(values.iter().flat_map(|v| v.to_le_bytes()), Some(VERTICES));
        self.accessor(FLOAT, values.len(), "SCALAR")
    }

    /// Declares `count` vectors of `width` numbers whose values an extension brings; returns the number of their accessor.
    pub fn declared_floats(&mut self, count: usize, width: usize) -> usize {
        self.accessors.push(json!({ "componentType": FLOAT, "count": count, "type": format!("VEC{width}") }));
        self.accessors.len() - 1
    }

    /// As [`Self::declared_floats`], positions between two corners.
    pub fn declared_positions(&mut self, count: usize, [low, high]: [[f32; 3]; 2]) -> usize {
        let accessor = self.declared_floats(count, 3);
        self.accessors[accessor]["min"] = json!(low);
        self.accessors[accessor]["max"] = json!(high);
        accessor
    }

    /// As [`Self::declared_floats`], colours of four bytes.
    pub fn declared_colors(&mut self, count: usize) -> usize {
        let accessor = self.declared_floats(count, 4);
        self.accessors[accessor]["componentType"] = json!(UNSIGNED_BYTE);
        self.accessors[accessor]["normalized"] = json!(true);
        accessor
    }

    /// Appends colours (linear red, green, blue and alpha, 65535 stands for 1); returns the number of their accessor.
    pub fn colors(&mut self, values: &[[u16; 4]]) -> usize {
        self.append(values.as_flattened().iter().flat_map(|v| v.to_le_bytes()), Some(VERTICES));
        let accessor = self.accessor(UNSIGNED_SHORT, values.len(), "VEC4");
        self.accessors[accessor]["normalized"] = json!(true);
        accessor
    }

    /// Appends triangles; returns the number of their accessor.
    pub fn triangles(&mut self, triangles: &[[u32; 3]]) -> usize {
        self.append(triangles.as_flattened().iter().flat_map(|v| v.to_le_bytes()), Some(INDICES));
        self.accessor(UNSIGNED_INT, 3 * triangles.len(), "SCALAR")
    }

    /// Appends the bytes of a file, as of an image; returns the number of its buffer view.
    pub fn file(&mut self, bytes: &[u8]) -> usize {
        self.append(bytes.iter().copied(), None)
    }

    /// Appends bytes, padded to whole words; returns the number of their buffer view.
    fn append(&mut self, bytes: impl Iterator<Item = u8>, target: Option<u32>) -> usize {
        let start = self.binary.len();
        self.binary.extend(bytes);
        let length = self.binary.len() - start;
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": start, "byteLength": length });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.views.push(view);
        self.views.len() - 1
    }

    /// Adds an accessor of the last buffer view.
    fn accessor(&mut self, component: u32, count: usize, kind: &str) -> usize {
        let view = self.views.len() - 1;
        self.accessors
            .push(json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }));
        self.accessors.len() - 1
    }

    /// The `.glb` file of a document, to which this adds accessors, views, the buffer, version and generator. None above the 4 GiB
    /// that the format can hold.
    #[must_use]
    pub fn into_file(self, mut document: Value) -> Option<Vec<u8>> {
        document["asset"]["version"] = json!("2.0");
        document["asset"]["generator"] = json!(concat!("satgs ", env!("CARGO_PKG_VERSION")));
        document["accessors"] = Value::Array(self.accessors);
        document["bufferViews"] = Value::Array(self.views);
        document["buffers"] = json!([{ "byteLength": self.binary.len() }]);
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = u32::try_from(12 + 8 + text.len() + 8 + self.binary.len()).ok()?;
        let words = |a: u32, b: &[u8; 4]| [a.to_le_bytes(), *b].concat();
        let header = [b"glTF".to_vec(), 2u32.to_le_bytes().to_vec(), total.to_le_bytes().to_vec()].concat();
        let (text_length, binary_length) = (text.len() as u32, self.binary.len() as u32);
        Some(
            [header, words(text_length, b"JSON"), text, words(binary_length, b"BIN\0"), self.binary].concat(),
        )
    }
}

/// The `extras` that say where the coordinates of a file are: those of a site frame.
#[must_use]
pub fn place(site: &SiteGrid) -> Value {
    let [east, north, height] = site.origin.xyz();
    json!({
        "epsg": site.epsg, "east_m": east, "north_m": north, "height_m": height, "vertical": "WGS 84 ellipsoid",
    })
}

/// The document and the binary data of a `.glb` file, which may be empty.
///
/// # Errors
/// What is wrong with the file.
pub fn open(bytes: &[u8]) -> Result<(Value, &[u8]), String> {
    let (header, mut rest) =
        bytes.split_at_checked(12).ok_or("it is shorter than the header of a .glb file")?;
    if !header.starts_with(b"glTF") {
        return Err("it does not start with `glTF`".into());
    }
    let word = |b: &[u8]| b.first_chunk().map_or(0, |w| u32::from_le_bytes(*w));
    let (version, length) = (word(&header[4..]), word(&header[8..]) as usize);
    if version != 2 {
        return Err(format!("it is of version {version} of the format, expected 2"));
    }
    if length > bytes.len() {
        return Err(format!("it is cut off: it has {} of {length} bytes", bytes.len()));
    }
    let (mut document, mut binary) = (None, &[][..]);
    while let Some((head, body)) = rest.split_at_checked(8) {
        let Some((chunk, after)) = body.split_at_checked(word(head) as usize) else {
            return Err("a chunk is cut off".into());
        };
        match &head[4..] {
            b"JSON" => {
                document = serde_json::from_slice(chunk).map_err(|e| format!("its JSON is damaged: {e}"))?
            }
            b"BIN\0" => binary = chunk,
            _ => {}
        }
        rest = after;
    }
    Ok((document.ok_or("it has no JSON chunk")?, binary))
}
