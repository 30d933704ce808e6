//! A box with a rectangular hole along x, formed by four walls.

use scene::Body;

/// Cross-section of a hole in its body's frame, in m.
#[derive(Clone, Copy)]
pub(crate) struct Hole {
    /// Lower bounds of (y, z).
    pub(crate) min: [f64; 2],
    /// Upper bounds of (y, z).
    pub(crate) max: [f64; 2],
}

impl Hole {
    /// Returns the hole with half-extents `half` centred at (y, z) = `centre`, in m.
    pub(crate) fn around(centre: [f64; 2], half: [f64; 2]) -> Self {
        let bounds = |side: f64| core::array::from_fn(|axis| centre[axis] + side * half[axis]);
        Self { min: bounds(-1.0), max: bounds(1.0) }
    }

    /// Returns the hole of a body whose first four parts are [`Hole::walls`].
    pub(crate) fn of(body: &Body) -> Self {
        let wall = |i: usize| body.parts[i].shape.aabb(&body.parts[i].pose);
        Self { min: [wall(0).max.y, wall(2).max.z], max: [wall(1).min.y, wall(3).min.z] }
    }

    /// Returns the centre (y, z) of the hole, in m.
    pub(crate) fn centre(self) -> [f64; 2] {
        core::array::from_fn(|axis| (self.min[axis] + self.max[axis]) / 2.0)
    }

    /// Returns the half-extents and centres of the four walls of a box with half-extents `half` around the
    /// origin, in m: first the walls at −y and +y of the hole, then those below and above it.
    pub(crate) fn walls(self, [hx, hy, hz]: [f64; 3]) -> [([f64; 3], [f64; 3]); 4] {
        let Self { min: [y0, z0], max: [y1, z1] } = self;
        [([-hy, -hz], [y0, hz]), ([y1, -hz], [hy, hz]), ([y0, -hz], [y1, z0]), ([y0, z1], [y1, hz])].map(
            |([y, z], [to_y, to_z])| {
                ([hx, (to_y - y) / 2.0, (to_z - z) / 2.0], [0.0, (to_y + y) / 2.0, (to_z + z) / 2.0])
            },
        )
    }
}
