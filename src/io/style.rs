//! QGIS styles of rasters: files with the name of a raster and the extension `.qml`, which QGIS applies automatically, and the
//! `<pipe>` elements in them and in layer definitions, which say how a raster is drawn.

use std::fmt::Display;

/// Colours (red, green, blue) of values in ascending order; colours between them are interpolated.
pub type ColorStops = [(f32, [u8; 3])];

/// The text of a QGIS style that colours the first band, in metres.
#[must_use]
pub fn color_style(stops: &ColorStops) -> String {
    format!(
        "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n<qgis version=\"3.22\" styleCategories=\"Symbology\">\n{}</qgis>\n",
        color_pipe(1, " m", stops)
    )
}

/// The drawing of a band, from 1, in colours; the legend has the `unit` after each value.
#[must_use]
pub fn color_pipe(band: usize, unit: impl Display, stops: &ColorStops) -> String {
    let item = |(value, [r, g, b]): &(f32, [u8; 3])| {
        format!(
            "          <item value=\"{value}\" label=\"{value}{unit}\" color=\"#{r:02x}{g:02x}{b:02x}\" alpha=\"255\"/>\n"
        )
    };
    let items: String = stops.iter().map(item).collect();
    let [low, high] = [stops.first(), stops.last()].map(|stop| stop.map_or(0.0, |s| s.0));
    format!(
        r#"  <pipe>
    <rasterrenderer type="singlebandpseudocolor" band="{band}" opacity="1" alphaBand="-1"
      classificationMin="{low}" classificationMax="{high}">
      <rastershader>
        <colorrampshader colorRampType="INTERPOLATED" classificationMode="1" clip="0"
          minimumValue="{low}" maximumValue="{high}">
{items}        </colorrampshader>
      </rastershader>
    </rasterrenderer>
  </pipe>
"#
    )
}

/// The drawing of heights as a shaded relief, lit from the north-west.
#[must_use]
pub fn relief_pipe() -> String {
    r#"  <pipe>
    <rasterrenderer type="hillshade" band="1" opacity="1" alphaBand="-1" azimuth="315" angle="45" zfactor="1" multidirection="0"/>
  </pipe>
"#
    .into()
}

/// The drawing of the first three bands as red, green and blue.
#[must_use]
pub fn picture_pipe() -> String {
    r#"  <pipe>
    <rasterrenderer type="multibandcolor" redBand="1" greenBand="2" blueBand="3" opacity="1" alphaBand="-1"/>
  </pipe>
"#
    .into()
}

/// The drawing that a style says; none if the text is no style.
#[must_use]
pub fn pipe_of_style(style: &str) -> Option<&str> {
    const END: &str = "</pipe>";
    let (start, end) = (style.find("<pipe>")?, style.find(END)?);
    style.get(start..end + END.len())
}
