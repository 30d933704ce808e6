//! Radar chart of the paper: mean success under perturbations of language, vision and action.

use crate::study::page::drawings::canvas::{Canvas, Color, GRID, TextAnchor, svgs};

/// The corners of one series in percent: language (top), vision, action, clockwise.
pub(crate) struct RadarSeries {
    pub(crate) name: String,
    pub(crate) values: [f64; 3],
    pub(crate) color: Color,
    /// `true` for the bimanual series of a policy.
    pub(crate) is_dashed: bool,
}

const AXES: [&str; 3] = ["language", "vision", "action"];

/// Draws the series over rings at 25, 50, 75 and 100 %; `None` without any.
pub(crate) fn radar(series: &[RadarSeries]) -> Option<[String; 2]> {
    let draw = |canvas: &mut Canvas| {
        let is_narrow = canvas.is_narrow();
        let radius = if is_narrow { 110.0 } else { 190.0 };
        let centre = [if is_narrow { canvas.width / 2.0 } else { 300.0 }, radius + 40.0];
        let corner = |axis: usize, percent: f64| {
            let angle = core::f64::consts::TAU * axis as f64 / 3.0;
            let radius = radius * percent / 100.0;
            [centre[0] + radius * libm::sin(angle), centre[1] - radius * libm::cos(angle)]
        };
        let ring = |values: [f64; 3]| {
            let mut points: Vec<[f64; 2]> =
                values.iter().enumerate().map(|(axis, v)| corner(axis, *v)).collect();
            points.push(points[0]);
            points
        };
        for percent in [25.0, 50.0, 75.0, 100.0] {
            canvas.line(&ring([percent; 3]), GRID, 1.0, false);
            let [x, y] = corner(0, percent);
            canvas.text([x + 4.0, y + 8.0], &format!("{percent:.0}"), TextAnchor::Start);
        }
        for (axis, name) in AXES.iter().enumerate() {
            canvas.line(&[centre, corner(axis, 100.0)], GRID, 1.0, false);
            let [x, y] = corner(axis, 100.0);
            canvas.text([x, if axis == 0 { y - 14.0 } else { y + 14.0 }], name, TextAnchor::Middle);
        }
        let below = centre[1] + 0.5 * radius + 40.0;
        let (left, top) = if is_narrow { (8.0, below) } else { (560.0, 60.0) };
        for (idx, one) in series.iter().enumerate() {
            let outline = ring(one.values);
            canvas.polygon(&outline, one.color, 0.08);
            canvas.line(&outline, one.color, 2.0, one.is_dashed);
            let y = top + 22.0 * idx as f64;
            canvas.line(&[[left, y], [left + 25.0, y]], one.color, 2.0, one.is_dashed);
            let [language, vision, action] = one.values;
            let values = format!("{}: L {language:.0}, V {vision:.0}, A {action:.0} %", one.name);
            canvas.text([left + 32.0, y], &values, TextAnchor::Start);
        }
        below.max(top + 22.0 * series.len() as f64)
    };
    (!series.is_empty()).then(|| svgs(draw))
}
