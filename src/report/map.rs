//! Pictures of maps with what a reader needs: the scale, north, and a legend with the unit.

use super::ReportError;
use super::pictures::img;
use crate::dsm::{HeightScale, hillshade, is_confirmed};
use crate::io::{Grid2, MapGrid, escape_xml, round_below};
use std::fmt::Write;

/// Colour of cells without a height.
const NOTHING: [u8; 3] = [190, 190, 190];
/// Colours of cells by the views that confirm them: filled in, two views, three, four or more (Okabe and Ito).
const CONFIDENCE: [([u8; 3], &str); 4] = [
    ([230, 159, 0], "filled in"),
    ([166, 206, 227], "2 views"),
    ([86, 150, 214], "3 views"),
    ([8, 69, 148], "4 or more"),
];
/// Brightness of slopes in full shadow.
const DARKEST: f32 = 0.35;
/// Largest share of the map's width that the scale takes.
const SCALE_SHARE: f64 = 0.3;

/// A figure of a map: its picture, below it scale, north and legend, and its caption.
pub(super) fn figure(picture: &str, grid: &MapGrid, legend: &str, caption: &str) -> String {
    let wide = grid.width as f64 * grid.cell;
    let metres = round_below(SCALE_SHARE * wide);
    let length = if metres >= 1000.0 { format!("{} km", metres / 1000.0) } else { format!("{metres} m") };
    format!(
        "<figure class=\"map\">{picture}\n<div class=\"ground\"><span class=\"bar\" style=\"width:{:.2}%\">{length}</span>\
         <span>north is up</span></div>\n{legend}<figcaption>{}</figcaption></figure>\n",
        100.0 * metres / wide,
        escape_xml(caption)
    )
}

/// A picture of heights in metres, in colours under a light from the north-west.
pub(super) fn relief(heights: &Grid2, grid: &MapGrid, alt: &str) -> Result<String, ReportError> {
    let scale = HeightScale::of(heights);
    let shades = hillshade(heights, grid.cell);
    let pixel = |(height, shade): (&f32, &u8)| {
        if height.is_nan() {
            return NOTHING;
        }
        let light = DARKEST + (1.0 - DARKEST) * f32::from(*shade) / 255.0;
        scale.color(*height).map(|c| (f32::from(c) * light).round() as u8)
    };
    let rgb: Vec<u8> = heights.data.iter().zip(&shades).flat_map(pixel).collect();
    Ok(img(grid.width, grid.height, &rgb, alt, "")?)
}

/// A picture of an orthophoto, whose values are bytes.
pub(super) fn colors(bands: &[Grid2], grid: &MapGrid, alt: &str) -> Result<String, ReportError> {
    let pixel = |i: usize| {
        let of = |band: usize| {
            bands.get(band.min(bands.len().saturating_sub(1))).map_or(f32::NAN, |band| band.data[i])
        };
        let values = [of(0), of(1), of(2)];
        if values.iter().any(|v| v.is_nan()) { NOTHING } else { values.map(|v| v.round() as u8) }
    };
    let rgb: Vec<u8> = (0..grid.width * grid.height).flat_map(pixel).collect();
    Ok(img(grid.width, grid.height, &rgb, alt, "")?)
}

/// The legend of [`relief`]; `unit` is the unit with the vertical reference.
pub(super) fn height_legend(heights: &Grid2, unit: &str) -> String {
    let HeightScale { low, high } = HeightScale::of(heights);
    let digits = usize::from(high - low < 10.0);
    ramp(&HeightScale::COLORS, &[low, 0.5 * (low + high), high].map(|h| format!("{h:.digits$}")), unit)
}

/// A legend of colours that change evenly: the texts stand at its ends and its middle.
pub(super) fn ramp(colors: &[[u8; 3]], texts: &[String; 3], unit: &str) -> String {
    let stops: Vec<String> = colors.iter().map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
    format!(
        "<div class=\"legend\"><div>{}</div><div class=\"ramp\" style=\"background:linear-gradient(to right,{})\"></div>\
         <div class=\"ticks\"><span>{}</span><span>{}</span><span>{}</span></div></div>\n",
        escape_xml(unit),
        stops.join(","),
        texts[0],
        texts[1],
        texts[2]
    )
}

/// A picture of what heights rest on, from heights and the numbers of views that see the cells, and its legend.
pub(super) fn confidence(heights: &Grid2, views: &Grid2, grid: &MapGrid) -> Result<String, ReportError> {
    let pixel = |(height, views): (&f32, &f32)| match views {
        _ if height.is_nan() || views.is_nan() => NOTHING,
        // Averages of several cells count as what most of them are.
        views if is_confirmed(views.round()) => {
            CONFIDENCE[(views.round() as usize - 1).min(CONFIDENCE.len() - 1)].0
        }
        _ => CONFIDENCE[0].0,
    };
    let rgb: Vec<u8> = heights.data.iter().zip(&views.data).flat_map(pixel).collect();
    let alt = "Map of the cells: filled in, or confirmed by two, three, four or more views";
    let mut legend = String::from("<div class=\"legend swatches\">");
    for ([r, g, b], text) in CONFIDENCE.iter().chain([&(NOTHING, "no height")]) {
        let _ = write!(legend, "<span><i style=\"background:rgb({r},{g},{b})\"></i>{text}</span>");
    }
    legend.push_str("</div>\n");
    let caption = "Number of views that see each cell; heights that fewer than two views see are filled in from their surroundings";
    Ok(figure(&img(grid.width, grid.height, &rgb, alt, "")?, grid, &legend, caption))
}
