//! Charts with two numeric axes: success in simulation against hardware, success over time, and frames per
//! second against environments.

use crate::study::page::content::FittedLine;
use crate::study::page::drawings::canvas::{AxisRange, Canvas, Color, INK, TextAnchor, color, svgs};

/// A series of a chart: points in the units of the axes.
#[derive(Clone, Debug)]
pub(crate) struct Curve {
    pub(crate) name: String,
    pub(crate) color: Color,
    pub(crate) line: Vec<[f64; 2]>,
    pub(crate) dots: Vec<[f64; 2]>,
    /// A further point with a text.
    pub(crate) mark: Option<([f64; 2], String)>,
}

const HEIGHT: f64 = 380.0;

impl Curve {
    /// Makes the `idx`-th series of a chart from points joined by a line.
    pub(crate) fn joined(idx: usize, name: String, points: Vec<[f64; 2]>) -> Self {
        Self { name, color: color(idx), line: points.clone(), dots: points, mark: None }
    }
}

/// Draws frames per second (y) against the number of environments (x), both logarithmic.
pub(crate) fn fps_svgs(curves: &[Curve]) -> Option<[String; 2]> {
    let marks = curves.iter().filter_map(|curve| Some(&curve.mark.as_ref()?.0));
    let all: Vec<&[f64; 2]> = curves.iter().flat_map(|curve| &curve.dots).chain(marks).collect();
    let max = |axis: usize| all.iter().map(|point| point[axis]).fold(2.0, f64::max);
    let min_y = all.iter().map(|point| point[1]).fold(max(1) / 2.0, f64::min).max(1e-3);
    let x = AxisRange { name: "environments", values: [1.0, 1.1 * max(0)], is_log: true };
    let y = AxisRange { name: "frames per second", values: [min_y / 1.2, 1.2 * max(1)], is_log: true };
    chart([x, y], curves)
}

/// Draws the series over a grid; `None` without any.
pub(crate) fn chart(axes: [AxisRange<'_>; 2], curves: &[Curve]) -> Option<[String; 2]> {
    let legend: Vec<_> = curves.iter().map(|curve| (curve.name.clone(), curve.color)).collect();
    let draw = |canvas: &mut Canvas| {
        let top = canvas.legend(&legend);
        let [x, y] = canvas.chart(axes, [top, top + HEIGHT]);
        let at = |point: &[f64; 2]| [x.at(point[0]), y.at(point[1])];
        for Curve { color, line, dots, mark, .. } in curves {
            canvas.line(&line.iter().map(at).collect::<Vec<_>>(), *color, 2.0, false);
            dots.iter().for_each(|dot| canvas.dot(at(dot), 3.0, *color));
            if let Some((point, text)) = mark {
                let [x, y] = at(point);
                canvas.dot([x, y], 6.0, INK);
                canvas.dot([x, y], 4.0, *color);
                canvas.text([x, y + 16.0], text, TextAnchor::Middle);
            }
        }
        top + HEIGHT
    };
    (!curves.is_empty()).then(|| svgs(draw))
}

/// Returns the ends of the part of a line that lies within percentages.
pub(crate) fn within_percent(FittedLine { slope, offset, .. }: FittedLine) -> Vec<[f64; 2]> {
    let crossings = [0.0, 100.0].map(|y| (y - offset) / slope).into_iter().filter(|x| x.is_finite());
    let mut ends: Vec<[f64; 2]> =
        [0.0, 100.0].into_iter().chain(crossings).map(|x| [x, offset + slope * x]).collect();
    ends.retain(|point| point.iter().all(|value| (-1e-9..=100.0 + 1e-9).contains(value)));
    ends.sort_by(|a, b| a[0].total_cmp(&b[0]));
    ends
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_ends_at_the_frame() {
        let line = |slope, offset| within_percent(FittedLine { slope, offset, r_squared: None });
        assert_eq!(line(1.5, 10.0), [[0.0, 10.0], [60.0, 100.0]]);
        assert_eq!(line(0.0, 50.0), [[0.0, 50.0], [100.0, 50.0]]);
        assert_eq!(line(1.0, 200.0), Vec::<[f64; 2]>::new());
    }
}
