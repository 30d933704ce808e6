//! From a distribution of scenes to one scene.
//!
//! A task states a [`SceneSpec`] of ranges, a perturbation edits it, a seed draws a [`Scene`] of numbers, and nothing
//! changes a `Scene` afterwards. This module knows neither rapier nor pixels.

mod clutter;
mod distractors;
mod draw;
mod drawn;
mod form;
mod instruction;
mod look;
mod paint;
mod place;
mod range;
mod shape;
mod snapshot;
mod spec;
mod texture;

pub(crate) use clutter::APPLE;
pub use drawn::{
    Background, Body, Camera, DirectionalLight, Lights, Paint, Part, Robot, Scene, Table, Visual,
};
pub use form::{Form, rounded_rectangle};
pub use instruction::{InstructionSpec, Wording};
pub use paint::{PaintSpec, Variation, rgb};
pub use place::{DistractorsSpec, PlacementSpec, RegionSpec, Widened};
pub use range::Range;
pub use shape::{Extent, Primitive};
pub use snapshot::{ArmLinks, Link, N_LINKS, Snapshot};
pub use spec::{
    BackgroundSpec, BodySpec, CameraMount, CameraSlot, CameraSpec, DirectionalSpec, Jitter, JointKind,
    JointSpec, LightsSpec, Motion, PartSpec, RobotSpec, Role, ScaledBy, SceneSpec, SizesSpec, TableKind,
    TableSpec, VisualSpec,
};
pub use texture::Texture;
