//! Mesh instances: what is drawn where, and with which material.

use std::sync::{Arc, LazyLock};

use nalgebra::Isometry3;

use super::material::Material;
use crate::math::affine::{Affine3, Vec3};
use crate::mesh::{Mesh, MeshId, MeshLibrary};
use scene::Snapshot;

/// The mesh library. Its meshes are constants that are too large to write down, so a static holds them and no
/// caller has to pass them around.
static MESHES: LazyLock<MeshLibrary> = LazyLock::new(MeshLibrary::new);

/// The frame that an instance is attached to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Anchor {
    /// The world: the instance is static.
    World(Fixture),
    /// A body, by index.
    Body(usize),
    /// A link of an arm, by index.
    Link { arm: usize, link: usize },
}

/// Storage of the mesh of an instance.
pub(crate) enum MeshSource {
    /// A mesh of the library, shared by all scenes.
    Library(MeshId),
    /// A mesh generated for one scene and shared by its instances.
    Own(Arc<Mesh>),
}

/// Identity of a mesh. Meshes with the same contents have the same key, in every process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum MeshKey {
    /// A mesh of the library.
    Library(MeshId),
    /// A generated mesh, by its fingerprint.
    Own(u64),
}

impl MeshSource {
    /// Returns the identity of the mesh.
    pub(crate) fn key(&self) -> MeshKey {
        match self {
            Self::Library(id) => MeshKey::Library(*id),
            Self::Own(mesh) => MeshKey::Own(mesh.fingerprint),
        }
    }
}

/// The static parts of the room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fixture {
    Table,
    Floor,
    Walls,
}

/// A mesh with a pose, a scale and a material.
pub(crate) struct Instance {
    /// The mesh, shared with other instances.
    pub(crate) mesh: MeshSource,
    /// The frame that the instance is attached to.
    pub(crate) anchor: Anchor,
    /// Pose in the anchor frame.
    pub(crate) pose: Isometry3<f32>,
    /// Scale factors along the mesh axes, all positive.
    pub(crate) scale: Vec3,
    /// Surface material, in linear light.
    pub(crate) material: Material,
}

impl Instance {
    /// Returns `true` if the instance casts a shadow: everything except the floor does.
    pub(crate) fn casts_shadow(&self) -> bool {
        self.mesh.key() != MeshKey::Library(MeshId::Quad)
    }

    /// Returns the mesh of the instance.
    pub(crate) fn mesh(&self) -> &Mesh {
        match &self.mesh {
            MeshSource::Library(id) => MESHES.get(*id),
            MeshSource::Own(mesh) => mesh,
        }
    }

    /// Returns the transform from the mesh frame, in mesh units, to the world.
    #[inline(always)]
    pub(crate) fn world_from_mesh(&self, snapshot: &Snapshot) -> Affine3 {
        let local = Affine3::from_pose_and_scale(&self.pose, self.scale);
        match self.anchor {
            Anchor::World(_) => local,
            Anchor::Body(body) => Affine3::from_pose(&snapshot.bodies[body]).compose(&local),
            Anchor::Link { arm, link } => Affine3::from_pose(&snapshot.arms[arm][link]).compose(&local),
        }
    }
}
