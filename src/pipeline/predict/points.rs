//! Points to predict splats from, in the site frame: from point clouds, surface models, or what a run has.

use crate::frame::{Point, SiteGrid, Transform};
use crate::io::{
    self, CloudError, HeightSystem, ImageFile, VerticalReference, Window, epsg_of_cloud, is_metric_map,
    read_heights,
};
use crate::mesh::TriangleMesh;
use crate::mvs::MatchedSurface;
use crate::pipeline::PipelineError;
use las::Reader;
use std::path::Path;

/// Endings of files that points are read from.
pub const ENDINGS: [&str; 5] = ["laz", "las", "ply", "tif", "tiff"];
/// Longest side of a surface model, cells; larger ones are averaged.
const LONGEST: usize = 8192;
/// Largest number of points: about 8 GB of memory.
const MOST: usize = 100_000_000;

/// Reads the points of a file, in the site frame (metres). The vertical reference is the ellipsoid unless the file states another.
/// A PLY file without georeference has coordinates of the site's map; of a scene without a site, those of the scene.
pub fn read_points(path: &Path, site: Option<&SiteGrid>) -> Result<Vec<[f64; 3]>, PipelineError> {
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let is_ply = ending.as_deref() == Some("ply");
    let points = match (site, ending.as_deref()) {
        (Some(site), Some("laz" | "las")) => of_cloud(path, site)?,
        (Some(site), Some("tif" | "tiff")) => of_raster(path, site)?,
        (Some(site), _) => of_ply(path, site)?,
        (None, _) if is_ply => TriangleMesh::read_vertices(path)?.0,
        (None, _) => {
            return Err(refused(
                path,
                "the scene has no place on Earth, so that only a .ply file has its coordinates",
            ));
        }
    };
    if points.len() > MOST {
        return Err(refused(path, format!("it has more than {MOST} points")));
    }
    Ok(points)
}

/// The cells of a matched surface.
pub fn of_surface(surface: &MatchedSurface) -> Vec<[f64; 3]> {
    let cells = (0..surface.grid.height).flat_map(|row| (0..surface.grid.width).map(move |col| (col, row)));
    cells.map(|(col, row)| surface.point(col, row).xyz()).filter(|p| p[2].is_finite()).collect()
}

fn refused(path: &Path, reason: impl Into<String>) -> PipelineError {
    PipelineError::Points { path: path.into(), reason: reason.into() }
}

/// Brings map positions and heights of a file to the site frame.
struct ToSite<'a> {
    path: &'a Path,
    site: &'a SiteGrid,
    transform: Option<Transform>,
    vertical: VerticalReference,
    metres: f64,
}

impl<'a> ToSite<'a> {
    fn new(
        path: &'a Path,
        site: &'a SiteGrid,
        epsg: u32,
        system: &HeightSystem,
    ) -> Result<Self, PipelineError> {
        let transform = (epsg != site.epsg).then(|| Transform::new(epsg, site.epsg)).transpose()?;
        let vertical = match &system.from {
            Some(name) => VerticalReference::read(name)
                .map_err(|e| refused(path, format!("its heights are above `{name}`: {e}")))?,
            None => VerticalReference::Ellipsoid,
        };
        Ok(Self { path, site, transform, vertical, metres: system.metres })
    }

    /// A point of the file, heights in its unit.
    fn point(&self, x: f64, y: f64, height: f64) -> [f64; 3] {
        let (e, n) = self.transform.map_or((x, y), |t| t.convert(x, y));
        let mut height_m = height * self.metres;
        if !matches!(self.vertical, VerticalReference::Ellipsoid) {
            let place = self.site.geodetic_from_utm(Point::new(e, n, height_m));
            height_m += self.vertical.undulation_m(place.lon_deg(), place.lat_deg());
        }
        self.site.site_from_utm(Point::new(e, n, height_m)).xyz()
    }

    /// The points, or an error if there are none with three numbers.
    fn finite(&self, points: Vec<[f64; 3]>) -> Result<Vec<[f64; 3]>, PipelineError> {
        if points.iter().any(|p| p.iter().all(|v| v.is_finite())) {
            return Ok(points);
        }
        Err(refused(self.path, "no point of it has a position on the map and a height"))
    }
}

/// Points that are withheld or classified as noise are left out.
fn of_cloud(path: &Path, site: &SiteGrid) -> Result<Vec<[f64; 3]>, PipelineError> {
    let damaged = |cause: las::Error| PipelineError::Cloud(CloudError::Read { path: path.into(), cause });
    let mut reader = Reader::from_path(path).map_err(damaged)?;
    let header = reader.header();
    let epsg = epsg_of_cloud(header).ok_or_else(|| refused(path, "its CRS is not stated"))?;
    if !is_metric_map(epsg) {
        return Err(refused(path, format!("EPSG:{epsg} is no map projection in metres")));
    }
    let to_site = ToSite::new(path, site, epsg, &HeightSystem::of_cloud(header))?;
    let mut out = Vec::new();
    io::read_points(path, &mut reader, |point| {
        // One more than there may be says that there are too many.
        if out.len() <= MOST {
            out.push(to_site.point(point.x, point.y, point.z));
        }
    })?;
    to_site.finite(out)
}

fn of_raster(path: &Path, site: &SiteGrid) -> Result<Vec<[f64; 3]>, PipelineError> {
    let file = ImageFile::open(path)?;
    let grid = file.map_grid()?;
    let to_site =
        ToSite::new(path, site, grid.epsg, &HeightSystem { metres: 1.0, ..HeightSystem::of_raster(&file)? })?;
    let window = Window { col: 0, row: 0, width: grid.width, height: grid.height };
    let (heights, factor, _) = read_heights(&file, window, LONGEST)?;
    let cell = grid.cell * factor as f64;
    let at = |i: usize| {
        let height = f64::from(heights.data[i]);
        let (col, row) = ((i % heights.width) as f64, (i / heights.width) as f64);
        let (x, y) = (grid.west + (col + 0.5) * cell, grid.north - (row + 0.5) * cell);
        (!height.is_nan()).then(|| to_site.point(x, y, height))
    };
    to_site.finite((0..heights.data.len()).filter_map(at).collect())
}

fn of_ply(path: &Path, site: &SiteGrid) -> Result<Vec<[f64; 3]>, PipelineError> {
    let (points, own) = TriangleMesh::read_vertices(path)?;
    // Coordinates are relative to the origin of a georeference beside the file.
    let own = own.unwrap_or(SiteGrid { epsg: site.epsg, origin: Point::new(0.0, 0.0, 0.0) });
    let system = HeightSystem { unit: String::new(), metres: 1.0, from: None };
    let to_site = ToSite::new(path, site, own.epsg, &system)?;
    let [e, n, up] = own.origin.xyz();
    to_site.finite(points.into_iter().map(|[x, y, z]| to_site.point(e + x, n + y, up + z)).collect())
}
