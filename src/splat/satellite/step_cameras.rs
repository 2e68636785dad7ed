//! The cameras of an iteration.

use crate::affine::{TrainingView, ViewCamera};
use crate::splat::backend::StepPlan;
use crate::splat::loss::target::camera_at;
use crate::splat::sheared_camera::{ShearedCamera, SunView};

/// The cameras of an iteration, at its resolution level.
#[derive(Clone, Copy, Debug)]
pub struct StepCameras {
    /// That of the view.
    pub camera: ViewCamera,
    /// Columns and rows of the view.
    pub size: (usize, usize),
    /// The sun; none without shadows.
    pub sun: Option<SunView<f32>>,
    /// The virtual view, if the iteration has one.
    pub virtual_view: Option<ShearedCamera<f32>>,
}

impl StepCameras {
    /// Of an iteration on a view. `altitudes` are the lowest and highest of the scene, metres.
    #[must_use]
    pub fn new(view: &TrainingView, plan: &StepPlan, altitudes: (f64, f64)) -> Self {
        let (camera, size) = camera_at(view, plan.level);
        let scale = 0.5f64.powi(plan.level as i32);
        let sun = view.sun_shear.filter(|_| plan.shadows).map(|shear| shear.map(|s| s * scale));
        let [across, down] = half_sides(size);
        let virtual_shear = plan.virtual_shear.map(|[x, y]| [x * across, y * down]);
        Self {
            camera,
            size,
            sun: sun.map(|shear| SunView::new(&camera, size, shear, altitudes)),
            virtual_view: virtual_shear.map(|shear| ShearedCamera::virtual_view(&camera, size, shear)),
        }
    }

    /// Half of the view's columns and rows.
    #[must_use]
    pub fn half_sides(&self) -> [f64; 2] {
        half_sides(self.size)
    }

    /// Pixels of the view for a metre of level ground, and pixels of its longer side.
    #[must_use]
    pub fn scale(&self) -> (f64, f64) {
        (1.0 / self.camera.gsd_m(), self.size.0.max(self.size.1) as f64)
    }
}

fn half_sides((width, height): (usize, usize)) -> [f64; 2] {
    [width, height].map(|n| 0.5 * n as f64)
}
