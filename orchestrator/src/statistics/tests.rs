//! Tests against published worked examples and reference values (`benches/peers/statistics_reference.py`).

use super::*;

fn pairs([both, only_a, only_b, neither]: [u32; 4]) -> Pairs {
    Pairs { both, only_a, only_b, neither }
}

fn assert_close(found: [f64; 2], expected: [f64; 2], tolerance: f64) {
    for (found, expected) in found.into_iter().zip(expected) {
        assert!((found - expected).abs() < tolerance, "{found}, expected {expected}");
    }
}

#[test]
fn normal_quantiles_are_exact() {
    assert!((quantile(0.975) - Z95).abs() < 1e-14);
    assert!((quantile(0.05) + 1.644_853_626_951_472_7).abs() < 1e-14);
    assert!((cdf(quantile(1e-12)) / 1e-12 - 1.0).abs() < 1e-12);
}

/// The bounds are the solutions p of (p̂ − p)² = z² p (1 − p) / n.
#[test]
fn wilson_bounds_solve_the_score_equation() {
    for (successes, n) in [(0, 10), (1, 10), (5, 10), (100, 100), (37, 204), (1, 1)] {
        let found = wilson_interval(successes, n, Z95).unwrap();
        let observed = f64::from(successes) / f64::from(n);
        for p in found {
            let left = (observed - p).powi(2);
            let right = Z95 * Z95 * p * (1.0 - p) / f64::from(n);
            assert!((left - right).abs() < 1e-12, "{successes}/{n}: {p}");
        }
        assert!(found[0] <= observed && observed <= found[1]);
    }
    assert_eq!(wilson_interval(0, 0, Z95), None);
    let rounded = |successes| wilson_interval(successes, 10, Z95).unwrap().map(|p| (p * 1e4).round() / 1e4);
    assert_eq!([rounded(0), rounded(5), rounded(10)], [[0.0, 0.2775], [0.2366, 0.7634], [0.7225, 1.0]]);
    assert_close(wilson_interval(81, 263, Z95).unwrap(), [0.255_288_519_9, 0.366_209_577_0], 1e-9);
}

/// The first table is the airway example of Fagerland, Lydersen and Laake (Statistics in Medicine
/// 33:2850, 2014), who give [−0.517, −0.026].
#[test]
fn paired_interval_matches_reference() {
    let cases = [
        ([1, 1, 7, 12], [-0.517_232, -0.026_003]),
        ([36, 12, 2, 0], [0.061_112, 0.344_709]),
        ([43, 0, 1, 0], [-0.118_077, 0.059_393]),
        ([10, 0, 0, 10], [-0.161_125, 0.161_125]),
        ([150, 20, 8, 22], [0.008_680, 0.115_396]),
        ([0, 5, 0, 0], [0.131_035, 1.0]),
    ];
    for (counts, expected) in cases {
        assert_close(tango_interval(&pairs(counts), Z95).unwrap(), expected, 2e-6);
    }
    assert_eq!(tango_interval(&Pairs::default(), Z95), None);
}

/// Fagerland, Lydersen and Laake (2013) give 0.039 for the first table.
#[test]
fn mid_p_matches_reference() {
    let cases = [
        ([1, 1, 7, 12], 0.039_063),
        ([36, 12, 2, 0], 0.007_385),
        ([43, 0, 1, 0], 0.5),
        ([10, 0, 0, 10], 1.0),
        ([150, 20, 8, 22], 0.024_120),
        ([0, 5, 0, 0], 0.031_25),
    ];
    for (counts, expected) in cases {
        assert!((mcnemar_mid_p(&pairs(counts)) - expected).abs() < 1e-6, "{counts:?}");
    }
}

#[test]
fn holm_matches_reference() {
    let adjusted = holm(&[0.01, 0.04, 0.03, 0.005, 0.5]);
    for (found, expected) in adjusted.into_iter().zip([0.04, 0.09, 0.09, 0.025, 0.5]) {
        assert!((found - expected).abs() < 1e-12);
    }
    assert!(holm(&[]).is_empty());
}

#[test]
fn e_values_match_reference() {
    let cases = [(0, 0, 0.0), (8, 8, 3.917_476_856), (15, 20, 0.877_325_723), (60, 100, -0.517_394_483)];
    for (k, m, expected) in cases {
        assert!((discordance_ln_e(k, m) - expected).abs() < 1e-8, "{k} of {m}");
    }
}

#[test]
fn confidence_sequence_matches_grid_reference() {
    let mut sequence = ConfidenceSequence::new(0.05);
    let pattern = [1.0, 0.5, 0.5, 1.0, 0.0, 0.5, 1.0, 0.5];
    pattern.iter().cycle().take(120).for_each(|observation| sequence.push(*observation));
    assert_close(sequence.interval(), [0.536_090, 0.720_125], 2e-5);
}

fn tested(pairs: &Pairs, margin: f64) -> TestedDifference {
    TestedDifference {
        difference: pairs.difference().unwrap(),
        p: mcnemar_mid_p(pairs),
        equivalence_p: equivalence_p(pairs, margin),
    }
}

#[test]
fn verdicts_follow_test_then_margin() {
    let decision = |counts| judge(&[tested(&pairs(counts), 0.1)], 0.05)[0].decision;
    assert_eq!(decision([50, 30, 5, 15]), Decision::ABetter);
    assert_eq!(decision([50, 5, 30, 15]), Decision::BBetter);
    assert_eq!(decision([95, 1, 1, 3]), Decision::Equivalent);
    assert_eq!(decision([5, 3, 1, 1]), Decision::Undecided);
}

/// Each kind of verdict is adjusted for the table that it stands in.
#[test]
fn verdicts_of_large_tables_need_more() {
    let (better, equivalent) = (pairs([45, 18, 4, 33]), pairs([60, 1, 1, 38]));
    let rows = [tested(&better, 0.1), tested(&equivalent, 0.1)];
    let unclear = tested(&pairs([5, 3, 1, 1]), 0.1);
    let judged = |n_unclear: usize| {
        let table: Vec<TestedDifference> = rows.iter().copied().chain(vec![unclear; n_unclear]).collect();
        let judged = judge(&table, 0.05);
        ([judged[0].decision, judged[1].decision], n_open_tests(&judged, 0.05))
    };
    assert_eq!(judged(0), ([Decision::ABetter, Decision::Equivalent], [1, 1]));
    assert_eq!(judged(100), ([Decision::Undecided; 2], [102, 102]));
}

/// For 80 % power at p10 = 0.2 and p01 = 0.1, Connor gives 234 pairs. The continuity correction adds 1 / 0.1,
/// which `benches/conclusions` checks by simulation.
#[test]
fn planned_pairs_follow_connor() {
    let rates = PairRates { difference: 0.1, discordance: 0.3 };
    let levels = Levels { alpha: 0.05, margin: 0.05 };
    let needed = |n_tests| rates.pairs_needed(levels, n_tests).ceil();
    assert!((needed([1, 1]) - 244.0).abs() <= 1.0, "{}", needed([1, 1]));
    assert!(needed([20, 20]) > 1.7 * needed([1, 1]));
    let equal = PairRates { difference: 0.0, discordance: 0.1 };
    // (1.645 + 1.282)² · 0.1 / 0.05² + 1 / 0.05
    assert!(
        (equal.pairs_needed(levels, [1, 1]) - 362.6).abs() < 0.2,
        "{}",
        equal.pairs_needed(levels, [1, 1])
    );
    let at_the_margin = PairRates { difference: 0.05, discordance: 0.0 };
    assert!(at_the_margin.pairs_needed(levels, [1, 1]).is_finite());
}

const LEVELS: Levels = Levels { alpha: 0.05, margin: 0.05 };

fn mean(cells: &[DifferenceCell]) -> MeanDifference {
    MeanDifference::new(&cells.iter().map(|cell| (1.0, cell)).collect::<Vec<_>>(), LEVELS).unwrap()
}

/// Cells of one task share their episodes, so that averaging them does not shorten the interval.
#[test]
fn twins_count_once() {
    let differences: Vec<Option<i8>> = (0..100).map(|idx| Some([1, 0, -1, 0, 1][idx % 5])).collect();
    let cell = |task_idx| DifferenceCell { task_idx, differences: differences.clone() };
    let width = |cells: &[DifferenceCell]| {
        let found = mean(cells);
        assert!((found.mean - 0.2).abs() < 1e-12);
        found.interval[1] - found.interval[0]
    };
    let (alone, twins, independent) =
        (width(&[cell(0)]), width(&[cell(0), cell(0)]), width(&[cell(0), cell(1)]));
    // 2 · 1.96 · √(0.56 / 100) and the continuity correction
    assert!((alone - 0.293 - 0.01).abs() < 0.01, "{alone}");
    assert!((twins / alone - 1.0).abs() < 0.02, "{twins} against {alone}");
    assert!((independent / alone - 0.5_f64.sqrt()).abs() < 0.02, "{independent}");
}

/// A mean of one cell has the score interval of its pairs, but for the continuity correction.
#[test]
fn mean_of_one_cell_is_the_cell() {
    let counts = pairs([150, 20, 8, 22]);
    let differences = [(1, counts.only_a), (-1, counts.only_b), (0, counts.both + counts.neither)];
    let differences = differences.iter().flat_map(|&(sign, n)| vec![Some(sign); n as usize]).collect();
    let found = mean(&[DifferenceCell { task_idx: 0, differences }]);
    assert_close(found.interval, tango_interval(&counts, Z95).unwrap(), 0.003);
    assert!((found.n_effective - 200.0).abs() < 2.0, "{found:?}");
    // (12 − ½) / √28
    assert!((found.p - 0.029_8).abs() < 1e-3, "{found:?}");
}

/// Without a discordant pair an interval has a width, and few pairs decide nothing.
#[test]
fn few_pairs_decide_nothing() {
    let cell = |task_idx, sign, n| DifferenceCell { task_idx, differences: vec![Some(sign); n] };
    for (n_tasks, n) in [(1, 1), (6, 1), (1, 10), (6, 3), (28, 2)] {
        let found = mean(&(0..n_tasks).map(|task| cell(task, 0, n)).collect::<Vec<_>>());
        assert!(found.interval[1] > 0.05 && found.equivalence_p > 0.05, "{n_tasks} × {n}: {found:?}");
    }
    // (5 − ½) / √5 is the smallest number of discordant pairs that exceeds 1.96.
    let one_sided = |n_tasks| mean(&(0..n_tasks).map(|task| cell(task, 1, 1)).collect::<Vec<_>>()).p;
    assert!(one_sided(1) > 0.3 && one_sided(4) > 0.05 && one_sided(6) < 0.05);
    let equal = mean(&(0..28).map(|task| cell(task, 0, 3)).collect::<Vec<_>>());
    assert!(equal.equivalence_p < 0.05, "84 equal pairs show equivalence: {equal:?}");
}

/// A weight acts like copies of independent cells on the mean.
#[test]
fn weights_belong_to_cells() {
    let cells = [[1, 0, 0, 0], [-1, -1, 0, 0]];
    let cells: Vec<DifferenceCell> = cells
        .iter()
        .enumerate()
        .map(|(task_idx, row)| DifferenceCell { task_idx, differences: row.map(Some).to_vec() })
        .collect();
    let found = MeanDifference::new(&[(3.0, &cells[0]), (1.0, &cells[1])], LEVELS).unwrap();
    assert!((found.mean - (0.75 * 0.25 - 0.25 * 0.5)).abs() < 1e-12, "{found:?}");
    // (9/16 + 1/16) / 4 is the variance of the mean for each unit of a pair's.
    assert!(found.n_effective <= 4.0 * 16.0 / 10.0 + 1e-9, "{found:?}");
}

#[test]
fn mean_leaves_out_missing_pairs() {
    let differences = vec![Some(1), None, Some(0), None];
    let found = mean(&[DifferenceCell { task_idx: 0, differences }]);
    assert!((found.mean - 0.5).abs() < 1e-12, "{found:?}");
    assert_eq!(MeanDifference::new(&[], LEVELS), None);
}

/// A cell that is decided for A has an interval above zero, an equivalent one an interval in the margin.
#[test]
fn sequential_interval_agrees_with_its_tests() {
    let mut better = PairedSequence::new(LEVELS);
    while better.tested().p > LEVELS.alpha {
        better.push(true, better.pairs().n().is_multiple_of(3));
    }
    assert!(better.interval()[0] >= 0.0, "{:?}", better.interval());
    let mut equal = PairedSequence::new(LEVELS);
    while equal.tested().equivalence_p > LEVELS.alpha {
        equal.push(true, true);
    }
    assert!(equal.interval().iter().all(|bound| bound.abs() < LEVELS.margin), "{:?}", equal.interval());
}
