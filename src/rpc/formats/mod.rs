//! RPC files of every vendor: what a file is shows in its content, not in its name.
//!
//! Read are `_RPC.TXT` text (IKONOS, GeoEye, Planet, SkySat), Maxar's `.XML` and `.RPB`, DIMAP 1, 2 and 3, OSSIM
//! `.geom`, rpcm JSON, the TIFF tag 50844, GDAL's `.aux.xml` and VRT, and whatever else GDAL shows in its RPC
//! domain. Written are text, RPB, JSON and, through GDAL, the tag; writing and reading back gives the same bits.
//! Pixels count from the centre of the first, as in RPC00B; a reader of another convention converts.

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
use std::path::{Path, PathBuf};

/// A sidecar larger than this is no RPC.
const MAX_BYTES: u64 = 64 << 20;

/// Two models of one image that differ by less, in pixels, are the same, rounded differently.
pub const SAME_PX: f64 = 0.1;

/// Why a file gives no RPC.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum FormatError {
    /// A number that every RPC has is not there.
    #[error("`{file}`: RPC field `{field}` is missing (found {found} of {of} fields)", of = keys::REQUIRED)]
    #[diagnostic(help(
        "the RPC is incomplete: ask for the original metadata; `satgs info` lists what was read"
    ))]
    Missing {
        /// The file.
        file: PathBuf,
        /// The first field that is missing, in the file's own names.
        field: String,
        /// Numbers found.
        found: usize,
    },
    /// A polynomial with more or fewer terms than it must have.
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
    /// Text where a number should be.
    #[error("`{file}`: `{field}` is `{text}`, a number is expected")]
    #[diagnostic(help(
        "numbers have a decimal point, no comma, and at most a unit behind: `-0.0703 degrees`"
    ))]
    NotANumber {
        /// The file.
        file: PathBuf,
        /// The field.
        field: String,
        /// What was found.
        text: String,
    },
    /// Numbers that make no camera.
    #[error("`{file}`: {source}")]
    #[diagnostic(help("{hint}"))]
    Invalid {
        /// The file.
        file: PathBuf,
        /// Which number, and why.
        source: RpcError,
        /// What to do about it.
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
    /// The older form, whose terms come in another order.
    #[error("`{file}` holds an RPC00A, satgs reads RPC00B")]
    #[diagnostic(help(
        "the two order their terms differently; ask for RPC00B, or convert the image with a tool that reads RPC00A"
    ))]
    Rpc00a {
        /// The file.
        file: PathBuf,
    },
    /// A field that is there twice with two values.
    #[error("`{file}`: `{field}` is given twice, as {first} and as {second}")]
    #[diagnostic(help("which is right only its maker knows: remove the other"))]
    Twice {
        /// The file.
        file: PathBuf,
        /// The field.
        field: String,
        /// The value that comes first.
        first: f64,
        /// The other.
        second: f64,
    },
    /// None of the formats.
    #[error("`{file}` is no RPC file that satgs reads{what}")]
    #[diagnostic(help(
        "read are `_RPC.TXT` text, Maxar .RPB and .XML, DIMAP, OSSIM .geom, rpcm JSON, and what GDAL shows as RPC"
    ))]
    Unrecognised {
        /// The file.
        file: PathBuf,
        /// What it looks like, if that is known.
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

/// A view's metadata that some files hold beside the camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewTags {
    /// File name of the image.
    pub image: Option<String>,
    /// Columns and rows of the image, of all its tiles together.
    pub size: Option<(usize, usize)>,
    /// Sun's azimuth clockwise from north and elevation, degrees.
    pub sun_deg: Option<(f64, f64)>,
    /// Acquisition time, ISO 8601.
    pub acquired: Option<String>,
    /// Lowest and highest ellipsoidal height on the ground, metres.
    pub height_range: Option<(f64, f64)>,
    /// Mean ground sampling distance, metres.
    pub gsd_m: Option<f64>,
    /// Angle of the view from the vertical at the ground (incidence), degrees.
    pub off_nadir_deg: Option<f64>,
    /// How the image is cut into files, if it is.
    pub tiles: Option<Tiles>,
    /// Value of pixels that are no image.
    pub nodata: Option<f64>,
}

/// A product that is cut into files `…_R1C1`, `…_R1C2`, ….
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiles {
    /// Columns from one tile to the next.
    pub width: usize,
    /// Rows from one tile to the next.
    pub height: usize,
    /// Tiles side by side.
    pub across: usize,
    /// Tiles one below the other.
    pub down: usize,
}

impl ViewTags {
    /// Takes from `other` what these tags do not tell.
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

/// What an RPC file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct RpcFile {
    /// The camera.
    pub rpc: Rpc,
    /// What else the file says.
    pub tags: ViewTags,
    /// The format, as a user would name it.
    pub format: &'static str,
    /// What is odd about it, one sentence a cause.
    pub warnings: Vec<String>,
}

impl RpcFile {
    /// A camera of which nothing else is known.
    #[must_use]
    pub fn new(rpc: Rpc, format: &'static str) -> Self {
        Self { rpc, tags: ViewTags::default(), format, warnings: Vec::new() }
    }
}

/// Reads a sidecar in any format, recognised by its content.
///
/// # Errors
/// [`FormatError`], naming file and field.
pub fn read(file: &Path) -> Result<RpcFile, FormatError> {
    parse(file, &read_text(file)?)
}

/// As [`read`], of content in memory; `file` is for messages.
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

/// Reads what a metadata file (`.IMD`, `.XML`, `DIM_*.XML`) says about an image, camera or not.
///
/// # Errors
/// [`FormatError`] when the file cannot be read or is broken XML.
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

/// Text of a regular file of reasonable size; bytes that are no UTF-8 do not matter, they are comments.
fn read_text(file: &Path) -> Result<String, FormatError> {
    let unreadable = |cause| FormatError::Unreadable { file: file.into(), cause };
    let metadata = std::fs::metadata(file).map_err(unreadable)?;
    if !metadata.is_file() {
        return Err(unreadable(std::io::Error::other("it is not a regular file")));
    }
    if metadata.len() > MAX_BYTES {
        let size = format!("{} bytes are too many for an RPC", metadata.len());
        return Err(unreadable(std::io::Error::other(size)));
    }
    let bytes = std::fs::read(file).map_err(unreadable)?;
    Ok(decode(&bytes))
}

/// Text as editors and Windows write it: UTF-16 by its byte-order mark, else UTF-8 with or without one.
///
/// What is neither becomes replacement characters.
#[must_use]
pub fn decode(bytes: &[u8]) -> String {
    let utf16 = |rest: &[u8], number: fn([u8; 2]) -> u16| {
        let words: Vec<u16> = rest.chunks_exact(2).map(|pair| number([pair[0], pair[1]])).collect();
        String::from_utf16_lossy(&words)
    };
    match bytes {
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        [0xef, 0xbb, 0xbf, rest @ ..] => String::from_utf8_lossy(rest).into_owned(),
        _ => String::from_utf8_lossy(bytes).into_owned(),
    }
}

#[cfg(test)]
pub(super) mod tests;
