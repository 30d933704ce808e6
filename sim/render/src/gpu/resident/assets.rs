//! Meshes and textures on the device. They are uploaded on first use and stay resident. Meshes of scenes that
//! no longer exist are removed when there are many.

use std::collections::{HashMap, HashSet};

use gpu::{GpuDevice, GrowableBuffer};

use crate::gpu::chunk::records::{MAX_TRIANGLES, VertexRecord, padded};
use crate::mesh::{Mesh, ProjectionAxis};
use crate::prepared::{Instance, MeshKey, RenderScene};
use crate::texture::image;
use scene::Texture;

/// Number of vertices above which unused meshes are looked for: bodies of random size have meshes of their
/// own.
const MIN_EVICTION_VERTICES: usize = 1 << 21;

/// Location of a mesh in the device buffers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MeshRange {
    /// Index of its first triangle.
    pub(crate) first_triangle: u32,
    /// Number of triangles.
    pub(crate) n_triangles: u32,
}

/// A resident mesh.
struct ResidentMesh {
    range: MeshRange,
    first_vertex: u32,
    n_vertices: u32,
}

/// All meshes and textures used so far, with host copies of their buffers.
pub(crate) struct Assets {
    meshes: HashMap<MeshKey, ResidentMesh>,
    textures: HashMap<Texture, u32>,
    vertices: Vec<VertexRecord>,
    /// Three vertex indices and the texture projection axis per triangle.
    triangles: Vec<[u32; 4]>,
    texels: Vec<u32>,
    /// Lengths of `vertices`, `triangles` and `texels` at the last upload.
    n_uploaded: [usize; 3],
    /// Number of times that meshes have moved.
    generation: u64,
    /// Number of vertices above which there are many meshes, and the least such number.
    max_vertices: usize,
    pub(crate) min_eviction_vertices: usize,
    pub(crate) vertex_buffer: GrowableBuffer,
    pub(crate) triangle_buffer: GrowableBuffer,
    pub(crate) texel_buffer: GrowableBuffer,
}

impl Assets {
    /// Creates empty buffers.
    pub(crate) fn new(gpu: &GpuDevice) -> Self {
        let buffer = |label| GrowableBuffer::new(gpu, label, u64::MAX);
        Self {
            meshes: HashMap::new(),
            textures: HashMap::new(),
            vertices: Vec::new(),
            triangles: Vec::new(),
            texels: Vec::new(),
            n_uploaded: [0; 3],
            generation: 0,
            max_vertices: 0,
            min_eviction_vertices: MIN_EVICTION_VERTICES,
            vertex_buffer: buffer("vertices"),
            triangle_buffer: buffer("triangles"),
            texel_buffer: buffer("texels"),
        }
    }

    /// Adds the meshes and textures of a scene that are new.
    pub(crate) fn add_scene(&mut self, scene: &RenderScene) {
        for instance in &scene.instances {
            let key = instance.mesh.key();
            if !self.meshes.contains_key(&key) {
                let mesh = self.add_mesh(instance.mesh());
                self.meshes.insert(key, mesh);
            }
            if let Some(texture) = instance.material.texture
                && !self.textures.contains_key(&texture)
            {
                self.textures.insert(texture, self.textures.len() as u32);
                self.texels.extend_from_slice(&image(texture).texels);
            }
        }
    }

    /// Returns the number of vertices of all resident meshes.
    #[cfg(test)]
    pub(crate) fn n_vertices(&self) -> usize {
        self.vertices.len()
    }

    /// Returns the location of an instance's mesh.
    ///
    /// # Panics
    /// If its scene was not added.
    pub(crate) fn mesh(&self, instance: &Instance) -> MeshRange {
        self.meshes[&instance.mesh.key()].range
    }

    /// Returns the device index of a texture.
    ///
    /// # Panics
    /// If no scene with this texture was added.
    pub(crate) fn texture(&self, texture: Texture) -> u32 {
        self.textures[&texture]
    }

    /// Returns the number of times that meshes have moved, which invalidates their locations.
    pub(crate) fn generation(&self) -> u64 {
        self.generation
    }

    /// Returns `true` if there are so many meshes that unused ones should be removed.
    pub(crate) fn has_many_meshes(&self) -> bool {
        self.vertices.len() > self.max_vertices.max(self.min_eviction_vertices)
    }

    /// Removes all meshes that are not `used`. The next removal is due when the number of vertices has
    /// doubled, so that many scenes with meshes of their own do not cause one in every batch.
    pub(crate) fn retain(&mut self, used: &HashSet<MeshKey>) {
        let n_before = self.meshes.len();
        self.meshes.retain(|key, _| used.contains(key));
        if self.meshes.len() < n_before {
            self.compact();
        }
        self.max_vertices = 2 * self.vertices.len();
    }

    /// Removes all meshes if they take up half of the largest buffer that the device supports, so that the
    /// next chunk finds room.
    pub(crate) fn evict_if_full(&mut self, gpu: &GpuDevice) {
        let n_bytes = size_of_val(&self.vertices[..]).max(size_of_val(&self.triangles[..])) as u64;
        if n_bytes > gpu.max_buffer_bytes() / 2 {
            self.meshes.clear();
            self.compact();
        }
    }

    /// Uploads new meshes and textures. Returns `true` if a buffer was reallocated.
    pub(crate) fn upload(&mut self, gpu: &GpuDevice) -> bool {
        let mut reallocated = false;
        let [n_vertices, n_triangles, n_texels] = self.n_uploaded;
        if n_vertices < self.vertices.len() {
            reallocated |= self.vertex_buffer.append(gpu, &self.vertices, n_vertices);
            reallocated |= self.triangle_buffer.append(gpu, &self.triangles, n_triangles);
        }
        if n_texels < self.texels.len() {
            reallocated |= self.texel_buffer.append(gpu, &self.texels, n_texels);
        }
        self.n_uploaded = [self.vertices.len(), self.triangles.len(), self.texels.len()];
        reallocated
    }

    fn add_mesh(&mut self, mesh: &Mesh) -> ResidentMesh {
        assert!(mesh.triangles.len() <= MAX_TRIANGLES, "a mesh has {} triangles", mesh.triangles.len());
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
        }
        let n_triangles = mesh.triangles.len() as u32;
        ResidentMesh {
            range: MeshRange { first_triangle, n_triangles },
            first_vertex,
            n_vertices: mesh.n_vertices() as u32,
        }
    }

    /// Moves the remaining meshes to the start of the buffers. They are uploaded again.
    fn compact(&mut self) {
        let (vertices, triangles) =
            (core::mem::take(&mut self.vertices), core::mem::take(&mut self.triangles));
        for mesh in self.meshes.values_mut() {
            let MeshRange { first_triangle, n_triangles } = mesh.range;
            let (old_first, new_first) = (mesh.first_vertex, self.vertices.len() as u32);
            (mesh.range.first_triangle, mesh.first_vertex) = (self.triangles.len() as u32, new_first);
            self.vertices.extend_from_slice(&vertices[old_first as usize..][..mesh.n_vertices as usize]);
            for &[a, b, c, axis] in &triangles[first_triangle as usize..][..n_triangles as usize] {
                let corners = [a, b, c].map(|i| i - old_first + new_first);
                self.triangles.push([corners[0], corners[1], corners[2], axis]);
            }
        }
        [self.n_uploaded[0], self.n_uploaded[1]] = [0; 2];
        self.generation += 1;
    }
}
