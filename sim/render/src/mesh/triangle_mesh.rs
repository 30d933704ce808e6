//! The mesh type, and how it is built triangle by triangle.

use super::packed::PackedMesh;
use crate::math::affine::{Vec3, add, cross, dot, scaled, sub};

/// An indexed triangle mesh, open or closed, with counter-clockwise winding seen from outside. Lengths are in
/// m, or in units of the instance scale for the unit solids.
#[derive(Default)]
pub(crate) struct Mesh {
    /// Vertex coordinates, one array of `n_vertices` per axis.
    pub(crate) positions: [Vec<f32>; 3],
    /// Unit normal of each vertex.
    pub(crate) normals: Vec<Vec3>,
    /// Vertex indices of each triangle.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Texture projection axis of each triangle: the axis closest to its normal.
    pub(crate) projection_axes: Vec<ProjectionAxis>,
    /// Centre of the bounding sphere.
    pub(crate) centre: Vec3,
    /// Radius of the bounding sphere.
    pub(crate) radius: f32,
    /// The same triangles in the layout that SIMD code loads.
    pub(crate) packed: PackedMesh,
    /// Hash of everything that affects an image: corners, normals and projection axes.
    pub(crate) fingerprint: u64,
}

/// The mesh axis along which a triangle's texture is projected. The remaining two coordinates are its texture
/// coordinates (u, v): (z, y), (x, z) or (x, y). Where possible v runs along y, so that the planks of a table
/// do too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ProjectionAxis {
    /// (u, v) = (z, y).
    X,
    /// (u, v) = (x, z).
    Y,
    /// (u, v) = (x, y).
    Z,
}

impl Mesh {
    /// Returns the position of vertex `i`.
    pub(crate) fn position(&self, i: u32) -> Vec3 {
        core::array::from_fn(|axis| self.positions[axis][i as usize])
    }

    /// Returns the number of vertices.
    pub(crate) fn n_vertices(&self) -> usize {
        self.normals.len()
    }

    /// Appends a vertex and returns its index.
    pub(crate) fn push(&mut self, position: Vec3, normal: Vec3) -> u32 {
        for (axis, x) in self.positions.iter_mut().zip(position) {
            axis.push(x);
        }
        self.normals.push(normal);
        self.normals.len() as u32 - 1
    }

    /// Appends a triangle unless it is degenerate.
    pub(crate) fn triangle(&mut self, corners: [u32; 3]) {
        let [a, b, c] = corners.map(|i| self.position(i));
        let normal = cross(sub(b, a), sub(c, a));
        if dot(normal, normal) == 0.0 {
            return;
        }
        let [x, y, z] = normal.map(f32::abs);
        self.projection_axes.push(if z >= x && z >= y {
            ProjectionAxis::Z
        } else if x >= y {
            ProjectionAxis::X
        } else {
            ProjectionAxis::Y
        });
        self.triangles.push(corners);
    }

    /// Appends a quad, split along its shorter diagonal. The corners are in order around it.
    pub(crate) fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        let length = |i, j| {
            let edge = sub(self.position(i), self.position(j));
            dot(edge, edge)
        };
        let triangles =
            if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        for triangle in triangles {
            self.triangle(triangle);
        }
    }
}

/// Returns centre and radius of a bounding sphere: the one centred in the bounding box.
pub(crate) fn bounding_sphere(points: impl Iterator<Item = Vec3> + Clone) -> (Vec3, f32) {
    let min = points.clone().fold([f32::MAX; 3], |m, p| core::array::from_fn(|i| m[i].min(p[i])));
    let max = points.clone().fold([f32::MIN; 3], |m, p| core::array::from_fn(|i| m[i].max(p[i])));
    let centre = scaled(add(min, max), 0.5);
    let squared = points.map(|p| dot(sub(p, centre), sub(p, centre))).fold(0.0, f32::max);
    (centre, squared.sqrt())
}
