//! Builder of distractor objects from collision shapes and visual shapes in any convenient frame.
//!
//! [`DistractorBuilder::build`] moves the finished object onto z = 0, centres it on the z axis and samples
//! its size. Lengths are in m.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::distractor::Distractor;
use crate::stream::Stream;
use crate::{Aabb, AppearanceSpec, PartSpec, Primitive, Range, VisualShape, VisualSpec};

/// Angular damping that stands in for the rolling resistance of round objects, in 1/s.
const ROLLING_DAMPING: f64 = 3.0;
/// Isotropic scale of an object.
const SCALE: Range = Range::new(0.92, 1.08);

/// A rotation as a quaternion (w, x, y, z) that need not be normalised.
pub(crate) type Quat = [f64; 4];
/// Identity rotation, which leaves a shape as it is.
pub(crate) const IDENTITY: Quat = [1.0, 0.0, 0.0, 0.0];
/// Rotates z to x, and x to −z.
pub(crate) const Z_TO_X: Quat = [1.0, 0.0, 1.0, 0.0];
/// Rotates by 180° about z.
pub(crate) const HALF_TURN_Z: Quat = [0.0, 0.0, 0.0, 1.0];

/// Returns the pose at `position` (m) with the given rotation.
pub(crate) fn pose(position: [f64; 3], [w, x, y, z]: Quat) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    Isometry3::from_parts(Translation3::from(position), rotation)
}

/// Returns the rotation from the z axis to a unit vector other than −z.
pub(crate) fn z_axis_to([x, y, z]: [f64; 3]) -> Quat {
    [1.0 + z, -y, x, 0.0]
}

/// A distractor object under construction.
pub(crate) struct DistractorBuilder(Distractor);

impl DistractorBuilder {
    /// Creates an empty object of the given density in kg/m³. `rolls` adds angular damping, so that a round
    /// object comes to rest.
    pub(crate) fn new(density: f64, friction: f64, rolls: bool) -> Self {
        let damping = [0.0, if rolls { ROLLING_DAMPING } else { 0.0 }];
        Self(Distractor { parts: Vec::new(), visuals: Vec::new(), density, friction, damping })
    }

    pub(crate) fn collider(&mut self, shape: Primitive, pose: Isometry3<f64>) {
        self.0.parts.push(PartSpec { shape, pose, appearance: AppearanceSpec::plain([0.7; 3]) });
    }

    pub(crate) fn visual(&mut self, shape: VisualShape, pose: Isometry3<f64>, appearance: AppearanceSpec) {
        self.0.visuals.push(VisualSpec { shape, pose, appearance });
    }

    /// Moves the collision shapes' bounding box onto z = 0 and centres it on the z axis, then samples the
    /// scale.
    ///
    /// # Panics
    /// If no collision shape was added.
    pub(crate) fn build(self, stream: &mut Stream) -> Distractor {
        let Self(mut object) = self;
        let aabbs = object.parts.iter().map(|part| part.shape.aabb(&part.pose));
        let Aabb { min, max } = aabbs.reduce(Aabb::union).expect("a distractor has at least one part");
        let centre = (min + max) / 2.0;
        let onto_table = Isometry3::translation(-centre.x, -centre.y, -min.z);
        let scale = stream.uniform(SCALE);
        let moved = |pose: Isometry3<f64>| {
            let mut pose = onto_table * pose;
            pose.translation.vector *= scale;
            pose
        };
        for part in &mut object.parts {
            (part.shape, part.pose) = (part.shape.scaled(scale), moved(part.pose));
        }
        for visual in &mut object.visuals {
            (visual.shape, visual.pose) = (visual.shape.scaled(scale), moved(visual.pose));
        }
        object
    }
}
