//! Distribution of a task's scenes: plain data of ranges. Only perturbations edit it.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::instruction::InstructionSpec;
use super::placement::{DistractorsSpec, PlacementSpec, RegionSpec};
use crate::appearance::AppearanceSpec;
use crate::mass::Mass;
use crate::range::Range;
use crate::shape::Primitive;
use crate::shape::VisualShape;

/// Role of a body in the task. Colour, texture and size perturbations select bodies by role.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// MO: an object that the robot manipulates.
    ManipulationObject,
    /// RO: an object in or on which the manipulated object is placed.
    ReceiverObject,
    /// Neither of the two.
    Fixture,
    /// A distractor object, irrelevant to the task.
    Distractor,
}

impl Role {
    /// Returns the name used in messages.
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

/// The size perturbation that scales a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScaledBy {
    /// The perturbation MO-Size.
    MoSize,
    /// The perturbation RO-Size.
    RoSize,
    /// No perturbation, for the given reason.
    Nothing(&'static str),
}

/// Axes along which a body is scaled by the same factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScaleAxes {
    /// One factor for the whole body, which keeps its proportions.
    Together,
    /// One factor for each axis of the body's frame. The benchmark does this to bodies made from mesh files.
    Independent,
}

/// Render parts of a body: the units that colour and texture perturbations change independently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RenderParts {
    /// The shapes of one nominal appearance are one, like the benchmark's shapes that share a material.
    PerAppearance,
    /// Every part or visual is one.
    PerShape,
    /// The whole body is one, like the benchmark's bodies with a single mesh.
    Single,
}

/// Motion type of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Moves freely under forces.
    Dynamic,
    /// Collides but never moves.
    Fixed,
    /// Neither moves nor collides: a mark painted on the table.
    VisualOnly,
    /// Moves along or about a joint anchored at its initial pose. It collides with dynamic bodies and arms,
    /// but not with fixed or other jointed bodies.
    Jointed(JointSpec),
}

impl Motion {
    /// Returns `true` if the body's pose can change during an episode.
    #[must_use]
    pub const fn can_move(self) -> bool {
        matches!(self, Self::Dynamic | Self::Jointed(_))
    }
}

/// Type of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Translation along the axis; positions in m.
    Slide,
    /// Rotation about the axis through the body's origin; positions in rad.
    Hinge,
}

/// A joint between a body and the world, whose position is 0 at the body's initial pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSpec {
    /// Slide or hinge.
    pub kind: JointKind,
    /// Unit vector in the body's frame, other than −x.
    pub axis: [f64; 3],
    /// Upper position limit, in m at scale 1 or in rad. The lower limit is 0.
    pub upper: f64,
    /// Viscous damping, in N·s/m or N·m·s/rad.
    pub damping: f64,
    /// Dry friction, in N or N·m.
    pub friction: f64,
}

/// One convex collision shape of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct PartSpec {
    /// Shape at scale 1.
    pub shape: Primitive,
    /// Pose in the body's frame at scale 1. The translation scales with the body.
    pub pose: Isometry3<f64>,
    /// Appearance, used if the body has no visuals.
    pub appearance: AppearanceSpec,
}

impl PartSpec {
    /// Creates an unrotated part centred at `position` (m) in the body's frame.
    #[must_use]
    pub fn at(shape: Primitive, position: [f64; 3], appearance: AppearanceSpec) -> Self {
        Self {
            shape,
            pose: Isometry3::from_parts(Vector3::from(position).into(), UnitQuaternion::identity()),
            appearance,
        }
    }
}

/// One visual shape of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct VisualSpec {
    /// Shape at scale 1.
    pub shape: VisualShape,
    /// Pose in the body's frame at scale 1. The translation scales with the body.
    pub pose: Isometry3<f64>,
    /// Appearance of the whole shape.
    pub appearance: AppearanceSpec,
}

impl VisualSpec {
    /// Creates an unrotated visual centred at `position` (m) in the body's frame.
    #[must_use]
    pub fn at(shape: VisualShape, position: [f64; 3], appearance: AppearanceSpec) -> Self {
        Self {
            shape,
            pose: Isometry3::from_parts(Vector3::from(position).into(), UnitQuaternion::identity()),
            appearance,
        }
    }
}

/// Distribution of one rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct BodySpec {
    /// Name used by predicates and messages; also the prefix of the body's random streams.
    pub name: &'static str,
    /// Role in the task.
    pub role: Role,
    /// Motion type, including the joint if there is one.
    pub motion: Motion,
    /// Collision shapes. They are also rendered if there are no visuals.
    pub parts: Vec<PartSpec>,
    /// Visual shapes. If empty, the parts are rendered instead.
    pub visuals: Vec<VisualSpec>,
    /// The units that are recoloured independently.
    pub render_parts: RenderParts,
    /// The size perturbation that scales the body.
    pub scaled_by: ScaledBy,
    /// Scale, nominally 1.
    pub scale: Range,
    /// Axes that share one value of the scale.
    pub scale_axes: ScaleAxes,
    /// Distribution of the initial pose.
    pub placement: PlacementSpec,
    /// Mass, or the density that determines it.
    pub mass: Mass,
    /// Friction coefficient, static and dynamic.
    pub friction: f64,
    /// Linear and angular damping, in 1/s: the fraction of the velocity lost per second.
    pub damping: [f64; 2],
}

impl BodySpec {
    /// Sets the range of the rotation about the vertical, in rad.
    ///
    /// # Panics
    /// If the body is placed relative to another body.
    #[must_use]
    pub fn with_yaw(mut self, range: Range) -> Self {
        let PlacementSpec::OnSurface { yaw, .. } = &mut self.placement else {
            panic!("{} is placed relative to another body and has no yaw", self.name)
        };
        *yaw = range;
        self
    }

    /// Sets the orientation before the yaw rotation.
    ///
    /// # Panics
    /// If the body is placed relative to another body.
    #[must_use]
    pub fn with_orientation(mut self, upright: UnitQuaternion<f64>) -> Self {
        let PlacementSpec::OnSurface { orientation, .. } = &mut self.placement else {
            panic!("{} is placed relative to another body, which determines its orientation", self.name)
        };
        *orientation = upright;
        self
    }

    /// Sets the world z of the body's origin at the start, in m.
    ///
    /// # Panics
    /// If the body is placed relative to another body.
    #[must_use]
    pub fn with_origin_z(mut self, z_m: f64) -> Self {
        let PlacementSpec::OnSurface { origin_z_m, .. } = &mut self.placement else {
            panic!("{} is placed relative to another body, which determines its height", self.name)
        };
        *origin_z_m = Some(z_m);
        self
    }

    /// Iterates over the appearances of all parts and visuals.
    pub fn appearances_mut(&mut self) -> impl Iterator<Item = &mut AppearanceSpec> {
        let parts = self.parts.iter_mut().map(|part| &mut part.appearance);
        parts.chain(self.visuals.iter_mut().map(|visual| &mut visual.appearance))
    }
}

/// Distribution of one arm.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotSpec {
    /// World pose of link 0.
    pub base: Isometry3<f64>,
    /// Positions of joints 1 to 7 in rad, clamped to the joint limits after adding noise. Fingers start at
    /// 0.04 m.
    pub qpos: [f64; 7],
    /// Standard deviation of the Gaussian noise on each joint position, in rad.
    pub noise_rad: f64,
}

/// Body dimensions that are sampled per episode and that a uniform scale cannot express.
#[derive(Clone, Copy, Debug)]
pub struct SizesSpec {
    /// Name (also of its random stream) and range of each sampled dimension.
    pub ranges: &'static [(&'static str, Range)],
    /// Sets the shapes and poses of the bodies' parts from the sampled dimensions. It must not change
    /// anything else.
    pub apply: fn(&[f64], &mut [BodySpec]),
}

impl PartialEq for SizesSpec {
    fn eq(&self, other: &Self) -> bool {
        self.ranges == other.ranges && core::ptr::fn_addr_eq(self.apply, other.apply)
    }
}

/// Geometry and orientation of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableKind {
    /// 1.209 × 2.418 m with its top at z = 0 and its long side along y.
    SingleArm,
    /// The same table with its long side along x.
    SingleArmTurned,
    /// A plate of 1.2 × 1.6 m with its top at z = 0.825, above the single-arm table.
    Bimanual,
}

/// Distribution of the table's appearance.
#[derive(Clone, Debug, PartialEq)]
pub struct TableSpec {
    /// Geometry and orientation.
    pub kind: TableKind,
    /// Appearance of the work surface.
    pub top: AppearanceSpec,
    /// Appearance of the legs and of the frame below each top.
    pub legs: AppearanceSpec,
    /// Appearance of the lower table's top, if there are two tables.
    pub lower_top: Option<AppearanceSpec>,
    /// If `true`, the table that stands on the floor is drawn as the block that it collides as.
    pub as_block: bool,
}

impl TableSpec {
    /// Iterates over the appearances of all parts of the table.
    pub fn appearances_mut(&mut self) -> impl Iterator<Item = &mut AppearanceSpec> {
        [&mut self.top, &mut self.legs].into_iter().chain(&mut self.lower_top)
    }
}

/// Distribution of the surroundings of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct BackgroundSpec {
    /// Appearance of the floor at z = −0.9196 m.
    pub floor: AppearanceSpec,
    /// Appearance of the four walls at ±1.5 m. The walls exist only if their appearance varies.
    pub walls: AppearanceSpec,
}

/// Distribution of a directional light, infinitely far away.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionalLightSpec {
    /// Linear RGB radiance.
    pub color: [Range; 3],
    /// World direction in which the light travels at yaw 0; not necessarily normalised.
    pub direction: [f64; 3],
    /// Rotation of the direction about the vertical, in rad.
    pub yaw: Range,
}

/// Distribution of the lighting.
#[derive(Clone, Debug, PartialEq)]
pub struct LightsSpec {
    /// Ambient light, linear RGB.
    pub ambient: [Range; 3],
    /// Directional lights, at most two.
    pub directional: Vec<DirectionalLightSpec>,
    /// `true` if the first directional light casts shadows.
    pub shadows: bool,
}

/// The observation image that a camera renders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "named after the benchmark's cameras")]
pub enum CameraSlot {
    External1,
    External2,
    Hand1,
    Hand2,
}

/// Attachment of a camera. Camera frame: x forward, y left, z up.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraMount {
    /// Fixed in the world, looking from `eye` at `target` with +z up.
    World {
        /// World position of the camera, in m.
        eye: [f64; 3],
        /// World position of the look-at point, in m.
        target: [f64; 3],
    },
    /// Fixed to the hand link of an arm.
    Hand {
        /// Index of the arm.
        arm: usize,
        /// Camera pose in the hand's frame.
        pose: Isometry3<f64>,
    },
}

/// Distribution of a camera's pose error, expressed in the camera's own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jitter {
    /// Translation along x, y and z, in m.
    pub translation: [Range; 3],
    /// Intrinsic XYZ Euler angles, in rad.
    pub rotation: [Range; 3],
}

impl Jitter {
    /// No pose error.
    pub const NONE: Self = Self { translation: [Range::fixed(0.0); 3], rotation: [Range::fixed(0.0); 3] };
}

/// Distribution of one camera. Images are square.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraSpec {
    /// Observation image that the camera renders.
    pub slot: CameraSlot,
    /// Attachment to the world or to a hand.
    pub mount: CameraMount,
    /// Vertical field of view, in rad.
    pub fov_y_rad: f64,
    /// Distances of the near and far clipping planes, in m.
    pub clip_m: [f64; 2],
    /// Distribution of the pose error.
    pub jitter: Jitter,
}

/// Distribution of a task's scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneSpec {
    /// Bodies, in the order of their indices.
    pub bodies: Vec<BodySpec>,
    /// Regions in which bodies are placed.
    pub regions: Vec<RegionSpec>,
    /// Minimum gap between the bounding boxes of any two bodies at the start, in m: all positions are drawn
    /// again until it is kept. `None` accepts overlaps. Bodies placed relative to others do not count.
    pub min_start_gap_m: Option<f64>,
    /// Sampled body dimensions, if any.
    pub sizes: Option<SizesSpec>,
    /// Physics steps per second of simulated time, a multiple of the control rate of 20 Hz.
    pub physics_hz: u32,
    /// One or two arms.
    pub robots: Vec<RobotSpec>,
    /// Table geometry and appearance.
    pub table: TableSpec,
    /// Floor and walls.
    pub background: BackgroundSpec,
    /// Ambient and directional lights.
    pub lights: LightsSpec,
    /// Cameras in the order of the observation's images.
    pub cameras: Vec<CameraSpec>,
    /// Distribution of the distractor objects.
    pub distractors: DistractorsSpec,
    /// Language instruction given to the policy.
    pub instruction: InstructionSpec,
}

impl SceneSpec {
    /// Returns the index of the body called `name`.
    ///
    /// # Panics
    /// If there is no such body.
    #[must_use]
    pub fn body_idx(&self, name: &str) -> usize {
        self.bodies.iter().position(|b| b.name == name).unwrap_or_else(|| panic!("no body is named {name}"))
    }
}
