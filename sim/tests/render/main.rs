//! Tests of the renderer through its public interface: projection, visibility, shading, and that images
//! depend on nothing but the scene, snapshot and camera.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;
mod contact_sheet;
mod image_content;
mod independence;
mod inspect;
mod lighting;
mod projection;
mod sizes;
mod static_layers;
mod visual_shapes;
