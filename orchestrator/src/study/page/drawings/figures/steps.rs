//! Success over time: the share of episodes that have succeeded by each part of the horizon.

use crate::study::page::drawings::canvas::{AxisRange, Color, FigureLegend, svgs};

/// The curve of one policy.
pub(crate) struct StepCurve {
    pub(crate) name: String,
    /// Times of first successes as fractions of the horizon, ascending.
    pub(crate) times: Vec<f64>,
    /// Number of episodes, including those without success.
    pub(crate) n_episodes: u32,
    pub(crate) color: Color,
}

/// Height of the chart.
const HEIGHT: f64 = 340.0;

/// Draws one staircase per policy.
pub(crate) fn success_over_time(curves: &[StepCurve]) -> [String; 2] {
    let name = |curve: &StepCurve| format!("{} ({} of {})", curve.name, curve.times.len(), curve.n_episodes);
    let legend: FigureLegend = curves.iter().map(|curve| (name(curve), curve.color)).collect();
    let range = |name| AxisRange { name, values: [0.0, 100.0], is_log: false };
    svgs(|canvas| {
        let top = canvas.legend(&legend);
        let axes = [range("control step, % of the horizon"), range("episodes that have succeeded, %")];
        let [x, y] = canvas.chart(axes, [top, top + HEIGHT]);
        for curve in curves {
            let n = f64::from(curve.n_episodes.max(1));
            let mut points = vec![[0.0, 0.0]];
            for (idx, time) in curve.times.iter().enumerate() {
                points.push([100.0 * time, 100.0 * idx as f64 / n]);
                points.push([100.0 * time, 100.0 * (idx + 1) as f64 / n]);
            }
            points.push([100.0, 100.0 * curve.times.len() as f64 / n]);
            let points: Vec<[f64; 2]> =
                thinned(&points).into_iter().map(|point| [x.at(point[0]), y.at(point[1])]).collect();
            canvas.line(&points, curve.color, 2.0, false);
        }
        top + HEIGHT
    })
}

/// Keeps at most about a thousand points, the first and the last among them.
fn thinned(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let step = points.len().div_ceil(1000).max(1);
    let last = points.len() - 1;
    let kept = points.iter().enumerate().filter(|(idx, _)| idx % step == 0 || *idx == last);
    kept.map(|(_, point)| *point).collect()
}
