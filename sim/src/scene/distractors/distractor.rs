//! One distractor object.

use crate::scene::{PartSpec, VisualSpec};

/// One distractor object, resting on z = 0 and centred on the z axis of its own frame.
pub(crate) struct Distractor {
    /// Collision shapes. They are also rendered if there are no visuals.
    pub(crate) parts: Vec<PartSpec>,
    /// Visual shapes. If empty, the parts are rendered instead.
    pub(crate) visuals: Vec<VisualSpec>,
    /// Density in kg/m³.
    pub(crate) density: f64,
    /// Friction coefficient, static and dynamic.
    pub(crate) friction: f64,
    /// Linear and angular damping, in 1/s.
    pub(crate) damping: [f64; 2],
}
