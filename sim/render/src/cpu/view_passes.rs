//! The sequence of passes that renders one view, or the shadow map of an env.

use std::sync::{Arc, PoisonError};

use super::cache::scene_cache::SceneCache;
use super::cache::shared_cache::SharedCache;
use super::cache::static_layer::{FindStaleTiles, MeasureLightBounds, StaticLayer, StaticLayerKey};
use super::settings::RenderSettings;
use super::shading::lighting::ViewLights;
use super::shading::sink::{ImageSink, OverlaySink};
use super::shadow::{Shadow, ShadowMap};
use super::transform::TransformInstances;
use super::visibility::raster::ClearTo;
use super::visibility::tile::{MultisampleTile, Tile4x4, TileLayout};
use super::workspace::{CameraContext, Workspace};
use crate::Samples;
use crate::prepared::RenderScene;
use crate::renderer::View;
use scene::Snapshot;

impl Workspace {
    /// Renders the shadow map of a scene whose first sun casts shadows.
    pub(crate) fn render_shadow_map(
        &mut self,
        settings: &RenderSettings,
        scene: &RenderScene,
        snapshot: &Snapshot,
        map: &mut ShadowMap,
    ) {
        map.draw(settings.isa, scene, snapshot, &settings.static_heights, &mut self.raster);
    }

    /// Renders one view into its `out`.
    pub(crate) fn render(&mut self, settings: &RenderSettings, view: &mut View<'_>, map: Option<&ShadowMap>) {
        match settings.options.samples {
            Samples::One => self.render_with::<Tile4x4>(settings, view, map),
            Samples::Four => self.render_with::<MultisampleTile>(settings, view, map),
        }
    }

    fn render_with<B: TileLayout>(
        &mut self,
        settings: &RenderSettings,
        view: &mut View<'_>,
        map: Option<&ShadowMap>,
    ) {
        let RenderSettings { isa, options, layers, .. } = settings;
        let (isa, scene, camera) = (*isa, view.scene, &view.scene.cameras[view.camera_idx]);
        let view_from_world = camera.view_from_world(view.snapshot);
        isa.run(TransformInstances {
            scene,
            snapshot: view.snapshot,
            view_from_world,
            transforms: &mut self.view_from_mesh,
        });
        self.select_ray_table(isa, camera);
        let (context, lights) =
            (CameraContext { isa, scene, camera }, ViewLights::new(scene, &view_from_world));
        let shadow = map.and_then(|map| map.view(&view_from_world));
        if !(options.static_layers && camera.is_static()) {
            self.clear::<B>(context);
            self.rasterize::<B>(context, 0..scene.instances.len());
            self.shade::<B>(context, &lights, shadow, None, ImageSink::new(view.out, camera.size));
            return;
        }
        let layer = &*self.layer::<B>(context, view, &lights, map, layers);
        self.clear_to::<B>(context, ClearTo::Depths(&layer.depths));
        self.rasterize::<B>(context, scene.n_static..scene.instances.len());
        let mut stale = core::mem::take(&mut self.stale);
        isa.run(FindStaleTiles {
            visibility: &mut self.visibility,
            samples_per_edge: B::SAMPLES_PER_EDGE,
            layer,
            moving: map.map(ShadowMap::moving),
            stale: &mut stale,
        });
        let sink = OverlaySink::new(&layer.pixels, view.out, camera.size);
        self.shade::<B>(context, &lights, shadow, Some(&stale), sink);
        self.stale = stale;
    }

    /// Returns the layer of a view: the scene's own, or an identical one from the shared cache, rendering
    /// it on a miss.
    fn layer<B: TileLayout>(
        &mut self,
        context: CameraContext<'_>,
        view: &View<'_>,
        lights: &ViewLights,
        map: Option<&ShadowMap>,
        layers: &SharedCache<StaticLayerKey, StaticLayer>,
    ) -> Arc<StaticLayer> {
        // The slot is never partially written, so a poisoned lock is safe to use.
        let mut slot =
            SceneCache::of(view.scene).layers[view.camera_idx].lock().unwrap_or_else(PoisonError::into_inner);
        match &*slot {
            Some(layer) if layer.matches(&self.view_from_mesh[..view.scene.n_static], B::SAMPLES) => {
                Arc::clone(layer)
            }
            _ => {
                let view_from_world = context.camera.view_from_world(view.snapshot);
                let shadow = map.and_then(|map| map.static_view(&view_from_world));
                let render = || self.render_layer::<B>(context, lights, shadow);
                let key = StaticLayerKey::of(view, B::SAMPLES);
                Arc::clone(slot.insert(layers.get_or_insert_with(key, render)))
            }
        }
    }

    fn render_layer<B: TileLayout>(
        &mut self,
        context: CameraContext<'_>,
        lights: &ViewLights,
        shadow: Option<Shadow<'_>>,
    ) -> StaticLayer {
        let CameraContext { isa, scene, camera } = context;
        self.clear::<B>(context);
        self.rasterize::<B>(context, 0..scene.n_static);
        let mut light_bounds = Vec::new();
        if let Some(shadow) = &shadow {
            isa.run(MeasureLightBounds {
                visibility: &self.visibility,
                samples_per_edge: B::SAMPLES_PER_EDGE,
                rays: &self.rays[0],
                shadow,
                light_bounds: &mut light_bounds,
            });
        }
        let mut pixels = vec![0; camera.size.n_bytes()];
        self.shade::<B>(context, lights, shadow, None, ImageSink::new(&mut pixels, camera.size));
        StaticLayer {
            view_from_mesh: self.view_from_mesh[..scene.n_static].to_vec(),
            samples: B::SAMPLES,
            depths: self.visibility.depths.clone(),
            ids: self.visibility.ids.clone(),
            tile_ids: self.surfaces.tile_ids.clone(),
            pixels,
            light_bounds,
        }
    }
}
