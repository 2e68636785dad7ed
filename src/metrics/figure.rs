//! The error map as a picture: red where the prediction is too high, blue where it is too low.

use crate::raster::Plane;

/// Errors of this size and more get the strongest colour, in metres.
const FULL_COLOUR_M: f32 = 3.0;
/// Colour of cells that are not scored.
const NOT_SCORED: [f32; 3] = [90.0, 90.0, 90.0];
/// ColorBrewer's RdBu from too low to too high.
const DIVERGING: [[f32; 3]; 7] = [
    [33.0, 102.0, 172.0],
    [103.0, 169.0, 207.0],
    [209.0, 229.0, 240.0],
    [247.0, 247.0, 247.0],
    [253.0, 219.0, 199.0],
    [239.0, 138.0, 98.0],
    [178.0, 24.0, 43.0],
];

/// Three bytes a cell: a diverging map of errors from -3 m (blue) over 0 (white) to 3 m (red), NaN grey.
#[must_use]
pub fn error_picture(errors: &Plane) -> Vec<u8> {
    errors.data.iter().flat_map(|e| color(*e).map(|c| c.round() as u8)).collect()
}

fn color(error_m: f32) -> [f32; 3] {
    if error_m.is_nan() {
        return NOT_SCORED;
    }
    let last = DIVERGING.len() - 1;
    let place = (error_m / FULL_COLOUR_M).clamp(-1.0, 1.0).mul_add(0.5, 0.5) * last as f32;
    let index = (place as usize).min(last - 1);
    let t = place - index as f32;
    std::array::from_fn(|i| DIVERGING[index][i] + (DIVERGING[index + 1][i] - DIVERGING[index][i]) * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_say_too_high_and_too_low() {
        let p = Plane { width: 4, height: 1, data: vec![0.0, 99.0, -3.0, f32::NAN] };
        assert_eq!(error_picture(&p), [247, 247, 247, 178, 24, 43, 33, 102, 172, 90, 90, 90]);
    }
}
