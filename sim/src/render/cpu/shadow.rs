//! Shadows of the first sun: a map of heights along its light, and looking up whether a point is reached.

use core::marker::PhantomData;
use core::ops::Range;
use std::sync::{Arc, PoisonError};

use super::each::each;
use super::geometry::Draw;
use super::isa::{Isa, Kernel};
use super::kind::{Block, Plain, Square};
use super::lens::{Lens, Projected, Unfit, Vectors};
use super::raster::Visibility;
use super::rays::Gaze;
use super::simd::{Floats, Lanes, Line, Mask, N_LANES, Number, Per, Simd, Whole, WholeLine};
use crate::render::affine::{Affine, Vec3, normalised, scaled};
use crate::render::mesh::Bounds;
use crate::render::posed;
use crate::render::rules::{MAP_M, MAP_SIDE, OFF_SURFACE_M, light_from_world};
use crate::render::scene::{Instance, RenderScene};
use crate::scene::Snapshot;

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
            blocks.clear::<Plain>(SIDE, DEPTHS_OF_SPACE);
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
        isa.run(Unfold { blocks: &mut blocks.depths, still, heights, moving });
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

    /// Draws everything that casts a shadow in a scene that has shadows. What never moves is drawn once if the scene is to
    /// keep it, and anew otherwise.
    pub(super) fn draw(
        &mut self,
        isa: Isa,
        scene: &RenderScene,
        snapshot: &Snapshot,
        keep: bool,
        relief: &mut Relief,
    ) {
        let Some(centre) = scene.shadow_centre else { return };
        self.light_from_world = mirrored(light_from_world(scene.suns[0].towards, centre));
        posed::pose(scene, snapshot, &self.light_from_world, &mut relief.maps);
        let still = keep.then(|| still_heights(isa, scene, relief));
        let is_same = match (&self.still, &still) {
            (Some(known), Some(still)) => Arc::ptr_eq(known, still),
            (known, still) => known.is_none() && still.is_none(),
        };
        if !is_same {
            self.start_over(still);
        }
        let first = if keep { scene.n_still } else { 0 };
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

/// The heights of what never moves, drawn unless the scene has them for the relief's maps.
fn still_heights(isa: Isa, scene: &RenderScene, relief: &mut Relief) -> Arc<StillHeights> {
    // What is kept is whole at any moment.
    let mut kept = scene.still_heights.lock().unwrap_or_else(PoisonError::into_inner);
    let maps = &relief.maps[..scene.n_still];
    match &*kept {
        Some(still) if still.maps == maps => Arc::clone(still),
        _ => {
            let (maps, mut heights) = (maps.to_vec(), Heights::new());
            relief.draw(isa, (scene, 0..scene.n_still), None, &mut heights, &mut Highest::new());
            Arc::clone(kept.insert(Arc::new(StillHeights { maps, heights })))
        }
    }
}

/// Moves a relief into a map over what never moves, and leaves the relief empty.
struct Unfold<'a> {
    blocks: &'a mut [Line],
    still: Option<&'a Heights>,
    heights: &'a mut Heights,
    moving: &'a mut Highest,
}

impl Kernel for Unfold<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        const PER_ROW: usize = SIDE / Plain::WIDTH as usize;
        let Self { blocks, still, heights, moving } = self;
        for cell in 0..CELLS * CELLS {
            let (column, row) = (cell % CELLS, cell / CELLS);
            let upper = row * 2 * PER_ROW + column * 2;
            let places = [upper, upper + 1, upper + PER_ROW, upper + PER_ROW + 1];
            let [a, b, c, d] = each!(k in 4 => S::F::load(&blocks[places[k]]));
            let greatest = a.max(b).max(c.max(d));
            let is_empty = !greatest.gt(S::F::all(DEPTHS_OF_SPACE)).any();
            // Most cells are empty in one picture after the other.
            if is_empty && moving.levels[0][cell] == DEPTHS_OF_SPACE {
                continue;
            }
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

/// A shadow map as a camera looks it up.
pub(super) struct Shadow<'a> {
    /// `[512, 512]` bits of f32 heights in m.
    heights: &'a [u32],
    highest: &'a Highest,
    /// From the view frame to texels and heights.
    texel_from_view: Affine,
}

impl Shadow<'_> {
    /// What share of the sun's light reaches what is seen, given its unit normals; `None` for all. `is_plane` if one flat
    /// triangle is seen through a [`super::kind::Square`] of pixels.
    #[inline(always)]
    pub(super) fn sunlight<S: Simd, N: Per<S>>(
        &self,
        gaze: &Gaze<S>,
        normal: &[N; 3],
        is_plane: bool,
    ) -> Option<S::F> {
        let [x, y, height] = self.place(gaze, normal);
        let (zero, last) = (S::F::all(0.0), S::F::all((SIDE - 1) as f32));
        let outside = zero.gt(x) | x.gt(last) | zero.gt(y) | y.gt(last);
        let limit = S::F::all((SIDE - 2) as f32);
        let at = [x.max(zero).min(limit).truncated(), y.max(zero).min(limit).truncated()];
        let first = if is_plane {
            let mut lines = [WholeLine::ZERO; 2];
            at[0].store(&mut lines[0]);
            at[1].store(&mut lines[1]);
            let ranges = each!(k in 2 => Square::range_of_corners(&lines[k], (SIDE - 2) as i32));
            // All in the light?
            if !S::F::all(self.highest.within(ranges)).gt(height).any() {
                return None;
            }
            each!(k in 2 => ranges[k][0])
        } else {
            // Most of what is bent moves, and has something of its own behind it.
            each!(k in 2 => at[k].least())
        };
        let [fx, fy] = each!(k in 2 => [x, y][k] - at[k].floats());
        let corner = each!(k in 2 => first[k].min((SIDE - 8) as i32));
        let within = each!(k in 2 => at[k] - S::I::all(corner[k]));
        let first = corner[1] as usize * SIDE + corner[0] as usize;
        let corners = match S::window(self.heights, first, SIDE, within) {
            Some(corners) => corners,
            None => {
                let mut place = WholeLine::ZERO;
                (at[1].shl::<9>() + at[0]).store(&mut place);
                let (a, b) = S::pairs(self.heights, &place);
                let (c, d) = S::pairs(&self.heights[SIDE..], &place);
                [a, b, c, d]
            }
        };
        let [a, b, c, d] = each!(k in 4 => {
            let shaded = corners[k].as_float_bits().gt(height);
            S::F::all(0.0).or_where(shaded, S::F::all(1.0))
        });
        let upper = (b - a).mul_add(fx, a);
        let lower = (d - c).mul_add(fx, c);
        Some(S::F::all(1.0).or_where(outside, (lower - upper).mul_add(fy, upper)))
    }
}

impl Shadow<'_> {
    /// Where on the map what is seen is looked up, in texels, and its height, given its unit normals.
    #[inline(always)]
    fn place<S: Simd, N: Per<S>>(&self, gaze: &Gaze<S>, normal: &[N; 3]) -> [S::F; 3] {
        let z = S::F::all(1.0) / gaze.depth;
        let [dx, dy] = gaze.d;
        each!(i in 3 => {
            let [a, b, c] = self.texel_from_view.linear[i];
            let along = dx.mul_add(S::F::all(a), dy.mul_add(S::F::all(b), S::F::all(c)));
            let aside = normal[0].mul_add(N::all(a), normal[1].mul_add(N::all(b), normal[2] * N::all(c)));
            let offset = aside.mul_add(N::all(OFF_SURFACE_M), N::all(self.texel_from_view.offset[i]));
            z.mul_add(along, offset.spread())
        })
    }
}

/// Where on a map a block of pixels is looked up, whatever its normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reach {
    /// First and last column, first and last row, in cells.
    ranges: [[u8; 2]; 2],
    /// Nothing that is lower shades it.
    lowest: f32,
}

impl Reach {
    /// Of what no shadow falls on.
    pub(super) const NONE: Self = Self { ranges: [[0; 2]; 2], lowest: f32::INFINITY };

    /// Widens it by what a block of pixels shows there where `seen`.
    #[inline(always)]
    pub(super) fn add<S: Simd>(&mut self, shadow: &Shadow<'_>, gaze: &Gaze<S>, seen: S::M) {
        // Normals are unit vectors, and something is left for rounding.
        const SLACK: f32 = OFF_SURFACE_M * TEXELS_PER_M + 0.1;
        const LAST: i32 = SIDE as i32 - 2;
        let mut lines = [Line::ZERO; 3];
        let place = shadow.place(gaze, &[0.0; 3]);
        for k in 0..3 {
            place[k].store(&mut lines[k]);
        }
        let [columns, rows, heights] = &lines;
        for lane in Lanes(seen.to_bits()) {
            let (at, height) = ([columns.0[lane], rows.0[lane]], heights.0[lane]);
            if at.iter().any(|x| !(-SLACK..SIDE as f32 + SLACK).contains(x)) {
                continue;
            }
            let is_first = self.lowest == f32::INFINITY;
            for (range, x) in self.ranges.iter_mut().zip(at) {
                let (first, last) = ((x - SLACK) as i32, (x + SLACK) as i32);
                // And its neighbour's.
                let (first, last) = (first.clamp(0, LAST), last.clamp(0, LAST) + 1);
                let (first, last) = ((first as usize / CELL) as u8, (last as usize / CELL) as u8);
                *range = if is_first { [first, last] } else { [range[0].min(first), range[1].max(last)] };
            }
            self.lowest = self.lowest.min(height - OFF_SURFACE_M - 0.001);
        }
    }

    /// Whether a shadow of something this high may fall on it.
    #[inline(always)]
    pub(super) fn is_touched(&self, highest: &Highest) -> bool {
        self.lowest < f32::INFINITY && highest.reaches_above(self.lowest, self.ranges)
    }
}

/// The greatest heights of cells of 8 × 8 texels, row by row, then of cells of 16 × 16 and so on.
#[derive(Clone)]
pub(super) struct Highest {
    levels: [Vec<f32>; N_LEVELS],
    /// First and last column, first and last row of the cells that hold anything.
    occupied: [[u8; 2]; 2],
}

/// Levels down to 2 × 2 cells.
const N_LEVELS: usize = CELLS.ilog2() as usize;

impl Highest {
    fn new() -> Self {
        Self {
            levels: core::array::from_fn(|level| vec![DEPTHS_OF_SPACE; (CELLS >> level).pow(2)]),
            occupied: [[u8::MAX, 0]; 2],
        }
    }

    /// Finds the rest out from the finest level.
    fn finish(&mut self) {
        self.occupied = [[u8::MAX, 0]; 2];
        for (row, cells) in self.levels[0].chunks_exact(CELLS).enumerate() {
            let is_there = |highest: &f32| *highest != DEPTHS_OF_SPACE;
            let ends = [cells.iter().position(is_there), cells.iter().rposition(is_there)];
            if let [Some(left), Some(right)] = ends {
                for (range, ends) in self.occupied.iter_mut().zip([[left, right], [row, row]]) {
                    *range = [range[0].min(ends[0] as u8), range[1].max(ends[1] as u8)];
                }
            }
        }
        for level in 1..N_LEVELS {
            let [finer, coarser] = &mut self.levels[level - 1..=level] else { continue };
            let side = CELLS >> level;
            for (i, highest) in coarser.iter_mut().enumerate() {
                let first = i / side * 4 * side + i % side * 2;
                let [upper, lower] = [&finer[first..first + 2], &finer[first + 2 * side..][..2]];
                *highest = upper[0].max(upper[1]).max(lower[0].max(lower[1]));
            }
        }
    }

    /// Whether anything is as high as that in these columns and rows of cells.
    #[inline(always)]
    fn reaches_above(&self, height: f32, ranges: [[u8; 2]; 2]) -> bool {
        let [columns, rows] = each!(k in 2 => {
            let ([first, last], [from, to]) = (ranges[k], self.occupied[k]);
            usize::from(first.max(from))..usize::from(last.min(to)) + 1
        });
        rows.into_iter()
            .any(|row| columns.clone().any(|column| self.levels[0][row * CELLS + column] > height))
    }

    /// A height above which there is none at texels within these columns and rows, nor at their right and lower neighbours.
    #[inline(always)]
    fn within(&self, [[left, right], [top, bottom]]: [[i32; 2]; 2]) -> f32 {
        // Cells as large as that: at most 2 × 2 of them.
        let reach = (right - left).max(bottom - top) as u32 + 1;
        let bits = (u32::BITS - reach.leading_zeros()).max(CELL.ilog2());
        let Some(level) = self.levels.get((bits - CELL.ilog2()) as usize) else { return f32::MAX };
        let side = SIDE >> bits;
        let at = |column: i32, row: i32| level[(row as usize >> bits) * side + (column as usize >> bits)];
        let upper = at(left, top).max(at(right + 1, top));
        upper.max(at(left, bottom + 1).max(at(right + 1, bottom + 1)))
    }
}

/// The view along the light.
struct Parallel {
    /// Direction to the light in the frame of the mesh that is drawn.
    light_in_mesh: Vec3,
}

/// Texels beyond the map's edges that fit the rasteriser's numbers; nothing in a scene reaches farther, but for the floor.
const GUARD: f32 = 512.0;

impl Lens for Parallel {
    fn draws(&self, instance: &Instance) -> bool {
        instance.casts_shadow()
    }

    fn turn_to(&mut self, light_from_mesh: &Affine, centre: Vec3, radius: f32) -> bool {
        // Facing is kept by cofactors: n' · z' = (C n) · z' = n · (Cᵀ z').
        self.light_in_mesh = normalised(light_from_mesh.normals()[2]);
        let [x, y, _] = light_from_mesh.point(centre);
        let reach = MAP_M / 2.0 + radius * light_from_mesh.stretch();
        x.abs() <= reach && y.abs() <= reach
    }

    #[inline(always)]
    fn project<S: Simd>(&self, [x, y, z]: &Vectors<S>) -> Projected<S> {
        let (scale, middle) = (S::F::all(TEXELS_PER_M * 256.0), S::F::all((SIDE * 128) as f32));
        Projected { x: x.mul_add(scale, middle).rounded(), y: y.mul_add(scale, middle).rounded(), depth: *z }
    }

    #[inline(always)]
    fn unfit<S: Simd>(&self, [x, y, _]: &Vectors<S>) -> Unfit<S> {
        let reach = S::F::all((SIDE as f32 / 2.0 + GUARD) / TEXELS_PER_M);
        let opposite = S::F::all(0.0) - reach;
        let far = x.gt(reach) | opposite.gt(*x) | y.gt(reach) | opposite.gt(*y);
        Unfit { hidden: far, unfit: far }
    }

    #[inline(always)]
    fn misses<S: Simd>(&self, bounds: &Bounds, [x, y, _]: &Vectors<S>, radius: S::F) -> u16 {
        let reach = radius + S::F::all(MAP_M / 2.0);
        let opposite = S::F::all(0.0) - reach;
        let outside = x.gt(reach) | opposite.gt(*x) | y.gt(reach) | opposite.gt(*y);
        // A cluster all of whose normals are within 90° of the light's direction has no back face.
        let [l, m, n] = each!(k in 3 => S::F::load(&bounds.axis[k]) * S::F::all(self.light_in_mesh[k]));
        let facing = (l + m + n).gt(S::F::load(&bounds.cutoff));
        (outside | facing).to_bits()
    }

    #[inline(always)]
    fn clip<S: Simd, B: Block>(&self, _triangle: [Vec3; 3], _id: i32, _visibility: &mut Visibility) {}
}
