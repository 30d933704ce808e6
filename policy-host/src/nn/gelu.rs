//! Smooth activations: QuickGELU of CLIP, the tanh form of GELU of SigLIP and Gemma, and SiLU.

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

    /// Applies GELU in place, in the form with tanh: `x · σ(2√(2/π)·(x + 0.044715 x³))`.
    pub fn gelu_tanh(x: &mut [f32]) {
        for x in x {
            *x *= sigmoid(gelu_argument(*x));
        }
    }

    /// Computes GeGLU, `gate = gelu_tanh(gate) · up`.
    pub fn geglu(gate: &mut [f32], up: &[f32]) {
        for (gate, up) in gate.iter_mut().zip(up) {
            *gate *= sigmoid(gelu_argument(*gate)) * up;
        }
    }

    /// Applies SiLU in place, `x · σ(x)`.
    pub fn silu(x: &mut [f32]) {
        for x in x {
            *x *= sigmoid(*x);
        }
    }
}

/// Returns `2√(2/π)·(x + 0.044715 x³)`.
#[inline(always)]
fn gelu_argument(x: f32) -> f32 {
    /// 2√(2/π).
    const SCALE: f32 = 1.595_769_2;
    SCALE * (x + 0.044_715 * x * x * x)
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

    #[test]
    fn gelu_and_silu_agree_with_double_precision() {
        for step in -2000..=2000 {
            let x = step as f32 * 0.01;
            let wide = f64::from(x);
            let sigmoid = |x: f64| 1.0 / (1.0 + libm::exp(-x));
            let tanh = libm::tanh((2.0 / std::f64::consts::PI).sqrt() * (wide + 0.044_715 * wide.powi(3)));
            let (gelu_exact, silu_exact) = (0.5 * wide * (1.0 + tanh), wide * sigmoid(wide));
            let (mut gelu, mut gated, mut swish) = ([x], [x], [x]);
            gelu_tanh(&mut gelu);
            geglu(&mut gated, &[0.5]);
            silu(&mut swish);
            let near =
                |found: f32, exact: f64| (f64::from(found) - exact).abs() <= 2e-6 * exact.abs().max(0.1);
            assert!(near(gelu[0], gelu_exact), "GELU of {x}: {} {gelu_exact}", gelu[0]);
            assert!(near(gated[0], 0.5 * gelu_exact), "GeGLU of {x}");
            assert!(near(swish[0], silu_exact), "SiLU of {x}: {} {silu_exact}", swish[0]);
        }
    }
}
