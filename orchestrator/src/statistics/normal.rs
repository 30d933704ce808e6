//! The standard normal distribution.

/// Quantile at 0.975, of two-sided intervals at 95 %.
pub const Z95: f64 = 1.959_963_984_540_054;

/// Returns the probability that a standard normal variable is at most `x`.
#[must_use]
pub fn cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x / core::f64::consts::SQRT_2)
}

/// Returns the quantile of the standard normal distribution at `p`, by bisection of [`cdf`] to the last bit.
///
/// # Panics
/// If `p` is not in (0, 1).
#[must_use]
pub fn quantile(p: f64) -> f64 {
    assert!(p > 0.0 && p < 1.0, "p is {p}, expected a number in (0, 1)");
    // `cdf` keeps its relative precision only in the lower tail.
    if p > 0.5 {
        return -quantile(1.0 - p);
    }
    bisect(-40.0, 0.0, |x| cdf(x) < p)
}

/// Returns the point in `[low, high]` at which `is_below` turns from true to false.
pub(crate) fn bisect(mut low: f64, mut high: f64, is_below: impl Fn(f64) -> bool) -> f64 {
    loop {
        let middle = low.midpoint(high);
        if middle <= low || middle >= high {
            return middle;
        }
        if is_below(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
}
