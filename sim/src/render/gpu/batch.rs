//! Host-side preparation of a chunk of views: device records and draw lists.

use super::assets::Assets;
use super::draw_list::DrawList;
use super::records::{
    InstanceRecord, MAX_INSTANCES, NONE, SunRecord, TRIANGLE_BITS, ViewRecord, padded, rows,
};
use super::shadow::map_from_world;
use crate::render::View;
use crate::render::math::affine::Affine3;
use crate::render::scene::Instance;
use crate::render::scene::camera::PinholeCamera;
use crate::render::shading::SHADOW_MAP_SIDE;
use crate::render::texture::mip_chain;

/// Records and draw lists of a chunk of views. The allocations are reused from chunk to chunk.
pub(super) struct ViewBatch {
    /// Views of the images, followed by those of the shadow maps.
    pub(super) views: Vec<ViewRecord>,
    pub(super) instances: Vec<InstanceRecord>,
    /// Draw list of the images.
    pub(super) images: DrawList,
    /// Draw list of the shadow maps.
    pub(super) shadow_maps: DrawList,
    /// Number of views that are images.
    pub(super) n_images: u32,
    /// Total number of pixels of all images.
    pub(super) n_pixels: u32,
    /// Total number of texels of all shadow maps.
    pub(super) n_shadow_pixels: u32,
    /// Largest side of an image in px.
    pub(super) max_side: u32,
}

impl ViewBatch {
    /// Creates an empty batch.
    pub(super) fn new() -> Self {
        Self {
            views: Vec::new(),
            instances: Vec::new(),
            images: DrawList::default(),
            shadow_maps: DrawList::default(),
            n_images: 0,
            n_pixels: 0,
            n_shadow_pixels: 0,
            max_side: 0,
        }
    }

    /// Replaces the contents of the batch by `views`.
    pub(super) fn fill(&mut self, views: &[View<'_>], assets: &mut Assets) {
        self.views.clear();
        self.instances.clear();
        self.images.clear();
        self.shadow_maps.clear();
        (self.n_pixels, self.n_shadow_pixels, self.max_side) = (0, 0, 0);
        self.n_images = views.len() as u32;
        for view in views {
            self.add_image(view, assets);
        }
        // The images of an env are consecutive and share a shadow map.
        let mut map = NONE;
        for (i, view) in views.iter().enumerate() {
            let shares = i > 0 && view.is_same_env(&views[i - 1]);
            if !shares {
                map = self.add_map(view, assets);
            }
            self.views[i].shadow_map = map;
        }
    }

    fn add_image(&mut self, view: &View<'_>, assets: &mut Assets) {
        let camera = &view.scene.cameras[view.camera_idx];
        let view_from_world = camera.view_from_world(view.snapshot);
        let view_idx = self.views.len() as u32;
        let record = ViewRecord {
            first_pixel: self.n_pixels,
            layer: view_idx,
            first_instance: self.instances.len() as u32,
            ..image_record(view, camera, &view_from_world)
        };
        self.views.push(record);
        self.n_pixels += record.side * record.side;
        self.max_side = self.max_side.max(record.side);
        for instance in &view.scene.instances {
            let view_from_mesh = view_from_world.compose(&instance.world_from_mesh(view.snapshot));
            let mesh = instance.mesh();
            if camera.may_intersect_sphere(&view_from_mesh, mesh.centre, mesh.radius) {
                let first = record.first_instance;
                let record =
                    instance_record(instance, &view_from_mesh, view_idx, first, self.instances.len(), assets);
                self.images.add(assets.mesh(instance), self.instances.len() as u32);
                self.instances.push(record);
            }
        }
        self.images.end_view();
    }

    /// Adds the shadow map of a view's env. Returns its view index, or [`NONE`] if the scene has no shadows.
    fn add_map(&mut self, view: &View<'_>, assets: &mut Assets) -> u32 {
        let Some(centre) = view.scene.shadow_centre else { return NONE };
        let map_from_world = map_from_world(view.scene.suns[0].towards, centre);
        let view_idx = self.views.len() as u32;
        let first_instance = self.instances.len() as u32;
        self.views.push(ViewRecord {
            side: SHADOW_MAP_SIDE,
            first_pixel: self.n_shadow_pixels,
            layer: view_idx - self.n_images,
            half_px: SHADOW_MAP_SIDE as f32 / 2.0,
            first_instance,
            shadow_map: NONE,
            ..bytemuck::Zeroable::zeroed()
        });
        self.n_shadow_pixels += SHADOW_MAP_SIDE * SHADOW_MAP_SIDE;
        for instance in view.scene.instances.iter().filter(|instance| instance.casts_shadow()) {
            let map_from_mesh = map_from_world.compose(&instance.world_from_mesh(view.snapshot));
            let instance_idx = self.instances.len();
            let record =
                instance_record(instance, &map_from_mesh, view_idx, first_instance, instance_idx, assets);
            self.instances.push(record);
            self.shadow_maps.add(assets.mesh(instance), instance_idx as u32);
        }
        self.shadow_maps.end_view();
        view_idx
    }
}

fn image_record(view: &View<'_>, camera: &PinholeCamera, view_from_world: &Affine3) -> ViewRecord {
    let scene = view.scene;
    let sun = |i: usize| SunRecord {
        towards: padded(view_from_world.transform_vector(scene.suns[i].towards)),
        color: padded(scene.suns[i].color),
    };
    let shadow_from_view = scene.shadow_centre.map_or([[0.0; 4]; 3], |centre| {
        rows(&map_from_world(scene.suns[0].towards, centre).compose(&view_from_world.rigid_inverse()))
    });
    ViewRecord {
        focal_px: camera.focal_px,
        half_px: camera.side as f32 / 2.0,
        near_m: camera.clip_m[0],
        inverse_far: 1.0 / camera.clip_m[1],
        side: camera.side as u32,
        ambient: padded(scene.ambient),
        suns: [sun(0), sun(1)],
        shadow_from_view,
        ..bytemuck::Zeroable::zeroed()
    }
}

fn instance_record(
    instance: &Instance,
    view_from_mesh: &Affine3,
    view: u32,
    first_instance: u32,
    instance_idx: usize,
    assets: &mut Assets,
) -> InstanceRecord {
    let mesh = assets.mesh(instance);
    let idx_in_view = instance_idx as u32 - first_instance;
    assert!((idx_in_view as usize) < MAX_INSTANCES, "a view has at most {MAX_INSTANCES} instances");
    let material = &instance.material;
    let tile_m = material.texture.map_or(1.0, |texture| mip_chain(texture).tile_m);
    InstanceRecord {
        view_from_mesh: rows(view_from_mesh),
        color: material.color,
        specular: material.specular,
        tiles: instance.scale.map(|scale| scale * (1.0 / tile_m)),
        texture: material.texture.map_or(NONE, |texture| assets.texture(texture)),
        view,
        first_triangle: mesh.first_triangle,
        n_triangles: mesh.n_triangles,
        first_id: idx_in_view << TRIANGLE_BITS,
        metallic: material.metallic,
        padding: [0; 3],
    }
}
