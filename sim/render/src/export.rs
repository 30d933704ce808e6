//! Scenes as plain data, so that other renderers can be given the same geometry, materials, lights and
//! cameras.

use ipc_types::ImageSize;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use super::math::affine::{Affine3, Vec3, normalised};
use super::mesh::ProjectionAxis;
use super::prepared::{Instance, RenderScene};
use super::shading::{SHADOW_MAP_SIDE, SHADOW_MAP_WIDTH_M};
use super::texture;
use scene::Snapshot;

/// Everything about a scene that does not change within an episode.
#[derive(Clone, Debug)]
pub struct ExportedScene {
    /// Rigid objects of the scene, the static ones first.
    pub instances: Vec<ExportedInstance>,
    /// Cameras, in the order of the observation's images.
    pub cameras: Vec<ExportedCamera>,
    /// Directional lights. Only the first one casts shadows; unused lights are black.
    pub lights: Vec<ExportedLight>,
    /// Ambient light, linear RGB.
    pub ambient: [f32; 3],
    /// Texels along each edge of the shadow map.
    pub shadow_map_side: u32,
    /// Width of the region that the shadow map covers, in m.
    pub shadow_map_width_m: f32,
}

/// A mesh with its material, at its final size.
#[derive(Clone, Debug)]
pub struct ExportedInstance {
    /// Vertex positions in the instance's frame, in m.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals, one per vertex.
    pub normals: Vec<[f32; 3]>,
    /// Vertex indices, counter-clockwise when viewed from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Per triangle the axis (0, 1 or 2) along which the texture is projected onto it: texture coordinates
    /// are (z, y), (x, z) or (x, y), divided by the tile's side.
    pub texture_axes: Vec<usize>,
    /// Diffuse reflectance, linear RGB.
    pub color: [f32; 3],
    /// Strength of the highlight, in [0, 1].
    pub specular: f32,
    /// Texture that multiplies the colour.
    pub texture: Option<ExportedTexture>,
}

/// A square texture that repeats.
#[derive(Clone, Debug)]
pub struct ExportedTexture {
    /// Texels along each edge.
    pub side: usize,
    /// Side of a tile in m.
    pub tile_m: f32,
    /// `[side, side, 3] u8`: 255 times the square root of the linear factors.
    pub rgb: Vec<u8>,
}

/// A pinhole camera with square pixels.
#[derive(Clone, Copy, Debug)]
pub struct ExportedCamera {
    /// Size of its image.
    pub size: ImageSize,
    /// Vertical field of view in rad.
    pub fov_y_rad: f32,
    /// Depths of the near and far clipping planes, in m.
    pub clip_m: [f32; 2],
}

/// A directional light.
#[derive(Clone, Copy, Debug)]
pub struct ExportedLight {
    /// Unit vector towards the light, in the world frame.
    pub towards: [f32; 3],
    /// Linear RGB irradiance.
    pub color: [f32; 3],
}

/// Poses in the world at one moment. A pose is a position in m followed by a quaternion (w, x, y, z).
#[derive(Clone, Debug)]
pub struct ExportedPoses {
    /// Poses of the instances, in the order of [`ExportedScene::instances`].
    pub instances: Vec<[f32; 7]>,
    /// Poses of the cameras, whose axes are x right, y up, z backward (the OpenGL convention).
    pub cameras: Vec<[f32; 7]>,
}

impl RenderScene {
    /// Returns the geometry, materials, lights and cameras of the scene.
    #[must_use]
    pub fn export(&self) -> ExportedScene {
        let cameras = self.cameras.iter().map(|camera| ExportedCamera {
            size: camera.size,
            fov_y_rad: 2.0 * libm::atanf(camera.slopes()[1]),
            clip_m: camera.clip_m,
        });
        let lights = self.suns.iter().map(|sun| ExportedLight { towards: sun.towards, color: sun.color });
        ExportedScene {
            instances: self.instances.iter().map(exported_instance).collect(),
            cameras: cameras.collect(),
            lights: lights.collect(),
            ambient: self.ambient,
            shadow_map_side: SHADOW_MAP_SIDE,
            shadow_map_width_m: SHADOW_MAP_WIDTH_M,
        }
    }

    /// Returns the poses of all exported instances and cameras for a snapshot.
    ///
    /// # Panics
    /// If the snapshot does not belong to the scene.
    #[must_use]
    pub fn exported_poses(&self, snapshot: &Snapshot) -> ExportedPoses {
        let instances = self.instances.iter().map(|instance| {
            let mut map = instance.world_from_mesh(snapshot);
            for row in &mut map.linear {
                *row = core::array::from_fn(|axis| row[axis] / instance.scale[axis]);
            }
            pose(&map)
        });
        let cameras = self.cameras.iter().map(|camera| {
            let mut map = camera.view_from_world(snapshot).rigid_inverse();
            for row in &mut map.linear {
                *row = [row[0], -row[1], -row[2]];
            }
            pose(&map)
        });
        ExportedPoses { instances: instances.collect(), cameras: cameras.collect() }
    }
}

fn exported_instance(instance: &Instance) -> ExportedInstance {
    let (mesh, scale) = (instance.mesh(), instance.scale);
    let vertices = 0..mesh.n_vertices() as u32;
    let normals = mesh.normals.iter().map(|&normal| normalised(scaled_by(normal, scale.map(|s| 1.0 / s))));
    let texture_axes = mesh.projection_axes.iter().map(|facing| match facing {
        ProjectionAxis::X => 0,
        ProjectionAxis::Y => 1,
        ProjectionAxis::Z => 2,
    });
    ExportedInstance {
        positions: vertices.map(|i| scaled_by(mesh.position(i), scale)).collect(),
        normals: normals.collect(),
        triangles: mesh.triangles.clone(),
        texture_axes: texture_axes.collect(),
        color: instance.material.color,
        specular: instance.material.specular,
        texture: instance.material.texture.map(exported_texture),
    }
}

/// Exports a texture without its padding.
fn exported_texture(texture: scene::Texture) -> ExportedTexture {
    let (image, side) = (texture::image(texture), texture::SIDE);
    let rows = image.texels.chunks_exact(texture::PITCH).take(side);
    let rgb = rows.flat_map(|row| &row[..side]).flat_map(|texel| {
        let [r, g, b, _] = texel.to_le_bytes();
        [r, g, b]
    });
    ExportedTexture { side, tile_m: image.tile_m, rgb: rgb.collect() }
}

/// Converts a rigid transform to a position and a quaternion (w, x, y, z).
fn pose(map: &Affine3) -> [f32; 7] {
    let matrix = Matrix3::from_fn(|row, column| map.linear[row][column]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    let [x, y, z] = map.offset;
    [x, y, z, rotation.w, rotation.i, rotation.j, rotation.k]
}

fn scaled_by(v: Vec3, scale: Vec3) -> Vec3 {
    core::array::from_fn(|axis| v[axis] * scale[axis])
}
