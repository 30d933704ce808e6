//! Radar chart of the paper: mean success under perturbations of language, vision and action.

use plotters::style::RGBColor;

use crate::page::canvas::{Anchor, GRID, svg};

/// The corners of one series in percent: language (top), vision, action, clockwise.
pub(crate) struct RadarSeries {
    pub(crate) name: String,
    pub(crate) values: [f64; 3],
    pub(crate) color: RGBColor,
    /// `true` for the bimanual series of a policy.
    pub(crate) is_dashed: bool,
}

const CENTRE: [f64; 2] = [250.0, 235.0];
const RADIUS: f64 = 180.0;
const AXES: [&str; 3] = ["Language", "Vision", "Action"];

/// Draws the series over rings at 25, 50, 75 and 100 %.
pub(crate) fn radar(series: &[RadarSeries]) -> anyhow::Result<String> {
    let corner = |axis: usize, percent: f64| {
        let angle = core::f64::consts::TAU * axis as f64 / 3.0;
        let radius = RADIUS * percent / 100.0;
        [CENTRE[0] + radius * libm::sin(angle), CENTRE[1] - radius * libm::cos(angle)]
    };
    let ring = |values: [f64; 3]| {
        let mut points: Vec<[f64; 2]> = values.iter().enumerate().map(|(axis, v)| corner(axis, *v)).collect();
        points.push(points[0]);
        points
    };
    svg([720, 400], |canvas| {
        for percent in [25.0, 50.0, 75.0, 100.0] {
            canvas.line(&ring([percent; 3]), GRID, 1)?;
            let [x, y] = corner(0, percent);
            canvas.text([x + 4.0, y + 8.0], &format!("{percent:.0}"), 12.0, Anchor::Start)?;
        }
        for (axis, name) in AXES.iter().enumerate() {
            canvas.line(&[CENTRE, corner(axis, 100.0)], GRID, 1)?;
            canvas.text(corner(axis, 110.0), name, 14.0, Anchor::Middle)?;
        }
        for (idx, one) in series.iter().enumerate() {
            let outline = ring(one.values);
            canvas.polygon(&outline, one.color, 0.08)?;
            let y = 60.0 + 22.0 * idx as f64;
            let sample = [[480.0, y], [505.0, y]];
            if one.is_dashed {
                canvas.dashed_line(&outline, one.color, 2)?;
                canvas.dashed_line(&sample, one.color, 2)?;
            } else {
                canvas.line(&outline, one.color, 2)?;
                canvas.line(&sample, one.color, 2)?;
            }
            canvas.text([512.0, y], &one.name, 13.0, Anchor::Start)?;
        }
        Ok(())
    })
}
