//! QGIS layer styles: files with the name of a raster and the extension `.qml`, which QGIS applies automatically.

/// The text of a QGIS style that colours the first band, in metres. `stops` are values in ascending order with their
/// colours (red, green, blue); colours between them are interpolated.
#[must_use]
pub fn color_style(stops: &[(f32, [u8; 3])]) -> String {
    let item = |(value, [r, g, b]): &(f32, [u8; 3])| {
        format!(
            "          <item value=\"{value}\" label=\"{value} m\" color=\"#{r:02x}{g:02x}{b:02x}\" alpha=\"255\"/>\n"
        )
    };
    let items: String = stops.iter().map(item).collect();
    let [low, high] = [stops.first(), stops.last()].map(|stop| stop.map_or(0.0, |s| s.0));
    format!(
        r#"<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22" styleCategories="Symbology">
  <pipe>
    <rasterrenderer type="singlebandpseudocolor" band="1" opacity="1" alphaBand="-1"
      classificationMin="{low}" classificationMax="{high}">
      <rastershader>
        <colorrampshader colorRampType="INTERPOLATED" classificationMode="1" clip="0"
          minimumValue="{low}" maximumValue="{high}">
{items}        </colorrampshader>
      </rastershader>
    </rasterrenderer>
  </pipe>
</qgis>
"#
    )
}
