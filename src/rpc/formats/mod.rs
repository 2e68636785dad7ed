//! Readers and writers of RPC files. The format of a file is recognised by its content, not by its name.
//!
//! Formats read: `_RPC.TXT` text (IKONOS, GeoEye, Planet, SkySat), Maxar's `.XML` and `.RPB`, DIMAP 1, 2 and 3, OSSIM
//! `.geom`, rpcm JSON, the TIFF tag 50844, GDAL's `.aux.xml` and VRT, and whatever else GDAL lists in its RPC
//! metadata domain. Formats written: text, RPB, JSON and, through GDAL, the TIFF tag; a file that was written and read
//! back gives the same bits. Pixel (0, 0) is the centre of the first pixel, as in RPC00B; readers of formats with another
//! convention convert.

mod date;
mod dimap;
mod gdal;
mod geom;
mod json;
mod keys;
mod maxar;
mod product;
mod text;
mod tiff;
mod vendor_xml;
mod xml;

pub use date::iso_date;
pub use gdal::{from_gdal, to_gdal};
pub use json::to_json;
pub use maxar::{til_offset, to_rpb};
pub use text::to_text;
pub use tiff::{from_tiff, parse_tiff};

use super::{Rpc, RpcError};
use crate::io::{decode_text, vsi};
use std::path::{Path, PathBuf};

/// Largest size of an RPC file.
const MAX_BYTES: u64 = 64 << 20;

/// Largest distance between the projections of two models that count as the same model, pixels; it allows for rounding.
pub const SAME_PX: f64 = 0.1;

/// Why no RPC could be read from a file.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum FormatError {
    /// A required coefficient is missing.
    #[error("`{file}`: RPC field `{field}` is missing (found {found} of {of} fields)", of = keys::REQUIRED)]
    #[diagnostic(help(
        "the RPC is incomplete: ask for the original metadata; `satgs info` lists what was read"
    ))]
    Missing {
        /// The file.
        file: PathBuf,
        /// The first missing field, by its name in the file's format.
        field: String,
        /// Number of required coefficients found.
        found: usize,
    },
    /// A polynomial has the wrong number of coefficients.
    #[error("`{file}`: RPC field `{field}` has {found} coefficients, {expected} are expected")]
    #[diagnostic(help("RPC00B has 20 coefficients in each of its four polynomials"))]
    Count {
        /// The file.
        file: PathBuf,
        /// The polynomial.
        field: String,
        /// Coefficients found.
        found: usize,
        /// Coefficients expected.
        expected: usize,
    },
    /// A field holds text that is not a number.
    #[error("`{file}`: `{field}` is `{text}`, a number is expected")]
    #[diagnostic(help(
        "numbers have a decimal point instead of a comma, and at most a unit after them: `-0.0703 degrees`"
    ))]
    NotANumber {
        /// The file.
        file: PathBuf,
        /// The field.
        field: String,
        /// The text found.
        text: String,
    },
    /// The coefficients do not form a valid RPC.
    #[error("`{file}`: {source}")]
    #[diagnostic(help("{hint}"))]
    Invalid {
        /// The file.
        file: PathBuf,
        /// Which coefficient is invalid, and why.
        source: RpcError,
        /// What the user can do about it.
        hint: &'static str,
    },
    /// The file begins like JSON but cannot be parsed as JSON.
    #[error("`{file}` is not valid JSON: {cause}")]
    #[diagnostic(help("NaN and Infinity are not JSON numbers; is the file complete?"))]
    Json {
        /// The file.
        file: PathBuf,
        /// Error of the parser.
        cause: serde_json::Error,
    },
    /// The file begins like XML but cannot be parsed as XML.
    #[error("`{file}` is not valid XML: {cause}")]
    #[diagnostic(help("is the file complete?"))]
    Xml {
        /// The file.
        file: PathBuf,
        /// Error of the parser.
        cause: roxmltree::Error,
    },
    /// The file holds an RPC00A, whose polynomial terms are in another order.
    #[error("`{file}` holds an RPC00A, satgs reads RPC00B")]
    #[diagnostic(help(
        "RPC00A orders the polynomial terms differently; ask for RPC00B, or convert the image with a tool that reads RPC00A"
    ))]
    Rpc00a {
        /// The file.
        file: PathBuf,
    },
    /// A field occurs twice with different values.
    #[error("`{file}`: `{field}` is given twice, as {first} and as {second}")]
    #[diagnostic(help("remove the value that is wrong; the producer of the file knows which"))]
    Twice {
        /// The file.
        file: PathBuf,
        /// The field.
        field: String,
        /// The first value.
        first: f64,
        /// The second value.
        second: f64,
    },
    /// The file is in none of the known formats.
    #[error("`{file}` is not an RPC file in a known format{what}")]
    #[diagnostic(help(
        "known formats are `_RPC.TXT` text, Maxar .RPB and .XML, DIMAP, OSSIM .geom, rpcm JSON, and RPCs that GDAL reads"
    ))]
    Unrecognised {
        /// The file.
        file: PathBuf,
        /// What the file seems to be, in parentheses after a space; empty if that is not known.
        what: &'static str,
    },
    /// The file cannot be read, is not a regular file, or is too large to be an RPC.
    #[error("`{file}` cannot be read: {cause}")]
    #[diagnostic(help("does the file exist, and may you read it?"))]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// Error of the file system.
        cause: std::io::Error,
    },
}

impl FormatError {
    fn invalid(file: &Path, source: RpcError) -> Self {
        let hint = match &source {
            RpcError::OutOfRange { .. } => "are latitude and longitude swapped?",
            RpcError::Pole { .. } => "are the coefficients in the order of RPC00B?",
            _ => "the RPC is damaged: ask for the original metadata",
        };
        Self::Invalid { file: file.into(), source, hint }
    }
}

/// Metadata of a view that some files hold beside the RPC. `None` means that the file does not state the value.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewTags {
    /// File name of the image.
    pub image: Option<String>,
    /// Columns and rows of the image; of a tiled product, those of all tiles together.
    pub size: Option<(usize, usize)>,
    /// Azimuth of the sun, clockwise from true north, and its elevation above the horizon, degrees.
    pub sun_deg: Option<(f64, f64)>,
    /// Acquisition time in UTC, `YYYY-MM-DDThh:mm:ssZ` or `YYYY-MM-DD`.
    pub acquired: Option<String>,
    /// Lowest and highest ellipsoidal height on the ground, metres.
    pub height_range: Option<(f64, f64)>,
    /// Mean ground sampling distance, metres.
    pub gsd_m: Option<f64>,
    /// Incidence angle: between the line of sight and the vertical at the ground, degrees.
    pub off_nadir_deg: Option<f64>,
    /// The tiles of a product that is delivered in several files.
    pub tiles: Option<Tiles>,
    /// Value of pixels without data.
    pub nodata: Option<f64>,
}

/// Layout of a product that is delivered as tiles in files `…_R1C1`, `…_R1C2`, …, as DIMAP describes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiles {
    /// Distance from one tile to the next along a row, pixels.
    pub width: usize,
    /// Distance from one tile to the next along a column, pixels.
    pub height: usize,
    /// Number of tiles in a row.
    pub across: usize,
    /// Number of tiles in a column.
    pub down: usize,
}

impl ViewTags {
    /// These tags, completed by the values of `other` that these do not state.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            image: self.image.or(other.image),
            size: self.size.or(other.size),
            sun_deg: self.sun_deg.or(other.sun_deg),
            acquired: self.acquired.or(other.acquired),
            height_range: self.height_range.or(other.height_range),
            gsd_m: self.gsd_m.or(other.gsd_m),
            off_nadir_deg: self.off_nadir_deg.or(other.off_nadir_deg),
            tiles: self.tiles.or(other.tiles),
            nodata: self.nodata.or(other.nodata),
        }
    }
}

/// Content of an RPC file.
#[derive(Clone, Debug, PartialEq)]
pub struct RpcFile {
    /// The camera.
    pub rpc: Rpc,
    /// Other metadata in the file.
    pub tags: ViewTags,
    /// Name of the format, for messages: `Maxar XML`, `DIMAP v2`.
    pub format: &'static str,
    /// Warnings about the content, one sentence each.
    pub warnings: Vec<String>,
}

impl RpcFile {
    /// A camera without other metadata.
    #[must_use]
    pub fn new(rpc: Rpc, format: &'static str) -> Self {
        Self { rpc, tags: ViewTags::default(), format, warnings: Vec::new() }
    }
}

/// Reads an RPC file; its format is recognised by its content.
///
/// # Errors
/// [`FormatError`], naming file and field.
pub fn read(file: &Path) -> Result<RpcFile, FormatError> {
    parse(file, &read_text(file)?)
}

/// Parses the content of an RPC file as [`read`] does; `file` names it in messages.
///
/// # Errors
/// As [`read`].
pub fn parse(file: &Path, content: &str) -> Result<RpcFile, FormatError> {
    let content = content.trim_start_matches('\u{feff}').trim_start();
    match content.as_bytes().first() {
        Some(b'{') => json::from_json(file, content),
        Some(b'<') => vendor_xml::from_xml(file, content),
        None => Err(FormatError::Unrecognised { file: file.into(), what: " (it is empty)" }),
        _ if maxar::is_pvl(content) => maxar::from_rpb(file, content),
        _ if geom::is_geom(content) => geom::from_geom(file, content),
        _ => text::from_text(file, content),
    }
}

/// Reads the metadata of a view from a metadata file (`.IMD`, `.XML`, `DIM_*.XML`, Planet's and GeoEye's
/// `_metadata.*`), with or without an RPC.
///
/// # Errors
/// [`FormatError`] if the file cannot be read or is damaged XML.
pub fn read_tags(file: &Path) -> Result<ViewTags, FormatError> {
    let content = read_text(file)?;
    let content = content.trim_start_matches('\u{feff}').trim_start();
    Ok(match content.as_bytes().first() {
        Some(b'<') => vendor_xml::tags_of_xml(file, content)?,
        Some(b'{') => product::planet_tags(content),
        _ if product::is_geoeye(content) => product::geoeye_tags(content),
        _ if maxar::is_pvl(content) => maxar::imd_tags(content),
        _ => ViewTags::default(),
    })
}

/// Text of a regular file of at most [`MAX_BYTES`]. Bytes that are not UTF-8 are accepted, as they occur in comments
/// only.
fn read_text(file: &Path) -> Result<String, FormatError> {
    let unreadable = |cause| FormatError::Unreadable { file: file.into(), cause };
    let bytes = vsi::size(file).map_err(unreadable)?;
    if bytes > MAX_BYTES {
        let size = format!("{bytes} bytes are too many for an RPC");
        return Err(unreadable(std::io::Error::other(size)));
    }
    Ok(decode_text(&vsi::read(file).map_err(unreadable)?))
}

#[cfg(test)]
pub(super) mod tests;
