//! What a device is told about a chunk of views: the structs of `wgsl/records.wgsl`, field by field.

use bytemuck::{Pod, Zeroable};

use crate::render::math::affine::Affine3;
use crate::render::scene::N_SUNS;

/// No texture, no shadow map, no triangle.
pub(super) const NONE: u32 = u32::MAX;
/// An id is the instance's index in its view above these bits, and the triangle's index in its mesh in them.
pub(super) const TRIANGLE_BITS: u32 = 20;
/// Most instances of a view and most triangles of a mesh; the last instance's number is left to [`NONE`].
pub(super) const MAX_INSTANCES: usize = (1 << (32 - TRIANGLE_BITS)) - 1;
pub(super) const MAX_TRIANGLES: usize = 1 << TRIANGLE_BITS;

/// A light infinitely far away.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct SunRecord {
    /// Unit vector to the light, in the view frame.
    pub(super) towards: [f32; 4],
    /// Linear RGB.
    pub(super) color: [f32; 4],
}

/// A camera's image or a shadow map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct ViewRecord {
    /// Pixels per unit of x/z.
    pub(super) focal_px: f32,
    /// Half the image's side.
    pub(super) half_px: f32,
    /// Nearest depth that is drawn, in m.
    pub(super) near_m: f32,
    /// 1/z of the farthest.
    pub(super) inverse_far: f32,
    /// Pixels along each edge.
    pub(super) side: u32,
    /// Pixels of the views before this one.
    pub(super) first_pixel: u32,
    /// Its place among the images or among the maps.
    pub(super) layer: u32,
    /// Index of its first instance.
    pub(super) first_instance: u32,
    /// Index of its shadow map's record, or [`NONE`].
    pub(super) map: u32,
    /// Nothing.
    pub(super) spare: [u32; 3],
    /// Linear RGB.
    pub(super) ambient: [f32; 4],
    /// The world's up, in the view frame.
    pub(super) up: [f32; 4],
    /// Directional lights.
    pub(super) suns: [SunRecord; 2],
    /// From the view frame to the shadow map's texels and height.
    pub(super) map_from_view: [[f32; 4]; 3],
}

/// A mesh in a view.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct InstanceRecord {
    /// From the mesh to the view frame, or to a shadow map's texels and height.
    pub(super) view_from_mesh: [[f32; 4]; 3],
    /// Linear RGB.
    pub(super) color: [f32; 3],
    /// Strength of the highlight.
    pub(super) specular: f32,
    /// Tiles of its texture per unit of the mesh along each axis.
    pub(super) tiles: [f32; 3],
    /// Index of its texture on the device, or [`NONE`].
    pub(super) texture: u32,
    /// Index of its view's record.
    pub(super) view: u32,
    /// Index of its first triangle on the device.
    pub(super) first_triangle: u32,
    /// Triangles of its mesh.
    pub(super) n_triangles: u32,
    /// Id of its first triangle.
    pub(super) first_id: u32,
}

/// A corner of a mesh.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct VertexRecord {
    /// In the mesh's frame.
    pub(super) position: [f32; 4],
    /// Unit vector.
    pub(super) normal: [f32; 4],
}

const _: () = assert!(size_of::<ViewRecord>() == 192 && size_of::<InstanceRecord>() == 96);
const _: () = assert!(size_of::<VertexRecord>() == 32 && N_SUNS == 2);

/// A matrix as the device has it: rows, the offset last.
pub(super) fn rows(map: &Affine3) -> [[f32; 4]; 3] {
    core::array::from_fn(|i| {
        let [x, y, z] = map.linear[i];
        [x, y, z, map.offset[i]]
    })
}

/// A vector as the device has it.
pub(super) fn padded([x, y, z]: [f32; 3]) -> [f32; 4] {
    [x, y, z, 0.0]
}
