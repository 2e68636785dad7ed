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

/// Height of texts and half the side of the square around a place that texts leave free, pixels.
const TEXT_PX: f64 = 14.0;
const DOT_PX: f64 = 6.0;

/// A drawing of lines, circles and texts. x points right and y down; the unit is a pixel of the screen.
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

    /// Adds a text in the colour of the page; `at` (x, y) is the middle of its line, `anchor` is `start`, `middle` or `end`.
    pub fn text(&mut self, [x, y]: [f64; 2], anchor: &str, text: &str) {
        let _ = writeln!(
            self.body,
            "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{}</text>",
            y + 0.35 * TEXT_PX,
            escape_xml(text)
        );
    }

    /// Adds a text beside each place (x, y), on the first side where it covers no other text or place and stays within the
    /// drawing. A text for which there is no room is left out.
    pub fn labels(&mut self, places: &[([f64; 2], String)]) {
        let mut taken: Vec<[f64; 4]> =
            places.iter().map(|([x, y], _)| [x - DOT_PX, y - DOT_PX, x + DOT_PX, y + DOT_PX]).collect();
        for ([x, y], text) in places {
            let (width, half) = (0.6 * TEXT_PX * text.chars().count() as f64, 0.5 * TEXT_PX);
            let beside = DOT_PX + 2.0;
            let sides = [
                ([x + beside, *y], "start", [x + beside, y - half, x + beside + width, y + half]),
                ([x - beside, *y], "end", [x - beside - width, y - half, x - beside, y + half]),
                ([*x, y - beside - half], "middle", around([*x, y - beside - half], width, half)),
                ([*x, y + beside + half], "middle", around([*x, y + beside + half], width, half)),
            ];
            let is_within =
                |b: &[f64; 4]| b[0] >= 0.0 && b[1] >= 0.0 && b[2] <= self.size[0] && b[3] <= self.size[1];
            let covers =
                |a: &[f64; 4], b: &[f64; 4]| a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
            let free = sides
                .into_iter()
                .find(|(.., area)| is_within(area) && !taken.iter().any(|b| covers(area, b)));
            if let Some((at, anchor, area)) = free {
                self.text(at, anchor, text);
                taken.push(area);
            }
        }
    }

    /// The drawing as an SVG element, which is also a complete SVG file; `label` is the description for screen readers.
    #[must_use]
    pub fn svg(&self, label: &str) -> String {
        let [width, height] = self.size;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" role=\"img\" \
             aria-label=\"{}\" font-family=\"system-ui, sans-serif\" font-size=\"{TEXT_PX}\" fill=\"currentColor\">\n{}</svg>\n",
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

/// The area of a text around its middle: left, top, right, bottom.
fn around([x, y]: [f64; 2], width: f64, half: f64) -> [f64; 4] {
    [x - 0.5 * width, y - half, x + 0.5 * width, y + half]
}

/// Escapes a text for the content or an attribute of an XML or HTML element.
#[must_use]
pub fn escape_xml(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_neither_overlap_nor_leave_the_drawing() {
        let mut drawing = Drawing::new(100.0, 60.0);
        let at = |x: f64, y: f64| ([x, y], "name".to_owned());
        drawing.labels(&[at(50.0, 30.0), at(90.0, 30.0), at(52.0, 31.0), at(51.0, 30.0), at(50.0, 29.0)]);
        let svg = drawing.svg("dots");
        let xml = roxmltree::Document::parse(&svg).unwrap();
        let anchors: Vec<_> = xml.descendants().filter_map(|n| n.attribute("text-anchor")).collect();
        // The second has no room to its right; of the crowd around the first some are left out.
        assert!(anchors.len() < 5 && anchors.contains(&"end") || anchors.contains(&"middle"), "{svg}");
    }
}
