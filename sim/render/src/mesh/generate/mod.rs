//! Mesh generators for solids with a closed-form boundary.

mod contour;
pub(crate) mod extrusion;
pub(crate) mod lathe;
mod polygon;
pub(crate) mod rounded_box;
pub(crate) mod torus;
pub(crate) mod unit_solids;
