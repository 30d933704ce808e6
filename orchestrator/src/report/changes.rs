//! The effect of perturbations on a policy: changes against the unperturbed tasks, averaged as in the
//! benchmark's figures.

use sim::Perturbation;
use sim::perturb::Composition;

use super::Cell;
use crate::table::{Align, TextTable};

/// Minimum unperturbed success rate of a task that counts for the changes.
const MIN_SUCCESS: f64 = 0.1;

/// The results of a policy under a perturbation, averaged over tasks.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Effect {
    /// Name of the policy.
    pub(crate) policy: String,
    pub(crate) perturbation: Composition,
    /// Mean success rate over all tasks that ran under the perturbation.
    pub(crate) success_once: f64,
    /// Number of tasks that count for the changes: those that also ran unperturbed, with a success rate of at
    /// least [`MIN_SUCCESS`].
    pub(crate) n_tasks: usize,
    /// Mean difference of the success rate over these tasks; `None` without tasks.
    pub(crate) change: Option<f64>,
    /// Mean difference relative to the unperturbed success rate over these tasks; `None` without tasks.
    pub(crate) relative_change: Option<f64>,
}

/// Computes the effects, sorted by policy (in the order of `cells`) and perturbation (in the order of the
/// suite). Returns none unless there are both perturbed and unperturbed results.
pub(crate) fn effects(cells: &[Cell]) -> Vec<Effect> {
    let none = Composition::from(Perturbation::None);
    let mut found: Vec<(&str, Composition)> = Vec::new();
    for cell in cells {
        let pair = (cell.policy.as_str(), cell.condition.perturbation);
        if !found.contains(&pair) {
            found.push(pair);
        }
    }
    let is_compared = found.iter().any(|(_, perturbation)| *perturbation == none)
        && found.iter().any(|(_, perturbation)| *perturbation != none);
    if !is_compared {
        return Vec::new();
    }
    // Cells are sorted by task: a perturbation that does not apply to the first task appears late in them.
    let place = |perturbation: &Composition| perturbation.iter().collect::<Vec<Perturbation>>();
    let policies: Vec<&str> = found.iter().map(|(policy, _)| *policy).collect();
    let rank = |name: &str| policies.iter().position(|policy| *policy == name);
    found.sort_by_key(|(policy, perturbation)| (rank(policy), place(perturbation)));
    found.into_iter().filter_map(|(policy, perturbation)| effect(cells, policy, perturbation)).collect()
}

fn effect(cells: &[Cell], policy: &str, perturbation: Composition) -> Option<Effect> {
    let none = Composition::from(Perturbation::None);
    let own = |perturbation: Composition| {
        let of_policy = cells.iter().filter(move |cell| cell.policy == policy);
        of_policy.filter(move |cell| cell.condition.perturbation == perturbation)
    };
    let all: Vec<f64> = own(perturbation).filter_map(Cell::success_once).collect();
    let pairs = own(perturbation).filter_map(|cell| {
        let twin = own(none).find(|twin| twin.condition.task == cell.condition.task)?;
        Some((twin.success_once()?, cell.success_once()?))
    });
    let pairs: Vec<(f64, f64)> = pairs.filter(|(before, _)| *before >= MIN_SUCCESS).collect();
    Some(Effect {
        policy: policy.to_owned(),
        perturbation,
        success_once: mean(&all)?,
        n_tasks: pairs.len(),
        change: mean(&pairs.iter().map(|(before, after)| after - before).collect::<Vec<_>>()),
        relative_change: mean(&pairs.iter().map(|(before, after)| after / before - 1.0).collect::<Vec<_>>()),
    })
}

fn mean(numbers: &[f64]) -> Option<f64> {
    (!numbers.is_empty()).then(|| numbers.iter().sum::<f64>() / numbers.len() as f64)
}

/// Formats the effects as a table; empty without effects.
pub(super) fn table(effects: &[Effect]) -> String {
    use Align::{Left, Right};
    if effects.is_empty() {
        return String::new();
    }
    let columns = [
        ("policy", Left),
        ("perturbation", Left),
        ("success_once", Right),
        ("tasks", Right),
        ("change", Right),
        ("relative", Right),
    ];
    let mut table = TextTable::new(&columns);
    for effect in effects {
        let is_none = effect.perturbation == Composition::from(Perturbation::None);
        let change = |change: Option<f64>, unit: &str| match change {
            Some(change) if !is_none => format!("{:+.1} {unit}", 100.0 * change),
            _ => "–".to_owned(),
        };
        table.row(vec![
            effect.policy.clone(),
            effect.perturbation.name(),
            format!("{:.1} %", 100.0 * effect.success_once),
            effect.n_tasks.to_string(),
            change(effect.change, "pp"),
            change(effect.relative_change, "%"),
        ]);
    }
    format!("\n{table}")
}

#[cfg(test)]
mod tests {
    use sim::TaskId;

    use super::*;
    use crate::plan::Condition;
    use crate::results::CellSums;

    /// Marks a perturbation that does not apply to the task.
    const NOT: f64 = f64::NAN;
    /// Success rates in percent over 200 episodes of an earlier ACT in the benchmark's repository, by task:
    /// None, MO-Color, RO-Color, Table-Color, RO-Size, All.
    const MEASURED: [(TaskId, [f64; 6]); 12] = [
        (TaskId::DualArmLiftPot, [97.5, 61.5, NOT, 34.5, NOT, 0.0]),
        (TaskId::DualArmPushBox, [82.0, 42.0, NOT, 54.0, NOT, 1.5]),
        (TaskId::DualArmLiftTray, [70.5, 23.5, NOT, NOT, NOT, 0.0]),
        (TaskId::DualArmPourPot, [68.0, 71.0, 66.5, NOT, 70.5, 2.5]),
        (TaskId::DualArmStackCube, [59.5, 0.0, 23.5, 4.0, 56.0, 0.0]),
        (TaskId::DualArmPenCap, [18.0, 7.0, 5.0, NOT, NOT, 2.0]),
        (TaskId::DualArmThreading, [9.0, 3.5, 2.5, NOT, NOT, 0.0]),
        (TaskId::DualArmDrawerOpen, [6.0, NOT, NOT, NOT, NOT, 5.5]),
        (TaskId::DualArmStackTwoCubes, [3.5, 0.0, 7.0, 0.0, 5.0, 0.0]),
        (TaskId::DualArmBottleHandover, [1.0, 2.5, NOT, 1.5, NOT, 4.5]),
        (TaskId::DualArmCubeHandover, [0.0, 0.0, NOT, 0.0, NOT, 0.0]),
        (TaskId::DualArmDrawerPlace, [0.0, 0.0, NOT, NOT, NOT, 0.0]),
    ];
    const PERTURBATIONS: [Perturbation; 6] = [
        Perturbation::None,
        Perturbation::MoColor,
        Perturbation::RoColor,
        Perturbation::TableColor,
        Perturbation::RoSize,
        Perturbation::All,
    ];

    fn measured() -> Vec<Cell> {
        let cells = MEASURED.iter().flat_map(|(task, row)| {
            row.iter().zip(PERTURBATIONS).filter(|(percent, _)| percent.is_finite()).map(|(percent, one)| {
                Cell {
                    policy: "act".to_owned(),
                    condition: Condition { task: *task, perturbation: one.into() },
                    sums: CellSums {
                        n: 200,
                        success_once: (2.0 * percent).round() as u32,
                        ..CellSums::default()
                    },
                }
            })
        });
        cells.collect()
    }

    #[test]
    fn benchmark_table_gives_benchmark_changes() {
        let effects = effects(&measured());
        let shown: Vec<_> = effects
            .iter()
            .map(|effect| {
                let part = |part: Option<f64>| format!("{:.2}", 100.0 * part.unwrap_or(f64::NAN));
                (
                    effect.perturbation.name(),
                    effect.n_tasks,
                    part(effect.change),
                    part(effect.relative_change),
                )
            })
            .collect();
        let row = |name: &str, n, change: &str, relative: &str| {
            (name.to_owned(), n, change.to_owned(), relative.to_owned())
        };
        assert_eq!(
            shown,
            [
                row("None", 6, "0.00", "0.00"),
                row("MO-Color", 6, "-31.75", "-51.51"),
                row("RO-Color", 3, "-16.83", "-44.98"),
                row("Table-Color", 3, "-48.83", "-64.01"),
                row("RO-Size", 2, "-0.50", "-1.10"),
                row("All", 6, "-64.92", "-97.23"),
            ]
        );
        assert!(
            (effects[0].success_once - 0.345_833).abs() < 1e-5,
            "all twelve tasks count for the mean success"
        );
    }

    #[test]
    fn table_is_empty_without_comparison() {
        let unperturbed = |cell: &Cell| cell.condition.perturbation == Perturbation::None.into();
        let (none, others): (Vec<Cell>, Vec<Cell>) = measured().into_iter().partition(unperturbed);
        assert_eq!(table(&effects(&none)) + &table(&effects(&others)), "");
    }
}
