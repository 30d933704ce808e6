//! The figures of a report: which are drawn, and from which numbers.

use std::collections::BTreeMap;

use ipc_types::Morphology;
use plotters::style::RGBColor;
use sim::Perturbation;
use sim::perturb::Modality;
use sim::task::Category;

use super::canvas::{Figure, INK, color};
use super::content::{MODALITIES, PolicyRole, PolicySummary, ReportContent};
use super::figures::{
    Bar, BarGroup, ForestRow, RadarSeries, Scatter, StackRow, StepCurve, bars, forest, fps_curve, radar,
    regression, stacks, success_over_time,
};
use crate::analysis::{CellSummary, Comparison, ComparisonKind};
use crate::plan::Condition;

/// Cells up to which a forest plot shows each.
const MAX_FOREST_CELLS: usize = 40;
/// Failed predicates that get a colour of their own.
const MAX_PREDICATES: usize = 8;

/// Draws all figures that the results allow.
///
/// # Errors
/// If a figure cannot be drawn.
pub(super) fn figures(report: &ReportContent) -> anyhow::Result<Vec<Figure>> {
    let drawn = [
        radar_figure(report)?,
        change_figure(report)?,
        perturbation_figure(report)?,
        waterfall(report, Morphology::Single)?,
        waterfall(report, Morphology::Bimanual)?,
        category_figure(report)?,
        time_to_success(report)?,
        failed_predicates(report)?,
        time_figure(report)?,
        hardware_figure(report)?,
        fps_figure(report)?,
    ];
    let mut figures: Vec<Figure> = drawn.into_iter().flatten().collect();
    for (idx, comparison) in report.comparisons.iter().enumerate() {
        figures.push(forest_figure(comparison, idx)?);
    }
    Ok(figures)
}

fn figure(id: &str, title: &str, caption: &str, svg: String) -> Option<Figure> {
    Some(Figure { id: id.to_owned(), title: title.to_owned(), caption: caption.to_owned(), svg })
}

fn policies_under_test(report: &ReportContent) -> Vec<(RGBColor, &PolicySummary)> {
    let shown = report.policies.iter().filter(|policy| policy.role == PolicyRole::Policy);
    shown.map(|policy| (color(report.policy_idx(&policy.name)), policy)).collect()
}

/// Returns the policies under test over whose cells means may be taken.
fn policies_with_means(report: &ReportContent) -> Vec<(RGBColor, &PolicySummary)> {
    policies_under_test(report).into_iter().filter(|(_, policy)| !policy.ended_early).collect()
}

fn legend(policies: &[(RGBColor, &PolicySummary)]) -> Vec<(String, RGBColor)> {
    policies.iter().map(|(color, policy)| (policy.name.clone(), *color)).collect()
}

/// Returns the mean over the perturbations of a modality of the mean success over tasks, in percent.
fn mean_success(cells: &[&CellSummary], modality: Modality) -> Option<f64> {
    let mut by_perturbation: BTreeMap<Perturbation, Vec<f64>> = BTreeMap::new();
    for cell in cells {
        let mut parts = cell.condition.perturbation.iter();
        if let (Some(part), None, Some(rate)) = (parts.next(), parts.next(), cell.rate.fraction())
            && part.modality() == Some(modality)
        {
            by_perturbation.entry(part).or_default().push(100.0 * rate);
        }
    }
    mean(by_perturbation.values().filter_map(|rates| mean(rates.iter().copied())))
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0), |(sum, n), value| (sum + value, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}

fn of_morphology<'a>(
    report: &'a ReportContent,
    policy: &'a str,
    morphology: Morphology,
) -> Vec<&'a CellSummary> {
    report.cells_of(policy).filter(|cell| cell.condition.task.task().morphology == morphology).collect()
}

fn morphology_name(morphology: Morphology) -> &'static str {
    match morphology {
        Morphology::Single => "single arm",
        Morphology::Bimanual => "bimanual",
    }
}

fn radar_figure(report: &ReportContent) -> anyhow::Result<Option<Figure>> {
    let mut series = Vec::new();
    for (color, policy) in policies_with_means(report) {
        for morphology in Morphology::ALL {
            let cells = of_morphology(report, &policy.name, morphology);
            let values = MODALITIES.map(|modality| mean_success(&cells, modality));
            if let [Some(language), Some(vision), Some(action)] = values {
                series.push(RadarSeries {
                    name: format!("{}, {}", policy.name, morphology_name(morphology)),
                    values: [language, vision, action],
                    color,
                    is_dashed: morphology == Morphology::Bimanual,
                });
            }
        }
    }
    if series.is_empty() {
        return Ok(None);
    }
    let caption = "Mean success in percent under the perturbations of each kind: the mean over perturbations of the mean over \
                   all tasks.";
    Ok(figure("radar", "Success under perturbations", caption, radar(&series)?))
}

fn change_figure(report: &ReportContent) -> anyhow::Result<Option<Figure>> {
    let policies = policies_with_means(report);
    let group = |(idx, name): (usize, &str)| BarGroup {
        label: name.to_owned(),
        bars: policies
            .iter()
            .filter_map(|(color, policy)| {
                let value = 100.0 * policy.changes[idx]?;
                Some(Bar { value, interval: None, color: *color })
            })
            .collect(),
    };
    let groups: Vec<BarGroup> = ["Language", "Vision", "Action"].into_iter().enumerate().map(group).collect();
    if groups.iter().all(|group| group.bars.is_empty()) {
        return Ok(None);
    }
    let svg = bars(&groups, &legend(&policies), range_of(&groups), "")?;
    let caption = "Mean change of success in percentage points, over the perturbations of each kind and the tasks with at \
                   least 10 % unperturbed success (the paper's averages; a perturbation that was not run counts as 0).";
    Ok(figure("changes", "Change by kind of perturbation", caption, svg))
}

fn perturbation_figure(report: &ReportContent) -> anyhow::Result<Option<Figure>> {
    let policies = policies_under_test(report);
    let mut perturbations: Vec<String> = Vec::new();
    for comparison in &report.perturbations {
        for group in &comparison.groups {
            if !perturbations.contains(&group.group) {
                perturbations.push(group.group.clone());
            }
        }
    }
    let bar = |policy: &PolicySummary, color: RGBColor, name: &str| {
        let comparison = report.perturbations.iter().find(|comparison| match &comparison.sides {
            ComparisonKind::Perturbations { policy: own, .. } => *own == policy.name,
            ComparisonKind::Policies { .. } => false,
        })?;
        let group = comparison.groups.iter().find(|group| group.group == name)?;
        let interval = group.estimate.interval.map(|bound| 100.0 * bound);
        Some(Bar { value: 100.0 * group.estimate.mean, interval: Some(interval), color })
    };
    let groups: Vec<BarGroup> = perturbations
        .into_iter()
        .map(|name| BarGroup {
            bars: policies.iter().filter_map(|(color, policy)| bar(policy, *color, &name)).collect(),
            label: name,
        })
        .collect();
    if groups.is_empty() {
        return Ok(None);
    }
    let svg = bars(&groups, &legend(&policies), range_of(&groups), "")?;
    let caption = "Mean change against the policy's own unperturbed twins in percentage points, over all tasks, with score \
                   intervals.";
    Ok(figure("perturbations", "Change by perturbation", caption, svg))
}

/// Returns a range of percentage points around zero that contains all bars.
fn range_of(groups: &[BarGroup]) -> [f64; 2] {
    let values = || {
        let bars = groups.iter().flat_map(|group| &group.bars);
        bars.flat_map(|bar| {
            [bar.value, bar.interval.map_or(bar.value, |i| i[0]), bar.interval.map_or(bar.value, |i| i[1])]
        })
    };
    let low = values().fold(-10.0, f64::min);
    let high = values().fold(5.0, f64::max);
    [(low / 10.0).floor() * 10.0, (high / 10.0).ceil() * 10.0]
}

fn unperturbed_cell<'a>(
    report: &'a ReportContent,
    policy: &'a str,
    task: sim::TaskId,
) -> Option<&'a CellSummary> {
    let condition = Condition { task, perturbation: Perturbation::None.into() };
    report.cells_of(policy).find(|cell| cell.condition == condition)
}

fn waterfall(report: &ReportContent, morphology: Morphology) -> anyhow::Result<Option<Figure>> {
    let policies = policies_under_test(report);
    let mut tasks: Vec<(sim::TaskId, f64)> = Vec::new();
    for task in sim::TaskId::ALL.iter().filter(|task| task.task().morphology == morphology) {
        let rates = policies
            .iter()
            .filter_map(|(_, policy)| unperturbed_cell(report, &policy.name, *task)?.rate.fraction());
        if let Some(mean) = mean(rates) {
            tasks.push((*task, mean));
        }
    }
    if tasks.is_empty() {
        return Ok(None);
    }
    tasks.sort_by(|a, b| b.1.total_cmp(&a.1));
    let bar = |color: RGBColor, cell: &CellSummary| {
        let interval = cell.interval?.map(|bound| 100.0 * bound);
        Some(Bar { value: 100.0 * cell.rate.fraction()?, interval: Some(interval), color })
    };
    let groups: Vec<BarGroup> = tasks
        .iter()
        .map(|(task, _)| BarGroup {
            label: task.name().to_owned(),
            bars: policies
                .iter()
                .filter_map(|(color, policy)| bar(*color, unperturbed_cell(report, &policy.name, *task)?))
                .collect(),
        })
        .collect();
    let name = morphology_name(morphology);
    let svg = bars(&groups, &legend(&policies), [0.0, 100.0], "")?;
    let caption = "Unperturbed success in percent with intervals, tasks sorted by the mean over policies.";
    let id = format!("waterfall-{}", name.replace(' ', "-"));
    Ok(figure(&id, &format!("Unperturbed success, {name}"), caption, svg))
}

fn category_figure(report: &ReportContent) -> anyhow::Result<Option<Figure>> {
    let policies = policies_with_means(report);
    let mut groups: Vec<(Morphology, Category)> = Vec::new();
    for task in sim::TaskId::ALL {
        let key = (task.task().morphology, task.task().category);
        if !groups.contains(&key) {
            groups.push(key);
        }
    }
    let value = |policy: &str, (morphology, category): (Morphology, Category)| {
        let cells = of_morphology(report, policy, morphology).into_iter();
        let own = cells.filter(|cell| {
            cell.condition.perturbation == Perturbation::None.into()
                && cell.condition.task.task().category == category
        });
        mean(own.filter_map(|cell| cell.rate.fraction())).map(|mean| 100.0 * mean)
    };
    let group = |key: &(Morphology, Category)| BarGroup {
        label: format!("{}, {}", key.1.name(), morphology_name(key.0)),
        bars: policies
            .iter()
            .filter_map(|(color, policy)| {
                Some(Bar { value: value(&policy.name, *key)?, interval: None, color: *color })
            })
            .collect(),
    };
    let groups: Vec<BarGroup> = groups.iter().map(group).filter(|group| !group.bars.is_empty()).collect();
    if groups.is_empty() {
        return Ok(None);
    }
    let svg = bars(&groups, &legend(&policies), [0.0, 100.0], "")?;
    let caption = "Unperturbed success in percent, the mean over the tasks of a category that were run.";
    Ok(figure("categories", "Success by category", caption, svg))
}

fn time_to_success(report: &ReportContent) -> anyhow::Result<Option<Figure>> {
    let curve = |(color, policy): (RGBColor, &PolicySummary)| {
        let unperturbed = report
            .cells_of(&policy.name)
            .filter(|cell| cell.condition.perturbation == Perturbation::None.into());
        let (mut times, mut n_episodes) = (Vec::new(), 0);
        for cell in unperturbed {
            let horizon = f64::from(cell.condition.task.task().max_steps);
            // A results file may contain any number.
            let time = |step: &u32| (f64::from(*step) / horizon).min(1.0);
            times.extend(cell.first_success_steps.iter().map(time));
            n_episodes += cell.rate.n;
        }
        times.sort_by(f64::total_cmp);
        StepCurve { name: policy.name.clone(), times, n_episodes, color }
    };
    let mut shown = policies_with_means(report);
    shown.extend(
        report
            .policies
            .iter()
            .filter(|policy| policy.role == PolicyRole::Ceiling && !policy.ended_early)
            .map(|policy| (INK, policy)),
    );
    let curves: Vec<StepCurve> = shown.into_iter().map(curve).filter(|curve| curve.n_episodes > 0).collect();
    if curves.is_empty() {
        return Ok(None);
    }
    let caption = "Share of all unperturbed episodes that have succeeded by each part of their horizon.";
    Ok(figure("time-to-success", "Time to success", caption, success_over_time(&curves)?))
}

fn failed_predicates(report: &ReportContent) -> anyhow::Result<Option<Figure>> {
    let policies = policies_under_test(report);
    let mut totals: BTreeMap<&str, u32> = BTreeMap::new();
    for (_, policy) in &policies {
        for (name, n) in report.cells_of(&policy.name).flat_map(|cell| &cell.failed_predicates) {
            *totals.entry(name).or_default() += n;
        }
    }
    let mut names: Vec<(&str, u32)> = totals.into_iter().collect();
    names.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(b.0)));
    let names: Vec<&str> = names.into_iter().take(MAX_PREDICATES).map(|(name, _)| name).collect();
    if names.is_empty() {
        return Ok(None);
    }
    let mut legend: Vec<(String, RGBColor)> =
        names.iter().enumerate().map(|(idx, name)| ((*name).to_owned(), color(idx))).collect();
    legend.push(("others".to_owned(), RGBColor(170, 175, 182)));
    let row = |policy: &PolicySummary| {
        let count = |name: &str| -> u32 {
            report.cells_of(&policy.name).filter_map(|cell| cell.failed_predicates.get(name)).sum()
        };
        let all: u32 = report.cells_of(&policy.name).flat_map(|cell| cell.failed_predicates.values()).sum();
        let mut parts: Vec<f64> = names.iter().map(|name| f64::from(count(name))).collect();
        parts.push(f64::from(all) - parts.iter().sum::<f64>());
        StackRow { label: policy.name.clone(), parts, note: format!("{all} failures") }
    };
    let rows: Vec<StackRow> = policies.iter().map(|(_, policy)| row(policy)).collect();
    let caption = "Failed episodes by the first predicate that did not hold at the end, over all cells.";
    Ok(figure("failed-predicates", "Where episodes fail", caption, stacks(&rows, &legend, "")?))
}

fn time_figure(report: &ReportContent) -> anyhow::Result<Option<Figure>> {
    let parts = ["physics", "rendering", "policy", "waiting"];
    let legend: Vec<(String, RGBColor)> =
        parts.iter().enumerate().map(|(idx, name)| ((*name).to_owned(), color(idx))).collect();
    let row = |policy: &PolicySummary| {
        let steps: u64 = report.cells_of(&policy.name).map(|cell| cell.steps).sum();
        let mut sums = [0.0; 4];
        for cell in report.cells_of(&policy.name) {
            sums.iter_mut().zip(cell.times_s).for_each(|(sum, seconds)| *sum += seconds);
        }
        let parts = sums.map(|seconds| 1e3 * seconds / steps.max(1) as f64).to_vec();
        let total: f64 = parts.iter().sum();
        StackRow { label: policy.name.clone(), parts, note: format!("{total:.2} ms") }
    };
    let rows: Vec<StackRow> = report.policies.iter().map(row).collect();
    let caption = "Wall milliseconds of an episode per control step while others run beside it: time in physics and rendering, \
                   from query to answer, and waiting for a core or a batch.";
    Ok(figure("time", "Where the time went", caption, stacks(&rows, &legend, " ms")?))
}

fn hardware_figure(report: &ReportContent) -> anyhow::Result<Option<Figure>> {
    let Some(hardware) = &report.external.hardware else { return Ok(None) };
    let series = |(color, policy): (RGBColor, &PolicySummary)| {
        let point = |row: &super::external::HardwareRow| {
            let cell = report.cells_of(&policy.name).find(|cell| {
                cell.condition.task == row.task && cell.condition.perturbation == row.perturbation
            })?;
            Some((row.success_percent, 100.0 * cell.rate.fraction()?))
        };
        Scatter { name: policy.name.clone(), points: hardware.rows.iter().filter_map(point).collect(), color }
    };
    let series: Vec<Scatter> = policies_under_test(report).into_iter().map(series).collect();
    let (svg, line) = regression(&series)?;
    let fit = line.map_or_else(
        || "too few points for a line".to_owned(),
        |line| format!("sim = {:.2} · hardware {:+.1}, R² = {:.2}", line.slope, line.offset, line.r_squared),
    );
    let caption =
        format!("Each point is a task under a perturbation; the line is the least-squares fit: {fit}.");
    Ok(figure("hardware", "Simulation against hardware", &caption, svg))
}

fn fps_figure(report: &ReportContent) -> anyhow::Result<Option<Figure>> {
    let Some(fps) = &report.external.fps else { return Ok(None) };
    let series = [Scatter { name: "FPS".to_owned(), points: fps.points.clone(), color: color(0) }];
    let caption = "Frames per second by number of environments, both axes logarithmic.";
    Ok(figure("fps", "Frames per second", caption, fps_curve(&series)?))
}

fn forest_figure(comparison: &Comparison, idx: usize) -> anyhow::Result<Figure> {
    let shade = |is_decided: bool, difference: f64| match (is_decided, difference > 0.0) {
        (false, _) => RGBColor(120, 128, 138),
        (true, true) => color(0),
        (true, false) => color(5),
    };
    let percent = |pair: [f64; 2]| pair.map(|bound| 100.0 * bound);
    let alpha = comparison.levels.alpha;
    let cell = |cell: &crate::analysis::ComparedCell| ForestRow {
        label: format!("{} · {}", cell.condition.task.name(), cell.condition.perturbation.name()),
        difference: 100.0 * cell.difference,
        interval: percent(cell.interval),
        color: shade(cell.adjusted_p <= alpha, cell.difference),
        is_mean: false,
    };
    let mut rows: Vec<ForestRow> = Vec::new();
    if comparison.cells.len() <= MAX_FOREST_CELLS {
        rows.extend(comparison.cells.iter().map(cell));
    }
    rows.extend(comparison.groups.iter().map(|group| {
        let [low, high] = group.estimate.interval;
        ForestRow {
            label: format!("mean: {}", group.group),
            difference: 100.0 * group.estimate.mean,
            interval: percent(group.estimate.interval),
            color: shade(low > 0.0 || high < 0.0, group.estimate.mean),
            is_mean: true,
        }
    }));
    let [a, b] = comparison.sides.short_names();
    let svg = forest(&rows, [a, b], 100.0 * comparison.levels.margin)?;
    Ok(Figure {
        id: format!("forest-{idx}"),
        title: format!("{a} against {b}"),
        caption: "Difference of success in percentage points on matched episodes, with intervals; coloured where decided after \
                  Holm's correction. The margin is shaded."
            .to_owned(),
        svg,
    })
}
