//! Charts with two numeric axes: simulation against hardware, and frames per second against environments.

use plotters::prelude::*;

use crate::page::canvas::{color, svg};
use crate::page::hardware::FittedLine;

/// Points of one series, in percent.
pub(crate) struct Scatter {
    pub(crate) name: String,
    pub(crate) points: Vec<(f64, f64)>,
    pub(crate) line: Option<FittedLine>,
    pub(crate) color: RGBColor,
}

/// Frames per second of one series over the number of environments.
#[derive(Clone, Debug)]
pub(crate) struct FpsSeries {
    pub(crate) name: String,
    pub(crate) points: Vec<(f64, f64)>,
}

/// Draws success in simulation (y) against success on hardware (x) with the lines of the series.
pub(crate) fn regression(series: &[Scatter]) -> anyhow::Result<String> {
    svg([720, 420], |canvas| {
        let legend: Vec<(String, RGBColor)> =
            series.iter().map(|one| (one.name.clone(), one.color)).collect();
        canvas.legend(60.0, 14.0, &legend)?;
        let area = canvas.below(28.0);
        let mut chart = ChartBuilder::on(&area)
            .margin(8)
            .x_label_area_size(42)
            .y_label_area_size(52)
            .build_cartesian_2d(0.0..100.0, 0.0..100.0)?;
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT)
            .x_desc("success on hardware, %")
            .y_desc("success in simulation, %");
        mesh.draw()?;
        for one in series {
            let dots = one.points.iter().map(|point| Circle::new(*point, 4, one.color.filled()));
            chart.draw_series(dots)?;
            if let Some(line) = one.line {
                chart.draw_series(LineSeries::new(inside(line), one.color.stroke_width(1)))?;
            }
        }
        Ok(())
    })
}

/// Returns the ends of the part of a line that lies within the axes.
fn inside(FittedLine { slope, offset, .. }: FittedLine) -> Vec<(f64, f64)> {
    let at = |x: f64| (x, offset + slope * x);
    let crossings = [0.0, 100.0].map(|y| (y - offset) / slope).into_iter().filter(|x| x.is_finite());
    let mut ends: Vec<(f64, f64)> = [0.0, 100.0].into_iter().chain(crossings).map(at).collect();
    ends.retain(|(x, y)| [x, y].iter().all(|value| (-1e-9..=100.0 + 1e-9).contains(*value)));
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    ends
}

/// Draws frames per second (y) against the number of environments (x), both logarithmic.
pub(crate) fn fps_svg(series: &[FpsSeries]) -> anyhow::Result<String> {
    let all = || series.iter().flat_map(|one| one.points.iter());
    let max_x = all().map(|point| point.0).fold(2.0, f64::max);
    let max_y = all().map(|point| point.1).fold(2.0, f64::max);
    let min_y = all().map(|point| point.1).fold(f64::INFINITY, f64::min).min(max_y / 2.0).max(1e-3);
    svg([720, 360], |canvas| {
        let legend: Vec<(String, RGBColor)> =
            series.iter().enumerate().map(|(idx, one)| (one.name.clone(), color(idx))).collect();
        canvas.legend(60.0, 14.0, &legend)?;
        let area = canvas.below(28.0);
        let mut chart = ChartBuilder::on(&area)
            .margin(8)
            .x_label_area_size(42)
            .y_label_area_size(62)
            .build_cartesian_2d(
                (1.0..max_x * 1.1).log_scale().base(2.0),
                (min_y / 1.2..max_y * 1.2).log_scale(),
            )?;
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(TRANSPARENT).x_desc("environments").y_desc("frames per second");
        let whole: &dyn Fn(&f64) -> String = &|value| format!("{value:.0}");
        mesh.x_label_formatter(whole).y_label_formatter(whole);
        mesh.draw()?;
        for (idx, FpsSeries { points, .. }) in series.iter().enumerate() {
            chart.draw_series(LineSeries::new(points.iter().copied(), color(idx).stroke_width(2)))?;
            chart.draw_series(points.iter().map(|point| Circle::new(*point, 3, color(idx).filled())))?;
        }
        Ok(())
    })
}
