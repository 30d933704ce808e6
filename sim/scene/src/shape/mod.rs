//! Shapes: convex primitives that collide, and visual shapes that do not.

mod primitive;
mod visual_shape;

pub(crate) use primitive::factors_along;
pub use primitive::{Aabb, Primitive};
pub use visual_shape::{VisualShape, rounded_rectangle};
