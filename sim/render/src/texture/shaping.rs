//! Shaping functions: one-dimensional curves from which patterns are composed.

/// Returns the Hermite step from 0 at `lo` to 1 at `hi`, with zero slope at both ends.
pub(crate) fn smooth_step(lo: f32, hi: f32, x: f32) -> f32 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Returns `t` − ⌊`t`⌋, in [0, 1], for |t| < 2³¹. The cast to an integer is several times faster than `floor`
/// on targets where `floor` is a library call.
pub(crate) fn fract(t: f32) -> f32 {
    let remainder = t - t as i32 as f32;
    if remainder < 0.0 { remainder + 1.0 } else { remainder }
}

/// Returns the distance to the nearest integer, in [0, 1/2].
pub(crate) fn distance_to_integer(t: f32) -> f32 {
    0.5 - (fract(t) - 0.5).abs()
}

/// Returns a wave of period 1 that approximates (1 − cos 2πt) / 2: 0 at integers, 1 half-way between.
pub(crate) fn smooth_wave(t: f32) -> f32 {
    smooth_step(0.0, 0.5, distance_to_integer(t))
}

/// Returns the parabola that is 0 at 0 and 1, and 1 at 1/2: the profile of a thread, rib or cane across its
/// width.
pub(crate) fn parabola(t: f32) -> f32 {
    4.0 * t * (1.0 - t)
}

/// Returns the Euclidean norm of a vector.
pub(crate) fn length([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}

/// Returns `true` on the odd squares of the integer chequerboard.
pub(crate) fn is_odd_square(x: f32, y: f32) -> bool {
    (x.floor() as i32 + y.floor() as i32) & 1 == 1
}
