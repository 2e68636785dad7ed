//! Perspective scenes, and the choice of the reader.

use super::companions::unused_companions;
use super::draft::Drafts;
use super::error::PerspectiveError;
use super::georeference::Georeference;
use super::georeference_source::georeference;
use super::options::PerspectiveOptions;
use super::registration::{ColorRegistration, RejectedRegistration};
use super::scene_parts::{Layout, ScenePoint};
use super::transparency::Transparency;
use super::view::PerspectiveView;
use super::{colmap, levir, rgbd, scannetpp, transforms};
use crate::frame::Point;
use crate::io::vsi;
use crate::scene::{Found, Role};
use crate::stats::median;
use glam::DVec3;
use std::path::Path;

/// What a perspective scene holds.
const EXPECTED: &str = "expected a COLMAP project (cameras.bin or cameras.txt, in the folder, in `sparse` or in `sparse/0`), a transforms.json (or \
     transforms_train.json), an RGB-D folder with camera-intrinsics.txt, a scene of LEVIR-NVS (`Images` and `Cams`) or of \
     ScanNet++ (`dslr/colmap` and `dslr/resized_images`)";

/// Largest spacing of coordinates of single precision as a share of the extent of the cameras.
const COARSEST: f64 = 1e-4;

/// Photographs of one place, with pinhole cameras.
///
/// With a georeference, the frame of all positions is the site frame: metres east, north and up from an origin near the
/// middle of the scene. Without one it is the frame of the file, whose axes and unit may be any, less [`PerspectiveScene::origin`].
#[derive(Clone, Debug, PartialEq)]
pub struct PerspectiveScene {
    /// How its files are arranged.
    pub layout: Layout,
    /// The views, ordered by the names of their images.
    pub views: Vec<PerspectiveView>,
    /// The points that the scene comes with.
    pub points: Vec<ScenePoint>,
    /// Where the scene lies on Earth, if that is known.
    pub georeference: Option<Georeference>,
    /// Place in the frame of the file from which positions are measured; none for its origin.
    pub origin: Option<[f64; 3]>,
    /// Images and files that were left out, and why.
    pub skipped: Vec<(String, String)>,
    /// Keys and files of the scene that are not used, and why.
    pub unused: Vec<(String, String)>,
    /// The colour camera of RGB-D frames, if it was found to be another one than that of the depth maps.
    pub registration: Option<ColorRegistration>,
    /// Two cameras of RGB-D frames that edges suggest and matched features do not confirm; they are not used.
    pub rejected_registration: Option<RejectedRegistration>,
}

impl PerspectiveScene {
    /// Whether a path is a perspective scene, by the names of its files alone.
    #[must_use]
    pub fn is_one(path: &Path) -> bool {
        layout_of(path).is_some()
    }

    /// Refuses a perspective scene where one of satellite images is needed.
    ///
    /// # Errors
    /// [`PerspectiveError::NotSatellite`] if the path is a perspective scene.
    pub fn require_satellite(path: &Path) -> Result<(), PerspectiveError> {
        let refused =
            |layout: Layout| PerspectiveError::NotSatellite { path: path.into(), layout: layout.name() };
        layout_of(path).map_or(Ok(()), |layout| Err(refused(layout)))
    }

    /// Reads a scene: its cameras and points. Pixels are read when they are needed
    /// ([`PerspectiveView::read_image`]).
    ///
    /// # Errors
    /// [`PerspectiveError`] if the path is no perspective scene, a file is missing or damaged, an image is not of the size
    /// of its camera, or the georeference cannot be determined.
    pub fn read(path: &Path, options: &PerspectiveOptions) -> Result<Self, PerspectiveError> {
        let mut scene = Self::read_as_stated(path, options)?;
        if scene.layout == Layout::RgbD {
            match ColorRegistration::find(&scene.views) {
                Ok(found) => scene.registration = found,
                Err(rejected) => scene.rejected_registration = Some(rejected),
            }
        }
        Ok(scene.registered())
    }

    /// As [`PerspectiveScene::read`], with the colour camera that an earlier reading found.
    ///
    /// # Errors
    /// As [`PerspectiveScene::read`].
    pub fn read_again(
        path: &Path,
        options: &PerspectiveOptions,
        registration: Option<ColorRegistration>,
    ) -> Result<Self, PerspectiveError> {
        Ok(Self { registration, ..Self::read_as_stated(path, options)? }.registered())
    }

    /// With the colour camera that was found.
    fn registered(mut self) -> Self {
        if let Some(registration) = &self.registration {
            self.views.iter_mut().for_each(|view| registration.apply(view));
        }
        self
    }

    fn read_as_stated(path: &Path, options: &PerspectiveOptions) -> Result<Self, PerspectiveError> {
        let mut drafts = read_drafts(path)?;
        if let (true, Some((first, reason))) = (drafts.views.is_empty(), drafts.skipped.first()) {
            let (first, reason) = (first.clone(), reason.clone());
            let images = drafts.skipped.len();
            return Err(PerspectiveError::AllLeftOut { path: path.into(), images, first, reason });
        }
        if drafts.views.is_empty() {
            return Err(PerspectiveError::NoViews {
                path: path.into(),
                hint: "a view is an image with its camera and pose",
            });
        }
        let (layout, mut points) = (drafts.layout, std::mem::take(&mut drafts.points));
        let positions: Vec<DVec3> = points.iter().map(|p| DVec3::from_array(p.position.xyz())).collect();
        let source = options.georeference.as_ref();
        let georeference =
            source.map(|source| georeference(path, source, &drafts.views, &positions)).transpose()?;
        if let Some(georeference) = &georeference {
            for point in &mut points {
                point.position = georeference.site_from_file(point.position.xyz());
            }
        }
        let skipped = std::mem::take(&mut drafts.skipped);
        let mut unused = std::mem::take(&mut drafts.unused);
        unused.extend(unused_companions(path, &drafts));
        let views = drafts.views(options, georeference.as_ref())?;
        Ok(Self {
            layout,
            views,
            points,
            georeference,
            origin: None,
            skipped,
            unused,
            registration: None,
            rejected_registration: None,
        })
    }

    /// Whether positions are in metres: the scene has a georeference, or depth maps in metres.
    #[must_use]
    pub fn is_metric(&self) -> bool {
        self.georeference.is_some() || matches!(self.layout, Layout::RgbD | Layout::Levir | Layout::ScanNetPp)
    }

    /// The scene with positions from a place among its cameras, on whole units, if they are too large: splats have coordinates of
    /// single precision.
    #[must_use]
    pub fn near_origin(self) -> Self {
        let centers: Vec<DVec3> = self.views.iter().map(|v| v.camera.center).collect();
        let middle = |k: usize| median(centers.iter().map(|c| c[k]).collect()).unwrap_or(0.0).round();
        let origin = DVec3::new(middle(0), middle(1), middle(2));
        let farthest = centers.iter().map(|c| c.abs().max_element()).fold(0.0, f64::max);
        let apart = centers.iter().map(|c| c.distance(origin)).fold(0.0, f64::max);
        let extent = if centers.len() > 1 { apart } else { 1.0 };
        let is_far = self.georeference.is_none() && farthest * f64::from(f32::EPSILON) > COARSEST * extent;
        if is_far && origin != DVec3::ZERO { self.measured_from(origin.to_array()) } else { self }
    }

    /// The scene with positions from a place in the frame of its file.
    #[must_use]
    pub fn measured_from(mut self, origin: [f64; 3]) -> Self {
        let by = DVec3::from_array(origin);
        for point in &mut self.points {
            let [x, y, z] = (DVec3::from_array(point.position.xyz()) - by).to_array();
            point.position = Point::new(x, y, z);
        }
        self.views.iter_mut().for_each(|view| view.camera.center -= by);
        Self { origin: Some(origin), ..self }
    }

    /// A note on positions whose origin is not that of the file.
    #[must_use]
    pub fn moved(&self) -> Option<String> {
        let [x, y, z] = self.origin?;
        Some(format!(
            "coordinates are too large for single precision: positions are those of the file less ({x}, {y}, {z})"
        ))
    }

    /// How many images have transparent pixels, and what these mean; none without such images.
    #[must_use]
    pub fn transparency(&self) -> Option<(usize, Transparency)> {
        let meanings: Vec<Transparency> = self.views.iter().filter_map(|view| view.transparency).collect();
        Some((meanings.len(), *meanings.first()?))
    }

    /// Lowest and highest coordinates of the points and the camera centres.
    #[must_use]
    pub fn extent(&self) -> Option<[[f64; 3]; 2]> {
        let points = self.points.iter().map(|p| DVec3::from_array(p.position.xyz()));
        let all = points.chain(self.views.iter().map(|v| v.camera.center));
        let both = all.map(|p| (p, p)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        Some([both.0.to_array(), both.1.to_array()])
    }

    /// How well the points of the COLMAP model at a path fit its images; none for other scenes and models without tracks.
    ///
    /// # Errors
    /// [`PerspectiveError`] if the model cannot be read.
    pub fn reprojection(path: &Path) -> Result<Option<colmap::Reprojection>, PerspectiveError> {
        let project = colmap::project(path);
        Ok(project.map(|p| colmap::read(&p.model)).transpose()?.and_then(|model| model.reprojection()))
    }

    /// Views that may be trained on.
    pub fn training(&self) -> impl Iterator<Item = &PerspectiveView> {
        self.views.iter().filter(|v| v.role == Role::Train)
    }
}

/// The layout of a scene, by the names of its files. Remote folders are not searched: every name that is tried there is a request.
fn layout_of(path: &Path) -> Option<Layout> {
    if vsi::is_remote(path) {
        None
    } else if colmap::is_project(path) {
        Some(Layout::Colmap)
    } else if transforms::file_of(path).is_some() {
        Some(Layout::Transforms)
    } else if rgbd::is_one(path) {
        Some(Layout::RgbD)
    } else if levir::is_one(path) {
        Some(Layout::Levir)
    } else if scannetpp::part_of(path).is_some() {
        Some(Layout::ScanNetPp)
    } else {
        None
    }
}

fn read_drafts(path: &Path) -> Result<Drafts, PerspectiveError> {
    let no_layout = || {
        let found = Found::at(path);
        let next_step = found.next_step().unwrap_or_else(|| EXPECTED.into());
        PerspectiveError::NoLayout { path: path.into(), found: found.clause(), next_step }
    };
    match layout_of(path).ok_or_else(no_layout)? {
        Layout::Colmap => colmap::read_project(&colmap::project(path).ok_or_else(no_layout)?),
        Layout::Transforms => transforms::read(&transforms::file_of(path).ok_or_else(no_layout)?),
        Layout::RgbD => rgbd::read(path),
        Layout::Levir => levir::read(path),
        Layout::ScanNetPp => scannetpp::read(&scannetpp::part_of(path).ok_or_else(no_layout)?),
    }
}
