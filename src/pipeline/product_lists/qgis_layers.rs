//! The rasters of a run as QGIS layers with their styles, `RUN/layers.qlr`: one file to drag onto a map.

use super::super::PipelineError;
use crate::dsm::{EXPECTED_ERROR_BAND, VIEWS_BAND};
use crate::io::{
    ImageFile, color_pipe, picture_pipe, pipe_of_style, relief_pipe, remove_if_there, write_file,
};
use crate::run_files::{ABOVE_GROUND, CONFIDENCE, DSM, ERROR_MAP, EVALUATION, GROUND, LAYERS, ORTHO};
use std::path::Path;

/// Colours of expected errors, metres.
const EXPECTED_ERRORS: [(f32, [u8; 3]); 4] =
    [(0.0, [255, 255, 229]), (0.5, [254, 217, 118]), (1.0, [253, 141, 60]), (3.0, [177, 0, 38])];
/// Colours of numbers of views: nothing is confirmed by less than two.
const VIEWS: [(f32, [u8; 3]); 4] =
    [(0.0, [178, 24, 43]), (1.0, [244, 165, 130]), (2.0, [209, 229, 240]), (10.0, [33, 102, 172])];
/// QGIS's numbers of how a layer is drawn over those below it.
const BLEND_NORMAL: u8 = 0;
const BLEND_MULTIPLY: u8 = 6;

/// How a layer is drawn.
enum Drawing {
    /// By the style file beside the raster.
    Style,
    /// By this `<pipe>`.
    Pipe(String),
}

struct Layer {
    id: &'static str,
    name: &'static str,
    file: String,
    drawing: Drawing,
    blend: u8,
    is_shown: bool,
}

/// Writes `RUN/layers.qlr` of the rasters that are there; there is none without a surface model.
pub(super) fn write_layers(run: &Path) -> Result<(), PipelineError> {
    let (path, dsm) = (run.join(LAYERS), run.join(DSM));
    if !dsm.exists() {
        return Ok(remove_if_there(&path)?);
    }
    let epsg = ImageFile::open(&dsm)?.map_grid()?.epsg;
    let there = layers().into_iter().filter(|layer| run.join(&layer.file).exists());
    let drawn = there.filter_map(|layer| Some((pipe(run, &layer)?, layer)));
    let (mut tree, mut maps) = (String::new(), String::new());
    for (pipe, Layer { id, name, file, blend, is_shown, .. }) in drawn {
        let checked = if is_shown { "Qt::Checked" } else { "Qt::Unchecked" };
        tree += &format!(
            "    <layer-tree-layer id=\"{id}\" name=\"{name}\" source=\"./{file}\" providerKey=\"gdal\" checked=\"{checked}\" expanded=\"0\"/>\n"
        );
        maps += &format!(
            r#"  <maplayer type="raster">
  <id>{id}</id>
  <datasource>./{file}</datasource>
  <layername>{name}</layername>
  <srs><spatialrefsys><authid>EPSG:{epsg}</authid></spatialrefsys></srs>
  <provider>gdal</provider>
{pipe}  <blendMode>{blend}</blendMode>
  </maplayer>
"#
        );
    }
    let text = format!(
        r#"<!DOCTYPE qgis-layer-definition>
<qlr>
  <layer-tree-group name="satgs" checked="Qt::Checked" expanded="1">
{tree}  </layer-tree-group>
  <maplayers>
{maps}  </maplayers>
</qlr>
"#
    );
    Ok(write_file(&path, text)?)
}

/// All layers, the first on top.
fn layers() -> [Layer; 8] {
    let layer = |id, name, file: &str, drawing, is_shown| Layer {
        id,
        name,
        file: file.into(),
        drawing,
        blend: BLEND_NORMAL,
        is_shown,
    };
    let of_confidence = |band, unit, colors| Drawing::Pipe(color_pipe(band, unit, colors));
    let relief = layer("satgs_relief", "Shaded relief", DSM, Drawing::Pipe(relief_pipe()), true);
    [
        layer("satgs_error", "Error", &format!("{EVALUATION}/{ERROR_MAP}"), Drawing::Style, false),
        layer(
            "satgs_expected",
            "Expected error",
            CONFIDENCE,
            of_confidence(EXPECTED_ERROR_BAND, " m", &EXPECTED_ERRORS),
            false,
        ),
        layer("satgs_views", "Confirming views", CONFIDENCE, of_confidence(VIEWS_BAND, "", &VIEWS), false),
        layer("satgs_ortho", "Orthophoto", ORTHO, Drawing::Pipe(picture_pipe()), false),
        Layer { blend: BLEND_MULTIPLY, ..relief },
        layer("satgs_dsm", "Heights", DSM, Drawing::Style, true),
        layer("satgs_above", "Heights above ground", ABOVE_GROUND, Drawing::Style, false),
        layer("satgs_ground", "Bare ground", GROUND, Drawing::Style, false),
    ]
}

/// The `<pipe>` of a layer; none if its style file is gone.
fn pipe(run: &Path, layer: &Layer) -> Option<String> {
    match &layer.drawing {
        Drawing::Pipe(pipe) => Some(pipe.clone()),
        Drawing::Style => {
            let style = std::fs::read_to_string(run.join(&layer.file).with_extension("qml")).ok()?;
            Some(format!("  {}\n", pipe_of_style(&style)?))
        }
    }
}
