//! Why a run cannot be exported.

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
    #[diagnostic(help("`satgs train RUN --overwrite` writes cameras.json anew"))]
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
    /// Splats whose colours depend on the direction are not turned.
    #[error("the colours of these splats depend on the direction, and are not turned")]
    #[diagnostic(help("--variant 3dgs keeps the axes of the run"))]
    DirectionalColor,
}
