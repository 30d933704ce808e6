//! Wilson's score interval for a proportion (E. B. Wilson, JASA 22, 1927), which is also valid at 0 %, at
//! 100 % and for few episodes.

/// Returns the interval of the success probability, given `successes` in `n` trials and the normal quantile
/// `z` (1.96 for 95 %); `None` without trials.
#[must_use]
pub fn wilson_interval(successes: u32, n: u32, z: f64) -> Option<[f64; 2]> {
    if n == 0 {
        return None;
    }
    let (n, p) = (f64::from(n), f64::from(successes) / f64::from(n));
    let scale = 1.0 / (1.0 + z * z / n);
    let centre = scale * (p + z * z / (2.0 * n));
    let half = scale * z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    Some([(centre - half).max(0.0), (centre + half).min(1.0)])
}
