//! Splat files of all formats, read.

use super::packing::bounds;
use super::{Axes, ExportError, compressed_ply, splat_gltf, spz};
use crate::frame::SiteGrid;
use crate::io::{read_georeference, read_json};
use crate::splat::harmonics_turn::degree;
use crate::splat::ply;
use crate::splat::primitive::PrimitiveKind;
use crate::splat::splats::Splats;
use serde::Serialize;
use std::path::Path;

/// A format of splat files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum SplatFormat {
    /// The PLY of 3DGS and 2DGS.
    #[serde(rename = "ply")]
    Ply,
    /// The compressed PLY of PlayCanvas.
    #[serde(rename = "compressed-ply")]
    CompressedPly,
    /// SPZ.
    #[serde(rename = "spz")]
    Spz,
    /// glTF with `KHR_gaussian_splatting`.
    #[serde(rename = "gltf")]
    Gltf,
}

/// What is in a splat file.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatFile {
    /// Its format.
    pub format: SplatFormat,
    /// Its splats, in the axes of the file.
    pub splats: Splats,
    /// The axes, which glTF and SPZ define; of PLY files those that `NAME.georef.json` names.
    pub axes: Axes,
    /// The frame of the coordinates, if the file or `NAME.georef.json` beside it says so.
    pub site: Option<SiteGrid>,
}

impl SplatFile {
    /// Whether a path has an ending of splat files: `.ply`, `.spz`, `.glb`.
    #[must_use]
    pub fn is_named_like_one(path: &Path) -> bool {
        ending(path).is_some()
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`ExportError::NotSplats`] if it cannot be read or is damaged, [`ExportError::Georeference`] if the file beside it is.
    pub fn read(path: &Path) -> Result<Self, ExportError> {
        let refused = |reason: String| ExportError::NotSplats { path: path.into(), reason };
        let bytes = std::fs::read(path).map_err(|e| refused(e.to_string()))?;
        let mut inside = None;
        let (format, splats) = match ending(path) {
            Some("spz") => (SplatFormat::Spz, spz::decode(&bytes).map_err(refused)?),
            Some("glb") => {
                let (splats, site) = splat_gltf::decode(&bytes).map_err(refused)?;
                inside = site;
                (SplatFormat::Gltf, splats)
            }
            Some(_) if compressed_ply::is_one(&bytes) => {
                (SplatFormat::CompressedPly, compressed_ply::decode(&bytes).map_err(refused)?)
            }
            Some(_) => (SplatFormat::Ply, ply::decode(path, &bytes)?),
            None => return Err(refused("it does not end in .ply, .spz or .glb".into())),
        };
        let beside =
            |path: &Path| read_georeference(path).map_err(|source| ExportError::Georeference { source });
        let site = if inside.is_some() { inside } else { beside(path)? };
        let axes = match format {
            SplatFormat::Spz | SplatFormat::Gltf => Axes::EastUpSouth,
            SplatFormat::Ply | SplatFormat::CompressedPly => axes_beside(path)?,
        };
        Ok(Self { format, splats, axes, site })
    }

    /// The splats in the site frame.
    #[must_use]
    pub fn into_site(self) -> Splats {
        self.axes.to_site(self.splats)
    }
}

/// The format by the ending of a name.
fn ending(path: &Path) -> Option<&'static str> {
    let found = path.extension()?.to_str()?.to_ascii_lowercase();
    ["ply", "spz", "glb"].into_iter().find(|ending| *ending == found)
}

/// The axes that the file with the georeference names.
fn axes_beside(path: &Path) -> Result<Axes, ExportError> {
    #[derive(serde::Deserialize)]
    struct Directions {
        axes: Option<Vec<String>>,
    }
    let georef = path.with_extension("georef.json");
    if !georef.exists() {
        return Ok(Axes::default());
    }
    let read: Directions = read_json(&georef).map_err(|source| ExportError::Georeference { source })?;
    let Some(names) = read.axes else { return Ok(Axes::default()) };
    Axes::named(&names).ok_or_else(|| ExportError::UnknownAxes { path: georef, axes: names.join(", ") })
}

/// What a splat file holds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SplatFileInfo {
    /// Its format.
    pub format: SplatFormat,
    /// Number of splats.
    pub splats: usize,
    /// Ellipsoids or discs.
    pub primitive: PrimitiveKind,
    /// Highest degree of spherical harmonics that is not zero.
    pub degree: usize,
    /// Directions of x, y and z.
    pub axes: [&'static str; 3],
    /// Corners of the box around the centres, in the axes and the unit of the file; none without splats.
    pub bounds: Option<[[f32; 3]; 2]>,
    /// The frame of the coordinates, if it is known.
    pub site: Option<SiteGrid>,
    /// Corners of that box on the map of the frame: easting, northing, ellipsoidal height, metres.
    pub map_bounds: Option<[[f64; 3]; 2]>,
}

impl SplatFile {
    /// What the file holds.
    #[must_use]
    pub fn info(&self) -> SplatFileInfo {
        let corners = |splats: &Splats| {
            let (low, high) = bounds(&splats.position);
            (!splats.is_empty()).then_some([low, high])
        };
        let on_map = || {
            let origin = self.site?.origin.xyz();
            // The axes of files are those of the site frame in another order or direction.
            let [a, b] = corners(&self.splats)?.map(|corner| self.axes.place_in_site(corner));
            let corner = |of: fn(f64, f64) -> f64| std::array::from_fn(|k| origin[k] + of(a[k], b[k]));
            Some([corner(f64::min), corner(f64::max)])
        };
        SplatFileInfo {
            format: self.format,
            splats: self.splats.len(),
            primitive: self.splats.primitive(),
            degree: degree(&self.splats),
            axes: self.axes.names(),
            bounds: corners(&self.splats),
            site: self.site,
            map_bounds: on_map(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_splats::some;
    use super::*;
    use crate::frame::Point;
    use crate::io::write_georeference;

    #[test]
    fn a_file_is_known_by_its_content_and_its_place_by_what_lies_beside() {
        let folder = tempfile::tempdir().unwrap();
        let splats = some(300, 0, false);
        let (plain, packed) = (folder.path().join("a.ply"), folder.path().join("b.compressed.ply"));
        ply::write_local(&plain, &splats).unwrap();
        std::fs::write(&packed, compressed_ply::encode(&splats, &[])).unwrap();
        let read = SplatFile::read(&plain).unwrap();
        assert_eq!((read.format, read.site, &read.splats), (SplatFormat::Ply, None, &splats));
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.5, 3_357_611.25, -20.5) };
        write_georeference(&packed, &site).unwrap();
        let read = SplatFile::read(&packed).unwrap();
        assert_eq!((read.format, read.site), (SplatFormat::CompressedPly, Some(site)));
        let info = read.info();
        let [low, high] = info.map_bounds.unwrap();
        assert!((low[0] - 436_191.5).abs() < 0.5 && (high[2] - -0.5).abs() < 0.5, "{low:?} {high:?}");
        std::fs::write(packed.with_extension("georef.json"), "{\"axes\": [\"west\"]}").unwrap();
        assert!(SplatFile::read(&packed).is_err());
        for (name, content, says) in [
            ("c.txt", "", "does not end in"),
            ("c.spz", "text", "gzip"),
            ("c.glb", "text", "header of a .glb"),
            ("c.ply", "text", "PLY header"),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            let error = SplatFile::read(&path).unwrap_err().to_string();
            assert!(error.contains(says) && error.contains(name), "{error}");
        }
    }
}
