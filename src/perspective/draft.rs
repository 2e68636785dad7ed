//! What the readers of all layouts find, before views are made of it.

use super::error::PerspectiveError;
use super::georeference::Georeference;
use super::lens::LensCamera;
use super::mask_file::MaskFile;
use super::options::{PerspectiveOptions, TestViews};
use super::orientation::Orientation;
use super::pose::Pose;
use super::scene_parts::{Layout, ScenePoint};
use super::transparency::Transparency;
use super::view::{DepthFile, PerspectiveView};
use crate::io::{ImageFile, read_text};
use crate::scene::Role;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Largest difference in pixels between the size of an image and the size for which its camera is, scaled alike along
/// both axes; sizes are rounded when images are resampled.
const ROUNDING_PX: f64 = 1.5;

/// An image and its camera as a reader found them.
#[derive(Clone, Debug)]
pub(super) struct Draft {
    /// Name of the image in the scene, by which views are sorted.
    pub name: String,
    /// The image file.
    pub image: PathBuf,
    /// The size for which the camera is, if the scene states it; otherwise it is for the image.
    pub size: Option<(usize, usize)>,
    /// The camera, for an image of the stated size.
    pub lens: LensCamera,
    /// The pose in the frame of the file.
    pub pose: Pose,
    /// The masks.
    pub masks: Vec<MaskFile>,
    /// The depth map, in units of the file's frame.
    pub depth: Option<DepthFile>,
    /// What the scene's own list of test views says.
    pub role: Option<Role>,
    /// Indices of the points that the image is known to show.
    pub observed: Vec<u32>,
}

/// All that a reader found.
#[derive(Clone, Debug)]
pub(super) struct Drafts {
    /// The layout.
    pub layout: Layout,
    /// The images.
    pub views: Vec<Draft>,
    /// Points in the frame of the file.
    pub points: Vec<ScenePoint>,
    /// What was left out, and why.
    pub skipped: Vec<(String, String)>,
    /// Keys and files that are not used, and why.
    pub unused: Vec<(String, String)>,
    /// Files that were read beside images, masks and depth maps.
    pub sources: Vec<PathBuf>,
}

impl Drafts {
    /// Nothing of a layout yet.
    pub(super) fn of(layout: Layout) -> Self {
        Self {
            layout,
            views: Vec::new(),
            points: Vec::new(),
            skipped: Vec::new(),
            unused: Vec::new(),
            sources: Vec::new(),
        }
    }

    /// Reports how many images have no mask in a folder of masks, unless none has one: that is reported for the folder.
    pub(super) fn say_which_lack_masks(&mut self, folder: &Path) {
        let mut without = self.views.iter().filter(|v| v.masks.is_empty());
        let (missing, of) = (without.clone().count(), self.views.len());
        if let Some(first) = without.next().filter(|_| missing < of) {
            let reason = format!("{missing} of {of} images have none, the first is {}", first.name);
            self.unused.push((format!("{} for all images", folder.display()), reason));
        }
    }

    /// The views, ordered by the names of their images.
    pub(super) fn views(
        mut self,
        options: &PerspectiveOptions,
        georeference: Option<&Georeference>,
    ) -> Result<Vec<PerspectiveView>, PerspectiveError> {
        let downsampling = options.downsampling;
        if ![1, 2, 4, 8].contains(&downsampling) {
            return Err(PerspectiveError::Downsampling { found: downsampling });
        }
        self.views.sort_by(|a, b| a.name.cmp(&b.name));
        let names = view_names(&self.views)?;
        let roles = roles(&self.views, &names, &options.test_views)?;
        let scale = georeference.map_or(1.0, |g| g.scale);
        let transparency = options.transparency.unwrap_or(Transparency::of(self.layout));
        let view = |((draft, name), role): ((Draft, String), Role)| {
            let file = ImageFile::open(&draft.image)?;
            let (lens, turned) = lens_of_image(&draft, file.size(), Orientation::of(&file))?;
            let pose = georeference.map_or(draft.pose, |g| g.pose(draft.pose));
            let camera =
                PerspectiveView::undistorted_camera(&lens, pose.cam_from_world, pose.center, downsampling);
            if camera.size.0 == 0 || camera.size.1 == 0 {
                return Err(PerspectiveError::Downsampling { found: downsampling });
            }
            Ok(PerspectiveView {
                name,
                path_in_scene: draft.name.into(),
                image: draft.image,
                role,
                transparency: file.has_transparency(&file.default_bands()).then_some(transparency),
                turned,
                lens_camera: lens,
                camera,
                downsampling,
                masks: draft.masks,
                depth: draft.depth.map(|d| DepthFile { metres_per_unit: d.metres_per_unit * scale, ..d }),
                observed: draft.observed,
            })
        };
        self.views.into_par_iter().zip(names).zip(roles).map(view).collect::<Vec<_>>().into_iter().collect()
    }
}

/// The camera of the image file, whose size may be another one than that for which the scene states the camera, and how the file
/// is turned if the camera is of the image as displayed.
fn lens_of_image(
    draft: &Draft,
    (width, height): (usize, usize),
    orientation: Option<Orientation>,
) -> Result<(LensCamera, Option<Orientation>), PerspectiveError> {
    let Some(of) = draft.size else {
        return Ok((LensCamera { size: (width, height), ..draft.lens }, None));
    };
    let lens = LensCamera { size: of, ..draft.lens };
    if is_resampled((width, height), of) {
        return Ok((lens.resized((width, height)), None));
    }
    if orientation.is_some() && is_resampled((height, width), of) {
        return Ok((lens.resized((height, width)), orientation));
    }
    Err(PerspectiveError::Size {
        path: draft.image.clone(),
        width,
        height,
        of: "the image of its camera",
        expected_width: of.0,
        expected_height: of.1,
        hint: "images may be resampled, alike along both axes, and turned as their EXIF says, but not be cropped or turned otherwise",
    })
}

/// Whether an image of a size may be one of another size, resampled alike along both axes.
fn is_resampled((width, height): (usize, usize), (of_width, of_height): (usize, usize)) -> bool {
    let off = (width as f64 / of_width as f64 - height as f64 / of_height as f64).abs();
    off * of_width as f64 <= ROUNDING_PX || off * of_height as f64 <= ROUNDING_PX
}

/// Names of the views: the names of the images without folders and extensions if these differ, otherwise with folders.
fn view_names(views: &[Draft]) -> Result<Vec<String>, PerspectiveError> {
    let short = |d: &Draft| {
        Path::new(&d.name).file_stem().map_or_else(|| d.name.clone(), |s| s.to_string_lossy().into_owned())
    };
    let long = |d: &Draft| Path::new(&d.name).with_extension("").to_string_lossy().replace(['/', '\\'], "_");
    let names: Vec<String> = views.iter().map(short).collect();
    if names.iter().collect::<BTreeSet<_>>().len() == names.len() {
        return Ok(names);
    }
    let names: Vec<String> = views.iter().map(long).collect();
    let mut first = BTreeMap::new();
    for (name, view) in names.iter().zip(views) {
        if let Some(first) = first.insert(name, &view.name) {
            return Err(PerspectiveError::SameName { first: first.clone(), second: view.name.clone() });
        }
    }
    Ok(names)
}

/// Index of the view whose image a list names: with its folder, or without it, if there is one such image only, and both with or
/// without the extension. None if there is none.
///
/// # Errors
/// [`PerspectiveError::Field`] for a name that several images have.
pub(super) fn named(list: &Path, views: &[Draft], name: &str) -> Result<Option<usize>, PerspectiveError> {
    let name = name.replace('\\', "/");
    let whole = |v: &Draft| v.name == name || Path::new(&v.name).with_extension("") == Path::new(&name);
    if let Some(place) = views.iter().position(whole) {
        return Ok(Some(place));
    }
    let is_it = |v: &Draft| {
        let file = Path::new(&v.name);
        [file.file_name(), file.file_stem()].into_iter().flatten().any(|f| f == name.as_str())
    };
    let mut places = (0..views.len()).filter(|i| is_it(&views[*i]));
    match (places.next(), places.next()) {
        (Some(_), Some(_)) => {
            let (found, expected) = ("of several images", "a name with its folder");
            Err(PerspectiveError::field(list, format!("the name `{name}`"), found, expected))
        }
        (place, _) => Ok(place),
    }
}

fn roles(views: &[Draft], names: &[String], tests: &TestViews) -> Result<Vec<Role>, PerspectiveError> {
    let role = |is_test: bool| if is_test { Role::Test } else { Role::Train };
    match tests {
        TestViews::None => Ok(vec![Role::Train; views.len()]),
        TestViews::Every(n) => {
            let every = |(i, view): (usize, &Draft)| view.role.unwrap_or(role(*n > 0 && i % n == 0));
            Ok(views.iter().enumerate().map(every).collect())
        }
        TestViews::List(path) => {
            let text = read_text(path)?.replace('\\', "/");
            let lines = text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#'));
            let mut out = vec![Role::Train; views.len()];
            for line in lines {
                let place = match names.iter().position(|name| name == line) {
                    Some(place) => Some(place),
                    None => named(path, views, line)?,
                };
                let first = names.first().cloned().unwrap_or_default();
                let place = place.ok_or_else(|| PerspectiveError::UnknownView {
                    path: path.clone(),
                    name: line.into(),
                    first,
                })?;
                out[place] = Role::Test;
            }
            Ok(out)
        }
    }
}
