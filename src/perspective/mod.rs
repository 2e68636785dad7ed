//! Perspective cameras and scenes: the pinhole camera and its kernel for the rasteriser, lenses and the removal of their
//! distortion, and the readers of scenes: COLMAP, `transforms.json`, RGB-D frames, LEVIR-NVS, ScanNet++.

pub mod colmap;
mod companions;
mod draft;
mod error;
mod from_depths;
mod georeference;
mod georeference_source;
mod jpeg;
mod kernel;
mod lens;
mod levir;
mod mask_file;
mod options;
mod pinhole;
mod point_normals;
mod pose;
mod registration;
mod rgbd;
mod scannetpp;
mod scene;
mod scene_parts;
mod similarity;
mod similarity_fit;
mod stated_position;
mod transforms;
mod transparency;
mod undistort;
mod view;
mod words;

pub use error::PerspectiveError;
pub use from_depths::points_from_depths;
pub use georeference::{Georeference, PositionFit};
pub use kernel::PinholeKernel;
pub use lens::{LensCamera, LensModel};
pub use mask_file::MaskFile;
pub use options::{GeoreferenceSource, PerspectiveOptions, TEST_EVERY, TestViews};
pub use pinhole::PinholeCamera;
pub use point_normals::point_normals;
pub use registration::ColorRegistration;
pub use scene::PerspectiveScene;
pub use scene_parts::{Layout, ScenePoint};
pub use similarity::SimilarityTransform;
pub use similarity_fit::{DirectionPair, PointPair, SimilarityFit};
pub use transparency::Transparency;
pub use view::{DepthFile, PerspectiveView, SensorCamera, ViewImage};
