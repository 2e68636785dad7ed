//! Line drawings as SVG.

use super::{WriteError, write_file};
use std::fmt::Write;
use std::path::Path;

/// Blue of lines and dots. It can be distinguished from [`ORANGE`] on white and on black, also by colour-blind readers
/// (palette of Okabe and Ito).
pub const BLUE: &str = "#0a84d6";
/// Orange of lines and dots.
pub const ORANGE: &str = "#d55e00";
/// Green of lines.
pub const GREEN: &str = "#009e73";
/// Gray of grids behind a drawing.
pub const GRAY: &str = "#999999";

/// A drawing of lines and circles. x points right and y down; the unit is a pixel of the screen.
pub struct Drawing {
    size: [f64; 2],
    body: String,
}

impl Drawing {
    /// An empty drawing of a width and a height in pixels.
    #[must_use]
    pub fn new(width: f64, height: f64) -> Self {
        Self { size: [width, height], body: String::new() }
    }

    /// Adds a closed outline; `ring` holds its corners (x, y), `color` is a colour of SVG.
    pub fn outline(&mut self, ring: &[[f64; 2]], color: &str) {
        let corners: Vec<String> = ring.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(
            self.body,
            "<polygon points=\"{}\" fill=\"none\" stroke=\"{color}\"/>",
            corners.join(" ")
        );
    }

    /// Adds straight lines of one colour, each from a start (x, y) to an end; `opacity` is from 0 to 1.
    pub fn lines(&mut self, lines: impl Iterator<Item = [[f64; 2]; 2]>, color: &str, opacity: f64) {
        let mut path = String::new();
        for [[x0, y0], [x1, y1]] in lines {
            let _ = write!(path, "M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}");
        }
        let _ = writeln!(self.body, "<path d=\"{path}\" stroke=\"{color}\" opacity=\"{opacity:.2}\"/>");
    }

    /// Adds a circle, filled or hollow, with its centre (x, y) and its radius in pixels.
    pub fn circle(&mut self, [x, y]: [f64; 2], radius: f64, color: &str, is_filled: bool) {
        let fill = if is_filled { color } else { "none" };
        let _ = writeln!(
            self.body,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{fill}\" stroke=\"{color}\" stroke-width=\"2\"/>"
        );
    }

    /// The drawing as an SVG element, which is also a complete SVG file; `label` is the description for screen readers.
    #[must_use]
    pub fn svg(&self, label: &str) -> String {
        let [width, height] = self.size;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" role=\"img\" \
             aria-label=\"{}\">\n{}</svg>\n",
            escape_xml(label),
            self.body
        )
    }

    /// Writes the drawing as an SVG file; `label` is the description for screen readers.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write(&self, path: &Path, label: &str) -> Result<(), WriteError> {
        write_file(path, self.svg(label))
    }
}

/// Escapes a text for the content or an attribute of an XML or HTML element.
#[must_use]
pub fn escape_xml(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
