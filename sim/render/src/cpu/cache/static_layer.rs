//! Static layers: the static geometry as a static camera sees it, rendered once. Later images start from the
//! layer, and only the pixel tiles that differ from it are shaded.

use crate::Samples;
use crate::cpu::shading::rays::{RayTable, ViewRays};
use crate::cpu::shading::surface::MIXED;
use crate::cpu::shadow::{LightBounds, LightBoundsBuilder, MaxHeightPyramid, Shadow};
use crate::cpu::simd::each::each;
use crate::cpu::simd::isa::Kernel;
use crate::cpu::simd::{F32x16, I32x16, Simd, SimdF32, SimdI32, SimdMask};
use crate::cpu::visibility::raster::{NO_ID, Visibility};
use crate::math::affine::{Affine3, Vec3};
use crate::prepared::camera::PinholeCamera;
use crate::prepared::material::Material;
use crate::prepared::{Instance, MeshKey, N_SUNS, Sun};
use crate::renderer::View;

/// The rendered static geometry of one static camera. Using it changes no byte of an image, because static
/// instances come first in every scene.
pub(crate) struct StaticLayer {
    /// Per static instance the transform from its mesh to the view frame.
    pub(crate) view_from_mesh: Vec<Affine3>,
    /// Number of samples per pixel with which the layer was rendered.
    pub(crate) samples: Samples,
    /// 1/z per visibility tile.
    pub(crate) depths: Vec<F32x16>,
    /// Triangle ids per visibility tile.
    pub(crate) ids: Vec<I32x16>,
    /// Per visibility tile the id that all of its lanes show, or [`MIXED`]. It is read in place of the much
    /// larger `ids` where possible.
    pub(crate) tile_ids: Vec<i32>,
    /// The shaded image, `[height, width, 3] u8` sRGB.
    pub(crate) pixels: Vec<u8>,
    /// Per pixel tile its bounds in the shadow map; empty if no light casts shadows.
    pub(crate) light_bounds: Vec<LightBounds>,
}

/// Everything that a layer depends on. Keys are compared as floats: the sign of a zero does not affect a
/// layer.
#[derive(PartialEq)]
pub(crate) struct StaticLayerKey {
    camera: PinholeCamera,
    /// Mesh, world-from-mesh transform (including scale), scale and material of each static instance.
    instances: Vec<(MeshKey, Affine3, Vec3, Material)>,
    ambient: Vec3,
    suns: [Sun; N_SUNS],
    shadow_centre: Option<Vec3>,
    samples: Samples,
}

impl StaticLayerKey {
    /// Returns the key of the layer of a view.
    pub(crate) fn of(view: &View<'_>, samples: Samples) -> Self {
        let View { scene, snapshot, camera_idx, .. } = view;
        let instances = scene.instances[..scene.n_static].iter();
        let instance_key =
            |it: &Instance| (it.mesh.key(), it.world_from_mesh(snapshot), it.scale, it.material);
        Self {
            camera: scene.cameras[*camera_idx].clone(),
            instances: instances.map(instance_key).collect(),
            ambient: scene.ambient,
            suns: scene.suns,
            shadow_centre: scene.shadow_centre,
            samples,
        }
    }
}

impl StaticLayer {
    /// Returns `true` if the layer was rendered for these transforms and this number of samples.
    pub(crate) fn matches(&self, view_from_mesh: &[Affine3], samples: Samples) -> bool {
        self.view_from_mesh == view_from_mesh && self.samples == samples
    }

    /// Replaces the background lanes of a visibility tile with the layer's ids.
    #[inline(always)]
    fn composite_under<S: Simd>(&self, ids: &mut I32x16, tile: usize) {
        let front = S::I::load(ids);
        let covered = front.gt(S::I::splat(NO_ID));
        if covered.to_bits() != u16::MAX {
            let behind = match self.tile_ids[tile] {
                MIXED => S::I::load(&self.ids[tile]),
                id => S::I::splat(id),
            };
            front.select_or(covered, behind).store(ids);
        }
    }
}

/// Computes the shadow-map bounds of each pixel tile of a layer.
pub(crate) struct MeasureLightBounds<'a> {
    pub(crate) visibility: &'a Visibility,
    pub(crate) samples_per_edge: usize,
    pub(crate) rays: &'a RayTable,
    pub(crate) shadow: &'a Shadow<'a>,
    pub(crate) light_bounds: &'a mut Vec<LightBounds>,
}

impl Kernel for MeasureLightBounds<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { visibility, samples_per_edge, rays, shadow, light_bounds } = self;
        let Visibility { depths, ids, .. } = visibility;
        let [per_row, n_rows] = visibility.pixel_tiles(samples_per_edge);
        light_bounds.clear();
        for tile in 0..per_row * n_rows {
            let (column, row) = (tile % per_row, tile / per_row);
            let mut bounds = LightBoundsBuilder::NONE;
            let no_id = S::I::splat(NO_ID);
            if samples_per_edge == 1 {
                let ray = rays.tile::<S>(column, row).at(&depths[tile]);
                bounds.add::<S>(shadow, &ray, S::I::load(&ids[tile]).gt(no_id));
            } else {
                let four = visibility.sample_tiles(column, row);
                let ids = S::interleave_tiles(each!(k in 4 => S::I::load(&ids[four[k]])));
                let depths = S::interleave_tiles(each!(k in 4 => S::F::load(&depths[four[k]]).bitcast_i32()));
                for k in 0..4 {
                    let ray = ViewRays { depth: depths[k].bitcast_f32(), ..rays.tile::<S>(column, row) };
                    bounds.add::<S>(shadow, &ray, ids[k].gt(no_id));
                }
            }
            light_bounds.push(bounds.finish());
        }
    }
}

/// Finds the pixel tiles that differ from a layer, and composites the layer's ids under the moving instances
/// there. A tile is stale if a moving instance is visible in it or may cast a shadow on it.
pub(crate) struct FindStaleTiles<'a> {
    /// Visibility buffer of the moving instances, depth-tested against the layer.
    pub(crate) visibility: &'a mut Visibility,
    pub(crate) samples_per_edge: usize,
    pub(crate) layer: &'a StaticLayer,
    /// Max-height pyramid of the moving instances, if they cast shadows.
    pub(crate) moving: Option<&'a MaxHeightPyramid>,
    /// Per pixel tile `true` if it differs from the layer.
    pub(crate) stale: &'a mut Vec<bool>,
}

impl Kernel for FindStaleTiles<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { visibility, samples_per_edge, layer, moving, stale } = self;
        let [per_row, n_rows] = visibility.pixel_tiles(samples_per_edge);
        let no_id = S::I::splat(NO_ID);
        stale.clear();
        stale.resize(per_row * n_rows, false);
        if let Some(max_heights) = moving {
            for (stale, bounds) in stale.iter_mut().zip(&layer.light_bounds) {
                *stale = bounds.may_be_shaded_by(max_heights);
            }
        }
        if samples_per_edge == 1 {
            for (tile, (ids, stale)) in visibility.ids.iter_mut().zip(stale).enumerate() {
                *stale |= S::I::load(ids).gt(no_id).any();
                if *stale {
                    layer.composite_under::<S>(ids, tile);
                }
            }
            return;
        }
        for (tile, stale) in stale.iter_mut().enumerate() {
            let four = visibility.sample_tiles(tile % per_row, tile / per_row);
            let ids = &mut visibility.ids;
            let [a, b, c, d] = each!(k in 4 => S::I::load(&ids[four[k]]));
            *stale |= a.max(b).max(c.max(d)).gt(no_id).any();
            if *stale {
                for tile in four {
                    layer.composite_under::<S>(&mut ids[tile], tile);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, PoisonError};

    use ipc_types::{ControlMode, ImageSizes};

    use super::StaticLayer;
    use crate::cpu::cache::scene_cache::SceneCache;
    use crate::{CpuRenderer, RenderScene};
    use scene::{CameraMount, Scene, Snapshot};
    use sim::physics::World;
    use sim::{Profile, TaskId};

    /// Renders a scene and returns it with the layer of its first camera.
    fn layer(renderer: &mut CpuRenderer, scene: &Scene) -> (RenderScene, Arc<StaticLayer>) {
        let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
        World::build(scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
        let scene = RenderScene::new(scene, ImageSizes::BENCHMARK);
        let _images = renderer.render_cameras(&scene, &snapshot);
        let layer = SceneCache::of(&scene).layers[0].lock().unwrap_or_else(PoisonError::into_inner).clone();
        (scene, layer.expect("a static camera must have a layer"))
    }

    #[test]
    fn cached_layers_survive_arm_motion() {
        let mut renderer = CpuRenderer::new(1);
        for &task in TaskId::ALL {
            let mut scene = (task.task().nominal)(Profile::Strict).draw(1);
            scene.lights.shadows = true;
            let mut world = World::build(&scene, ControlMode::EeDeltaPose);
            let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
            let render = RenderScene::new(&scene, ImageSizes::BENCHMARK);
            let mut cached = || {
                world.write_snapshot(&mut snapshot);
                let _images = renderer.render_cameras(&render, &snapshot);
                world.step(&vec![0.3; scene.robots.len() * 7]);
                let layers = SceneCache::of(&render).layers.iter().map(|layer| layer.lock().unwrap().clone());
                (layers.collect::<Vec<_>>(), SceneCache::of(&render).static_heights.lock().unwrap().clone())
            };
            let (layers, heights) = cached();
            for _ in 0..3 {
                let (later, later_heights) = cached();
                assert!(Arc::ptr_eq(&heights.clone().unwrap(), &later_heights.unwrap()), "{task:?}");
                let same = |(a, b): (&Option<_>, &Option<_>)| match (a, b) {
                    (Some(a), Some(b)) => Arc::ptr_eq(a, b),
                    (a, b) => a.is_none() && b.is_none(),
                };
                assert!(layers.iter().zip(&later).all(same), "{task:?}");
            }
        }
    }

    #[test]
    fn scenes_share_layer_only_if_static_parts_match() {
        let mut renderer = CpuRenderer::new(1);
        let draw = |seed| (TaskId::RaiseCube.task().nominal)(Profile::Strict).draw(seed);
        let (_scene, first) = layer(&mut renderer, &draw(1));
        assert!(Arc::ptr_eq(&first, &layer(&mut renderer, &draw(2)).1));
        type Change = (&'static str, fn(&mut Scene));
        let changes: [Change; 6] = [
            ("colour", |scene| scene.table.top.color[0] *= 0.9),
            ("floor", |scene| scene.background.floor.specular += 0.1),
            ("light", |scene| scene.lights.ambient[1] *= 0.9),
            ("sun", |scene| scene.lights.directional[0].direction[0] += 0.1),
            ("shadows", |scene| scene.lights.shadows ^= true),
            ("camera", |scene| match &mut scene.cameras[0].mount {
                CameraMount::World { eye, .. } => eye[0] += 0.01,
                CameraMount::Hand { .. } => unreachable!("the first camera is static"),
            }),
        ];
        for (name, change) in changes {
            let mut scene = draw(1);
            change(&mut scene);
            assert!(!Arc::ptr_eq(&first, &layer(&mut renderer, &scene).1), "{name}");
        }
    }
}
