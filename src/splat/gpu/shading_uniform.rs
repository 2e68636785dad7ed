//! The uniform of a satellite view's pixels: `Shading` in `wgsl/shading.wgsl`.

use crate::nn::adam::AdamStep;
use crate::splat::loss::Prior;
use crate::splat::shear_warp::ShearWarp;
use std::sync::Arc;

/// What the kernels of a satellite view's pixels are told.
pub struct ShadingUniform {
    /// The map to the sun's image, and its columns and rows; none without shadows.
    pub sun: Option<(ShearWarp<f32>, [usize; 2])>,
    /// The map to the virtual view.
    pub virtual_view: Option<ShearWarp<f32>>,
    /// Resolution level.
    pub level: usize,
    /// Columns of the view's image.
    pub photograph_columns: usize,
    /// Derivative of the loss by the sum of entropies.
    pub by_entropy: f64,
    /// Weights of the mean differences from the virtual view: of colours, and of altitudes (per metre).
    pub by_color: f64,
    /// See [`ShadingUniform::by_color`].
    pub by_altitude: f64,
    /// Derivative of the loss by the sum of robust distances from the prior's surface.
    pub by_distance: f64,
    /// The prior.
    pub prior: Option<Arc<Prior>>,
    /// The step of the colour model.
    pub appearance: AdamStep,
    /// Number of anchored splats.
    pub anchored: usize,
}

impl ShadingUniform {
    /// Words of `Shading`.
    pub const WORDS: usize = 24;

    /// The bytes of `Shading`, as words.
    pub fn words(&self) -> [u32; Self::WORDS] {
        let mut out = [0; Self::WORDS];
        let mut put = |at: usize, values: &[f32]| {
            out[at..at + values.len()].iter_mut().zip(values).for_each(|(out, v)| *out = v.to_bits());
        };
        for (at, warp) in [(0, self.sun.map(|sun| sun.0)), (4, self.virtual_view)] {
            if let Some(ShearWarp { shear, origin }) = warp {
                put(at, &shear);
                put(at + 2, &origin);
            }
        }
        let weights = [self.by_entropy, self.by_color, self.by_altitude, self.by_distance];
        put(12, &weights.map(|v| v as f32));
        put(21, &[self.appearance.rate(), self.appearance.root_second()]);
        if let Some(cells) = self.prior.as_ref().map(|prior| prior.cells()) {
            put(16, &cells.corner.map(|v| v as f32));
            put(20, &[cells.cell_m as f32]);
            out[18..20].copy_from_slice(&[cells.size.0 as u32, cells.size.1 as u32]);
        }
        if let Some((_, [columns, rows])) = self.sun {
            out[8..10].copy_from_slice(&[columns as u32, rows as u32]);
        }
        out[10..12].copy_from_slice(&[self.level as u32, self.photograph_columns as u32]);
        out[23] = self.anchored as u32;
        out
    }
}
