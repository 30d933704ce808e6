//! Outlines in a plane: points, arcs, ellipses and rounded rectangles in sequence.

use serde::Deserialize;

use crate::rounded_rectangle;

/// Cosine and sine of 7.5°, the angular step of arcs.
pub(crate) const COS_SIN_STEP: [f64; 2] = [0.991_444_861_373_810_4, 0.130_526_192_220_051_6];

/// The first and last of a sequence of multiples of 7.5°, and the increment.
pub(crate) type Steps = [i32; 3];

/// All multiples of 7.5°.
pub(crate) const FULL_CIRCLE: Steps = [0, 47, 1];

/// Returns the points of a circle about the origin at the given angles from the x axis.
pub(crate) fn arc(radius: f64, [first, last, increment]: Steps) -> impl Iterator<Item = [f64; 2]> {
    let [cos, sin] = COS_SIN_STEP;
    let rotated = move |[x, y]: [f64; 2], _| [cos * x - sin * y, sin * x + cos * y];
    let steps = (0..=(last - first) / increment).map(move |i| first + i * increment);
    steps.map(move |step| (0..step.rem_euclid(48)).fold([radius, 0.0], rotated))
}

/// Returns the outline of an ellipse about the origin with semi-axes `a` and `b`.
pub(crate) fn ellipse([a, b]: [f64; 2]) -> Vec<[f64; 2]> {
    arc(1.0, [0, 47, 2]).map(|[x, y]| [a * x, b * y]).collect()
}

/// One or more successive points of an outline, in m.
#[derive(Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub(crate) enum Piece {
    /// One point.
    Point([f64; 2]),
    /// Part of a circle about `at`.
    Arc { arc: f64, steps: Steps, at: Option<[f64; 2]> },
    /// Ellipse about `at`, given by its semi-axes.
    Ellipse { ellipse: [f64; 2], at: Option<[f64; 2]> },
    /// Rectangle about `at` with rounded corners, given by its half-extents and the corner radius.
    Rounded { rounded: [f64; 3], at: Option<[f64; 2]> },
}

impl Piece {
    fn points(&self) -> Vec<[f64; 2]> {
        let (points, at) = match *self {
            Self::Point(point) => (vec![point], None),
            Self::Arc { arc: radius, steps, at } => (arc(radius, steps).collect(), at),
            Self::Ellipse { ellipse: axes, at } => (ellipse(axes), at),
            Self::Rounded { rounded: [x, y, radius], at } => (rounded_rectangle([x, y], radius), at),
        };
        let Some([dx, dy]) = at else { return points };
        points.into_iter().map(|[x, y]| [x + dx, y + dy]).collect()
    }
}

/// Returns the outline that consists of `pieces`.
pub(crate) fn outline(pieces: &[Piece]) -> Vec<[f64; 2]> {
    pieces.iter().flat_map(Piece::points).collect()
}
