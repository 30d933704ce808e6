//! Shadows of the first sun: a map of heights along its light, and looking up whether a point is reached.

use core::marker::PhantomData;

use super::each::each;
use super::geometry::Draw;
use super::isa::{Isa, Kernel};
use super::kind::{Block, Plain, Square};
use super::lens::{Lens, Projected, Unfit, Vectors};
use super::raster::Visibility;
use super::rays::Gaze;
use super::simd::{Floats, Line, Mask, N_LANES, Number, Per, Simd, Whole, WholeLine};
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
pub(super) struct ShadowMap {
    /// `[512, 512]`.
    heights: Vec<f32>,
    highest: Highest,
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
}

impl ShadowMap {
    /// A map without shadows.
    pub(super) fn new() -> Self {
        Self {
            heights: vec![DEPTHS_OF_SPACE; SIDE * SIDE],
            highest: Highest::new(),
            light_from_world: Affine::IDENTITY,
        }
    }

    /// Draws everything that casts a shadow in a scene that has shadows.
    pub(super) fn draw(&mut self, isa: Isa, scene: &RenderScene, snapshot: &Snapshot, relief: &mut Relief) {
        let Some(centre) = scene.shadow_centre else { return };
        self.light_from_world = mirrored(light_from_world(scene.suns[0].towards, centre));
        posed::pose(scene, snapshot, &self.light_from_world, &mut relief.maps);
        if !relief.is_empty {
            relief.blocks.clear::<Plain>(SIDE, DEPTHS_OF_SPACE);
        }
        relief.is_empty = false;
        isa.run(Draw {
            instances: &scene.instances,
            maps: &relief.maps,
            first_ids: &scene.first_id,
            lens: Parallel { light_in_mesh: [0.0; 3] },
            visibility: &mut relief.blocks,
            blocks: PhantomData::<Plain>,
        });
        isa.run(Unfold { blocks: &mut relief.blocks.depths, map: self });
        relief.is_empty = true;
    }

    /// What a camera needs to look points up.
    pub(super) fn seen_from(&self, view_from_world: &Affine) -> Shadow<'_> {
        let mut texel_from_view = self.light_from_world.after(&view_from_world.rigid_inverse());
        for axis in 0..2 {
            texel_from_view.linear[axis] = scaled(texel_from_view.linear[axis], TEXELS_PER_M);
            // From texels' corners to their middles.
            texel_from_view.offset[axis] =
                texel_from_view.offset[axis] * TEXELS_PER_M + (SIDE as f32 / 2.0 - 0.5);
        }
        Shadow { heights: bytemuck::cast_slice(&self.heights), highest: &self.highest, texel_from_view }
    }
}

/// Moves a relief into a map, and leaves it empty.
struct Unfold<'a> {
    blocks: &'a mut [Line],
    map: &'a mut ShadowMap,
}

impl Kernel for Unfold<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        const PER_ROW: usize = SIDE / Plain::WIDTH as usize;
        let Self { blocks, map } = self;
        for cell in 0..CELLS * CELLS {
            let (column, row) = (cell % CELLS, cell / CELLS);
            let upper = row * 2 * PER_ROW + column * 2;
            let places = [upper, upper + 1, upper + PER_ROW, upper + PER_ROW + 1];
            let [a, b, c, d] = each!(k in 4 => S::F::load(&blocks[places[k]]));
            let greatest = a.max(b).max(c.max(d));
            let is_empty = !greatest.gt(S::F::all(DEPTHS_OF_SPACE)).any();
            // Most cells are empty in one picture after the other.
            if is_empty && map.highest.0[0][cell] == DEPTHS_OF_SPACE {
                continue;
            }
            let mut line = Line::ZERO;
            greatest.store(&mut line);
            map.highest.0[0][cell] = line.0.into_iter().fold(DEPTHS_OF_SPACE, f32::max);
            for (k, place) in places.into_iter().enumerate() {
                let first = (row * CELL + k / 2 * 4) * SIDE + column * CELL + k % 2 * 4;
                for y in 0..4 {
                    let from = &blocks[place].0[y * 4..y * 4 + 4];
                    map.heights[first + y * SIDE..][..4].copy_from_slice(from);
                }
                blocks[place] = Line([DEPTHS_OF_SPACE; N_LANES]);
            }
        }
        map.highest.coarsen();
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
        let z = S::F::all(1.0) / gaze.depth;
        let [dx, dy] = gaze.d;
        let [x, y, height] = each!(i in 3 => {
            let [a, b, c] = self.texel_from_view.linear[i];
            let along = dx.mul_add(S::F::all(a), dy.mul_add(S::F::all(b), S::F::all(c)));
            let aside = normal[0].mul_add(N::all(a), normal[1].mul_add(N::all(b), normal[2] * N::all(c)));
            let offset = aside.mul_add(N::all(OFF_SURFACE_M), N::all(self.texel_from_view.offset[i]));
            z.mul_add(along, offset.spread())
        });
        let (zero, last) = (S::F::all(0.0), S::F::all((SIDE - 1) as f32));
        let outside = zero.gt(x) | x.gt(last) | zero.gt(y) | y.gt(last);
        if outside.to_bits() == u16::MAX {
            return None;
        }
        let limit = S::F::all((SIDE - 2) as f32);
        let at = [x.max(zero).min(limit).truncated(), y.max(zero).min(limit).truncated()];
        let ranges = if is_plane {
            let mut lines = [WholeLine::ZERO; 2];
            at[0].store(&mut lines[0]);
            at[1].store(&mut lines[1]);
            each!(k in 2 => Square::range_of_corners(&lines[k], (SIDE - 2) as i32))
        } else {
            each!(k in 2 => at[k].range())
        };
        // All in the light?
        if !S::F::all(self.highest.within(ranges)).gt(height).any() {
            return None;
        }
        let [fx, fy] = each!(k in 2 => [x, y][k] - at[k].floats());
        let corner = each!(k in 2 => ranges[k][0].min((SIDE - 8) as i32));
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

/// The greatest heights of cells of 8 × 8 texels, row by row, then of cells of 16 × 16 and so on.
struct Highest([Vec<f32>; N_LEVELS]);

/// Levels down to 2 × 2 cells.
const N_LEVELS: usize = CELLS.ilog2() as usize;

impl Highest {
    fn new() -> Self {
        Self(core::array::from_fn(|level| vec![DEPTHS_OF_SPACE; (CELLS >> level).pow(2)]))
    }

    /// Fills all levels but the finest.
    fn coarsen(&mut self) {
        for level in 1..N_LEVELS {
            let [finer, coarser] = &mut self.0[level - 1..=level] else { continue };
            let side = CELLS >> level;
            for (i, highest) in coarser.iter_mut().enumerate() {
                let first = i / side * 4 * side + i % side * 2;
                let [upper, lower] = [&finer[first..first + 2], &finer[first + 2 * side..][..2]];
                *highest = upper[0].max(upper[1]).max(lower[0].max(lower[1]));
            }
        }
    }

    /// A height above which there is none at texels within these columns and rows, nor at their right and lower neighbours.
    #[inline(always)]
    fn within(&self, [[left, right], [top, bottom]]: [[i32; 2]; 2]) -> f32 {
        // Cells as large as that: at most 2 × 2 of them.
        let reach = (right - left).max(bottom - top) as u32 + 1;
        let bits = (u32::BITS - reach.leading_zeros()).max(CELL.ilog2());
        let Some(level) = self.0.get((bits - CELL.ilog2()) as usize) else { return f32::MAX };
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
