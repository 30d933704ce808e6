//! Temporary.
use crate::scene::{PaintSpec, PartSpec, Primitive, VisualSpec};
use crate::stream::Stream;

/// What a distractor is made of, as it rests on z 0 around the z axis of its own frame.
pub(crate) struct Thing {
    /// Solids that collide; drawn if there are no visuals.
    pub(crate) parts: Vec<PartSpec>,
    /// Forms drawn instead of the parts.
    pub(crate) visuals: Vec<VisualSpec>,
    /// kg/m³.
    pub(crate) density: f64,
    /// Coefficient, static and dynamic.
    pub(crate) friction: f64,
    /// Share of linear and angular speed lost per second, 1/s.
    pub(crate) damping: [f64; 2],
}

/// A kind of thing.
pub(crate) struct Kind {
    pub(crate) name: &'static str,
    pub(crate) make: fn(&mut Stream) -> Thing,
}

impl Kind {
    pub(crate) const ALL: &[Self] = &[Self {
        name: "block",
        make: |_| Thing {
            parts: vec![PartSpec::at(
                Primitive::Box { half: [0.04, 0.03, 0.1] },
                [0.0, 0.0, 0.1],
                PaintSpec::plain([0.8, 0.2, 0.2]),
            )],
            visuals: Vec::new(),
            density: 500.0,
            friction: 0.5,
            damping: [0.0; 2],
        },
    }];
}
