//! What heights count from: the WGS 84 ellipsoid, or a geoid.

use super::{Geoid, RasterError};
use std::path::{Path, PathBuf};

/// Geoid models by name: EPSG code of the heights above them, and the grids PROJ has of them.
const MODELS: [(&str, u32, &[&str]); 3] = [
    ("EGM84", 5798, &["us_nga_egm84_30.tif", "egm84_30.gtx"]),
    ("EGM96", 5773, &["us_nga_egm96_15.tif", "egm96_15.gtx"]),
    ("EGM2008", 3855, &["us_nga_egm08_25.tif", "egm08_25.gtx"]),
];
/// Where grids lie if PROJ's environment variables name no other folder.
const FOLDERS: [&str; 3] = ["/usr/share/proj", "/usr/local/share/proj", "/opt/homebrew/share/proj"];

/// What heights count from.
pub enum Vertical {
    /// The WGS 84 ellipsoid.
    Ellipsoid,
    /// A geoid.
    Geoid {
        /// Its model's name, or its grid's.
        name: String,
        /// EPSG code of heights above it.
        epsg: Option<u32>,
        /// Its height above the ellipsoid.
        grid: Geoid,
    },
}

impl Vertical {
    /// Metadata item of a raster that says what its heights count from.
    pub const ITEM: &str = "VERTICAL_REFERENCE";

    /// `ellipsoid`, the name of a geoid model whose grid PROJ has, or the path of a geoid's grid.
    ///
    /// # Errors
    /// [`RasterError::NoGeoid`], or another when the grid cannot be read.
    pub fn read(text: &str) -> Result<Self, RasterError> {
        if text.eq_ignore_ascii_case("ellipsoid") {
            return Ok(Self::Ellipsoid);
        }
        let path = PathBuf::from(text);
        let named = MODELS.iter().find(|m| m.0.eq_ignore_ascii_case(text));
        let found = match named {
            Some((_, _, grids)) => {
                in_folders(grids).ok_or_else(|| RasterError::NoGeoid { name: text.into() })?
            }
            None => path,
        };
        let file = found.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let model = MODELS.iter().find(|m| m.2.contains(&file.as_str()));
        let (name, epsg) = model.map_or((file, None), |m| (m.0.to_owned(), Some(m.1)));
        Ok(Self::Geoid { name, epsg, grid: Geoid::read(&found)? })
    }

    /// As [`Vertical::ITEM`] has it.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Ellipsoid => "WGS 84 ellipsoid",
            Self::Geoid { name, .. } => name,
        }
    }

    /// Whether a raster's [`Vertical::ITEM`] means the ellipsoid.
    #[must_use]
    pub fn is_ellipsoid(item: &str) -> bool {
        item.to_ascii_lowercase().contains("ellipsoid")
    }

    /// EPSG code of the heights, if it takes one beside the map's CRS.
    #[must_use]
    pub fn epsg(&self) -> Option<u32> {
        match self {
            Self::Ellipsoid => None,
            Self::Geoid { epsg, .. } => *epsg,
        }
    }

    /// Height of what heights count from above the ellipsoid at a place in degrees, metres; NaN where unknown.
    #[must_use]
    pub fn undulation_m(&self, lon_deg: f64, lat_deg: f64) -> f64 {
        match self {
            Self::Ellipsoid => 0.0,
            Self::Geoid { grid, .. } => grid.undulation_m(lon_deg, lat_deg),
        }
    }
}

/// The first of some files that one of PROJ's folders has.
fn in_folders(files: &[&str]) -> Option<PathBuf> {
    let listed = ["PROJ_DATA", "PROJ_LIB"].into_iter().filter_map(std::env::var_os);
    let folders: Vec<PathBuf> = listed
        .flat_map(|list| std::env::split_paths(&list).collect::<Vec<_>>())
        .chain(FOLDERS.iter().map(PathBuf::from))
        .collect();
    let paths = folders.iter().flat_map(|folder| files.iter().map(|file| Path::join(folder, file)));
    paths.into_iter().find(|path| path.exists())
}
