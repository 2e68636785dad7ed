//! The binary files of a COLMAP model.

use super::super::error::PerspectiveError;
use super::super::lens::LensModel;
use super::bytes::Bytes;
use super::{ColmapCamera, ColmapImage, ColmapObservation, ColmapPoint};
use std::io::{Result, Write};
use std::path::Path;

/// Number of a point that an observation does not have.
const NO_POINT: u64 = u64::MAX;
/// Bytes of the smallest camera, image, observation, point and element of a track.
const SMALLEST: [u64; 5] = [48, 73, 24, 51, 8];

/// Reads `cameras.bin`.
pub(super) fn cameras(path: &Path) -> std::result::Result<Vec<ColmapCamera>, PerspectiveError> {
    let mut bytes = Bytes::of(path)?;
    let count = bytes.count("the number of cameras", SMALLEST[0])?;
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let id = bytes.u32("the number of a camera")?;
        let field = format!("camera {id}");
        let number = bytes.i32(&field)?;
        let model = LensModel::from_id(number).ok_or_else(|| PerspectiveError::Model {
            path: path.into(),
            field: field.clone(),
            found: number.to_string(),
        })?;
        let (width, height) = (bytes.u64(&field)?, bytes.u64(&field)?);
        let parameters =
            (0..model.parameters()).map(|_| bytes.f64(&field)).collect::<std::result::Result<_, _>>()?;
        out.push(ColmapCamera { id, model, width, height, parameters });
    }
    bytes.end()?;
    Ok(out)
}

/// Reads `images.bin`.
pub(super) fn images(path: &Path) -> std::result::Result<Vec<ColmapImage>, PerspectiveError> {
    let mut bytes = Bytes::of(path)?;
    let count = bytes.count("the number of images", SMALLEST[1])?;
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let id = bytes.u32("the number of an image")?;
        let field = format!("image {id}");
        let (rotation, translation) = (bytes.f64s(&field)?, bytes.f64s(&field)?);
        let camera = bytes.u32(&field)?;
        let name = bytes.text(&format!("the name of image {id}"))?;
        let seen = bytes.count(&format!("the number of observations of image {id}"), SMALLEST[2])?;
        let mut observations = Vec::with_capacity(seen);
        for _ in 0..seen {
            let [x, y] = bytes.f64s(&field)?;
            let point = Some(bytes.u64(&field)?).filter(|p| *p != NO_POINT);
            observations.push(ColmapObservation { x, y, point });
        }
        out.push(ColmapImage { id, rotation, translation, camera, name, observations });
    }
    bytes.end()?;
    Ok(out)
}

/// Reads `points3D.bin`.
pub(super) fn points(path: &Path) -> std::result::Result<Vec<ColmapPoint>, PerspectiveError> {
    let mut bytes = Bytes::of(path)?;
    let count = bytes.count("the number of points", SMALLEST[3])?;
    let mut out = Vec::with_capacity(count);
    for _ in 0..count {
        let id = bytes.u64("the number of a point")?;
        let field = format!("point {id}");
        let position: [f64; 3] = bytes.f64s(&field)?;
        if position.iter().any(|v| !v.is_finite()) {
            return Err(PerspectiveError::field(
                bytes.path(),
                field,
                format!("{position:?}"),
                "a finite position",
            ));
        }
        let rgb = bytes.u8s(&field)?;
        let error = bytes.f64(&field)?;
        let length = bytes.count(&format!("the length of the track of point {id}"), SMALLEST[4])?;
        let mut track = Vec::with_capacity(length);
        for _ in 0..length {
            track.push((bytes.u32(&field)?, bytes.u32(&field)?));
        }
        out.push(ColmapPoint { id, position, rgb, error, track });
    }
    bytes.end()?;
    Ok(out)
}

fn put_f64s(out: &mut dyn Write, values: &[f64]) -> Result<()> {
    values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}

fn put_count(out: &mut dyn Write, count: usize) -> Result<()> {
    out.write_all(&(count as u64).to_le_bytes())
}

/// Writes `cameras.bin`.
pub(super) fn write_cameras(out: &mut dyn Write, cameras: &[ColmapCamera]) -> Result<()> {
    put_count(out, cameras.len())?;
    for c in cameras {
        out.write_all(&c.id.to_le_bytes())?;
        out.write_all(&c.model.id().to_le_bytes())?;
        out.write_all(&c.width.to_le_bytes())?;
        out.write_all(&c.height.to_le_bytes())?;
        put_f64s(out, &c.parameters)?;
    }
    Ok(())
}

/// Writes `images.bin`.
pub(super) fn write_images(out: &mut dyn Write, images: &[ColmapImage]) -> Result<()> {
    put_count(out, images.len())?;
    for i in images {
        out.write_all(&i.id.to_le_bytes())?;
        put_f64s(out, &i.rotation)?;
        put_f64s(out, &i.translation)?;
        out.write_all(&i.camera.to_le_bytes())?;
        out.write_all(i.name.as_bytes())?;
        out.write_all(&[0])?;
        put_count(out, i.observations.len())?;
        for o in &i.observations {
            put_f64s(out, &[o.x, o.y])?;
            out.write_all(&o.point.unwrap_or(NO_POINT).to_le_bytes())?;
        }
    }
    Ok(())
}

/// Writes `points3D.bin`.
pub(super) fn write_points(out: &mut dyn Write, points: &[ColmapPoint]) -> Result<()> {
    put_count(out, points.len())?;
    for p in points {
        out.write_all(&p.id.to_le_bytes())?;
        put_f64s(out, &p.position)?;
        out.write_all(&p.rgb)?;
        put_f64s(out, &[p.error])?;
        put_count(out, p.track.len())?;
        for (image, index) in &p.track {
            out.write_all(&image.to_le_bytes())?;
            out.write_all(&index.to_le_bytes())?;
        }
    }
    Ok(())
}
