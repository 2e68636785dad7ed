//! Tests of the RPC formats: agreement between formats, round trips, and malformed files.

use super::*;
use crate::rpc::model::tests::synthetic;
use crate::rpc::{Axis, RpcCoefficients};
use proptest::prelude::*;

fn here() -> &'static Path {
    Path::new("a_RPC.TXT")
}

/// A file of the real data under `rpc/`; `None`, with a message, if it is absent.
#[allow(clippy::print_stdout)]
pub fn real_file(name: &str) -> Option<PathBuf> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let file = std::env::var_os("SATGS_DATA").map_or(here, PathBuf::from).join("rpc").join(name);
    if !file.is_file() {
        println!("skipped: no real data at {}", file.display());
        return None;
    }
    Some(file)
}

/// Any number that a coefficient may have.
fn value() -> impl Strategy<Value = f64> {
    (-1.0..1.0f64, -12..6i32).prop_map(|(m, e)| m * 10f64.powi(e))
}

fn axis() -> impl Strategy<Value = Axis> {
    (-89.0..89.0f64, 1e-3..5e4f64).prop_map(|(offset, scale)| Axis { offset, scale })
}

fn camera() -> impl Strategy<Value = Rpc> {
    let axes = [axis(), axis(), axis(), axis(), axis()];
    let terms = || proptest::collection::vec(value(), 20);
    (axes, terms(), terms(), terms(), terms(), proptest::option::of(0.0..10.0f64)).prop_map(
        |([col, row, lon, lat, height], cn, rn, cd, rd, err_bias_m)| {
            let array = |v: &[f64]| std::array::from_fn(|i| v[i]);
            // Denominators near 1 have no pole.
            let den = |v: &[f64]| std::array::from_fn(|i| if i == 0 { 1.0 } else { v[i] * 1e-8 });
            Rpc::new(RpcCoefficients {
                col,
                row,
                lon,
                lat,
                height,
                col_num: array(&cn),
                row_num: array(&rn),
                col_den: den(&cd),
                row_den: den(&rd),
                err_bias_m,
                err_rand_m: None,
            })
            .unwrap()
        },
    )
}

proptest! {
    #[test]
    fn a_round_trip_keeps_every_bit(rpc in camera()) {
        prop_assert_eq!(&parse(here(), &to_text(&rpc)).unwrap().rpc, &rpc);
        prop_assert_eq!(&parse(here(), &to_rpb(&rpc)).unwrap().rpc, &rpc);
        prop_assert_eq!(from_gdal(here(), &to_gdal(&rpc)).unwrap().unwrap(), rpc.clone());
        let tags = ViewTags {
            image: Some("é b.tif".into()),
            size: Some((746, 815)),
            sun_deg: Some((150.3, -5.25)),
            acquired: Some("2014-10-05T16:01:38Z".into()),
            height_range: Some((-27.0, 30.125)),
            ..ViewTags::default()
        };
        let back = parse(here(), &to_json(&rpc, &tags)).unwrap();
        prop_assert_eq!((back.rpc, back.tags), (rpc, tags));
    }

    #[test]
    fn no_text_makes_a_reader_panic(text in ".{0,300}") {
        let _ = parse(here(), &text);
        for start in ["LINE_OFF: ", "lineOffset = ;", "line_num_coeff_00: ", "<isd><RPB>", "<a><Global_RFM>"] {
            let _ = parse(here(), &format!("{start}{text}"));
        }
        let _ = parse(here(), &format!("{{\"rpc\": {{\"row_num\": \"{text}\"}}}}"));
        let _ = iso_date(&text);
    }
}

#[test]
fn spelling_variants_of_vendors_give_the_same_camera() {
    let rpc = synthetic();
    let text = to_text(&rpc);
    let same = |changed: String| assert_eq!(parse(here(), &changed).unwrap().rpc, rpc);
    same(text.replace('\n', "\r\n"));
    same(text.to_ascii_lowercase());
    same(text.replace(": ", ":"));
    same(text.replace(": ", " = "));
    same(format!("\u{feff}{text}"));
    same(text.replace("e-", "D-"));
    same(text.replace(" pixels", "").replace(" degrees", "").replace(" meters", ""));
    same(text.replace(": 5", ": +0005").replace("COEFF_1:", "COEFF_01:"));
    same(format!("satId = \"QB02\";\nSPEC: 1\n{text}\nREMARK: 12 of 13"));
}

#[test]
fn errors_name_file_and_field() {
    let text = to_text(&synthetic());
    let without = |key: &str| {
        let lines: Vec<&str> = text.lines().filter(|l| !l.starts_with(key)).collect();
        parse(here(), &lines.join("\n")).unwrap_err().to_string()
    };
    assert_eq!(without("LINE_OFF"), "`a_RPC.TXT`: RPC field `LINE_OFF` is missing (found 89 of 90 fields)");
    assert_eq!(
        without("SAMP_DEN_COEFF"),
        "`a_RPC.TXT`: RPC field `SAMP_DEN_COEFF` is missing (found 70 of 90 fields)"
    );
    assert!(without("SAMP_DEN_COEFF_20").contains("`SAMP_DEN_COEFF_20` is missing (found 89"));

    let broken = |from: &str, to: &str| {
        let changed = text.replace(from, to);
        assert_ne!(changed, text);
        parse(here(), &changed).unwrap_err().to_string()
    };
    assert!(broken("LAT_OFF: 43.26", "LAT_OFF: 43,26").contains("`LAT_OFF` is `43,26 degrees`"));
    assert!(broken("LAT_OFF: 43.26", "LAT_OFF: nan").contains("`LAT_OFF` is not a finite number"));
    assert!(broken("LAT_SCALE: 0.0027", "LAT_SCALE: 0").contains("`LAT_SCALE` is zero"));
    assert!(broken("LAT_OFF: 43.26", "LAT_OFF: -143.26").contains("`LAT_OFF` is -143.26, outside ±90"));
    assert!(broken("SAMP_NUM_COEFF_20:", "SAMP_NUM_COEFF_21:").contains("has 21 coefficients"));

    let mut domain = to_gdal(&synthetic());
    domain.iter_mut().find(|(k, _)| k == "LINE_NUM_COEFF").unwrap().1 = "1 2 3".into();
    assert!(from_gdal(here(), &domain).unwrap_err().to_string().contains("has 3 coefficients, 20"));
    assert!(from_gdal(here(), &[]).unwrap().is_none());

    let refused = |content: &str| parse(here(), content).unwrap_err().to_string();
    assert!(refused("{\"a\": 1}").contains("`rpc` is missing"));
    assert!(refused("{\"rpc\": {\"row_offset\": NaN}}").contains("not valid JSON"));
    assert!(refused("{\"rpc\": {\"row_offset\": 1}}").contains("`col_offset` is missing (found 1 of 90"));
    assert!(refused("<isd/>").contains("it is XML without an RPC"));
    assert!(refused("<isd>").contains("is not valid XML"));
    assert!(refused("<isd><RPB/></isd>").contains("`LINEOFFSET` is missing (found 0 of 90"));
    assert!(refused("<a><Global_RFM/></a>").contains("`RFM_Validity` is missing"));
    assert!(refused("<level_X/>").contains("one RPC for each band"));
    assert!(refused(" \n").contains("it is empty"));
    assert!(refused("lineOffset = 3;").contains("`sampOffset` is missing (found 1 of 90"));
    assert!(refused("FAKE").contains("not an RPC file"));
}

#[test]
fn rpc00a_is_refused_in_every_format_that_states_it() {
    let is_refused = |content: &str| matches!(parse(here(), content), Err(FormatError::Rpc00a { .. }));
    let rpb = to_rpb(&synthetic());
    assert!(!is_refused(&rpb) && is_refused(&rpb.replace("RPC00B", "RPC00A")));
    assert!(is_refused("<isd><RPB><SPECID>RPC00A</SPECID></RPB></isd>"));
    assert!(is_refused("polynomial_format:  A\nline_off: 3"));
    assert!(is_refused(&format!("SPEC_ID: RPC00A\n{}", to_text(&synthetic()))));
}

/// The camera as text in Maxar XML, DIMAP 1, 2 and 3, OSSIM `.geom` and GDAL metadata, each with its own conventions.
fn in_every_dialect(rpc: &Rpc) -> Vec<(&'static str, String)> {
    let c = rpc.coefficients();
    let join = |t: &[f64; 20]| t.map(|v| v.to_string()).join(" ");
    let polynomials = [&c.row_num, &c.row_den, &c.col_num, &c.col_den];
    let axes = [c.row, c.col, c.lat, c.lon, c.height];
    let mut maxar = String::from("<isd><RPB><IMAGE>");
    for (name, a) in ["LINE", "SAMP", "LAT", "LONG", "HEIGHT"].iter().zip(axes) {
        maxar += &format!("<{name}OFFSET>{}</{name}OFFSET><{name}SCALE>{}</{name}SCALE>", a.offset, a.scale);
    }
    for (name, t) in ["LINENUM", "LINEDEN", "SAMPNUM", "SAMPDEN"].iter().zip(polynomials) {
        maxar += &format!("<{name}COEFList><{name}COEF>{}</{name}COEF></{name}COEFList>", join(t));
    }
    maxar += "</IMAGE></RPB></isd>";

    let dimap = |profile: &str, element: &str, first: f64| {
        let mut xml = format!("<D><METADATA_PROFILE>{profile}</METADATA_PROFILE><Global_RFM><RFM_Validity>");
        for (i, (name, a)) in ["LINE", "SAMP", "LAT", "LONG", "HEIGHT"].iter().zip(axes).enumerate() {
            let offset = if i < 2 { a.offset + first } else { a.offset };
            xml += &format!("<{name}_OFF>{offset}</{name}_OFF><{name}_SCALE>{}</{name}_SCALE>", a.scale);
        }
        xml += &format!("<FIRST_ROW>-27</FIRST_ROW></RFM_Validity><{element}>");
        for (name, terms) in ["LINE_NUM", "LINE_DEN", "SAMP_NUM", "SAMP_DEN"].iter().zip(polynomials) {
            for (k, t) in terms.iter().enumerate() {
                xml += &format!("<{name}_COEFF_{0}>{t}</{name}_COEFF_{0}>", k + 1);
            }
        }
        xml + &format!("</{element}></Global_RFM></D>")
    };
    let mut v1 = String::from("<PHR_Dimap_Document><Global_RFM><Inverse_Model>");
    v1 += &format!("<F_COL>{} {}</F_COL>", join(&c.col_num), join(&c.col_den));
    v1 += &format!("<F_ROW>{} {}</F_ROW></Inverse_Model><RFM_Validity>", join(&c.row_num), join(&c.row_den));
    for (i, (name, a)) in ["Row", "Col", "Lat", "Lon", "Alt"].iter().zip(axes).enumerate() {
        let offset = if i < 2 { a.offset + 1.0 } else { a.offset };
        v1 += &format!("<{name}><A>{}</A><B>{offset}</B></{name}>", a.scale);
    }
    v1 += "</RFM_Validity></Global_RFM></PHR_Dimap_Document>";

    let mut geom = String::from("polynomial_format:  B\n");
    for (name, a) in ["line", "samp", "lat", "long", "height"].iter().zip(axes) {
        geom += &format!("{name}_off:  {}\n{name}_scale:  {}\n", a.offset, a.scale);
    }
    for (name, terms) in ["line_num", "line_den", "samp_num", "samp_den"].iter().zip(polynomials) {
        for (k, t) in terms.iter().enumerate() {
            geom += &format!("{name}_coeff_{k:02}:  {t}\n");
        }
    }
    let pam = to_gdal(rpc).iter().map(|(k, v)| format!("<MDI key=\"{k}\">{v}</MDI>")).collect::<String>();
    vec![
        ("Maxar XML", maxar),
        ("DIMAP v1", v1),
        ("DIMAP v2", dimap("PHR_SENSOR", "Inverse_Model", 1.0)),
        ("DIMAP v2", dimap("S6_SENSOR", "Inverse_Model", 1.0)),
        ("DIMAP v3", dimap("PNEO_SENSOR", "GroundtoImage_Values", 0.0)),
        ("OSSIM geom", geom),
        ("GDAL metadata", format!("<PAMDataset><Metadata domain=\"RPC\">{pam}</Metadata></PAMDataset>")),
    ]
}

#[test]
fn every_format_gives_the_same_camera() {
    let rpc = synthetic();
    for (format, content) in in_every_dialect(&rpc) {
        let file = parse(here(), &content).unwrap_or_else(|e| panic!("{format}: {e}"));
        assert_eq!((file.rpc, file.warnings), (rpc.clone(), Vec::new()), "{format}");
        assert_eq!(file.format, format);
    }
}

#[test]
fn the_profile_of_a_dimap_file_decides_whether_pixels_count_from_0_or_1() {
    let rpc = synthetic();
    let (_, v2) = in_every_dialect(&rpc).swap_remove(2);
    let neo = parse(here(), &v2.replace("PHR_SENSOR", "PNEO_SENSOR")).unwrap().rpc;
    assert_eq!(neo, rpc.shifted(1.0, 1.0));
}

#[test]
fn dates_are_converted_to_iso_8601() {
    assert_eq!(iso_date("20141005160138").unwrap(), "2014-10-05T16:01:38Z");
    assert_eq!(iso_date("2014-10-05T16:01:38.250Z").unwrap(), "2014-10-05T16:01:38Z");
    assert_eq!(iso_date("2014-10-05").unwrap(), "2014-10-05");
    assert_eq!(iso_date("2014-10-05T16:01:38+00:00").unwrap(), "2014-10-05T16:01:38Z");
    assert_eq!(iso_date("2014-10-05T16:01:38.3+02:00").unwrap(), "2014-10-05T14:01:38Z");
    assert_eq!(iso_date("2014-10-05T16:01:38.3-02:00").unwrap(), "2014-10-05T18:01:38Z");
    assert_eq!(iso_date("05OCT14"), None);
    assert_eq!(iso_date("20141305160138"), None);
}

/// The seeds of `scripts/fuzz` are valid cameras; inputs that made readers fail in the past must be handled.
#[test]
fn fuzzing_seeds_are_read_and_found_cases_are_handled() {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz");
    let files = |folder: &Path| -> Vec<PathBuf> {
        std::fs::read_dir(folder).into_iter().flatten().map(|e| e.unwrap().path()).collect()
    };
    let read = |path: &Path| {
        let bytes = std::fs::read(path).unwrap();
        // Names of TIFF seeds end in `.tif`; names of TIFF cases begin with the name of the reader.
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        match name.ends_with(".tif") || name.starts_with("tiff-") {
            true => parse_tiff(path, std::io::Cursor::new(bytes)).map(|rpc| rpc.is_some()),
            false => parse(path, &String::from_utf8_lossy(&bytes)).map(|_| true),
        }
    };
    let seeds: Vec<PathBuf> = files(&fuzz.join("seeds")).iter().flat_map(|f| files(f)).collect();
    assert_eq!(seeds.len(), 11);
    for seed in seeds {
        assert!(read(&seed).unwrap(), "{}", seed.display());
    }
    for case in files(&fuzz.join("cases")) {
        let _ = read(&case);
    }
}
