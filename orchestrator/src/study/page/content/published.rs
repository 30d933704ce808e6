//! The paper's means beside those of a report.

use ipc_types::Morphology;
use policy_host::models::Family;
use policy_host::spec::PolicySpec;
use sim::perturb::Modality;
use sim::{Perturbation, TaskId};

use crate::study::analysis::{ComparisonKind, modality_name, morphology_name};
use crate::study::page::content::{PublishedRow, PublishedUnit, ReportContent};

#[derive(Clone, Copy, Debug)]
enum Quantity {
    Unperturbed,
    Under(Perturbation),
    Modality(Modality),
}

/// The means in the paper's text (arXiv 2605.27759): of ACT with one arm and two, and of π0.5 with one arm
/// and two. The text does not have all of them.
const PUBLISHED: [(Quantity, PublishedUnit, [Option<f64>; 4]); 9] = [
    (Quantity::Unperturbed, PublishedUnit::Success, all([29.2, 44.5, 21.2, 12.6])),
    (Quantity::Modality(Modality::Vision), PublishedUnit::Points, all([-28.57, -29.06, -7.73, -9.86])),
    (
        Quantity::Under(Perturbation::LanguageParaphrase),
        PublishedUnit::Points,
        all([-0.28, -0.57, -19.16, -24.0]),
    ),
    (Quantity::Under(Perturbation::LanguageParaphrase), PublishedUnit::Relative, only_last(-63.6)),
    (Quantity::Under(Perturbation::LanguageNone), PublishedUnit::Relative, only_last(-72.2)),
    (Quantity::Under(Perturbation::LanguageOtherTask), PublishedUnit::Relative, only_last(-87.8)),
    (Quantity::Under(Perturbation::LanguageRandom), PublishedUnit::Relative, only_last(-91.2)),
    (Quantity::Modality(Modality::Action), PublishedUnit::Unclear, all([-11.2, -18.24, -10.08, -4.11])),
    (
        Quantity::Under(Perturbation::PoseRandomization),
        PublishedUnit::Unclear,
        all([-21.8, -40.9, -12.9, -51.4]),
    ),
];

const fn all([a, b, c, d]: [f64; 4]) -> [Option<f64>; 4] {
    [Some(a), Some(b), Some(c), Some(d)]
}

const fn only_last(value: f64) -> [Option<f64>; 4] {
    [None, None, None, Some(value)]
}

/// The paper's mean absolute differences between the changes of one arm and of two, in points.
const EMBODIMENTS: [(Family, f64); 2] = [(Family::Act, 10.83), (Family::Pi05, 3.69)];

/// Returns the means of the paper's policies that it gives, too. The paper's are means over all tasks of a
/// robot, so a policy that has not met all of them has none here.
pub(crate) fn published_rows(report: &ReportContent) -> Vec<PublishedRow> {
    let mut rows = Vec::new();
    for policy in report.under_test().filter(|policy| !policy.ended_early) {
        let Ok(PolicySpec::Network(family, _)) = policy.spec.parse() else { continue };
        let robots = Morphology::ALL.map(|morphology| has_all_tasks(report, &policy.name, morphology));
        for (idx, morphology) in Morphology::ALL.into_iter().enumerate().filter(|(idx, _)| robots[*idx]) {
            let column = 2 * usize::from(family == Family::Pi05) + idx;
            for (quantity, unit, values) in PUBLISHED {
                if let Some(paper) = values[column] {
                    rows.extend(row(report, (&policy.name, morphology), quantity, (paper, unit)));
                }
            }
        }
        let ours = report.embodiment_differences.iter().find(|one| one.policy == policy.name);
        let paper = EMBODIMENTS.iter().find(|(other, _)| *other == family);
        if let (Some(ours), Some((_, paper)), [true, true]) = (ours, paper, robots) {
            rows.push(PublishedRow {
                policy: policy.name.clone(),
                robot: "both",
                quantity: "difference between one arm and two".to_owned(),
                ours: 100.0 * ours.difference,
                interval: None,
                relative: None,
                paper: *paper,
                unit: PublishedUnit::Points,
            });
        }
    }
    rows
}

fn has_all_tasks(report: &ReportContent, policy: &str, morphology: Morphology) -> bool {
    let own = |task: &&TaskId| task.task().morphology == morphology;
    TaskId::ALL.iter().filter(own).all(|task| {
        report.cells_of(policy).any(|cell| {
            cell.condition.task == *task
                && cell.condition.perturbation == Perturbation::None.into()
                && cell.rate.n > 0
        })
    })
}

fn row(
    report: &ReportContent,
    (policy, morphology): (&str, Morphology),
    quantity: Quantity,
    (paper, unit): (f64, PublishedUnit),
) -> Option<PublishedRow> {
    let percent = |fraction: f64| 100.0 * fraction;
    let effect = |perturbation: Perturbation| {
        report.effects.iter().find(|effect| {
            effect.policy == policy
                && effect.morphology == morphology
                && effect.perturbation == perturbation.into()
        })
    };
    let (ours, relative) = match quantity {
        Quantity::Unperturbed => (effect(Perturbation::None)?.success, None),
        Quantity::Under(perturbation) => {
            let effect = effect(perturbation)?;
            (effect.change?, effect.relative_change)
        }
        Quantity::Modality(modality) => {
            let effect = report.modality_effect(policy, morphology, modality)?;
            (effect.change?, effect.relative_change)
        }
    };
    let group = format!("{}, {}", quantity.group(), morphology_name(morphology));
    let groups = report.perturbations.iter().filter(|comparison| match &comparison.sides {
        ComparisonKind::Perturbations { policy: own, .. } => own == policy,
        ComparisonKind::Policies { .. } => false,
    });
    let interval = groups.flat_map(|comparison| &comparison.groups).find(|other| other.group == group);
    Some(PublishedRow {
        policy: policy.to_owned(),
        robot: morphology_name(morphology),
        quantity: quantity.name(),
        ours: percent(ours),
        interval: interval.map(|group| group.estimate.interval.map(percent)),
        relative: relative.map(percent),
        paper,
        unit,
    })
}

impl Quantity {
    /// Returns the name for people.
    fn name(self) -> String {
        match self {
            Self::Unperturbed => "unperturbed success".to_owned(),
            Self::Under(_) | Self::Modality(_) => format!("change under {}", self.group()),
        }
    }

    /// Returns the name of the cells over which the mean is taken.
    fn group(self) -> String {
        match self {
            Self::Unperturbed => Perturbation::None.name().to_owned(),
            Self::Under(perturbation) => perturbation.name().to_owned(),
            Self::Modality(modality) => modality_name(modality).to_owned(),
        }
    }
}
