//! Hillshades.

use crate::io::Grid2;

/// Hillshade of heights on a grid of cells of `cell_m` metres, lit from the north-west: values from 0 to 254, row by row;
/// 255 where there is no height.
///
/// `height` is in metres, NaN where there is none.
#[must_use]
pub fn hillshade(height: &Grid2, cell_m: f64) -> Vec<u8> {
    // Unit vector towards a light at azimuth 315° and elevation 45°, as is usual on maps.
    let light = [-0.5f32, 0.5, std::f32::consts::FRAC_1_SQRT_2];
    let cell = cell_m as f32;
    let at = |c: i64, r: i64| {
        height.get(c.clamp(0, height.width as i64 - 1), r.clamp(0, height.height as i64 - 1))
    };
    let mut out = Vec::with_capacity(height.data.len());
    for row in 0..height.height as i64 {
        for col in 0..height.width as i64 {
            let east = (at(col + 1, row) - at(col - 1, row)) / (2.0 * cell);
            let north = (at(col, row - 1) - at(col, row + 1)) / (2.0 * cell);
            let shade =
                (light[2] - light[0] * east - light[1] * north) / (1.0 + east * east + north * north).sqrt();
            out.push(if shade.is_nan() { 255 } else { (shade.clamp(0.0, 1.0) * 254.0) as u8 });
        }
    }
    out
}
