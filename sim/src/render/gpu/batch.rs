//! A chunk of views as the device will have it: records, and what is to be drawn.

use super::assets::Assets;
use super::drawing::Drawing;
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

/// Records of a chunk; the memory is kept from one to the next.
pub(super) struct Batch {
    /// The images', then the shadow maps'.
    pub(super) views: Vec<ViewRecord>,
    pub(super) instances: Vec<InstanceRecord>,
    /// Images to draw.
    pub(super) images: Drawing,
    /// Shadow maps to draw.
    pub(super) maps: Drawing,
    /// How many of the views are images.
    pub(super) n_images: u32,
    /// Pixels of all images, and of all maps.
    pub(super) n_pixels: u32,
    pub(super) n_map_pixels: u32,
    /// Greatest side of an image.
    pub(super) max_side: u32,
}

impl Batch {
    /// An empty one.
    pub(super) fn new() -> Self {
        Self {
            views: Vec::new(),
            instances: Vec::new(),
            images: Drawing::default(),
            maps: Drawing::default(),
            n_images: 0,
            n_pixels: 0,
            n_map_pixels: 0,
            max_side: 0,
        }
    }

    /// Makes this the batch of `views`.
    pub(super) fn fill(&mut self, views: &[View<'_>], assets: &mut Assets) {
        self.views.clear();
        self.instances.clear();
        self.images.clear();
        self.maps.clear();
        (self.n_pixels, self.n_map_pixels, self.max_side) = (0, 0, 0);
        self.n_images = views.len() as u32;
        for view in views {
            self.add_image(view, assets);
        }
        // The images of one env follow each other and share a map.
        let mut map = NONE;
        for (i, view) in views.iter().enumerate() {
            let shares = i > 0 && view.is_same_env(&views[i - 1]);
            if !shares {
                map = self.add_map(view, assets);
            }
            self.views[i].map = map;
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
                let posed = posed(instance, &view_from_mesh, view_idx, first, self.instances.len(), assets);
                self.images.add(assets.mesh(instance), self.instances.len() as u32);
                self.instances.push(posed);
            }
        }
        self.images.end_view();
    }

    /// The shadow map of a view's env: its index, or [`NONE`] if the scene has no shadows.
    fn add_map(&mut self, view: &View<'_>, assets: &mut Assets) -> u32 {
        let Some(centre) = view.scene.shadow_centre else { return NONE };
        let map_from_world = map_from_world(view.scene.suns[0].towards, centre);
        let view_idx = self.views.len() as u32;
        let first_instance = self.instances.len() as u32;
        self.views.push(ViewRecord {
            side: SHADOW_MAP_SIDE,
            first_pixel: self.n_map_pixels,
            layer: view_idx - self.n_images,
            half_px: SHADOW_MAP_SIDE as f32 / 2.0,
            first_instance,
            map: NONE,
            ..bytemuck::Zeroable::zeroed()
        });
        self.n_map_pixels += SHADOW_MAP_SIDE * SHADOW_MAP_SIDE;
        for instance in view.scene.instances.iter().filter(|instance| instance.casts_shadow()) {
            let map_from_mesh = map_from_world.compose(&instance.world_from_mesh(view.snapshot));
            let at = self.instances.len();
            self.instances.push(posed(instance, &map_from_mesh, view_idx, first_instance, at, assets));
            self.maps.add(assets.mesh(instance), at as u32);
        }
        self.maps.end_view();
        view_idx
    }
}

fn image_record(view: &View<'_>, camera: &PinholeCamera, view_from_world: &Affine3) -> ViewRecord {
    let scene = view.scene;
    let sun = |i: usize| SunRecord {
        towards: padded(view_from_world.transform_vector(scene.suns[i].towards)),
        color: padded(scene.suns[i].color),
    };
    let map_from_view = scene.shadow_centre.map_or([[0.0; 4]; 3], |centre| {
        rows(&map_from_world(scene.suns[0].towards, centre).compose(&view_from_world.rigid_inverse()))
    });
    ViewRecord {
        focal_px: camera.focal_px,
        half_px: camera.side as f32 / 2.0,
        near_m: camera.clip_m[0],
        inverse_far: 1.0 / camera.clip_m[1],
        side: camera.side as u32,
        ambient: padded(scene.ambient),
        up: padded(view_from_world.transform_vector([0.0, 0.0, 1.0])),
        suns: [sun(0), sun(1)],
        map_from_view,
        ..bytemuck::Zeroable::zeroed()
    }
}

fn posed(
    instance: &Instance,
    view_from_mesh: &Affine3,
    view: u32,
    first_instance: u32,
    at: usize,
    assets: &mut Assets,
) -> InstanceRecord {
    let mesh = assets.mesh(instance);
    let number = at as u32 - first_instance;
    assert!((number as usize) < MAX_INSTANCES, "a view shows at most {MAX_INSTANCES} instances");
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
        first_id: number << TRIANGLE_BITS,
    }
}
