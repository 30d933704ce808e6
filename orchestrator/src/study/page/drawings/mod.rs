//! The figures of a report: which are drawn, and from which numbers.

pub(crate) mod canvas;
pub(crate) mod figures;
pub(crate) mod heat_map;

use std::collections::BTreeMap;

use ipc_types::Morphology;
use sim::Perturbation;
use sim::perturb::Modality;
use sim::task::Category;

use crate::study::analysis::{CellSummary, ComparedGroup, Comparison, ComparisonKind, mean, morphology_name};
use crate::study::page::content::headlines::predicate_words;
use crate::study::page::content::{FittedLine, HardwareFit, PolicyRole, PolicySummary, ReportContent};
use crate::study::page::drawings::canvas::{Color, Figure, FigureLegend, INK, color};
use crate::study::page::drawings::figures::{
    Bar, BarGroup, ForestRow, FpsSeries, RadarSeries, Scatter, StackRow, StepCurve, bars, forest, fps_svgs,
    radar, regression, stacks, success_over_time,
};

/// The modalities in the order of the paper's radar figure.
const MODALITIES: [Modality; 3] = [Modality::Language, Modality::Vision, Modality::Action];
/// Cells up to which a forest plot shows each.
const MAX_FOREST_CELLS: usize = 40;
/// Failed predicates that get a colour of their own.
const MAX_PREDICATES: usize = 8;

/// Draws all figures that the results allow.
pub(crate) fn figures(report: &ReportContent) -> Vec<Figure> {
    let drawn = [
        radar_figure(report),
        change_figure(report, Morphology::Single),
        change_figure(report, Morphology::Bimanual),
        waterfall(report, Morphology::Single),
        waterfall(report, Morphology::Bimanual),
        category_figure(report),
        time_to_success(report),
        failed_predicates(report),
        time_figure(report),
        hardware_figure(report),
        fps_figure(report),
    ];
    let forests =
        report.comparisons.iter().enumerate().map(|(idx, comparison)| forest_figure(comparison, idx));
    drawn.into_iter().flatten().chain(forests).collect()
}

fn figure(id: &str, title: &str, caption: &str, svgs: [String; 2]) -> Option<Figure> {
    Some(Figure { id: id.to_owned(), title: title.to_owned(), caption: caption.to_owned(), svgs })
}

fn policies_under_test(report: &ReportContent) -> Vec<(Color, &PolicySummary)> {
    report.under_test().map(|policy| (color(report.policy_idx(&policy.name)), policy)).collect()
}

/// Returns the policies under test over whose cells means may be taken.
fn policies_with_means(report: &ReportContent) -> Vec<(Color, &PolicySummary)> {
    policies_under_test(report).into_iter().filter(|(_, policy)| !policy.ended_early).collect()
}

fn legend(policies: &[(Color, &PolicySummary)]) -> FigureLegend {
    policies.iter().map(|(color, policy)| (policy.name.clone(), *color)).collect()
}

fn of_morphology<'a>(
    report: &'a ReportContent,
    policy: &'a str,
    morphology: Morphology,
) -> Vec<&'a CellSummary> {
    report.cells_of(policy).filter(|cell| cell.condition.task.task().morphology == morphology).collect()
}

fn radar_figure(report: &ReportContent) -> Option<Figure> {
    let mut series = Vec::new();
    for (color, policy, morphology) in robots(report) {
        let success = |modality| {
            report.modality_effect(&policy.name, morphology, modality).map(|effect| 100.0 * effect.success)
        };
        if let [Some(language), Some(vision), Some(action)] = MODALITIES.map(success) {
            series.push(RadarSeries {
                name: format!("{}, {}", policy.name, morphology_name(morphology)),
                values: [language, vision, action],
                color,
                is_dashed: morphology == Morphology::Bimanual,
            });
        }
    }
    if series.is_empty() {
        return None;
    }
    let caption = "Mean success in percent under the perturbations of language (L), vision (V) and action (A): the mean over \
                   perturbations of the mean over all tasks.";
    figure("radar", "Success under perturbations", caption, radar(&series))
}

/// Returns the policies over whose cells means may be taken, with each robot that they moved.
fn robots(report: &ReportContent) -> Vec<(Color, &PolicySummary, Morphology)> {
    let mut robots = Vec::new();
    for (color, policy) in policies_with_means(report) {
        for morphology in Morphology::ALL {
            if !of_morphology(report, &policy.name, morphology).is_empty() {
                robots.push((color, policy, morphology));
            }
        }
    }
    robots
}

/// Draws the changes of one robot by perturbation and by modality.
fn change_figure(report: &ReportContent, morphology: Morphology) -> Option<Figure> {
    let policies = policies_with_means(report);
    let suffix = format!(", {}", morphology_name(morphology));
    let groups_of = |policy: &PolicySummary| {
        let comparison = report.perturbations.iter().find(|comparison| match &comparison.sides {
            ComparisonKind::Perturbations { policy: own, .. } => *own == policy.name,
            ComparisonKind::Policies { .. } => false,
        });
        comparison.map_or(&[][..], |comparison| &comparison.groups)
    };
    let mut names: Vec<&str> = Vec::new();
    for group in policies.iter().flat_map(|(_, policy)| groups_of(policy)) {
        if let Some(name) = group.group.strip_suffix(&suffix)
            && !names.contains(&name)
        {
            names.push(name);
        }
    }
    let bar = |policy: &PolicySummary, color: Color, name: &str| {
        let is_named = |group: &&ComparedGroup| group.group.strip_suffix(&suffix) == Some(name);
        let group = groups_of(policy).iter().find(is_named)?;
        let estimate = &group.estimate;
        let (value, interval) = (100.0 * estimate.mean, estimate.interval.map(|bound| 100.0 * bound));
        let note = format!("{value:+.1} [{:+.0}, {:+.0}], n {}", interval[0], interval[1], group.n);
        Some(Bar { value, interval: Some(interval), note, color })
    };
    let groups: Vec<BarGroup> = names
        .into_iter()
        .map(|name| BarGroup {
            bars: policies.iter().filter_map(|(color, policy)| bar(policy, *color, name)).collect(),
            label: name.to_owned(),
        })
        .collect();
    if groups.is_empty() {
        return None;
    }
    let svgs = bars(&groups, &legend(&policies), range_of(&groups));
    let caption = "Mean change against the policy's own unperturbed twins in percentage points, over the tasks with at least 10 % \
                   unperturbed success, with intervals; vision, language and action: over their perturbations that were run, each \
                   with the same weight.";
    let name = morphology_name(morphology);
    let id = format!("changes-{}", name.replace(' ', "-"));
    figure(&id, &format!("Change under perturbations, {name}"), caption, svgs)
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

/// Draws the unperturbed success of each policy in descending order, as the paper does.
fn waterfall(report: &ReportContent, morphology: Morphology) -> Option<Figure> {
    let policies = policies_under_test(report);
    let of_policy = |(color, policy): &(Color, &PolicySummary)| {
        let own = of_morphology(report, &policy.name, morphology).into_iter();
        let own = own.filter(|cell| cell.condition.perturbation == Perturbation::None.into());
        let color = *color;
        let bar = move |cell: &CellSummary| {
            let value = 100.0 * cell.rate.fraction()?;
            let interval = cell.interval?.map(|bound| 100.0 * bound);
            let note = format!("{value:.1} [{:.0}, {:.0}], n {}", interval[0], interval[1], cell.rate.n);
            let bars = vec![Bar { value, interval: Some(interval), note, color }];
            Some(BarGroup { label: cell.condition.task.name().to_owned(), bars })
        };
        let mut groups: Vec<BarGroup> = own.filter_map(bar).collect();
        groups.sort_by(|a, b| b.bars[0].value.total_cmp(&a.bars[0].value));
        groups
    };
    let groups: Vec<BarGroup> = policies.iter().flat_map(of_policy).collect();
    if groups.is_empty() {
        return None;
    }
    let name = morphology_name(morphology);
    let svgs = bars(&groups, &legend(&policies), [0.0, 100.0]);
    let caption =
        "Unperturbed success in percent with intervals: each policy's tasks from its best to its worst.";
    let id = format!("waterfall-{}", name.replace(' ', "-"));
    figure(&id, &format!("Unperturbed success, {name}"), caption, svgs)
}

fn category_figure(report: &ReportContent) -> Option<Figure> {
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
        let own: Vec<_> = own.collect();
        let n: u32 = own.iter().map(|cell| cell.rate.n).sum();
        mean(own.iter().filter_map(|cell| cell.rate.fraction())).map(|mean| (100.0 * mean, n))
    };
    let group = |key: &(Morphology, Category)| BarGroup {
        label: format!("{}, {}", key.1.name(), morphology_name(key.0)),
        bars: policies
            .iter()
            .filter_map(|(color, policy)| {
                let (value, n) = value(&policy.name, *key)?;
                Some(Bar { value, interval: None, note: format!("{value:.1}, n {n}"), color: *color })
            })
            .collect(),
    };
    let groups: Vec<BarGroup> = groups.iter().map(group).filter(|group| !group.bars.is_empty()).collect();
    if groups.is_empty() {
        return None;
    }
    let svgs = bars(&groups, &legend(&policies), [0.0, 100.0]);
    let caption = "Unperturbed success in percent, the mean over the tasks of a category that were run.";
    figure("categories", "Success by category", caption, svgs)
}

fn time_to_success(report: &ReportContent) -> Option<Figure> {
    let curve = |(color, policy): (Color, &PolicySummary)| {
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
        return None;
    }
    let caption = "Share of all unperturbed episodes that have succeeded by each part of their horizon.";
    figure("time-to-success", "Time to success", caption, success_over_time(&curves))
}

fn failed_predicates(report: &ReportContent) -> Option<Figure> {
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
        return None;
    }
    let mut legend: FigureLegend =
        names.iter().enumerate().map(|(idx, name)| (predicate_words(name).to_owned(), color(idx))).collect();
    legend.push(("others".to_owned(), Color(170, 175, 182)));
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
    figure("failed-predicates", "Where episodes fail", caption, stacks(&rows, &legend, ""))
}

fn time_figure(report: &ReportContent) -> Option<Figure> {
    let parts = ["physics", "rendering", "policy", "waiting"];
    let legend: FigureLegend =
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
    figure("time", "Where the time went", caption, stacks(&rows, &legend, " ms"))
}

fn hardware_figure(report: &ReportContent) -> Option<Figure> {
    let series = |fit: &HardwareFit| Scatter {
        name: fit.policy.clone(),
        points: fit.points.clone(),
        line: fit.line,
        color: color(report.policy_idx(&fit.policy)),
    };
    let whole: Vec<&HardwareFit> = report.hardware.iter().filter(|fit| fit.task.is_none()).collect();
    if whole.is_empty() {
        return None;
    }
    let fitted = |fit: &&HardwareFit| match &fit.line {
        Some(FittedLine { slope, offset, r_squared }) => format!(
            "{}: sim = {slope:.2} · hardware {offset:+.1}, R² = {}",
            fit.policy,
            r_squared.map_or_else(|| "–".to_owned(), |r| format!("{r:.2}"))
        ),
        None => format!("{}: too few points for a line", fit.policy),
    };
    let caption = format!(
        "Each point is a task under a perturbation, with the least-squares line of each policy. {}.",
        whole.iter().map(fitted).collect::<Vec<_>>().join("; ")
    );
    let svgs = regression(&whole.into_iter().map(series).collect::<Vec<_>>());
    figure("hardware", "Simulation against hardware", &caption, svgs)
}

fn fps_figure(report: &ReportContent) -> Option<Figure> {
    let series: Vec<FpsSeries> = report
        .external
        .fps
        .iter()
        .map(|table| FpsSeries { name: table.name.clone(), points: table.points.clone() })
        .collect();
    if series.is_empty() {
        return None;
    }
    let caption = "Frames per second by number of environments, both axes logarithmic.";
    figure("fps", "Frames per second", caption, fps_svgs(&series))
}

fn forest_figure(comparison: &Comparison, idx: usize) -> Figure {
    let shade = |is_decided: bool, difference: f64| match (is_decided, difference > 0.0) {
        (false, _) => Color(120, 128, 138),
        (true, true) => color(0),
        (true, false) => color(5),
    };
    let percent = |pair: [f64; 2]| pair.map(|bound| 100.0 * bound);
    let alpha = comparison.levels.alpha;
    let cell = |cell: &crate::study::analysis::ComparedCell| ForestRow {
        label: format!("{} · {}", cell.condition.task.name(), cell.condition.perturbation.name()),
        difference: 100.0 * cell.difference,
        interval: percent(cell.interval),
        n: cell.n,
        color: shade(cell.adjusted_p <= alpha, cell.difference),
        is_mean: false,
    };
    let mut rows: Vec<ForestRow> = Vec::new();
    if comparison.cells.len() <= MAX_FOREST_CELLS {
        rows.extend(comparison.cells.iter().map(cell));
    }
    rows.extend(comparison.groups.iter().map(|group| ForestRow {
        label: format!("mean: {}", group.group),
        difference: 100.0 * group.estimate.mean,
        interval: percent(group.estimate.interval),
        n: group.n,
        color: shade(group.adjusted_p <= alpha, group.estimate.mean),
        is_mean: true,
    }));
    let [a, b] = comparison.sides.short_names();
    let svgs = forest(&rows, [a, b], 100.0 * comparison.levels.margin);
    Figure {
        id: format!("forest-{idx}"),
        title: format!("{a} against {b}"),
        caption: "Difference of success in percentage points on matched episodes, with intervals; coloured where decided after \
                  Holm's correction. The margin is shaded."
            .to_owned(),
        svgs,
    }
}
