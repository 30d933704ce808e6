//! Drawing of figures as SVG text, in pixels from the upper left corner.

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Colours of policies that can also be told apart by people with a colour vision deficiency (M. Okabe,
/// K. Ito, 2008).
const PALETTE: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(230, 159, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(213, 94, 0),
    RGBColor(120, 120, 60),
];
/// Colour of text and axes.
pub(super) const INK: RGBColor = RGBColor(34, 40, 49);
/// Colour of grid lines.
pub(super) const GRID: RGBColor = RGBColor(221, 225, 230);

/// A figure of the page.
#[derive(Clone, Debug, serde::Serialize)]
pub(crate) struct Figure {
    /// Identifier in links.
    pub(crate) id: String,
    pub(crate) title: String,
    /// Explanation of what is shown.
    pub(crate) caption: String,
    pub(crate) svg: String,
}

/// The drawing area of a figure.
pub(super) struct Canvas<'a> {
    area: DrawingArea<SVGBackend<'a>, Shift>,
}

/// The horizontal side of a text that its position states.
#[derive(Clone, Copy, Debug)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// Returns the colour of the `idx`-th policy.
pub(super) fn color(idx: usize) -> RGBColor {
    PALETTE[idx % PALETTE.len()]
}

/// Returns the SVG text of what `draw` draws.
pub(super) fn svg(
    [width, height]: [u32; 2],
    draw: impl FnOnce(&Canvas<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<String> {
    let mut text = String::new();
    {
        let canvas = Canvas { area: SVGBackend::with_string(&mut text, (width, height)).into_drawing_area() };
        draw(&canvas)?;
        canvas.area.present()?;
    }
    Ok(text)
}

impl<'a> Canvas<'a> {
    /// Returns the part of the area below `top` pixels, for charts with axes.
    pub(super) fn below(&self, top: f64) -> DrawingArea<SVGBackend<'a>, Shift> {
        self.area.clone().split_vertically(top as i32).1
    }

    pub(super) fn text(&self, [x, y]: [f64; 2], text: &str, size: f64, anchor: Anchor) -> anyhow::Result<()> {
        let horizontal = match anchor {
            Anchor::Start => HPos::Left,
            Anchor::Middle => HPos::Center,
            Anchor::End => HPos::Right,
        };
        let style = ("sans-serif", size).into_text_style(&self.area).color(&INK);
        let style = style.pos(Pos::new(horizontal, VPos::Center));
        Ok(self.area.draw(&Text::new(text.to_owned(), pixel([x, y]), style))?)
    }

    pub(super) fn line(&self, points: &[[f64; 2]], color: RGBColor, width: u32) -> anyhow::Result<()> {
        let points: Vec<(i32, i32)> = points.iter().map(|point| pixel(*point)).collect();
        Ok(self.area.draw(&PathElement::new(points, color.stroke_width(width)))?)
    }

    pub(super) fn dashed_line(&self, points: &[[f64; 2]], color: RGBColor, width: u32) -> anyhow::Result<()> {
        let points: Vec<(i32, i32)> = points.iter().map(|point| pixel(*point)).collect();
        let style = color.stroke_width(width);
        Ok(self.area.draw(&DashedPathElement::new(points, 5, 4, style))?)
    }

    pub(super) fn polygon(&self, points: &[[f64; 2]], color: RGBColor, opacity: f64) -> anyhow::Result<()> {
        let points: Vec<(i32, i32)> = points.iter().map(|point| pixel(*point)).collect();
        Ok(self.area.draw(&Polygon::new(points, color.mix(opacity)))?)
    }

    pub(super) fn rectangle(&self, from: [f64; 2], to: [f64; 2], color: RGBColor) -> anyhow::Result<()> {
        Ok(self.area.draw(&Rectangle::new([pixel(from), pixel(to)], color.filled()))?)
    }

    pub(super) fn dot(&self, at: [f64; 2], radius: u32, color: RGBColor) -> anyhow::Result<()> {
        Ok(self.area.draw(&Circle::new(pixel(at), radius, color.filled()))?)
    }

    /// Draws one coloured square and name per entry in a row, starting at `left`.
    pub(super) fn legend(&self, left: f64, y: f64, entries: &[(String, RGBColor)]) -> anyhow::Result<()> {
        let mut x = left;
        for (name, color) in entries {
            self.rectangle([x, y - 5.0], [x + 10.0, y + 5.0], *color)?;
            self.text([x + 15.0, y], name, 13.0, Anchor::Start)?;
            x += 32.0 + 7.2 * name.chars().count() as f64;
        }
        Ok(())
    }

    /// Draws the vertical grid of a horizontal axis, with its labels below.
    pub(super) fn grid(&self, axis: &Axis, [top, bottom]: [f64; 2], unit: &str) -> anyhow::Result<()> {
        for value in axis.ticks() {
            let x = axis.at(value);
            self.line(&[[x, top], [x, bottom]], GRID, 1)?;
            self.text([x, bottom + 12.0], &format!("{value:.0}{unit}"), 12.0, Anchor::Middle)?;
        }
        Ok(())
    }
}

/// A horizontal axis: maps values to pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    pub(super) values: [f64; 2],
    pub(super) pixels: [f64; 2],
}

impl Axis {
    /// Returns the pixel of a value. Values beyond the axis are drawn at its end.
    pub(super) fn at(&self, value: f64) -> f64 {
        let ([low, high], [left, right]) = (self.values, self.pixels);
        left + (right - left) * ((value - low) / (high - low)).clamp(0.0, 1.0)
    }

    /// Returns up to about eight round values.
    fn ticks(&self) -> Vec<f64> {
        let [low, high] = self.values;
        let steps = [1.0, 2.0, 5.0, 10.0, 20.0, 25.0, 50.0, 100.0];
        let fits = |step: &f64| (high - low) / step <= 8.0;
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

fn pixel([x, y]: [f64; 2]) -> (i32, i32) {
    (x.round() as i32, y.round() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Found by fuzzing: a long axis had a tick every 200 units.
    #[test]
    fn axis_has_at_most_nine_ticks() {
        let ticks = |high| Axis { values: [0.0, high], pixels: [0.0, 1.0] }.ticks();
        assert_eq!(ticks(100.0), [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        assert_eq!(ticks(1700.0), [0.0, 500.0, 1000.0, 1500.0]);
        for high in [1e-9, 7e4, 1e12, 1e300, f64::MAX, f64::INFINITY] {
            assert!(ticks(high).len() <= 9, "{high}");
        }
    }
}
