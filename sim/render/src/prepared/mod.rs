//! The render scene: mesh instances, lights and cameras of one episode, in the form that both renderers read.

mod attachment;
mod body;
pub(crate) mod camera;
mod instance;
pub(crate) mod material;
mod robot;
mod room;
pub(crate) mod transforms;

#[cfg(feature = "gpu")]
use std::sync::Arc;

use ipc_types::{ImageSize, ImageSizes};

use super::math::affine::{Vec3, normalised, scaled};
use super::math::lanes::N_LANES;
use attachment::Attachment;
use body::OwnMeshes;
use camera::PinholeCamera;
pub(crate) use instance::{Anchor, Fixture, Instance, MeshKey};
use scene::{Body, Lights, Scene, Snapshot};

/// A directional light.
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct Sun {
    /// Unit vector towards the light.
    pub(crate) towards: Vec3,
    /// Radiance, linear RGB.
    pub(crate) color: Vec3,
}

/// Maximum number of directional lights. Missing ones are black.
pub(crate) const N_SUNS: usize = 2;

/// The part of a [`Scene`] that stays constant within an episode, ready for rendering.
pub struct RenderScene {
    /// Static instances first, and among them the room first.
    pub(crate) instances: Vec<Instance>,
    /// Number of static instances.
    pub(crate) n_static: usize,
    /// Id of the first triangle of each instance: a multiple of 16, the cluster size.
    pub(crate) first_id: Vec<u32>,
    n_ids: usize,
    /// Ambient radiance, linear RGB.
    pub(crate) ambient: Vec3,
    pub(crate) suns: [Sun; N_SUNS],
    pub(crate) cameras: Vec<PinholeCamera>,
    /// World position of the centre of the shadow map, if the first directional light casts shadows.
    pub(crate) shadow_centre: Option<Vec3>,
    /// Data that a renderer derives from the scene.
    pub(crate) attachment: Attachment,
    /// Tells a GPU renderer whether the scene that it has uploaded still exists.
    #[cfg(feature = "gpu")]
    pub(crate) liveness: Arc<()>,
    n_triangles: usize,
    n_bodies: usize,
    n_arms: usize,
}

impl RenderScene {
    /// Prepares a scene for rendering images of these sizes, which may exceed those of observations.
    ///
    /// # Panics
    /// If it has more than two directional lights.
    #[must_use]
    pub fn new(scene: &Scene, sizes: ImageSizes) -> Self {
        let (mut instances, mut n_static) = (Vec::new(), 0);
        let mut own_meshes = OwnMeshes::default();
        room::push(scene, &mut instances);
        for moves in [false, true] {
            let moves_so = |body: &&Body| body.motion.can_move() == moves;
            for (body_idx, body) in scene.bodies.iter().enumerate().filter(|(_, body)| moves_so(body)) {
                body::push(body_idx, body, &mut own_meshes, &mut instances);
            }
            for arm in 0..scene.robots.len() {
                robot::push(arm, scene.robots.len(), moves, &mut instances);
            }
            if !moves {
                n_static = instances.len();
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
            cameras: scene.cameras.iter().map(|camera| PinholeCamera::new(camera, sizes)).collect(),
            attachment: Attachment::default(),
            #[cfg(feature = "gpu")]
            liveness: Arc::new(()),
            n_static,
            n_triangles: instances.iter().map(|instance| instance.mesh().triangles.len()).sum(),
            n_bodies: scene.bodies.len(),
            n_arms: scene.robots.len(),
            instances,
        }
    }

    /// Returns the number of cameras, which are in the order of the images of an observation.
    #[must_use]
    pub fn n_cameras(&self) -> usize {
        self.cameras.len()
    }

    /// Returns the size of the image of a camera.
    ///
    /// # Panics
    /// If there is no such camera.
    #[must_use]
    pub fn size(&self, camera_idx: usize) -> ImageSize {
        self.cameras[camera_idx].size
    }

    /// Returns the number of triangles in the scene, visible or not.
    #[must_use]
    pub fn n_triangles(&self) -> usize {
        self.n_triangles
    }

    /// Returns the number of bodies.
    #[cfg(feature = "gpu")]
    pub(crate) fn n_bodies(&self) -> usize {
        self.n_bodies
    }

    /// Returns the number of triangle ids, padding of partial clusters included.
    pub(crate) fn n_ids(&self) -> usize {
        self.n_ids
    }

    /// Returns `true` if the snapshot has as many bodies and arms as the scene.
    pub(crate) fn fits(&self, snapshot: &Snapshot) -> bool {
        snapshot.bodies.len() == self.n_bodies && snapshot.arms.len() == self.n_arms
    }
}

/// Returns the centre of the shadow map, above the middle of the workspace, if the scene has shadows.
fn shadow_centre(scene: &Scene) -> Option<Vec3> {
    let has_shadows = scene.lights.shadows && !scene.lights.directional.is_empty();
    has_shadows.then_some([-0.1, 0.0, room::table_top_z(scene.table.kind) + 0.35])
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
