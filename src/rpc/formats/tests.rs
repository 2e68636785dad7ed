//! Formats against each other, against themselves, and against what vendors get wrong.

use super::*;
use crate::rpc::model::tests::synthetic;
use crate::rpc::{Axis, RpcCoefficients};
use proptest::prelude::*;

fn here() -> &'static Path {
    Path::new("a_RPC.TXT")
}

/// Any number a camera may hold, down to the last bit.
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
            // Denominators near one have no pole.
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
    fn writing_and_reading_back_gives_the_same_bits(rpc in camera()) {
        prop_assert_eq!(&from_text(here(), &to_text(&rpc)).unwrap(), &rpc);
        prop_assert_eq!(from_gdal(here(), &to_gdal(&rpc)).unwrap().unwrap(), rpc.clone());
        let file = RpcFile {
            rpc,
            tags: ViewTags {
                image: Some("é b.tif".into()),
                size: Some((746, 815)),
                sun_deg: Some((150.3, -5.25)),
                acquired: Some("2014-10-05T16:01:38Z".into()),
                height_range: Some((-27.0, 30.125)),
            },
        };
        prop_assert_eq!(parse(here(), &to_json(&file)).unwrap(), file);
    }

    #[test]
    fn no_text_makes_a_reader_panic(text in ".{0,300}") {
        let _ = parse(here(), &text);
        let _ = parse(here(), &format!("LINE_OFF: {text}"));
        let _ = parse(here(), &format!("{{\"rpc\": {{\"row_num\": \"{text}\"}}}}"));
        let _ = iso_date(&text);
    }
}

#[test]
fn vendors_spellings_are_the_same_camera() {
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
        from_text(here(), &lines.join("\n")).unwrap_err().to_string()
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
        from_text(here(), &changed).unwrap_err().to_string()
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
    assert!(refused("{\"rpc\": {\"row_offset\": NaN}}").contains("no valid JSON"));
    assert!(refused("{\"rpc\": {\"row_offset\": 1}}").contains("`col_offset` is missing (found 1 of 90"));
    assert!(refused("<isd/>").contains("it is XML"));
    assert!(refused(" \n").contains("it is empty"));
    assert!(refused("lineOffset = 3;").contains("RPB"));
    assert!(refused("FAKE").contains("no RPC file"));
}

#[test]
fn dates_become_iso() {
    assert_eq!(iso_date("20141005160138").unwrap(), "2014-10-05T16:01:38Z");
    assert_eq!(iso_date("2014-10-05T16:01:38.250Z").unwrap(), "2014-10-05T16:01:38Z");
    assert_eq!(iso_date("2014-10-05").unwrap(), "2014-10-05");
    assert_eq!(iso_date("05OCT14"), None);
    assert_eq!(iso_date("20141305160138"), None);
}
