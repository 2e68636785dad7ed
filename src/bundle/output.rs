//! An adjustment on disk: corrected RPCs as JSON and text, sparse points as LAZ, tie points as CSV and GeoPackage, the
//! report as JSON and pictures.

use super::error::BundleError;
use super::report::Report;
use crate::frame::{CenterPx, Geodetic, Pixel, Point, SiteGrid};
use crate::raster::{Marker, write_atomically, write_file, write_markers};
use crate::rpc::Rpc;
use crate::rpc::formats;
use crate::scene::{Scene, View};
use las::{Builder, Reader, Transform, Vector, Writer};
use std::path::Path;

/// Resolution of the points' coordinates on disk, metres.
const RESOLUTION_M: f64 = 0.001;

/// A point that several views see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparsePoint {
    /// Where.
    pub position: Point<Geodetic>,
    /// Number of views that see it.
    pub views: u8,
}

/// A point as one view shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiePoint {
    /// Index of the sparse point.
    pub point: usize,
    /// Index of the view among the cameras.
    pub view: usize,
    /// Where the whole image shows it.
    pub px: Pixel<CenterPx>,
    /// Observed minus predicted, columns and rows, pixels.
    pub residual_px: [f64; 2],
}

/// What an adjustment makes.
#[derive(Clone, Debug)]
pub struct Adjustment {
    /// Name and corrected camera of every view used: of the whole image, whatever window of it is used.
    pub cameras: Vec<(String, Rpc)>,
    /// Sparse points.
    pub points: Vec<SparsePoint>,
    /// Their observations, point by point; not read back.
    pub tie_points: Vec<TiePoint>,
    /// Figures.
    pub report: Report,
}

impl Adjustment {
    /// Writes `rpcs/NAME.json`, `rpcs/NAME_RPC.TXT`, `points.laz` (UTM, ellipsoidal heights; the intensity is the
    /// number of views), `tie_points.csv` and `.gpkg`, `report.json` and its pictures.
    ///
    /// # Errors
    /// [`BundleError`].
    pub fn write(&self, folder: &Path, scene: &Scene) -> Result<(), BundleError> {
        for (name, rpc) in &self.cameras {
            let Some(view) = scene.views.iter().find(|v| v.name == *name) else { continue };
            let json = formats::to_json(rpc, &view.tags());
            let rpcs = folder.join("rpcs");
            write_file(&rpcs.join(format!("{name}.json")), &json)?;
            write_file(&rpcs.join(format!("{name}_RPC.TXT")), formats::to_text(rpc))?;
        }
        self.write_points(&folder.join("points.laz"))?;
        self.write_tie_points(folder)?;
        self.write_figures(folder, scene)?;
        let report = serde_json::to_string_pretty(&self.report).unwrap_or_default();
        Ok(write_file(&folder.join("report.json"), report)?)
    }

    /// Reads what [`Adjustment::write`] wrote.
    ///
    /// # Errors
    /// [`BundleError`].
    pub fn read(folder: &Path) -> Result<Self, BundleError> {
        let path = folder.join("report.json");
        let damaged = |reason: String| BundleError::Points { path: path.clone(), reason };
        let text = std::fs::read_to_string(&path).map_err(|e| damaged(e.to_string()))?;
        let report: Report = serde_json::from_str(&text).map_err(|e| damaged(e.to_string()))?;
        let cameras = report
            .views
            .iter()
            .map(|v| {
                let file = folder.join("rpcs").join(format!("{}.json", v.name));
                Ok((v.name.clone(), formats::read(&file)?.rpc))
            })
            .collect::<Result<Vec<_>, BundleError>>()?;
        let points = read_points(&folder.join("points.laz"))?;
        Ok(Self { cameras, points, tie_points: Vec::new(), report })
    }

    /// The corrected cameras in the order of a scene's views, each of the view's window.
    ///
    /// # Errors
    /// [`BundleError::NoCamera`].
    pub fn cameras_of(&self, scene: &Scene) -> Result<Vec<Rpc>, BundleError> {
        let camera = |view: &View| {
            let found = self.cameras.iter().find(|c| c.0 == view.name).map(|c| view.camera_of_window(&c.1));
            found.ok_or_else(|| BundleError::NoCamera { view: view.name.clone(), folder: "ba/rpcs".into() })
        };
        scene.views.iter().map(camera).collect()
    }

    /// Where the sparse points are.
    #[must_use]
    pub fn positions(&self) -> Vec<Point<Geodetic>> {
        self.points.iter().map(|p| p.position).collect()
    }

    /// `tie_points.csv`, a line an observation, and `tie_points.gpkg`, a point each.
    fn write_tie_points(&self, folder: &Path) -> Result<(), BundleError> {
        use std::fmt::Write;
        let mut csv = String::from("point,lon,lat,h,view,col,row,residual_col,residual_row\n");
        let mut residual_px = vec![0.0f64; self.points.len()];
        for t in &self.tie_points {
            let [lon, lat, h] = self.points[t.point].position.xyz();
            let [d_col, d_row] = t.residual_px;
            let _ = writeln!(
                csv,
                "{},{lon:.8},{lat:.8},{h:.3},{},{:.3},{:.3},{d_col:.3},{d_row:.3}",
                t.point, self.cameras[t.view].0, t.px.col, t.px.row
            );
            residual_px[t.point] = residual_px[t.point].max(d_col.hypot(d_row));
        }
        write_file(&folder.join("tie_points.csv"), csv)?;
        let markers: Vec<Marker> = self
            .points
            .iter()
            .zip(residual_px)
            .map(|(p, worst)| Marker {
                place: p.position.xyz(),
                numbers: vec![("views", f64::from(p.views)), ("worst_residual_px", worst)],
            })
            .collect();
        Ok(write_markers(&folder.join("tie_points.gpkg"), "tie_points", &markers)?)
    }

    fn write_points(&self, path: &Path) -> Result<(), BundleError> {
        let refused = |reason: String| BundleError::Points { path: path.into(), reason };
        let Some(first) = self.points.first() else { return Err(refused("there are no points".into())) };
        let grid = SiteGrid::at(first.position).map_err(|e| refused(e.to_string()))?;
        let origin = grid.origin.xyz().map(f64::floor);
        let axis = |k: usize| Transform { scale: RESOLUTION_M, offset: origin[k] };
        let mut builder = Builder::from((1, 4));
        builder.point_format.is_compressed = true;
        builder.transforms = Vector { x: axis(0), y: axis(1), z: axis(2) };
        builder.generating_software = concat!("satgs ", env!("CARGO_PKG_VERSION")).into();
        // The zone's code stands in the system identifier: LAS needs a WKT record to say more.
        builder.system_identifier = format!("EPSG:{}", grid.epsg);
        let header = builder.into_header().map_err(|e| refused(e.to_string()))?;
        write_atomically(path, |t| {
            let mut writer = Writer::from_path(t, header).map_err(|e| refused(e.to_string()))?;
            for p in &self.points {
                let [x, y, z] = grid.utm_from_geodetic(p.position).xyz();
                let point = las::Point { x, y, z, intensity: p.views.into(), ..las::Point::default() };
                writer.write_point(point).map_err(|e| refused(e.to_string()))?;
            }
            writer.close().map_err(|e| refused(e.to_string()))
        })
    }
}

fn read_points(path: &Path) -> Result<Vec<SparsePoint>, BundleError> {
    let refused = |reason: String| BundleError::Points { path: path.into(), reason };
    let mut reader = Reader::from_path(path).map_err(|e| refused(e.to_string()))?;
    let epsg = reader.header().system_identifier().strip_prefix("EPSG:").and_then(|c| c.parse().ok());
    let epsg: u32 = epsg.ok_or_else(|| refused("it does not name its EPSG code".into()))?;
    let grid = SiteGrid { epsg, origin: Point::new(0.0, 0.0, 0.0) };
    let all = reader.read_all().map_err(|e| refused(e.to_string()))?;
    all.points()
        .map(|p| {
            let p = p.map_err(|e| refused(e.to_string()))?;
            let position = grid.geodetic_from_utm(Point::new(p.x, p.y, p.z));
            Ok(SparsePoint { position, views: u8::try_from(p.intensity).unwrap_or(u8::MAX) })
        })
        .collect()
}
