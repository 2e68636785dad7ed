//! A surface and a picture that a user has, as a height field.

use super::error::SimulateError;
use super::field::{Field, Material, Node};
use super::geodesy::ecef_from_geodetic;
use super::keyed_rng::KeyedRng;
use super::options::SIZE_PX;
use super::summary::SurfaceFigures;
use super::terrain::SurfaceFiles;
use super::texture::{Albedo, scaled};
use crate::frame::{Geodetic, Point, Site, SiteGrid};
use crate::io::{Grid2, HeightSystem, ImageFile, MapGrid, VerticalReference, Window, read_heights};
use crate::stats::interpolated_quantile_in_place;
use rayon::prelude::*;
use std::path::Path;

/// Lowest and highest height of land on Earth, metres.
const HEIGHTS_M: (f32, f32) = (-500.0, 9000.0);
/// Largest error of distances on the map, as a share: maps of countries stay below, Web Mercator does not.
const STRETCH: f64 = 0.01;
/// Columns and rows of the copy of a surface that shows its lowest and highest height.
const OVERVIEW_PX: usize = 512;
/// Shares of the values of a picture that are darker than black and brighter than white, and the reflectances of both.
const TAIL: f64 = 0.005;
const REFLECTANCES: (f32, f32) = (0.03, 0.62);
/// Factor by which green exceeds red and blue where plants grow.
const GREENER: f32 = 1.08;
/// Cars drive on level ground that is grey and not bright: largest slope, difference of the bands, and reflectance.
const STREET_SLOPE: f64 = 0.12;
const STREET_COLOR: f32 = 0.06;
const STREET_BRIGHTEST: f32 = 0.42;
/// Cars drive no higher than this above the lowest place within two blocks of this side, metres.
const STREET_HEIGHT_M: f32 = 1.5;
const BLOCK_M: f64 = 8.0;

/// The place of a surface: its grid, the map whose origin is its centre, and the height of its heights' zero above the
/// ellipsoid there, metres.
struct Place {
    cells: MapGrid,
    map: SiteGrid,
    zero_m: f64,
}

/// A surface as a field.
pub(super) struct Survey {
    pub(super) field: Field,
    /// Its map; the origin is the centre, at height 0.
    pub(super) grid: SiteGrid,
    /// Longitude, latitude and a typical ellipsoidal height of the centre.
    pub(super) center: Point<Geodetic>,
    pub(super) figures: SurfaceFigures,
}

/// Reads a user's surface. `half_m` gives half the side of the field for its height differences; `extent_m` is the side of the
/// images on the ground.
pub(super) fn read(
    files: &SurfaceFiles,
    step_m: f64,
    extent_m: f64,
    half_m: impl Fn(f64) -> f64,
    colors: KeyedRng,
) -> Result<Survey, SimulateError> {
    let file = ImageFile::open(&files.surface)?;
    let (place, vertical, is_assumed) = place(&file, files)?;
    let (low, high) = height_range(&file, &place)?;
    let farthest_m = 0.5 * place.cells.cell * place.cells.width.max(place.cells.height) as f64 + 1.0;
    let half_m = half_m(f64::from(high - low)).min((farthest_m / step_m).ceil() * step_m);
    let heights = Sampled::heights(&file, &place, half_m, step_m)?.nodes(half_m, step_m);
    let texture = match &files.texture {
        Some(path) => Some(Texture::read(path, &place, half_m, step_m)?),
        None => None,
    };
    let side = heights.width;
    let at = |k: usize| k as f64 * step_m - half_m;
    let in_images = |k: usize| at(k % side).abs().max(at(k / side).abs()) <= 0.5 * extent_m;
    let shown = (0..side * side).filter(|k| in_images(*k));
    let holes = shown.clone().filter(|k| heights.data[*k].is_nan()).count();
    let colored: Vec<Option<Albedo>> = (0..side * side)
        .into_par_iter()
        .map(|k| texture.as_ref().and_then(|t| t.albedo(at(k % side), at(k / side))))
        .collect();
    let plain = shown.clone().filter(|k| colored[*k].is_none()).count();
    let all = shown.count().max(1) as f64;
    if texture.is_some() && plain as f64 >= all {
        let path = files.texture.clone().unwrap_or_default();
        return Err(SimulateError::Surface {
            path,
            reason: "it shows nothing of the middle of the surface".into(),
        });
    }
    let filled = filled(&heights);
    let streets = streets(&filled, step_m);
    let nodes = (0..side * side).into_par_iter().map(|k| {
        let albedo = colored[k].unwrap_or_else(|| plain_albedo(colors, at(k % side), at(k / side)));
        let material = match heights.data[k].is_nan() {
            true => Material::Void,
            false => material(albedo, streets[k]),
        };
        Node { height_m: f64::from(filled.data[k]) + place.zero_m, material, owner: 0, albedo }
    });
    let field = Field::new(half_m, step_m, nodes.collect());
    let center = place.map.geodetic_from_utm(place.map.origin);
    let center = center.at_height(0.5 * f64::from(low + high) + place.zero_m);
    let figures = SurfaceFigures {
        vertical,
        vertical_is_assumed: is_assumed,
        holes_share: holes as f64 / all,
        untextured_share: plain as f64 / all,
    };
    Ok(Survey { field, grid: place.map, center, figures })
}

/// Columns and rows of images of a ground sampling distance that show a surface as far as its shorter side and the largest
/// size of images allow.
///
/// # Errors
/// [`SimulateError::Raster`] if the surface is no map.
pub fn covering_px(surface: &Path, gsd_m: f64) -> Result<usize, SimulateError> {
    let cells = ImageFile::open(surface)?.map_grid()?;
    let shorter_m = cells.cell * cells.width.min(cells.height) as f64;
    Ok(((shorter_m / gsd_m) as usize).clamp(*SIZE_PX.start(), *SIZE_PX.end()))
}

/// The place of a surface, the name of its vertical reference, and whether this is assumed.
fn place(file: &ImageFile, files: &SurfaceFiles) -> Result<(Place, String, bool), SimulateError> {
    let wrong = |reason: &str| SimulateError::Surface { path: files.surface.clone(), reason: reason.into() };
    let cells = file.map_grid()?;
    let stated = HeightSystem::of_raster(file)?.from;
    let named = files.vertical.clone().or(stated);
    let vertical = match &named {
        Some(name) => VerticalReference::read(name)?,
        None => VerticalReference::Ellipsoid,
    };
    let half = |cells_along: usize| 0.5 * cells.cell * cells_along as f64;
    let (e, n) = (cells.west + half(cells.width), cells.north - half(cells.height));
    let map = SiteGrid { epsg: cells.epsg, origin: Point::new(e.round(), n.round(), 0.0) };
    let center = map.geodetic_from_utm(map.origin);
    if !(center.lon_deg().is_finite() && center.lat_deg().is_finite()) {
        return Err(wrong("its middle has no longitude and latitude"));
    }
    let stretch = stretch(&map);
    if (stretch - 1.0).abs() > STRETCH {
        let reason = format!(
            "its map stretches the ground by {stretch:.2} here; `gdalwarp -t_srs` makes one in UTM of it"
        );
        return Err(wrong(&reason));
    }
    let zero_m = vertical.undulation_m(center.lon_deg(), center.lat_deg());
    if zero_m.is_nan() {
        return Err(wrong("the geoid's grid does not cover it"));
    }
    Ok((Place { cells, map, zero_m }, vertical.name().to_owned(), named.is_none()))
}

/// Metres on the map for a metre on the ground at its origin, of the axis that is stretched more.
fn stretch(map: &SiteGrid) -> f64 {
    const REACH_M: f64 = 50.0;
    let on_ground = |x: f64, y: f64| {
        let at =
            |by: f64| ecef_from_geodetic(map.geodetic_from_site(Point::<Site>::new(by * x, by * y, 0.0)));
        (at(REACH_M) - at(-REACH_M)).norm() / (2.0 * REACH_M)
    };
    let both = [1.0 / on_ground(1.0, 0.0), 1.0 / on_ground(0.0, 1.0)];
    if (both[0] - 1.0).abs() > (both[1] - 1.0).abs() { both[0] } else { both[1] }
}

/// Lowest and highest height of a surface as it is stored, metres.
fn height_range(file: &ImageFile, place: &Place) -> Result<(f32, f32), SimulateError> {
    let Place { cells, .. } = place;
    let all = Window { col: 0, row: 0, width: cells.width, height: cells.height };
    let (overview, _, _) = read_heights(file, all, OVERVIEW_PX)?;
    let (low, high) = overview.valid().fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(v), h.max(v)));
    let wrong = |reason: String| Err(SimulateError::Surface { path: file.path().into(), reason });
    if low > high {
        return wrong("it holds no height".into());
    }
    if low < HEIGHTS_M.0 || high > HEIGHTS_M.1 {
        return wrong(format!("its heights go from {low} to {high} m, which do not occur on Earth"));
    }
    Ok((low, high))
}

/// A band of a map around a place, sampled at positions in metres from it.
struct Sampled {
    values: Grid2,
    /// Column and row of the place in `values`, and cells a metre along both.
    origin: [f64; 2],
    per_m: [f64; 2],
}

impl Sampled {
    /// The window of a map that a field covers, and the most columns and rows that are worth reading; `None` if there is none.
    fn window(cells: &MapGrid, map: &SiteGrid, half_m: f64, step_m: f64) -> Option<(Window, usize)> {
        let [e, n, _] = map.origin.xyz();
        let span = |from: f64, to: f64, size: usize| {
            let (from, to) = ((from.floor() - 1.0).max(0.0), (to.ceil() + 1.0).min(size as f64));
            (to > from).then_some((from as usize, (to - from) as usize))
        };
        let (col, width) = span(
            (e - half_m - cells.west) / cells.cell,
            (e + half_m - cells.west) / cells.cell,
            cells.width,
        )?;
        let (row, height) = span(
            (cells.north - n - half_m) / cells.cell,
            (cells.north - n + half_m) / cells.cell,
            cells.height,
        )?;
        Some((Window { col, row, width, height }, Field::nodes_per_side(half_m, step_m) + 4))
    }

    fn new(values: Grid2, cells: &MapGrid, map: &SiteGrid, window: Window, cells_each: [f64; 2]) -> Self {
        let [e, n, _] = map.origin.xyz();
        let place = [
            (e - cells.west) / cells.cell - window.col as f64,
            (cells.north - n) / cells.cell - window.row as f64,
        ];
        let per_m = [1.0 / (cells.cell * cells_each[0]), 1.0 / (cells.cell * cells_each[1])];
        let origin = [place[0] / cells_each[0] - 0.5, place[1] / cells_each[1] - 0.5];
        Self { values, origin, per_m }
    }

    /// The heights of a surface.
    fn heights(file: &ImageFile, place: &Place, half_m: f64, step_m: f64) -> Result<Self, SimulateError> {
        let Place { cells, map, .. } = place;
        let empty =
            || SimulateError::Surface { path: file.path().into(), reason: "it holds no height".into() };
        let (window, most) = Self::window(cells, map, half_m, step_m).ok_or_else(empty)?;
        let (values, factor, _) = read_heights(file, window, most)?;
        Ok(Self::new(values, cells, map, window, [factor as f64; 2]))
    }

    fn at(&self, x: f64, y: f64) -> f32 {
        self.values.bilinear(self.origin[0] + x * self.per_m[0], self.origin[1] - y * self.per_m[1])
    }

    /// Its values at the nodes of a field, row by row from the south.
    fn nodes(&self, half_m: f64, step_m: f64) -> Grid2 {
        let side = Field::nodes_per_side(half_m, step_m);
        let at = |k: usize| k as f64 * step_m - half_m;
        Grid2::from_rows(side, side, |row, line| {
            line.iter_mut().enumerate().for_each(|(col, v)| *v = self.at(at(col), at(row)));
        })
    }
}

/// A picture of the ground: one band, or red, green and blue.
struct Texture {
    bands: Vec<Sampled>,
    black: f32,
    white: f32,
}

impl Texture {
    fn read(path: &Path, place: &Place, half_m: f64, step_m: f64) -> Result<Self, SimulateError> {
        let wrong = |reason: String| SimulateError::Surface { path: path.into(), reason };
        let file = ImageFile::open(path)?;
        let cells = file.map_grid()?;
        if cells.epsg != place.map.epsg {
            let reason = format!(
                "its CRS is EPSG:{}, that of the surface EPSG:{}; `gdalwarp -t_srs EPSG:{}` converts it",
                cells.epsg, place.map.epsg, place.map.epsg
            );
            return Err(wrong(reason));
        }
        let outside = || wrong("it does not cover the middle of the surface".into());
        let (window, most) = Sampled::window(&cells, &place.map, half_m, step_m).ok_or_else(outside)?;
        let size = (window.width.min(most), window.height.min(most));
        let each = [window.width as f64 / size.0 as f64, window.height as f64 / size.1 as f64];
        let count = if file.bands() >= 3 { 3 } else { 1 };
        let read = |band: usize| file.read_scaled(band, window, size);
        let mut bands = (1..=count).map(read).collect::<Result<Vec<Grid2>, _>>()?;
        // Black in all bands is what programs leave where an orthophoto shows nothing.
        for k in 0..size.0 * size.1 {
            if bands.iter().any(|band| band.data[k].is_nan()) || bands.iter().all(|band| band.data[k] == 0.0)
            {
                bands.iter_mut().for_each(|band| band.data[k] = f32::NAN);
            }
        }
        let mut levels: Vec<f32> = bands.iter().flat_map(Grid2::valid).collect();
        if levels.is_empty() {
            return Err(outside());
        }
        let [black, white] =
            [TAIL, 1.0 - TAIL].map(|q| interpolated_quantile_in_place(&mut levels, q) as f32);
        let sampled = |values| Sampled::new(values, &cells, &place.map, window, each);
        Ok(Self { bands: bands.into_iter().map(sampled).collect(), black, white })
    }

    /// Reflectance at a place; none where the picture shows nothing.
    fn albedo(&self, x: f64, y: f64) -> Option<Albedo> {
        let (dark, bright) = REFLECTANCES;
        let span = (self.white - self.black).max(f32::MIN_POSITIVE);
        let reflectance = |band: &Sampled| {
            let level = band.at(x, y);
            let share = ((level - self.black) / span).clamp(0.0, 1.0);
            (!level.is_nan()).then_some(dark + (bright - dark) * share)
        };
        match self.bands.as_slice() {
            [red, green, blue] => Some([reflectance(red)?, reflectance(green)?, reflectance(blue)?]),
            [gray, ..] => reflectance(gray).map(|r| [r; 3]),
            [] => None,
        }
    }
}

/// The plain texture of ground without a picture: grey-brown, with patches and grain of all sizes that an image resolves.
fn plain_albedo(colors: KeyedRng, x: f64, y: f64) -> Albedo {
    let broad = colors.key(80).fractal_noise(x, y, 24.0, 5);
    let grain = colors.key(81).fractal_noise(x, y, 0.9, 2);
    scaled([0.36, 0.34, 0.31], 1.0 + 0.4 * broad + 0.3 * grain)
}

fn material([red, green, blue]: Albedo, is_street: bool) -> Material {
    let (low, high) = (red.min(green).min(blue), red.max(green).max(blue));
    if green > GREENER * red && green > GREENER * blue {
        Material::Grass
    } else if is_street && high - low < STREET_COLOR && high < STREET_BRIGHTEST {
        Material::Asphalt
    } else {
        Material::Paving
    }
}

/// Whether each node is level and low, as streets and yards are.
fn streets(heights: &Grid2, step_m: f64) -> Vec<bool> {
    let nodes = (BLOCK_M / step_m).ceil().max(1.0) as usize;
    let (width, rows) = (heights.width, heights.height);
    let blocks = (width.div_ceil(nodes), rows.div_ceil(nodes));
    let mut lowest = Grid2::filled(blocks.0, blocks.1, f32::MAX);
    for (k, h) in heights.data.iter().enumerate() {
        let block = &mut lowest.data[k / width / nodes * blocks.0 + k % width / nodes];
        *block = block.min(*h);
    }
    let is_street = |k: usize| {
        let (col, row) = (k % width, k / width);
        let h = heights.data[k];
        let around = |k: usize, last: usize| k.saturating_sub(1)..(k + 2).min(last);
        let floor = around(row / nodes, blocks.1)
            .flat_map(|r| around(col / nodes, blocks.0).map(move |c| (c, r)))
            .fold(f32::MAX, |low, (c, r)| low.min(lowest.at(c, r)));
        let east = heights.at((col + 1).min(width - 1), row) - h;
        let north = heights.at(col, (row + 1).min(rows - 1)) - h;
        h - floor < STREET_HEIGHT_M && f64::from(east.hypot(north)) < STREET_SLOPE * step_m
    };
    (0..heights.data.len()).into_par_iter().map(is_street).collect()
}

/// Heights with holes filled smoothly from what surrounds them, so that rays and shadows pass over them.
fn filled(heights: &Grid2) -> Grid2 {
    if heights.data.iter().all(|h| !h.is_nan()) {
        return heights.clone();
    }
    let Grid2 { width, height, .. } = *heights;
    if width < 2 || height < 2 {
        let (sum, n) = heights.valid().fold((0.0, 0.0f32), |(sum, n), h| (sum + h, n + 1.0));
        let mean = sum / n.max(1.0);
        return Grid2::from_fn(width, height, |c, r| {
            Some(heights.at(c, r)).filter(|h| !h.is_nan()).unwrap_or(mean)
        });
    }
    let coarse = filled(&heights.halved());
    let inside = |k: usize, size: usize| (0.5 * k as f64 - 0.25).clamp(0.0, (size - 1) as f64);
    Grid2::from_fn(width, height, |col, row| match heights.at(col, row) {
        h if h.is_nan() => coarse.bilinear(inside(col, coarse.width), inside(row, coarse.height)),
        h => h,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_filled_between_the_heights_around_them() {
        let tilted = |c: usize, r: usize| if (10..20).contains(&c) && r > 4 { f32::NAN } else { c as f32 };
        let filled = filled(&Grid2::from_fn(40, 33, tilted));
        assert!(filled.data.iter().all(|h| (0.0..=39.0).contains(h)));
        assert!((filled.at(15, 20) - 15.0).abs() < 5.0, "{}", filled.at(15, 20));
        assert_eq!(filled.at(30, 8), 30.0);
    }

    #[test]
    fn streets_are_level_and_low() {
        // A roof 6 m above level ground, and a slope beside it.
        let height = |c: usize, _| match c {
            40..60 => 6.0,
            100.. => 0.5 * (c - 100) as f32,
            _ => 0.0,
        };
        let found = streets(&Grid2::from_fn(160, 50, height), 0.5);
        let at = |c: usize| found[20 * 160 + c];
        assert!(at(20) && at(80) && !at(50) && !at(130));
    }
}
