//! Mesh generators for solids with a closed-form boundary.

mod contour;
pub(in crate::render) mod extrusion;
pub(in crate::render) mod lathe;
mod polygon;
pub(in crate::render) mod rounded_box;
pub(in crate::render) mod torus;
pub(super) mod unit_solids;
