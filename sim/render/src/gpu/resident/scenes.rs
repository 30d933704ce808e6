//! Scenes on the device: what stays constant within an episode is uploaded once per scene.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::{Arc, Weak};

use gpu::{GpuDevice, GrowableBuffer};

use super::assets::Assets;
use crate::RenderScene;
use crate::gpu::chunk::records::{MAX_INSTANCES, NONE, SceneInstanceRecord, rows};
use crate::math::affine::Affine3;
use crate::prepared::{Anchor, Instance, MeshKey};
use crate::texture::image;
use scene::{N_LINKS, Snapshot};

/// Number of triangles that one workgroup of the compute kernels takes at a time.
const TRIANGLES_PER_BLOCK: u32 = 64;

/// Location of a scene in the buffer of instances.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SceneRange {
    /// Index of its first instance.
    pub(crate) first: u32,
    /// Number of its instances.
    pub(crate) n_instances: u32,
    /// Number of blocks of all its triangles.
    pub(crate) n_blocks: u32,
}

/// A resident scene.
struct ResidentScene {
    /// Tells whether the scene still exists. It also keeps the address from being used again.
    liveness: Weak<()>,
    range: SceneRange,
    /// Number of instances for which there is room: a power of two.
    capacity: u32,
    /// [`Assets::generation`] when the records were written.
    generation: u64,
    meshes: Vec<MeshKey>,
}

/// All scenes rendered so far that still exist, with a host copy of their records.
pub(crate) struct ResidentScenes {
    /// By the address of [`RenderScene::liveness`].
    scenes: HashMap<usize, ResidentScene>,
    /// Starts of unused ranges, by capacity.
    free: BTreeMap<u32, Vec<u32>>,
    records: Vec<SceneInstanceRecord>,
    /// Ranges of records written since the last upload.
    changed: Vec<SceneRange>,
    pub(crate) buffer: GrowableBuffer,
}

impl ResidentScenes {
    /// Creates an empty buffer.
    pub(crate) fn new(gpu: &GpuDevice) -> Self {
        Self {
            scenes: HashMap::new(),
            free: BTreeMap::new(),
            records: Vec::new(),
            changed: Vec::new(),
            buffer: GrowableBuffer::new(gpu, "scene instances", u64::MAX),
        }
    }

    /// Returns the location of a scene. It is added, with its meshes and textures, unless it is resident and
    /// its meshes have not moved.
    ///
    /// # Panics
    /// If it has more than [`MAX_INSTANCES`] instances.
    pub(crate) fn locate(&mut self, scene: &RenderScene, assets: &mut Assets) -> SceneRange {
        let key = Arc::as_ptr(&scene.liveness).addr();
        if let Some(resident) = self.scenes.get(&key)
            && resident.generation == assets.generation()
        {
            return resident.range;
        }
        assets.add_scene(scene);
        let resident = match self.scenes.remove(&key) {
            Some(stale) => ResidentScene { generation: assets.generation(), ..stale },
            None => self.allocate(scene, assets),
        };
        let range = resident.range;
        self.scenes.insert(key, resident);
        let records = &mut self.records[range.first as usize..][..range.n_instances as usize];
        for (record, instance) in records.iter_mut().zip(&scene.instances) {
            *record = scene_instance(scene, instance, assets);
        }
        self.changed.push(range);
        range
    }

    /// Uploads the scenes that are new or have changed. Returns `true` if the buffer was reallocated.
    pub(crate) fn upload(&mut self, gpu: &GpuDevice) -> bool {
        let reallocated = self.buffer.reserve(gpu, size_of_val(&self.records[..]) as u64);
        if reallocated {
            self.buffer.write_at(gpu, &self.records, 0);
        } else {
            for SceneRange { first, n_instances, .. } in &self.changed {
                let records = &self.records[*first as usize..][..*n_instances as usize];
                self.buffer.write_at(gpu, records, *first as usize);
            }
        }
        self.changed.clear();
        reallocated
    }

    /// Removes the scenes that no longer exist.
    pub(crate) fn remove_dropped(&mut self) {
        let free = &mut self.free;
        self.scenes.retain(|_, scene| {
            let exists = scene.liveness.strong_count() > 0;
            if !exists {
                free.entry(scene.capacity).or_default().push(scene.range.first);
            }
            exists
        });
    }

    /// Returns the meshes of all resident scenes.
    pub(crate) fn meshes(&self) -> HashSet<MeshKey> {
        self.scenes.values().flat_map(|scene| scene.meshes.iter().copied()).collect()
    }

    /// Returns a range for a scene: one that was in use before, if possible.
    fn allocate(&mut self, scene: &RenderScene, assets: &Assets) -> ResidentScene {
        let n = scene.instances.len();
        assert!(n <= MAX_INSTANCES, "a scene has {n} instances, at most {MAX_INSTANCES} are supported");
        let capacity = (n as u32).next_power_of_two();
        if self.free.get(&capacity).is_none_or(Vec::is_empty) {
            self.remove_dropped();
        }
        let reused = self.free.get_mut(&capacity).and_then(Vec::pop);
        let first = reused.unwrap_or_else(|| {
            let end = self.records.len();
            self.records.resize(end + capacity as usize, bytemuck::Zeroable::zeroed());
            end as u32
        });
        let n_triangles = scene.instances.iter().map(|instance| assets.mesh(instance).n_triangles);
        let n_blocks = n_triangles.map(|n| n.div_ceil(TRIANGLES_PER_BLOCK)).sum();
        ResidentScene {
            liveness: Arc::downgrade(&scene.liveness),
            range: SceneRange { first, n_instances: n as u32, n_blocks },
            capacity,
            generation: assets.generation(),
            meshes: scene.instances.iter().map(|instance| instance.mesh.key()).collect(),
        }
    }
}

/// Appends the poses of an env: those of the bodies, then those of the links of each arm.
pub(crate) fn push_poses(snapshot: &Snapshot, poses: &mut Vec<[[f32; 4]; 3]>) {
    let all = snapshot.bodies.iter().chain(snapshot.arms.as_flattened());
    poses.extend(all.map(|pose| rows(&Affine3::from_pose(pose))));
}

/// Returns the index of an anchor's pose among those of its env.
fn pose_idx(scene: &RenderScene, anchor: Anchor) -> u32 {
    match anchor {
        Anchor::World(_) => NONE,
        Anchor::Body(body) => body as u32,
        Anchor::Link { arm, link } => (scene.n_bodies() + arm * N_LINKS + link) as u32,
    }
}

fn scene_instance(scene: &RenderScene, instance: &Instance, assets: &Assets) -> SceneInstanceRecord {
    let (material, location) = (&instance.material, assets.mesh(instance));
    let tile_m = material.texture.map_or(1.0, |texture| image(texture).tile_m);
    SceneInstanceRecord {
        anchor_from_mesh: rows(&Affine3::from_pose_and_scale(&instance.pose, instance.scale)),
        color: material.color,
        specular: material.specular,
        tiles: instance.scale.map(|scale| scale * (1.0 / tile_m)),
        texture: material.texture.map_or(NONE, |texture| assets.texture(texture)),
        centre: instance.mesh().centre,
        radius: instance.mesh().radius,
        pose: pose_idx(scene, instance.anchor),
        first_triangle: location.first_triangle,
        n_triangles: location.n_triangles,
        metallic: material.metallic,
        casts_shadow: u32::from(instance.casts_shadow()),
        padding: [0; 3],
    }
}
