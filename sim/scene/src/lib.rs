//! Scene distributions and the scenes sampled from them.
//!
//! A task describes its scenes as a [`SceneSpec`], whose values are ranges. Perturbations edit the spec, and
//! [`SceneSpec::draw`] samples a [`Scene`], whose values are numbers, from it and a seed. A `Scene` is never
//! modified afterwards. This crate depends on neither the physics engine nor the renderer.

mod appearance;
mod color;
pub mod distractors;
mod draw;
mod drawn;
mod instruction;
mod mass;
mod placement;
mod primitive;
mod range;
pub mod robot;
mod snapshot;
mod spec;
pub mod stream;
mod texture;
mod visual_shape;

pub use appearance::{AppearanceSpec, AppearanceVariation};
pub use color::{decode_srgb, rgb, srgb};
pub use drawn::{
    Appearance, Background, Body, Camera, DirectionalLight, Lights, Part, Robot, Scene, Table, Visual,
};
pub use instruction::{InstructionSource, InstructionSpec};
pub use mass::Mass;
pub use placement::{DistractorPlacement, DistractorsSpec, PlacementSpec, RegionSpec, WidenedRanges};
pub use primitive::{Aabb, Primitive};
pub use range::Range;
pub use snapshot::{ArmLinks, Link, N_LINKS, Snapshot};
pub use spec::{
    BackgroundSpec, BodySpec, CameraMount, CameraSlot, CameraSpec, DirectionalLightSpec, Jitter, JointKind,
    JointSpec, LightsSpec, Motion, PartSpec, RenderParts, RobotSpec, Role, ScaleAxes, ScaledBy, SceneSpec,
    SizesSpec, TableKind, TableSpec, VisualSpec,
};
pub use texture::Texture;
pub use visual_shape::{VisualShape, rounded_rectangle};
