//! One scene: the spec's tree with every range drawn. Nothing changes it afterwards.

use nalgebra::Isometry3;

use super::form::Form;
use super::shape::{Extent, Primitive};
use super::spec::{CameraMount, CameraSlot, Motion, Role, TableKind};
use super::texture::Texture;

/// Look of a part or a visual; colour is sRGB in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paint {
    /// sRGB in [0, 1].
    pub color: [f64; 3],
    /// Pattern tinted by the colour.
    pub texture: Option<Texture>,
    /// Strength of the highlight in [0, 1].
    pub specular: f64,
}

/// One convex solid of a body, already scaled.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Solid.
    pub shape: Primitive,
    /// Pose in the body's frame.
    pub pose: Isometry3<f64>,
    /// Look.
    pub paint: Paint,
}

/// One form that a body is seen as, already scaled.
#[derive(Clone, Debug, PartialEq)]
pub struct Visual {
    /// Form.
    pub form: Form,
    /// Pose in the body's frame.
    pub pose: Isometry3<f64>,
    /// Look.
    pub paint: Paint,
}

/// One rigid body at its start.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Name within the scene.
    pub name: &'static str,
    /// Role.
    pub role: Role,
    /// Whether it moves; a joint's reach is scaled already.
    pub motion: Motion,
    /// Scaled solids.
    pub parts: Vec<Part>,
    /// Scaled forms drawn instead of the parts; empty: the parts themselves are drawn.
    pub visuals: Vec<Visual>,
    /// Factor by which the nominal lengths were multiplied.
    pub scale: f64,
    /// World pose of its frame at reset.
    pub pose: Isometry3<f64>,
    /// kg/m³.
    pub density: f64,
    /// Coefficient, static and dynamic.
    pub friction: f64,
    /// Share of its linear and angular speed that it loses per second, in 1/s.
    pub damping: [f64; 2],
}

impl Body {
    /// Axis-aligned extent of all parts when the body's frame is at `pose`.
    ///
    /// # Panics
    /// If the body has no part.
    #[must_use]
    pub fn extent(&self, pose: &Isometry3<f64>) -> Extent {
        self.parts
            .iter()
            .map(|part| part.shape.extent(&(pose * part.pose)))
            .reduce(Extent::union)
            .expect("a body has at least one part")
    }
}

/// One arm at its start.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// World pose of link 0.
    pub base: Isometry3<f64>,
    /// Joint positions 1 to 7 in rad, noise included; fingers at 0.04 m.
    pub qpos: [f64; 7],
}

/// Table.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Kind.
    pub kind: TableKind,
    /// Look of the top that is worked on.
    pub top: Paint,
    /// Look of the frame below each top.
    pub frame: Paint,
    /// Look of the legs.
    pub legs: Paint,
    /// Look of the lower table's top, if there is one.
    pub under: Option<Paint>,
}

/// Floor and walls.
#[derive(Clone, Debug, PartialEq)]
pub struct Background {
    /// Floor.
    pub floor: Paint,
    /// Walls, if any.
    pub walls: Option<Paint>,
}

/// A light infinitely far away.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionalLight {
    /// Linear RGB.
    pub color: [f64; 3],
    /// Direction the light travels in.
    pub direction: [f64; 3],
}

/// Lighting.
#[derive(Clone, Debug, PartialEq)]
pub struct Lights {
    /// Linear RGB.
    pub ambient: [f64; 3],
    /// Up to two.
    pub directional: Vec<DirectionalLight>,
    /// Whether the first directional light casts shadows.
    pub shadows: bool,
}

/// One camera. Camera frame: x forward, y left, z up.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Image it fills.
    pub slot: CameraSlot,
    /// What it is fixed to.
    pub mount: CameraMount,
    /// Pose error in the camera's own frame: multiply the mounted pose by it from the right.
    pub error: Isometry3<f64>,
    /// Vertical field of view, in rad.
    pub fov_y_rad: f64,
    /// Near and far plane, in m.
    pub clip_m: [f64; 2],
}

/// One drawn scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Bodies, in the spec's order.
    pub bodies: Vec<Body>,
    /// Arms.
    pub robots: Vec<Robot>,
    /// Table.
    pub table: Table,
    /// Floor and walls.
    pub background: Background,
    /// Lighting.
    pub lights: Lights,
    /// Cameras in the order of the observation's images.
    pub cameras: Vec<Camera>,
    /// Instruction given to the policy.
    pub instruction: String,
}

impl Scene {
    /// Index of the body with this name.
    ///
    /// # Panics
    /// If there is none: a task names only its own bodies.
    #[must_use]
    pub fn body_idx(&self, name: &str) -> usize {
        self.bodies.iter().position(|b| b.name == name).unwrap_or_else(|| panic!("no body is named {name}"))
    }

    /// The body with this name.
    ///
    /// # Panics
    /// If there is none.
    #[must_use]
    pub fn body(&self, name: &str) -> &Body {
        &self.bodies[self.body_idx(name)]
    }
}
