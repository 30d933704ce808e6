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
use super::simd::{Floats, Line, N_LANES, Number, Simd};
use crate::render::affine::{Affine, scaled};
use crate::render::rules::{MAP_M, MAP_SIDE, light_from_world};
use crate::render::scene::{MeshKey, RenderScene};
use crate::scene::Snapshot;
pub(super) use highest::Highest;
pub(super) use lookup::{Reach, Shadow};
use parallel::Parallel;

/// Texels along each edge of a map.
const SIDE: usize = MAP_SIDE as usize;
const TEXELS_PER_M: f32 = SIDE as f32 / MAP_M;
/// Nothing is as low as this, in m.
const DEPTHS_OF_SPACE: f32 = -1e9;

/// Texels along each edge of a cell.
const CELL: usize = 8;
/// Cells along each edge of a map.
const CELLS: usize = SIDE / CELL;

/// Heights along the first sun's light, in m, of the surfaces that look away from it: those that look at it would now and
/// then shade themselves.
struct Heights {
    /// `[512, 512]`.
    texels: Vec<f32>,
    highest: Highest,
}

impl Heights {
    /// Nothing anywhere.
    fn new() -> Self {
        Self { texels: vec![DEPTHS_OF_SPACE; SIDE * SIDE], highest: Highest::new() }
    }

    /// What a camera needs to look points up.
    fn seen_from(&self, light_from_world: &Affine, view_from_world: &Affine) -> Shadow<'_> {
        let mut texel_from_view = light_from_world.after(&view_from_world.rigid_inverse());
        for axis in 0..2 {
            texel_from_view.linear[axis] = scaled(texel_from_view.linear[axis], TEXELS_PER_M);
            // From texels' corners to their middles.
            texel_from_view.offset[axis] =
                texel_from_view.offset[axis] * TEXELS_PER_M + (SIDE as f32 / 2.0 - 0.5);
        }
        Shadow { heights: bytemuck::cast_slice(&self.texels), highest: &self.highest, texel_from_view }
    }
}

/// Heights of what never moves in a scene, which renderers keep there.
pub(in crate::render) struct StillHeights {
    /// The maps of what never moves, from its meshes to the light's frame, for which it was drawn.
    maps: Vec<Affine>,
    heights: Heights,
}

/// All that the heights of what never moves depend on: meshes and their maps to the light's frame.
#[derive(PartialEq)]
pub(super) struct Casters(Vec<(MeshKey, Affine)>);

/// Heights of everything at one moment.
pub(super) struct ShadowMap {
    heights: Heights,
    /// Of what moves alone, if the rest was kept.
    pub(super) moving: Highest,
    /// Over what it was drawn: wherever nothing moves it is the same.
    still: Option<Arc<StillHeights>>,
    light_from_world: Affine,
}

/// What one map at a time is drawn in, block by block.
pub(super) struct Relief {
    blocks: Visibility,
    maps: Vec<Affine>,
    /// Whether there is nothing in it.
    is_empty: bool,
}

impl Relief {
    /// An empty one.
    pub(super) fn new() -> Self {
        Self { blocks: Visibility::new(), maps: Vec::with_capacity(256), is_empty: false }
    }

    /// Draws some of the instances, moves them into a map over what never moves, and leaves nothing behind. `moving` gets the
    /// heights of what was drawn.
    fn draw(
        &mut self,
        isa: Isa,
        (scene, which): (&RenderScene, Range<usize>),
        still: Option<&Heights>,
        heights: &mut Heights,
        moving: &mut Highest,
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
        isa.run(Unfold { blocks, still, heights, moving });
        *is_empty = true;
    }
}

impl ShadowMap {
    /// A map without shadows.
    pub(super) fn new() -> Self {
        Self {
            heights: Heights::new(),
            moving: Highest::new(),
            still: None,
            light_from_world: Affine::IDENTITY,
        }
    }

    /// Draws everything that casts a shadow in a scene that has shadows. What never moves is drawn once if scenes are to
    /// `keep` it, and anew otherwise.
    pub(super) fn draw(
        &mut self,
        isa: Isa,
        scene: &RenderScene,
        snapshot: &Snapshot,
        keep: Option<&Kept<Casters, StillHeights>>,
        relief: &mut Relief,
    ) {
        let Some(centre) = scene.shadow_centre else { return };
        self.light_from_world = mirrored(light_from_world(scene.suns[0].towards, centre));
        let (view_from_world, maps) = (self.light_from_world, &mut relief.maps);
        isa.run(Pose { scene, snapshot, view_from_world, maps });
        let still = keep.map(|kept| still_heights(isa, scene, kept, relief));
        let is_same = match (&self.still, &still) {
            (Some(known), Some(still)) => Arc::ptr_eq(known, still),
            (known, still) => known.is_none() && still.is_none(),
        };
        if !is_same {
            self.start_over(still);
        }
        let first = if keep.is_some() { scene.n_still } else { 0 };
        let Self { heights, moving, still, .. } = self;
        let still = still.as_ref().map(|still| &still.heights);
        relief.draw(isa, (scene, first..scene.instances.len()), still, heights, moving);
    }

    /// Shows what never moves, and nothing else.
    fn start_over(&mut self, still: Option<Arc<StillHeights>>) {
        let Self { heights, moving, .. } = self;
        *moving = Highest::new();
        if let Some(StillHeights { heights: still, .. }) = still.as_deref() {
            heights.texels.copy_from_slice(&still.texels);
            heights.highest.clone_from(&still.highest);
        } else {
            heights.texels.fill(DEPTHS_OF_SPACE);
            heights.highest.clone_from(moving);
        }
        self.still = still;
    }

    /// What a camera needs to look points up.
    pub(super) fn seen_from(&self, view_from_world: &Affine) -> Shadow<'_> {
        self.heights.seen_from(&self.light_from_world, view_from_world)
    }

    /// The same as if there were nothing but what never moves; `None` if that was not kept.
    pub(super) fn still_seen_from(&self, view_from_world: &Affine) -> Option<Shadow<'_>> {
        let still = self.still.as_ref()?;
        Some(still.heights.seen_from(&self.light_from_world, view_from_world))
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
                let mut heights = Heights::new();
                relief.draw(isa, (scene, 0..scene.n_still), None, &mut heights, &mut Highest::new());
                StillHeights { maps, heights }
            };
            Arc::clone(kept.insert(all.get(casters, draw)))
        }
    }
}

/// Moves a relief into a map over what never moves, and leaves the relief empty.
struct Unfold<'a> {
    blocks: &'a mut Visibility,
    still: Option<&'a Heights>,
    heights: &'a mut Heights,
    moving: &'a mut Highest,
}

impl Kernel for Unfold<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        const PER_ROW: usize = SIDE / Plain::WIDTH as usize;
        let Self { blocks: Visibility { depths: blocks, drawn, .. }, still, heights, moving } = self;
        for cell in 0..CELLS * CELLS {
            let (column, row) = (cell % CELLS, cell / CELLS);
            let upper = row * 2 * PER_ROW + column * 2;
            let places = [upper, upper + 1, upper + PER_ROW, upper + PER_ROW + 1];
            let is_empty = each!(k in 4 => core::mem::take(&mut drawn[places[k]])) == [0; 4];
            // Most cells are empty in one picture after the other.
            if is_empty && moving.levels[0][cell] == DEPTHS_OF_SPACE {
                continue;
            }
            let [a, b, c, d] = each!(k in 4 => S::F::load(&blocks[places[k]]));
            let greatest = a.max(b).max(c.max(d));
            let mut line = Line::ZERO;
            greatest.store(&mut line);
            let highest = line.0.into_iter().fold(DEPTHS_OF_SPACE, f32::max);
            moving.levels[0][cell] = highest;
            heights.highest.levels[0][cell] =
                still.map_or(highest, |still| highest.max(still.highest.levels[0][cell]));
            for (k, place) in places.into_iter().enumerate() {
                let first = (row * CELL + k / 2 * 4) * SIDE + column * CELL + k % 2 * 4;
                for y in 0..4 {
                    let to = first + y * SIDE..first + y * SIDE + 4;
                    let from = &blocks[place].0[y * 4..y * 4 + 4];
                    let texels = &mut heights.texels[to.clone()];
                    texels.copy_from_slice(from);
                    if let Some(still) = still {
                        for (texel, under) in texels.iter_mut().zip(&still.texels[to]) {
                            *texel = texel.max(*under);
                        }
                    }
                }
                blocks[place] = Line([DEPTHS_OF_SPACE; N_LANES]);
            }
        }
        moving.finish();
        heights.highest.finish();
    }
}

/// The light's frame upside down: a mirror image of what the sun sees, so that what looks away from it is drawn.
fn mirrored(light_from_world: Affine) -> Affine {
    let Affine { linear: [right, down, height], offset: [x, y, z] } = light_from_world;
    Affine { linear: [right, scaled(down, -1.0), height], offset: [x, -y, z] }
}
