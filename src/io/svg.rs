//! Line drawings as SVG.

use super::{WriteError, write_file};
use std::fmt::Write;
use std::path::Path;

/// Blue of lines and dots. Together with [`ORANGE`] it can be told apart on white and on black, also by the colour-blind
/// (Okabe and Ito), as the colours of charts can.
pub const BLUE: &str = "#0a84d6";
/// Orange of lines and dots.
pub const ORANGE: &str = "#d55e00";
/// Green of lines.
pub const GREEN: &str = "#009e73";
/// Gray of grids behind a drawing.
pub const GRAY: &str = "#999999";

/// A drawing of lines and circles; x counts right and y down, in units of one pixel on the screen.
pub struct Drawing {
    size: [f64; 2],
    body: String,
}

impl Drawing {
    /// An empty drawing.
    #[must_use]
    pub fn new(width: f64, height: f64) -> Self {
        Self { size: [width, height], body: String::new() }
    }

    /// A closed outline.
    pub fn outline(&mut self, ring: &[[f64; 2]], color: &str) {
        let corners: Vec<String> = ring.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(
            self.body,
            "<polygon points=\"{}\" fill=\"none\" stroke=\"{color}\"/>",
            corners.join(" ")
        );
    }

    /// Straight lines of one colour, each from a start to an end.
    pub fn lines(&mut self, lines: impl Iterator<Item = [[f64; 2]; 2]>, color: &str, opacity: f64) {
        let mut path = String::new();
        for [[x0, y0], [x1, y1]] in lines {
            let _ = write!(path, "M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}");
        }
        let _ = writeln!(self.body, "<path d=\"{path}\" stroke=\"{color}\" opacity=\"{opacity:.2}\"/>");
    }

    /// A circle, filled or hollow.
    pub fn circle(&mut self, [x, y]: [f64; 2], radius: f64, color: &str, is_filled: bool) {
        let fill = if is_filled { color } else { "none" };
        let _ = writeln!(
            self.body,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{fill}\" stroke=\"{color}\" stroke-width=\"2\"/>"
        );
    }

    /// The drawing as an SVG element, which is also a complete SVG file; `label` describes it to those who cannot see it.
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

    /// Writes the drawing as an SVG file.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn write(&self, path: &Path, label: &str) -> Result<(), WriteError> {
        write_file(path, self.svg(label))
    }
}

/// Text as the content or an attribute of an XML or HTML element.
#[must_use]
pub fn escape_xml(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
