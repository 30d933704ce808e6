//! What a renderer keeps of a scene for the length of an episode: instances of meshes, lights, cameras.

use std::sync::LazyLock;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};

use super::affine::{Affine, Vec3, normalised, scaled};
use super::camera::Camera;
use super::line::N_LANES;
use super::material::Material;
use super::mesh::{Mesh, MeshId, MeshLibrary};
use super::{robot, room};
use crate::scene::{Body, Lights, Primitive, Scene, Snapshot};

/// Meshes. They are constants that are too large to be written down: the same in every process, never changed, a
/// function of nothing. Hence a static, which spares every caller from handing them through.
static MESHES: LazyLock<MeshLibrary> = LazyLock::new(MeshLibrary::new);

/// What an instance moves with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    /// Nothing: it stands in the world.
    World(Fixture),
    /// A body, by index.
    Body(usize),
    /// A link of an arm, by their indices.
    Link { arm: usize, link: usize },
}

/// What the room is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fixture {
    Table,
    Floor,
    Walls,
}

/// A mesh somewhere, looking somehow.
pub(super) struct Instance {
    /// Mesh.
    pub(super) mesh: MeshId,
    /// What it moves with.
    pub(super) anchor: Anchor,
    /// Pose in the anchor's frame.
    pub(super) pose: Isometry3<f32>,
    /// Factors along the mesh's axes, all positive.
    pub(super) scale: Vec3,
    /// Look.
    pub(super) material: Material,
}

/// A light infinitely far away.
#[derive(Clone, Copy)]
pub(super) struct Sun {
    /// Unit vector towards the light.
    pub(super) towards: Vec3,
    /// Linear RGB.
    pub(super) color: Vec3,
}

/// Directional lights a scene may have; those it lacks are black.
pub(super) const N_SUNS: usize = 2;

/// Everything about a [`Scene`] that does not move within its episode.
pub struct RenderScene {
    pub(super) instances: Vec<Instance>,
    /// Id of each instance's first triangle: a multiple of 16, for triangles come in clusters of so many.
    pub(super) first_id: Vec<u32>,
    n_ids: usize,
    pub(super) ambient: Vec3,
    pub(super) suns: [Sun; N_SUNS],
    pub(super) cameras: Vec<Camera>,
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
        // Near things first: what they hide is then never written.
        let mut instances = Vec::new();
        for arm in 0..scene.robots.len() {
            robot::push(arm, robot::has_camera(scene, arm), &mut instances);
        }
        for (body_idx, body) in scene.bodies.iter().enumerate() {
            push_body(body_idx, body, &mut instances);
        }
        room::push(scene, &mut instances);
        let mut n_ids = 0;
        let first_id = instances.iter().map(|instance| {
            let first = n_ids;
            n_ids += instance.mesh().batches.batches.len() * N_LANES;
            first as u32
        });
        Self {
            first_id: first_id.collect(),
            n_ids,
            ambient: scene.lights.ambient.map(|c| c as f32),
            suns: suns(&scene.lights),
            cameras: scene.cameras.iter().map(Camera::new).collect(),
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
    pub(super) fn n_ids(&self) -> usize {
        self.n_ids
    }

    /// Whether the snapshot has as many bodies and arms as the scene.
    pub(super) fn fits(&self, snapshot: &Snapshot) -> bool {
        snapshot.bodies.len() == self.n_bodies && snapshot.arms.len() == self.n_arms
    }
}

impl Instance {
    /// Its mesh.
    pub(super) fn mesh(&self) -> &'static Mesh {
        MESHES.get(self.mesh)
    }

    /// From the mesh, in its own units, to the world.
    pub(super) fn world_from_mesh(&self, snapshot: &Snapshot) -> Affine {
        let local = Affine::placed(&self.pose, self.scale);
        match self.anchor {
            Anchor::World(_) => local,
            Anchor::Body(body) => Affine::rigid(&snapshot.bodies[body]).after(&local),
            Anchor::Link { arm, link } => Affine::rigid(&snapshot.arms[arm][link]).after(&local),
        }
    }
}

/// Instances of a body's parts, scaled to exactly their solids.
fn push_body(body_idx: usize, body: &Body, instances: &mut Vec<Instance>) {
    for part in &body.parts {
        let mut push = |mesh, inner: Isometry3<f64>, scale: [f64; 3]| {
            instances.push(Instance {
                mesh,
                anchor: Anchor::Body(body_idx),
                pose: (part.pose * inner).cast(),
                scale: scale.map(|s| s as f32),
                material: part.paint.into(),
            });
        };
        let centred = Isometry3::identity();
        match part.shape {
            Primitive::Box { half } => push(MeshId::Box, centred, half),
            Primitive::Cylinder { radius, half_height } => {
                push(MeshId::Cylinder, centred, [radius, radius, half_height]);
            }
            Primitive::Ball { radius } => push(MeshId::Ball, centred, [radius; 3]),
            Primitive::Capsule { radius, half_height } => {
                let upper = Isometry3::translation(0.0, 0.0, half_height);
                let half_turn = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
                push(MeshId::Tube, centred, [radius, radius, half_height]);
                push(MeshId::Dome, upper, [radius; 3]);
                push(MeshId::Dome, half_turn * upper, [radius; 3]);
            }
        }
    }
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
