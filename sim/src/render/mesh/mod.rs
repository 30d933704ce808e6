//! Triangle meshes, all generated from formulas. Every rendered instance is one of them under an affine
//! transform.
//!
//! `generate` covers solids with a closed-form boundary and `sdf` the Panda's housings. No mesh is read from
//! a file.

#[cfg(test)]
mod checks;
mod clusters;
mod generate;
mod library;
mod packed;
mod sdf;

use xxhash_rust::xxh3::Xxh3;

use super::math::affine::{Vec3, add, cross, dot, scaled, sub};
pub(crate) use generate::{extrusion, lathe, rounded_box, torus};
pub(crate) use library::{FIRST_TRIMMED_LINK, MeshId, MeshLibrary};
pub(crate) use packed::{ClusterBounds, ClusterCorners, PackedMesh, TriangleRecord, Vec3x16};

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
    fn push(&mut self, position: Vec3, normal: Vec3) -> u32 {
        for (axis, x) in self.positions.iter_mut().zip(position) {
            axis.push(x);
        }
        self.normals.push(normal);
        self.normals.len() as u32 - 1
    }

    /// Appends a triangle unless it is degenerate.
    fn triangle(&mut self, corners: [u32; 3]) {
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
    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
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

    fn content_hash(&self) -> u64 {
        let mut hash = Xxh3::new();
        hash.update(bytemuck::cast_slice(&self.packed.grid_step));
        hash.update(bytemuck::cast_slice(&self.packed.triangles));
        hash.digest()
    }

    /// Rounds all vertices to the grid of [`PackedMesh`], by at most about 2⁻¹⁶ of the extent along each
    /// axis, and removes triangles that degenerate.
    fn quantise(&mut self) {
        let grid_step = packed::grid_step(self);
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
    fn finish(mut self) -> Self {
        self.quantise();
        let vertices = (0..self.n_vertices() as u32).map(|i| self.position(i));
        (self.centre, self.radius) = bounding_sphere(vertices);
        clusters::sort_triangles(&mut self);
        self.packed = PackedMesh::new(&self);
        self.fingerprint = self.content_hash();
        self
    }
}

/// Returns centre and radius of a bounding sphere: the one centred in the bounding box.
fn bounding_sphere(points: impl Iterator<Item = Vec3> + Clone) -> (Vec3, f32) {
    let min = points.clone().fold([f32::MAX; 3], |m, p| core::array::from_fn(|i| m[i].min(p[i])));
    let max = points.clone().fold([f32::MIN; 3], |m, p| core::array::from_fn(|i| m[i].max(p[i])));
    let centre = scaled(add(min, max), 0.5);
    let squared = points.map(|p| dot(sub(p, centre), sub(p, centre))).fold(0.0, f32::max);
    (centre, squared.sqrt())
}

#[cfg(test)]
mod tests {
    use super::{Mesh, MeshId, MeshLibrary, PackedMesh, ProjectionAxis, checks, dot, scaled, sub, torus};

    #[test]
    fn fingerprint_depends_on_everything_visible() {
        let mut mesh = torus::mesh(0.05, 0.01);
        let first = mesh.fingerprint;
        assert_eq!(first, torus::mesh(0.05, 0.01).fingerprint);
        assert_ne!(first, torus::mesh(0.05, 0.011).fingerprint);
        mesh.normals[7] = scaled(mesh.normals[7], -1.0);
        let (second, facing) = (mesh.rehash(), mesh.projection_axes[3]);
        assert_ne!(second, first);
        mesh.projection_axes[3] =
            if facing == ProjectionAxis::X { ProjectionAxis::Y } else { ProjectionAxis::X };
        assert_ne!(mesh.rehash(), second);
    }

    impl Mesh {
        fn rehash(&mut self) -> u64 {
            self.packed = PackedMesh::new(self);
            self.content_hash()
        }
    }

    const CLOSED: [MeshId; 12] = [
        MeshId::Box,
        MeshId::Cylinder,
        MeshId::Sphere,
        MeshId::Link(0),
        MeshId::Link(1),
        MeshId::Link(2),
        MeshId::Link(3),
        MeshId::Link(4),
        MeshId::Link(5),
        MeshId::Link(6),
        MeshId::Link(7),
        MeshId::Hand,
    ];

    #[test]
    fn closed_meshes_have_no_holes() {
        let library = MeshLibrary::new();
        for id in CLOSED {
            checks::assert_closed(&id, library.get(id));
        }
    }

    #[test]
    fn winding_agrees_with_normals() {
        let library = MeshLibrary::new();
        for id in CLOSED.into_iter().chain([MeshId::Quad, MeshId::OpenCylinder, MeshId::Hemisphere]) {
            checks::assert_normals_follow_faces(&id, library.get(id));
        }
    }

    #[test]
    fn links_match_extents_of_collision_hulls() {
        // Extents of the collision hulls of links 0 to 7, in m (docs/benchmark.md, "Robot and control").
        let hulls = [
            [0.226, 0.189, 0.140],
            [0.110, 0.185, 0.247],
            [0.110, 0.249, 0.185],
            [0.192, 0.166, 0.176],
            [0.193, 0.179, 0.166],
            [0.110, 0.185, 0.317],
            [0.180, 0.133, 0.100],
            [0.125, 0.125, 0.055],
        ];
        let library = MeshLibrary::new();
        for (link, hull) in hulls.into_iter().enumerate() {
            for (size, extent) in checks::extents_m(library.get(MeshId::Link(link))).into_iter().zip(hull) {
                assert!((size - extent).abs() < 0.016, "link {link}: {size} for {extent}");
            }
        }
    }

    #[test]
    fn bounding_sphere_contains_mesh() {
        let library = MeshLibrary::new();
        for id in CLOSED {
            let mesh = library.get(id);
            for i in 0..mesh.n_vertices() as u32 {
                let off = sub(mesh.position(i), mesh.centre);
                assert!(dot(off, off).sqrt() <= mesh.radius * 1.000_01, "{id:?}");
            }
        }
    }
}
