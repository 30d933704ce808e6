//! Device records of a chunk of views. Their layout must match the structs of `passes/wgsl/records.wgsl`
//! field by field.

use bytemuck::{Pod, Zeroable};

use crate::math::affine::Affine3;
use crate::prepared::N_SUNS;

/// Sentinel for a missing texture, shadow map or triangle.
pub(crate) const NONE: u32 = u32::MAX;
/// Number of low bits of a triangle id that hold the triangle's index in its mesh. The bits above hold the
/// instance's index in its view.
pub(crate) const TRIANGLE_BITS: u32 = 20;
/// Maximum number of instances per view. One less than the bits allow, because the last index is reserved for
/// [`NONE`].
pub(crate) const MAX_INSTANCES: usize = (1 << (32 - TRIANGLE_BITS)) - 1;
/// Maximum number of triangles per mesh.
pub(crate) const MAX_TRIANGLES: usize = 1 << TRIANGLE_BITS;

/// A directional light.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SunRecord {
    /// Unit vector towards the light, in the view frame.
    pub(crate) towards: [f32; 4],
    /// Irradiance, linear RGB.
    pub(crate) color: [f32; 4],
}

/// A camera image or a shadow map.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct ViewRecord {
    /// Focal length in px.
    pub(crate) focal_px: f32,
    /// Depth of the near clipping plane in m.
    pub(crate) near_m: f32,
    /// Reciprocal of the depth of the far clipping plane, in 1/m.
    pub(crate) inverse_far: f32,
    /// Depth of the far clipping plane in m.
    pub(crate) far_m: f32,
    /// Half the width and height of the image.
    pub(crate) half_px: [f32; 2],
    /// Distances in m along x and y, per metre of radius, by which the centre of a sphere may lie outside an
    /// edge of the image while the sphere is still visible.
    pub(crate) sphere_margins: [f32; 2],
    /// Columns and rows in whole tiles, of which the image is the left upper part.
    pub(crate) size: [u32; 2],
    /// Width of the guard band: triangles are clipped only if they extend farther beyond the image's edges.
    pub(crate) guard_px: f32,
    /// 1 for a shadow map, 0 for an image.
    pub(crate) is_shadow_map: u32,
    /// Index of the first pixel: the number of pixels of all preceding views of the same kind.
    pub(crate) first_pixel: u32,
    /// Index of the first instance.
    pub(crate) first_instance: u32,
    /// Index of the shadow map's record, or [`NONE`].
    pub(crate) shadow_map: u32,
    /// Index of the scene's first instance among those of all resident scenes.
    pub(crate) first_scene_instance: u32,
    /// Number of instances of the scene.
    pub(crate) n_instances: u32,
    /// Index of the env's first pose.
    pub(crate) first_pose: u32,
    /// Padding to 16 bytes.
    pub(crate) padding: [u32; 2],
    /// Rows of the transform from the world to the view frame, or to shadow map texels and height.
    pub(crate) view_from_world: [[f32; 4]; 3],
    /// Ambient light, linear RGB.
    pub(crate) ambient: [f32; 4],
    /// Directional lights; unused ones are black.
    pub(crate) suns: [SunRecord; 2],
    /// Rows of the transform from the view frame to shadow map texels and height.
    pub(crate) shadow_from_view: [[f32; 4]; 3],
}

/// A mesh instance of a scene: what stays constant within an episode.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SceneInstanceRecord {
    /// Rows of the transform from the mesh frame to the frame that the instance is attached to.
    pub(crate) anchor_from_mesh: [[f32; 4]; 3],
    /// Reflectance, linear RGB.
    pub(crate) color: [f32; 3],
    /// Specular reflectance in white; 0 for a metal.
    pub(crate) specular: f32,
    /// Texture tiles per mesh unit along each axis.
    pub(crate) tiles: [f32; 3],
    /// Device index of the texture, or [`NONE`].
    pub(crate) texture: u32,
    /// Centre of the bounding sphere in the mesh frame.
    pub(crate) centre: [f32; 3],
    /// Radius of the bounding sphere in the mesh frame.
    pub(crate) radius: f32,
    /// Index of the frame's pose among those of the env, or [`NONE`] for the world.
    pub(crate) pose: u32,
    /// Device index of the mesh's first triangle.
    pub(crate) first_triangle: u32,
    /// Number of triangles of the mesh.
    pub(crate) n_triangles: u32,
    /// 1 for a metal, 0 for anything else.
    pub(crate) metallic: f32,
    /// 1 if the instance casts a shadow, 0 if it does not.
    pub(crate) casts_shadow: u32,
    /// Padding to 16 bytes.
    pub(crate) padding: [u32; 3],
}

/// The pose of a body or a link: rows of the transform from its frame to the world.
pub(crate) type PoseRecord = [[f32; 4]; 3];

/// Size in bytes of a mesh instance in a view, which the device writes.
pub(crate) const INSTANCE_BYTES: u64 = 112;

/// A mesh vertex.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct VertexRecord {
    /// Position in the mesh frame; w is unused.
    pub(crate) position: [f32; 4],
    /// Unit normal in the mesh frame; w is unused.
    pub(crate) normal: [f32; 4],
}

const _: () = assert!(size_of::<ViewRecord>() == 256 && size_of::<SceneInstanceRecord>() == 128);
const _: () = assert!(size_of::<VertexRecord>() == 32 && N_SUNS == 2);

/// Converts a transform to the rows of a 3 × 4 matrix, with the translation in the last column.
pub(crate) fn rows(map: &Affine3) -> [[f32; 4]; 3] {
    core::array::from_fn(|i| {
        let [x, y, z] = map.linear[i];
        [x, y, z, map.offset[i]]
    })
}

/// Pads a vector to 16 bytes.
pub(crate) fn padded([x, y, z]: [f32; 3]) -> [f32; 4] {
    [x, y, z, 0.0]
}
