//! QuickGELU, the activation of CLIP.

use super::attention::exp_of_non_positive;
use super::isa::multiversion;

multiversion! {
    /// Applies QuickGELU, `x · σ(1.702 x)`, in place: Hendrycks and Gimpel's approximation of the Gaussian
    /// error linear unit.
    pub fn quick_gelu(x: &mut [f32]) {
        for x in x {
            *x *= sigmoid(1.702 * *x);
        }
    }
}

/// Returns `1 / (1 + exp(−x))`, computed from `exp(−|x|)`, which cannot overflow.
#[inline(always)]
fn sigmoid(x: f32) -> f32 {
    let exp = exp_of_non_positive(-x.abs());
    let numerator = if x < 0.0 { exp } else { 1.0 };
    numerator / (1.0 + exp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quick_gelu_agrees_with_double_precision() {
        for step in -2000..=2000 {
            let x = step as f32 * 0.05;
            let exact = f64::from(x) / (1.0 + libm::exp(-1.702 * f64::from(x)));
            let mut y = [x];
            quick_gelu(&mut y);
            assert!((f64::from(y[0]) - exact).abs() <= 1e-6 * exact.abs().max(1e-3), "{x}: {} {exact}", y[0]);
        }
    }
}
