//! What insertion tasks share: a box with a rectangular hole through it along x, left free by the four walls around it.

use crate::scene::Body;

/// The cross-section of a hole in the frame of its body: least and greatest (y, z), in m.
#[derive(Clone, Copy)]
pub(in crate::tasks) struct Hole {
    pub(in crate::tasks) least: [f64; 2],
    pub(in crate::tasks) greatest: [f64; 2],
}

impl Hole {
    /// The hole of half extents `half` around (y, z) = `middle`, in m.
    pub(in crate::tasks) fn around(middle: [f64; 2], half: [f64; 2]) -> Self {
        let bounds = |side: f64| core::array::from_fn(|axis| middle[axis] + side * half[axis]);
        Self { least: bounds(-1.0), greatest: bounds(1.0) }
    }

    /// The hole of a body whose first parts are [`Hole::walls`].
    pub(in crate::tasks) fn of(body: &Body) -> Self {
        let wall = |i: usize| body.parts[i].shape.aabb(&body.parts[i].pose);
        Self { least: [wall(0).max.y, wall(2).max.z], greatest: [wall(1).min.y, wall(3).min.z] }
    }

    /// (y, z) of its axis, in m.
    pub(in crate::tasks) fn middle(self) -> [f64; 2] {
        core::array::from_fn(|axis| (self.least[axis] + self.greatest[axis]) / 2.0)
    }

    /// Half extents and middles of the walls of a box of half extents `half` around the origin, in m: those beside the hole,
    /// at −y and +y, and between them those below and above it.
    pub(in crate::tasks) fn walls(self, [hx, hy, hz]: [f64; 3]) -> [([f64; 3], [f64; 3]); 4] {
        let Self { least: [y0, z0], greatest: [y1, z1] } = self;
        [([-hy, -hz], [y0, hz]), ([y1, -hz], [hy, hz]), ([y0, -hz], [y1, z0]), ([y0, z1], [y1, hz])].map(
            |([y, z], [to_y, to_z])| {
                ([hx, (to_y - y) / 2.0, (to_z - z) / 2.0], [0.0, (to_y + y) / 2.0, (to_z + z) / 2.0])
            },
        )
    }
}
