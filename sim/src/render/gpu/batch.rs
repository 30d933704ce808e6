//! Host-side preparation of a chunk of views: device records and draw lists.

use rayon::prelude::*;

use super::assets::{Assets, MeshRange};
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
    /// Index of the view whose env each shadow map belongs to.
    map_views: Vec<usize>,
    /// Images, followed by shadow maps, before they are combined.
    prepared: Vec<PreparedView>,
}

/// Records of one view. Any thread may prepare it.
struct PreparedView {
    record: ViewRecord,
    instances: Vec<InstanceRecord>,
    meshes: Vec<MeshRange>,
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
            map_views: Vec::new(),
            prepared: Vec::new(),
        }
    }

    /// Replaces the contents of the batch by `views`. Views are prepared in parallel, on the current rayon
    /// pool, and combined in their order.
    pub(super) fn fill(&mut self, views: &[View<'_>], assets: &mut Assets) {
        self.clear();
        self.n_images = views.len() as u32;
        for (i, view) in views.iter().enumerate() {
            // The images of an env are consecutive and share a shadow map.
            if i == 0 || !view.is_same_env(&views[i - 1]) {
                assets.add_scene(view.scene);
                if view.scene.shadow_centre.is_some() {
                    self.map_views.push(i);
                }
            }
        }
        let n = views.len() + self.map_views.len();
        if self.prepared.len() < n {
            self.prepared.resize_with(n, PreparedView::new);
        }
        let (images, maps) = self.prepared[..n].split_at_mut(views.len());
        let assets = &*assets;
        images.par_iter_mut().zip(views).for_each(|(prepared, view)| prepared.image(view, assets));
        maps.par_iter_mut().zip(&self.map_views).for_each(|(prepared, i)| {
            prepared.shadow_map(&views[*i], assets);
        });
        for idx in 0..n {
            self.append(idx);
        }
        self.link_shadow_maps(views);
    }

    fn clear(&mut self) {
        self.views.clear();
        self.instances.clear();
        self.images.clear();
        self.shadow_maps.clear();
        self.map_views.clear();
        (self.n_pixels, self.n_shadow_pixels, self.max_side) = (0, 0, 0);
    }

    /// Appends a prepared view.
    fn append(&mut self, idx: usize) {
        let PreparedView { record, instances, meshes } = &self.prepared[idx];
        let (view, first_instance) = (idx as u32, self.instances.len() as u32);
        let n_pixels = record.side * record.side;
        let (first_pixel, layer, draw_list) = if view < self.n_images {
            self.max_side = self.max_side.max(record.side);
            self.n_pixels += n_pixels;
            (self.n_pixels - n_pixels, view, &mut self.images)
        } else {
            self.n_shadow_pixels += n_pixels;
            (self.n_shadow_pixels - n_pixels, view - self.n_images, &mut self.shadow_maps)
        };
        self.views.push(ViewRecord { first_pixel, layer, first_instance, ..*record });
        self.instances.extend(instances.iter().map(|instance| InstanceRecord { view, ..*instance }));
        for (instance, mesh) in (first_instance..).zip(meshes) {
            draw_list.add(*mesh, instance);
        }
        draw_list.end_view();
    }

    /// Points each image at the shadow map of its env.
    fn link_shadow_maps(&mut self, views: &[View<'_>]) {
        let mut maps = (self.n_images..).zip(&self.map_views).peekable();
        let mut current = NONE;
        for (i, view) in views.iter().enumerate() {
            if let Some((map, _)) = maps.next_if(|(_, first)| **first == i) {
                current = map;
            }
            let has_map = view.scene.shadow_centre.is_some();
            self.views[i].shadow_map = if has_map { current } else { NONE };
        }
    }
}

impl PreparedView {
    fn new() -> Self {
        Self { record: bytemuck::Zeroable::zeroed(), instances: Vec::new(), meshes: Vec::new() }
    }

    /// Replaces the contents by an image of the instances that its camera may see.
    fn image(&mut self, view: &View<'_>, assets: &Assets) {
        let camera = &view.scene.cameras[view.camera_idx];
        let view_from_world = camera.view_from_world(view.snapshot);
        self.begin(image_record(view, camera, &view_from_world));
        for instance in &view.scene.instances {
            let view_from_mesh = view_from_world.compose(&instance.world_from_mesh(view.snapshot));
            let mesh = instance.mesh();
            if camera.may_intersect_sphere(&view_from_mesh, mesh.centre, mesh.radius) {
                self.add(instance, &view_from_mesh, assets);
            }
        }
    }

    /// Replaces the contents by the shadow map of a view's env.
    fn shadow_map(&mut self, view: &View<'_>, assets: &Assets) {
        self.begin(ViewRecord {
            side: SHADOW_MAP_SIDE,
            half_px: SHADOW_MAP_SIDE as f32 / 2.0,
            shadow_map: NONE,
            ..bytemuck::Zeroable::zeroed()
        });
        let Some(centre) = view.scene.shadow_centre else { return };
        let map_from_world = map_from_world(view.scene.suns[0].towards, centre);
        for instance in view.scene.instances.iter().filter(|instance| instance.casts_shadow()) {
            let map_from_mesh = map_from_world.compose(&instance.world_from_mesh(view.snapshot));
            self.add(instance, &map_from_mesh, assets);
        }
    }

    fn begin(&mut self, record: ViewRecord) {
        self.record = record;
        self.instances.clear();
        self.meshes.clear();
    }

    fn add(&mut self, instance: &Instance, view_from_mesh: &Affine3, assets: &Assets) {
        let mesh = assets.mesh(instance);
        self.instances.push(instance_record(instance, view_from_mesh, mesh, self.instances.len(), assets));
        self.meshes.push(mesh);
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

/// Returns the record of an instance, but for the index of its view.
fn instance_record(
    instance: &Instance,
    view_from_mesh: &Affine3,
    mesh: MeshRange,
    idx_in_view: usize,
    assets: &Assets,
) -> InstanceRecord {
    assert!(idx_in_view < MAX_INSTANCES, "a view has at most {MAX_INSTANCES} instances");
    let material = &instance.material;
    let tile_m = material.texture.map_or(1.0, |texture| mip_chain(texture).tile_m);
    InstanceRecord {
        view_from_mesh: rows(view_from_mesh),
        color: material.color,
        specular: material.specular,
        tiles: instance.scale.map(|scale| scale * (1.0 / tile_m)),
        texture: material.texture.map_or(NONE, |texture| assets.texture(texture)),
        view: 0,
        first_triangle: mesh.first_triangle,
        n_triangles: mesh.n_triangles,
        first_id: (idx_in_view as u32) << TRIANGLE_BITS,
        metallic: material.metallic,
        padding: [0; 3],
    }
}
