//! Agreement of simulated success with success on hardware, by the paper's measures.

use crate::selection::condition::Condition;
use crate::study::analysis::mean;
use crate::study::page::content::external::HardwareTable;
use crate::study::page::content::{FittedLine, HardwareFit, ReportContent};

/// A condition with its success in percent on hardware and in simulation.
type Pair = (Condition, [f64; 2]);

/// Compares each policy under test with the hardware: over all tasks, then per task with at least two points.
pub(crate) fn fits(report: &ReportContent, hardware: &HardwareTable) -> Vec<HardwareFit> {
    let mut fits = Vec::new();
    for policy in report.under_test() {
        let pair = |row: &crate::study::page::content::external::HardwareRow| {
            let cell = report.cells_of(&policy.name).find(|cell| cell.condition == row.condition)?;
            Some((row.condition, [row.success_percent, 100.0 * cell.rate.fraction()?]))
        };
        let pairs: Vec<Pair> = hardware.rows.iter().filter_map(pair).collect();
        if pairs.is_empty() {
            continue;
        }
        fits.push(fit(&policy.name, None, &pairs));
        let mut tasks: Vec<_> = pairs.iter().map(|(condition, _)| condition.task).collect();
        tasks.sort_unstable();
        tasks.dedup();
        for task in tasks {
            let own: Vec<Pair> =
                pairs.iter().filter(|(condition, _)| condition.task == task).copied().collect();
            if own.len() > 1 {
                fits.push(fit(&policy.name, Some(task.name()), &own));
            }
        }
    }
    fits
}

fn fit(policy: &str, task: Option<&'static str>, pairs: &[Pair]) -> HardwareFit {
    let points: Vec<[f64; 2]> = pairs.iter().map(|(_, point)| *point).collect();
    let difference = |[hardware, simulation]: &[f64; 2]| (hardware - simulation).abs();
    let normalised = |(condition, point): &Pair| {
        let is_twin = |(other, _): &&Pair| other.task == condition.task && other.perturbation == NONE.into();
        let (twin, [hardware, simulation]) = pairs.iter().find(is_twin)?;
        let is_usable = twin != condition && *hardware > 0.0 && *simulation > 0.0;
        is_usable.then(|| difference(&[100.0 * point[0] / hardware, 100.0 * point[1] / simulation]))
    };
    HardwareFit {
        policy: policy.to_owned(),
        task,
        line: least_squares(&points),
        spearman: spearman(&points),
        mean_difference: mean(points.iter().map(difference)),
        mean_normalised_difference: mean(pairs.iter().filter_map(normalised)),
        points,
    }
}

const NONE: sim::Perturbation = sim::Perturbation::None;

/// Returns the sums of squares and products of the deviations from the means.
fn deviations(points: &[[f64; 2]]) -> Option<([f64; 2], [f64; 3])> {
    let center = [mean(points.iter().map(|point| point[0]))?, mean(points.iter().map(|point| point[1]))?];
    let sum = |a: usize, b: usize| -> f64 {
        points.iter().map(|point| (point[a] - center[a]) * (point[b] - center[b])).sum()
    };
    Some((center, [sum(0, 0), sum(0, 1), sum(1, 1)]))
}

/// Returns the line of least squares; `None` without two different values on hardware.
fn least_squares(points: &[[f64; 2]]) -> Option<FittedLine> {
    let ([mean_x, mean_y], [xx, xy, yy]) = deviations(points)?;
    (xx > 0.0).then(|| {
        let slope = xy / xx;
        let r_squared = (yy > 0.0).then(|| xy * xy / (xx * yy));
        FittedLine { slope, offset: mean_y - slope * mean_x, r_squared }
    })
}

/// Returns Spearman's rank correlation; equal values share the mean of their ranks.
fn spearman(points: &[[f64; 2]]) -> Option<f64> {
    let ranks = |axis: usize| -> Vec<f64> {
        let count = |is_counted: &dyn Fn(f64) -> bool| {
            points.iter().filter(|point| is_counted(point[axis])).count() as f64
        };
        let rank = |value: f64| count(&|other| other < value) + 0.5 * count(&|other| other == value);
        points.iter().map(|point| rank(point[axis])).collect()
    };
    let ranked: Vec<[f64; 2]> = ranks(0).into_iter().zip(ranks(1)).map(|(a, b)| [a, b]).collect();
    let (_, [xx, xy, yy]) = deviations(&ranked)?;
    (xx > 0.0 && yy > 0.0).then(|| xy / (xx * yy).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `numpy.polyfit([0, 20, 40, 80], [10, 35, 30, 70], 1)` gives 0.692857 and 12.
    #[test]
    fn least_squares_matches_known_line() {
        let points = [[0.0, 10.0], [20.0, 35.0], [40.0, 30.0], [80.0, 70.0]];
        let line = least_squares(&points).unwrap();
        assert!((line.slope - 0.692_857).abs() < 1e-5, "{line:?}");
        assert!((line.offset - 12.0).abs() < 1e-9, "{line:?}");
        assert!((line.r_squared.unwrap() - 0.899_092).abs() < 1e-5, "{line:?}");
        assert_eq!(least_squares(&points[..1]), None);
    }

    /// `scipy.stats.spearmanr([55, 42.5, 10, 35, 50, 0], [60, 40, 20, 40, 70, 5])` gives 0.927634.
    #[test]
    fn spearman_shares_ranks() {
        let points = [[55.0, 60.0], [42.5, 40.0], [10.0, 20.0], [35.0, 40.0], [50.0, 70.0], [0.0, 5.0]];
        assert!((spearman(&points).unwrap() - 0.927_634).abs() < 1e-5, "{:?}", spearman(&points));
        assert_eq!(spearman(&[[1.0, 2.0], [3.0, 2.0]]), None);
    }
}
