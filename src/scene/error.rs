//! Why a scene cannot be read or used.

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
    /// A file where a folder is expected.
    #[error("scene `{path}` is a file, a folder is expected")]
    #[diagnostic(help(
        "give the folder that holds the images, or a list of views: TOML, STAC JSON (`satgs info --help`)"
    ))]
    NotAFolder {
        /// The path given.
        path: PathBuf,
    },
    /// A folder without images.
    #[error("no images found in `{path}`")]
    #[diagnostic(help(
        "images end in .tif, .tiff, .ntf, .nitf, .nsf, .jp2, .j2k or .vrt; sub-folders other than `images/` are not searched"
    ))]
    NoImages {
        /// The folder searched.
        path: PathBuf,
    },
    /// An image without a camera.
    #[error("`{path}` has no RPC, neither inside nor beside it{what}")]
    #[diagnostic(help(
        "orthorectified products have lost their camera: take the sensor (basic, primary, level 1) product, or put NAME_RPC.TXT or NAME.json beside it; `satgs info SCENE` lists each image's RPC"
    ))]
    NoRpc {
        /// The image.
        path: PathBuf,
        /// What it looks like instead.
        what: &'static str,
    },
    /// A map-projected image with the RPC of the image it was made from.
    #[error(
        "`{path}` is orthorectified: it has a map projection, and its RPC sees that place {distance_px:.0} px away"
    )]
    #[diagnostic(help(
        "an RPC belongs to the sensor image: take the sensor (basic, primary, level 1) or ortho-ready product; if it is one, and only its place on the map is rough, --trust-rpc takes the RPC as it is"
    ))]
    Ortho {
        /// The image.
        path: PathBuf,
        /// Distance between a corner or the centre and where its RPC sees it, pixels.
        distance_px: f64,
    },
    /// A NITF chip that is more than a part of the image for which its RPC is.
    #[error("`{path}` is a chip of a larger image (ICHIPB), and {reason}")]
    #[diagnostic(help(
        "its RPC is for the full image; only chips that are cut out without turning or resampling are read: take the full image"
    ))]
    Chip {
        /// The image.
        path: PathBuf,
        /// What makes it more than a cut.
        reason: String,
    },
    /// An image of another resolution than its RPC.
    #[error(
        "`{image}` has {width} x {height} pixels, its RPC ({source_file}) is for an image of about {told_width:.0} x {told_height:.0}"
    )]
    #[diagnostic(help(
        "was the image resampled, or is this the RPC of a panchromatic image beside a multispectral one? `satgs rpc convert` writes other forms, no other scales: take the RPC of this image; --trust-rpc takes it as it is"
    ))]
    OtherScale {
        /// The image.
        image: PathBuf,
        /// Where the RPC was found.
        source_file: String,
        /// Columns of the RPC's volume.
        told_width: f64,
        /// Rows of the RPC's volume.
        told_height: f64,
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
    },
    /// A part of a product, without the file that says which.
    #[error("`{path}` is tile R{row}C{col} of a mosaic, and {reason}")]
    #[diagnostic(help("put the product's own DIM_*.XML beside it: it tells how the product is cut"))]
    TileOfMosaic {
        /// The image.
        path: PathBuf,
        /// Row of the tile, from 1.
        row: usize,
        /// Column of the tile, from 1.
        col: usize,
        /// What is not known of it.
        reason: String,
    },
    /// Several folders of JSON files and none chosen.
    #[error("`{path}` has several folders of RPC files: {}", folders.join(", "))]
    #[diagnostic(help("choose one with --rpcs NAME"))]
    SeveralRpcFolders {
        /// The scene.
        path: PathBuf,
        /// Their names.
        folders: Vec<String>,
    },
    /// A folder of RPC files that is not there.
    #[error("`{path}` has no folder `{asked}` of RPC files")]
    #[diagnostic(help("{}", if folders.is_empty() { "--rpcs is for scenes with `images/` and a folder of JSON files; this has none".to_owned() } else { format!("there is {}", folders.join(", ")) }))]
    NoSuchRpcFolder {
        /// The scene.
        path: PathBuf,
        /// What was asked for.
        asked: String,
        /// What there is.
        folders: Vec<String>,
    },
    /// An RPC file whose image is not there.
    #[error("`{rpc}` is for the image `{image}`, which is missing")]
    #[diagnostic(help("put the image there, or remove the RPC file"))]
    NoImageForRpc {
        /// The RPC file.
        rpc: PathBuf,
        /// The image expected.
        image: PathBuf,
    },
    /// An image of another size than its metadata say.
    #[error(
        "`{rpc}` is for an image of {told_width} x {told_height} pixels, `{image}` has {width} x {height}"
    )]
    #[diagnostic(help(
        "an image that was cropped or resampled needs an RPC that was changed with it; --trust-rpc takes it as it is"
    ))]
    OtherSize {
        /// The RPC file.
        rpc: PathBuf,
        /// The image.
        image: PathBuf,
        /// Columns according to the RPC file.
        told_width: usize,
        /// Rows according to the RPC file.
        told_height: usize,
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
    },
    /// Two files with the same content.
    #[error("`{first}` and `{second}` are the same image")]
    #[diagnostic(help("remove one of them: a view without a baseline only pretends to be one more"))]
    SameImage {
        /// One file.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// Two files that would be views of the same name.
    #[error("`{first}` and `{second}` have the same name")]
    #[diagnostic(help("views are known by their file names without extension: rename one"))]
    SameName {
        /// One file.
        first: PathBuf,
        /// The other.
        second: PathBuf,
    },
    /// `--sun` for a view that does not exist.
    #[error("there is no view `{name}` to give a sun")]
    #[diagnostic(help("the views are {}", names.join(", ")))]
    UnknownView {
        /// The name given.
        name: String,
        /// The views there are.
        names: Vec<String>,
    },
    /// Too few views for what is asked.
    #[error("the scene has {found} view{}, at least {needed} are needed", if *found == 1 { "" } else { "s" })]
    #[diagnostic(help(
        "heights come from seeing the same ground from different places; `satgs info` lists the views"
    ))]
    TooFewViews {
        /// Views in the scene.
        found: usize,
        /// Views needed.
        needed: usize,
    },
    /// A view that sees ground no other view sees.
    #[error(
        "views do not share ground: `{view}` ({footprint}) overlaps its nearest view `{nearest}` ({nearest_footprint}) by {percent:.1} %"
    )]
    #[diagnostic(help(
        "are all images of the same place? a cropped image needs an RPC moved with the crop; `satgs info` lists the footprints"
    ))]
    NoSharedGround {
        /// The view.
        view: String,
        /// Where it looks.
        footprint: String,
        /// The view it overlaps most.
        nearest: String,
        /// Where that looks.
        nearest_footprint: String,
        /// Share of the view's footprint.
        percent: f64,
    },
    /// RPCs of different heights.
    #[error(
        "the RPC of `{view}` is made for heights of {low_m:.0} to {high_m:.0} m, those of others for {usual_m:.0} m or so"
    )]
    #[diagnostic(help(
        "does this RPC belong to this scene? --height-range LOW,HIGH says which heights to search"
    ))]
    NoSharedHeights {
        /// The view that differs most.
        view: String,
        /// Its lowest height.
        low_m: f64,
        /// Its highest height.
        high_m: f64,
        /// The middle of the others'.
        usual_m: f64,
    },
    /// A camera that does not see the ground.
    #[error("the RPC of `{view}` ({source_file}) sees no ground at a height of {height_m} m")]
    #[diagnostic(help(
        "does this RPC belong to this image? a cropped image needs an RPC moved with the crop"
    ))]
    SeesNoGround {
        /// The view.
        view: String,
        /// Where its RPC is from.
        source_file: String,
        /// Ellipsoidal height tried.
        height_m: f64,
    },
    /// An area of interest that cannot be.
    #[error("area of interest: {reason}")]
    #[diagnostic(help(
        "an area is WEST,SOUTH,EAST,NORTH in degrees, or a GeoJSON file with a polygon in lon/lat"
    ))]
    Area {
        /// What is wrong with it.
        reason: String,
    },
    /// An area that no view sees.
    #[error("no view sees the area ({area}); the first sees {footprint}")]
    #[diagnostic(help(
        "`satgs info` without the area lists the footprints; a cropped image needs an RPC moved with the crop"
    ))]
    AreaNotSeen {
        /// The area.
        area: String,
        /// Where the first view looks.
        footprint: String,
    },
    /// An elevation model of unknown vertical reference.
    #[error("`{path}` does not say what its heights count from{told}")]
    #[diagnostic(help(
        "--dem-vertical ellipsoid, EGM84, EGM96 (SRTM), EGM2008 (Copernicus), or the path of a geoid's grid \
         (.gtx, .tif of PROJ)"
    ))]
    VerticalReference {
        /// The elevation model.
        path: PathBuf,
        /// What it says instead, if anything: a phrase.
        told: String,
    },
    /// An elevation model with heights that are none.
    #[error("`{path}` has a height of {height_m:.0} m where the views look, which is none on Earth")]
    #[diagnostic(help(
        "is it a value for no data? `gdal_edit.py -a_nodata VALUE FILE` declares it; are the heights in another unit?"
    ))]
    DemVoid {
        /// The elevation model.
        path: PathBuf,
        /// The height, metres.
        height_m: f64,
    },
    /// An elevation model of another place.
    #[error("`{path}` has no heights where the views look")]
    #[diagnostic(help("`satgs info` lists the footprints; the model must be a north-up map"))]
    DemElsewhere {
        /// The elevation model.
        path: PathBuf,
    },
    /// A geoid grid of another place.
    #[error("the geoid grid has no undulation where the views look")]
    #[diagnostic(help("EGM96 and EGM2008 grids of the whole Earth come with PROJ's data"))]
    GeoidElsewhere,
    /// A list of views that cannot be read.
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
    /// A mask of another size than its image.
    #[error("mask `{mask}` is {width} x {height} pixels, its image `{image}` is {of_width} x {of_height}")]
    #[diagnostic(help("a mask has the size of its image; 0 is where there is none"))]
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
    /// A band that an image does not have.
    #[error("`{image}` has {found} band{}, band {asked} was asked for", if *found == 1 { "" } else { "s" })]
    #[diagnostic(help(
        "--bands counts from 1: three for red, green and blue, or one; `satgs info` lists the bands"
    ))]
    NoBand {
        /// The image.
        image: PathBuf,
        /// Bands it has.
        found: usize,
        /// The band asked for.
        asked: usize,
    },
    /// The band asked for says which pixels are image.
    #[error("`{image}`: band {asked} is an alpha band and holds no colour")]
    #[diagnostic(help("--bands takes the others; where the alpha band is 0 there is no image in any case"))]
    AlphaBand {
        /// The image.
        image: PathBuf,
        /// The band asked for.
        asked: usize,
    },
    /// Pixels are entries of a colour table.
    #[error("`{image}`: its pixels are numbers of a palette's colours, whose differences mean nothing")]
    #[diagnostic(help(
        "gdal_translate -expand rgb IN OUT writes the colours themselves; the RPC has to be kept beside OUT"
    ))]
    Palette {
        /// The image.
        image: PathBuf,
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
