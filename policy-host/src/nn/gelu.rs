//! The activation of CLIP.

use super::attention::exp_of_negative;
use super::wide::wide;

wide! {
    /// `x · σ(1.702 x)` in place: Hendrycks and Gimpel's fast approximation of the Gaussian error linear unit.
    pub fn quick_gelu(x: &mut [f32]) {
        for x in x {
            *x *= sigmoid(1.702 * *x);
        }
    }
}

/// `1 / (1 + exp(−x))`, by way of the exponential that does not overflow.
#[inline(always)]
fn sigmoid(x: f32) -> f32 {
    let small = exp_of_negative(-x.abs());
    let numerator = if x < 0.0 { small } else { 1.0 };
    numerator / (1.0 + small)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_agrees_with_double_precision_at_any_size() {
        for step in -2000..=2000 {
            let x = step as f32 * 0.05;
            let exact = f64::from(x) / (1.0 + libm::exp(-1.702 * f64::from(x)));
            let mut y = [x];
            quick_gelu(&mut y);
            assert!((f64::from(y[0]) - exact).abs() <= 1e-6 * exact.abs().max(1e-3), "{x}: {} {exact}", y[0]);
        }
    }
}
