//! The arguments of every command that reads a scene.

use super::perspective_args::PerspectiveArgs;
use super::scene_kind::SceneKind;
use super::{CliError, Ui};
use crate::perspective::PerspectiveScene;
use crate::progress::{Event, Progress};
use crate::run::AnyScene;
use crate::scene::{self, Aoi, ReadOptions, Scene, SceneError, Sun, TransferFunction};
use std::path::{Path, PathBuf};

/// A scene and how to read it.
#[derive(clap::Args, Clone, Debug)]
pub struct SceneArgs {
    /// Folder of images with RPCs, list of views, or scene of photographs
    ///
    /// RPCs lie in the files, beside them as delivered by the vendor, or in folders beside `images/`. A list of views is TOML with
    /// `[[view]]` tables, a STAC Item or an ItemCollection. Photographs have poses: a COLMAP project, a transforms.json, RGB-D frames,
    /// LEVIR-NVS, ScanNet++.
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Name of the folder of RPC files beside `images/` to use, when there are several
    #[arg(long, value_name = "NAME", hide_short_help = true, help_heading = "Input")]
    pub rpcs: Option<String>,
    /// Position of the sun in a view: azimuth clockwise from north and elevation, degrees; repeatable [default: from the
    /// image's metadata]
    #[arg(long = "sun", value_name = "NAME=AZ,EL", value_parser = parse_sun, hide_short_help = true, help_heading = "Input")]
    pub suns: Vec<(String, Sun)>,
    /// Area of interest: a box in degrees, or a GeoJSON polygon
    ///
    /// Only the parts of images that may show it are read [default: the ground that at least three views see; two, in a scene of two
    /// or three views].
    #[arg(long, value_name = "W,S,E,N|FILE", allow_hyphen_values = true, help_heading = "Input")]
    pub aoi: Option<String>,
    /// Bands to use, counted from 1: three as red, green, blue, or one [default: those that the file declares as such, else
    /// the first three]
    #[arg(long, value_name = "R,G,B", value_parser = parse_bands, hide_short_help = true, help_heading = "Input")]
    pub bands: Option<Bands>,
    /// Contrast stretch: percentage of pixels to clip at each end of the histogram [default: 0.5; 8-bit images: 0]
    #[arg(long, value_name = "PERCENT", value_parser = parse_percent, hide_short_help = true, help_heading = "Input")]
    pub stretch: Option<f64>,
    /// Display gamma of the images: 1 if values are proportional to radiance, 2.2 if they were made for a screen
    ///
    /// Pixel values are linearised (value^GAMMA) before matching and training. `auto` takes 2.2 for 8-bit images whose shadows are
    /// bright, too, such as DFC2019's, else 1; `satgs info` and `satgs ba` print which.
    #[arg(long, value_name = "GAMMA|auto", default_value = "auto", value_parser = parse_gamma,
        hide_short_help = true, help_heading = "Input")]
    pub gamma: Gamma,
    /// Use the first RPC found for an image, even if it seems to belong to another image
    ///
    /// For example to an image of another size, or to the raw image from which this one was orthorectified.
    #[arg(long, hide_short_help = true, help_heading = "Input")]
    pub trust_rpc: bool,
}

/// The argument SCENE of commands that refuse photographs.
pub(super) fn of_satellites(scene: clap::Arg) -> clap::Arg {
    scene.help("Folder of images with RPCs, or list of views").long_help(
        "Folder of images with RPCs, or list of views\n\nRPCs lie in the files, beside them as delivered by the vendor, or in \
         folders beside `images/`. A list of views is TOML with `[[view]]` tables, a STAC Item or an ItemCollection.",
    )
}

/// The transfer function of `--gamma`; none for `auto`.
#[derive(Clone, Copy, Debug)]
pub struct Gamma(Option<TransferFunction>);

/// Bands of `--bands`.
#[derive(Clone, Debug, Default)]
pub struct Bands(Vec<usize>);

impl SceneArgs {
    /// Where the scene lies.
    pub fn path(&self) -> &Path {
        &self.scene
    }

    /// Reads a scene of either kind and shows the warnings of satellite scenes. An option that scenes of its kind do not use is an
    /// error.
    pub fn read_any(
        &self,
        of_photographs: &PerspectiveArgs,
        height_range: Option<(f64, f64)>,
        ui: &Ui,
    ) -> Result<AnyScene, CliError> {
        if self.is_of_photographs() {
            ui.given().require_of(SceneKind::Photographs, &self.scene)?;
            return Ok(AnyScene::read_photographs(&self.scene, &of_photographs.options())?);
        }
        ui.given().require_of(SceneKind::Satellites, &self.scene)?;
        Ok(self.read(height_range, ui)?.into())
    }

    /// Whether the scene is one of photographs.
    pub fn is_of_photographs(&self) -> bool {
        PerspectiveScene::is_one(&self.scene)
    }

    /// Reads a satellite scene and shows its warnings.
    pub fn read(&self, height_range: Option<(f64, f64)>, ui: &Ui) -> Result<Scene, CliError> {
        PerspectiveScene::require_satellite(&self.scene)?;
        let options = ReadOptions {
            rpcs: self.rpcs.clone(),
            suns: self.suns.clone(),
            aoi: self.aoi.as_deref().map(read_aoi).transpose()?,
            height_range,
            bands: self.bands.clone().unwrap_or_default().0,
            stretch_percent: self.stretch,
            transfer_function: self.gamma.0,
            trust_rpc: self.trust_rpc,
        };
        let scene = scene::read(&self.scene, &options)?;
        for warning in &scene.warnings {
            ui.event(Event::Warning(warning.clone()));
        }
        if self.gamma.0.is_none() && !scene.transfer_function.is_linear() {
            let gamma = scene.transfer_function.gamma();
            ui.event(Event::Note(format!(
                "the images look processed for display: values are linearised with gamma {gamma} (--gamma 1 if they are linear)"
            )));
        }
        Ok(scene)
    }
}

fn read_aoi(text: &str) -> Result<Aoi, SceneError> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|w| w.trim().parse().ok()).collect();
    match numbers.and_then(|n| n.try_into().ok()) {
        Some(area) => Aoi::from_box(area),
        None => Aoi::from_geojson(Path::new(text)),
    }
}

fn parse_bands(text: &str) -> Result<Bands, String> {
    let bands: Option<Vec<usize>> = text.split(',').map(|w| w.trim().parse().ok()).collect();
    let wrong = || "expected one band or three, counted from 1, e.g. 3,2,1".to_owned();
    bands.filter(|b| [1, 3].contains(&b.len()) && !b.contains(&0)).map(Bands).ok_or_else(wrong)
}

fn parse_percent(text: &str) -> Result<f64, String> {
    let percent = text.parse().ok().filter(|p| (0.0..50.0).contains(p));
    percent.ok_or_else(|| "expected a percentage from 0 to below 50".to_owned())
}

fn parse_gamma(text: &str) -> Result<Gamma, String> {
    if text == "auto" {
        return Ok(Gamma(None));
    }
    let transfer_function = text.parse().ok().and_then(TransferFunction::new);
    transfer_function
        .map(|f| Gamma(Some(f)))
        .ok_or_else(|| "expected a number from 1 to 4, or auto".to_owned())
}

fn parse_sun(text: &str) -> Result<(String, Sun), String> {
    let wrong = || "expected NAME=AZ,EL in degrees, e.g. JAX_068_001_RGB=150.3,50.8".to_owned();
    let (name, angles) = text.rsplit_once('=').ok_or_else(wrong)?;
    let (azimuth, elevation) = angles.split_once(',').ok_or_else(wrong)?;
    let degrees = |s: &str| s.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(wrong);
    let sun = Sun::new(degrees(azimuth)?, degrees(elevation)?);
    Ok((name.into(), sun.ok_or("azimuth is within ±360°, elevation within ±90°")?))
}
