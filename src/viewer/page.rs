//! The page: its layers, their files, and the HTML around them.

use super::{CameraMark, LiveState, ViewerError};
use crate::frame::{SiteBox, SiteGrid};
use crate::io::escape_xml;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt::Write;
use std::path::PathBuf;

/// Largest size of a page in one file, MB. Texts of Chromium are at most 512 MB long.
const LARGEST_PAGE_MB: u64 = 500;

/// The parts of the page that are the same for every run.
const MARKUP: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/page.css");
/// The page's program: one script of its modules.
pub(super) const PROGRAM: &str = concat!(
    include_str!("page/page.js"),
    include_str!("page/pick.js"),
    include_str!("page/heights.js"),
    include_str!("page/profile.js"),
    include_str!("page/detail.js"),
    include_str!("page/live.js"),
    include_str!("page/swipe.js"),
    "begin();\n",
);
const LOADER: &str = include_str!("page/loader.js");
/// three.js and Spark as one script, packed with gzip, with their licences.
pub(super) const LIBRARIES: &[u8] = include_bytes!("page/dist/libraries.js.gz");
const LICENSES: &str = include_str!("page/dist/LICENSES.txt");

/// A file that a layer is read from.
#[derive(Clone, Debug, PartialEq)]
pub struct PageFile {
    /// Its name, of letters, digits, dots and hyphens.
    pub name: Cow<'static, str>,
    /// Its content.
    pub content: PageContent,
}

impl PageFile {
    /// A file with this content.
    #[must_use]
    pub fn new(name: &'static str, bytes: Vec<u8>) -> Self {
        Self { name: name.into(), content: PageContent::Bytes(bytes) }
    }
}

/// The content of a file of the page.
#[derive(Clone, Debug, PartialEq)]
pub enum PageContent {
    /// These bytes.
    Bytes(Vec<u8>),
    /// That of a file on disk.
    File(PathBuf),
}

impl PageContent {
    /// Number of bytes.
    fn len(&self) -> u64 {
        match self {
            Self::Bytes(bytes) => bytes.len() as u64,
            Self::File(path) => path.metadata().map_or(0, |m| m.len()),
        }
    }

    /// The bytes.
    ///
    /// # Errors
    /// The error of the file system.
    pub(super) fn read(&self) -> std::io::Result<Cow<'_, [u8]>> {
        Ok(match self {
            Self::Bytes(bytes) => Cow::Borrowed(bytes),
            Self::File(path) => Cow::Owned(std::fs::read(path)?),
        })
    }
}

/// What a layer consists of; coordinates are in the site frame, metres.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum PageLayer {
    /// Gaussian splats.
    Splats {
        /// PLY files of 3DGS, from coarse to fine: the more of them, the more detail.
        files: Vec<Cow<'static, str>>,
        /// Number of splats of all files.
        count: usize,
    },
    /// A surface model in relief.
    Relief {
        /// Altitudes of the cells as f32, row by row from the north-west; NaN where there is none.
        file: &'static str,
        /// A PNG of its colours.
        texture: Option<&'static str>,
        /// The number of views that see each cell, a byte each, 255 where that is not known.
        views: Option<&'static str>,
        /// Number of columns.
        columns: usize,
        /// Number of rows.
        rows: usize,
        /// Western edge.
        west: f64,
        /// Northern edge.
        north: f64,
        /// Side of a cell.
        cell: f64,
    },
    /// A mesh of triangles.
    Mesh {
        /// A PLY file with z up, or a GLB file with y up.
        file: &'static str,
        /// What is added to its coordinates east, north and up.
        offset: [f64; 3],
    },
    /// Points.
    Points {
        /// East, north and up of all points as f32, then red, green and blue of all points as bytes.
        file: &'static str,
        /// Number of points.
        count: usize,
    },
    /// Cameras.
    Cameras {
        /// One entry a view.
        views: Vec<CameraMark>,
    },
}

/// A layer with its line in the list of layers.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ShownLayer {
    /// What it consists of.
    #[serde(flatten)]
    pub layer: PageLayer,
    /// Its name in the list.
    pub label: &'static str,
    /// A number beside its name.
    pub note: String,
    /// Whether it is shown at the start.
    pub is_shown: bool,
}

/// What a page looks at: a ball around a place, in the site frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PageScope {
    /// Its middle.
    pub middle: [f64; 3],
    /// Its radius.
    pub radius: f64,
    /// The upward direction.
    pub up: [f64; 3],
}

impl PageScope {
    /// The area of a site, whose ground is about at the site's origin.
    #[must_use]
    pub fn of_area((west, south, east, north): SiteBox) -> Self {
        let middle = [0.5 * (west + east), 0.5 * (south + north), 0.0];
        Self { middle, radius: 0.5 * (east - west).hypot(north - south), up: [0.0, 0.0, 1.0] }
    }
}

/// The run that a page compares with.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Comparison {
    /// Its title.
    pub(super) title: String,
    /// Its origin in the frame of the first run, metres.
    pub(super) offset: [f64; 3],
    /// What its files' names begin with.
    pub(super) prefix: &'static str,
    /// Its layers.
    pub(super) layers: Vec<ShownLayer>,
}

/// A page that shows a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ViewerPage {
    /// The title.
    pub title: String,
    /// Map coordinates of the site's origin: easting, northing, ellipsoidal height in metres; zero without a map.
    pub(super) origin: [f64; 3],
    /// What map coordinates refer to; empty without a map.
    pub(super) frame: String,
    /// Whether positions are on the map; otherwise they have no unit.
    is_on_map: bool,
    /// What is looked at.
    #[serde(flatten)]
    scope: PageScope,
    /// The layers in the order of the list.
    pub layers: Vec<ShownLayer>,
    /// The run that is compared with.
    pub(super) other: Option<Comparison>,
    /// How far the training is, if it is watched.
    pub live: Option<LiveState>,
    /// The files of the layers.
    #[serde(skip)]
    pub files: Vec<PageFile>,
}

impl ViewerPage {
    /// A page without layers, of a site or, without one, in a frame that is not on the map.
    #[must_use]
    pub fn new(title: String, site: Option<&SiteGrid>, scope: PageScope) -> Self {
        let frame = |site: &SiteGrid| format!("EPSG:{}, height above the WGS 84 ellipsoid", site.epsg);
        Self {
            title,
            origin: site.map_or([0.0; 3], |site| site.origin.xyz()),
            frame: site.map_or_else(String::new, frame),
            is_on_map: site.is_some(),
            scope,
            layers: Vec::new(),
            other: None,
            live: None,
            files: Vec::new(),
        }
    }

    /// The page as one HTML file, which opens without a network connection.
    ///
    /// # Errors
    /// [`ViewerError::TooLarge`], [`ViewerError::Unreadable`].
    pub fn html(&self) -> Result<String, ViewerError> {
        let bytes: u64 = self.files.iter().map(|f| f.content.len()).sum();
        let megabytes = bytes / 3 * 4 / 1_000_000;
        if megabytes > LARGEST_PAGE_MB {
            return Err(ViewerError::TooLarge { megabytes, limit: LARGEST_PAGE_MB });
        }
        let mut scripts = String::with_capacity(bytes as usize / 3 * 4 + (2 << 20));
        let mut add = |name: &str, bytes: &[u8]| {
            let _ = write!(scripts, "<script type=\"text/plain\" id=\"file:{name}\">");
            STANDARD.encode_string(bytes, &mut scripts);
            scripts.push_str("</script>\n");
        };
        for PageFile { name, content } in &self.files {
            let unreadable = |cause| ViewerError::Unreadable { name: name.to_string(), cause };
            add(name, &content.read().map_err(unreadable)?);
        }
        add("libraries.js.gz", LIBRARIES);
        let _ = write!(
            scripts,
            "<script type=\"text/plain\" id=\"program\">\n{PROGRAM}</script>\n<script>\n{LOADER}</script>\n"
        );
        Ok(self.with_scripts(&scripts))
    }

    /// The page that a server sends; it asks the server for the files.
    #[must_use]
    pub(super) fn index(&self) -> String {
        self.with_scripts("<script src=\"libraries.js\"></script>\n<script src=\"page.js\"></script>\n")
    }

    /// What the page shows, as JSON.
    #[must_use]
    pub(super) fn run(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    fn with_scripts(&self, scripts: &str) -> String {
        let title = escape_xml(&self.title);
        // A text with `</script>` in it would end the element.
        let run = self.run().replace('<', "\\u003c");
        format!(
            "<!doctype html>\n<!--\n{LICENSES}-->\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width\">\n<link rel=\"icon\" href=\"data:,\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{MARKUP}\
             <script type=\"application/json\" id=\"run\">{run}</script>\n{scripts}</body>\n</html>\n"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Point;

    fn page(title: &str) -> ViewerPage {
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.125, 3_357_611.5, -20.25) };
        let mut page = ViewerPage::new(title.into(), Some(&site), PageScope::of_area((-1.0, -2.0, 3.0, 4.0)));
        let layer = PageLayer::Points { file: "points.bin", count: 0 };
        page.layers.push(ShownLayer { layer, label: "Points", note: "0".into(), is_shown: false });
        page.files.push(PageFile::new("points.bin", vec![1, 2, 3]));
        page
    }

    #[test]
    fn a_page_in_one_file_asks_for_nothing_else() {
        let html = page("run").html().unwrap();
        assert!(html.contains("id=\"file:points.bin\">AQID</script>"));
        for outside in ["src=\"", "http-equiv", "@import", "url("] {
            assert!(!html.contains(outside), "{outside}");
        }
    }

    #[test]
    fn names_cannot_end_an_element_of_the_page() {
        let html = page("</script><b>&\"").index();
        assert!(!html.contains("</script><b>"), "{html}");
        assert!(html.contains("\\u003c/script>\\u003cb>") || html.contains("\\u003c/script\\u003e"));
        assert!(html.contains("436211.125") && html.contains("EPSG:32617"));
    }

    #[test]
    fn the_program_can_stand_inside_of_a_script_element() {
        for text in [PROGRAM, LOADER] {
            assert!(!text.contains("</script") && !text.contains("<!--"));
        }
    }
}
