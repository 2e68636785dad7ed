//! The files of an adjustment: corrected RPCs as JSON and text, sparse points as LAZ and PLY, tie points as CSV and
//! GeoPackage, the report as JSON, and figures.

use super::error::BundleError;
use super::report::Report;
use crate::frame::{CenterPx, Geodetic, Pixel, Point, SiteGrid};
use crate::io::{
    CloudError, CloudPoint, Marker, PointCloud, ReadError, VerticalReference, WriteError, epsg_of_cloud,
    read_json, write_file, write_json, write_markers,
};
use crate::rpc::Rpc;
use crate::rpc::formats;
use crate::run_files::{ADJUSTMENT_REPORT, SPARSE_POINTS};
use crate::scene::{Scene, View};
use las::Reader;
use serde::Deserialize;
use std::path::Path;

/// A triangulated tie point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SparsePoint {
    /// Its position.
    pub position: Point<Geodetic>,
    /// Number of views that observe it.
    pub views: u8,
    /// Gray value in the first of these views, 0 to 255.
    pub gray: u8,
}

/// Accuracy of a tie point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointQuality {
    /// Standard deviations east, north and up for a given datum, metres.
    pub sigma_m: [f64; 3],
    /// Largest angle between two of its rays, degrees.
    pub angle_deg: f64,
}

/// An observation of a tie point in a view, after the adjustment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TiePointObservation {
    /// Index of the point in [`Adjustment::points`].
    pub point: usize,
    /// Index of the view in [`Adjustment::cameras`].
    pub view: usize,
    /// Observed position in the whole image.
    pub px: Pixel<CenterPx>,
    /// Residual, observed minus predicted: columns and rows, pixels.
    pub residual_px: [f64; 2],
}

/// A row of `tie_points.csv`. The position of the point is not read from it: that in `points.laz` has more digits.
#[derive(Deserialize)]
struct TiePointRow {
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

/// Result of an adjustment.
#[derive(Clone, Debug)]
pub struct Adjustment {
    /// Name and corrected RPC of every used view; the RPC is that of the whole image, also where a window of it was
    /// used.
    pub cameras: Vec<(String, Rpc)>,
    /// The triangulated tie points.
    pub points: Vec<SparsePoint>,
    /// Observations of the tie points, point by point; empty after [`Adjustment::read`].
    pub observations: Vec<TiePointObservation>,
    /// Accuracy of each tie point; empty after [`Adjustment::read`].
    pub quality: Vec<PointQuality>,
    /// Statistics.
    pub report: Report,
}

impl Adjustment {
    /// Writes `rpcs/NAME.json`, `rpcs/NAME_RPC.TXT`, `points.laz` (map coordinates, ellipsoidal heights; the intensity
    /// is the number of views), `points.ply`, `tie_points.csv`, `tie_points.gpkg`, `report.json` and the figures.
    ///
    /// # Errors
    /// [`BundleError`].
    pub fn write(&self, folder: &Path, scene: &Scene) -> Result<(), BundleError> {
        self.write_cameras(folder, scene)?;
        self.write_points(folder)?;
        self.write_tie_points(folder)?;
        self.write_figures(folder, scene)?;
        Ok(write_json(&folder.join(ADJUSTMENT_REPORT), &self.report)?)
    }

    /// Writes `rpcs/NAME.json` and `rpcs/NAME_RPC.TXT`.
    fn write_cameras(&self, folder: &Path, scene: &Scene) -> Result<(), BundleError> {
        for (name, rpc) in &self.cameras {
            let Some(view) = scene.views.iter().find(|v| v.name == *name) else { continue };
            let json = formats::to_json(rpc, &view.tags());
            let rpcs = folder.join("rpcs");
            write_file(&rpcs.join(format!("{name}.json")), &json)?;
            write_file(&rpcs.join(format!("{name}_RPC.TXT")), formats::to_text(rpc))?;
        }
        Ok(())
    }

    /// Writes what [`Adjustment::read`] reads: cameras, points and report.
    ///
    /// # Errors
    /// [`BundleError`].
    pub fn write_result(&self, folder: &Path, scene: &Scene) -> Result<(), BundleError> {
        self.write_cameras(folder, scene)?;
        self.write_points(folder)?;
        Ok(write_json(&folder.join(ADJUSTMENT_REPORT), &self.report)?)
    }

    /// Keeps some of the views, by name, and some of the points, by place; the observations are dropped.
    pub fn keep(&mut self, view: impl Fn(&str) -> bool, place: impl Fn(Point<Geodetic>) -> bool) {
        self.cameras.retain(|camera| view(&camera.0));
        self.report.views.retain(|report| view(&report.name));
        self.points.retain(|point| place(point.position));
        self.observations.clear();
        self.quality.clear();
    }

    /// Reads cameras, points and report as written by [`Adjustment::write`], without observations and accuracies.
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
        Ok(Self { cameras, points, observations: Vec::new(), quality: Vec::new(), report })
    }

    /// The corrected RPCs in the order of a scene's views, each for the view's window.
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

    /// Reads everything that [`Adjustment::write`] wrote.
    ///
    /// # Errors
    /// [`BundleError`].
    pub fn read_with_observations(folder: &Path) -> Result<Self, BundleError> {
        let mut all = Self::read(folder)?;
        let path = folder.join("tie_points.csv");
        let damaged = |reason: String| BundleError::Points { path: path.clone(), reason };
        let mut reader = csv::Reader::from_path(&path).map_err(|e| damaged(e.to_string()))?;
        for line in reader.deserialize::<TiePointRow>() {
            let l = line.map_err(|e| damaged(e.to_string()))?;
            let view = all.cameras.iter().position(|c| c.0 == l.view);
            let view = view.ok_or_else(|| damaged(format!("view `{}` is not in report.json", l.view)))?;
            all.observations.push(TiePointObservation {
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
        if all.quality.len() != all.points.len()
            || all.observations.iter().any(|t| t.point >= all.points.len())
        {
            return Err(damaged("its points are not those of points.laz".into()));
        }
        Ok(all)
    }

    /// The adjustment translated on the ground by degrees of longitude, degrees of latitude and metres of height.
    /// Residuals do not change.
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

    /// Positions of the sparse points.
    #[must_use]
    pub fn positions(&self) -> Vec<Point<Geodetic>> {
        self.points.iter().map(|p| p.position).collect()
    }

    /// Writes `tie_points.csv`, one row per observation, and `tie_points.gpkg`, one feature per point.
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
        for t in &self.observations {
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

    /// Writes `points.laz` and `points.ply`.
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
        let cloud = PointCloud {
            epsg: grid.epsg,
            vertical: &VerticalReference::Ellipsoid,
            origin: Point::new(x, y, z),
        };
        Ok(cloud.write(path, points)?)
    }

    /// Writes `points.ply` with coordinates relative to `origin`, because map coordinates exceed single precision.
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
