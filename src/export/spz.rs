//! SPZ, the compressed splats of Niantic: version 3 is written, versions 2 and 3 are read
//! (<https://github.com/nianticlabs/spz>).
//!
//! A gzip stream of a header and the parameters, group by group: positions of 24 bits with a fixed point, opacities, colours,
//! logarithms of scales in steps of 1/16, quaternions, spherical harmonics. Axes are right, up, back.

use super::ExportError;
use super::packing::{
    OF_CHANNEL, coefficients, flatten_if_flat, from_smallest_three, logit_of_byte, smallest_three,
};
use crate::splat::harmonics_turn::degree;
use crate::splat::splats::{Splats, sigmoid, unit_quaternion};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use std::f32::consts::FRAC_1_SQRT_2;
use std::io::{Read, Write};

/// `NGSP`.
const MAGIC: u32 = 0x5053_474e;
/// Versions that are read; the last one is written.
const VERSIONS: [u32; 2] = [2, 3];
/// Bytes of the header.
const HEADER: usize = 16;
/// Bits of a coordinate.
const COORDINATE_BITS: i32 = 24;
/// Bits after the point of most files: a quarter of a millimetre.
const USUAL_BITS: i32 = 12;
/// Small scenes have more, up to a millionth of their extent.
const SMALL_BITS: i32 = 20;
/// Factor of the coefficients of colours, of which bytes span those of 0.5 ± 1 / (2 * 0.15).
const COLOR_SCALE: f32 = 0.15;
/// Logarithm of the smallest scale, and steps in a unit of the logarithm.
const SMALLEST_LOG_SCALE: f32 = -10.0;
const LOG_SCALE_STEPS: f32 = 16.0;
/// Steps of a component of a quaternion from zero to the largest that is not the largest of all.
const ROTATION_STEPS: f32 = 511.0;
/// Steps in a unit of coefficients of spherical harmonics, which are cut off at ±1.
const HARMONICS_STEPS: f32 = 128.0;

/// The distance of neighbouring coordinates in a file of these splats, in their unit.
///
/// # Errors
/// [`ExportError::TooWide`] beyond coordinates of 8,388,607.
pub fn step(splats: &Splats) -> Result<f64, ExportError> {
    Ok((-f64::from(fraction_bits(splats)?)).exp2())
}

/// Bits after the point.
fn fraction_bits(splats: &Splats) -> Result<u8, ExportError> {
    let farthest = splats.position.as_flattened().iter().fold(0.0f32, |m, v| m.max(v.abs()));
    // The largest number of a file is 2^23 - 1 steps; the next power of two stands for what is rounded up.
    let whole_bits = (f64::from(farthest) * (1.0 + 1e-6)).max(1e-6).log2().ceil() as i32;
    // Readers know no more bits after the point than a coordinate has.
    let fits = (COORDINATE_BITS - 1 - whole_bits).min(COORDINATE_BITS);
    let bits = fits.min(USUAL_BITS.max(SMALL_BITS - whole_bits));
    u8::try_from(bits).map_err(|_| ExportError::TooWide { farthest })
}

/// The file of splats whose axes are right, up, back ([`Axes::EastUpSouth`](super::Axes)).
///
/// # Errors
/// [`ExportError::TooWide`], [`ExportError::TooMany`].
pub fn encode(splats: &Splats) -> Result<Vec<u8>, ExportError> {
    let bits = fraction_bits(splats)?;
    let count = u32::try_from(splats.len()).map_err(|_| ExportError::TooMany { splats: splats.len() })?;
    let degree = degree(splats);
    let mut raw = Vec::with_capacity(HEADER + splats.len() * (20 + 3 * coefficients(degree)));
    for word in [MAGIC, VERSIONS[1], count] {
        raw.extend(word.to_le_bytes());
    }
    raw.extend([degree as u8, bits, 0, 0]);
    let byte = |v: f32| v.round().clamp(0.0, 255.0) as u8;
    let scale = f64::from(bits).exp2();
    for v in splats.position.as_flattened() {
        raw.extend_from_slice(&((f64::from(*v) * scale).round() as i32).to_le_bytes()[..3]);
    }
    raw.extend(splats.opacity_logit.iter().map(|o| byte(255.0 * sigmoid(o[0]))));
    raw.extend(splats.f_dc.as_flattened().iter().map(|v| byte(255.0 * (COLOR_SCALE * v + 0.5))));
    let log_scales = splats.log_scale.as_flattened().iter();
    raw.extend(log_scales.map(|v| byte((v - SMALLEST_LOG_SCALE) * LOG_SCALE_STEPS)));
    for rotation in &splats.rotation {
        raw.extend(packed_rotation(*rotation).to_le_bytes());
    }
    for rest in splats.f_rest.iter().take(if degree > 0 { splats.len() } else { 0 }) {
        // Coefficient by coefficient, red, green and blue of each.
        for k in 0..coefficients(degree) {
            raw.extend([0, 1, 2].map(|c| byte(HARMONICS_STEPS * (rest[OF_CHANNEL * c + k] + 1.0))));
        }
    }
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    // A vector takes all that is written to it.
    let written = gzip.write_all(&raw).and_then(|()| gzip.finish());
    written.map_err(|_| ExportError::TooMany { splats: splats.len() })
}

/// A unit quaternion in 32 bits: the place of its largest component in (x, y, z, w) and the other three.
fn packed_rotation(rotation: [f32; 4]) -> u32 {
    let [w, x, y, z] = unit_quaternion(rotation);
    let (largest, three) = smallest_three([x, y, z, w]);
    three.iter().fold(largest as u32, |packed, v| {
        let size = (ROTATION_STEPS * (v.abs() / FRAC_1_SQRT_2) + 0.5) as u32;
        (packed << 10) | (u32::from(*v < 0.0) << 9) | size.min(ROTATION_STEPS as u32)
    })
}

/// The inverse of [`packed_rotation`].
fn unpacked_rotation(packed: u32) -> [f32; 4] {
    let component = |shift: u32| {
        let bits = (packed >> shift) & 0x3ff;
        let size = FRAC_1_SQRT_2 * (bits & 0x1ff) as f32 / ROTATION_STEPS;
        if bits >> 9 == 1 { -size } else { size }
    };
    let [x, y, z, w] = from_smallest_three((packed >> 30) as usize, [20, 10, 0].map(component));
    [w, x, y, z]
}

/// Splats from a file, in its axes: right, up, back.
///
/// # Errors
/// What is wrong with the file.
pub fn decode(bytes: &[u8]) -> Result<Splats, String> {
    if bytes.starts_with(&MAGIC.to_le_bytes()) {
        let version = bytes.get(4..8).and_then(|b| b.first_chunk()).map_or(0, |w| u32::from_le_bytes(*w));
        return Err(format!("it is of version {version} of SPZ, expected 2 or 3"));
    }
    let mut stream = GzDecoder::new(bytes);
    let mut header = [0; HEADER];
    stream
        .read_exact(&mut header)
        .map_err(|e| format!("it is not a gzip stream with a header of SPZ: {e}"))?;
    let word = |k: usize| u32::from_le_bytes([header[k], header[k + 1], header[k + 2], header[k + 3]]);
    let (version, n, [degree, bits]) = (word(4), word(8) as usize, [header[12], header[13]]);
    if word(0) != MAGIC {
        return Err("its content does not start with `NGSP`".into());
    }
    if !VERSIONS.contains(&version) {
        return Err(format!("it is of version {version} of SPZ, expected 2 or 3"));
    }
    if degree > 3 || i32::from(bits) > COORDINATE_BITS {
        return Err(format!(
            "it has spherical harmonics of degree {degree} and {bits} bits after the point, expected at most 3 and 24"
        ));
    }
    let of_splat = coefficients(degree.into());
    let rotation_bytes = if version == 2 { 3 } else { 4 };
    let widths = [9, 1, 3, 3, rotation_bytes, 3 * of_splat];
    let expected = n as u64 * widths.iter().sum::<usize>() as u64;
    let mut body = Vec::new();
    stream
        .take(expected)
        .read_to_end(&mut body)
        .map_err(|e| format!("its content is damaged or cut off: {e}"))?;
    if body.len() as u64 != expected {
        return Err(format!("it is cut off: {n} splats have {expected} bytes, {} are there", body.len()));
    }
    let mut rest = body.as_slice();
    let [positions, opacities, colors, scales, rotations, harmonics] = widths.map(|width| {
        let (group, after) = rest.split_at(n * width);
        rest = after;
        group
    });
    let mut splats = Splats::zeros(n);
    let unit = (-f64::from(bits)).exp2();
    for (value, b) in splats.position.as_flattened_mut().iter_mut().zip(positions.as_chunks::<3>().0) {
        // The sign is in the highest of the three bytes.
        *value = (f64::from(i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8) * unit) as f32;
    }
    for (value, b) in splats.opacity_logit.as_flattened_mut().iter_mut().zip(opacities) {
        *value = logit_of_byte(*b);
    }
    for (value, b) in splats.f_dc.as_flattened_mut().iter_mut().zip(colors) {
        *value = (f32::from(*b) / 255.0 - 0.5) / COLOR_SCALE;
    }
    for (value, b) in splats.log_scale.as_flattened_mut().iter_mut().zip(scales) {
        *value = f32::from(*b) / LOG_SCALE_STEPS + SMALLEST_LOG_SCALE;
    }
    for (value, b) in splats.rotation.iter_mut().zip(rotations.chunks_exact(rotation_bytes)) {
        *value = match *b {
            [x, y, z] => {
                let [x, y, z] = [x, y, z].map(|v| f32::from(v) / 127.5 - 1.0);
                let [x, y, z, w] = from_smallest_three(3, [x, y, z]);
                [w, x, y, z]
            }
            [a, b, c, d] => unpacked_rotation(u32::from_le_bytes([a, b, c, d])),
            _ => [1.0, 0.0, 0.0, 0.0],
        };
    }
    if of_splat > 0 {
        splats.f_rest = vec![[0.0; 3 * OF_CHANNEL]; n];
        for (values, b) in splats.f_rest.iter_mut().zip(harmonics.chunks_exact(3 * of_splat)) {
            for (i, b) in b.iter().enumerate() {
                values[OF_CHANNEL * (i % 3) + i / 3] = f32::from(*b) / HARMONICS_STEPS - 1.0;
            }
        }
    }
    flatten_if_flat(&mut splats, SMALLEST_LOG_SCALE);
    Ok(splats)
}

#[cfg(test)]
mod tests {
    use super::super::test_splats::{assert_near, some};
    use super::*;

    #[test]
    fn splats_come_back_within_the_steps_of_the_format() {
        for (degree, is_flat) in [(0, false), (0, true), (1, false), (3, false)] {
            let splats = some(200, degree, is_flat);
            let bytes = encode(&splats).unwrap();
            let read = decode(&bytes).unwrap();
            assert_eq!(read.primitive(), splats.primitive());
            // Half steps: 2^-12 m, 1 / (255 * 0.15), 1/16, 1/128.
            assert_near(&splats, &read, [1.3e-4, 0.014, 0.032, 0.004]);
            assert_eq!(encode(&splats).unwrap(), bytes);
        }
    }

    #[test]
    fn positions_have_the_bits_that_the_extent_leaves() {
        let of = |farthest: f32| {
            let mut splats = Splats::default();
            splats.push([farthest, -farthest, 0.0], 0.1, 0.5, [0.5; 3]);
            (step(&splats).unwrap().log2(), decode(&encode(&splats).unwrap()).unwrap().position[0])
        };
        for (farthest, bits) in
            [(0.001, -24.0), (0.9, -20.0), (10.0, -16.0), (300.0, -12.0), (2047.0, -12.0), (5000.0, -10.0)]
        {
            let (step, read) = of(farthest);
            assert_eq!(step, bits);
            assert!((read[0] - farthest).abs() <= 0.51 * bits.exp2() as f32, "{read:?}");
            assert!((read[1] + farthest).abs() <= 0.51 * bits.exp2() as f32, "{read:?}");
        }
        let mut splats = Splats::default();
        splats.push([1e8, 0.0, 0.0], 0.1, 0.5, [0.5; 3]);
        assert!(matches!(encode(&splats), Err(ExportError::TooWide { .. })));
    }

    #[test]
    fn damaged_files_and_other_versions_are_refused() {
        let splats = some(50, 1, false);
        let bytes = encode(&splats).unwrap();
        for part in 0..50 {
            assert!(decode(&bytes[..bytes.len() * part / 50]).is_err());
        }
        assert!(decode(b"NGSP\x04\0\0\0").unwrap_err().contains("version 4"));
        let mut raw = Vec::new();
        GzDecoder::new(bytes.as_slice()).read_to_end(&mut raw).unwrap();
        let zipped = |raw: &[u8]| {
            let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
            gzip.write_all(raw).unwrap();
            gzip.finish().unwrap()
        };
        let changed = |at: usize, to: u8| {
            let mut raw = raw.clone();
            raw[at] = to;
            decode(&zipped(&raw)).unwrap_err()
        };
        assert!(changed(0, b'P').contains("NGSP"));
        assert!(changed(4, 1).contains("version 1"));
        assert!(changed(11, 100).contains("cut off"));
        assert!(changed(12, 4).contains("degree 4"));
        assert!(decode(&zipped(&raw[..raw.len() - 1])).unwrap_err().contains("cut off"));
    }
}
