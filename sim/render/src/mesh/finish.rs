//! The completion of a mesh: rounding to its grid, clusters, and derived fields.

use xxhash_rust::xxh3::Xxh3;

use super::clusters::sort_triangles;
use super::packing::{grid_step, pack};
use super::triangle_mesh::{Mesh, bounding_sphere};
use crate::math::affine::{cross, sub};

impl Mesh {
    pub(crate) fn content_hash(&self) -> u64 {
        let mut hash = Xxh3::new();
        hash.update(bytemuck::cast_slice(&self.packed.grid_step));
        hash.update(bytemuck::cast_slice(&self.packed.triangles));
        hash.digest()
    }

    /// Rounds all vertices to the grid of [`super::PackedMesh`], by at most about 2⁻¹⁶ of the extent along
    /// each axis, and removes triangles that degenerate.
    fn quantise(&mut self) {
        let grid_step = grid_step(self);
        for (axis, step) in self.positions.iter_mut().zip(grid_step) {
            axis.iter_mut().for_each(|x| *x = (*x / step).round_ties_even() * step);
        }
        let survives = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|i| self.position(i));
            cross(sub(b, a), sub(c, a)) != [0.0; 3]
        };
        let keep: Vec<bool> = self.triangles.iter().map(survives).collect();
        let mut flags = keep.iter();
        self.triangles.retain(|_| flags.next() == Some(&true));
        let mut flags = keep.iter();
        self.projection_axes.retain(|_| flags.next() == Some(&true));
    }

    /// Completes the mesh once all triangles are in place: quantises it, sorts its triangles into clusters
    /// and computes the derived fields.
    pub(crate) fn finish(mut self) -> Self {
        self.quantise();
        let vertices = (0..self.n_vertices() as u32).map(|i| self.position(i));
        (self.centre, self.radius) = bounding_sphere(vertices);
        sort_triangles(&mut self);
        self.packed = pack(&self);
        self.fingerprint = self.content_hash();
        self
    }
}
