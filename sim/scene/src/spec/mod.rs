//! Specifications, from which scenes are drawn: their bodies, robots, cameras and lights, where things may
//! stand, and what the instruction says.

mod instruction;
mod placement;
mod scene;

pub use instruction::{InstructionSource, InstructionSpec};
pub use placement::{DistractorPlacement, DistractorsSpec, PlacementSpec, RegionSpec, WidenedRanges};
pub use scene::{
    BackgroundSpec, BodySpec, CameraMount, CameraSlot, CameraSpec, DirectionalLightSpec, Jitter, JointKind,
    JointSpec, LightsSpec, Motion, PartSpec, RenderParts, RobotSpec, Role, ScaleAxes, ScaledBy, SceneSpec,
    SizesSpec, TableKind, TableSpec, VisualSpec,
};
