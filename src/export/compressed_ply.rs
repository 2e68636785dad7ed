//! The compressed PLY of PlayCanvas and SuperSplat (`.compressed.ply`).
//!
//! Splats are sorted so that neighbours lie in the same chunk of 256. A chunk holds the bounds of positions, logarithms of
//! scales and colours; a splat 16 bytes: position and scale in 11, 10, 11 bits between the bounds, a quaternion in 2, 10, 10,
//! 10 bits, colour and opacity in 8 bits each. An element `sh` holds coefficients of spherical harmonics in bytes from -4 to 4.

use super::packing::{
    OF_CHANNEL, bounds, coefficients, flatten_if_flat, from_smallest_three, logit_of_byte, smallest_three,
    z_order,
};
use crate::io::decode_text;
use crate::splat::harmonics_turn::degree;
use crate::splat::splats::{Splats, color_from_f_dc, f_dc_from_color, sigmoid, unit_quaternion};
use std::f32::consts::SQRT_2;
use std::fmt::Write as _;

/// Splats of a chunk.
const CHUNK: usize = 256;
/// Numbers of a chunk: lower and upper bounds of positions, of scales, of colours, three each.
const CHUNK_COLUMNS: [&str; 18] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
    "min_r",
    "min_g",
    "min_b",
    "max_r",
    "max_g",
    "max_b",
];
/// Words of a splat.
const COLUMNS: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];
/// Logarithms of scales are cut off beyond.
const LARGEST_LOG_SCALE: f32 = 20.0;
/// Coefficients of spherical harmonics span this much.
const HARMONICS_SPAN: f32 = 8.0;
const END: &[u8] = b"end_header\n";

/// The file of splats, with a comment in its header.
#[must_use]
pub fn encode(splats: &Splats, comments: &[String]) -> Vec<u8> {
    let n = splats.len();
    let of_channel = coefficients(degree(splats));
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    for comment in comments {
        let _ = writeln!(header, "comment {comment}");
    }
    let _ = writeln!(header, "element chunk {}", n.div_ceil(CHUNK));
    CHUNK_COLUMNS.iter().for_each(|name| header += &format!("property float {name}\n"));
    let _ = writeln!(header, "element vertex {n}");
    COLUMNS.iter().for_each(|name| header += &format!("property uint {name}\n"));
    if of_channel > 0 {
        let _ = writeln!(header, "element sh {n}");
        (0..3 * of_channel).for_each(|k| header += &format!("property uchar f_rest_{k}\n"));
    }
    let mut bytes = [header.as_bytes(), END].concat();
    let order = z_order(&splats.position);
    let (mut vertices, mut harmonics) = (Vec::with_capacity(16 * n), Vec::with_capacity(3 * of_channel * n));
    for chunk in order.chunks(CHUNK) {
        let of = |value: &dyn Fn(usize) -> [f32; 3]| -> Vec<[f32; 3]> {
            chunk.iter().map(|i| value(*i as usize)).collect()
        };
        let positions = of(&|i| splats.position[i]);
        let scales = of(&|i| splats.log_scale[i].map(|s| s.clamp(-LARGEST_LOG_SCALE, LARGEST_LOG_SCALE)));
        let colors = of(&|i| color_from_f_dc(splats.f_dc[i]));
        let ranges = [&positions, &scales, &colors].map(|values| bounds(values));
        for v in ranges.iter().flat_map(|(low, high)| low.iter().chain(high)) {
            bytes.extend(v.to_le_bytes());
        }
        for (k, i) in chunk.iter().enumerate() {
            let i = *i as usize;
            let opacity = sigmoid(splats.opacity_logit[i][0]);
            let [r, g, b] = share(colors[k], ranges[2]);
            for word in [
                packed_vector(share(positions[k], ranges[0])),
                packed_rotation(splats.rotation[i]),
                packed_vector(share(scales[k], ranges[1])),
                packed(&[(r, 8), (g, 8), (b, 8), (opacity, 8)]),
            ] {
                vertices.extend(word.to_le_bytes());
            }
            if let Some(rest) = splats.f_rest.get(i) {
                for channel in rest.as_chunks::<OF_CHANNEL>().0 {
                    let byte = |v: &f32| (256.0 * (v / HARMONICS_SPAN + 0.5)).clamp(0.0, 255.0) as u8;
                    harmonics.extend(channel[..of_channel].iter().map(byte));
                }
            }
        }
    }
    bytes.extend(vertices);
    bytes.extend(harmonics);
    bytes
}

/// Values as shares of their range.
fn share(values: [f32; 3], (low, high): ([f32; 3], [f32; 3])) -> [f32; 3] {
    std::array::from_fn(|k| if high[k] > low[k] { (values[k] - low[k]) / (high[k] - low[k]) } else { 0.0 })
}

/// Shares from 0 to 1 with their numbers of bits, the first one in the highest bits.
fn packed(shares: &[(f32, u32)]) -> u32 {
    shares.iter().fold(0, |word, (share, bits)| {
        let largest = ((1u32 << bits) - 1) as f32;
        (word << bits) | (share * largest + 0.5).clamp(0.0, largest) as u32
    })
}

/// The inverse of [`packed`] for the bits above `shift`.
fn unpacked(word: u32, shift: u32, bits: u32) -> f32 {
    let largest = (1u32 << bits) - 1;
    ((word >> shift) & largest) as f32 / largest as f32
}

fn packed_vector([x, y, z]: [f32; 3]) -> u32 {
    packed(&[(x, 11), (y, 10), (z, 11)])
}

fn unpacked_vector(word: u32) -> [f32; 3] {
    [unpacked(word, 21, 11), unpacked(word, 11, 10), unpacked(word, 0, 11)]
}

/// The place of the largest component in (w, x, y, z) and the other three.
fn packed_rotation(rotation: [f32; 4]) -> u32 {
    let (largest, three) = smallest_three(unit_quaternion(rotation));
    let [a, b, c] = three.map(|v| (v / SQRT_2 + 0.5, 10));
    ((largest as u32) << 30) | packed(&[a, b, c])
}

fn unpacked_rotation(word: u32) -> [f32; 4] {
    let three = [20, 10, 0].map(|shift| SQRT_2 * (unpacked(word, shift, 10) - 0.5));
    from_smallest_three((word >> 30) as usize, three)
}

/// Whether a PLY file is a compressed one.
#[must_use]
pub fn is_one(bytes: &[u8]) -> bool {
    header_of(bytes)
        .is_some_and(|(header, _)| header.contains("element chunk") && header.contains(COLUMNS[0]))
}

fn header_of(bytes: &[u8]) -> Option<(String, &[u8])> {
    let end = bytes.windows(END.len()).position(|w| w == END)?;
    Some((decode_text(&bytes[..end]), &bytes[end + END.len()..]))
}

/// An element of a PLY file: its name, number and properties (types and names).
struct Element {
    name: String,
    count: usize,
    properties: Vec<(String, String)>,
}

/// Splats from a file, in its axes and its order.
///
/// # Errors
/// What is wrong with the file.
pub fn decode(bytes: &[u8]) -> Result<Splats, String> {
    let (header, mut body) = header_of(bytes).ok_or("it has no PLY header")?;
    if !header.contains("format binary_little_endian 1.0") {
        return Err("it is not binary little-endian".into());
    }
    let mut elements: Vec<Element> = Vec::new();
    for line in header.lines() {
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["element", name, count] => {
                let count = count.parse().map_err(|_| format!("`{line}` has no number"))?;
                elements.push(Element { name: name.into(), count, properties: Vec::new() });
            }
            ["property", kind, name] => {
                if let Some(element) = elements.last_mut() {
                    element.properties.push((kind.into(), name.into()));
                }
            }
            _ => {}
        }
    }
    let expects = |element: &Element, kind: &str, names: &mut dyn Iterator<Item = String>| {
        let expected: Vec<_> = names.map(|name| (kind.to_owned(), name)).collect();
        if element.properties == expected {
            return Ok(());
        }
        Err(format!("its element `{}` has other properties than compressed splats", element.name))
    };
    let [chunks, vertices, others @ ..] = elements.as_slice() else {
        return Err("it lacks the elements `chunk` and `vertex`".into());
    };
    let names_of = |names: &'static [&'static str]| names.iter().map(ToString::to_string);
    expects(chunks, "float", &mut names_of(&CHUNK_COLUMNS))?;
    expects(vertices, "uint", &mut names_of(&COLUMNS))?;
    let n = vertices.count;
    let harmonics = others.first().filter(|e| e.name == "sh");
    let of_channel = harmonics.map_or(0, |e| e.properties.len() / 3);
    if let Some(element) = harmonics {
        expects(element, "uchar", &mut (0..3 * of_channel).map(|k| format!("f_rest_{k}")))?;
        if !(1..=3).any(|degree| coefficients(degree) == of_channel) || element.count != n {
            return Err("its element `sh` is not of all splats and of degree 1, 2 or 3".into());
        }
    }
    if chunks.count != n.div_ceil(CHUNK) {
        return Err(format!("it has {} chunks for {n} splats, expected one for each {CHUNK}", chunks.count));
    }
    let mut take = |count: usize, width: usize| {
        let length = count.checked_mul(width).filter(|length| *length <= body.len());
        let (group, after) = body.split_at(length.ok_or("it is cut off: it ends before its last splat")?);
        body = after;
        Ok::<_, String>(group)
    };
    let chunks = take(chunks.count, 4 * CHUNK_COLUMNS.len())?;
    let vertices = take(n, 4 * COLUMNS.len())?;
    let harmonics = take(if of_channel > 0 { n } else { 0 }, 3 * of_channel)?;
    let mut splats = Splats::zeros(n);
    for (i, vertex) in vertices.as_chunks::<16>().0.iter().enumerate() {
        let word = |k: usize| u32::from_le_bytes(std::array::from_fn(|b| vertex[4 * k + b]));
        let chunk = &chunks[i / CHUNK * 4 * CHUNK_COLUMNS.len()..];
        let number = |k: usize| f32::from_le_bytes(std::array::from_fn(|b| chunk[4 * k + b]));
        let between = |range: usize, shares: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|k| {
                let (low, high) = (number(6 * range + k), number(6 * range + 3 + k));
                low * (1.0 - shares[k]) + high * shares[k]
            })
        };
        let color = word(3);
        splats.position[i] = between(0, unpacked_vector(word(0)));
        splats.rotation[i] = unpacked_rotation(word(1));
        splats.log_scale[i] = between(1, unpacked_vector(word(2)));
        splats.f_dc[i] = f_dc_from_color(between(2, [24, 16, 8].map(|shift| unpacked(color, shift, 8))));
        splats.opacity_logit[i] = [logit_of_byte((color & 0xff) as u8)];
    }
    if of_channel > 0 {
        splats.f_rest = vec![[0.0; 3 * OF_CHANNEL]; n];
        for (values, bytes) in splats.f_rest.iter_mut().zip(harmonics.chunks_exact(3 * of_channel)) {
            for (k, byte) in bytes.iter().enumerate() {
                // The middle of the byte's step.
                let share = (f32::from(*byte) + 0.5) / 256.0;
                values[k / of_channel * OF_CHANNEL + k % of_channel] = HARMONICS_SPAN * (share - 0.5);
            }
        }
    }
    if splats.groups().iter().any(|group| group.iter().any(|v| !v.is_finite())) {
        return Err("a bound of a chunk is not finite".into());
    }
    flatten_if_flat(&mut splats, -LARGEST_LOG_SCALE);
    Ok(splats)
}

#[cfg(test)]
mod tests {
    use super::super::test_splats::{assert_near, some};
    use super::*;

    #[test]
    fn splats_come_back_within_the_steps_of_their_chunks() {
        for (n, degree, is_flat) in [(1, 0, false), (256, 0, false), (700, 0, true), (600, 2, false)] {
            let splats = some(n, degree, is_flat);
            let bytes = encode(&splats, &["made by a test".into()]);
            assert!(is_one(&bytes));
            let read = decode(&bytes).unwrap();
            assert_eq!(read.primitive(), splats.primitive());
            let mut sorted = Splats::default();
            sorted.take_from(&splats, &z_order(&splats.position));
            // 40 m in 10 bits at most, colours in 8 bits, logarithms of scales in 10 bits, harmonics in steps of 1/32.
            assert_near(&sorted, &read, [0.021, 0.01, 0.003, 0.017]);
        }
    }

    #[test]
    fn damaged_files_are_refused() {
        let bytes = encode(&some(300, 1, false), &[]);
        for part in 0..60 {
            assert!(decode(&bytes[..bytes.len() * part / 60]).is_err());
        }
        let text = String::from_utf8_lossy(&bytes[..400]).into_owned();
        let at = text.find("element chunk 2").unwrap();
        let mut other = bytes.clone();
        other[at + 14] = b'9';
        assert!(decode(&other).unwrap_err().contains("9 chunks"));
        let at = text.find("min_x").unwrap();
        other.clone_from(&bytes);
        other[at] = b'n';
        assert!(decode(&other).unwrap_err().contains("other properties"));
        assert!(!is_one(b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nend_header\n"));
    }
}
