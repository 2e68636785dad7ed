//! The arguments of every command that reads a scene.

use super::{Failure, Ui};
use crate::event::Event;
use crate::scene::{self, ReadOptions, Scene, Sun};
use std::path::{Path, PathBuf};

/// A scene and how to read it.
#[derive(clap::Args, Clone, Debug)]
pub struct SceneArgs {
    /// Folder of images with RPCs (in the file, or NAME_RPC.TXT or NAME.json beside it), or a folder with
    /// `images/` and folders of RPC files
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Folder of RPC files beside `images/`, when there are several
    #[arg(long, value_name = "NAME")]
    pub rpcs: Option<String>,
    /// Sun of a view, azimuth clockwise from north and elevation in degrees; repeatable
    #[arg(long = "sun", value_name = "NAME=AZ,EL", value_parser = parse_sun)]
    pub suns: Vec<(String, Sun)>,
}

impl SceneArgs {
    /// Where the scene lies.
    pub fn path(&self) -> &Path {
        &self.scene
    }

    /// Reads the scene and shows its warnings.
    pub fn read(&self, ui: &Ui) -> Result<Scene, Failure> {
        let options = ReadOptions { rpcs: self.rpcs.clone(), suns: self.suns.clone() };
        let scene = scene::read(&self.scene, &options)?;
        for warning in &scene.warnings {
            ui.show(Event::Warning(warning.clone()));
        }
        Ok(scene)
    }
}

fn parse_sun(text: &str) -> Result<(String, Sun), String> {
    let wrong = || "expected NAME=AZ,EL in degrees, e.g. JAX_068_001_RGB=150.3,50.8".to_owned();
    let (name, angles) = text.rsplit_once('=').ok_or_else(wrong)?;
    let (azimuth, elevation) = angles.split_once(',').ok_or_else(wrong)?;
    let degrees = |s: &str| s.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(wrong);
    let sun = Sun { azimuth_deg: degrees(azimuth)?, elevation_deg: degrees(elevation)? };
    if !(-360.0..=360.0).contains(&sun.azimuth_deg) || !(-90.0..=90.0).contains(&sun.elevation_deg) {
        return Err("azimuth is within ±360°, elevation within ±90°".to_owned());
    }
    Ok((name.into(), sun))
}
