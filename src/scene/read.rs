//! Reads a scene from disk, in either layout, and says what is odd about it.

use super::source::{files_in, images_in};
use super::{Scene, SceneError, Sun, checks, dfc2019, folder};
use std::path::Path;

/// What a user can choose when a scene is read.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// The folder of RPC files, when the scene has several.
    pub rpcs: Option<String>,
    /// Suns by view name; they win over what files tell.
    pub suns: Vec<(String, Sun)>,
}

/// Reads the scene at `path`.
///
/// A folder with `images/` and a folder of RPC files for them is read as sat-NeRF and DFC2019 lay it out;
/// `images/` alone, or a folder of images, as images with RPCs inside or beside them. Views are ordered by name.
///
/// # Errors
/// [`SceneError`], naming the file.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Scene, SceneError> {
    let about = std::fs::metadata(path)
        .map_err(|e| SceneError::Unreadable { path: path.into(), reason: e.to_string() })?;
    if !about.is_dir() {
        return Err(SceneError::NotAFolder { path: path.into() });
    }
    files_in(path)?;
    let mut warnings = Vec::new();
    let images = path.join("images");
    let views = if images.is_dir() && !images_in(&images)?.is_empty() {
        match choose(path, options.rpcs.as_deref())? {
            Some(rpcs) => dfc2019::read(path, &rpcs, &mut warnings)?,
            None => folder::read(&images, &mut warnings)?,
        }
    } else if let Some(asked) = &options.rpcs {
        let (path, asked) = (path.into(), asked.clone());
        return Err(SceneError::NoSuchRpcFolder { path, asked, folders: Vec::new() });
    } else {
        folder::read(path, &mut warnings)?
    };
    if views.is_empty() {
        return Err(SceneError::NoImages { path: path.into() });
    }
    let mut scene = Scene { views, warnings };
    scene.views.sort_by(|a, b| a.name.cmp(&b.name));
    checks::refuse_duplicates(&scene)?;
    give_suns(&mut scene, &options.suns)?;
    checks::refuse_blind(&scene)?;
    checks::warn(&mut scene);
    Ok(scene)
}

/// The folder of RPC files: the one asked for, or the only one there is.
fn choose(path: &Path, asked: Option<&str>) -> Result<Option<String>, SceneError> {
    let mut folders = dfc2019::rpc_folders(path)?;
    match asked {
        Some(name) if path.join(name).is_dir() => Ok(Some(name.trim_end_matches('/').into())),
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
