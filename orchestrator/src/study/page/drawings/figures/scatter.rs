//! Charts with two numeric axes: simulation against hardware, and frames per second against environments.

use crate::study::page::content::FittedLine;
use crate::study::page::drawings::canvas::{AxisRange, Color, FigureLegend, color, svgs};

/// Points of one series, in percent.
pub(crate) struct Scatter {
    pub(crate) name: String,
    pub(crate) points: Vec<[f64; 2]>,
    pub(crate) line: Option<FittedLine>,
    pub(crate) color: Color,
}

/// Frames per second of one series over the number of environments.
#[derive(Clone, Debug)]
pub(crate) struct FpsSeries {
    pub(crate) name: String,
    pub(crate) points: Vec<(f64, f64)>,
}

/// Height of a chart.
const HEIGHT: f64 = 380.0;

/// Draws success in simulation (y) against success on hardware (x) with the lines of the series.
pub(crate) fn regression(series: &[Scatter]) -> [String; 2] {
    let legend: FigureLegend = series.iter().map(|one| (one.name.clone(), one.color)).collect();
    let range = |name| AxisRange { name, values: [0.0, 100.0], is_log: false };
    svgs(|canvas| {
        let top = canvas.legend(&legend);
        let axes = [range("success on hardware, %"), range("success in simulation, %")];
        let [x, y] = canvas.chart(axes, [top, top + HEIGHT]);
        for one in series {
            for point in &one.points {
                canvas.dot([x.at(point[0]), y.at(point[1])], 4.0, one.color);
            }
            if let Some(line) = one.line {
                let ends: Vec<[f64; 2]> =
                    inside(line).into_iter().map(|point| [x.at(point[0]), y.at(point[1])]).collect();
                canvas.line(&ends, one.color, 1.0, false);
            }
        }
        top + HEIGHT
    })
}

/// Returns the ends of the part of a line that lies within the axes.
fn inside(FittedLine { slope, offset, .. }: FittedLine) -> Vec<[f64; 2]> {
    let crossings = [0.0, 100.0].map(|y| (y - offset) / slope).into_iter().filter(|x| x.is_finite());
    let mut ends: Vec<[f64; 2]> =
        [0.0, 100.0].into_iter().chain(crossings).map(|x| [x, offset + slope * x]).collect();
    ends.retain(|point| point.iter().all(|value| (-1e-9..=100.0 + 1e-9).contains(value)));
    ends.sort_by(|a, b| a[0].total_cmp(&b[0]));
    ends
}

/// Draws frames per second (y) against the number of environments (x), both logarithmic.
pub(crate) fn fps_svgs(series: &[FpsSeries]) -> [String; 2] {
    let all = || series.iter().flat_map(|one| one.points.iter());
    let max_x = all().map(|point| point.0).fold(2.0, f64::max);
    let max_y = all().map(|point| point.1).fold(2.0, f64::max);
    let min_y = all().map(|point| point.1).fold(f64::INFINITY, f64::min).min(max_y / 2.0).max(1e-3);
    let legend: FigureLegend =
        series.iter().enumerate().map(|(idx, one)| (one.name.clone(), color(idx))).collect();
    svgs(|canvas| {
        let top = canvas.legend(&legend);
        let x = AxisRange { name: "environments", values: [1.0, 1.1 * max_x], is_log: true };
        let y = AxisRange { name: "frames per second", values: [min_y / 1.2, 1.2 * max_y], is_log: true };
        let [x, y] = canvas.chart([x, y], [top, top + HEIGHT]);
        for (idx, FpsSeries { points, .. }) in series.iter().enumerate() {
            let points: Vec<[f64; 2]> =
                points.iter().map(|(envs, speed)| [x.at(*envs), y.at(*speed)]).collect();
            canvas.line(&points, color(idx), 2.0, false);
            points.iter().for_each(|point| canvas.dot(*point, 3.0, color(idx)));
        }
        top + HEIGHT
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_ends_at_the_frame() {
        let line = |slope, offset| inside(FittedLine { slope, offset, r_squared: None });
        assert_eq!(line(1.5, 10.0), [[0.0, 10.0], [60.0, 100.0]]);
        assert_eq!(line(0.0, 50.0), [[0.0, 50.0], [100.0, 50.0]]);
        assert_eq!(line(1.0, 200.0), Vec::<[f64; 2]>::new());
    }
}
