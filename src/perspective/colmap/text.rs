//! The text files of a COLMAP model.

use super::super::error::PerspectiveError;
use super::super::lens::LensModel;
use super::{ColmapCamera, ColmapImage, ColmapObservation, ColmapPoint};
use crate::io::read_text;
use std::io::Write;
use std::path::Path;
use std::str::FromStr;

type Result<T> = std::result::Result<T, PerspectiveError>;

/// The words of a line, with what errors say.
struct Words<'a> {
    path: &'a Path,
    line: usize,
    words: std::str::SplitAsciiWhitespace<'a>,
}

impl<'a> Words<'a> {
    fn new(path: &'a Path, line: usize, text: &'a str) -> Self {
        Self { path, line, words: text.split_ascii_whitespace() }
    }

    fn error(&self, what: &str, found: impl Into<String>, expected: &str) -> PerspectiveError {
        PerspectiveError::field(self.path, format!("{what} in line {}", self.line), found, expected)
    }

    fn word(&mut self, what: &str) -> Result<&'a str> {
        self.words.next().ok_or_else(|| self.error(what, "missing", "a value"))
    }

    fn value<T: FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.word(what)?;
        word.parse().map_err(|_| self.error(what, format!("`{word}`"), "a number"))
    }

    fn values<T: FromStr + Default + Copy, const N: usize>(&mut self, what: &str) -> Result<[T; N]> {
        let mut out = [T::default(); N];
        for value in &mut out {
            *value = self.value(what)?;
        }
        Ok(out)
    }

    fn is_at_end(&self) -> bool {
        self.words.clone().next().is_none()
    }
}

/// Numbered lines that are not comments; empty ones are kept.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    numbered.filter(|(_, line)| !line.starts_with('#'))
}

/// Reads `cameras.txt`.
pub(super) fn cameras(path: &Path) -> Result<Vec<ColmapCamera>> {
    let text = read_text(path)?;
    let camera = |(number, line)| {
        let mut words = Words::new(path, number, line);
        let id = words.value("the number of a camera")?;
        let name = words.word("the camera model")?;
        let model = LensModel::named(name).ok_or_else(|| PerspectiveError::Model {
            path: path.into(),
            field: format!("camera {id}"),
            found: name.into(),
        })?;
        let [width, height] = words.values("the size")?;
        let mut parameters = Vec::with_capacity(model.parameters());
        while !words.is_at_end() {
            parameters.push(words.value("a parameter")?);
        }
        Ok(ColmapCamera { id, model, width, height, parameters })
    };
    lines(&text).filter(|(_, line)| !line.is_empty()).map(camera).collect()
}

/// Reads `images.txt`. An image has two lines, the second of which may be empty.
pub(super) fn images(path: &Path) -> Result<Vec<ColmapImage>> {
    let text = read_text(path)?;
    let mut lines = lines(&text);
    let mut out = Vec::new();
    while let Some((number, line)) = lines.next() {
        if line.is_empty() {
            continue;
        }
        let mut words = Words::new(path, number, line);
        let id = words.value("the number of an image")?;
        let rotation = words.values("the quaternion")?;
        let translation = words.values("the translation")?;
        let camera = words.value("the number of the camera")?;
        let first = words.word("the name of the image")?;
        // Names may contain blanks: the name is the rest of the line.
        let start = first.as_ptr() as usize - line.as_ptr() as usize;
        let name = line.get(start..).unwrap_or(first).to_owned();
        let mut observations = Vec::new();
        if let Some((number, line)) = lines.next() {
            let mut words = Words::new(path, number, line);
            while !words.is_at_end() {
                let [x, y] = words.values("an observation")?;
                let point: i64 = words.value("the point of an observation")?;
                observations.push(ColmapObservation { x, y, point: u64::try_from(point).ok() });
            }
        }
        out.push(ColmapImage { id, rotation, translation, camera, name, observations });
    }
    Ok(out)
}

/// Reads `points3D.txt`.
pub(super) fn points(path: &Path) -> Result<Vec<ColmapPoint>> {
    let text = read_text(path)?;
    let point = |(number, line)| {
        let mut words = Words::new(path, number, line);
        let id = words.value("the number of a point")?;
        let position: [f64; 3] = words.values("the position")?;
        if position.iter().any(|v| !v.is_finite()) {
            return Err(words.error("the position", format!("{position:?}"), "finite"));
        }
        let rgb = words.values("the colour")?;
        let error = words.value("the error")?;
        let mut track = Vec::new();
        while !words.is_at_end() {
            track.push((words.value("the track")?, words.value("the track")?));
        }
        Ok(ColmapPoint { id, position, rgb, error, track })
    };
    lines(&text).filter(|(_, line)| !line.is_empty()).map(point).collect()
}

/// Numbers with as many digits as it takes to read the same value back.
fn spaced<T: ToString>(values: &[T]) -> String {
    values.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
}

/// Writes `cameras.txt`.
pub(super) fn write_cameras(out: &mut dyn Write, cameras: &[ColmapCamera]) -> std::io::Result<()> {
    writeln!(out, "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: {}", cameras.len())?;
    for c in cameras {
        let (name, parameters) = (c.model.name(), spaced(&c.parameters));
        writeln!(out, "{} {name} {} {} {parameters}", c.id, c.width, c.height)?;
    }
    Ok(())
}

/// Writes `images.txt`.
pub(super) fn write_images(out: &mut dyn Write, images: &[ColmapImage]) -> std::io::Result<()> {
    writeln!(
        out,
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n\
         # Number of images: {}",
        images.len()
    )?;
    for i in images {
        let (rotation, translation) = (spaced(&i.rotation), spaced(&i.translation));
        writeln!(out, "{} {rotation} {translation} {} {}", i.id, i.camera, i.name)?;
        for (k, o) in i.observations.iter().enumerate() {
            let point = o.point.map_or_else(|| "-1".to_owned(), |p| p.to_string());
            write!(out, "{}{} {} {point}", if k == 0 { "" } else { " " }, o.x, o.y)?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// Writes `points3D.txt`.
pub(super) fn write_points(out: &mut dyn Write, points: &[ColmapPoint]) -> std::io::Result<()> {
    writeln!(
        out,
        "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n# Number of points: {}",
        points.len()
    )?;
    for p in points {
        write!(out, "{} {} {} {}", p.id, spaced(&p.position), spaced(&p.rgb), p.error)?;
        for (image, index) in &p.track {
            write!(out, " {image} {index}")?;
        }
        writeln!(out)?;
    }
    Ok(())
}
