//! Why a run cannot be exported.

use crate::io::ReadError;
use crate::splat::ply::PlyError;
use std::path::PathBuf;

/// Why a run cannot be exported.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum ExportError {
    /// The folder holds the images of the scene.
    #[error("`{folder}` holds images of the scene itself, which the project would replace")]
    #[diagnostic(help("name a new folder"))]
    OwnScene {
        /// The folder.
        folder: PathBuf,
    },
    /// The folder holds something already.
    #[error("`{folder}` is not empty")]
    #[diagnostic(help("name a new folder, or replace what an earlier export wrote by --overwrite"))]
    NotEmpty {
        /// The folder.
        folder: PathBuf,
    },
    /// The area or its heights have no extent, or a view looks along the ground.
    #[error("view `{view}`: no pinhole camera fits its camera over the area and the heights of the run")]
    #[diagnostic(help("`satgs train RUN --overwrite` writes cameras.json again"))]
    NoPinhole {
        /// Name of the view.
        view: String,
    },
    /// No view shows the area.
    #[error("no view of `{run}` shows its area")]
    #[diagnostic(help("`satgs info SCENE` shows the footprints of the views"))]
    NoView {
        /// The run folder.
        run: PathBuf,
    },
    /// A file of the run would be overwritten.
    #[error("`{path}` holds the run's own splats")]
    #[diagnostic(help("choose another file name"))]
    OwnFile {
        /// The file.
        path: PathBuf,
    },
    /// Coordinates that 24 bits cannot hold.
    #[error("a coordinate of a splat is {farthest:.0}, and SPZ holds none above 8388607")]
    #[diagnostic(help("--gltf without --compress and --ply hold single precision"))]
    TooWide {
        /// The coordinate.
        farthest: f32,
    },
    /// More splats than a file of the format can hold.
    #[error("{splats} splats are too many for one file of this format")]
    #[diagnostic(help("`satgs export RUN --3dtiles DIR` divides them among many files"))]
    TooMany {
        /// Their number.
        splats: usize,
    },
    /// A file is not a supported splat file, or damaged.
    #[error("`{path}` is not a supported splat file: {reason}")]
    #[diagnostic(help(
        "satgs reads .ply of 3DGS and 2DGS, .compressed.ply, .spz of version 2 and 3, and .glb with KHR_gaussian_splatting"
    ))]
    NotSplats {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Two files of one name would need different georeferences.
    #[error("`{georeference}` belongs to `{other}`, and has another place or other axes than the new file")]
    #[diagnostic(help("choose another name for the file"))]
    SharedGeoreference {
        /// The georeference.
        georeference: PathBuf,
        /// The file that it belongs to.
        other: PathBuf,
    },
    /// A file is not a supported tileset.
    #[error("`{path}` is not a supported tileset: {reason}")]
    #[diagnostic(help("satgs reads tileset.json of 3D Tiles 1.0 and 1.1"))]
    Tileset {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A PLY file of splats cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Ply(#[from] PlyError),
    /// The georeference beside a file cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Georeference {
        /// Why.
        source: ReadError,
    },
    /// The georeference beside a file has axes that satgs does not write.
    #[error("`{path}`: axes `{axes}` are unknown")]
    #[diagnostic(help("expected east, north, up; east, down, north; or east, up, south"))]
    UnknownAxes {
        /// The file.
        path: PathBuf,
        /// The axes.
        axes: String,
    },
    /// The splats of a run have no place on Earth.
    #[error("`{run}` has no georeference, and 3D Tiles stand on Earth")]
    #[diagnostic(help("train with a scene that has a georeference (--georef), or use --gltf or --spz"))]
    NoPlace {
        /// The run folder.
        run: PathBuf,
    },
    /// The map projection of a run is not defined at its splats.
    #[error("EPSG:{epsg} gives no longitude and latitude at a splat of `{run}`")]
    #[diagnostic(help("`satgs info RUN/splats.ply` shows where the splats are"))]
    OffTheMap {
        /// The run folder.
        run: PathBuf,
        /// The coordinate system.
        epsg: u32,
    },
    /// There are no splats.
    #[error("`{run}` has no splats to export")]
    #[diagnostic(help("`satgs train RUN` makes them"))]
    NoSplats {
        /// The run folder.
        run: PathBuf,
    },
}
