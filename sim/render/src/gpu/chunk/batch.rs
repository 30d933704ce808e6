//! Host-side preparation of a chunk of views: one record per view, and the poses of their envs. The device
//! derives the rest from the resident scenes.

use ipc_types::ImageSize;

use super::records::{NONE, PoseRecord, SunRecord, ViewRecord, padded, rows};
use super::shadow::map_from_world;
use super::size::{ChunkSize, n_device_pixels, whole_tiles};
use crate::View;
use crate::gpu::resident::assets::Assets;
use crate::gpu::resident::scenes::{ResidentScenes, SceneRange, push_poses};
use crate::math::affine::Vec3;
use crate::shading::SHADOW_MAP_SIDE;

/// Records of a chunk of views. The allocations are reused from chunk to chunk.
#[derive(Default)]
pub(crate) struct ViewBatch {
    /// Views of the images, followed by those of the shadow maps.
    pub(crate) views: Vec<ViewRecord>,
    /// Poses of all envs.
    pub(crate) poses: Vec<PoseRecord>,
    /// Size of the chunk.
    pub(crate) size: ChunkSize,
    /// Number of views that are images.
    pub(crate) n_images: u32,
    /// Number of pixels of the largest image.
    pub(crate) max_pixels: u32,
    /// Shadow maps of the envs, in their order.
    maps: Vec<ViewRecord>,
    samples_per_axis: u32,
}

/// The env whose images are being added.
#[derive(Clone, Copy)]
struct CurrentEnv {
    scene: SceneRange,
    first_pose: u32,
    /// Index of its shadow map among all, if it has one.
    map: Option<u32>,
}

impl ViewBatch {
    /// Creates an empty batch of images with so many samples per pixel along each axis.
    pub(crate) fn new(samples_per_axis: u32) -> Self {
        Self { samples_per_axis, ..Self::default() }
    }

    /// Replaces the contents of the batch by the first views, as many as the limit permits but at least one.
    /// Returns their number.
    pub(crate) fn fill(
        &mut self,
        views: &[View<'_>],
        limit: ChunkSize,
        scenes: &mut ResidentScenes,
        assets: &mut Assets,
    ) -> usize {
        self.clear();
        let mut current = None;
        for (i, view) in views.iter().enumerate() {
            // The images of an env are consecutive and share poses and a shadow map.
            let env = current.filter(|_| view.is_same_env(&views[i - 1]));
            let scene = env.map_or_else(|| scenes.locate(view.scene, assets), |env: CurrentEnv| env.scene);
            let size = self.size.plus(size_of_view(view, scene, env.is_none()));
            if i > 0 && !size.fits(limit) {
                break;
            }
            let env = env.unwrap_or_else(|| self.begin_env(view, scene));
            self.push_image(view, env);
            self.size = size;
            current = Some(env);
        }
        self.append_shadow_maps();
        self.n_images as usize
    }

    fn clear(&mut self) {
        self.views.clear();
        self.poses.clear();
        self.maps.clear();
        self.size = ChunkSize::default();
        (self.n_images, self.max_pixels) = (0, 0);
    }

    /// Adds the poses of a view's env, and its shadow map if it has one.
    fn begin_env(&mut self, view: &View<'_>, scene: SceneRange) -> CurrentEnv {
        let first_pose = self.poses.len() as u32;
        push_poses(view.snapshot, &mut self.poses);
        let map = view.scene.shadow_centre.map(|centre| {
            let record = shadow_map_record(view.scene.suns[0].towards, centre);
            self.maps.push(ViewRecord { first_pose, ..in_scene(record, scene) });
            self.maps.len() as u32 - 1
        });
        CurrentEnv { scene, first_pose, map }
    }

    fn push_image(&mut self, view: &View<'_>, env: CurrentEnv) {
        let record = ViewRecord {
            first_pixel: self.size.pixels as u32,
            first_instance: self.views.last().map_or(0, end_of_instances),
            // Index among the shadow maps, until their place among all views is known.
            shadow_map: env.map.unwrap_or(NONE),
            first_pose: env.first_pose,
            ..in_scene(image_record(view, self.samples_per_axis), env.scene)
        };
        self.max_pixels = self.max_pixels.max(record.size[0] * record.size[1]);
        self.n_images += 1;
        self.views.push(record);
    }

    fn append_shadow_maps(&mut self) {
        let n_images = self.n_images;
        for view in self.views.iter_mut().filter(|view| view.shadow_map != NONE) {
            view.shadow_map += n_images;
        }
        for (map_idx, map) in (0..).zip(&self.maps) {
            let first_instance = self.views.last().map_or(0, end_of_instances);
            let first_pixel = map_idx * SHADOW_MAP_SIDE.pow(2);
            self.views.push(ViewRecord { first_pixel, first_instance, ..*map });
        }
    }
}

fn end_of_instances(view: &ViewRecord) -> u32 {
    view.first_instance + view.n_instances
}

/// Returns what a view takes up, together with the poses and the shadow map of its env if no
/// earlier view has them.
fn size_of_view(view: &View<'_>, scene: SceneRange, is_new_env: bool) -> ChunkSize {
    let (n_instances, n_blocks) = (u64::from(scene.n_instances), u64::from(scene.n_blocks));
    let n_maps = u64::from(is_new_env && view.scene.shadow_centre.is_some());
    ChunkSize {
        images: 1,
        pixels: n_device_pixels(view),
        shadow_maps: n_maps,
        instances: (1 + n_maps) * n_instances,
        image_blocks: n_blocks,
        map_blocks: n_maps * n_blocks,
        poses: if is_new_env { view.snapshot.n_poses() as u64 } else { 0 },
    }
}

fn in_scene(record: ViewRecord, scene: SceneRange) -> ViewRecord {
    ViewRecord { first_scene_instance: scene.first, n_instances: scene.n_instances, ..record }
}

fn image_record(view: &View<'_>, samples_per_axis: u32) -> ViewRecord {
    let (scene, camera) = (view.scene, &view.scene.cameras[view.camera_idx]);
    let view_from_world = camera.view_from_world(view.snapshot);
    let sun = |i: usize| SunRecord {
        towards: padded(view_from_world.transform_vector(scene.suns[i].towards)),
        color: padded(scene.suns[i].color),
    };
    let shadow_from_view = scene.shadow_centre.map_or([[0.0; 4]; 3], |centre| {
        rows(&map_from_world(scene.suns[0].towards, centre).compose(&view_from_world.rigid_inverse()))
    });
    let [near_m, far_m] = camera.clip_m;
    ViewRecord {
        focal_px: camera.focal_px,
        near_m,
        inverse_far: 1.0 / far_m,
        far_m,
        half_px: camera.half_px(),
        sphere_margins: camera.sphere_margins(),
        size: whole_tiles(camera.size),
        guard_px: guard_px(camera.size, samples_per_axis),
        view_from_world: rows(&view_from_world),
        ambient: padded(scene.ambient),
        suns: [sun(0), sun(1)],
        shadow_from_view,
        ..bytemuck::Zeroable::zeroed()
    }
}

/// Returns the width of the guard band. Edge functions fit in 32 bits if image and guard band together have
/// at most 2²³ samples.
fn guard_px(size: ImageSize, samples_per_axis: u32) -> f32 {
    const MAX_SIDE: f32 = 2896.0;
    let mean_px = (size.width + size.height) as f32 / 2.0;
    ((MAX_SIDE / samples_per_axis as f32 - mean_px) / 2.0).min(448.0)
}

fn shadow_map_record(towards: Vec3, centre: Vec3) -> ViewRecord {
    ViewRecord {
        size: [SHADOW_MAP_SIDE; 2],
        shadow_map: NONE,
        is_shadow_map: 1,
        view_from_world: rows(&map_from_world(towards, centre)),
        ..bytemuck::Zeroable::zeroed()
    }
}
