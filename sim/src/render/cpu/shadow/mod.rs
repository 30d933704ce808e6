//! Shadows of the first sun: a map of heights along its light, and looking up whether a point is reached.

mod highest;
mod lookup;
mod parallel;

use core::marker::PhantomData;
use core::ops::Range;
use std::sync::{Arc, PoisonError};

use super::Pose;
use super::each::each;
use super::geometry::Draw;
use super::isa::{Isa, Kernel};
use super::kept::Kept;
use super::kind::{Block, Plain};
use super::raster::{Begin, Behind, Visibility};
use super::simd::{F32x16, FloatLike, I32x16, N_LANES, SetBits, Simd, SimdF32, SimdI32, SimdMask};
use crate::render::math::affine::{Affine3, scaled};
use crate::render::scene::{MeshKey, RenderScene};
use crate::render::shading::{
    SHADOW_DEPTH_LEVELS, SHADOW_HALF_DEPTH_M, SHADOW_MAP_SIDE, SHADOW_MAP_WIDTH_M, light_from_world,
};
use crate::scene::Snapshot;
pub(super) use highest::Highest;
use highest::{Level, Window};
pub(super) use lookup::{Extent, Reach, Shadow};
use parallel::Parallel;

/// Texels along each edge of a map.
const SIDE: usize = SHADOW_MAP_SIDE as usize;
const TEXELS_PER_M: f32 = SIDE as f32 / SHADOW_MAP_WIDTH_M;
/// Heights are whole numbers of steps.
const STEPS_PER_M: f32 = SHADOW_DEPTH_LEVELS / (2.0 * SHADOW_HALF_DEPTH_M);
/// Height of the map's middle, in steps.
const MIDDLE_STEPS: f32 = SHADOW_DEPTH_LEVELS / 2.0;
/// The greatest height, in steps; what is higher is taken for as high as this.
const TOP: f32 = SHADOW_DEPTH_LEVELS - 1.0;
/// Nothing is as low as this, in steps.
const DEPTHS_OF_SPACE: f32 = 0.0;

/// Texels along each edge of a block.
const BLOCK: usize = Plain::WIDTH as usize;
/// Blocks along each edge of a map.
const BLOCKS: usize = SIDE / BLOCK;
/// Texels along each edge of a cell.
const CELL: usize = 2;
/// Cells along each edge of a block.
const PER_BLOCK: usize = BLOCK / CELL;
/// Cells along each edge of a map.
const CELLS: usize = SIDE / CELL;

/// Heights along the first sun's light, in steps, of the surfaces that look away from it: those that look at it would now and
/// then shade themselves.
struct Heights {
    /// `[512, 512]`, of what was drawn and of what it was drawn over.
    texels: Vec<u16>,
    /// Of what was drawn alone.
    highest: Highest,
    /// Per sixteen blocks where anything was drawn, bit by bit.
    filled: Vec<u16>,
}

impl Heights {
    /// Nothing anywhere.
    fn new() -> Self {
        Self {
            texels: vec![0; SIDE * SIDE],
            highest: Highest::new(),
            filled: vec![0; BLOCKS * BLOCKS / N_LANES],
        }
    }
}

/// Heights of what never moves in a scene, which renderers keep there.
pub(in crate::render) struct StillHeights {
    /// The maps of what never moves, from its meshes to the light's frame, for which it was drawn.
    maps: Vec<Affine3>,
    heights: Heights,
}

/// All that the heights of what never moves depend on: meshes and their maps to the light's frame.
#[derive(PartialEq)]
pub(super) struct Casters(Vec<(MeshKey, Affine3)>);

/// Heights of everything at one moment.
pub(super) struct ShadowMap {
    /// What moves, drawn over the rest.
    heights: Heights,
    /// The rest: wherever nothing moves it is the same.
    still: Option<Arc<StillHeights>>,
    light_from_world: Affine3,
}

/// What one map at a time is drawn in, block by block.
pub(super) struct Relief {
    blocks: Visibility,
    maps: Vec<Affine3>,
    /// Whether there is nothing in it.
    is_empty: bool,
}

impl Relief {
    /// An empty one.
    pub(super) fn new() -> Self {
        Self { blocks: Visibility::new(), maps: Vec::with_capacity(256), is_empty: false }
    }

    /// Draws some of the instances, moves them into `heights` over other ones, and leaves nothing behind.
    fn draw(
        &mut self,
        isa: Isa,
        (scene, which): (&RenderScene, Range<usize>),
        under: &[u16],
        heights: &mut Heights,
    ) {
        let Self { blocks, maps, is_empty } = self;
        if !*is_empty {
            let (behind, kind) = (Behind::Nothing(DEPTHS_OF_SPACE), PhantomData::<Plain>);
            isa.run(Begin { visibility: blocks, side: SIDE, behind, blocks: kind });
        }
        *is_empty = false;
        isa.run(Draw {
            instances: &scene.instances[which.clone()],
            maps: &maps[which.clone()],
            first_ids: &scene.first_id[which],
            lens: Parallel { light_in_mesh: [0.0; 3] },
            visibility: blocks,
            blocks: PhantomData::<Plain>,
        });
        isa.run(Unfold { blocks, under, heights });
        *is_empty = true;
    }
}

impl ShadowMap {
    /// A map without shadows.
    pub(super) fn new() -> Self {
        Self { heights: Heights::new(), still: None, light_from_world: Affine3::IDENTITY }
    }

    /// Draws everything that casts a shadow in a scene that has shadows; what never moves only if no scene has `kept` it.
    pub(super) fn draw(
        &mut self,
        isa: Isa,
        scene: &RenderScene,
        snapshot: &Snapshot,
        kept: &Kept<Casters, StillHeights>,
        relief: &mut Relief,
    ) {
        let Some(centre) = scene.shadow_centre else { return };
        self.light_from_world = mirrored(light_from_world(scene.suns[0].towards, centre));
        let (view_from_world, maps) = (self.light_from_world, &mut relief.maps);
        isa.run(Pose { scene, snapshot, view_from_world, maps });
        let still = still_heights(isa, scene, kept, relief);
        if !self.still.as_ref().is_some_and(|known| Arc::ptr_eq(known, &still)) {
            // Where something moved it is drawn anew in any case.
            self.heights.texels.copy_from_slice(&still.heights.texels);
        }
        let which = scene.n_still..scene.instances.len();
        relief.draw(isa, (scene, which), &still.heights.texels, &mut self.heights);
        self.still = Some(still);
    }

    /// What a camera needs to look points up; `None` if nothing was drawn.
    pub(super) fn seen_from(&self, view_from_world: &Affine3) -> Option<Shadow<'_>> {
        let still = self.still.as_ref()?;
        let highest = [&self.heights.highest, &still.heights.highest];
        Some(self.shadow(&self.heights.texels, highest, view_from_world))
    }

    /// The same as if there were nothing but what never moves.
    pub(super) fn still_seen_from(&self, view_from_world: &Affine3) -> Option<Shadow<'_>> {
        let still = self.still.as_ref()?;
        Some(self.shadow(&still.heights.texels, [&still.heights.highest; 2], view_from_world))
    }

    /// The greatest heights of what moves.
    pub(super) fn moving(&self) -> &Highest {
        &self.heights.highest
    }

    fn shadow<'a>(
        &self,
        texels: &'a [u16],
        highest: [&'a Highest; 2],
        view_from_world: &Affine3,
    ) -> Shadow<'a> {
        let mut texel_from_view = self.light_from_world.compose(&view_from_world.rigid_inverse());
        for axis in 0..2 {
            texel_from_view.linear[axis] = scaled(texel_from_view.linear[axis], TEXELS_PER_M);
            // From texels' corners to their middles.
            texel_from_view.offset[axis] =
                texel_from_view.offset[axis] * TEXELS_PER_M + (SIDE as f32 / 2.0 - 0.5);
        }
        texel_from_view.linear[2] = scaled(texel_from_view.linear[2], STEPS_PER_M);
        texel_from_view.offset[2] = texel_from_view.offset[2] * STEPS_PER_M + MIDDLE_STEPS;
        Shadow { heights: texels, highest, texel_from_view }
    }
}

/// The heights of what never moves, drawn unless this scene or another one has them for the relief's maps.
fn still_heights(
    isa: Isa,
    scene: &RenderScene,
    all: &Kept<Casters, StillHeights>,
    relief: &mut Relief,
) -> Arc<StillHeights> {
    // What is kept is whole at any moment.
    let mut kept = scene.still_heights.lock().unwrap_or_else(PoisonError::into_inner);
    let maps = &relief.maps[..scene.n_still];
    match &*kept {
        Some(still) if still.maps == maps => Arc::clone(still),
        _ => {
            let meshes = scene.instances.iter().map(|instance| instance.mesh.key());
            let casters = Casters(meshes.zip(maps.iter().copied()).collect());
            let maps = maps.to_vec();
            let draw = || {
                let (nothing, mut heights) = (vec![0; SIDE * SIDE], Heights::new());
                relief.draw(isa, (scene, 0..scene.n_still), &nothing, &mut heights);
                StillHeights { maps, heights }
            };
            Arc::clone(kept.insert(all.get(casters, draw)))
        }
    }
}

/// Moves a relief into a map over other heights, and leaves the relief empty.
struct Unfold<'a> {
    blocks: &'a mut Visibility,
    under: &'a [u16],
    heights: &'a mut Heights,
}

impl Kernel for Unfold<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { blocks: Visibility { depths, drawn, .. }, under, heights } = self;
        let Heights { texels, highest, filled } = heights;
        let (mut columns, mut rows) = ([CELLS, 0], [CELLS, 0]);
        let sixteens = depths.as_chunks_mut::<N_LANES>().0.iter_mut().zip(drawn.as_chunks_mut::<N_LANES>().0);
        for ((sixteen, (blocks, drawn)), filled) in sixteens.enumerate().zip(filled) {
            // Most blocks are empty in one picture after the other.
            if *drawn == [0; N_LANES] && *filled == 0 {
                continue;
            }
            let is = S::I::load(&I32x16(each!(i in 16 => drawn[i].into()))).gt(S::I::splat(0)).to_bits();
            let was = core::mem::replace(filled, is);
            *drawn = [0; N_LANES];
            let (column, row) = (sixteen * N_LANES % BLOCKS, sixteen * N_LANES / BLOCKS);
            if is != 0 {
                let ends = [column + is.trailing_zeros() as usize, column + is.ilog2() as usize];
                let [first, last] = [ends[0] * PER_BLOCK, ends[1] * PER_BLOCK + PER_BLOCK - 1];
                columns = [columns[0].min(first), columns[1].max(last)];
                rows = [rows[0].min(row * PER_BLOCK), row * PER_BLOCK + PER_BLOCK - 1];
            }
            for i in SetBits(is | was) {
                let mut line = I32x16::ZERO;
                S::F::load(&blocks[i]).min(S::F::splat(TOP)).truncate_to_i32().store(&mut line);
                blocks[i] = F32x16([DEPTHS_OF_SPACE; N_LANES]);
                let steps = each!(k in 16 => line.0[k] as u16);
                let place = row * BLOCK * SIDE + (column + i) * BLOCK;
                let rows = place..place + (BLOCK - 1) * SIDE + BLOCK;
                let (texels, under) = (&mut texels[rows.clone()], &under[rows]);
                for (y, steps) in steps.as_chunks::<BLOCK>().0.iter().enumerate() {
                    let (texels, under) = (&mut texels[y * SIDE..][..BLOCK], &under[y * SIDE..][..BLOCK]);
                    for x in 0..BLOCK {
                        texels[x] = steps[x].max(under[x]);
                    }
                }
                for k in 0..PER_BLOCK {
                    let [upper, lower] = each!(half in 2 => steps.as_chunks::<BLOCK>().0[2 * k + half]);
                    let [a, b, c, d] = each!(x in 4 => upper[x].max(lower[x]));
                    highest.set_two([(column + i) * PER_BLOCK, row * PER_BLOCK + k], [a.max(b), c.max(d)]);
                }
            }
        }
        highest.finish((columns[0] < CELLS).then_some([columns, rows]));
    }
}

/// The light's frame upside down: a mirror image of what the sun sees, so that what looks away from it is drawn.
fn mirrored(light_from_world: Affine3) -> Affine3 {
    let Affine3 { linear: [right, down, height], offset: [x, y, z] } = light_from_world;
    Affine3 { linear: [right, scaled(down, -1.0), height], offset: [x, -y, z] }
}
