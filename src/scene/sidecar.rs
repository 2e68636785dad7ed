//! Sidecar files of images, found by the naming conventions of vendors and GDAL.

use super::SceneError;
use super::files::{file_name, stem};
use crate::io::vsi;
use crate::rpc::Rpc;
use crate::rpc::formats::{self, ViewTags};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Suffixes of the RPC files of the image NAME, in order of preference.
const CAMERAS: [&str; 11] = [
    "_rpc.txt",
    "_rpc_org.txt",
    ".rpc.txt",
    ".rpc",
    ".rpb",
    "_rpc.xml",
    ".xml",
    ".geom",
    "_rpc.json",
    ".json",
    ".txt",
];
/// Suffixes of the files of the image NAME that state sun and date.
const METADATA: [&str; 2] = [".imd", ".xml"];
/// Suffixes of such files whose names begin as NAME does (Planet, GeoEye).
const ITEM_METADATA: [&str; 2] = ["_metadata.json", "_metadata.txt"];
/// Suffixes of image names of Airbus for the bands in the image.
const AIRBUS_BANDS: [&str; 8] = ["_p", "_ms", "_pms", "_rgb", "_ned", "_ms-fs", "_pms-fs", "_ms-n"];

/// Number of bytes at the beginning of a file in which field names of an RPC are searched.
const SEARCHED_BYTES: u64 = 16 << 20;

/// Order in which RPCs of an image are preferred, as text for `satgs info`.
pub const ORDER: &str = "NAME_RPC.TXT, NAME.RPB, NAME.XML or RPC_*.XML (Maxar, DIMAP), NAME.geom, NAME.json, \
                         NAME.txt, .aux.xml, then the RPC inside the image (of a VRT first); one that is for another \
                         image is passed over";

/// Sidecar files of one image.
#[derive(Clone, Debug, Default)]
pub(super) struct Sidecars {
    /// RPC files in order of preference.
    pub cameras: Vec<PathBuf>,
    /// Those of them that belong to the product of which the image is a tile.
    pub of_product: Vec<PathBuf>,
    /// Files that state sun, date and size.
    pub metadata: Vec<PathBuf>,
    /// Such files of the product of which the image is a tile.
    pub product_metadata: Vec<PathBuf>,
    /// Maxar's `.TIL` file, which states the positions of the tiles of a product.
    pub til: Option<PathBuf>,
    /// Whether the name of the image is that of a tile.
    pub is_tile_by_name: bool,
    /// The tile of a product that the image is, if its RPC files are those of the whole product.
    pub tile: Option<Tile>,
    /// Whether the user chose the RPC file, so that the RPC in the image is ignored.
    pub is_chosen: bool,
}

/// Row and column of a tile, counted from 1, as in `…_R1C2`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tile {
    row: usize,
    col: usize,
}

impl Sidecars {
    /// Finds the sidecar files of `image` in a listing of its folder.
    pub(super) fn of(image: &Path, listing: &[PathBuf]) -> Self {
        let name = stem(image).to_lowercase();
        let file = file_name(image).to_lowercase();
        let (product, tile) = split_tile(&name);
        let mut own = by_name(&name, &CAMERAS, listing);
        own.extend(exactly(&format!("{file}.rpc"), listing));
        own.extend(exactly(&format!("rpc_{name}.txt"), listing));
        own.retain(|p| is_about_rpc(p));
        let mut of_product = Vec::new();
        let mut metadata = by_name(&name, &METADATA, listing);
        metadata.extend(of_item(&name, listing));
        let (mut product_metadata, mut til) = (Vec::new(), None);
        if tile.is_some() {
            of_product = by_name(&product, &CAMERAS, listing);
            product_metadata = by_name(&product, &METADATA, listing);
            til = exactly(&format!("{product}.til"), listing).into_iter().next();
        }
        if let Some(base) = product.strip_prefix("img") {
            let base = base.trim_start_matches('_');
            let short = AIRBUS_BANDS.iter().find_map(|b| base.strip_suffix(b));
            for base in std::iter::once(base).chain(short) {
                of_product.extend(exactly(&format!("rpc_{base}.xml"), listing));
                product_metadata.extend(exactly(&format!("dim_{base}.xml"), listing));
            }
            if base.is_empty() {
                // In DIMAP 1 every image is named IMG_R1C1, and its metadata file holds the RPC too.
                of_product.extend(
                    listing.iter().filter(|p| stem(p).to_lowercase().starts_with("phrdimap")).cloned(),
                );
            }
        }
        of_product.retain(|p| is_about_rpc(p) && !own.contains(p));
        let auxiliary = exactly(&format!("{file}.aux.xml"), listing).into_iter().filter(|p| is_about_rpc(p));
        let cameras = own.into_iter().chain(of_product.iter().cloned()).chain(auxiliary).collect();
        let is_tile_by_name = tile.is_some();
        let tile = if of_product.is_empty() { None } else { tile };
        Self { cameras, of_product, metadata, product_metadata, til, is_tile_by_name, tile, is_chosen: false }
    }

    /// The sidecar files of `image`, with an RPC file chosen by the user.
    pub(super) fn with_camera(camera: PathBuf, image: &Path, listing: &[PathBuf]) -> Self {
        let of_product = Vec::new();
        Self { cameras: vec![camera], of_product, tile: None, is_chosen: true, ..Self::of(image, listing) }
    }
}

impl Tile {
    /// The camera of this tile, derived from that of the whole product.
    pub(super) fn camera(
        self,
        image: &Path,
        whole: &Rpc,
        tags: &ViewTags,
        til: Option<&Path>,
        warnings: &mut Vec<String>,
    ) -> Result<Rpc, SceneError> {
        let Self { row, col } = self;
        let listed = til.map(|til| formats::til_offset(til, &file_name(image))).transpose()?.flatten();
        if let Some((first_col, first_row)) = listed {
            return Ok(whole.shifted(-first_col, -first_row));
        }
        let refused = |reason| Err(SceneError::TileOfMosaic { path: image.into(), row, col, reason });
        let Some(tiles) = tags.tiles else {
            let alone = (row, col) == (1, 1);
            return if alone {
                Ok(whole.clone())
            } else {
                refused("no file beside it states the size of the tiles".into())
            };
        };
        if col > tiles.across || row > tiles.down {
            return refused(format!("its product has {} x {} tiles", tiles.down, tiles.across));
        }
        let count = tiles.across.saturating_mul(tiles.down);
        if count > 1 {
            warnings.push(format!(
                "`{}` is one of {count} tiles of its product; GDAL opens the product's DIM_*.XML as one image",
                image.display()
            ));
        }
        let before = |tile: usize, step: usize| (tile - 1) as f64 * step as f64;
        Ok(whole.shifted(-before(col, tiles.width), -before(row, tiles.height)))
    }
}

/// Names that the sidecar files of an image usually have, for folders that cannot be listed.
pub(super) fn likely_names(image: &Path) -> Vec<String> {
    let (name, file) = (stem(image), file_name(image));
    let product = split_tile(&name.to_lowercase()).0;
    let mut bases = vec![name.clone()];
    if product.len() < name.len() {
        // `_R1C2` is cut out of the name as it is written; in lower case only the length is known.
        let at = product.bytes().zip(name.to_lowercase().bytes()).take_while(|(a, b)| a == b).count();
        let rest = name.len() - (product.len() - at);
        bases.extend(name.get(..at).zip(name.get(rest..)).map(|(start, end)| format!("{start}{end}")));
    }
    let mut names: Vec<String> =
        [".aux.xml", ".rpc", ".msk", ".ovr"].map(|end| format!("{file}{end}")).into();
    names.push(format!("rpc_{name}.txt"));
    for base in &bases {
        for ending in CAMERAS.iter().chain(&METADATA).chain(&ITEM_METADATA).chain(&[".til"]) {
            let (start, extension) = ending.split_once('.').unwrap_or((ending, ""));
            let upper = start.to_uppercase();
            names.extend([
                format!("{base}{ending}"),
                format!("{base}{upper}.{extension}"),
                format!("{base}{upper}.{}", extension.to_uppercase()),
            ]);
        }
        if let Some(scene) = base.strip_prefix("IMG_") {
            let short = AIRBUS_BANDS.iter().find_map(|b| scene.strip_suffix(&b.to_uppercase()));
            for scene in std::iter::once(scene).chain(short) {
                names.extend(["RPC", "DIM"].map(|kind| format!("{kind}_{scene}.XML")));
            }
        }
    }
    names.sort();
    names.dedup();
    names
}

/// Splits `_R1C2` off the name of a tile; `name` is in lower case.
fn split_tile(name: &str) -> (String, Option<Tile>) {
    for (at, _) in name.match_indices("_r") {
        let rest = &name[at + 2..];
        let Some((row, after)) = digits(rest) else { continue };
        let Some((col, after)) = after.strip_prefix('c').and_then(digits) else { continue };
        if row > 0 && col > 0 {
            return (format!("{}{after}", &name[..at]), Some(Tile { row, col }));
        }
    }
    (name.to_owned(), None)
}

/// The number at the beginning of a text, and the rest of the text.
fn digits(text: &str) -> Option<(usize, &str)> {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    Some((text[..end].parse().ok()?, &text[end..]))
}

/// Metadata files of the item to which an image belongs: the name of the image begins with theirs. `name` is in lower
/// case.
fn of_item<'a>(name: &'a str, listing: &'a [PathBuf]) -> impl Iterator<Item = PathBuf> + 'a {
    let is_its = move |path: &&PathBuf| {
        let file = file_name(path).to_lowercase();
        let item = ITEM_METADATA.iter().find_map(|ending| file.strip_suffix(ending));
        item.is_some_and(|item| !item.is_empty() && name.starts_with(item))
    };
    listing.iter().filter(is_its).cloned()
}

/// Files of a listing that are named `name` with one of some suffixes, in the order of the suffixes; `name` is in lower
/// case.
pub(super) fn by_name(name: &str, endings: &[&str], listing: &[PathBuf]) -> Vec<PathBuf> {
    endings.iter().flat_map(|ending| exactly(&format!("{name}{ending}"), listing)).collect()
}

/// The RPC file of the image `name` in a folder of RPC files.
pub(super) fn camera_of(name: &str, listing: &[PathBuf]) -> Option<PathBuf> {
    by_name(&name.to_lowercase(), &CAMERAS, listing).into_iter().next()
}

fn exactly(wanted: &str, listing: &[PathBuf]) -> Vec<PathBuf> {
    listing.iter().filter(|p| file_name(p).to_lowercase() == wanted).cloned().collect()
}

/// Whether a file holds an RPC. Files with general suffixes (`NAME.txt`, `NAME.xml`) must contain field names of an RPC.
fn is_about_rpc(path: &Path) -> bool {
    let name = file_name(path).to_lowercase();
    let says_so = |ending: &&&str| ending.contains("rp") || ending.contains("geom");
    if name.starts_with("rpc_") || CAMERAS.iter().filter(says_so).any(|ending| name.ends_with(ending)) {
        return true;
    }
    let mut bytes = Vec::new();
    let Ok(_) = vsi::open(path).and_then(|f| f.take(SEARCHED_BYTES).read_to_end(&mut bytes)) else {
        return true;
    };
    let text = String::from_utf8_lossy(&bytes);
    let words = ["line_", "LINE_", "samp_", "SAMP_", "row_num", "<RPB", "Global_RFM"];
    words.iter().any(|word| text.contains(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(image: &str, listing: &[&str]) -> (Vec<String>, Vec<String>, Option<Tile>) {
        let folder = tempfile::tempdir().unwrap();
        let paths: Vec<PathBuf> = listing.iter().map(|n| folder.path().join(n)).collect();
        paths.iter().for_each(|p| std::fs::write(p, "<RPB/>").unwrap());
        let s = Sidecars::of(&folder.path().join(image), &paths);
        let names = |v: Vec<PathBuf>| -> Vec<String> {
            v.iter().map(|p| p.file_name().unwrap().to_string_lossy().into_owned()).collect()
        };
        let metadata = s.metadata.into_iter().chain(s.product_metadata).collect();
        (names(s.cameras), names(metadata), s.tile)
    }

    #[test]
    fn sidecar_files_of_every_vendor_are_found_in_order() {
        let maxar = ["a.tif", "A.XML", "A.IMD", "a.rpb", "a_RPC.TXT", "ab.rpb", "a.tif.aux.xml"];
        let (cameras, metadata, tile) = found("a.tif", &maxar);
        assert_eq!(cameras, ["a_RPC.TXT", "a.rpb", "A.XML", "a.tif.aux.xml"]);
        assert_eq!(metadata, ["A.IMD", "A.XML"]);
        assert_eq!(tile, None);
        let airbus = ["RPC_PHR1B_X-001.XML", "DIM_PHR1B_X-001.XML", "RPC_PHR1B_Y-001.XML"];
        let (cameras, metadata, tile) = found("IMG_PHR1B_X-001_R2C1.JP2", &airbus);
        assert_eq!((cameras, metadata), (vec![airbus[0].to_owned()], vec![airbus[1].to_owned()]));
        assert_eq!(tile, Some(Tile { row: 2, col: 1 }));
        let neo = ["RPC_PNEO3_X_F_1.XML", "DIM_PNEO3_X_F_1.XML"];
        let (cameras, metadata, _) = found("IMG_PNEO3_X_F_1_P_R1C1.JP2", &neo);
        assert_eq!((cameras, metadata), (vec![neo[0].to_owned()], vec![neo[1].to_owned()]));
        let old = found("IMG_R1C1.JP2", &["PHRDIMAP_P1BP--2018.XML"]);
        assert_eq!(old.0, ["PHRDIMAP_P1BP--2018.XML"]);
        let planet = ["20230717_x_metadata.json", "20230718_x_metadata.json"];
        let (_, metadata, _) = found("20230717_X_basic_pan_dn.tif", &planet);
        assert_eq!(metadata, [planet[0]]);
        let strip = found("10NOV-M1BS_R1C2-0523.TIF", &["10NOV-M1BS-0523.XML"]);
        assert_eq!((strip.0.len(), strip.2), (1, Some(Tile { row: 1, col: 2 })));
    }

    #[test]
    fn the_usual_names_of_sidecar_files_are_likely() {
        for (image, beside) in [
            ("a.TIF", "a_RPC.TXT"),
            ("a.tif", "a_RPC.json"),
            ("a.tif", "a.RPB"),
            ("a.tif", "a.IMD"),
            ("a.tif", "a.tif.aux.xml"),
            ("10NOV-M1BS_R1C2-0523.TIF", "10NOV-M1BS-0523.XML"),
            ("IMG_PHR1B_X-001_R2C1.JP2", "RPC_PHR1B_X-001.XML"),
            ("IMG_PNEO3_X_F_1_P_R1C1.JP2", "DIM_PNEO3_X_F_1.XML"),
        ] {
            let names = likely_names(Path::new(image));
            assert!(names.iter().any(|n| n == beside), "{image}: {names:?}");
        }
    }

    #[test]
    fn names_that_resemble_tiles_are_not_taken_for_tiles() {
        assert_eq!(split_tile("img_r0c1").1, None);
        assert_eq!(split_tile("a_rc1").1, None);
        assert_eq!(split_tile("a_r1").1, None);
        assert_eq!(split_tile("x_r99999999999999999999c1").1, None);
    }
}
