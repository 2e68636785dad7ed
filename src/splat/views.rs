//! The training views: cameras, pixels at full and half resolution, which pixels count.

use super::init::SiteBox;
use super::raster::Layers;
use crate::affine::AffineCamera;
use crate::frame::{CenterPx, Pixel};
use crate::raster::Plane;

/// A view at one resolution.
#[derive(Clone, Debug)]
pub struct Level {
    /// The camera of this resolution.
    pub camera: AffineCamera,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Colours, 0 to 255, laid out as [`Layers`] with three channels.
    colors: Vec<u8>,
    /// Pixels that count, row by row.
    pub valid: Vec<bool>,
}

/// A view that is trained on.
#[derive(Clone, Debug)]
pub struct TrainingView {
    /// Its name.
    pub name: String,
    /// Full resolution, then half.
    pub levels: Vec<Level>,
    /// Shear of the full-resolution camera towards the sun, pixels per metre; none without a sun.
    pub sun_shear: Option<[f64; 2]>,
}

impl TrainingView {
    /// A view from its colours (three planes, or one for all), in [0, 1] with NaN where there is no pixel.
    ///
    /// Only pixels whose ground at the site's altitude lies in `area` count.
    #[must_use]
    pub fn new(
        name: String,
        camera: AffineCamera,
        sun_shear: Option<[f64; 2]>,
        planes: &[Plane],
        area: SiteBox,
    ) -> Self {
        let halved: Vec<Plane> = planes.iter().map(Plane::halved).collect();
        let levels = vec![Level::new(camera, planes, area), Level::new(camera.rescaled(0.5), &halved, area)];
        Self { name, levels, sun_shear }
    }
}

impl Level {
    fn new(camera: AffineCamera, planes: &[Plane], area: SiteBox) -> Self {
        let (width, height) = (planes[0].width, planes[0].height);
        let plane = |c: usize| &planes[c.min(planes.len() - 1)];
        let (west, south, east, north) = area;
        let [[a, b, _], [c, d, _]] = camera.linear;
        let det = a * d - b * c;
        let mut valid = Vec::with_capacity(width * height);
        let mut colors = vec![0; 3 * width * height];
        for row in 0..height {
            for col in 0..width {
                let (u, v) = (col as f64 - camera.offset[0], row as f64 - camera.offset[1]);
                let (x, y) = ((d * u - b * v) / det, (a * v - c * u) / det);
                let inside = x >= west && x <= east && y >= south && y <= north;
                let known = (0..3).all(|k| !plane(k).at(col, row).is_nan());
                valid.push(inside && known);
                if inside && known {
                    for k in 0..3 {
                        colors[(row * 3 + k) * width + col] = (plane(k).at(col, row) * 255.0).round() as u8;
                    }
                }
            }
        }
        Self { camera, width, height, colors, valid }
    }

    /// Brightness in [0, 1], NaN where masked.
    #[must_use]
    pub fn gray(&self) -> Plane {
        Plane::from_fn(self.width, self.height, |col, row| {
            self.color_at(col, row).map_or(f32::NAN, |c| (c[0] + c[1] + c[2]) / 3.0)
        })
    }

    /// Colour of the pixel nearest to a position, in [0, 1]; none outside and where masked.
    #[must_use]
    pub fn color(&self, p: Pixel<CenterPx>) -> Option<[f32; 3]> {
        let (col, row) = (p.col.round(), p.row.round());
        let inside = col >= 0.0 && row >= 0.0 && col < self.width as f64 && row < self.height as f64;
        if inside { self.color_at(col as usize, row as usize) } else { None }
    }

    fn color_at(&self, col: usize, row: usize) -> Option<[f32; 3]> {
        let value = |k: usize| f32::from(self.colors[(row * 3 + k) * self.width + col]) / 255.0;
        self.valid[row * self.width + col].then(|| std::array::from_fn(value))
    }

    /// Colours in [0, 1], zero where masked.
    pub fn load(&self, out: &mut Layers<f32>) {
        out.resize(self.width, self.height, 3);
        for (o, c) in out.data.iter_mut().zip(&self.colors) {
            *o = f32::from(*c) / 255.0;
        }
    }
}
