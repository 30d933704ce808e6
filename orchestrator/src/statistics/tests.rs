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
/// 33:2850, 2014), who give [−0.517, −0.026] for Tango's and [−0.507, −0.026] for Newcombe's interval.
#[test]
fn paired_intervals_match_reference() {
    let cases = [
        ([1, 1, 7, 12], [-0.517_232, -0.026_003], [-0.506_920, -0.025_559]),
        ([36, 12, 2, 0], [0.061_112, 0.344_709], [0.056_930, 0.340_428]),
        ([43, 0, 1, 0], [-0.118_077, 0.059_393], [-0.118_077, 0.059_718]),
        ([10, 0, 0, 10], [-0.161_125, 0.161_125], [-0.089_757, 0.089_757]),
        ([150, 20, 8, 22], [0.008_680, 0.115_396], [0.007_625, 0.113_628]),
        ([0, 5, 0, 0], [0.131_035, 1.0], [0.385_549, 1.0]),
    ];
    for (counts, tango, newcombe) in cases {
        assert_close(tango_interval(&pairs(counts), Z95).unwrap(), tango, 2e-6);
        assert_close(newcombe_interval(&pairs(counts), Z95).unwrap(), newcombe, 2e-6);
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

#[test]
fn verdicts_follow_test_then_margin() {
    let levels = Levels { alpha: 0.05, margin: 0.1 };
    let verdict = |counts| {
        let pairs = pairs(counts);
        Verdict::new(&pairs, mcnemar_mid_p(&pairs), levels)
    };
    assert_eq!(verdict([50, 30, 5, 15]).decision, Decision::ABetter);
    assert_eq!(verdict([50, 5, 30, 15]).decision, Decision::BBetter);
    assert_eq!(verdict([95, 1, 1, 3]).decision, Decision::Equivalent);
    let undecided = verdict([5, 3, 1, 1]);
    assert_eq!(undecided.decision, Decision::Undecided);
    // 0.41 = 5 / 11 − 0.04 of variance need 39.1 pairs for an interval of ± 0.2; 10 are there.
    assert_eq!(undecided.more_episodes, Some(30));
    assert_eq!(undecided.text(["a", "b"], levels.margin), "undecided: about 30 more episodes");
}

/// Cells of one task share their episodes, so that averaging them does not shorten the interval.
#[test]
fn bootstrap_resamples_twins_together() {
    let differences: Vec<Option<i8>> = (0..100).map(|idx| Some([1, 0, -1, 0, 1][idx % 5])).collect();
    let cell = |task_idx| BootstrapCell { task_idx, differences: differences.clone() };
    let width = |cells: &[BootstrapCell]| {
        let group: Vec<usize> = (0..cells.len()).collect();
        let estimate = cluster_bootstrap(cells, &[group], 0.05).remove(0).unwrap();
        assert!((estimate.mean - 0.2).abs() < 1e-12);
        estimate.interval[1] - estimate.interval[0]
    };
    let (alone, twins, independent) =
        (width(&[cell(0)]), width(&[cell(0), cell(0)]), width(&[cell(0), cell(1)]));
    // 2 · 1.96 · √(0.56 / 100)
    assert!((alone - 0.293).abs() < 0.02, "{alone}");
    assert!((twins - alone).abs() < 1e-12, "{twins}");
    assert!((independent / alone - 0.5_f64.sqrt()).abs() < 0.05, "{independent}");
}

#[test]
fn bootstrap_leaves_out_missing_pairs() {
    let differences = vec![Some(1), None, Some(0), None];
    let cells = [BootstrapCell { task_idx: 0, differences }];
    let estimates = cluster_bootstrap(&cells, &[vec![0], Vec::new()], 0.05);
    let estimate = estimates[0].unwrap();
    assert!((estimate.mean - 0.5).abs() < 1e-12 && estimate.interval == [0.0, 1.0], "{estimate:?}");
    assert_eq!(estimates[1], None);
}
