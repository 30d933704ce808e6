//! Meshes and textures on the device. They are uploaded on first use and stay resident until the meshes
//! exceed a memory limit.

use super::device::Gpu;
use super::growable_buffer::GrowableBuffer;
use super::records::{MAX_TRIANGLES, VertexRecord, padded};
use crate::render::mesh::{Mesh, ProjectionAxis};
use crate::render::scene::{Instance, MeshKey};
use crate::render::texture::mip_chain;
use crate::scene::Texture;

/// Location of a mesh in the device buffers.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeshRange {
    /// Identifies the mesh.
    pub(super) key: MeshKey,
    /// Index of the mesh, in order of first use.
    pub(super) mesh_idx: usize,
    /// Index of its first triangle.
    pub(super) first_triangle: u32,
    /// Number of triangles.
    pub(super) n_triangles: u32,
}

/// All meshes and textures used so far, with host copies of their buffers.
pub(super) struct Assets {
    meshes: Vec<MeshRange>,
    textures: Vec<Texture>,
    vertices: Vec<VertexRecord>,
    /// Three vertex indices and the texture projection axis per triangle.
    triangles: Vec<[u32; 4]>,
    /// Three vertex indices per triangle, as the index buffer.
    indices: Vec<[u32; 3]>,
    texels: Vec<u32>,
    /// `true` if meshes were added since the last upload.
    meshes_dirty: bool,
    /// `true` if textures were added since the last upload.
    textures_dirty: bool,
    pub(super) vertex_buffer: GrowableBuffer,
    pub(super) triangle_buffer: GrowableBuffer,
    pub(super) index_buffer: GrowableBuffer,
    pub(super) texel_buffer: GrowableBuffer,
}

impl Assets {
    /// Creates empty buffers.
    pub(super) fn new(gpu: &Gpu) -> Self {
        let buffer = |label, usage| GrowableBuffer::new(gpu, label, usage);
        let none = wgpu::BufferUsages::empty();
        Self {
            meshes: Vec::new(),
            textures: Vec::new(),
            vertices: Vec::new(),
            triangles: Vec::new(),
            indices: Vec::new(),
            texels: Vec::new(),
            meshes_dirty: false,
            textures_dirty: false,
            vertex_buffer: buffer("vertices", none),
            triangle_buffer: buffer("triangles", none),
            index_buffer: buffer("indices", wgpu::BufferUsages::INDEX),
            texel_buffer: buffer("texels", none),
        }
    }

    /// Returns the location of an instance's mesh, adding the mesh if it is new.
    pub(super) fn mesh(&mut self, instance: &Instance) -> MeshRange {
        let key = instance.mesh.key();
        let known = self.meshes.iter().find(|range| range.key == key).copied();
        known.unwrap_or_else(|| self.add_mesh(key, instance.mesh()))
    }

    /// Returns the device index of a texture, adding the texture if it is new.
    pub(super) fn texture(&mut self, texture: Texture) -> u32 {
        let known = self.textures.iter().position(|other| *other == texture);
        known.unwrap_or_else(|| self.add_texture(texture)) as u32
    }

    /// Removes all meshes if they exceed a memory limit: bodies of random size have meshes of their own. Must
    /// only be called between batches, because it invalidates all mesh ranges.
    pub(super) fn evict_if_full(&mut self) {
        const MAX_VERTICES: usize = 1 << 21;
        if self.vertices.len() > MAX_VERTICES {
            self.meshes.clear();
            self.vertices.clear();
            self.triangles.clear();
            self.indices.clear();
        }
    }

    /// Uploads new meshes and textures. Returns `true` if a buffer was reallocated.
    pub(super) fn upload(&mut self, gpu: &Gpu) -> bool {
        let mut reallocated = false;
        if core::mem::take(&mut self.meshes_dirty) {
            reallocated |= self.vertex_buffer.write(gpu, &self.vertices);
            reallocated |= self.triangle_buffer.write(gpu, &self.triangles);
            reallocated |= self.index_buffer.write(gpu, &self.indices);
        }
        if core::mem::take(&mut self.textures_dirty) {
            reallocated |= self.texel_buffer.write(gpu, &self.texels);
        }
        reallocated
    }

    fn add_mesh(&mut self, key: MeshKey, mesh: &Mesh) -> MeshRange {
        assert!(mesh.triangles.len() <= MAX_TRIANGLES, "{key:?} has {} triangles", mesh.triangles.len());
        let (first_vertex, first_triangle) = (self.vertices.len() as u32, self.triangles.len() as u32);
        self.vertices.extend((0..mesh.n_vertices() as u32).map(|i| VertexRecord {
            position: padded(mesh.position(i)),
            normal: padded(mesh.normals[i as usize]),
        }));
        for (corners, facing) in mesh.triangles.iter().zip(&mesh.projection_axes) {
            let [a, b, c] = corners.map(|i| i + first_vertex);
            let axis = match facing {
                ProjectionAxis::X => 0,
                ProjectionAxis::Y => 1,
                ProjectionAxis::Z => 2,
            };
            self.triangles.push([a, b, c, axis]);
            self.indices.push([a, b, c]);
        }
        let n_triangles = mesh.triangles.len() as u32;
        let range = MeshRange { key, mesh_idx: self.meshes.len(), first_triangle, n_triangles };
        self.meshes.push(range);
        self.meshes_dirty = true;
        range
    }

    fn add_texture(&mut self, texture: Texture) -> usize {
        self.textures.push(texture);
        self.texels.extend_from_slice(&mip_chain(texture).texels);
        self.textures_dirty = true;
        self.textures.len() - 1
    }
}
