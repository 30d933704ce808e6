//! Meshes and textures on the device: brought there when they are first seen and kept, until there are too many.

use super::device::Gpu;
use super::records::{MAX_TRIANGLES, VertexRecord, padded};
use super::store::Store;
use crate::render::mesh::{Mesh, ProjectionAxis};
use crate::render::scene::{Instance, MeshKey};
use crate::render::texture::mip_chain;
use crate::scene::Texture;

/// Where a mesh lies.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeshPlace {
    /// Which it is.
    pub(super) key: MeshKey,
    /// Its number, in the order in which meshes were first seen.
    pub(super) mesh_idx: usize,
    /// Index of its first triangle.
    pub(super) first_triangle: u32,
    /// Its triangles.
    pub(super) n_triangles: u32,
}

/// All that was seen so far.
pub(super) struct Assets {
    meshes: Vec<MeshPlace>,
    textures: Vec<Texture>,
    vertices: Vec<VertexRecord>,
    /// Three vertices each, then the axis it faces.
    triangles: Vec<[u32; 4]>,
    /// Three vertices each.
    indices: Vec<[u32; 3]>,
    texels: Vec<u32>,
    /// Something was seen since the last upload.
    new_meshes: bool,
    new_textures: bool,
    pub(super) vertex_store: Store,
    pub(super) triangle_store: Store,
    pub(super) index_store: Store,
    pub(super) texel_store: Store,
}

impl Assets {
    /// Nothing yet.
    pub(super) fn new(gpu: &Gpu) -> Self {
        let store = |label, usage| Store::new(gpu, label, usage);
        let none = wgpu::BufferUsages::empty();
        Self {
            meshes: Vec::new(),
            textures: Vec::new(),
            vertices: Vec::new(),
            triangles: Vec::new(),
            indices: Vec::new(),
            texels: Vec::new(),
            new_meshes: false,
            new_textures: false,
            vertex_store: store("vertices", none),
            triangle_store: store("triangles", none),
            index_store: store("indices", wgpu::BufferUsages::INDEX),
            texel_store: store("texels", none),
        }
    }

    /// The place of an instance's mesh.
    pub(super) fn mesh(&mut self, instance: &Instance) -> MeshPlace {
        let key = instance.mesh.key();
        let known = self.meshes.iter().find(|place| place.key == key).copied();
        known.unwrap_or_else(|| self.add_mesh(key, instance.mesh()))
    }

    /// The index of a texture.
    pub(super) fn texture(&mut self, texture: Texture) -> u32 {
        let known = self.textures.iter().position(|seen| *seen == texture);
        known.unwrap_or_else(|| self.add_texture(texture)) as u32
    }

    /// Forgets all meshes once they fill much memory: bodies of drawn sizes have meshes of their own. Only between batches,
    /// for places are no longer good afterwards.
    pub(super) fn trim(&mut self) {
        const MOST_VERTICES: usize = 1 << 21;
        if self.vertices.len() > MOST_VERTICES {
            self.meshes.clear();
            self.vertices.clear();
            self.triangles.clear();
            self.indices.clear();
        }
    }

    /// Brings what is new to the device; whether that took another buffer.
    pub(super) fn upload(&mut self, gpu: &Gpu) -> bool {
        let mut grown = false;
        if core::mem::take(&mut self.new_meshes) {
            grown |= self.vertex_store.write(gpu, &self.vertices);
            grown |= self.triangle_store.write(gpu, &self.triangles);
            grown |= self.index_store.write(gpu, &self.indices);
        }
        if core::mem::take(&mut self.new_textures) {
            grown |= self.texel_store.write(gpu, &self.texels);
        }
        grown
    }

    fn add_mesh(&mut self, key: MeshKey, mesh: &Mesh) -> MeshPlace {
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
        let place = MeshPlace { key, mesh_idx: self.meshes.len(), first_triangle, n_triangles };
        self.meshes.push(place);
        self.new_meshes = true;
        place
    }

    fn add_texture(&mut self, texture: Texture) -> usize {
        self.textures.push(texture);
        self.texels.extend_from_slice(&mip_chain(texture).texels);
        self.new_textures = true;
        self.textures.len() - 1
    }
}
