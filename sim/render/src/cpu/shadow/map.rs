//! The shadow map of an env: heights of static and of moving geometry.

use core::marker::PhantomData;
use core::ops::Range;
use std::sync::{Arc, PoisonError};

use super::height_map::{HeightMap, StaticHeights, StaticHeightsKey};
use super::light_projection::LightProjection;
use super::lookup::Shadow;
use super::max_heights::MaxHeightPyramid;
use super::size::{
    CELLS, CELLS_PER_TILE, EMPTY_HEIGHT, MAX_HEIGHT, MIDDLE_STEPS, SIDE, STEPS_PER_M, TEXELS_PER_M, TILE,
    TILES,
};
use crate::cpu::cache::scene_cache::SceneCache;
use crate::cpu::cache::shared_cache::SharedCache;
use crate::cpu::simd::each::each;
use crate::cpu::simd::isa::{Isa, Kernel};
use crate::cpu::simd::{F32x16, FloatLike, I32x16, N_LANES, SetBits, Simd, SimdF32, SimdI32, SimdMask};
use crate::cpu::transform::TransformInstances;
use crate::cpu::visibility::instances::RasterizeInstances;
use crate::cpu::visibility::raster::{ClearTo, ClearVisibility, Visibility};
use crate::cpu::visibility::tile::DepthTile;
use crate::math::affine::{Affine3, scaled};
use crate::prepared::RenderScene;
use crate::shading::light_from_world;
use scene::Snapshot;

/// The shadow map of one env at one time.
pub(crate) struct ShadowMap {
    /// Heights of moving geometry, drawn over the static map.
    heights: HeightMap,
    /// Heights of static geometry.
    still: Option<Arc<StaticHeights>>,
    light_from_world: Affine3,
}

/// Scratch buffers for rasterising one map at a time, tile by tile.
pub(crate) struct HeightRaster {
    tiles: Visibility,
    maps: Vec<Affine3>,
    /// `true` if all tiles are cleared.
    is_empty: bool,
}

impl HeightRaster {
    /// Creates empty buffers.
    pub(crate) fn new() -> Self {
        Self { tiles: Visibility::new(), maps: Vec::with_capacity(256), is_empty: false }
    }

    /// Rasterises a range of instances and resolves them into `heights` on top of `under`. Leaves the tiles
    /// cleared.
    fn draw(
        &mut self,
        isa: Isa,
        (scene, which): (&RenderScene, Range<usize>),
        under: &[u16],
        heights: &mut HeightMap,
    ) {
        let Self { tiles, maps, is_empty } = self;
        if !*is_empty {
            let (behind, kind) = (ClearTo::Background(EMPTY_HEIGHT), PhantomData::<DepthTile>);
            isa.run(ClearVisibility { visibility: tiles, n_tiles: [TILES; 2], behind, tiles: kind });
        }
        *is_empty = false;
        isa.run(RasterizeInstances {
            instances: &scene.instances[which.clone()],
            maps: &maps[which.clone()],
            first_ids: &scene.first_id[which],
            projection: LightProjection { light_in_mesh: [0.0; 3] },
            visibility: tiles,
            tiles: PhantomData::<DepthTile>,
        });
        isa.run(ResolveHeights { tiles, under, heights });
        *is_empty = true;
    }
}

impl ShadowMap {
    /// Creates a map without shadows.
    pub(crate) fn new() -> Self {
        Self { heights: HeightMap::new(), still: None, light_from_world: Affine3::IDENTITY }
    }

    /// Renders all shadow casters of a scene with shadows. Static geometry is rendered only if it is not in
    /// the `cache`.
    pub(crate) fn draw(
        &mut self,
        isa: Isa,
        scene: &RenderScene,
        snapshot: &Snapshot,
        cache: &SharedCache<StaticHeightsKey, StaticHeights>,
        raster: &mut HeightRaster,
    ) {
        let Some(centre) = scene.shadow_centre else { return };
        self.light_from_world = mirrored(light_from_world(scene.suns[0].towards, centre));
        let (view_from_world, maps) = (self.light_from_world, &mut raster.maps);
        isa.run(TransformInstances { scene, snapshot, view_from_world, transforms: maps });
        let still = static_heights(isa, scene, cache, raster);
        if !self.still.as_ref().is_some_and(|known| Arc::ptr_eq(known, &still)) {
            // Tiles that moving geometry occupied are rewritten below in any case.
            self.heights.texels.copy_from_slice(&still.heights.texels);
        }
        let which = scene.n_static..scene.instances.len();
        raster.draw(isa, (scene, which), &still.heights.texels, &mut self.heights);
        self.still = Some(still);
    }

    /// Returns the map for lookups from a camera, or `None` if nothing was rendered.
    pub(crate) fn view(&self, view_from_world: &Affine3) -> Option<Shadow<'_>> {
        let still = self.still.as_ref()?;
        let max_heights = [&self.heights.max_heights, &still.heights.max_heights];
        Some(self.shadow(&self.heights.texels, max_heights, view_from_world))
    }

    /// Returns the map of static geometry alone for lookups from a camera.
    pub(crate) fn static_view(&self, view_from_world: &Affine3) -> Option<Shadow<'_>> {
        let still = self.still.as_ref()?;
        Some(self.shadow(&still.heights.texels, [&still.heights.max_heights; 2], view_from_world))
    }

    /// Returns the maximum heights of moving geometry.
    pub(crate) fn moving(&self) -> &MaxHeightPyramid {
        &self.heights.max_heights
    }

    fn shadow<'a>(
        &self,
        texels: &'a [u16],
        max_heights: [&'a MaxHeightPyramid; 2],
        view_from_world: &Affine3,
    ) -> Shadow<'a> {
        let mut texel_from_view = self.light_from_world.compose(&view_from_world.rigid_inverse());
        for axis in 0..2 {
            texel_from_view.linear[axis] = scaled(texel_from_view.linear[axis], TEXELS_PER_M);
            // Shift from texel corners to texel centres.
            texel_from_view.offset[axis] =
                texel_from_view.offset[axis] * TEXELS_PER_M + (SIDE as f32 / 2.0 - 0.5);
        }
        texel_from_view.linear[2] = scaled(texel_from_view.linear[2], STEPS_PER_M);
        texel_from_view.offset[2] = texel_from_view.offset[2] * STEPS_PER_M + MIDDLE_STEPS;
        Shadow { heights: texels, max_heights, texel_from_view }
    }
}

/// Returns the heights of static geometry, rendering them unless this or another scene has cached them.
fn static_heights(
    isa: Isa,
    scene: &RenderScene,
    cache: &SharedCache<StaticHeightsKey, StaticHeights>,
    raster: &mut HeightRaster,
) -> Arc<StaticHeights> {
    // The slot is replaced as a whole, so it is valid even if a panic poisoned the lock.
    let mut slot = SceneCache::of(scene).static_heights.lock().unwrap_or_else(PoisonError::into_inner);
    let maps = &raster.maps[..scene.n_static];
    match &*slot {
        Some(still) if still.maps == maps => Arc::clone(still),
        _ => {
            let meshes = scene.instances.iter().map(|instance| instance.mesh.key());
            let casters = StaticHeightsKey(meshes.zip(maps.iter().copied()).collect());
            let maps = maps.to_vec();
            let draw = || {
                let (nothing, mut heights) = (vec![0; SIDE * SIDE], HeightMap::new());
                raster.draw(isa, (scene, 0..scene.n_static), &nothing, &mut heights);
                StaticHeights { maps, heights }
            };
            Arc::clone(slot.insert(cache.get_or_insert_with(casters, draw)))
        }
    }
}

/// Kernel that resolves rasterised tiles into a height map on top of another one and clears the tiles.
struct ResolveHeights<'a> {
    tiles: &'a mut Visibility,
    under: &'a [u16],
    heights: &'a mut HeightMap,
}

impl Kernel for ResolveHeights<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { tiles: Visibility { depths, drawn, .. }, under, heights } = self;
        let HeightMap { texels, max_heights, filled } = heights;
        let (mut columns, mut rows) = ([CELLS, 0], [CELLS, 0]);
        let sixteens = depths.as_chunks_mut::<N_LANES>().0.iter_mut().zip(drawn.as_chunks_mut::<N_LANES>().0);
        for ((sixteen, (tiles, drawn)), filled) in sixteens.enumerate().zip(filled) {
            // Most tiles are empty in one image after another.
            if *drawn == [0; N_LANES] && *filled == 0 {
                continue;
            }
            let is = S::I::load(&I32x16(each!(i in 16 => drawn[i].into()))).gt(S::I::splat(0)).to_bits();
            let was = core::mem::replace(filled, is);
            *drawn = [0; N_LANES];
            let (column, row) = (sixteen * N_LANES % TILES, sixteen * N_LANES / TILES);
            if is != 0 {
                let ends = [column + is.trailing_zeros() as usize, column + is.ilog2() as usize];
                let [first, last] = [ends[0] * CELLS_PER_TILE, ends[1] * CELLS_PER_TILE + CELLS_PER_TILE - 1];
                columns = [columns[0].min(first), columns[1].max(last)];
                rows = [rows[0].min(row * CELLS_PER_TILE), row * CELLS_PER_TILE + CELLS_PER_TILE - 1];
            }
            for i in SetBits(is | was) {
                let mut line = I32x16::ZERO;
                S::F::load(&tiles[i]).min(S::F::splat(MAX_HEIGHT)).truncate_to_i32().store(&mut line);
                tiles[i] = F32x16([EMPTY_HEIGHT; N_LANES]);
                let steps = each!(k in 16 => line.0[k] as u16);
                let place = row * TILE * SIDE + (column + i) * TILE;
                let rows = place..place + (TILE - 1) * SIDE + TILE;
                let (texels, under) = (&mut texels[rows.clone()], &under[rows]);
                for (y, steps) in steps.as_chunks::<TILE>().0.iter().enumerate() {
                    let (texels, under) = (&mut texels[y * SIDE..][..TILE], &under[y * SIDE..][..TILE]);
                    for x in 0..TILE {
                        texels[x] = steps[x].max(under[x]);
                    }
                }
                for k in 0..CELLS_PER_TILE {
                    let [upper, lower] = each!(half in 2 => steps.as_chunks::<TILE>().0[2 * k + half]);
                    let [a, b, c, d] = each!(x in 4 => upper[x].max(lower[x]));
                    max_heights.set_cell_pair(
                        [(column + i) * CELLS_PER_TILE, row * CELLS_PER_TILE + k],
                        [a.max(b), c.max(d)],
                    );
                }
            }
        }
        max_heights.finish((columns[0] < CELLS).then_some([columns, rows]));
    }
}

/// Mirrors the light frame, which reverses the winding so that back faces are drawn.
fn mirrored(light_from_world: Affine3) -> Affine3 {
    let Affine3 { linear: [right, down, height], offset: [x, y, z] } = light_from_world;
    Affine3 { linear: [right, scaled(down, -1.0), height], offset: [x, -y, z] }
}
