//! Success over time: the share of episodes that have succeeded by each part of the horizon.

use plotters::prelude::*;

use crate::page::canvas::svg;

/// The curve of one policy.
pub(crate) struct StepCurve {
    pub(crate) name: String,
    /// Times of first successes as fractions of the horizon, ascending.
    pub(crate) times: Vec<f64>,
    /// Number of episodes, including those without success.
    pub(crate) n_episodes: u32,
    pub(crate) color: RGBColor,
}

/// Draws one staircase per policy.
pub(crate) fn success_over_time(curves: &[StepCurve]) -> anyhow::Result<String> {
    svg([720, 340], |canvas| {
        let legend: Vec<(String, RGBColor)> =
            curves.iter().map(|curve| (curve.name.clone(), curve.color)).collect();
        canvas.legend(60.0, 14.0, &legend)?;
        let area = canvas.below(28.0);
        let mut chart = ChartBuilder::on(&area)
            .margin(8)
            .x_label_area_size(42)
            .y_label_area_size(52)
            .build_cartesian_2d(0.0..100.0, 0.0..100.0)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .x_desc("control step, % of the horizon")
            .y_desc("episodes that have succeeded, %")
            .draw()?;
        for curve in curves {
            let n = f64::from(curve.n_episodes.max(1));
            let mut points = vec![(0.0, 0.0)];
            for (idx, time) in curve.times.iter().enumerate() {
                points.push((100.0 * time, 100.0 * idx as f64 / n));
                points.push((100.0 * time, 100.0 * (idx + 1) as f64 / n));
            }
            points.push((100.0, 100.0 * curve.times.len() as f64 / n));
            chart.draw_series(LineSeries::new(thinned(points), curve.color.stroke_width(2)))?;
        }
        Ok(())
    })
}

/// Keeps at most about a thousand points, the first and the last among them.
fn thinned(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let step = points.len().div_ceil(1000).max(1);
    let last = points.len() - 1;
    points
        .into_iter()
        .enumerate()
        .filter(|(idx, _)| idx % step == 0 || *idx == last)
        .map(|(_, point)| point)
        .collect()
}
