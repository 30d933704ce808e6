//! Builder of distractor objects from collision shapes and visual shapes in any convenient frame.
//!
//! [`DistractorBuilder::build`] moves the finished object onto z = 0, centres it on the z axis and samples
//! its size. Lengths are in m.

use core::ops::RangeInclusive;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::Distractor;
use crate::stream::Stream;
use crate::{Aabb, AppearanceSpec, PartSpec, Primitive, Range, VisualShape, VisualSpec};

/// Distance by which a label protrudes, so that it covers what is below it.
pub(crate) const LABEL_THICKNESS: f64 = 0.0003;
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
/// Rotates z to y, and y to −z.
pub(crate) const Z_TO_Y: Quat = [1.0, -1.0, 0.0, 0.0];
/// Rotates y to z, and z to −y: an outline stands upright in the xz plane.
pub(crate) const Y_TO_Z: Quat = [1.0, 1.0, 0.0, 0.0];
/// Rotates x to y, y to z and z to x: an outline stands upright in the yz plane.
pub(crate) const X_TO_Y_TO_Z: Quat = [1.0, 1.0, 1.0, 1.0];
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

/// Cosine and sine of 7.5°, the angular step of arcs.
pub(crate) const COS_SIN_STEP: [f64; 2] = [0.991_444_861_373_810_4, 0.130_526_192_220_051_6];

/// Returns the points of a circle about the origin at the given multiples of 7.5° from the x axis.
pub(crate) fn arc(radius: f64, steps: RangeInclusive<i32>) -> Vec<[f64; 2]> {
    let [cos, sin] = COS_SIN_STEP;
    let rotated = |[x, y]: [f64; 2], _| [cos * x - sin * y, sin * x + cos * y];
    steps.map(|step| (0..step.rem_euclid(48)).fold([radius, 0.0], rotated)).collect()
}

/// Returns the outline of an ellipse about the origin with semi-axes `a` and `b`.
pub(crate) fn ellipse([a, b]: [f64; 2]) -> Vec<[f64; 2]> {
    arc(1.0, 0..=47).iter().step_by(2).map(|[x, y]| [a * x, b * y]).collect()
}

/// A distractor object under construction.
///
/// Methods called `collider…` add collision shapes only and methods called `visual…` visual shapes only;
/// `lathe…`, `extrusion` and `curved_label` add visuals, and `rounded_box` adds both.
pub(crate) struct DistractorBuilder(Distractor);

impl DistractorBuilder {
    /// Creates an empty object of the given density in kg/m³.
    pub(crate) fn new(density: f64) -> Self {
        Self(Distractor { parts: Vec::new(), visuals: Vec::new(), density, friction: 0.5, damping: [0.0; 2] })
    }

    /// Sets the friction coefficient, which is 0.5 by default.
    pub(crate) fn friction(&mut self, friction: f64) -> &mut Self {
        self.0.friction = friction;
        self
    }

    /// Adds angular damping, so that a round object comes to rest.
    pub(crate) fn rolling_resistance(&mut self) -> &mut Self {
        self.0.damping = [0.0, ROLLING_DAMPING];
        self
    }

    pub(crate) fn collider(&mut self, shape: Primitive, pose: Isometry3<f64>) -> &mut Self {
        self.0.parts.push(PartSpec { shape, pose, appearance: AppearanceSpec::plain([0.7; 3]) });
        self
    }

    pub(crate) fn collider_box(&mut self, half: [f64; 3], centre: [f64; 3]) -> &mut Self {
        self.collider(Primitive::Box { half }, pose(centre, IDENTITY))
    }

    /// Adds two crossed boxes that together cover a box with its z edges cut off by `edge` m.
    pub(crate) fn collider_crossed_boxes(
        &mut self,
        [x, y, z]: [f64; 3],
        edge: f64,
        centre: [f64; 3],
    ) -> &mut Self {
        self.collider_box([x - edge, y, z], centre).collider_box([x, y - edge, z], centre)
    }

    /// Adds a cylinder about the z axis between two heights.
    pub(crate) fn collider_cylinder(&mut self, radius: f64, [low, high]: [f64; 2]) -> &mut Self {
        let shape = Primitive::Cylinder { radius, half_height: (high - low) / 2.0 };
        self.collider(shape, pose([0.0, 0.0, f64::midpoint(low, high)], IDENTITY))
    }

    /// Adds a bar along the x axis, made of two crossed boxes so that it does not roll.
    pub(crate) fn collider_bar_along_x(&mut self, radius: f64, [from, to]: [f64; 2]) -> &mut Self {
        let (half, centre) = ((to - from) / 2.0, [f64::midpoint(from, to), 0.0, 0.0]);
        self.collider_box([half, radius, radius / 2.0], centre)
            .collider_box([half, radius / 2.0, radius], centre)
    }

    pub(crate) fn visual(
        &mut self,
        shape: VisualShape,
        pose: Isometry3<f64>,
        appearance: AppearanceSpec,
    ) -> &mut Self {
        self.0.visuals.push(VisualSpec { shape, pose, appearance });
        self
    }

    pub(crate) fn visual_box(
        &mut self,
        half: [f64; 3],
        centre: [f64; 3],
        appearance: AppearanceSpec,
    ) -> &mut Self {
        self.visual(VisualShape::Primitive(Primitive::Box { half }), pose(centre, IDENTITY), appearance)
    }

    pub(crate) fn visual_rounded_box(
        &mut self,
        half: [f64; 3],
        centre: [f64; 3],
        edge_radius: f64,
        appearance: AppearanceSpec,
    ) -> &mut Self {
        self.visual(VisualShape::RoundedBox { half, edge_radius }, pose(centre, IDENTITY), appearance)
    }

    /// Adds a box that collides, with a rounded box as its visual.
    pub(crate) fn rounded_box(
        &mut self,
        half: [f64; 3],
        centre: [f64; 3],
        edge_radius: f64,
        appearance: AppearanceSpec,
    ) -> &mut Self {
        self.collider_box(half, centre).visual_rounded_box(half, centre, edge_radius, appearance)
    }

    /// Adds a [`VisualShape::Lathe`] with this profile of points (r, z).
    pub(crate) fn lathe(
        &mut self,
        profile: &[[f64; 2]],
        pose: Isometry3<f64>,
        appearance: AppearanceSpec,
    ) -> &mut Self {
        self.visual(VisualShape::Lathe { profile: profile.to_vec() }, pose, appearance)
    }

    pub(crate) fn lathe_about_z(&mut self, profile: &[[f64; 2]], appearance: AppearanceSpec) -> &mut Self {
        self.lathe(profile, Isometry3::identity(), appearance)
    }

    /// Adds a cylinder about the z axis between two heights.
    pub(crate) fn visual_cylinder(
        &mut self,
        radius: f64,
        [low, high]: [f64; 2],
        appearance: AppearanceSpec,
    ) -> &mut Self {
        self.lathe_about_z(&[[0.0, low], [radius, low], [radius, high], [0.0, high]], appearance)
    }

    pub(crate) fn visual_cylinder_along_x(
        &mut self,
        radius: f64,
        between: [f64; 2],
        appearance: AppearanceSpec,
    ) -> &mut Self {
        self.visual_cylinder_along_x_at(radius, between, 0.0, appearance)
    }

    /// Adds a cylinder along x whose axis is displaced to `y`.
    pub(crate) fn visual_cylinder_along_x_at(
        &mut self,
        radius: f64,
        [from, to]: [f64; 2],
        y: f64,
        appearance: AppearanceSpec,
    ) -> &mut Self {
        let profile = [[0.0, from], [radius, from], [radius, to], [0.0, to]];
        self.lathe(&profile, pose([0.0, y, 0.0], Z_TO_X), appearance)
    }

    /// Adds a [`VisualShape::Extrusion`].
    pub(crate) fn extrusion(
        &mut self,
        outline: &[[f64; 2]],
        holes: &[&[[f64; 2]]],
        half_height: f64,
        pose: Isometry3<f64>,
        appearance: AppearanceSpec,
    ) -> &mut Self {
        let holes = holes.iter().map(|hole| hole.to_vec()).collect();
        self.visual(
            VisualShape::Extrusion { outline: outline.to_vec(), holes, half_height },
            pose,
            appearance,
        )
    }

    /// Adds a label that is wrapped around a cylinder of this radius as its `layer`-th label from the inside.
    ///
    /// It lies between two heights and covers `half_steps` steps of 7.5° to either side of the rotated x
    /// axis.
    pub(crate) fn curved_label(
        &mut self,
        (radius, layer): (f64, u32),
        half_steps: i32,
        [low, high]: [f64; 2],
        rotation: Quat,
        appearance: AppearanceSpec,
    ) -> &mut Self {
        let outer = radius + LABEL_THICKNESS * f64::from(layer);
        let steps = || -half_steps..=half_steps;
        let mut outline = arc(outer, steps());
        outline.extend(arc(radius - 0.003, steps()).into_iter().rev());
        let centre = [0.0, 0.0, f64::midpoint(low, high)];
        self.extrusion(&outline, &[], (high - low) / 2.0, pose(centre, rotation), appearance)
    }

    /// Rotates everything added so far.
    pub(crate) fn rotated(&mut self, rotation: Quat) -> &mut Self {
        self.transform(&pose([0.0; 3], rotation))
    }

    fn transform(&mut self, by: &Isometry3<f64>) -> &mut Self {
        self.0.parts.iter_mut().for_each(|part| part.pose = by * part.pose);
        self.0.visuals.iter_mut().for_each(|visual| visual.pose = by * visual.pose);
        self
    }

    /// Moves the collision shapes' bounding box onto z = 0 and centres it on the z axis, then samples the
    /// scale.
    ///
    /// # Panics
    /// If no collision shape was added.
    pub(crate) fn build(mut self, stream: &mut Stream) -> Distractor {
        let aabbs = self.0.parts.iter().map(|part| part.shape.aabb(&part.pose));
        let Aabb { min, max } = aabbs.reduce(Aabb::union).expect("a distractor has at least one part");
        let centre = (min + max) / 2.0;
        self.transform(&Translation3::new(-centre.x, -centre.y, -min.z).into());
        let scale = stream.uniform(SCALE);
        let Distractor { parts, visuals, .. } = &mut self.0;
        for part in parts {
            part.shape = part.shape.scaled(scale);
            part.pose.translation.vector *= scale;
        }
        for visual in visuals {
            visual.shape = visual.shape.scaled(scale);
            visual.pose.translation.vector *= scale;
        }
        self.0
    }
}
