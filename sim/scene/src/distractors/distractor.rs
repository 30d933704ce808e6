//! One distractor object.

use crate::{PartSpec, VisualSpec};

/// One distractor object, resting on z = 0 and centred on the z axis of its own frame.
pub struct Distractor {
    /// Collision shapes. They are also rendered if there are no visuals.
    pub parts: Vec<PartSpec>,
    /// Visual shapes. If empty, the parts are rendered instead.
    pub visuals: Vec<VisualSpec>,
    /// Density in kg/m³.
    pub density: f64,
    /// Friction coefficient, static and dynamic.
    pub friction: f64,
    /// Linear and angular damping, in 1/s.
    pub damping: [f64; 2],
}
