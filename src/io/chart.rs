//! Line charts as SVG. Text is stored as text elements; axes and text have the text colour of the surrounding page.

use super::svg::{BLUE, GREEN, ORANGE};
use super::{WriteError, escape_xml, write_file};
use std::fmt::Write;
use std::path::Path;

/// Width and height of a chart, in user units of SVG.
const SIZE: (f64, f64) = (480.0, 300.0);
/// Margins for the labels of the axes: left, top, right, bottom.
const MARGIN: (f64, f64, f64, f64) = (68.0, 42.0, 14.0, 48.0);
/// Colours of the lines, in their order.
const COLORS: [&str; 4] = [BLUE, ORANGE, GREEN, "#cc79a7"];
/// Approximate number of ticks on an axis.
const TICKS: f64 = 5.0;

/// A chart of one or more lines over common axes.
pub struct Chart {
    /// Title, plain text.
    pub title: String,
    /// Name and unit of the horizontal axis.
    pub x: String,
    /// Name and unit of the vertical axis.
    pub y: String,
    /// Name and points (x, y) of each line; a point that is not finite leaves a gap.
    pub lines: Vec<(String, Vec<(f64, f64)>)>,
}

impl Chart {
    /// The chart as an SVG element, which is also a complete SVG file; `None` if there are no finite points.
    #[must_use]
    pub fn svg(&self) -> Option<String> {
        let finite = |p: &&(f64, f64)| p.0.is_finite() && p.1.is_finite();
        let points = || self.lines.iter().flat_map(|l| &l.1).filter(finite);
        let x = ChartAxis::over(points().map(|p| p.0))?;
        let y = ChartAxis::over(points().map(|p| p.1))?.rounded();
        let ((width, height), (left, top, right, bottom)) = (SIZE, MARGIN);
        let px = |v: f64| left + (width - left - right) * x.place(v);
        let py = |v: f64| height - bottom - (height - top - bottom) * y.place(v);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" role=\"img\" \
             aria-label=\"{title}: {y_name} over {x_name}\" font-family=\"system-ui, sans-serif\" font-size=\"13\" \
             fill=\"currentColor\">\n<text x=\"{left}\" y=\"16\" font-weight=\"600\">{title}</text>\n",
            title = escape_xml(&self.title),
            x_name = escape_xml(&self.x),
            y_name = escape_xml(&self.y),
        );
        for (axis, is_x) in [(&x, true), (&y, false)] {
            for tick in axis.ticks() {
                let text = axis.text(tick);
                let _ = if is_x {
                    let (x, low) = (px(tick), height - bottom);
                    writeln!(
                        out,
                        "<path d=\"M{x:.1} {top}V{low}\" stroke=\"currentColor\" opacity=\"0.15\"/>\
                         <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{text}</text>",
                        low + 16.0
                    )
                } else {
                    let y = py(tick);
                    writeln!(
                        out,
                        "<path d=\"M{left} {y:.1}H{}\" stroke=\"currentColor\" opacity=\"0.15\"/>\
                         <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>",
                        width - right,
                        left - 6.0,
                        y + 4.5
                    )
                };
            }
        }
        let middle = |low: f64, high: f64| 0.5 * (low + high);
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\n\
             <text transform=\"translate(12 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            middle(left, width - right),
            height - 10.0,
            escape_xml(&self.x),
            middle(top, height - bottom),
            escape_xml(&self.y)
        );
        for (i, (name, points)) in self.lines.iter().enumerate() {
            let color = COLORS[i % COLORS.len()];
            let (mut path, mut pen) = (String::new(), 'M');
            for p in points {
                if !finite(&p) {
                    pen = 'M';
                    continue;
                }
                let _ = write!(path, "{pen}{:.1} {:.1}", px(p.0), py(p.1));
                pen = 'L';
            }
            let _ = writeln!(
                out,
                "<path d=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.8\" stroke-linejoin=\"round\"/>"
            );
            if self.lines.len() > 1 {
                let at = left + 8.0 + i as f64 * 120.0;
                let _ = writeln!(
                    out,
                    "<path d=\"M{at} 30h14\" stroke=\"{color}\" stroke-width=\"3\"/>\
                     <text x=\"{}\" y=\"34\" font-size=\"12\">{}</text>",
                    at + 18.0,
                    escape_xml(name)
                );
            }
        }
        out.push_str("</svg>\n");
        Some(out)
    }

    /// Writes the chart as an SVG file. Nothing is written if the chart has no finite points.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        self.svg().map_or(Ok(()), |svg| write_file(path, svg))
    }

    /// The corners of a histogram's bars as a line: `counts` of bins of equal `width`, the first of which starts at
    /// `start`.
    #[must_use]
    pub fn bars(counts: &[f64], start: f64, width: f64) -> Vec<(f64, f64)> {
        let edge = |i: usize| start + i as f64 * width;
        let bars = counts.iter().enumerate();
        bars.flat_map(|(i, count)| [(edge(i), *count), (edge(i + 1), *count)]).collect()
    }
}

/// The largest of 1, 2 and 5 times a power of ten that is not above a positive number, for lengths of scales.
#[must_use]
pub fn round_below(number: f64) -> f64 {
    let power = 10f64.powf(number.log10().floor());
    [5.0, 2.0, 1.0].map(|m| m * power).into_iter().find(|n| *n <= number * 1.001).unwrap_or(number)
}

/// Range and tick distance of one axis.
struct ChartAxis {
    low: f64,
    high: f64,
    step: f64,
}

impl ChartAxis {
    /// The axis that covers some numbers; `None` if none of them is finite.
    fn over(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return None;
        }
        let wide = if high > low { high - low } else { f64::max(1.0, 0.1 * low.abs()) };
        // The distance between ticks is 1, 2 or 5 times a power of ten.
        let raw = wide / TICKS;
        let power = 10f64.powf(raw.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= raw * 0.999);
        Some(Self { low, high: low + wide, step: step.unwrap_or(raw) })
    }

    /// The axis extended to whole ticks at both ends.
    fn rounded(self) -> Self {
        let (low, high) = ((self.low / self.step).floor(), (self.high / self.step).ceil());
        Self { low: low * self.step, high: high * self.step, ..self }
    }

    fn place(&self, v: f64) -> f64 {
        (v - self.low) / (self.high - self.low)
    }

    fn ticks(&self) -> impl Iterator<Item = f64> {
        let slack = 1e-6;
        let first = (self.low / self.step - slack).ceil() as i64;
        let last = (self.high / self.step + slack).floor() as i64;
        let step = self.step;
        (first..=last).map(move |i| i as f64 * step)
    }

    fn text(&self, tick: f64) -> String {
        let digits = (-self.step.log10().floor()).clamp(0.0, 9.0) as usize;
        format!("{tick:.digits$}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_of_scales_are_round() {
        assert_eq!([37.0, 20.0, 9.9, 1234.0].map(round_below), [20.0, 20.0, 5.0, 1000.0]);
    }

    #[test]
    fn ticks_are_round_and_cover_the_numbers() {
        let ticks = |a: f64, b: f64| {
            let axis = ChartAxis::over([a, b].into_iter()).unwrap().rounded();
            axis.ticks().map(|t| axis.text(t)).collect::<Vec<_>>()
        };
        assert_eq!(ticks(0.0, 1.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(ticks(-3.1, 11.0), ["-5", "0", "5", "10", "15"]);
        assert_eq!(ticks(1200.0, 1900.0), ["1200", "1400", "1600", "1800", "2000"]);
        assert!(ticks(7.0, 7.0).len() > 1);
    }

    #[test]
    fn a_chart_is_xml_with_its_text_escaped_and_gaps_where_nothing_is() {
        let points = vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 3.0), (3.0, 2.0)];
        let chart = Chart {
            title: "a < b & c".into(),
            x: "m".into(),
            y: "%".into(),
            lines: vec![("one".into(), points), ("two".into(), vec![(0.0, 0.0)])],
        };
        let svg = chart.svg().unwrap();
        let xml = roxmltree::Document::parse(&svg).unwrap();
        assert!(xml.descendants().any(|n| n.text() == Some("a < b & c")));
        let line = xml.descendants().find_map(|n| n.attribute("d").filter(|d| d.matches('M').count() == 2));
        assert_eq!(line.unwrap().matches('L').count(), 1);
        assert!(Chart { lines: Vec::new(), ..chart }.svg().is_none());
    }
}
