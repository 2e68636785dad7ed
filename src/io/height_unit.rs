//! Units of heights.

/// Unit and vertical reference in the vertical part of a CRS; `metres` per unit is `None` for an unknown unit.
#[derive(Default)]
pub(super) struct VerticalPart {
    pub unit: String,
    pub metres: Option<f64>,
    pub from: Option<String>,
}

/// Metres per unit of height with a name that GDAL uses; `None` if it is unknown. An empty name means metres.
pub(super) fn metres_of(unit: &str) -> Option<f64> {
    match unit.trim().to_ascii_lowercase().replace('_', " ").as_str() {
        "" | "m" | "metre" | "meter" | "metres" | "meters" => Some(1.0),
        "ft" | "foot" | "feet" | "international foot" | "international feet" => Some(0.3048),
        "us survey foot" | "us survey feet" | "foot us" | "feet us" | "us-ft" | "ftus" | "us ft" => {
            Some(1200.0 / 3937.0)
        }
        "cm" | "centimetre" | "centimeter" => Some(0.01),
        "mm" | "millimetre" | "millimeter" => Some(0.001),
        _ => None,
    }
}
