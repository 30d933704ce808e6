//! Sine and cosine built from additions and multiplications, so that no image depends on the system's libm.

use core::f64::consts::{FRAC_PI_2, TAU};

/// Returns (sine, cosine) of an angle in rad with |angle| < 1e6, with an error of about 1e-15.
pub(crate) fn sin_cos(angle_rad: f64) -> (f64, f64) {
    let quarter_turns = (angle_rad / FRAC_PI_2).round();
    let x = angle_rad - quarter_turns * FRAC_PI_2;
    let (sin, cos) = (series(x, 1.0, x), series(x, 0.0, 1.0));
    match quarter_turns.rem_euclid(4.0) {
        0.0 => (sin, cos),
        1.0 => (cos, -sin),
        2.0 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Returns point `i` of `n` evenly spaced points on the unit circle, as (cosine, sine).
pub(crate) fn on_circle(i: usize, n: usize) -> (f32, f32) {
    let (sin, cos) = sin_cos(TAU * (i % n) as f64 / n as f64);
    (cos as f32, sin as f32)
}

/// Sums ten terms of the Taylor series whose first term is `term`, of degree `degree`; enough for |x| ≤ π/4.
fn series(x: f64, mut degree: f64, mut term: f64) -> f64 {
    let mut sum = 0.0;
    for _ in 0..10 {
        sum += term;
        term *= -x * x / ((degree + 1.0) * (degree + 2.0));
        degree += 2.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::sin_cos;

    #[test]
    fn sin_cos_matches_libm() {
        for i in -2000..2000 {
            let angle = f64::from(i) * 0.01;
            let (sin, cos) = sin_cos(angle);
            assert!(
                (sin - libm::sin(angle)).abs() < 1e-13 && (cos - libm::cos(angle)).abs() < 1e-13,
                "at {angle}"
            );
        }
    }
}
