//! Why a scene cannot be read or used.

use crate::fault::ErrorKind;
use crate::frame::FrameError;
use crate::io::{RasterError, VerticalError};
use crate::rpc::formats::FormatError;
use std::path::PathBuf;

/// Why a scene cannot be read or used.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum SceneError {
    /// The path does not exist, or may not be read.
    #[error("scene `{path}` cannot be read: {cause}")]
    #[diagnostic(help(
        "SCENE is a folder of images with RPCs, or one with `images/` and a folder of JSON files"
    ))]
    Unreadable {
        /// The given path.
        path: PathBuf,
        /// Error of the file system.
        cause: std::io::Error,
    },
    /// The path is a file where a folder is expected.
    #[error("scene `{path}` is a file, a folder is expected{found}")]
    #[diagnostic(help("{next_step}"))]
    NotAFolder {
        /// The path given.
        path: PathBuf,
        /// What it is, as a clause after a colon; empty if that is not known.
        found: String,
        /// What to do about it.
        next_step: String,
    },
    /// The folder holds no images.
    #[error("no images found in `{path}`{found}")]
    #[diagnostic(help("{next_step}"))]
    NoImages {
        /// The folder that was searched.
        path: PathBuf,
        /// What it holds instead, as a clause after a colon; empty for nothing that is known.
        found: String,
        /// What to do about it.
        next_step: String,
    },
    /// No RPC was found for an image.
    #[error("`{path}` has no RPC, neither inside nor beside it{what}")]
    #[diagnostic(help(
        "orthorectified products have no camera: use the sensor (basic, primary, level 1) product, or put NAME_RPC.TXT or NAME.json beside it; `satgs info SCENE` lists each image's RPC"
    ))]
    NoRpc {
        /// The image.
        path: PathBuf,
        /// What the image seems to be, after a semicolon; empty if that is not known.
        what: &'static str,
    },
    /// An orthorectified image comes with the RPC of the sensor image from which it was made.
    #[error(
        "`{path}` is orthorectified: it has a map projection, from which its RPC differs by {distance_px:.0} px"
    )]
    #[diagnostic(help(
        "the RPC belongs to the sensor image: use the sensor (basic, primary, level 1) or ortho-ready product; if this is one and only its map position is approximate, --trust-rpc uses the RPC without this check"
    ))]
    Ortho {
        /// The image.
        path: PathBuf,
        /// Largest distance between the corners or the centre and their projections by the RPC, pixels.
        distance_px: f64,
    },
    /// A NITF chip was not only cropped from the image to which its RPC belongs.
    #[error("`{path}` is a chip of a larger image (ICHIPB), and {reason}")]
    #[diagnostic(help(
        "its RPC belongs to the full image; only chips that were cropped without rotation and resampling can be read: use the full image"
    ))]
    Chip {
        /// The image.
        path: PathBuf,
        /// What was done to it besides cropping, as a clause.
        reason: String,
    },
    /// The resolution of an image is not that of its RPC.
    #[error(
        "`{image}` has {width} x {height} pixels, its RPC ({source_file}) is for an image of about {expected_width:.0} x {expected_height:.0}"
    )]
    #[diagnostic(help(
        "was the image resampled, or is this the RPC of a panchromatic image beside a multispectral one? use the RPC of this image; --trust-rpc uses the RPC without this check"
    ))]
    OtherScale {
        /// The image.
        image: PathBuf,
        /// Where the RPC was found.
        source_file: String,
        /// Columns of the RPC's volume.
        expected_width: f64,
        /// Rows of the RPC's volume.
        expected_height: f64,
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
    },
    /// An image is a tile of a product, and the position of the tile is not known.
    #[error("`{path}` is tile R{row}C{col} of a mosaic, and {reason}")]
    #[diagnostic(help("put the DIM_*.XML of the product beside it, which states the layout of the tiles"))]
    TileOfMosaic {
        /// The image.
        path: PathBuf,
        /// Row of the tile, from 1.
        row: usize,
        /// Column of the tile, from 1.
        col: usize,
        /// What is missing or contradictory, as a clause.
        reason: String,
    },
    /// There are several folders of RPC files, and none was chosen.
    #[error("`{path}` has several folders of RPC files: {}", folders.join(", "))]
    #[diagnostic(help("choose one with --rpcs NAME"))]
    SeveralRpcFolders {
        /// The scene.
        path: PathBuf,
        /// Names of the folders.
        folders: Vec<String>,
    },
    /// The chosen folder of RPC files does not exist.
    #[error("`{path}` has no folder `{asked}` of RPC files")]
    #[diagnostic(help("{}", if folders.is_empty() { "--rpcs is for scenes with `images/` and a folder of JSON files; this scene has none".to_owned() } else { format!("folders of RPC files in this scene: {}", folders.join(", ")) }))]
    NoSuchRpcFolder {
        /// The scene.
        path: PathBuf,
        /// The chosen name.
        asked: String,
        /// Names of the folders of RPC files that exist.
        folders: Vec<String>,
    },
    /// The image of an RPC file is missing.
    #[error("`{rpc}` is for the image `{image}`, which is missing")]
    #[diagnostic(help("put the image there, or remove the RPC file"))]
    NoImageForRpc {
        /// The RPC file.
        rpc: PathBuf,
        /// The expected image.
        image: PathBuf,
    },
    /// The size of an image is not the one that its metadata state.
    #[error(
        "`{rpc}` is for an image of {expected_width} x {expected_height} pixels, `{image}` has {width} x {height}"
    )]
    #[diagnostic(help(
        "an image that was cropped or resampled needs an RPC that was changed with it; --trust-rpc uses the RPC without this check"
    ))]
    OtherSize {
        /// The RPC file.
        rpc: PathBuf,
        /// The image.
        image: PathBuf,
        /// Columns according to the RPC file.
        expected_width: usize,
        /// Rows according to the RPC file.
        expected_height: usize,
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
    },
    /// Two image files have the same content.
    #[error("`{first}` and `{second}` are the same image")]
    #[diagnostic(help("remove one of them: there is no baseline between two copies of an image"))]
    SameImage {
        /// One file.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// Two image files would give views of the same name.
    #[error("`{first}` and `{second}` have the same name")]
    #[diagnostic(help("the name of a view is its file name without the extension: rename one of them"))]
    SameName {
        /// One file.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// `--sun` names a view that does not exist.
    #[error("--sun names the view `{name}`, which does not exist")]
    #[diagnostic(help("the views are {}", names.join(", ")))]
    UnknownView {
        /// The given name.
        name: String,
        /// Names of the views of the scene.
        names: Vec<String>,
    },
    /// The scene has too few views for the requested task.
    #[error("the scene has {found} view{}, at least {needed} are needed", if *found == 1 { "" } else { "s" })]
    #[diagnostic(help(
        "heights are computed from several views of the same ground; `satgs info` lists the views"
    ))]
    TooFewViews {
        /// Number of views in the scene.
        found: usize,
        /// Number of views needed.
        needed: usize,
    },
    /// A view sees ground that no other view sees.
    #[error(
        "views do not share ground: `{view}` ({footprint}) overlaps its nearest view `{nearest}` ({nearest_footprint}) by {percent:.1} %"
    )]
    #[diagnostic(help(
        "are all images of the same place? a cropped image needs an RPC that was shifted with the crop; `satgs info` lists the footprints"
    ))]
    NoSharedGround {
        /// The view.
        view: String,
        /// Extent of its footprint.
        footprint: String,
        /// The view with which it overlaps most.
        nearest: String,
        /// Extent of the footprint of that view.
        nearest_footprint: String,
        /// Overlap in percent of the footprint of the view.
        percent: f64,
    },
    /// The height ranges of the RPCs do not overlap.
    #[error(
        "the RPC of `{view}` covers heights from {low_m:.0} to {high_m:.0} m, those of the other views heights around {usual_m:.0} m"
    )]
    #[diagnostic(help(
        "does this RPC belong to this scene? --height-range LOW,HIGH sets the heights to search"
    ))]
    NoSharedHeights {
        /// The view that differs most.
        view: String,
        /// Lowest height of its RPC, metres.
        low_m: f64,
        /// Highest height of its RPC, metres.
        high_m: f64,
        /// Middle of the height ranges of the other views, metres.
        usual_m: f64,
    },
    /// The heights to search lie far from those for which the RPCs are made.
    #[error(
        "--height-range {low_m},{high_m} lies outside of the heights of the RPCs, {rpc_low_m:.0} to {rpc_high_m:.0} m above the ellipsoid"
    )]
    #[diagnostic(help(
        "give heights above the ellipsoid, not above sea level; without the option the heights of the RPCs are searched, and --dem FILE takes them from an elevation model"
    ))]
    HeightsElsewhere {
        /// Lowest height to search, metres.
        low_m: f64,
        /// Highest height to search, metres.
        high_m: f64,
        /// Lowest height of the RPCs, metres.
        rpc_low_m: f64,
        /// Highest height of the RPCs, metres.
        rpc_high_m: f64,
    },
    /// No ground point can be localised with a camera.
    #[error("the RPC of `{view}` ({source_file}) sees no ground at a height of {height_m} m")]
    #[diagnostic(help(
        "does this RPC belong to this image? a cropped image needs an RPC that was shifted with the crop"
    ))]
    SeesNoGround {
        /// The view.
        view: String,
        /// Where its RPC was found.
        source_file: String,
        /// Ellipsoidal height that was tried, metres.
        height_m: f64,
    },
    /// The area of interest is invalid.
    #[error("area of interest: {reason}")]
    #[diagnostic(help(
        "an area is WEST,SOUTH,EAST,NORTH in degrees, or a GeoJSON file with a polygon in lon/lat"
    ))]
    Area {
        /// What is wrong with it.
        reason: String,
    },
    /// No view sees the area of interest.
    #[error("no view sees the area ({area}); the first sees {footprint}")]
    #[diagnostic(help(
        "{}", if *is_swapped { "longitude and latitude are swapped: --aoi is WEST,SOUTH,EAST,NORTH, and GeoJSON has [longitude, latitude]" } else { "`satgs info` without the area lists the footprints; a cropped image needs an RPC that was shifted with the crop" }
    ))]
    AreaNotSeen {
        /// Whether views see the area once its longitudes and latitudes are exchanged.
        is_swapped: bool,
        /// Extent of the area.
        area: String,
        /// Extent of the footprint of the first view.
        footprint: String,
    },
    /// The vertical reference of an elevation model is unknown.
    #[error("`{path}` does not state a known vertical reference{stated}")]
    #[diagnostic(help(
        "name it: --dem-vertical ellipsoid, EGM84, EGM96 (SRTM), EGM2008 (Copernicus), or the path of a geoid's grid \
         (.gtx, .tif of PROJ)"
    ))]
    VerticalReference {
        /// The elevation model.
        path: PathBuf,
        /// The unknown reference that it states, as a clause after a semicolon; empty if there is none.
        stated: String,
    },
    /// An elevation model has a height that does not occur on Earth.
    #[error(
        "`{path}` has a height of {height_m:.0} m in the area of the scene, which does not occur on Earth"
    )]
    #[diagnostic(help(
        "is it a nodata value? `gdal_edit.py -a_nodata VALUE FILE` declares it; are the heights in another unit?"
    ))]
    DemVoid {
        /// The elevation model.
        path: PathBuf,
        /// The height, metres.
        height_m: f64,
    },
    /// An elevation model does not cover the scene.
    #[error("`{path}` has no heights in the area of the scene")]
    #[diagnostic(help("`satgs info` lists the footprints; the model must be a north-up map"))]
    DemElsewhere {
        /// The elevation model.
        path: PathBuf,
    },
    /// A geoid grid does not cover the scene.
    #[error("the geoid grid does not cover the area of the scene")]
    #[diagnostic(help("the EGM96 and EGM2008 grids in PROJ's data cover the whole Earth"))]
    GeoidElsewhere,
    /// A list of views is invalid.
    #[error("`{path}`: {reason}")]
    #[diagnostic(help(
        "a scene file is TOML with `[[view]]` tables (image, rpc, name, sun = [azimuth, elevation], acquired, mask, test) and `aoi`, or a STAC Item or ItemCollection in JSON"
    ))]
    List {
        /// The list.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The size of a mask is not that of its image.
    #[error("mask `{mask}` is {width} x {height} pixels, its image `{image}` is {of_width} x {of_height}")]
    #[diagnostic(help("a mask has the size of its image, and is 0 at pixels without valid data"))]
    OtherMask {
        /// The mask.
        mask: PathBuf,
        /// Its columns.
        width: usize,
        /// Its rows.
        height: usize,
        /// The image.
        image: PathBuf,
        /// The image's columns.
        of_width: usize,
        /// The image's rows.
        of_height: usize,
    },
    /// An image does not have a requested band.
    #[error("`{image}` has {found} band{}, band {asked} was asked for", if *found == 1 { "" } else { "s" })]
    #[diagnostic(help(
        "--bands counts from 1: three for red, green and blue, or one; `satgs info` lists the bands"
    ))]
    NoBand {
        /// The image.
        image: PathBuf,
        /// Number of bands of the image.
        found: usize,
        /// The requested band, from 1.
        asked: usize,
    },
    /// A requested band is an alpha band.
    #[error("`{image}`: band {asked} is an alpha band and holds no colour")]
    #[diagnostic(help(
        "choose other bands with --bands; pixels where the alpha band is 0 are ignored in any case"
    ))]
    AlphaBand {
        /// The image.
        image: PathBuf,
        /// The requested band, from 1.
        asked: usize,
    },
    /// The pixel values of an image are indices into a colour table.
    #[error("`{image}`: its pixel values are indices into a colour table, which are not intensities")]
    #[diagnostic(help(
        "gdal_translate -expand rgb IN OUT writes the colours; copy the RPC to a file beside OUT"
    ))]
    Palette {
        /// The image.
        image: PathBuf,
    },
    /// Windows of an image are to be read, and the image is stored as strips of whole rows.
    #[error(
        "`{image}` is stored as strips of whole rows: for {needed_gb:.1} GB of pixels, {read_gb:.1} GB would be read{}", if *others == 0 { String::new() } else { format!("; {others} more images are stored so") }
    )]
    #[diagnostic(help(
        "`gdal_translate -of COG IN OUT` writes a tiled copy, of which parts can be read; copy the RPC files beside it"
    ))]
    Striped {
        /// The image with the largest waste.
        image: PathBuf,
        /// Bytes that would be read of it, in units of 10⁹.
        read_gb: f64,
        /// Bytes of its pixels that are needed, in units of 10⁹.
        needed_gb: f64,
        /// Number of other images that are stored so.
        others: usize,
    },
    /// An RPC file cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Rpc(#[from] FormatError),
    /// An image cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Image(#[from] RasterError),
    /// The vertical reference of heights cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Geoid(#[from] VerticalError),
    /// The place cannot be mapped.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Place(#[from] FrameError),
}

impl SceneError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Image(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}
