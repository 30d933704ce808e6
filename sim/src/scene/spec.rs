//! The distribution of a task's scenes: plain data of ranges. Perturbations edit it; nothing else does.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::form::Form;
use super::instruction::InstructionSpec;
use super::paint::PaintSpec;
use super::place::{DistractorsSpec, PlacementSpec, RegionSpec};
use super::range::Range;
use super::shape::Primitive;

/// What a body is to the task; colour, texture and size perturbations choose by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// MO: the robot manipulates it.
    ManipulationObject,
    /// RO: the manipulated object goes to or on it.
    ReceiverObject,
    /// Neither.
    Fixture,
    /// Clutter that the task does not mention.
    Distractor,
}

impl Role {
    /// Word for messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ManipulationObject => "manipulation object",
            Self::ReceiverObject => "receiver object",
            Self::Fixture => "fixture",
            Self::Distractor => "distractor",
        }
    }
}

/// Which size perturbation scales a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScaledBy {
    /// MO-Size.
    MoSize,
    /// RO-Size.
    RoSize,
    /// None, for the reason given.
    Nothing(&'static str),
}

/// Whether a body moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Falls, is pushed and carried.
    Dynamic,
    /// Stays where it was put.
    Fixed,
    /// Stays where it was put, and is only seen: a mark on the table.
    Mark,
    /// Slides or turns from where it was put, and meets neither fixed bodies nor other jointed ones: its joint guides it.
    Jointed(JointSpec),
}

impl Motion {
    /// Whether the body can be elsewhere later.
    #[must_use]
    pub const fn moves(self) -> bool {
        matches!(self, Self::Dynamic | Self::Jointed(_))
    }
}

/// Which way a jointed body moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Along the axis; positions in m.
    Slide,
    /// About the axis through the body's origin; positions in rad.
    Hinge,
}

/// A joint between a body and the place it was put, where its position is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSpec {
    /// Kind.
    pub kind: JointKind,
    /// Unit vector in the body's frame; not −x.
    pub axis: [f64; 3],
    /// Greatest position, in m (at scale 1) or rad; the least is 0.
    pub upper: f64,
    /// N per m/s or N·m per rad/s.
    pub damping: f64,
    /// Dry friction, in N or N·m.
    pub friction: f64,
}

/// One convex solid of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct PartSpec {
    /// Solid at scale 1.
    pub shape: Primitive,
    /// Pose in the body's frame at scale 1; its translation scales with the body.
    pub pose: Isometry3<f64>,
    /// Look.
    pub paint: PaintSpec,
}

impl PartSpec {
    /// A solid centred at `position` (m) in the body's frame, not rotated.
    #[must_use]
    pub fn at(shape: Primitive, position: [f64; 3], paint: PaintSpec) -> Self {
        Self {
            shape,
            pose: Isometry3::from_parts(Vector3::from(position).into(), UnitQuaternion::identity()),
            paint,
        }
    }
}

/// One form that a body is seen as.
#[derive(Clone, Debug, PartialEq)]
pub struct VisualSpec {
    /// Form at scale 1.
    pub form: Form,
    /// Pose in the body's frame at scale 1; its translation scales with the body.
    pub pose: Isometry3<f64>,
    /// Look.
    pub paint: PaintSpec,
}

impl VisualSpec {
    /// A form centred at `position` (m) in the body's frame, not rotated.
    #[must_use]
    pub fn at(form: Form, position: [f64; 3], paint: PaintSpec) -> Self {
        Self {
            form,
            pose: Isometry3::from_parts(Vector3::from(position).into(), UnitQuaternion::identity()),
            paint,
        }
    }
}

/// One rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct BodySpec {
    /// Names it in predicates, streams and messages.
    pub name: &'static str,
    /// Role.
    pub role: Role,
    /// Whether it moves.
    pub motion: Motion,
    /// Solids; all collide unless the body is a mark, and are drawn if there are no visuals.
    pub parts: Vec<PartSpec>,
    /// Forms drawn instead of the parts; empty: the parts themselves are drawn.
    pub visuals: Vec<VisualSpec>,
    /// Which size perturbation scales it.
    pub scaled_by: ScaledBy,
    /// Isotropic scale, nominally 1.
    pub scale: Range,
    /// Start pose.
    pub placement: PlacementSpec,
    /// kg/m³.
    pub density: f64,
    /// Coefficient, static and dynamic.
    pub friction: f64,
    /// Share of its linear and angular speed that it loses per second, as through a thick medium; in 1/s.
    pub damping: [f64; 2],
}

impl BodySpec {
    /// The same, turned about the vertical by an angle of this range, in rad.
    ///
    /// # Panics
    /// If it is placed with another body: it turns with that.
    #[must_use]
    pub fn turned(mut self, range: Range) -> Self {
        let PlacementSpec::On { yaw, .. } = &mut self.placement else { panic!("{} has no yaw", self.name) };
        *yaw = range;
        self
    }

    /// The same, set up with this orientation before it is turned.
    ///
    /// # Panics
    /// If it is placed with another body: its pose there says how.
    #[must_use]
    pub fn set_up(mut self, orientation: UnitQuaternion<f64>) -> Self {
        let PlacementSpec::On { upright, .. } = &mut self.placement else {
            panic!("{} is set up by its pose", self.name)
        };
        *upright = orientation;
        self
    }

    /// Looks of all its parts and visuals.
    pub fn paints_mut(&mut self) -> impl Iterator<Item = &mut PaintSpec> {
        let parts = self.parts.iter_mut().map(|part| &mut part.paint);
        parts.chain(self.visuals.iter_mut().map(|visual| &mut visual.paint))
    }
}

/// One arm.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotSpec {
    /// World pose of link 0.
    pub base: Isometry3<f64>,
    /// Joint positions 1 to 7 in rad, beyond a joint's stop taken as at it; fingers start at 0.04 m.
    pub qpos: [f64; 7],
    /// Standard deviation of the noise on each joint, in rad.
    pub noise_rad: f64,
}

/// Parts whose solids differ from episode to episode by more than a scale.
#[derive(Clone, Copy, Debug)]
pub struct SizesSpec {
    /// Name of each number and the range it is drawn from.
    pub ranges: &'static [(&'static str, Range)],
    /// Gives the bodies the solids and poses of parts that follow from the drawn numbers; leaves everything else.
    pub shape: fn(&[f64], &mut [BodySpec]),
}

impl PartialEq for SizesSpec {
    fn eq(&self, other: &Self) -> bool {
        self.ranges == other.ranges && core::ptr::fn_addr_eq(self.shape, other.shape)
    }
}

/// Which table stands there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableKind {
    /// 1.209 × 2.418 m with its top at z 0, long side along y.
    SingleArm,
    /// The same, long side along x.
    SingleArmTurned,
    /// The plate of 1.2 × 1.6 m with its top at z 0.825, over the other table.
    Bimanual,
}

/// The table and its look.
#[derive(Clone, Debug, PartialEq)]
pub struct TableSpec {
    /// Kind.
    pub kind: TableKind,
    /// Look of the top that is worked on.
    pub top: PaintSpec,
    /// Look of the frame below each top.
    pub frame: PaintSpec,
    /// Look of the legs.
    pub legs: PaintSpec,
    /// Look of the lower table's top, if there is one.
    pub under: Option<PaintSpec>,
}

impl TableSpec {
    /// Looks of all its parts.
    pub fn paints_mut(&mut self) -> impl Iterator<Item = &mut PaintSpec> {
        [&mut self.top, &mut self.frame, &mut self.legs].into_iter().chain(&mut self.under)
    }
}

/// What surrounds the table.
#[derive(Clone, Debug, PartialEq)]
pub struct BackgroundSpec {
    /// Floor at z −0.9196.
    pub floor: PaintSpec,
    /// Four walls at ±1.5 m, which stand only where their look varies.
    pub walls: PaintSpec,
}

/// A light infinitely far away.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionalSpec {
    /// Linear RGB.
    pub color: [Range; 3],
    /// Direction the light travels in; need not be normalised.
    pub direction: [f64; 3],
    /// About the vertical from there, in rad.
    pub turn: Range,
}

/// Lighting.
#[derive(Clone, Debug, PartialEq)]
pub struct LightsSpec {
    /// Linear RGB of the ambient light.
    pub ambient: [Range; 3],
    /// Up to two.
    pub directional: Vec<DirectionalSpec>,
    /// Whether the first directional light casts shadows.
    pub shadows: bool,
}

/// Which image of the observation a camera fills.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "named after the benchmark's cameras")]
pub enum CameraSlot {
    External1,
    External2,
    Hand1,
    Hand2,
}

/// What a camera is fixed to. Camera frame: x forward, y left, z up.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraMount {
    /// The world; looks from `eye` to `target` with +z up.
    World {
        /// World position in m.
        eye: [f64; 3],
        /// World point in m.
        target: [f64; 3],
    },
    /// The hand link of an arm.
    Hand {
        /// Arm index.
        arm: usize,
        /// Camera pose in the hand's frame.
        pose: Isometry3<f64>,
    },
}

/// Error of a camera's pose, applied in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jitter {
    /// Along x, y, z, in m.
    pub translation: [Range; 3],
    /// Intrinsic XYZ Euler angles, in rad.
    pub rotation: [Range; 3],
}

impl Jitter {
    /// No error.
    pub const NONE: Self = Self { translation: [Range::fixed(0.0); 3], rotation: [Range::fixed(0.0); 3] };
}

/// One camera; images are square.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraSpec {
    /// Image it fills.
    pub slot: CameraSlot,
    /// Mount.
    pub mount: CameraMount,
    /// Vertical field of view, in rad.
    pub fov_y_rad: f64,
    /// Near and far plane, in m.
    pub clip_m: [f64; 2],
    /// Pose error.
    pub jitter: Jitter,
}

/// The distribution of a task's scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneSpec {
    /// Bodies in the order of their indices.
    pub bodies: Vec<BodySpec>,
    /// Regions bodies are placed in.
    pub regions: Vec<RegionSpec>,
    /// Sizes that are drawn, if any.
    pub sizes: Option<SizesSpec>,
    /// One or two arms.
    pub robots: Vec<RobotSpec>,
    /// Table.
    pub table: TableSpec,
    /// Floor and walls.
    pub background: BackgroundSpec,
    /// Lighting.
    pub lights: LightsSpec,
    /// Cameras in the order of the observation's images.
    pub cameras: Vec<CameraSpec>,
    /// Clutter.
    pub distractors: DistractorsSpec,
    /// Instruction given to the policy.
    pub instruction: InstructionSpec,
}

impl SceneSpec {
    /// Index of the body with this name.
    ///
    /// # Panics
    /// If there is none: a task names only its own bodies.
    #[must_use]
    pub fn body_idx(&self, name: &str) -> usize {
        self.bodies.iter().position(|b| b.name == name).unwrap_or_else(|| panic!("no body is named {name}"))
    }
}
