//! An adjustment on disk: corrected RPCs as JSON and text, sparse points as LAZ and PLY, tie points as CSV and
//! GeoPackage, the report as JSON and pictures.

use super::error::BundleError;
use super::report::Report;
use crate::frame::{CenterPx, Geodetic, Pixel, Point, SiteGrid};
use crate::io::{
    CloudError, CloudPoint, Marker, PointCloud, ReadError, Vertical, WriteError, epsg_of_cloud, read_json,
    write_file, write_json, write_markers,
};
use crate::rpc::Rpc;
use crate::rpc::formats;
use crate::run_files::{ADJUSTMENT_REPORT, SPARSE_POINTS};
use crate::scene::{Scene, View};
use las::Reader;
use serde::Deserialize;
use std::path::Path;

/// A point that several views see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparsePoint {
    /// Where.
    pub position: Point<Geodetic>,
    /// Number of views that see it.
    pub views: u8,
    /// What the first of them shows, stretched.
    pub gray: u8,
}

/// How well a point is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointQuality {
    /// Standard deviations within the scene, its datum taken as given: metres east, north and up.
    pub sigma_m: [f64; 3],
    /// Widest angle between two of its rays, degrees.
    pub angle_deg: f64,
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

/// A line of `tie_points.csv`; where its point is `points.laz` knows better.
#[derive(Deserialize)]
struct TieLine {
    point: usize,
    sigma_east_m: f64,
    sigma_north_m: f64,
    sigma_up_m: f64,
    angle_deg: f64,
    view: String,
    col: f64,
    row: f64,
    residual_col: f64,
    residual_row: f64,
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
    /// How well each sparse point is measured; not read back.
    pub quality: Vec<PointQuality>,
    /// Figures.
    pub report: Report,
}

impl Adjustment {
    /// Writes `rpcs/NAME.json`, `rpcs/NAME_RPC.TXT`, `points.laz` (UTM, ellipsoidal heights; the intensity is the
    /// number of views), `points.ply`, `tie_points.csv` and `.gpkg`, `report.json` and its pictures.
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
        self.write_points(folder)?;
        self.write_tie_points(folder)?;
        self.write_figures(folder, scene)?;
        Ok(write_json(&folder.join(ADJUSTMENT_REPORT), &self.report)?)
    }

    /// Reads what [`Adjustment::write`] wrote.
    ///
    /// # Errors
    /// [`BundleError`].
    pub fn read(folder: &Path) -> Result<Self, BundleError> {
        let path = folder.join(ADJUSTMENT_REPORT);
        let damaged = |e: ReadError| BundleError::Points { path: path.clone(), reason: e.cause.to_string() };
        let report: Report = read_json(&path).map_err(damaged)?;
        let cameras = report
            .views
            .iter()
            .map(|v| {
                let file = folder.join("rpcs").join(format!("{}.json", v.name));
                Ok((v.name.clone(), formats::read(&file)?.rpc))
            })
            .collect::<Result<Vec<_>, BundleError>>()?;
        let points = read_points(&folder.join(SPARSE_POINTS))?;
        Ok(Self { cameras, points, tie_points: Vec::new(), quality: Vec::new(), report })
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

    /// Reads the tie points and the points' quality too, which [`Adjustment::read`] passes over.
    ///
    /// # Errors
    /// [`BundleError`].
    pub fn read_all(folder: &Path) -> Result<Self, BundleError> {
        let mut all = Self::read(folder)?;
        let path = folder.join("tie_points.csv");
        let damaged = |reason: String| BundleError::Points { path: path.clone(), reason };
        let mut reader = csv::Reader::from_path(&path).map_err(|e| damaged(e.to_string()))?;
        for line in reader.deserialize::<TieLine>() {
            let l = line.map_err(|e| damaged(e.to_string()))?;
            let view = all.cameras.iter().position(|c| c.0 == l.view);
            let view = view.ok_or_else(|| damaged(format!("view `{}` is not in report.json", l.view)))?;
            all.tie_points.push(TiePoint {
                point: l.point,
                view,
                px: Pixel::new(l.col, l.row),
                residual_px: [l.residual_col, l.residual_row],
            });
            let sigma_m = [l.sigma_east_m, l.sigma_north_m, l.sigma_up_m];
            if l.point == all.quality.len() {
                all.quality.push(PointQuality { sigma_m, angle_deg: l.angle_deg });
            }
        }
        if all.quality.len() != all.points.len() || all.tie_points.iter().any(|t| t.point >= all.points.len())
        {
            return Err(damaged("its points are not those of points.laz".into()));
        }
        Ok(all)
    }

    /// The adjustment with everything moved by a step on the ground: degrees of longitude and latitude, metres of
    /// height. No residual changes.
    #[must_use]
    pub fn moved_on_ground(mut self, step: [f64; 3]) -> Self {
        for (_, rpc) in &mut self.cameras {
            *rpc = rpc.moved_on_ground(step);
        }
        for p in &mut self.points {
            let [lon, lat, h] = p.position.xyz();
            p.position = Point::new(lon + step[0], lat + step[1], h + step[2]);
        }
        self
    }

    /// Where the sparse points are.
    #[must_use]
    pub fn positions(&self) -> Vec<Point<Geodetic>> {
        self.points.iter().map(|p| p.position).collect()
    }

    /// `tie_points.csv`, a line an observation, and `tie_points.gpkg`, a point each.
    fn write_tie_points(&self, folder: &Path) -> Result<(), BundleError> {
        let mut csv = csv::Writer::from_writer(Vec::new());
        let path = folder.join("tie_points.csv");
        let failed = |e: csv::Error| WriteError::new(&path, e);
        csv.write_record([
            "point",
            "lon",
            "lat",
            "h",
            "sigma_east_m",
            "sigma_north_m",
            "sigma_up_m",
            "angle_deg",
            "view",
            "col",
            "row",
            "residual_col",
            "residual_row",
        ])
        .map_err(failed)?;
        let mut residual_px = vec![0.0f64; self.points.len()];
        for t in &self.tie_points {
            let [lon, lat, h] = self.points[t.point].position.xyz();
            let PointQuality { sigma_m: [east, north, up], angle_deg } = self.quality[t.point];
            let [d_col, d_row] = t.residual_px;
            csv.write_record([
                t.point.to_string(),
                format!("{lon:.8}"),
                format!("{lat:.8}"),
                format!("{h:.3}"),
                format!("{east:.3}"),
                format!("{north:.3}"),
                format!("{up:.3}"),
                format!("{angle_deg:.1}"),
                self.cameras[t.view].0.clone(),
                format!("{:.3}", t.px.col),
                format!("{:.3}", t.px.row),
                format!("{d_col:.3}"),
                format!("{d_row:.3}"),
            ])
            .map_err(failed)?;
            residual_px[t.point] = residual_px[t.point].max(d_col.hypot(d_row));
        }
        let lines = csv.into_inner().map_err(|e| failed(e.into_error().into()))?;
        write_file(&path, lines)?;
        let markers: Vec<Marker> = self
            .points
            .iter()
            .zip(residual_px.iter().zip(&self.quality))
            .map(|(p, (worst, q))| Marker {
                place: p.position.xyz(),
                numbers: vec![
                    ("views", f64::from(p.views)),
                    ("worst_residual_px", *worst),
                    ("angle_deg", q.angle_deg),
                    ("sigma_east_m", q.sigma_m[0]),
                    ("sigma_north_m", q.sigma_m[1]),
                    ("sigma_up_m", q.sigma_m[2]),
                ],
            })
            .collect();
        Ok(write_markers(&folder.join("tie_points.gpkg"), "tie_points", &markers)?)
    }

    /// `points.laz`, and the same as `points.ply`.
    pub(super) fn write_points(&self, folder: &Path) -> Result<(), BundleError> {
        let path = &folder.join(SPARSE_POINTS);
        let refused = |reason: String| BundleError::Points { path: path.clone(), reason };
        let Some(first) = self.points.first() else { return Err(refused("there are no points".into())) };
        let grid = SiteGrid::at(first.position).map_err(|e| refused(e.to_string()))?;
        let origin = grid.origin.xyz().map(f64::floor);
        self.write_ply(&folder.join("points.ply"), &grid, origin)?;
        let points = self.points.iter().map(|p| CloudPoint {
            place: grid.utm_from_geodetic(p.position),
            color: [f32::from(p.gray) / 255.0; 3],
            intensity: p.views.into(),
        });
        let [x, y, z] = origin;
        let cloud =
            PointCloud { epsg: grid.epsg, vertical: &Vertical::Ellipsoid, origin: Point::new(x, y, z) };
        Ok(cloud.write(path, points)?)
    }

    /// Single precision holds metres from `origin`, not map coordinates.
    fn write_ply(&self, path: &Path, grid: &SiteGrid, origin: [f64; 3]) -> Result<(), BundleError> {
        let [east, north, height] = origin;
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\n\
             comment metres east, north, up of EPSG:{} {east} {north}, ellipsoidal height {height}\n\
             comment Vertical Axis: z\n\
             element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
            grid.epsg,
            self.points.len()
        )
        .into_bytes();
        for p in &self.points {
            let place = grid.utm_from_geodetic(p.position).xyz();
            for k in 0..3 {
                bytes.extend_from_slice(&((place[k] - origin[k]) as f32).to_le_bytes());
            }
            bytes.extend_from_slice(&[p.gray; 3]);
        }
        Ok(write_file(path, bytes)?)
    }
}

fn read_points(path: &Path) -> Result<Vec<SparsePoint>, BundleError> {
    let refused = |reason: String| BundleError::Points { path: path.into(), reason };
    let damaged = |cause: las::Error| CloudError::Read { path: path.into(), cause };
    let mut reader = Reader::from_path(path).map_err(damaged)?;
    let epsg = epsg_of_cloud(reader.header()).ok_or_else(|| refused("its CRS is not stated".into()))?;
    let grid = SiteGrid { epsg, origin: Point::new(0.0, 0.0, 0.0) };
    let all = reader.read_all().map_err(damaged)?;
    all.points()
        .map(|p| {
            let p = p.map_err(damaged)?;
            let position = grid.geodetic_from_utm(Point::new(p.x, p.y, p.z));
            let gray = p.color.map_or(0, |c| (c.red / 257) as u8);
            Ok(SparsePoint { position, views: u8::try_from(p.intensity).unwrap_or(u8::MAX), gray })
        })
        .collect()
}
