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
use crate::study::page::content::external::FpsTable;
use crate::study::page::content::headlines::predicate_words;
use crate::study::page::content::{FittedLine, HardwareFit, PolicyRole, PolicySummary, ReportContent};
use crate::study::page::drawings::canvas::{AxisRange, Color, Figure, FigureLegend, INK, color};
use crate::study::page::drawings::figures::{
    ChartRow, ChartRowGroup, Curve, RadarSeries, RowChart, chart, fps_svgs, radar, within_percent,
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
    drawn.into_iter().chain(forests).flatten().collect()
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
    let caption = "Mean success in percent under the perturbations of language (L), vision (V) and action (A): the mean over \
                   perturbations of the mean over all tasks.";
    figure("radar", "Success under perturbations", caption, radar(&series)?)
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
        Some(ChartRow::bar(value, Some(interval), color, note))
    };
    let groups: Vec<ChartRowGroup> = names
        .into_iter()
        .map(|name| ChartRowGroup {
            rows: policies.iter().filter_map(|(color, policy)| bar(policy, *color, name)).collect(),
            label: name.to_owned(),
        })
        .collect();
    let (low, high) = extent(&groups);
    let range = [(low.min(-10.0) / 10.0).floor() * 10.0, (high.max(5.0) / 10.0).ceil() * 10.0];
    let svgs = RowChart { legend: legend(&policies), range, unit: "", sides: None }.draw(&groups)?;
    let caption = "Mean change against the policy's own unperturbed twins in percentage points, over the tasks with at least 10 % \
                   unperturbed success, with intervals; vision, language and action: over their perturbations that were run, each \
                   with the same weight.";
    let name = morphology_name(morphology);
    let id = format!("changes-{}", name.replace(' ', "-"));
    figure(&id, &format!("Change under perturbations, {name}"), caption, svgs)
}

/// Returns the least and the largest value of bars and intervals, zero included.
fn extent(groups: &[ChartRowGroup]) -> (f64, f64) {
    let values =
        |row: &ChartRow| row.bars.iter().map(|bar| bar.0).chain(row.interval).flatten().collect::<Vec<_>>();
    let all = groups.iter().flat_map(|group| &group.rows).flat_map(values);
    all.fold((0.0, 0.0), |(low, high), value| (value.min(low), value.max(high)))
}

/// Draws the unperturbed success of each policy in descending order, as the paper does.
fn waterfall(report: &ReportContent, morphology: Morphology) -> Option<Figure> {
    let policies = policies_under_test(report);
    let of_policy = |(color, policy): &(Color, &PolicySummary)| {
        let own = of_morphology(report, &policy.name, morphology).into_iter();
        let own = own.filter(|cell| cell.condition.perturbation == Perturbation::None.into());
        let bar = |cell: &CellSummary| {
            let value = 100.0 * cell.rate.fraction()?;
            let interval = cell.interval?.map(|bound| 100.0 * bound);
            let note = format!("{value:.1} [{:.0}, {:.0}], n {}", interval[0], interval[1], cell.rate.n);
            let rows = vec![ChartRow::bar(value, Some(interval), *color, note)];
            Some((value, ChartRowGroup { label: cell.condition.task.name().to_owned(), rows }))
        };
        let mut groups: Vec<(f64, ChartRowGroup)> = own.filter_map(bar).collect();
        groups.sort_by(|a, b| b.0.total_cmp(&a.0));
        groups.into_iter().map(|(_, group)| group)
    };
    let groups: Vec<ChartRowGroup> = policies.iter().flat_map(of_policy).collect();
    let name = morphology_name(morphology);
    let svgs = success_bars(&policies, &groups)?;
    let caption =
        "Unperturbed success in percent with intervals: each policy's tasks from its best to its worst.";
    let id = format!("waterfall-{}", name.replace(' ', "-"));
    figure(&id, &format!("Unperturbed success, {name}"), caption, svgs)
}

/// Draws bars of success in percent.
fn success_bars(policies: &[(Color, &PolicySummary)], groups: &[ChartRowGroup]) -> Option<[String; 2]> {
    RowChart { legend: legend(policies), range: [0.0, 100.0], unit: "", sides: None }.draw(groups)
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
    let group = |key: &(Morphology, Category)| ChartRowGroup {
        label: format!("{}, {}", key.1.name(), morphology_name(key.0)),
        rows: policies
            .iter()
            .filter_map(|(color, policy)| {
                let (value, n) = value(&policy.name, *key)?;
                Some(ChartRow::bar(value, None, *color, format!("{value:.1}, n {n}")))
            })
            .collect(),
    };
    let groups: Vec<ChartRowGroup> =
        groups.iter().map(group).filter(|group| !group.rows.is_empty()).collect();
    let svgs = success_bars(&policies, &groups)?;
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
        let name = format!("{} ({} of {n_episodes})", policy.name, times.len());
        (n_episodes > 0).then(|| Curve {
            name,
            color,
            line: staircase(&times, n_episodes),
            dots: Vec::new(),
            mark: None,
        })
    };
    let mut shown = policies_with_means(report);
    shown.extend(
        report
            .policies
            .iter()
            .filter(|policy| policy.role == PolicyRole::Ceiling && !policy.ended_early)
            .map(|policy| (INK, policy)),
    );
    let curves: Vec<Curve> = shown.into_iter().filter_map(curve).collect();
    let axes = ["control step, % of the horizon", "episodes that have succeeded, %"].map(AxisRange::percent);
    let caption = "Share of all unperturbed episodes that have succeeded by each part of their horizon.";
    figure("time-to-success", "Time to success", caption, chart(axes, &curves)?)
}

/// Returns the line of the share of episodes, in percent, that have succeeded by each part of their horizon.
/// Of many steps, it has at most about a thousand points.
fn staircase(times: &[f64], n_episodes: u32) -> Vec<[f64; 2]> {
    let share = |n: usize| 100.0 * n as f64 / f64::from(n_episodes);
    let steps = times.iter().enumerate();
    let corners = steps.flat_map(|(n, time)| [n, n + 1].map(|n| [100.0 * time, share(n)]));
    let corners = corners.step_by((2 * times.len()).div_ceil(1000).max(1));
    [[0.0, 0.0]].into_iter().chain(corners).chain([[100.0, share(times.len())]]).collect()
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
        stack(policy, &parts, &legend, format!("{all} failures"))
    };
    let rows: Vec<ChartRowGroup> = policies.iter().map(|(_, policy)| row(policy)).collect();
    let caption = "Failed episodes by the first predicate that did not hold at the end, over all cells.";
    figure("failed-predicates", "Where episodes fail", caption, stacks(&rows, &legend, "")?)
}

/// Returns a row of parts in the colours of a legend, one beside the other.
fn stack(policy: &PolicySummary, parts: &[f64], legend: &FigureLegend, note: String) -> ChartRowGroup {
    let bars = parts.iter().zip(legend).scan(0.0, |end, (part, (_, color))| {
        let start = *end;
        *end += part;
        Some(([start, *end], *color))
    });
    let row = ChartRow { bars: bars.collect(), ..ChartRow::bar(0.0, None, INK, note) };
    ChartRowGroup { label: policy.name.clone(), rows: vec![row] }
}

fn stacks(rows: &[ChartRowGroup], legend: &FigureLegend, unit: &'static str) -> Option<[String; 2]> {
    let range = [0.0, extent(rows).1.max(1e-9)];
    RowChart { legend: legend.clone(), range, unit, sides: None }.draw(rows)
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
        let parts = sums.map(|seconds| 1e3 * seconds / steps.max(1) as f64);
        let total: f64 = parts.iter().sum();
        stack(policy, &parts, &legend, format!("{total:.2} ms"))
    };
    let rows: Vec<ChartRowGroup> = report.policies.iter().map(row).collect();
    let caption = "Wall milliseconds of an episode per control step while others run beside it: time in physics and rendering, \
                   from query to answer, and waiting for a core or a batch.";
    figure("time", "Where the time went", caption, stacks(&rows, &legend, " ms")?)
}

fn hardware_figure(report: &ReportContent) -> Option<Figure> {
    let curve = |fit: &&HardwareFit| Curve {
        line: fit.line.map_or_else(Vec::new, within_percent),
        ..Curve::joined(report.policy_idx(&fit.policy), fit.policy.clone(), fit.points.clone())
    };
    let whole: Vec<&HardwareFit> = report.hardware.iter().filter(|fit| fit.task.is_none()).collect();
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
    let axes = ["success on hardware, %", "success in simulation, %"].map(AxisRange::percent);
    let svgs = chart(axes, &whole.iter().map(curve).collect::<Vec<_>>())?;
    figure("hardware", "Simulation against hardware", &caption, svgs)
}

fn fps_figure(report: &ReportContent) -> Option<Figure> {
    let curve =
        |(idx, table): (usize, &FpsTable)| Curve::joined(idx, table.name.clone(), table.points.clone());
    let curves: Vec<Curve> = report.external.fps.iter().enumerate().map(curve).collect();
    let caption = "Frames per second by number of environments, both axes logarithmic.";
    figure("fps", "Frames per second", caption, fps_svgs(&curves)?)
}

fn forest_figure(comparison: &Comparison, idx: usize) -> Option<Figure> {
    let row = |label: String, difference: f64, interval: [f64; 2], n: u32, adjusted_p: f64, is_mean: bool| {
        let (dot, [low, high]) = (100.0 * difference, interval.map(|bound| 100.0 * bound));
        let note = format!("{dot:+.1} [{low:+.1}, {high:+.1}]");
        let (interval, dot) = (Some([low, high]), Some(dot));
        let color = match (adjusted_p <= comparison.levels.alpha, difference > 0.0) {
            (false, _) => Color(120, 128, 138),
            (true, true) => color(0),
            (true, false) => color(5),
        };
        let rows = vec![ChartRow { bars: Vec::new(), interval, dot, color, is_mean, note }];
        ChartRowGroup { label: format!("{label}, n {n}"), rows }
    };
    let shown = comparison.cells.iter().filter(|_| comparison.cells.len() <= MAX_FOREST_CELLS);
    let cells = shown.map(|cell| {
        let label = format!("{} · {}", cell.condition.task.name(), cell.condition.perturbation.name());
        row(label, cell.difference, cell.interval, cell.n, cell.adjusted_p, false)
    });
    let means = comparison.groups.iter().map(|group| {
        let (label, estimate) = (format!("mean: {}", group.group), &group.estimate);
        row(label, estimate.mean, estimate.interval, group.n, group.adjusted_p, true)
    });
    let groups: Vec<ChartRowGroup> = cells.chain(means).collect();
    let (low, high) = extent(&groups);
    let limit = ((high.max(-low).max(10.0) / 10.0).ceil() * 10.0).min(100.0);
    let [a, b] = comparison.sides.short_names();
    let sides = Some(([a, b], 100.0 * comparison.levels.margin));
    let svgs = RowChart { legend: Vec::new(), range: [-limit, limit], unit: "", sides }.draw(&groups)?;
    let caption = "Difference of success in percentage points on matched episodes, with intervals; coloured where decided after \
                   Holm's correction. The margin is shaded.";
    figure(&format!("forest-{idx}"), &format!("{a} against {b}"), caption, svgs)
}
