//! A simulated town to learn from: its images with their true cameras, and its exact surface.

use super::error::LearnError;
use super::surface::ExactSurface;
use crate::affine::{SiteFrame, SiteScene, TrainingView};
use crate::frame::{Point, SiteBox, SiteGrid};
use crate::io::ImageFile;
use crate::predict::image_network::NetworkMaps;
use crate::predict::light::{Light, calibrate};
use crate::predict::{Cloud, SplatSampling, observer::SatelliteImages, reference};
use crate::progress::Progress;
use crate::rpc::formats;
use crate::scene::{ReadOptions, Role, Scene, TransferFunction};
use crate::simulate::{SimulateOptions, simulate};
use crate::splat::loss::Prior;
use std::path::Path;
use std::sync::Arc;

/// Margin of the altitudes below and above the surface, metres.
const MARGIN_M: f64 = 2.0;

/// A town.
pub struct Town {
    /// The area with a known surface.
    pub area: SiteBox,
    /// Lowest and highest altitude, metres.
    pub altitudes: (f64, f64),
    /// Images to predict from.
    pub context: Vec<TrainingView>,
    /// What a network of image features gives for these, if there is one.
    pub maps: Option<Arc<NetworkMaps>>,
    /// Images to compare with.
    pub targets: Vec<TargetView>,
    /// The exact surface.
    pub surface: ExactSurface,
    /// The surface for the loss, where it is smooth.
    pub prior: Arc<Prior>,
}

/// An image to compare renders with.
pub struct TargetView {
    /// The image.
    pub view: TrainingView,
    /// Its light.
    pub light: Light,
    /// For each pixel the position of the surface that it shows, and its sunlight; none without surface.
    pub shown: Vec<Option<([f64; 3], f32)>>,
}

impl Town {
    /// Simulates a town in a folder unless it is there, and reads it; its images are taken to encode light in this way.
    pub fn load(
        folder: &Path,
        options: &SimulateOptions,
        transfer_function: TransferFunction,
        progress: &dyn Progress,
    ) -> Result<Self, LearnError> {
        let truth = folder.join("truth/TOWN_DSM.tif");
        if !truth.exists() {
            simulate(folder, options, progress)?;
        }
        // The images are linear; `transfer_function` is the one that they are taken to have.
        let linear =
            ReadOptions { transfer_function: Some(TransferFunction::default()), ..ReadOptions::default() };
        let scene = crate::scene::read(folder, &linear)?;
        let file = ImageFile::open(&truth)?;
        let (grid, mut altitude) = (file.map_grid()?, file.read(1)?);
        let (west, south, east, north) = grid.bounds();
        let (lowest, highest) = altitude.valid().fold((f32::MAX, f32::MIN), |(a, b), v| (a.min(v), b.max(v)));
        let origin = Point::new(
            (0.5 * (west + east)).round(),
            (0.5 * (south + north)).round(),
            f64::from(lowest).round(),
        );
        altitude.data.iter_mut().for_each(|z| *z -= origin.z() as f32);
        let site = SiteGrid { epsg: grid.epsg, origin };
        let area = (west - origin.x(), south - origin.y(), east - origin.x(), north - origin.y());
        let altitudes =
            (f64::from(lowest) - origin.z() - MARGIN_M, f64::from(highest) - origin.z() + MARGIN_M);
        let surface = ExactSurface::new(site, grid, altitude);
        let frame = SiteFrame { site, area, altitudes, searched: altitudes, reference: None };
        let (context, targets) = views(folder, &scene, frame, transfer_function)?;
        let prior = Arc::new(Prior::new(&surface.smooth_parts()));
        let mut town = Self { area, altitudes, context, maps: None, targets: Vec::new(), surface, prior };
        town.targets = town.with_light(targets)?;
        Ok(town)
    }

    /// What the target views show of the exact surface, in the light of their dates.
    fn with_light(&self, targets: Vec<TrainingView>) -> Result<Vec<TargetView>, LearnError> {
        let sampling = SplatSampling::default();
        let (cloud, _) = Cloud::new(&self.surface.points(), 0.5 * self.surface.cell_m())?;
        let splats = reference::surface(&cloud, &sampling, self.area, true);
        let all: Vec<TrainingView> = self.context.iter().chain(&targets).cloned().collect();
        let images = SatelliteImages::new(&all, &splats, self.altitudes);
        let lights = calibrate(&images, cloud.positions(), 0);
        let of_target = |(k, view): (usize, TrainingView)| {
            let index = self.context.len() + k;
            TargetView { view, light: lights[index], shown: images.shown(index) }
        };
        Ok(targets.into_iter().enumerate().map(of_target).collect())
    }
}

/// The views to predict from and those to compare with, with their true cameras.
fn views(
    folder: &Path,
    scene: &Scene,
    frame: SiteFrame,
    transfer_function: TransferFunction,
) -> Result<(Vec<TrainingView>, Vec<TrainingView>), LearnError> {
    let rpc = |name: &String| Ok(formats::read(&folder.join(format!("truth/rpcs/{name}.json")))?.rpc);
    let names = scene.views.iter().map(|v| &v.name);
    let rpcs = names.map(rpc).collect::<Result<Vec<_>, LearnError>>()?;
    let mut setup = SiteScene::in_frame(scene, &rpcs, frame)?;
    setup.transfer_function = transfer_function;
    let is_target: Vec<bool> = setup.views.iter().map(|v| v.role == Role::Test).collect();
    setup.views.iter_mut().for_each(|v| v.role = Role::Train);
    let views = setup.training_views(scene)?.into_iter().zip(is_target);
    let (targets, context): (Vec<_>, Vec<_>) = views.partition(|(_, is_target)| *is_target);
    let alone = |views: Vec<(TrainingView, bool)>| views.into_iter().map(|(view, _)| view).collect();
    Ok((alone(context), alone(targets)))
}
