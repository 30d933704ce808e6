//! Wilson's score interval for a proportion (E. B. Wilson, JASA 22, 1927), which is also valid at 0 %, at
//! 100 % and for few episodes.

/// 97.5 % quantile of the standard normal distribution.
const Z: f64 = 1.959_963_984_540_054;

/// Returns the 95 % interval of the success probability, given `successes` in `n` trials; `None` without
/// trials.
pub(super) fn wilson95(successes: u32, n: u32) -> Option<[f64; 2]> {
    if n == 0 {
        return None;
    }
    let (n, p) = (f64::from(n), f64::from(successes) / f64::from(n));
    let scale = 1.0 / (1.0 + Z * Z / n);
    let centre = scale * (p + Z * Z / (2.0 * n));
    let half = scale * Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    Some([(centre - half).max(0.0), (centre + half).min(1.0)])
}

#[cfg(test)]
mod tests {
    use super::wilson95;

    /// The bounds are the solutions p of (p̂ − p)² = z² p (1 − p) / n.
    #[test]
    fn bounds_solve_the_score_equation() {
        for (successes, n) in [(0, 10), (1, 10), (5, 10), (100, 100), (37, 204), (1, 1)] {
            let found = wilson95(successes, n).unwrap();
            let observed = f64::from(successes) / f64::from(n);
            for p in found {
                let left = (observed - p).powi(2);
                let right = 3.841_458_820_694_124 * p * (1.0 - p) / f64::from(n);
                assert!((left - right).abs() < 1e-12, "{successes}/{n}: {p}");
            }
            assert!(found[0] <= observed && observed <= found[1]);
        }
        assert_eq!(wilson95(0, 0), None);
    }

    #[test]
    fn interval_matches_known_values() {
        let rounded = |successes, n| wilson95(successes, n).unwrap().map(|p| (p * 1e4).round() / 1e4);
        assert_eq!(rounded(0, 10), [0.0, 0.2775]);
        assert_eq!(rounded(10, 10), [0.7225, 1.0]);
        assert_eq!(rounded(5, 10), [0.2366, 0.7634]);
        assert_eq!(rounded(81, 263), [0.2553, 0.3662]);
    }
}
