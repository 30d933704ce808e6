//! Drawing of figures as SVG text, in pixels from the upper left corner.
//!
//! No crate of charts would replace it: `plotters` has neither rows with labels and notes nor forest plots,
//! and `charming` draws in a browser or an embedded JavaScript engine.

use std::fmt::{self, Display, Formatter, Write};

/// A colour of sRGB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Color(pub(crate) u8, pub(crate) u8, pub(crate) u8);

/// Colours of policies that can also be told apart by people with a colour vision deficiency (M. Okabe,
/// K. Ito, 2008).
const PALETTE: [Color; 7] = [
    Color(0, 114, 178),
    Color(230, 159, 0),
    Color(0, 158, 115),
    Color(204, 121, 167),
    Color(86, 180, 233),
    Color(213, 94, 0),
    Color(120, 120, 60),
];
/// Colour of text and axes.
pub(crate) const INK: Color = Color(34, 40, 49);
/// Colour of grid lines.
pub(crate) const GRID: Color = Color(221, 225, 230);
/// Size of all text in pixels.
const TEXT: f64 = 12.5;
/// Widths of a figure in pixels: on a desktop and on a phone.
const WIDTHS: [f64; 2] = [960.0, 340.0];
/// Height of a line of a legend.
const LEGEND_LINE: f64 = 20.0;
/// Room around a figure.
pub(crate) const MARGIN: f64 = 8.0;
/// Room to the left of an axis on a phone, for half of its first number.
pub(crate) const NARROW_MARGIN: f64 = 24.0;

/// A figure of the page.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Figure {
    /// Identifier in links.
    pub(crate) id: String,
    pub(crate) title: String,
    /// Explanation of what is shown.
    pub(crate) caption: String,
    /// The figure in each of [`WIDTHS`].
    pub(crate) svgs: [String; 2],
}

/// Entries of a legend: names with their colours.
pub(crate) type FigureLegend = Vec<(String, Color)>;

/// A figure in the making. Its height is that of what was drawn.
pub(crate) struct Canvas {
    pub(crate) width: f64,
    elements: String,
}

/// The side of a text that its position states.
#[derive(Clone, Copy, Debug)]
pub(crate) enum TextAnchor {
    Start,
    Middle,
    End,
}

impl Display for Color {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }
}

/// Returns the colour of the `idx`-th policy.
pub(crate) fn color(idx: usize) -> Color {
    PALETTE[idx % PALETTE.len()]
}

/// Returns the figure in both widths. `draw` returns its height.
pub(crate) fn svgs(draw: impl Fn(&mut Canvas) -> f64) -> [String; 2] {
    WIDTHS.map(|width| svg(width, &draw))
}

/// Returns the SVG text of what `draw` draws; `draw` returns the height.
fn svg(width: f64, draw: impl Fn(&mut Canvas) -> f64) -> String {
    let mut canvas = Canvas { width, elements: String::new() };
    let height = draw(&mut canvas).ceil();
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"{TEXT}\">{}</svg>",
        canvas.elements
    )
}

/// Returns about how wide a text is.
pub(crate) fn text_width(text: &str) -> f64 {
    0.56 * TEXT * text.chars().count() as f64
}

/// Returns the width of a column of texts beside an axis, at most `limit`.
pub(crate) fn column_width<'a>(texts: impl Iterator<Item = &'a str>, limit: f64) -> f64 {
    (texts.map(text_width).fold(0.0, f64::max) + 2.0 * MARGIN).min(limit)
}

/// Returns the text, or its beginning if it is wider than `room`.
fn shortened(text: &str, room: f64) -> String {
    if text_width(text) <= room {
        return text.to_owned();
    }
    let n_chars = (room / text_width("x")) as usize;
    text.chars().take(n_chars.saturating_sub(1)).chain(['…']).collect()
}

impl Canvas {
    /// Returns `true` on a phone, where labels stand above what they name.
    pub(crate) fn is_narrow(&self) -> bool {
        self.width < 500.0
    }

    fn element(&mut self, element: fmt::Arguments<'_>) {
        self.elements.write_fmt(element).expect("a string takes any text");
    }

    /// Writes text whose middle is at `y`, shortened to what the figure has room for.
    pub(crate) fn text(&mut self, [x, y]: [f64; 2], text: &str, anchor: TextAnchor) {
        let (anchor, room) = match anchor {
            TextAnchor::Start => ("start", self.width - x),
            TextAnchor::Middle => ("middle", 2.0 * x.min(self.width - x)),
            TextAnchor::End => ("end", x),
        };
        let text = shortened(text, room).replace('&', "&amp;").replace('<', "&lt;");
        let y = y + 0.35 * TEXT;
        self.element(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{INK}\">{text}</text>"
        ));
    }

    /// Draws a line, of dashes if wanted.
    pub(crate) fn line(&mut self, points: &[[f64; 2]], color: Color, width: f64, is_dashed: bool) {
        let dashes = if is_dashed { " stroke-dasharray=\"6 4\"" } else { "" };
        let points = Points(points);
        self.element(format_args!(
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\"{dashes}/>"
        ));
    }

    pub(crate) fn polygon(&mut self, points: &[[f64; 2]], color: Color, opacity: f64) {
        let points = Points(points);
        self.element(format_args!(
            "<polygon points=\"{points}\" fill=\"{color}\" fill-opacity=\"{opacity}\"/>"
        ));
    }

    pub(crate) fn rectangle(&mut self, [left, top]: [f64; 2], [right, bottom]: [f64; 2], color: Color) {
        let (width, height) = (right - left, bottom - top);
        self.element(format_args!(
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{color}\"/>"
        ));
    }

    pub(crate) fn dot(&mut self, [x, y]: [f64; 2], radius: f64, color: Color) {
        self.element(format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{color}\"/>"));
    }

    /// Draws coloured squares with names, in as many lines as they take, and returns where they end.
    pub(crate) fn legend(&mut self, entries: &[(String, Color)]) -> f64 {
        let (mut x, mut y) = (MARGIN, MARGIN + LEGEND_LINE / 2.0);
        for (name, color) in entries {
            let width = 34.0 + text_width(name);
            if x > MARGIN && x + width > self.width {
                (x, y) = (MARGIN, y + LEGEND_LINE);
            }
            self.rectangle([x, y - 5.0], [x + 10.0, y + 5.0], *color);
            self.text([x + 15.0, y], name, TextAnchor::Start);
            x += width;
        }
        y + LEGEND_LINE / 2.0 + MARGIN
    }

    /// Draws the vertical grid lines of a horizontal axis, with their values below.
    pub(crate) fn grid(&mut self, axis: &Axis, [top, bottom]: [f64; 2], unit: &str) {
        for (value, x) in axis.ticks() {
            self.line(&[[x, top], [x, bottom]], GRID, 1.0, false);
            self.text([x, bottom + 12.0], &format!("{value}{unit}"), TextAnchor::Middle);
        }
    }

    /// Draws a grid with both axes and their names, between `top` and `bottom`. Returns the axes.
    pub(crate) fn chart(&mut self, [x, y]: [AxisRange<'_>; 2], [top, bottom]: [f64; 2]) -> [Axis; 2] {
        let horizontal = Axis { range: x.values, pixels: [60.0, self.width - 20.0], is_log: x.is_log };
        let vertical = Axis { range: y.values, pixels: [bottom - 44.0, top + 20.0], is_log: y.is_log };
        let [left, right] = horizontal.pixels;
        self.grid(&horizontal, [vertical.pixels[1], vertical.pixels[0]], "");
        for (value, at) in vertical.ticks() {
            self.line(&[[left, at], [right, at]], GRID, 1.0, false);
            self.text([left - 6.0, at], &value, TextAnchor::End);
        }
        self.text([0.5 * (left + right), bottom - 12.0], x.name, TextAnchor::Middle);
        self.text([MARGIN, top + 4.0], y.name, TextAnchor::Start);
        [horizontal, vertical]
    }
}

/// The points of an element.
struct Points<'a>(&'a [[f64; 2]]);

impl Display for Points<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|[x, y]| write!(f, "{x:.1},{y:.1} "))
    }
}

/// The values and the name of an axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AxisRange<'a> {
    pub(crate) name: &'a str,
    pub(crate) values: [f64; 2],
    pub(crate) is_log: bool,
}

impl<'a> AxisRange<'a> {
    /// Makes an axis from 0 to 100 %.
    pub(crate) fn percent(name: &'a str) -> Self {
        Self { name, values: [0.0, 100.0], is_log: false }
    }
}

/// An axis: maps values to pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    pub(crate) range: [f64; 2],
    pub(crate) pixels: [f64; 2],
    pub(crate) is_log: bool,
}

impl Axis {
    /// Makes a horizontal axis in equal steps.
    pub(crate) fn linear(range: [f64; 2], pixels: [f64; 2]) -> Self {
        Self { range, pixels, is_log: false }
    }

    /// Returns the pixel of a value. Values beyond the axis are drawn at its end.
    pub(crate) fn at(&self, value: f64) -> f64 {
        let scale = |value: f64| if self.is_log { libm::log2(value) } else { value };
        let [low, high] = self.range.map(scale);
        let [start, end] = self.pixels;
        start + (end - start) * ((scale(value) - low) / (high - low)).clamp(0.0, 1.0)
    }

    /// Returns up to about eight round values as texts, with their pixels.
    fn ticks(&self) -> Vec<(String, f64)> {
        let values = if self.is_log { self.log_ticks() } else { self.linear_ticks() };
        values.into_iter().map(|value| (format!("{value}"), self.at(value))).collect()
    }

    /// Returns powers of ten and, where they are few, of two.
    fn log_ticks(&self) -> Vec<f64> {
        let [low, high] = self.range;
        let powers = |base: f64| -> Vec<f64> {
            let first = (libm::log(low) / libm::log(base)).ceil() as i32;
            let last = (libm::log(high) / libm::log(base)).floor() as i32;
            (first..=last).map(|power| libm::pow(base, f64::from(power))).collect()
        };
        let (tens, twos) = (powers(10.0), powers(2.0));
        if twos.len() <= 8 || tens.len() < 2 { twos.into_iter().take(9).collect() } else { tens }
    }

    fn linear_ticks(&self) -> Vec<f64> {
        let [low, high] = self.range;
        let room = ((self.pixels[1] - self.pixels[0]).abs() / 40.0).clamp(2.0, 8.0);
        let steps = [1.0, 2.0, 5.0, 10.0, 20.0, 25.0, 50.0, 100.0];
        let fits = |step: &f64| (high - low) / step <= room;
        let step = steps.into_iter().find(fits).unwrap_or_else(|| {
            // 200, 500, 1000 and so on; the largest range takes about a thousand of them.
            let larger = [2.0, 2.5, 2.0].into_iter().cycle().scan(100.0, |step, factor| {
                *step *= factor;
                Some(*step)
            });
            larger.take(1000).find(fits).unwrap_or(f64::INFINITY)
        });
        let first = (low / step).ceil() as i64;
        let last = (high / step).floor() as i64;
        (first..=last).map(|k| k as f64 * step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Found by fuzzing: a long axis had a tick every 200 units.
    #[test]
    fn axis_has_at_most_nine_ticks() {
        let ticks = |high| Axis::linear([0.0, high], [0.0, 1000.0]).linear_ticks();
        assert_eq!(ticks(100.0), [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        assert_eq!(ticks(1700.0), [0.0, 500.0, 1000.0, 1500.0]);
        for high in [1e-9, 7e4, 1e12, 1e300, f64::MAX, f64::INFINITY] {
            assert!(ticks(high).len() <= 9, "{high}");
        }
        for high in [2.0, 300.0, 1e12] {
            let axis = Axis { range: [1.0, high], pixels: [0.0, 100.0], is_log: true };
            assert!((2..=13).contains(&axis.log_ticks().len()), "{high}: {:?}", axis.log_ticks());
        }
    }

    #[test]
    fn names_are_text() {
        let drawn = svg(100.0, |canvas| canvas.legend(&[("<b>&".to_owned(), INK)]));
        assert!(drawn.contains(">&lt;b>&amp;</text>"), "{drawn}");
        let drawn = svg(100.0, |canvas| canvas.legend(&[("x".repeat(100), INK)]));
        assert!(drawn.contains("xxx…</text>") && !drawn.contains(&"x".repeat(20)), "{drawn}");
    }
}
