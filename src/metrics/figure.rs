//! Differences of heights as an image and as a QGIS style: red where the prediction is too high, blue where it is too low.

use crate::io::{Grid2, RgbImage, color_style, round_below};

/// Absolute error from which on colours are saturated, metres.
const FULL_COLOUR_M: f32 = 3.0;
/// Longest side of the image, pixels.
const LARGEST_SIDE: usize = 2048;
/// Side of a map that is large enough without enlargement, pixels.
const SMALLEST_SIDE: usize = 700;
/// Width of the scale of colours, its height, the margins, and the height of all that stands below the map, pixels.
const SCALE_PX: usize = 480;
const BAR_PX: usize = 18;
const MARGIN_PX: usize = 16;
const FOOT_PX: usize = BAR_PX + 2 * RgbImage::TEXT_HEIGHT + MARGIN_PX;
/// Largest share of the map's width that the scale of lengths takes.
const SCALE_SHARE: f64 = 0.25;
/// Colour of cells that are not scored.
const NOT_SCORED: [f32; 3] = [90.0, 90.0, 90.0];
/// Colour map RdBu of ColorBrewer, from too low to too high.
const DIVERGING: [[f32; 3]; 7] = [
    [33.0, 102.0, 172.0],
    [103.0, 169.0, 207.0],
    [209.0, 229.0, 240.0],
    [247.0, 247.0, 247.0],
    [253.0, 219.0, 199.0],
    [239.0, 138.0, 98.0],
    [178.0, 24.0, 43.0],
];

/// The image of an error map in metres: from -3 m (blue) over 0 (white) to 3 m (red), NaN grey. Large maps are
/// downsampled by leaving out cells.
#[must_use]
pub fn error_picture(errors: &Grid2) -> RgbImage {
    let step = errors.width.max(errors.height).div_ceil(LARGEST_SIDE).max(1);
    let (width, height) = (errors.width.div_ceil(step), errors.height.div_ceil(step));
    let at = |i: usize| errors.at(i % width * step, i / width * step);
    let data = (0..width * height).flat_map(|i| color(at(i)).map(|c| c.round() as u8)).collect();
    RgbImage { width, height, data }
}

/// What the ends of the scale of colours mean.
pub struct ScaleWords {
    /// After the length at the blue end.
    pub below: &'static str,
    /// After the length at the red end.
    pub above: &'static str,
    /// Of cells without a value.
    pub missing: &'static str,
}

/// The words of errors.
pub const ERRORS: ScaleWords = ScaleWords { below: "too low", above: "too high", missing: "not scored" };

/// An error map with its scale: [`error_picture`], enlarged if the map is small, over a scale of the colours
/// and of lengths. `cell_m` is the side of a cell on the ground, metres.
#[must_use]
pub fn error_figure(errors: &Grid2, cell_m: f64, words: &ScaleWords) -> RgbImage {
    let map = error_picture(errors);
    let by = SMALLEST_SIDE.div_ceil(map.width.max(map.height).max(1)).max(1);
    let (wide, high) = (map.width * by, map.height * by);
    let mut out = RgbImage::white(wide.max(SCALE_PX) + 2 * MARGIN_PX, high + 3 * MARGIN_PX + FOOT_PX);
    for row in 0..map.height {
        for col in 0..map.width {
            out.fill((MARGIN_PX + col * by, MARGIN_PX + row * by), (by, by), map.at(col, row));
        }
    }
    // The colours, with their meaning.
    let (left, top) = (MARGIN_PX, high + 2 * MARGIN_PX);
    for i in 0..SCALE_PX {
        let error = FULL_COLOUR_M * (2.0 * i as f32 / (SCALE_PX - 1) as f32 - 1.0);
        out.fill((left + i, top), (1, BAR_PX), color(error).map(|c| c.round() as u8));
    }
    let below = top + BAR_PX + 4;
    out.write_text((left, below), &format!("{FULL_COLOUR_M} m {}", words.below));
    out.write_text((left + (SCALE_PX - RgbImage::text_width("0")) / 2, below), "0");
    let text = format!("{FULL_COLOUR_M} m {}", words.above);
    out.write_text((left + SCALE_PX - RgbImage::text_width(&text), below), &text);
    // A length on the ground and the colour of what is not scored.
    let px_m = cell_m * (errors.width as f64 / wide.max(1) as f64);
    let metres = round_below(SCALE_SHARE * wide as f64 * px_m);
    let second = below + RgbImage::TEXT_HEIGHT + MARGIN_PX / 2;
    let length = (metres / px_m).round() as usize;
    out.fill((left, second + RgbImage::TEXT_HEIGHT / 2), (length, 3), [28, 30, 33]);
    out.write_text((left + length + 8, second), &format!("{metres} m"));
    let at = left + SCALE_PX - RgbImage::text_width(words.missing);
    out.fill((at - BAR_PX - 8, second), (BAR_PX, BAR_PX), NOT_SCORED.map(|c| c as u8));
    out.write_text((at, second), words.missing);
    out
}

/// The text of a QGIS style for an error map, in the colours of [`error_picture`].
#[must_use]
pub fn error_style() -> String {
    let last = (DIVERGING.len() - 1) as f32;
    let value = |i: usize| FULL_COLOUR_M * (2.0 * i as f32 - last) / last;
    let stops = DIVERGING.iter().enumerate().map(|(i, color)| (value(i), color.map(|c| c as u8)));
    color_style(&stops.collect::<Vec<_>>())
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
    fn errors_are_red_if_too_high_and_blue_if_too_low() {
        let p = Grid2 { width: 4, height: 1, data: vec![0.0, 99.0, -3.0, f32::NAN] };
        assert_eq!(error_picture(&p).data, [247, 247, 247, 178, 24, 43, 33, 102, 172, 90, 90, 90]);
    }

    #[test]
    fn the_figure_is_large_enough_and_holds_the_map_and_its_scale() {
        let figure = error_figure(&Grid2::filled(140, 136, 3.0), 0.5, &ERRORS);
        assert_eq!((figure.width, figure.height), (5 * 140 + 32, 5 * 136 + 48 + FOOT_PX));
        assert_eq!(figure.at(MARGIN_PX + 300, MARGIN_PX + 300), [178, 24, 43]);
        assert_eq!(figure.at(MARGIN_PX, 5 * 136 + 2 * MARGIN_PX), [33, 102, 172]);
        let large = error_figure(&Grid2::filled(3000, 20, f32::NAN), 0.5, &ERRORS);
        assert_eq!(large.width, 1500 + 32);
    }

    #[test]
    fn a_large_map_makes_a_picture_of_bounded_size() {
        let picture = error_picture(&Grid2::filled(5000, 20, 0.0));
        assert_eq!((picture.width, picture.height, picture.data.len()), (1667, 7, 3 * 1667 * 7));
    }

    #[test]
    fn the_style_is_symmetric_xml() {
        let text = error_style();
        let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
        let xml = roxmltree::Document::parse_with_options(&text, options).unwrap();
        let values: Vec<f32> = xml
            .descendants()
            .filter(|n| n.has_tag_name("item"))
            .map(|n| n.attribute("value").unwrap().parse().unwrap())
            .collect();
        assert_eq!(values, [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0]);
    }
}
