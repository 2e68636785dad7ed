//! What lies at a path where no scene was found, and the next step that works with it.

use super::SceneError;
use super::files::{file_name, has_extension};
use super::source::{files_in, images_in};
use crate::io::vsi;
use std::path::{Path, PathBuf};

const PHOTOGRAPHS: [&str; 6] = ["jpg", "jpeg", "png", "heic", "webp", "dng"];
const VIDEOS: [&str; 8] = ["mp4", "mov", "avi", "mkv", "m4v", "webm", "mts", "mpg"];
/// Archives that GDAL reads in place, with the prefix of its virtual file system.
const READ_IN_PLACE: [(&str, &str); 4] =
    [("zip", "/vsizip/"), ("tar", "/vsitar/"), ("tgz", "/vsitar/"), ("gz", "/vsitar/")];
const OTHER_ARCHIVES: [&str; 4] = ["7z", "rar", "xz", "bz2"];
/// Names in the folder of a scene of photographs. Whether it is one, [`crate::perspective`] says.
const OF_POSES: [&str; 9] = [
    "sparse",
    "cameras.bin",
    "cameras.txt",
    "transforms.json",
    "transforms_train.json",
    "camera-intrinsics.txt",
    "cams",
    "dslr",
    "colmap",
];
/// Folder of the images of either kind of scene.
const IMAGES: &str = "images";

/// What lies at a path where no scene was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Found {
    /// Nothing that is known.
    Nothing,
    /// Photographs, without the poses of their cameras.
    Photographs {
        /// The folder that holds them, or one above it.
        folder: PathBuf,
        /// How many.
        number: usize,
    },
    /// A video.
    Video {
        /// The file.
        path: PathBuf,
    },
    /// An archive.
    Archive {
        /// The file.
        path: PathBuf,
        /// The path by which GDAL reads the scene inside, if it reads such archives.
        inside: Option<PathBuf>,
    },
    /// A folder in the folder, which may hold the scene.
    Below {
        /// The folder.
        folder: PathBuf,
    },
}

impl Found {
    /// Looks at a file or folder, and at the folders in it, by their names alone. Remote folders are not searched, because
    /// every folder there is a request.
    #[must_use]
    pub fn at(path: &Path) -> Self {
        if vsi::is_remote(path) {
            return Self::Nothing;
        }
        if !vsi::is_dir(path) {
            return Self::of_file(path);
        }
        let listing = files_in(path).unwrap_or_default();
        let folders = listing.iter().filter(|p| vsi::is_dir(p));
        if let Some(folder) = folders.clone().find(|folder| holds_scene(folder)) {
            return Self::Below { folder: folder.clone() };
        }
        let first_of = |extensions: &[&str]| listing.iter().find(|p| has_extension(p, extensions));
        let number =
            std::iter::once(path.to_path_buf()).chain(folders.cloned()).map(|f| photographs_in(&f)).max();
        match number {
            Some(number) if number > 0 => Self::Photographs { folder: path.into(), number },
            _ => first_of(&VIDEOS)
                .or(listing.iter().find(|p| is_archive(p)))
                .map_or(Self::Nothing, |file| Self::of_file(file)),
        }
    }

    fn of_file(path: &Path) -> Self {
        if has_extension(path, &PHOTOGRAPHS) {
            Self::Photographs { folder: path.parent().unwrap_or(Path::new("")).into(), number: 1 }
        } else if has_extension(path, &VIDEOS) {
            Self::Video { path: path.into() }
        } else if is_archive(path) {
            Self::Archive { path: path.into(), inside: inside_of(path) }
        } else {
            Self::Nothing
        }
    }

    /// What was found, as a clause after a colon; empty for nothing.
    #[must_use]
    pub fn clause(&self) -> String {
        match self {
            Self::Nothing => String::new(),
            Self::Photographs { number: 1, .. } => {
                ": it is a photograph without the pose of its camera".into()
            }
            Self::Photographs { number, .. } => {
                format!(": it holds {number} photographs without the poses of their cameras")
            }
            Self::Video { path } => format!(": `{}` is a video", file_name(path)),
            Self::Archive { path, .. } => format!(": `{}` is an archive", file_name(path)),
            Self::Below { folder } => format!(": its folder `{}` may be the scene", file_name(folder)),
        }
    }

    /// The next step that works with what was found; none for nothing.
    #[must_use]
    pub fn next_step(&self) -> Option<String> {
        Some(match self {
            Self::Nothing => return None,
            Self::Photographs { folder, .. } => format!(
                "find the poses with `satgs-poses {} -o SCENE` of the Python package (`pip install './python[poses]'`), then \
                 `satgs run SCENE -o RUN`; or with COLMAP: put the photographs into WORK/images, run `colmap automatic_reconstructor \
                 --workspace_path WORK --image_path WORK/images --dense 0`, then `satgs run WORK -o RUN`. If they are satellite \
                 images, use the files as delivered, with their RPC",
                folder.display()
            ),
            Self::Video { path } => format!(
                "extract frames and find their poses: `mkdir -p WORK/images && ffmpeg -i {} -vf fps=2 -qscale:v 2 \
                 WORK/images/%04d.jpg`, `satgs-poses WORK/images -o WORK` of the Python package or `colmap automatic_reconstructor \
                 --workspace_path WORK --image_path WORK/images --dense 0`, then `satgs run WORK -o RUN`",
                path.display()
            ),
            Self::Archive { inside: Some(inside), .. } => {
                format!("give `{}` to read it in place, or unpack it, which is faster", inside.display())
            }
            Self::Archive { .. } => "unpack it, and give the folder of the scene".into(),
            Self::Below { folder } => format!("give `{}`", folder.display()),
        })
    }
}

/// The error of a folder without images.
pub(super) fn no_images(folder: &Path) -> SceneError {
    let found = Found::at(folder);
    let next_step = found.next_step().unwrap_or_else(|| {
        "images end in .tif, .tiff, .ntf, .nitf, .nsf, .jp2, .j2k or .vrt; sub-folders other than `images/` are not searched".into()
    });
    SceneError::NoImages { path: folder.into(), found: found.clause(), next_step }
}

/// The error of a file that is no list of views.
pub(super) fn not_a_folder(path: &Path, found: &Found) -> SceneError {
    let next_step = found.next_step().unwrap_or_else(|| {
        "give the folder that holds the images, or a list of views: TOML, STAC JSON (`satgs info --help`)"
            .into()
    });
    SceneError::NotAFolder { path: path.into(), found: found.clause(), next_step }
}

fn is_archive(path: &Path) -> bool {
    READ_IN_PLACE.iter().any(|(end, _)| has_extension(path, &[*end])) || has_extension(path, &OTHER_ARCHIVES)
}

/// The path by which GDAL reads the scene in an archive: its top, or the first folder in it that holds a scene.
fn inside_of(archive: &Path) -> Option<PathBuf> {
    let prefix = READ_IN_PLACE.iter().find(|(end, _)| has_extension(archive, &[*end]))?.1;
    let top = PathBuf::from(format!("{prefix}{}", vsi::absolute(archive).ok()?.display()));
    let listing = files_in(&top).ok()?;
    let below = || listing.iter().find(|folder| vsi::is_dir(folder) && holds_scene(folder)).cloned();
    if holds_scene(&top) { Some(top) } else { below().or(Some(top)) }
}

/// Whether a folder holds what the folder of a scene does, by names.
fn holds_scene(folder: &Path) -> bool {
    let has_images = |folder: &Path| images_in(folder).is_ok_and(|images| !images.is_empty());
    let is_of_poses = |p: &PathBuf| OF_POSES.contains(&file_name(p).to_lowercase().as_str());
    has_images(folder)
        || has_images(&folder.join(IMAGES))
        || files_in(folder).is_ok_and(|listing| listing.iter().any(is_of_poses))
}

fn photographs_in(folder: &Path) -> usize {
    files_in(folder).unwrap_or_default().iter().filter(|p| has_extension(p, &PHOTOGRAPHS)).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for file in files {
            let path = folder.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "x").unwrap();
        }
        folder
    }

    #[test]
    fn what_lies_there_decides_the_next_step() {
        let next = |files: &[&str]| Found::at(folder(files).path()).next_step().unwrap_or_default();
        for photographs in [["a.jpg", "b.JPG"], ["images/1.png", "images/2.png"]] {
            assert!(next(&photographs).contains("colmap automatic_reconstructor"), "{photographs:?}");
        }
        assert!(next(&["walk.MOV", "notes.txt"]).contains("ffmpeg -i"));
        // Archives that cannot be read in place: the first is damaged.
        for archive in ["delivery.zip", "delivery.7z"] {
            assert!(next(&[archive]).contains("unpack"), "{archive}");
        }
        assert_eq!(next(&["notes.txt", "other/readme.md"]), "");
    }

    #[test]
    fn a_scene_one_folder_deeper_is_named() {
        for inside in
            ["A/1.tif", "A/images/1.ntf", "A/sparse/0/cameras.bin", "A/transforms.json", "A/Cams/1.txt"]
        {
            let top = folder(&[inside, "B/readme.md"]);
            assert_eq!(Found::at(top.path()), Found::Below { folder: top.path().join("A") }, "{inside}");
        }
    }
}
