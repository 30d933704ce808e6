//! Charts with two numeric axes: simulation against hardware, and frames per second against environments.

use plotters::prelude::*;

use crate::page::canvas::{color, svg};

/// Points of one series, in percent.
pub(crate) struct Scatter {
    pub(crate) name: String,
    pub(crate) points: Vec<(f64, f64)>,
    pub(crate) color: RGBColor,
}

/// Frames per second of one series over the number of environments.
#[derive(Clone, Debug)]
pub(crate) struct FpsSeries {
    pub(crate) name: String,
    pub(crate) points: Vec<(f64, f64)>,
}

/// Slope, offset and coefficient of determination of a least-squares line.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub(crate) struct FittedLine {
    pub(crate) slope: f64,
    pub(crate) offset: f64,
    pub(crate) r_squared: f64,
}

/// Draws success in simulation (y) against success on hardware (x) with its least-squares line.
pub(crate) fn regression(series: &[Scatter]) -> anyhow::Result<(String, Option<FittedLine>)> {
    let points: Vec<(f64, f64)> = series.iter().flat_map(|one| one.points.iter().copied()).collect();
    let line = least_squares(&points);
    let text = svg([720, 420], |canvas| {
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
        }
        if let Some(line) = line {
            let ends = [0.0, 100.0].map(|x| (x, line.offset + line.slope * x));
            chart.draw_series(LineSeries::new(ends, BLACK.stroke_width(1)))?;
        }
        Ok(())
    })?;
    Ok((text, line))
}

/// Draws frames per second of several series, each in its own colour.
pub(crate) fn fps_svg(series: Vec<FpsSeries>) -> anyhow::Result<String> {
    let colored = |(idx, FpsSeries { name, points })| Scatter { name, points, color: color(idx) };
    fps_curve(&series.into_iter().enumerate().map(colored).collect::<Vec<_>>())
}

/// Draws frames per second (y) against the number of environments (x), both logarithmic.
pub(crate) fn fps_curve(series: &[Scatter]) -> anyhow::Result<String> {
    let all = || series.iter().flat_map(|one| one.points.iter());
    let max_x = all().map(|point| point.0).fold(2.0, f64::max);
    let max_y = all().map(|point| point.1).fold(2.0, f64::max);
    let min_y = all().map(|point| point.1).fold(f64::INFINITY, f64::min).min(max_y / 2.0).max(1e-3);
    svg([720, 360], |canvas| {
        let legend: Vec<(String, RGBColor)> =
            series.iter().map(|one| (one.name.clone(), one.color)).collect();
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
        for one in series {
            chart.draw_series(LineSeries::new(one.points.iter().copied(), one.color.stroke_width(2)))?;
            chart.draw_series(one.points.iter().map(|point| Circle::new(*point, 3, one.color.filled())))?;
        }
        Ok(())
    })
}

/// Returns the line of least squares; `None` without two different x.
fn least_squares(points: &[(f64, f64)]) -> Option<FittedLine> {
    let n = points.len() as f64;
    let mean = |value: fn(&(f64, f64)) -> f64| points.iter().map(value).sum::<f64>() / n;
    let (mean_x, mean_y) = (mean(|point| point.0), mean(|point| point.1));
    let sum =
        |term: fn(f64, f64) -> f64| -> f64 { points.iter().map(|(x, y)| term(x - mean_x, y - mean_y)).sum() };
    let (xx, xy, yy) = (sum(|x, _| x * x), sum(|x, y| x * y), sum(|_, y| y * y));
    (xx > 0.0).then(|| {
        let slope = xy / xx;
        let r_squared = if yy > 0.0 { xy * xy / (xx * yy) } else { 1.0 };
        FittedLine { slope, offset: mean_y - slope * mean_x, r_squared }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `numpy.polyfit([0, 20, 40, 80], [10, 35, 30, 70], 1)` gives 0.692857 and 12.
    #[test]
    fn least_squares_matches_known_line() {
        let points = [(0.0, 10.0), (20.0, 35.0), (40.0, 30.0), (80.0, 70.0)];
        let line = least_squares(&points).unwrap();
        assert!((line.slope - 0.692_857).abs() < 1e-5, "{line:?}");
        assert!((line.offset - 12.0).abs() < 1e-9, "{line:?}");
        assert!((line.r_squared - 0.899_092).abs() < 1e-5, "{line:?}");
        assert_eq!(least_squares(&points[..1]), None);
    }
}
