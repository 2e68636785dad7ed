//! The area of interest, a polygon in longitude and latitude.

use super::SceneError;
use crate::frame::{Geodetic, Point, SiteGrid, wrap_longitude_deg};
use geo::{ConvexHull, LineString, MultiPoint, Polygon, Validation};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

/// A box on the map: west, south, east, north in metres of a UTM zone.
pub type UtmBox = (f64, f64, f64, f64);

/// Number of points along each side of the polygon that are projected; its sides are straight on the map, but not in
/// images.
const PLACES_A_SIDE: usize = 8;
/// Largest side of an area, metres; larger ones are mistakes, or have to be divided into tiles.
const LARGEST_M: f64 = 100_000.0;
/// Smallest side of an area, metres.
const SMALLEST_M: f64 = 1.0;
/// Metres per degree of latitude, approximately.
const DEGREE_M: f64 = 111_200.0;

/// An area of interest: a ring of (longitude, latitude) in degrees, WGS 84. Longitudes of an area that crosses the
/// antimeridian continue beyond 180.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[f64; 2]>")]
pub struct Aoi(Vec<[f64; 2]>);

impl TryFrom<Vec<[f64; 2]>> for Aoi {
    type Error = SceneError;

    fn try_from(ring: Vec<[f64; 2]>) -> Result<Self, SceneError> {
        Self::checked(ring)
    }
}

impl Aoi {
    /// A box in degrees; `west > east` means that it crosses the antimeridian.
    ///
    /// # Errors
    /// [`SceneError::Area`] if the box is empty, too large, or outside of the ranges of longitude and latitude.
    pub fn from_box([west, south, east, north]: [f64; 4]) -> Result<Self, SceneError> {
        if south > north {
            return Err(SceneError::Area {
                reason: format!("the area is empty, its south {south} is beyond its north {north}"),
            });
        }
        let east = if west > east { east + 360.0 } else { east };
        Self::checked(vec![[west, south], [east, south], [east, north], [west, north]])
    }

    /// A box on the map, in metres of the UTM zone of `grid`.
    ///
    /// # Errors
    /// [`SceneError::Area`] if the box is empty or too large.
    pub fn from_utm_box((west, south, east, north): UtmBox, grid: &SiteGrid) -> Result<Self, SceneError> {
        let corners = [(west, south), (east, south), (east, north), (west, north)];
        let ring: Vec<[f64; 2]> = corners
            .iter()
            .map(|(x, y)| grid.geodetic_from_utm(Point::new(*x, *y, 0.0)))
            .map(|p| [p.lon_deg(), p.lat_deg()])
            .collect();
        // Longitudes continue beyond 180 where the box crosses the antimeridian.
        let first = ring[0][0];
        Self::checked(ring.iter().map(|[lon, lat]| [first + wrap_longitude_deg(lon - first), *lat]).collect())
    }

    /// The outer ring of the polygon in a GeoJSON file, or the convex hull of several polygons.
    ///
    /// # Errors
    /// [`SceneError::Unreadable`] if the file cannot be read, [`SceneError::Area`] if it holds no valid polygon.
    pub fn from_geojson(path: &Path) -> Result<Self, SceneError> {
        let text = super::files::read_text(path)?;
        let wrong = |reason: String| SceneError::Area { reason: format!("`{}`: {reason}", path.display()) };
        let json: Value =
            serde_json::from_str(&text).map_err(|e| wrong(format!("it is not valid JSON: {e}")))?;
        let rings = rings_of(&json);
        if rings.is_empty() {
            return Err(wrong("it holds no polygon".into()));
        }
        let points = |ring: &&Vec<Value>| -> Option<Vec<[f64; 2]>> {
            ring.iter().map(|p| Some([p.get(0)?.as_f64()?, p.get(1)?.as_f64()?])).collect()
        };
        let rings: Option<Vec<Vec<[f64; 2]>>> = rings.iter().map(points).collect();
        let rings = rings.ok_or_else(|| wrong("its polygon has coordinates that are not numbers".into()))?;
        if let [ring] = rings.as_slice() {
            return Self::checked(ring.clone());
        }
        let all: MultiPoint<f64> = rings.into_iter().flatten().map(|[x, y]| (x, y)).collect();
        Self::checked(all.convex_hull().exterior().coords().map(|c| [c.x, c.y]).collect())
    }

    /// The area with longitudes and latitudes exchanged; none if that is no area.
    pub(super) fn swapped(&self) -> Option<Self> {
        Self::checked(self.0.iter().map(|[lon, lat]| [*lat, *lon]).collect()).ok()
    }

    fn checked(ring: Vec<[f64; 2]>) -> Result<Self, SceneError> {
        let wrong = |reason: String| Err(SceneError::Area { reason });
        if let Some([lon, lat]) = ring.iter().find(|[lon, lat]| !(lon.abs() <= 540.0 && lat.abs() <= 90.0)) {
            let hint = if lat.abs() <= 180.0 && lon.abs() <= 90.0 { "; are the axes swapped?" } else { "" };
            return wrong(format!("longitude {lon}, latitude {lat} is not a place on Earth{hint}"));
        }
        let (low, high) = extent(&ring);
        let width = (high[0] - low[0]) * DEGREE_M * (0.5 * (low[1] + high[1])).to_radians().cos();
        let height = (high[1] - low[1]) * DEGREE_M;
        let size = format!("{width:.0} x {height:.0} m");
        if ring.len() < 3 || !(width >= SMALLEST_M && height >= SMALLEST_M) {
            return wrong(format!("the area is empty ({size})"));
        }
        if width > LARGEST_M || height > LARGEST_M {
            return wrong(format!("the area of {size} is too large, at most 100 km a side"));
        }
        let polygon = Polygon::new(LineString::from(ring.clone()), Vec::new());
        if !polygon.is_valid() {
            return wrong("the area's outline crosses itself".into());
        }
        Ok(Self(ring))
    }

    /// Bounding box of the area in metres of the UTM zone of `grid`.
    #[must_use]
    pub fn utm_box(&self, grid: &SiteGrid) -> UtmBox {
        let points = self.outline().map(|p| grid.utm_from_geodetic(p.at_height(0.0)).xyz());
        let (low, high) = extent(&points.map(|p| [p[0], p[1]]).collect::<Vec<_>>());
        (low[0], low[1], high[0], high[1])
    }

    /// The extent as text: `lon 5.4401 to 5.4523, lat 43.2611 to 43.2688`.
    #[must_use]
    pub fn place(&self) -> String {
        let (low, high) = extent(&self.0);
        format!("lon {:.4} to {:.4}, lat {:.4} to {:.4}", low[0], high[0], low[1], high[1])
    }

    /// Points along the outline, at height 0.
    pub(super) fn outline(&self) -> impl Iterator<Item = Point<Geodetic>> {
        let n = self.0.len();
        (0..n * PLACES_A_SIDE).map(move |i| {
            let (a, b) = (self.0[i / PLACES_A_SIDE], self.0[(i / PLACES_A_SIDE + 1) % n]);
            let t = (i % PLACES_A_SIDE) as f64 / PLACES_A_SIDE as f64;
            Point::new(a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), 0.0)
        })
    }
}

/// Smallest and largest value of each coordinate.
pub(super) fn extent(points: &[[f64; 2]]) -> ([f64; 2], [f64; 2]) {
    points.iter().fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(low, high), p| {
        ([low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])])
    })
}

/// The outer rings of all polygons in a GeoJSON value.
fn rings_of(json: &Value) -> Vec<&Vec<Value>> {
    let list = |name: &str| json.get(name).and_then(Value::as_array).into_iter().flatten();
    match json.get("type").and_then(Value::as_str) {
        Some("Polygon") => json.get("coordinates").and_then(|c| c.get(0)?.as_array()).into_iter().collect(),
        Some("MultiPolygon") => list("coordinates").filter_map(|p| p.get(0)?.as_array()).collect(),
        Some("Feature") => json.get("geometry").map(rings_of).unwrap_or_default(),
        Some("FeatureCollection") => list("features").flat_map(rings_of).collect(),
        Some("GeometryCollection") => list("geometries").flat_map(rings_of).collect(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wrong(area: [f64; 4]) -> String {
        Aoi::from_box(area).unwrap_err().to_string()
    }

    #[test]
    fn invalid_areas_are_refused_with_their_size() {
        assert!(wrong([43.2, 105.4, 43.3, 105.5]).contains("not a place on Earth"));
        assert!(wrong([5.4, 43.2, 5.4, 43.3]).contains("is empty (0 x 11120 m)"));
        assert!(wrong([5.4, 43.3, 5.5, 43.2]).contains("is empty"));
        assert!(wrong([5.0, 43.0, 7.0, 43.1]).contains("too large"));
        let bow = Aoi::checked(vec![[5.0, 43.0], [5.1, 43.1], [5.1, 43.0], [5.0, 43.1]]);
        assert!(bow.unwrap_err().to_string().contains("crosses itself"));
    }

    #[test]
    fn a_box_may_cross_the_antimeridian() {
        let aoi = Aoi::from_box([179.999, -17.001, -179.999, -17.0]).unwrap();
        let grid = SiteGrid::at(Point::new(180.0, -17.0, 0.0)).unwrap();
        let (w, s, e, n) = aoi.utm_box(&grid);
        assert!((e - w - 213.0).abs() < 10.0 && (n - s - 111.0).abs() < 10.0, "{w} {s} {e} {n}");
    }

    #[test]
    fn a_box_on_the_map_is_the_area_that_it_came_from() {
        for lon in [5.44, 180.0] {
            let grid = SiteGrid::at(Point::new(lon, -17.0, 0.0)).unwrap();
            let (x, y) = (grid.origin.x(), grid.origin.y());
            let given = (x - 400.0, y - 300.0, x + 600.0, y + 700.0);
            let back = Aoi::from_utm_box(given, &grid).unwrap().utm_box(&grid);
            for (a, b) in [(given.0, back.0), (given.1, back.1), (given.2, back.2), (given.3, back.3)] {
                assert!((a - b).abs() < 0.1, "{given:?} {back:?}");
            }
        }
    }

    #[test]
    fn polygons_are_read_from_every_kind_of_geojson() {
        let ring = "[[5.4,43.2],[5.41,43.2],[5.41,43.21],[5.4,43.2]]";
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.geojson");
        let polygon = format!(r#"{{"type":"Polygon","coordinates":[{ring}]}}"#);
        for text in [
            polygon.clone(),
            format!(r#"{{"type":"Feature","geometry":{polygon}}}"#),
            format!(
                r#"{{"type":"FeatureCollection","features":[{{"type":"Feature","geometry":{polygon}}}]}}"#
            ),
            format!(r#"{{"type":"MultiPolygon","coordinates":[[{ring}]]}}"#),
        ] {
            std::fs::write(&path, text).unwrap();
            assert_eq!(
                Aoi::from_geojson(&path).unwrap().place(),
                "lon 5.4000 to 5.4100, lat 43.2000 to 43.2100"
            );
        }
        std::fs::write(&path, r#"{"type":"Point","coordinates":[5,43]}"#).unwrap();
        assert!(Aoi::from_geojson(&path).unwrap_err().to_string().contains("holds no polygon"));
    }
}
