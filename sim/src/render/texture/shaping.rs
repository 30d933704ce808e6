//! Curves over the line from which patterns are made.

/// From 0 at `lo` to 1 at `hi`, level at both ends.
pub(super) fn smooth_step(lo: f32, hi: f32, x: f32) -> f32 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Place within a period of 1, in [0, 1], of |t| below 2³¹. By way of an integer, which is several times faster than
/// `floor` where that is a function of the system's library.
pub(super) fn wrap(t: f32) -> f32 {
    let way = t - t as i32 as f32;
    if way < 0.0 { way + 1.0 } else { way }
}

/// Distance to the nearest whole number, in [0, 1/2].
pub(super) fn edge(t: f32) -> f32 {
    0.5 - (wrap(t) - 0.5).abs()
}

/// A wave much like (1 − cos 2πt) / 2: 0 at whole numbers, 1 half-way between.
pub(super) fn swing(t: f32) -> f32 {
    smooth_step(0.0, 0.5, edge(t))
}

/// The profile of a rod seen from the side: 1 along its middle, 0 at both edges of [0, 1].
pub(super) fn bulge(t: f32) -> f32 {
    4.0 * t * (1.0 - t)
}

/// Length of a vector.
pub(super) fn length([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}

/// Whether whole numbers of squares count to an odd sum: the dark ones of a chess board.
pub(super) fn odd(x: f32, y: f32) -> bool {
    (x.floor() as i32 + y.floor() as i32) & 1 == 1
}
