//! Sun and date in metadata files without an RPC: JSON of Planet, text of GeoEye and IKONOS.

use super::{ViewTags, iso_date};
use serde_json::Value;

/// Metadata in the `_metadata.json` of a Planet item, a GeoJSON feature with `properties`.
pub(super) fn planet_tags(content: &str) -> ViewTags {
    let Ok(item) = serde_json::from_str::<Value>(content) else { return ViewTags::default() };
    let properties = item.get("properties").unwrap_or(&item);
    let number = |key: &str| properties.get(key).and_then(Value::as_f64);
    ViewTags {
        sun_deg: number("sun_azimuth").zip(number("sun_elevation")),
        acquired: properties.get("acquired").and_then(Value::as_str).and_then(iso_date),
        gsd_m: number("gsd"),
        off_nadir_deg: number("view_angle").map(f64::abs),
        ..ViewTags::default()
    }
}

/// Whether a text is a `_metadata.txt` of GeoEye or IKONOS.
pub(super) fn is_geoeye(content: &str) -> bool {
    content.contains("Sun Angle Azimuth:")
}

/// Metadata in a `_metadata.txt`, which has lines `Key: value unit`. Values that differ between the images of the product
/// are left out, because it is not known which image is meant.
pub(super) fn geoeye_tags(content: &str) -> ViewTags {
    let value = |key: &str| {
        let lines = content.lines().filter_map(|line| line.trim().strip_prefix(key)?.strip_prefix(':'));
        let mut values = lines.map(str::trim);
        let first = values.next()?;
        values.all(|other| other == first).then_some(first)
    };
    let number = |key: &str| value(key)?.split_whitespace().next()?.parse::<f64>().ok();
    // `2010-06-15 18:44 GMT` has no seconds.
    let time = value("Acquisition Date/Time").map(|t| t.trim_end_matches("GMT").trim());
    let with_seconds = |t: &str| if t.matches(':').count() == 1 { format!("{t}:00") } else { t.to_owned() };
    ViewTags {
        sun_deg: number("Sun Angle Azimuth").zip(number("Sun Angle Elevation")),
        acquired: time.and_then(|t| iso_date(&with_seconds(t))),
        off_nadir_deg: number("Nominal Collection Elevation").map(|elevation| 90.0 - elevation),
        ..ViewTags::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sun_date_and_resolution_are_read_from_planet_json() {
        let tags = planet_tags(
            r#"{"id": "x", "properties": {"acquired": "2023-07-17T09:56:10.25Z", "gsd": 0.8, "sun_azimuth": 121.5,
                "sun_elevation": 58.3, "view_angle": -12.5}}"#,
        );
        assert_eq!(tags.sun_deg, Some((121.5, 58.3)));
        assert_eq!(tags.acquired.as_deref(), Some("2023-07-17T09:56:10Z"));
        assert_eq!((tags.gsd_m, tags.off_nadir_deg), (Some(0.8), Some(12.5)));
        assert_eq!(planet_tags("{").sun_deg, None);
    }

    #[test]
    fn the_sun_is_read_from_geoeye_text_unless_it_is_ambiguous() {
        let text = "Product Image ID: 000\nNominal Collection Elevation: 70.5 degrees\nSun Angle Azimuth: 141.3 degrees\n\
                    Sun Angle Elevation: 62.1 degrees\nAcquisition Date/Time: 2010-06-15 18:44 GMT\n";
        assert!(is_geoeye(text));
        let tags = geoeye_tags(text);
        assert_eq!(tags.sun_deg, Some((141.3, 62.1)));
        assert_eq!(tags.acquired.as_deref(), Some("2010-06-15T18:44:00Z"));
        assert_eq!(tags.off_nadir_deg, Some(19.5));
        assert_eq!(geoeye_tags(&format!("{text}Sun Angle Azimuth: 1.0 degrees\n")).sun_deg, None);
    }
}
