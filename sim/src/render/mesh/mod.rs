//! Triangle meshes, all made here from formulas: no file is read. Everything drawn is one of these under an affine map.

#[cfg(test)]
mod checks;
mod clusters;
mod generate;
mod packed;
mod sdf;

use xxhash_rust::xxh3::Xxh3;

use super::math::affine::{Vec3, add, cross, dot, scaled, sub};
pub(super) use generate::{extrusion, lathe, rounded_box, torus};
pub(super) use packed::{ClusterBounds, ClusterCorners, PackedMesh, TriangleRecord, Vec3x16};

/// A closed or open surface of triangles, counter-clockwise seen from outside. Lengths in m, or in units of the
/// instance's scale for the solids of half extent 1.
#[derive(Default)]
pub(super) struct Mesh {
    /// Coordinates of the vertices, one array per axis.
    pub(super) positions: [Vec<f32>; 3],
    /// Unit normal per vertex.
    pub(super) normals: Vec<Vec3>,
    /// Three vertices per triangle.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Per triangle the axis its normal is nearest to: textures are projected along it.
    pub(super) projection_axes: Vec<ProjectionAxis>,
    /// Centre of a sphere that holds all vertices.
    pub(super) centre: Vec3,
    /// Radius of that sphere.
    pub(super) radius: f32,
    /// The triangles once more, as vector code reads them.
    pub(super) packed: PackedMesh,
    /// Hash of all that pictures are made of: corners, normals, the axes that textures are projected along.
    pub(super) fingerprint: u64,
}

/// The mesh axis along which a triangle's texture is projected. What is left of a point (x, y, z) are its texture
/// coordinates, v along y where it can, so that a table's boards run that way: (z, y), (x, z) or (x, y).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ProjectionAxis {
    X,
    Y,
    Z,
}

impl Mesh {
    /// Coordinates of vertex `i`.
    pub(super) fn position(&self, i: u32) -> Vec3 {
        core::array::from_fn(|axis| self.positions[axis][i as usize])
    }

    /// Number of vertices.
    pub(super) fn n_vertices(&self) -> usize {
        self.normals.len()
    }

    fn push(&mut self, position: Vec3, normal: Vec3) -> u32 {
        for (axis, x) in self.positions.iter_mut().zip(position) {
            axis.push(x);
        }
        self.normals.push(normal);
        self.normals.len() as u32 - 1
    }

    /// Adds the triangle unless two of its corners coincide.
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

    /// Two triangles; corners in order around the quad.
    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        let length = |i, j| {
            let edge = sub(self.position(i), self.position(j));
            dot(edge, edge)
        };
        let halves =
            if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        for half in halves {
            self.triangle(half);
        }
    }

    fn hashed(&self) -> u64 {
        let mut hash = Xxh3::new();
        hash.update(bytemuck::cast_slice(&self.packed.steps));
        hash.update(bytemuck::cast_slice(&self.packed.triangles));
        hash.digest()
    }

    /// Moves all vertices to where [`PackedMesh`] can hold them, by some 2⁻¹⁶ of the mesh's extent along each axis at most.
    /// Triangles of which nothing is left go.
    fn snap(&mut self) {
        let steps = packed::steps(self);
        for (axis, step) in self.positions.iter_mut().zip(steps) {
            axis.iter_mut().for_each(|x| *x = (*x / step).round_ties_even() * step);
        }
        let is_left = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|i| self.position(i));
            cross(sub(b, a), sub(c, a)) != [0.0; 3]
        };
        let left: Vec<bool> = self.triangles.iter().map(is_left).collect();
        let mut each = left.iter();
        self.triangles.retain(|_| each.next() == Some(&true));
        let mut each = left.iter();
        self.projection_axes.retain(|_| each.next() == Some(&true));
    }

    /// The mesh with its bounding sphere, its triangles in clusters.
    fn finished(mut self) -> Self {
        self.snap();
        let vertices = (0..self.n_vertices() as u32).map(|i| self.position(i));
        (self.centre, self.radius) = bounding_sphere(vertices);
        clusters::order(&mut self);
        self.packed = PackedMesh::new(&self);
        self.fingerprint = self.hashed();
        self
    }
}

/// Centre and radius of a sphere that holds all points: the one about the middle of their box.
fn bounding_sphere(points: impl Iterator<Item = Vec3> + Clone) -> (Vec3, f32) {
    let least = points.clone().fold([f32::MAX; 3], |m, p| core::array::from_fn(|i| m[i].min(p[i])));
    let greatest = points.clone().fold([f32::MIN; 3], |m, p| core::array::from_fn(|i| m[i].max(p[i])));
    let centre = scaled(add(least, greatest), 0.5);
    let squared = points.map(|p| dot(sub(p, centre), sub(p, centre))).fold(0.0, f32::max);
    (centre, squared.sqrt())
}

/// Every mesh there is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum MeshId {
    /// The square |x|, |y| ≤ 1 at z 0, seen from above.
    Quad,
    /// The box of half extents 1.
    Box,
    /// The cylinder about z of radius 1 and half height 1.
    Cylinder,
    /// The same without its end faces.
    Tube,
    /// The half of the unit ball with z ≥ 0, without its flat face.
    Dome,
    /// The ball of radius 1.
    Ball,
    /// Housing of a Panda's link 0 to 7, in the link's frame.
    Link(usize),
    /// Housing of the hand.
    Hand,
    /// Body of the wrist camera, in the hand's frame.
    WristCamera,
}

/// One mesh per [`MeshId`].
pub(super) struct MeshLibrary {
    solids: [Mesh; 6],
    links: [Mesh; 8],
    hand: Mesh,
    wrist_camera: Mesh,
}

impl MeshLibrary {
    /// Builds them all, in some tens of milliseconds.
    pub(super) fn new() -> Self {
        Self {
            solids: generate::unit_solids::all(),
            links: core::array::from_fn(sdf::panda::link),
            hand: sdf::panda::hand(),
            wrist_camera: sdf::panda::wrist_camera(),
        }
    }

    /// The mesh `id`.
    ///
    /// # Panics
    /// If it is a link above 7.
    pub(super) fn get(&self, id: MeshId) -> &Mesh {
        match id {
            MeshId::Quad => &self.solids[0],
            MeshId::Box => &self.solids[1],
            MeshId::Cylinder => &self.solids[2],
            MeshId::Tube => &self.solids[3],
            MeshId::Dome => &self.solids[4],
            MeshId::Ball => &self.solids[5],
            MeshId::Link(link) => &self.links[link],
            MeshId::Hand => &self.hand,
            MeshId::WristCamera => &self.wrist_camera,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Mesh, MeshId, MeshLibrary, PackedMesh, ProjectionAxis, checks, dot, scaled, sub, torus};

    #[test]
    fn meshes_that_look_different_have_different_fingerprints() {
        let mut mesh = torus::mesh(0.05, 0.01);
        let first = mesh.fingerprint;
        assert_eq!(first, torus::mesh(0.05, 0.01).fingerprint);
        assert_ne!(first, torus::mesh(0.05, 0.011).fingerprint);
        mesh.normals[7] = scaled(mesh.normals[7], -1.0);
        let (second, facing) = (mesh.hashed_anew(), mesh.projection_axes[3]);
        assert_ne!(second, first);
        mesh.projection_axes[3] =
            if facing == ProjectionAxis::X { ProjectionAxis::Y } else { ProjectionAxis::X };
        assert_ne!(mesh.hashed_anew(), second);
    }

    impl Mesh {
        fn hashed_anew(&mut self) -> u64 {
            self.packed = PackedMesh::new(self);
            self.hashed()
        }
    }

    const CLOSED: [MeshId; 13] = [
        MeshId::Box,
        MeshId::Cylinder,
        MeshId::Ball,
        MeshId::Link(0),
        MeshId::Link(1),
        MeshId::Link(2),
        MeshId::Link(3),
        MeshId::Link(4),
        MeshId::Link(5),
        MeshId::Link(6),
        MeshId::Link(7),
        MeshId::Hand,
        MeshId::WristCamera,
    ];

    #[test]
    fn closed_meshes_have_no_holes() {
        let library = MeshLibrary::new();
        for id in CLOSED {
            checks::assert_closed(&id, library.get(id));
        }
    }

    #[test]
    fn triangles_face_the_way_their_normals_point() {
        let library = MeshLibrary::new();
        for id in CLOSED.into_iter().chain([MeshId::Quad, MeshId::Tube, MeshId::Dome]) {
            checks::assert_normals_follow_faces(&id, library.get(id));
        }
    }

    #[test]
    fn links_are_about_as_large_as_their_collision_hulls() {
        // Extents in m of the hulls of spec/env.md §3.
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
    fn the_bounding_sphere_holds_the_mesh() {
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
