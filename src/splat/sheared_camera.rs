//! Cameras of the sun's image and of virtual views: a view's camera with a shear.

use super::raster::FrameCamera;
use super::shear_warp::ShearWarp;
use crate::affine::ViewCamera;
use crate::camera::QuadraticKernel;
use crate::simd::Real;

/// A view's camera with a shear, and the map from the view's pixels to its image.
#[derive(Clone, Copy, Debug)]
pub struct ShearedCamera<T> {
    /// The camera and its image size.
    pub camera: FrameCamera<QuadraticKernel<T>>,
    /// The map from the view's pixels to the image.
    pub warp: ShearWarp<T>,
}

/// The scene as the sun sees it.
#[derive(Clone, Copy, Debug)]
pub struct SunView<T> {
    /// The camera of the sun's image.
    pub image: ShearedCamera<T>,
    /// Unit vector to the sun in site axes.
    pub direction: [T; 3],
}

impl<T: Real> SunView<T> {
    /// The sun's image that is large enough for all pixels of a view at altitudes from `low` to `high`, metres. `size` is
    /// (columns, rows) of the view, `shear` that of the view's camera towards the sun, pixels per metre of altitude.
    #[must_use]
    pub fn new(view: &ViewCamera, size: (usize, usize), shear: [f64; 2], (low, high): (f64, f64)) -> Self {
        let axis = |s: f64, n: usize| {
            let (a, b) = ((-s * low).min(-s * high), (-s * low).max(-s * high));
            let origin = a.floor();
            (origin, n + (b - origin).ceil() as usize + 1)
        };
        let ((col, width), (row, height)) = (axis(shear[0], size.0), axis(shear[1], size.1));
        let image = ShearedCamera {
            camera: FrameCamera::new(&view.sheared(shear).cropped(col, row), width, height),
            warp: ShearWarp { shear: shear.map(T::from_f64), origin: [T::from_f64(col), T::from_f64(row)] },
        };
        Self { image, direction: view.direction_of(shear).map(T::from_f64) }
    }
}

impl<T: Real> ShearedCamera<T> {
    /// The camera of a virtual view, for the random-shear consistency loss: of the view's `size` (columns, rows), with
    /// `shear` in pixels per metre of altitude. Points at the altitude of the site's origin keep their place.
    #[must_use]
    pub fn virtual_view(view: &ViewCamera, size: (usize, usize), shear: [f64; 2]) -> Self {
        Self {
            camera: FrameCamera::new(&view.sheared(shear), size.0, size.1),
            warp: ShearWarp { shear: shear.map(T::from_f64), origin: [T::zero(); 2] },
        }
    }
}
