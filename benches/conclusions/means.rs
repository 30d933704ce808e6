//! Error rates of means over cells, in a grid of group sizes and rates.

use orchestrator::statistics::{DifferenceCell, Levels, MeanDifference};
use rayon::iter::ParallelIterator;
use sim::scene::stream::Stream;

use super::{LEVELS, percent, streams};

/// Pairs above which groups are left out: they take long and have the easiest statistics.
const MAX_PAIRS: usize = 20_000;

/// The dependence of a group's pairs on each other and on the task.
#[derive(Clone, Copy)]
struct Design {
    n_perturbations: usize,
    /// Probability that a pair follows its start, which all perturbations share.
    shared: f64,
    /// Distance of every other task's difference from the mean, with alternating sign.
    spread: f64,
}

/// Draws groups over a grid of tasks, episodes, discordance and difference, and prints the worst of each
/// design.
pub(crate) fn means(n: usize) {
    let grid = grid();
    println!(
        "means over cells, 1 to 28 tasks × 1 to 200 episodes × discordance 0.02 to 0.5, {} groups, {n} samples each: worst group",
        grid.len()
    );
    for design in [
        Design { n_perturbations: 1, shared: 0.0, spread: 0.0 },
        Design { n_perturbations: 1, shared: 0.0, spread: 0.2 },
        Design { n_perturbations: 3, shared: 0.5, spread: 0.0 },
        Design { n_perturbations: 3, shared: 1.0, spread: 0.2 },
        Design { n_perturbations: 12, shared: 0.5, spread: 0.0 },
    ] {
        let mut worst = [(0, GridPoint::default()); 3];
        for point in grid.iter().filter(|point| point.n_pairs(design) <= MAX_PAIRS) {
            let errors = mean_errors(design, *point, n, "mean");
            for (worst, n_errors) in worst.iter_mut().zip(errors) {
                if n_errors > worst.0 {
                    *worst = (n_errors, *point);
                }
            }
        }
        println!(
            "  {} perturbations, {:.0} % shared, tasks ± {:.1}",
            design.n_perturbations,
            100.0 * design.shared,
            design.spread
        );
        let kinds = ["interval misses", "equal, called different", "margin, called equivalent"];
        for (idx, (what, (n_errors, point))) in kinds.into_iter().zip(worst).enumerate() {
            // The worst of many is worse by chance, so it is drawn anew.
            let again = mean_errors(design, point, 10 * n, "again")[idx];
            let GridPoint { n_tasks, n_episodes, discordance, difference } = point;
            println!(
                "    {what}: {:.2} %, drawn again {:.2} % ({n_tasks} × {n_episodes}, discordance {discordance}, \
                 difference {difference})",
                percent(n_errors, n),
                percent(again, 10 * n)
            );
        }
    }
}

/// A group of cells and the rates of its pairs.
#[derive(Clone, Copy, Default)]
struct GridPoint {
    n_tasks: usize,
    n_episodes: usize,
    discordance: f64,
    difference: f64,
}

impl GridPoint {
    fn n_pairs(&self, design: Design) -> usize {
        self.n_tasks * design.n_perturbations * self.n_episodes
    }
}

/// Counts the groups whose interval misses the mean, which are called different although equal, and which are
/// called equivalent although their difference is the margin.
fn mean_errors(design: Design, point: GridPoint, n: usize, name: &str) -> [usize; 3] {
    let GridPoint { n_tasks, difference, .. } = point;
    // A single task has no counterpart.
    let truth = difference + if n_tasks % 2 == 0 { 0.0 } else { design.spread };
    let levels = Levels { alpha: LEVELS.alpha, margin: truth.max(0.01) };
    let sample = |mut random: Stream| {
        let cells = draw_group(&mut random, design, point);
        let found = MeanDifference::new(&cells.iter().map(|cell| (1.0, cell)).collect::<Vec<_>>(), levels)
            .expect("it has cells");
        [
            truth < found.interval[0] || found.interval[1] < truth,
            truth == 0.0 && found.p <= levels.alpha,
            truth > 0.0 && found.equivalence_p <= levels.alpha,
        ]
    };
    let found: Vec<[bool; 3]> = streams(n, name).map(sample).collect();
    [0, 1, 2].map(|idx| found.iter().filter(|errors| errors[idx]).count())
}

fn grid() -> Vec<GridPoint> {
    let mut grid = Vec::new();
    for n_tasks in [1, 2, 6, 12, 28] {
        for n_episodes in [1, 3, 10, 25, 50, 100, 200] {
            for discordance in [0.02, 0.05, 0.1, 0.2, 0.3, 0.5] {
                let differences = [0.0, 0.05, 0.1, 0.2].into_iter().filter(|d| *d <= discordance);
                grid.extend(differences.map(|difference| GridPoint {
                    n_tasks,
                    n_episodes,
                    discordance,
                    difference,
                }));
            }
        }
    }
    grid
}

fn draw_group(random: &mut Stream, design: Design, point: GridPoint) -> Vec<DifferenceCell> {
    let GridPoint { n_tasks, n_episodes, discordance, difference } = point;
    let mut cells = Vec::new();
    for task_idx in 0..n_tasks {
        let spread = match (task_idx % 2, n_tasks % 2) {
            (1, 0) => -design.spread,
            _ => design.spread,
        };
        let difference = difference + spread;
        let discordance = discordance.max(difference.abs());
        let [only_a, only_b] = [0.5 * (discordance + difference), 0.5 * (discordance - difference)];
        let starts: Vec<f64> = (0..n_episodes).map(|_| random.unit()).collect();
        for _ in 0..design.n_perturbations {
            let mut difference = |start: &f64| {
                let own = design.n_perturbations == 1 || random.unit() >= design.shared;
                let u = if own { random.unit() } else { *start };
                Some(if u < only_a { 1 } else { -i8::from(u < only_a + only_b) })
            };
            let differences = starts.iter().map(&mut difference).collect();
            cells.push(DifferenceCell { task_idx, differences });
        }
    }
    cells
}
