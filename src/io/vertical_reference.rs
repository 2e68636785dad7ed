//! Vertical references: the WGS 84 ellipsoid or a geoid.

use super::VerticalError;
use crate::frame::{FrameError, GeoidGrid};
use std::path::{Path, PathBuf};

/// Geoid models: name, EPSG code of heights above it, and names of its grids in PROJ's data.
const MODELS: [(&str, u32, &[&str]); 3] = [
    ("EGM84", 5798, &["us_nga_egm84_30.tif", "egm84_30.gtx"]),
    ("EGM96", 5773, &["us_nga_egm96_15.tif", "egm96_15.gtx"]),
    ("EGM2008", 3855, &["us_nga_egm08_25.tif", "egm08_25.gtx"]),
];
/// Folders of PROJ's data, in addition to those of its environment variables.
const FOLDERS: [&str; 3] = ["/usr/share/proj", "/usr/local/share/proj", "/opt/homebrew/share/proj"];

/// Heights whose difference equals the geoid's height to within this, in metres, probably have different vertical references.
const NEAR_GEOID_M: f64 = 5.0;

/// The height of the geoid at a place, and whether a difference of heights is that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeoidDifference {
    /// Height of the geoid (EGM96) above the ellipsoid, metres.
    pub geoid_m: f64,
    /// Whether the difference is about as large, up or down.
    pub is_near: bool,
}

impl GeoidDifference {
    /// Compares a difference of heights with the geoid at a place in degrees; none without a grid of the geoid.
    #[must_use]
    pub fn at(lon_deg: f64, lat_deg: f64, difference_m: f64) -> Option<Self> {
        let geoid_m = VerticalReference::read("EGM96").ok()?.undulation_m(lon_deg, lat_deg);
        let is_near =
            (difference_m.abs() - geoid_m.abs()).abs() < NEAR_GEOID_M && geoid_m.abs() > NEAR_GEOID_M;
        geoid_m.is_finite().then_some(Self { geoid_m, is_near })
    }
}

/// The surface from which heights are counted.
pub enum VerticalReference {
    /// The WGS 84 ellipsoid.
    Ellipsoid,
    /// A geoid.
    Geoid {
        /// Name of the model, or of the grid's file.
        name: String,
        /// EPSG code of heights above the geoid, for known models.
        epsg: Option<u32>,
        /// Grid of the geoid's height above the ellipsoid.
        grid: GeoidGrid,
    },
}

impl VerticalReference {
    /// Metadata item of rasters that names their vertical reference.
    pub const ITEM: &str = "VERTICAL_REFERENCE";

    /// Name of the ellipsoid, as [`VerticalReference::read`] takes it.
    pub const ELLIPSOID: &str = "ellipsoid";

    /// Reads a vertical reference: `ellipsoid`, the name or EPSG code of a geoid model, the path of a geoid grid, or
    /// the name of a grid in PROJ's folders. All options and files that name a vertical reference are read by this
    /// function.
    ///
    /// # Errors
    /// [`VerticalError`] if the text is not known, or the grid is missing or cannot be read.
    pub fn read(text: &str) -> Result<Self, VerticalError> {
        let name = Self::known_name(text);
        if name == Self::ELLIPSOID {
            return Ok(Self::Ellipsoid);
        }
        let (file, grid) = match MODELS.iter().find(|m| m.0 == name) {
            Some((model, _, grids)) => match in_folders(grids) {
                Some(path) => opened(&path)?,
                None => {
                    let published = grids.iter().find(|grid| grid.ends_with(".tif")).unwrap_or(&grids[0]);
                    let absent =
                        || VerticalError::NoGrid { name: (*model).into(), grid: (*published).into() };
                    let known = |file: &&str| Some(((*file).to_owned(), GeoidGrid::of_proj(file)?));
                    grids.iter().find_map(known).ok_or_else(absent)?
                }
            },
            None if Path::new(text).exists() => opened(Path::new(text))?,
            None => {
                let unknown = || VerticalError::Unknown { name: text.into() };
                opened(&in_folders(&[text]).ok_or_else(unknown)?)?
            }
        };
        let model = MODELS.iter().find(|m| m.2.contains(&file.as_str()));
        let (name, epsg) = model.map_or((file, None), |m| (m.0.to_owned(), Some(m.1)));
        Ok(Self::Geoid { name, epsg, grid })
    }

    /// The name that [`VerticalReference::read`] takes for what files call a vertical reference, as `WGS 84 ellipsoid`,
    /// `EGM96 height` or `EPSG:3855`; the text itself if it is unknown.
    #[must_use]
    pub fn known_name(text: &str) -> String {
        let text = text.trim();
        let letters: String = text.chars().filter(char::is_ascii_alphanumeric).collect();
        let letters = letters.to_ascii_uppercase();
        if ["ELLIPSOID", "WGS84ELLIPSOID", "ELLIPSOIDALHEIGHT", "EPSG4979", "EPSG4326"]
            .contains(&letters.as_str())
            || text.to_ascii_lowercase().ends_with("ellipsoid")
        {
            return Self::ELLIPSOID.into();
        }
        let is_model = |m: &&(&str, u32, &[&str])| {
            let rest = letters.strip_prefix(m.0).map(|r| r.trim_end_matches("MODEL"));
            matches!(rest, Some("" | "HEIGHT" | "GEOID" | "GEOIDHEIGHT")) || letters == format!("EPSG{}", m.1)
        };
        MODELS.iter().find(is_model).map_or_else(|| text.to_owned(), |m| m.0.to_owned())
    }

    /// Whether a name is that of the ellipsoid or of a known model.
    pub(super) fn is_known(name: &str) -> bool {
        name == Self::ELLIPSOID || MODELS.iter().any(|m| m.0 == name)
    }

    /// The name in [`VerticalReference::ITEM`].
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Ellipsoid => "WGS 84 ellipsoid",
            Self::Geoid { name, .. } => name,
        }
    }

    /// EPSG code of the vertical CRS, for compound CRSs; none for the ellipsoid and for unknown models.
    #[must_use]
    pub fn epsg(&self) -> Option<u32> {
        match self {
            Self::Ellipsoid => None,
            Self::Geoid { epsg, .. } => *epsg,
        }
    }

    /// Height of the vertical reference above the ellipsoid at a place in degrees, metres; NaN outside of the geoid's
    /// grid.
    #[must_use]
    pub fn undulation_m(&self, lon_deg: f64, lat_deg: f64) -> f64 {
        match self {
            Self::Ellipsoid => 0.0,
            Self::Geoid { grid, .. } => grid.undulation_m(lon_deg, lat_deg),
        }
    }
}

/// The name of a grid's file, and the grid.
fn opened(path: &Path) -> Result<(String, GeoidGrid), FrameError> {
    let file = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    Ok((file, GeoidGrid::open(path)?))
}

/// The first of some files that exists in a folder of PROJ's data.
fn in_folders(files: &[&str]) -> Option<PathBuf> {
    let listed = ["PROJ_DATA", "PROJ_LIB"].into_iter().filter_map(std::env::var_os);
    let folders: Vec<PathBuf> = listed
        .flat_map(|list| std::env::split_paths(&list).collect::<Vec<_>>())
        .chain(FOLDERS.iter().map(PathBuf::from))
        .collect();
    let paths = folders.iter().flat_map(|folder| files.iter().map(|file| Path::join(folder, file)));
    paths.into_iter().find(|path| path.exists())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_references_in_files_are_recognised() {
        for (text, name) in [
            ("WGS 84 ellipsoid", "ellipsoid"),
            ("Ellipsoid", "ellipsoid"),
            ("egm96", "EGM96"),
            ("EGM96 geoid", "EGM96"),
            ("EGM96 geoid height", "EGM96"),
            ("EGM 2008", "EGM2008"),
            ("EPSG:3855", "EGM2008"),
            ("NAVD88 height (ftUS)", "NAVD88 height (ftUS)"),
            ("my_egm96_15.gtx", "my_egm96_15.gtx"),
        ] {
            assert_eq!(VerticalReference::known_name(text), name);
        }
    }

    #[test]
    fn the_error_for_an_unknown_reference_lists_the_known_ones() {
        let Err(error) = VerticalReference::read("NAVD88") else { panic!("there is no such model") };
        let help = miette::Diagnostic::help(&error).map(|h| h.to_string()).unwrap_or_default();
        assert!(error.to_string().contains("NAVD88"), "{error}");
        assert!(["ellipsoid", "EGM84", "EGM96", "EGM2008"].iter().all(|n| help.contains(n)), "{help}");
    }
}
