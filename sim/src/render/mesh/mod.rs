//! Triangle meshes, all made here from formulas: no file is read. Everything drawn is one of these under an affine map.

mod field;
mod panda;
mod solid;
mod surface_nets;

use super::affine::{Vec3, add, cross, dot, scaled, sub};

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
    pub(super) facing: Vec<Facing>,
    /// Centre of a sphere that holds all vertices.
    pub(super) centre: Vec3,
    /// Radius of that sphere.
    pub(super) radius: f32,
}

/// The mesh axis along which a triangle's texture is projected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(clippy::upper_case_acronyms, reason = "axes")]
pub(super) enum Facing {
    X,
    Y,
    Z,
}

impl Facing {
    /// Texture coordinates of a point: v runs along y where it can, so that a table's boards do.
    pub(super) fn project(self, [x, y, z]: Vec3) -> [f32; 2] {
        match self {
            Self::X => [z, y],
            Self::Y => [x, z],
            Self::Z => [x, y],
        }
    }
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
        self.facing.push(if z >= x && z >= y {
            Facing::Z
        } else if x >= y {
            Facing::X
        } else {
            Facing::Y
        });
        self.triangles.push(corners);
    }

    /// Two triangles; corners in order around the quad.
    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        let length = |i, j| {
            let edge = sub(self.position(i), self.position(j));
            dot(edge, edge)
        };
        let halves = if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        for half in halves {
            self.triangle(half);
        }
    }

    /// The mesh with its bounding sphere.
    fn finished(mut self) -> Self {
        let vertices = || (0..self.n_vertices() as u32).map(|i| self.position(i));
        let least = vertices().fold([f32::MAX; 3], |m, p| core::array::from_fn(|i| m[i].min(p[i])));
        let greatest = vertices().fold([f32::MIN; 3], |m, p| core::array::from_fn(|i| m[i].max(p[i])));
        let centre = scaled(add(least, greatest), 0.5);
        let squared = vertices().map(|p| dot(sub(p, centre), sub(p, centre))).fold(0.0, f32::max);
        self.centre = centre;
        self.radius = squared.sqrt();
        self
    }
}

/// Every mesh there is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MeshId {
    /// The square |x|, |y| ≤ 1 at z 0, seen from above.
    Square,
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
            solids: solid::all(),
            links: core::array::from_fn(panda::link),
            hand: panda::hand(),
            wrist_camera: panda::wrist_camera(),
        }
    }

    /// The mesh `id`.
    ///
    /// # Panics
    /// If it is a link above 7.
    pub(super) fn get(&self, id: MeshId) -> &Mesh {
        match id {
            MeshId::Square => &self.solids[0],
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
