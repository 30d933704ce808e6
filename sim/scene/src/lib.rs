//! Scene distributions and the scenes sampled from them.
//!
//! A task describes its scenes as a [`SceneSpec`], whose values are ranges. Perturbations edit the spec, and
//! [`SceneSpec::draw`] samples a [`Scene`], whose values are numbers, from it and a seed. A `Scene` is never
//! modified afterwards. This crate depends on neither the physics engine nor the renderer.

mod appearance;
pub mod distractors;
mod draw;
mod drawn;
mod mass;
mod range;
pub mod robot;
mod shape;
mod snapshot;
mod spec;
pub mod stream;

pub use appearance::{AppearanceSpec, AppearanceVariation, Texture, decode_srgb, rgb, srgb};
pub use drawn::{
    Appearance, Background, Body, Camera, DirectionalLight, Lights, Part, Robot, Scene, Table, Visual,
};
pub use mass::Mass;
pub use range::Range;
pub use shape::{Aabb, Primitive, VisualShape, rounded_rectangle};
pub use snapshot::{ArmLinks, Link, N_LINKS, Snapshot};
pub use spec::{
    BackgroundSpec, BodySpec, CameraMount, CameraSlot, CameraSpec, DirectionalLightSpec, DistractorPlacement,
    DistractorsSpec, InstructionSource, InstructionSpec, Jitter, JointKind, JointSpec, LightsSpec, Motion,
    PartSpec, PlacementSpec, RegionSpec, RenderParts, RobotSpec, Role, ScaleAxes, ScaledBy, SceneSpec,
    SizesSpec, TableKind, TableSpec, VisualSpec, WidenedRanges,
};
