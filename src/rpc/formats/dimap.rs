//! Airbus DIMAP: version 1 (`DIMAP_PHR`), 2 (Pléiades, SPOT 6 and 7) and 3 (Pléiades Neo).
//!
//! The inverse model (ground to image) is the RPC. The direct model (image to ground) is only compared with it, because
//! localisation inverts the inverse model numerically. Versions 1 and 2 count pixels from 1, version 3 from 0 (GDAL issue
//! 5716); `FIRST_ROW` and `FIRST_COL` of the validity domain do not state which (GDAL pull request 7653).

use super::keys::{Fields, RPC00B, parse_number};
use super::xml::{find, items, number, text};
use super::{FormatError, RpcFile, SAME_PX, Tiles, ViewTags, iso_date};
use crate::frame::{Geodetic, Pixel, Point};
use crate::rpc::model::TERMS;
use crate::rpc::{Rpc, polynomial};
use roxmltree::Node;
use std::path::Path;

/// Nodes along each axis of the volume in which the two models are compared.
const NODES: i32 = 11;

/// Field names of the direct model in version 3; version 2 uses SAMP for longitude and LINE for latitude.
const DIRECT_V3: [&str; 4] = ["LAT_NUM_COEFF", "LAT_DEN_COEFF", "LON_NUM_COEFF", "LON_DEN_COEFF"];

/// Reads the `Global_RFM` element of any version.
pub(super) fn from_xml(file: &Path, root: Node, model: Node) -> Result<RpcFile, FormatError> {
    let missing = |field: &str| FormatError::Missing { file: file.into(), field: field.into(), found: 0 };
    let profile = text(root, "METADATA_PROFILE").unwrap_or_default();
    let inverse_v3 = find(model, "GroundtoImage_Values");
    let validity = find(model, "RFM_Validity").ok_or_else(|| missing("RFM_Validity"))?;
    let mut fields = Fields::new(file, &RPC00B);
    let (format, direct) = if find(model, "F_COL").is_some() {
        take_v1(file, &mut fields, model, validity)?;
        ("DIMAP v1", direct_v1(model))
    } else {
        let inverse = inverse_v3.or_else(|| find(model, "Inverse_Model"));
        let inverse = inverse.ok_or_else(|| missing("Inverse_Model"))?;
        // The errors in DIMAP (ERR_BIAS_X, ERR_BIAS_ROW) are those of the fit, not of the geolocation, and are not read.
        for (name, value) in items(validity).chain(items(inverse)) {
            fields.take(name, value)?;
        }
        let (format, direct, names) = match inverse_v3 {
            Some(_) => ("DIMAP v3", "ImagetoGround_Values", DIRECT_V3),
            None => ("DIMAP v2", "Direct_Model", RPC00B.polynomials),
        };
        (format, find(model, direct).and_then(|d| direct_terms(d, names)))
    };
    let first_pixel = match profile {
        "PNEO_SENSOR" => 0.0,
        "PHR_SENSOR" | "S6_SENSOR" | "S7_SENSOR" => 1.0,
        _ if inverse_v3.is_some() => 0.0,
        _ => 1.0,
    };
    let rpc = fields.rpc()?.shifted(-first_pixel, -first_pixel);
    let gap = direct.and_then(|direct| direct_gap_px(&rpc, &direct));
    let warnings = gap.filter(|gap| *gap > SAME_PX).map(|gap| {
        format!(
            "`{}`: its direct and inverse models differ by up to {gap:.1} px; the inverse model is used",
            file.display()
        )
    });
    let tags = tags(root);
    Ok(RpcFile { rpc, tags, format, warnings: warnings.into_iter().collect() })
}

/// Takes the coefficients of a version 1 file: each function has forty numbers, numerator before denominator; scales are
/// named A, offsets B.
fn take_v1(file: &Path, fields: &mut Fields, model: Node, validity: Node) -> Result<(), FormatError> {
    for (function, [num, den]) in
        [("F_ROW", ["LINE_NUM_COEFF", "LINE_DEN_COEFF"]), ("F_COL", ["SAMP_NUM_COEFF", "SAMP_DEN_COEFF"])]
    {
        let words: Vec<&str> = text(model, function).unwrap_or_default().split_whitespace().collect();
        if words.len() != 2 * TERMS {
            let (file, field) = (file.into(), function.into());
            return Err(FormatError::Count { file, field, found: words.len(), expected: 2 * TERMS });
        }
        fields.take(num, &words[..TERMS].join(" "))?;
        fields.take(den, &words[TERMS..].join(" "))?;
    }
    for (axis, scale, offset) in [
        ("Lon", "LONG_SCALE", "LONG_OFF"),
        ("Lat", "LAT_SCALE", "LAT_OFF"),
        ("Alt", "HEIGHT_SCALE", "HEIGHT_OFF"),
        ("Col", "SAMP_SCALE", "SAMP_OFF"),
        ("Row", "LINE_SCALE", "LINE_OFF"),
    ] {
        let Some(node) = find(validity, axis) else { continue };
        for (name, field) in [("A", scale), ("B", offset)] {
            if let Some(value) = text(node, name) {
                fields.take(field, value)?;
            }
        }
    }
    Ok(())
}

/// Coefficients of a direct model: numerator and denominator of latitude, then of longitude, as functions of (column,
/// row, height).
type Direct = [[f64; TERMS]; 4];

fn direct_terms(node: Node, names: [&str; 4]) -> Option<Direct> {
    let mut terms = [[f64::NAN; TERMS]; 4];
    for (name, value) in items(node) {
        let Some(k) = names.iter().position(|n| name.starts_with(n)) else { continue };
        let index: usize = name[names[k].len()..].strip_prefix('_')?.parse().ok()?;
        *terms[k].get_mut(index.checked_sub(1)?)? = parse_number(value)?;
    }
    terms.as_flattened().iter().all(|t| t.is_finite()).then_some(terms)
}

fn direct_v1(model: Node) -> Option<Direct> {
    let both = |function| {
        let words = text(model, function)?.split_whitespace().map(parse_number);
        words.collect::<Option<Vec<f64>>>().filter(|v| v.len() == 2 * TERMS)
    };
    let (lat, lon) = (both("F_LAT")?, both("F_LON")?);
    let half = |v: &[f64], from: usize| std::array::from_fn(|i| v[from + i]);
    Some([half(&lat, 0), half(&lat, TERMS), half(&lon, 0), half(&lon, TERMS)])
}

/// The ground point that the direct model gives for a pixel and a height; both are normalised by the offsets and scales
/// of the inverse model.
fn direct_ground(
    [lat_num, lat_den, lon_num, lon_den]: &Direct,
    rpc: &Rpc,
    place: [f64; 3],
) -> Point<Geodetic> {
    let c = rpc.coefficients();
    let ratio = |num, den| polynomial(num, place) / polynomial(den, place);
    Point::new(
        c.lon.offset + c.lon.scale * ratio(lon_num, lon_den),
        c.lat.offset + c.lat.scale * ratio(lat_num, lat_den),
        c.height.offset + c.height.scale * place[2],
    )
}

/// Largest distance over the validity volume between a pixel and the projection, by the inverse model, of the ground
/// point that the direct model gives for it; pixels.
fn direct_gap_px(rpc: &Rpc, direct: &Direct) -> Option<f64> {
    let c = rpc.coefficients();
    let node = |i: i32| 2.0 * f64::from(i) / f64::from(NODES - 1) - 1.0;
    let mut gap = 0.0f64;
    for i in 0..NODES.pow(3) {
        let place = [node(i % NODES), node(i / NODES % NODES), node(i / NODES.pow(2))];
        let px = Pixel::new(c.col.offset + c.col.scale * place[0], c.row.offset + c.row.scale * place[1]);
        let apart = rpc.project(direct_ground(direct, rpc, place)).distance(px);
        if !apart.is_finite() {
            return None;
        }
        gap = gap.max(apart);
    }
    Some(gap)
}

/// Metadata of the image in a product file (`DIM_*.XML`) or in a version 1 file.
pub(super) fn tags(root: Node) -> ViewTags {
    let is_center = |n: &Node| {
        n.tag_name().name() == "Located_Geometric_Values" && text(*n, "LOCATION_TYPE") == Some("Center")
    };
    let center = root.descendants().find(is_center).unwrap_or(root);
    let raster = find(root, "Raster_Dimensions");
    let count = |name| raster.and_then(|r| number(r, name)).filter(|v| *v >= 1.0).map(|v| v as usize);
    let imaged = || {
        let date = text(root, "IMAGING_DATE")?;
        iso_date(&format!("{date}T{}", text(root, "IMAGING_TIME")?)).or_else(|| iso_date(date))
    };
    let gsd = number(center, "GSD_ACROSS_TRACK").zip(number(center, "GSD_ALONG_TRACK"));
    ViewTags {
        size: count("NCOLS").zip(count("NROWS")),
        sun_deg: number(center, "SUN_AZIMUTH").zip(number(center, "SUN_ELEVATION")),
        acquired: text(center, "TIME").and_then(iso_date).or_else(imaged),
        gsd_m: gsd.map(|(across, along)| (across * along).sqrt()),
        off_nadir_deg: number(center, "INCIDENCE_ANGLE"),
        tiles: raster.and_then(tiles),
        nodata: nodata(root),
        ..ViewTags::default()
    }
}

/// Value of pixels without data: the special value `NODATA`.
fn nodata(root: Node) -> Option<f64> {
    let special =
        root.descendants().filter(|n| matches!(n.tag_name().name(), "Special_Value" | "Special_Values"));
    let is_nodata =
        |n: &Node| text(*n, "SPECIAL_VALUE_TEXT").is_some_and(|t| t.eq_ignore_ascii_case("NODATA"));
    special
        .filter(is_nodata)
        .find_map(|n| number(n, "SPECIAL_VALUE_COUNT").or_else(|| number(n, "SPECIAL_VALUE_INDEX")))
}

/// Layout of the tiles of a product.
fn tiles(raster: Node) -> Option<Tiles> {
    let tiling = find(raster, "Regular_Tiling")?;
    let (size, count) = (find(tiling, "NTILES_SIZE")?, find(tiling, "NTILES_COUNT")?);
    let value = |node: Node, name: &str| node.attribute(name)?.trim().parse::<usize>().ok();
    let overlap = |name| number(tiling, name).unwrap_or(0.0) as usize;
    Some(Tiles {
        width: value(size, "ncols")?.checked_sub(overlap("OVERLAP_COL"))?,
        height: value(size, "nrows")?.checked_sub(overlap("OVERLAP_ROW"))?,
        across: value(count, "ntiles_C")?,
        down: value(count, "ntiles_R")?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rpc::formats::tests::real_file;

    /// The inverse and the direct model of a file of version 1 or 2.
    fn models(file: &Path) -> (Rpc, Direct) {
        let text = std::fs::read_to_string(file).unwrap();
        let document = roxmltree::Document::parse(&text).unwrap();
        let root = document.root_element();
        let model = find(root, "Global_RFM").unwrap();
        let terms = || direct_terms(find(model, "Direct_Model")?, RPC00B.polynomials);
        let direct = direct_v1(model).or_else(terms).unwrap();
        (from_xml(file, root, model).unwrap().rpc, direct)
    }

    #[test]
    fn the_nodata_value_is_read_in_all_versions() {
        let value = |text: &str| nodata(roxmltree::Document::parse(text).unwrap().root_element());
        let v2 = "<Dimap_Document><Raster_Display>\
                  <Special_Value><SPECIAL_VALUE_TEXT>SATURATED</SPECIAL_VALUE_TEXT>\
                  <SPECIAL_VALUE_COUNT>4095</SPECIAL_VALUE_COUNT></Special_Value>\
                  <Special_Value><SPECIAL_VALUE_TEXT>NODATA</SPECIAL_VALUE_TEXT>\
                  <SPECIAL_VALUE_COUNT>7</SPECIAL_VALUE_COUNT></Special_Value></Raster_Display></Dimap_Document>";
        assert_eq!(value(v2), Some(7.0));
        let v1 = v2.replace("Special_Value>", "Special_Values>").replace("COUNT", "INDEX");
        assert_eq!((value(&v1), value("<Dimap_Document/>")), (Some(7.0), None));
    }

    /// Largest distances in pixels (specification, section 5.1); the last digit of the table is rounded.
    #[test]
    fn direct_and_inverse_models_differ_as_specified() {
        for (name, gap) in [
            ("rpcm/rpc_PLEIADES.xml", 0.0020),
            ("rpcm/rpc_SPOT6.xml", 0.0221),
            ("shareloc/RPC_PHR1B_P_201709281038045_SEN_PRG_FC_178608-001.XML", 0.0024),
            ("shareloc/RPC_PHR1B_P_201709281038393_SEN_PRG_FC_178609-001.XML", 0.0045),
            ("shareloc/phr_oise/RPC_PHR1A_P_202503191043438_SEN_7342362101-1.XML", 135.0),
        ] {
            let Some(file) = real_file(name) else { return };
            let (rpc, direct) = models(&file);
            let found = direct_gap_px(&rpc, &direct).unwrap();
            assert!((found - gap).abs() < 6e-5 + 5e-3 * gap, "{name}: {found} px");
        }
    }

    /// A test of shareloc: the direct model and Newton's method on the inverse model agree to 9e-8 degrees.
    #[test]
    fn localisation_agrees_with_the_direct_model_of_version_1() {
        let Some(file) = real_file("shareloc/PHRDIMAP_P1BP--2018122638935449CP.XML") else { return };
        let (rpc, direct) = models(&file);
        let (c, px, height_m) = (rpc.coefficients(), Pixel::new(199.5, 599.5), 125.0);
        let of = |value: f64, axis: crate::rpc::Axis| (value - axis.offset) / axis.scale;
        let place = [of(px.col, c.col), of(px.row, c.row), of(height_m, c.height)];
        let (told, found) = (direct_ground(&direct, &rpc, place), rpc.localize(px, height_m).unwrap());
        let apart = (told.lon_deg() - found.lon_deg()).abs().max((told.lat_deg() - found.lat_deg()).abs());
        assert!(apart < 9e-8, "{apart}°");
    }
}
