//! Dots, lines and discs for pictures in reports.

use super::{WriteError, write_png_rgb};
use std::path::Path;

/// A white picture to draw on; x counts right and y down from the middle of the first pixel.
pub struct Canvas {
    width: usize,
    pixels: Vec<[u8; 3]>,
}

impl Canvas {
    /// Lines behind curves and bars: light gray.
    pub const GRID: [u8; 3] = [200, 200, 200];
    /// With [`Self::BLUE`] two colours that everybody can tell apart.
    pub const ORANGE: [u8; 3] = [255, 127, 14];
    /// With [`Self::ORANGE`] two colours that everybody can tell apart.
    pub const BLUE: [u8; 3] = [31, 119, 180];

    /// An empty one.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, pixels: vec![[255; 3]; width * height] }
    }

    /// One pixel; outside is nowhere.
    pub fn dot(&mut self, [x, y]: [f64; 2], color: [u8; 3]) {
        let (col, row) = (x.round(), y.round());
        let height = self.pixels.len() / self.width.max(1);
        if (0.0..self.width as f64).contains(&col) && (0.0..height as f64).contains(&row) {
            self.pixels[row as usize * self.width + col as usize] = color;
        }
    }

    /// A straight line.
    pub fn line(&mut self, a: [f64; 2], b: [f64; 2], color: [u8; 3]) {
        let steps = (b[0] - a[0]).abs().max((b[1] - a[1]).abs()).ceil().max(1.0) as usize;
        for i in 0..=steps {
            let t = i as f64 / steps as f64;
            self.dot([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])], color);
        }
    }

    /// A closed line.
    pub fn outline(&mut self, ring: &[[f64; 2]], color: [u8; 3]) {
        for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
            self.line(*a, *b, color);
        }
    }

    /// A filled rectangle between two corners.
    pub fn bar(&mut self, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2], color: [u8; 3]) {
        let (first, last) = (x0.round() as i64, x1.round() as i64);
        for x in first..last {
            self.line([x as f64, y0], [x as f64, y1], color);
        }
    }

    /// A filled circle.
    pub fn disc(&mut self, [x, y]: [f64; 2], radius: f64, color: [u8; 3]) {
        let reach = radius.ceil() as i32;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let (dx, dy) = (f64::from(dx), f64::from(dy));
                if dx.hypot(dy) <= radius {
                    self.dot([x + dx, y + dy], color);
                }
            }
        }
    }

    /// Its columns, its rows, and red, green and blue of every pixel, row by row.
    #[must_use]
    pub fn picture(&self) -> (usize, usize, &[u8]) {
        (self.width, self.pixels.len() / self.width.max(1), self.pixels.as_flattened())
    }

    /// Writes it as a PNG.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        let (width, height, rgb) = self.picture();
        write_png_rgb(path, width, height, rgb)
    }
}
