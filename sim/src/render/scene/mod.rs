//! What a renderer keeps of a scene for the length of an episode: instances of meshes, lights, cameras.

mod body;
pub(in crate::render) mod camera;
pub(in crate::render) mod material;
mod robot;
mod room;
pub(in crate::render) mod transforms;

use std::sync::{Arc, LazyLock, Mutex};

use nalgebra::Isometry3;

use super::cpu::{Layer, StillHeights};
use super::math::affine::{Affine3, Vec3, normalised, scaled};
use super::math::lanes::N_LANES;
use super::mesh::{Mesh, MeshId, MeshLibrary};
use crate::scene::{Body, Lights, Scene, Snapshot};
use body::OwnMeshes;
use camera::PinholeCamera;
use material::Material;

/// Meshes. They are constants that are too large to be written down: the same in every process, never changed, a
/// function of nothing. Hence a static, which spares every caller from handing them through.
static MESHES: LazyLock<MeshLibrary> = LazyLock::new(MeshLibrary::new);

/// What an instance moves with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::render) enum Anchor {
    /// Nothing: it stands in the world.
    World(Fixture),
    /// A body, by index.
    Body(usize),
    /// A link of an arm, by their indices.
    Link { arm: usize, link: usize },
}

/// Where an instance's mesh is kept.
pub(in crate::render) enum MeshSource {
    /// With all others that every scene knows.
    Library(MeshId),
    /// With the instances of one scene that show it.
    Own(Arc<Mesh>),
}

/// What a mesh is known by: the same for all that are made of the same numbers, in every process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::render) enum MeshKey {
    /// One of the library.
    Library(MeshId),
    /// Any other, by its fingerprint.
    Own(u64),
}

impl MeshSource {
    /// What the mesh is known by.
    pub(in crate::render) fn key(&self) -> MeshKey {
        match self {
            Self::Library(id) => MeshKey::Library(*id),
            Self::Own(mesh) => MeshKey::Own(mesh.fingerprint),
        }
    }
}

/// What the room is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::render) enum Fixture {
    Table,
    Floor,
    Walls,
}

/// A mesh somewhere, looking somehow.
pub(in crate::render) struct Instance {
    /// Mesh.
    pub(in crate::render) mesh: MeshSource,
    /// What it moves with.
    pub(in crate::render) anchor: Anchor,
    /// Pose in the anchor's frame.
    pub(in crate::render) pose: Isometry3<f32>,
    /// Factors along the mesh's axes, all positive.
    pub(in crate::render) scale: Vec3,
    /// Look.
    pub(in crate::render) material: Material,
}

/// A light infinitely far away.
#[derive(Clone, Copy, PartialEq)]
pub(in crate::render) struct Sun {
    /// Unit vector towards the light.
    pub(in crate::render) towards: Vec3,
    /// Linear RGB.
    pub(in crate::render) color: Vec3,
}

/// Directional lights a scene may have; those it lacks are black.
pub(in crate::render) const N_SUNS: usize = 2;

/// Everything about a [`Scene`] that does not move within its episode.
pub struct RenderScene {
    /// First those that never move within an episode, of these the room first.
    pub(in crate::render) instances: Vec<Instance>,
    /// How many never move.
    pub(in crate::render) n_still: usize,
    /// Id of each instance's first triangle: a multiple of 16, for triangles come in clusters of so many.
    pub(in crate::render) first_id: Vec<u32>,
    n_ids: usize,
    pub(in crate::render) ambient: Vec3,
    pub(in crate::render) suns: [Sun; N_SUNS],
    pub(in crate::render) cameras: Vec<PinholeCamera>,
    /// Middle of the shadow map in the world, if the first sun casts shadows.
    pub(in crate::render) shadow_centre: Option<Vec3>,
    /// Per camera what the CPU renderer keeps from picture to picture: it saves work and changes no byte.
    pub(in crate::render) layers: Vec<Mutex<Option<Arc<Layer>>>>,
    /// The same for shadows.
    pub(in crate::render) still_heights: Mutex<Option<Arc<StillHeights>>>,
    n_triangles: usize,
    n_bodies: usize,
    n_arms: usize,
}

impl RenderScene {
    /// Prepares a scene.
    ///
    /// # Panics
    /// If it has more than two directional lights.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        Self::with_cameras(scene, scene.cameras.iter().map(PinholeCamera::new).collect())
    }

    /// Prepares a scene in which `n_tiles` × `n_tiles` cameras take the place of each camera. Each of them renders one
    /// tile of the image, in row-major order, at the camera's own resolution.
    pub(crate) fn with_tiled_cameras(scene: &Scene, n_tiles: usize) -> Self {
        let tiles = || (0..n_tiles * n_tiles).map(|tile| [tile % n_tiles, tile / n_tiles]);
        let cameras = scene.cameras.iter().map(PinholeCamera::new);
        let tiled = cameras.flat_map(|camera| tiles().map(move |tile| camera.tile(n_tiles, tile)));
        Self::with_cameras(scene, tiled.collect())
    }

    fn with_cameras(scene: &Scene, cameras: Vec<PinholeCamera>) -> Self {
        let (mut instances, mut n_still) = (Vec::new(), 0);
        let mut own_meshes = OwnMeshes::default();
        room::push(scene, &mut instances);
        for moves in [false, true] {
            let moves_so = |body: &&Body| body.motion.can_move() == moves;
            for (body_idx, body) in scene.bodies.iter().enumerate().filter(|(_, body)| moves_so(body)) {
                body::push(body_idx, body, &mut own_meshes, &mut instances);
            }
            for arm in 0..scene.robots.len() {
                robot::push(arm, moves, robot::has_camera(scene, arm), &mut instances);
            }
            if !moves {
                n_still = instances.len();
            }
        }
        let mut n_ids = 0;
        let first_id = instances.iter().map(|instance| {
            let first = n_ids;
            n_ids += instance.mesh().packed.corners.len() * N_LANES;
            first as u32
        });
        Self {
            first_id: first_id.collect(),
            n_ids,
            ambient: scene.lights.ambient.map(|c| c as f32),
            suns: suns(&scene.lights),
            shadow_centre: shadow_centre(scene),
            layers: cameras.iter().map(|_| Mutex::default()).collect(),
            cameras,
            still_heights: Mutex::default(),
            n_still,
            n_triangles: instances.iter().map(|instance| instance.mesh().triangles.len()).sum(),
            n_bodies: scene.bodies.len(),
            n_arms: scene.robots.len(),
            instances,
        }
    }

    /// Number of cameras, in the order of the observation's images.
    #[must_use]
    pub fn n_cameras(&self) -> usize {
        self.cameras.len()
    }

    /// Pixels along each edge of a camera's image.
    ///
    /// # Panics
    /// If there is no such camera.
    #[must_use]
    pub fn side(&self, camera_idx: usize) -> usize {
        self.cameras[camera_idx].side
    }

    /// Triangles in the scene, seen or not.
    #[must_use]
    pub fn n_triangles(&self) -> usize {
        self.n_triangles
    }

    /// Number of ids of triangles.
    pub(in crate::render) fn n_ids(&self) -> usize {
        self.n_ids
    }

    /// Whether the snapshot has as many bodies and arms as the scene.
    pub(in crate::render) fn fits(&self, snapshot: &Snapshot) -> bool {
        snapshot.bodies.len() == self.n_bodies && snapshot.arms.len() == self.n_arms
    }
}

impl Instance {
    /// Whether it throws a shadow: all but the floor do.
    pub(in crate::render) fn casts_shadow(&self) -> bool {
        self.mesh.key() != MeshKey::Library(MeshId::Quad)
    }

    /// Its mesh.
    pub(in crate::render) fn mesh(&self) -> &Mesh {
        match &self.mesh {
            MeshSource::Library(id) => MESHES.get(*id),
            MeshSource::Own(mesh) => mesh,
        }
    }

    /// From the mesh, in its own units, to the world.
    #[inline(always)]
    pub(in crate::render) fn world_from_mesh(&self, snapshot: &Snapshot) -> Affine3 {
        let local = Affine3::from_pose_and_scale(&self.pose, self.scale);
        match self.anchor {
            Anchor::World(_) => local,
            Anchor::Body(body) => Affine3::from_pose(&snapshot.bodies[body]).compose(&local),
            Anchor::Link { arm, link } => Affine3::from_pose(&snapshot.arms[arm][link]).compose(&local),
        }
    }
}

/// Above the middle of the work space, where shadows are wanted.
fn shadow_centre(scene: &Scene) -> Option<Vec3> {
    let wanted = scene.lights.shadows && !scene.lights.directional.is_empty();
    wanted.then_some([-0.1, 0.0, room::table_top_z(scene.table.kind) + 0.35])
}

fn suns(lights: &Lights) -> [Sun; N_SUNS] {
    assert!(lights.directional.len() <= N_SUNS, "a scene has at most {N_SUNS} directional lights");
    core::array::from_fn(|i| match lights.directional.get(i) {
        Some(light) => Sun {
            towards: normalised(scaled(light.direction.map(|c| c as f32), -1.0)),
            color: light.color.map(|c| c as f32),
        },
        None => Sun { towards: [0.0, 0.0, 1.0], color: [0.0; 3] },
    })
}
