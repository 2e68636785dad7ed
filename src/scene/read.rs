//! Reads a scene from disk, in any layout, and collects warnings.

use super::found::{Found, no_images, not_a_folder};
use super::source::{files_in, images_in, is_image};
use super::{Aoi, Scene, SceneError, Sun, TransferFunction, View, checks, dfc2019, folder, manifest};
use crate::io::{ImageFile, vsi};
use std::path::Path;

/// Largest number of images that are looked at to find whether they are encoded for display.
const JUDGED_VIEWS: usize = 20;

/// Options of [`read`].
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// Name of the folder of RPC files; needed if the scene has several.
    pub rpcs: Option<String>,
    /// Sun directions by view name; they replace those in files.
    pub suns: Vec<(String, Sun)>,
    /// Area of interest to which images are cropped.
    pub aoi: Option<Aoi>,
    /// Lowest and highest ellipsoidal height in the area, metres; the default is [`Scene::height_range`].
    pub height_range: Option<(f64, f64)>,
    /// Bands to use of images that have more than one, counted from 1: three or one. If empty, those that a file declares as red,
    /// green and blue, else the first three.
    pub bands: Vec<usize>,
    /// Percentage of pixels to clip at each end of the histogram.
    pub stretch_percent: Option<f64>,
    /// Relation between the images' pixel values and linear radiance; found from the images if none is given.
    pub transfer_function: Option<TransferFunction>,
    /// Whether the first RPC found for an image is used without checking that it belongs to the image.
    pub trust_rpc: bool,
}

/// Reads the scene at `path`.
///
/// A folder with `images/` and a folder of RPC files is read in the layout of sat-NeRF and DFC2019. A folder of images, or
/// with `images/` alone, holds images with RPCs in or beside them. A TOML or STAC file lists the views. Views are ordered
/// by name; paths of their files are absolute. `path`, and paths in a list, may be those of GDAL's virtual file systems
/// ([`vsi`]), or URLs.
///
/// # Errors
/// [`SceneError`] names the file that cannot be read, or the view or option that is wrong.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Scene, SceneError> {
    let path = &vsi::absolute(path).map_err(|cause| SceneError::Unreadable { path: path.into(), cause })?;
    let is_folder = vsi::is_dir(path);
    if !is_folder && let Err(cause) = vsi::size(path) {
        return Err(SceneError::Unreadable { path: path.into(), cause });
    }
    let found = if is_folder { Found::Nothing } else { Found::at(path) };
    if found != Found::Nothing {
        return Err(not_a_folder(path, &found));
    }
    let mut warnings = Vec::new();
    let (views, listed_aoi) = if !is_folder && !is_image(path) {
        manifest::read(path, options.trust_rpc, &mut warnings)?
    } else if is_folder {
        (in_folder(path, options, &mut warnings)?, None)
    } else {
        return Err(not_a_folder(path, &found));
    };
    if views.is_empty() {
        return Err(no_images(path));
    }
    let mut scene =
        Scene { views, aoi: None, heights: None, transfer_function: TransferFunction::default(), warnings };
    scene.views.sort_by(|a, b| a.name.cmp(&b.name));
    checks::refuse_duplicates(&scene)?;
    give_suns(&mut scene, &options.suns)?;
    checks::refuse_blind(&scene)?;
    choose_bands(&mut scene, options)?;
    checks::warn(&mut scene);
    if let Some(heights) = options.height_range {
        checks::require_heights_of_rpcs(&mut scene, heights)?;
    }
    if let Some(aoi) = options.aoi.clone().or(listed_aoi) {
        let heights = options.height_range.unwrap_or_else(|| scene.height_range());
        scene.crop(aoi, heights)?;
    }
    scene.transfer_function = match options.transfer_function {
        Some(stated) => stated,
        None => transfer_function_of(&scene.views)?,
    };
    Ok(scene)
}

/// [`TransferFunction::DISPLAY`] if most of the images that are looked at are probably encoded with it, else the identity.
fn transfer_function_of(views: &[View]) -> Result<TransferFunction, SceneError> {
    let looked_at = views.iter().step_by(views.len().div_ceil(JUDGED_VIEWS).max(1));
    let displayed = looked_at.map(View::is_displayed).collect::<Result<Vec<_>, _>>()?;
    let most_are = 2 * displayed.iter().filter(|d| **d).count() > displayed.len();
    Ok(if most_are { TransferFunction::DISPLAY } else { TransferFunction::default() })
}

/// The views of a folder, in either layout.
fn in_folder(
    path: &Path,
    options: &ReadOptions,
    warnings: &mut Vec<String>,
) -> Result<Vec<View>, SceneError> {
    files_in(path)?;
    let images = path.join("images");
    if vsi::is_dir(&images) && !images_in(&images)?.is_empty() {
        match choose(path, options.rpcs.as_deref())? {
            Some(rpcs) => dfc2019::read(path, &rpcs, options.trust_rpc, warnings),
            None => folder::read(&images, options.trust_rpc, warnings),
        }
    } else if let Some(asked) = &options.rpcs {
        let (path, asked) = (path.into(), asked.clone());
        Err(SceneError::NoSuchRpcFolder { path, asked, folders: Vec::new() })
    } else {
        folder::read(path, options.trust_rpc, warnings)
    }
}

/// Selects the bands of every view; images with a single band keep it.
fn choose_bands(scene: &mut Scene, options: &ReadOptions) -> Result<(), SceneError> {
    let mut first_of = Vec::new();
    for view in &mut scene.views {
        view.stretch_percent = options.stretch_percent;
        let file = ImageFile::open(&view.image)?;
        let found = file.color_bands().len();
        if found > 1 && !options.bands.is_empty() {
            let (image, found) = (view.image.clone(), file.bands());
            if let Some(asked) = options.bands.iter().copied().find(|b| !(1..=found).contains(b)) {
                return Err(SceneError::NoBand { image, found, asked });
            }
            if let Some(asked) = options.bands.iter().copied().find(|b| file.is_alpha(*b)) {
                return Err(SceneError::AlphaBand { image, asked });
            }
            view.bands.clone_from(&options.bands);
        } else if found > view.bands.len() {
            first_of.push(format!("{} ({found})", view.name));
        }
    }
    if !first_of.is_empty() {
        scene.warnings.push(format!(
            "only the first bands are used; --bands R,G,B chooses others (5,3,2 for the eight bands of WorldView-3): {}",
            first_of.join(", ")
        ));
    }
    Ok(())
}

/// Name of the folder of RPC files: the requested one, or the only one.
fn choose(path: &Path, asked: Option<&str>) -> Result<Option<String>, SceneError> {
    let mut folders = dfc2019::rpc_folders(path)?;
    match asked {
        Some(name) if vsi::is_dir(&path.join(name)) => Ok(Some(name.trim_end_matches('/').into())),
        Some(name) => Err(SceneError::NoSuchRpcFolder { path: path.into(), asked: name.into(), folders }),
        None if folders.len() > 1 => Err(SceneError::SeveralRpcFolders { path: path.into(), folders }),
        None => Ok(folders.pop()),
    }
}

fn give_suns(scene: &mut Scene, suns: &[(String, Sun)]) -> Result<(), SceneError> {
    for (name, sun) in suns {
        let view = scene.views.iter_mut().find(|v| v.name == *name);
        let Some(view) = view else {
            let names = scene.views.iter().map(|v| v.name.clone()).collect();
            return Err(SceneError::UnknownView { name: name.clone(), names });
        };
        view.sun = Some(*sun);
    }
    Ok(())
}
