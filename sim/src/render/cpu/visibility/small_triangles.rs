//! TriangleSetups of a few pixels, sixteen at a time: what each of them has of each tile is listed first and drawn then, so that a
//! processor need not guess at every triangle how many tiles there are.

use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::{F32x16, FloatLike, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask};
use crate::render::cpu::visibility::raster::{DepthPlane, Visibility, VisibilityTarget, write_tile};
use crate::render::cpu::visibility::tile::TileLayout;

/// Greatest extent of a small triangle along an axis in 1/256 px: edge functions then fit 32 bits, their steps 16.
pub(in crate::render::cpu) const SMALL_EXTENT: i32 = 1 << 14;

/// Sixteen triangles no larger than [`SMALL_EXTENT`], ready to be drawn.
pub(in crate::render::cpu) struct SmallTriangles<S: Simd> {
    /// Which of them are there; the others' numbers mean nothing.
    pub(in crate::render::cpu) present: S::M,
    /// Edge functions at the first tile's first pixel: not negative on the inner side. In units of 256/256² pixel²:
    /// pixel centres are whole pixels apart, so the part below such a unit never decides and is shifted out.
    pub(in crate::render::cpu) edges: [S::I; 3],
    /// Their changes per pixel to the right in the lower 16 bits, downwards in the upper ones.
    pub(in crate::render::cpu) steps: [S::I; 3],
    /// Depth at the first tile's first pixel.
    pub(in crate::render::cpu) depth: S::F,
    /// Change of depth per pixel to the right.
    pub(in crate::render::cpu) depth_dx: S::F,
    /// Change of depth per pixel downwards.
    pub(in crate::render::cpu) depth_dy: S::F,
    /// Least depth of a corner.
    pub(in crate::render::cpu) depth_least: S::F,
    /// Greatest depth of a corner.
    pub(in crate::render::cpu) depth_greatest: S::F,
    /// The first tile.
    pub(in crate::render::cpu) tile: S::I,
    /// How many columns and rows of tiles it light_bounds on.
    pub(in crate::render::cpu) more: [S::I; 2],
}

/// What tiles have of sixteen small triangles.
pub(in crate::render::cpu) struct TileBins {
    /// How many there are.
    n: usize,
    /// How many lines of the following are in use.
    n_lines: usize,
    /// Where to find each one's numbers, counted over all lines; the last vector may be written past the last of them.
    list: [i32; BIN_ENTRIES + N_LANES],
    /// Edge functions at the tile's first pixel, by edge and triangle.
    edges: [[I32x16; MAX_TILES_PER_TRIANGLE]; 3],
    /// Depth there.
    depths: [F32x16; MAX_TILES_PER_TRIANGLE],
    /// The tile.
    tiles: [I32x16; MAX_TILES_PER_TRIANGLE],
    triangles: TriangleSetups,
}

/// Blocks per triangle that are listed at a time.
const MAX_TILES_PER_TRIANGLE: usize = 16;
const BIN_ENTRIES: usize = MAX_TILES_PER_TRIANGLE * N_LANES;

/// What is the same in all tiles of sixteen small triangles: see [`SmallTriangles`].
struct TriangleSetups {
    steps: [I32x16; 3],
    depth_dx: F32x16,
    depth_dy: F32x16,
    depth_least: F32x16,
    depth_greatest: F32x16,
    ids: I32x16,
}

/// A tile's share of a small triangle, per lane.
#[derive(Clone, Copy)]
struct BinEntry<S: Simd> {
    edges: [S::I; 3],
    depth: S::F,
    tile: S::I,
}

impl TileBins {
    /// None.
    pub(in crate::render::cpu) const fn new() -> Self {
        Self {
            n: 0,
            n_lines: 0,
            list: [0; BIN_ENTRIES + N_LANES],
            edges: [[I32x16::ZERO; MAX_TILES_PER_TRIANGLE]; 3],
            depths: [F32x16::ZERO; MAX_TILES_PER_TRIANGLE],
            tiles: [I32x16::ZERO; MAX_TILES_PER_TRIANGLE],
            triangles: TriangleSetups {
                steps: [I32x16::ZERO; 3],
                depth_dx: F32x16::ZERO,
                depth_dy: F32x16::ZERO,
                depth_least: F32x16::ZERO,
                depth_greatest: F32x16::ZERO,
                ids: I32x16::ZERO,
            },
        }
    }

    /// Goes to other triangles.
    #[inline(always)]
    fn start<S: Simd>(&mut self, small: &SmallTriangles<S>, first_id: i32) {
        let triangles = &mut self.triangles;
        for (steps, line) in small.steps.iter().zip(&mut triangles.steps) {
            steps.store(line);
        }
        small.depth_dx.store(&mut triangles.depth_dx);
        small.depth_dy.store(&mut triangles.depth_dy);
        small.depth_least.store(&mut triangles.depth_least);
        small.depth_greatest.store(&mut triangles.depth_greatest);
        (S::I::load(&I32x16::INDICES) + S::I::splat(first_id)).store(&mut triangles.ids);
    }

    /// Lists those lanes that are kept.
    #[inline(always)]
    fn push<S: Simd>(&mut self, share: &BinEntry<S>, keep: S::M) {
        let line = self.n_lines % MAX_TILES_PER_TRIANGLE;
        for (edge, lines) in share.edges.iter().zip(&mut self.edges) {
            edge.store(&mut lines[line]);
        }
        share.depth.store(&mut self.depths[line]);
        share.tile.store(&mut self.tiles[line]);
        let places = S::I::load(&I32x16::INDICES) + S::I::splat((line * N_LANES) as i32);
        let (to, _) =
            self.list[self.n..].split_first_chunk_mut().expect("room for a vector behind the last one");
        self.n += S::compress(places, keep, to);
        self.n_lines = line + 1;
    }
}

/// Lines' numbers in a row.
#[inline(always)]
fn flat(lines: &[I32x16; MAX_TILES_PER_TRIANGLE]) -> &[i32; BIN_ENTRIES] {
    bytemuck::cast_ref(lines)
}

impl Visibility {
    /// Draws sixteen small triangles.
    #[inline(always)]
    pub(in crate::render::cpu) fn rasterize_small<S: Simd, B: TileLayout>(
        &mut self,
        small: &SmallTriangles<S>,
        first_id: i32,
        bins: &mut TileBins,
    ) {
        let whole = S::I::splat;
        bins.start::<S>(small, first_id);
        let changes = each!(k in 3 => [small.steps[k].shl::<16>().shr_arithmetic::<16>(), small.steps[k].shr_arithmetic::<16>()]);
        let right = each!(k in 3 => times::<S>(changes[k][0], B::WIDTH));
        let down = each!(k in 3 => times::<S>(changes[k][1], B::HEIGHT));
        // From a tile's first pixel to where an edge function is greatest.
        let most = each!(k in 3 => {
            let [x, y] = each!(axis in 2 => changes[k][axis].max(whole(0)));
            times::<S>(x, B::WIDTH - 1) + times::<S>(y, B::HEIGHT - 1)
        });
        let depth_right = small.depth_dx * S::F::splat(B::WIDTH as f32);
        let depth_down = small.depth_dy * S::F::splat(B::HEIGHT as f32);
        let [more_x, more_y] = small.more;
        let [last_x, last_y] =
            each!(axis in 2 => small.more[axis].select_or(small.present, whole(0)).reduce_max());
        let mut row: BinEntry<S> = BinEntry { edges: small.edges, depth: small.depth, tile: small.tile };
        for y in 0..last_y + 1 {
            let in_row = small.present.and_not(whole(y).gt(more_y));
            let mut share = row;
            for x in 0..last_x + 1 {
                let [a, b, c] = each!(k in 3 => share.edges[k] + most[k]);
                let reached = (a | b | c).gt(whole(-1)) & in_row.and_not(whole(x).gt(more_x));
                bins.push(&share, reached);
                if bins.n_lines == MAX_TILES_PER_TRIANGLE {
                    self.flush_bins::<S, B>(bins);
                }
                share.edges = each!(k in 3 => share.edges[k] + right[k]);
                share.depth = share.depth + depth_right;
                share.tile = share.tile + whole(1);
            }
            row.edges = each!(k in 3 => row.edges[k] + down[k]);
            row.depth = row.depth + depth_down;
            row.tile = row.tile + whole(self.side >> B::WIDTH_BITS);
        }
        self.flush_bins::<S, B>(bins);
    }

    /// Draws what tiles have of small triangles.
    #[inline(always)]
    fn flush_bins<S: Simd, B: TileLayout>(&mut self, bins: &mut TileBins) {
        let mut pixels = VisibilityTarget::of::<B>(self);
        let offsets = S::I::load(&B::XY);
        let TileBins { n, n_lines, list, edges, depths, tiles, triangles } = bins;
        let edges = each!(k in 3 => flat(&edges[k]));
        let (depths, tiles): (&[f32; BIN_ENTRIES], _) = (bytemuck::cast_ref(&*depths), flat(tiles));
        for share in &list[..*n] {
            let share = *share as usize % BIN_ENTRIES;
            let lane = share % N_LANES;
            // First of all, lest the numbers below be kept in other registers while it is seen whether there is such a tile.
            let here = pixels.at::<B>(tiles[share] as usize);
            let [a, b, c] = each!(k in 3 =>
                S::I::splat(triangles.steps[k].0[lane]).dot_i16(offsets) + S::I::splat(edges[k][share]));
            let plane = DepthPlane::<S>::new::<B>(
                [triangles.depth_dx.0[lane], triangles.depth_dy.0[lane]],
                [triangles.depth_least.0[lane], triangles.depth_greatest.0[lane]],
            );
            let covered = (a | b | c).gt(S::I::splat(-1));
            write_tile::<S>(here, covered, plane.at(depths[share]), S::I::splat(triangles.ids.0[lane]));
        }
        (*n, *n_lines) = (0, 0);
    }
}

/// Product with a tile's extent or the last place in it.
#[inline(always)]
fn times<S: Simd>(x: S::I, factor: i32) -> S::I {
    match factor {
        3 => x + x + x,
        4 => x.shl::<2>(),
        _ => x.mul(S::I::splat(factor)),
    }
}
