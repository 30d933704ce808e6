//! The meshes that every scene shares: unit solids and the parts of a Panda.

use super::Mesh;
use super::generate::unit_solids;
use super::sdf::panda;

/// Identifier of a library mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum MeshId {
    /// The square |x|, |y| ≤ 1 at z = 0, facing +z.
    Quad,
    /// Box of half extents 1.
    Box,
    /// Cylinder about z of radius 1 and half height 1.
    Cylinder,
    /// The cylinder without its caps.
    OpenCylinder,
    /// The hemisphere z ≥ 0 of the unit sphere, without its flat face.
    Hemisphere,
    /// Sphere of radius 1.
    Sphere,
    /// Housing of Panda link 0 to 7, in the link frame.
    Link(usize),
    /// Dark panels of Panda link 3 to 7, in the link frame.
    LinkTrim(usize),
    /// Housing of the Panda hand, in the hand frame.
    Hand,
}

/// First link with dark panels; all links after it have some, too.
pub(crate) const FIRST_TRIMMED_LINK: usize = 3;

/// One mesh for each [`MeshId`].
pub(crate) struct MeshLibrary {
    solids: [Mesh; 6],
    links: [Mesh; 8],
    /// Panels of links 3 to 7.
    trims: [Mesh; 5],
    hand: Mesh,
}

impl MeshLibrary {
    /// Generates all meshes, which takes some tens of milliseconds.
    pub(crate) fn new() -> Self {
        Self {
            solids: unit_solids::all(),
            links: core::array::from_fn(panda::link),
            trims: core::array::from_fn(|i| panda::trim(i + FIRST_TRIMMED_LINK)),
            hand: panda::hand(),
        }
    }

    /// Returns the mesh `id`.
    ///
    /// # Panics
    /// If `id` is a link above 7, or a link without panels.
    pub(crate) fn get(&self, id: MeshId) -> &Mesh {
        match id {
            MeshId::Quad => &self.solids[0],
            MeshId::Box => &self.solids[1],
            MeshId::Cylinder => &self.solids[2],
            MeshId::OpenCylinder => &self.solids[3],
            MeshId::Hemisphere => &self.solids[4],
            MeshId::Sphere => &self.solids[5],
            MeshId::Link(link) => &self.links[link],
            MeshId::LinkTrim(link) => &self.trims[link - FIRST_TRIMMED_LINK],
            MeshId::Hand => &self.hand,
        }
    }
}
