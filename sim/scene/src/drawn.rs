//! One sampled scene: the structure of a spec with a number in place of every range. It is immutable.

use nalgebra::{Isometry3, Point3, Translation3, Vector3};

use super::appearance::Texture;
use super::mass::Mass;
use super::shape::VisualShape;
use super::shape::{Aabb, Primitive};
use super::spec::{CameraMount, CameraSlot, Motion, Role, TableKind};

/// Appearance of a part or visual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Appearance {
    /// Linear RGB colour, channels in [0, 1].
    pub color: [f64; 3],
    /// Texture, multiplied by the colour.
    pub texture: Option<Texture>,
    /// Strength of the highlights in [0, 1], unless it is a metal.
    pub specular: f64,
    /// 1 for a metal, whose highlights have its colour; 0 for anything else.
    pub metallic: f64,
}

/// One convex collision shape of a body, at the body's scale.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Collision shape in the part's own frame.
    pub shape: Primitive,
    /// Pose in the body's frame.
    pub pose: Isometry3<f64>,
    /// Appearance, used if the body has no visuals.
    pub appearance: Appearance,
}

/// One visual shape of a body, at the body's scale.
#[derive(Clone, Debug, PartialEq)]
pub struct Visual {
    /// Visual shape in its own frame.
    pub shape: VisualShape,
    /// Further factors along the axes of the shape's own frame, all 1 unless the body's axes are scaled
    /// independently.
    pub stretch: [f64; 3],
    /// Pose in the body's frame.
    pub pose: Isometry3<f64>,
    /// Appearance of the whole shape.
    pub appearance: Appearance,
}

/// One rigid body in its initial state.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Name, unique within the scene.
    pub name: &'static str,
    /// Role in the task.
    pub role: Role,
    /// Motion type. The travel of a slide joint is already scaled.
    pub motion: Motion,
    /// Collision shapes, scaled.
    pub parts: Vec<Part>,
    /// Visual shapes, scaled. If empty, the parts are rendered instead.
    pub visuals: Vec<Visual>,
    /// Factors applied to all nominal lengths along the axes of the body's frame.
    pub scale: Vector3<f64>,
    /// World pose of the body's frame at reset.
    pub pose: Isometry3<f64>,
    /// Height above the surface from which it drops at reset, in m.
    pub drop_m: f64,
    /// Mass at this scale, or the density that determines it.
    pub mass: Mass,
    /// Friction coefficient, static and dynamic.
    pub friction: f64,
    /// Linear and angular damping, in 1/s: the fraction of the velocity lost per second.
    pub damping: [f64; 2],
}

impl Body {
    /// Returns the world pose of the body's frame once it has dropped onto the surface, if it does not tip.
    #[must_use]
    pub fn resting_pose(&self) -> Isometry3<f64> {
        Translation3::new(0.0, 0.0, -self.drop_m) * self.pose
    }

    /// Returns the resting world position of a point given in the body's frame at scale 1, in m.
    #[must_use]
    pub fn point(&self, nominal: [f64; 3]) -> Point3<f64> {
        self.resting_pose() * Point3::from(Vector3::from(nominal).component_mul(&self.scale))
    }

    /// Returns the axis-aligned bounding box of all parts when the body's frame is at `pose`.
    ///
    /// # Panics
    /// If the body has no parts.
    #[must_use]
    pub fn aabb(&self, pose: &Isometry3<f64>) -> Aabb {
        self.parts
            .iter()
            .map(|part| part.shape.aabb(&(pose * part.pose)))
            .reduce(Aabb::union)
            .expect("a body has at least one part")
    }
}

/// One arm in its initial state.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// World pose of link 0.
    pub base: Isometry3<f64>,
    /// Positions of joints 1 to 7 in rad, noise included. Both fingers start at 0.04 m.
    pub qpos: [f64; 7],
}

/// The table and the appearance of its parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Geometry and orientation.
    pub kind: TableKind,
    /// Appearance of the work surface.
    pub top: Appearance,
    /// Appearance of the legs and of the frame below each top.
    pub legs: Appearance,
    /// Appearance of the lower table's top, if there are two tables.
    pub lower_top: Option<Appearance>,
    /// If `true`, the table that stands on the floor is drawn as the block that it collides as.
    pub as_block: bool,
}

/// Floor and walls.
#[derive(Clone, Debug, PartialEq)]
pub struct Background {
    /// Appearance of the floor.
    pub floor: Appearance,
    /// Appearance of the walls; `None` if there are no walls.
    pub walls: Option<Appearance>,
}

/// A directional light, infinitely far away.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionalLight {
    /// Linear RGB radiance.
    pub color: [f64; 3],
    /// World direction in which the light travels.
    pub direction: [f64; 3],
}

/// Ambient and directional lights.
#[derive(Clone, Debug, PartialEq)]
pub struct Lights {
    /// Ambient light, linear RGB.
    pub ambient: [f64; 3],
    /// Directional lights, at most two.
    pub directional: Vec<DirectionalLight>,
    /// `true` if the first directional light casts shadows.
    pub shadows: bool,
}

/// One camera. Camera frame: x forward, y left, z up.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Observation image that the camera renders.
    pub slot: CameraSlot,
    /// Attachment to the world or to a hand.
    pub mount: CameraMount,
    /// Pose error in the camera's own frame: the camera's pose is `mount_pose * pose_error`.
    pub pose_error: Isometry3<f64>,
    /// Vertical field of view, in rad.
    pub fov_y_rad: f64,
    /// Distances of the near and far clipping planes, in m.
    pub clip_m: [f64; 2],
}

/// One sampled scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Bodies in the spec's order, followed by the distractor objects.
    pub bodies: Vec<Body>,
    /// Physics steps per second of simulated time, a multiple of the control rate of 20 Hz.
    pub physics_hz: u32,
    /// One or two arms.
    pub robots: Vec<Robot>,
    /// Table geometry and appearance.
    pub table: Table,
    /// Floor and walls.
    pub background: Background,
    /// Ambient and directional lights.
    pub lights: Lights,
    /// Cameras in the order of the observation's images.
    pub cameras: Vec<Camera>,
    /// Language instruction given to the policy.
    pub instruction: String,
    /// Sampled dimensions of the bodies, in the order and unit of the task's definition.
    pub sizes: Vec<f64>,
}

impl Scene {
    /// Returns the index of the body called `name`.
    ///
    /// # Panics
    /// If there is no such body.
    #[must_use]
    pub fn body_idx(&self, name: &str) -> usize {
        self.bodies.iter().position(|b| b.name == name).unwrap_or_else(|| panic!("no body is named {name}"))
    }

    /// Returns the body called `name`.
    ///
    /// # Panics
    /// If there is no such body.
    #[must_use]
    pub fn body(&self, name: &str) -> &Body {
        &self.bodies[self.body_idx(name)]
    }
}
