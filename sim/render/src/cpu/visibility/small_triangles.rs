//! Rasterisation of small triangles, sixteen at a time. All pairs of a triangle and a tile are binned first
//! and rasterised afterwards, which avoids a mispredicted loop exit per triangle.

use crate::cpu::simd::each::each;
use crate::cpu::simd::{F32x16, FloatLike, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask};
use crate::cpu::visibility::raster::{DepthPlane, Visibility, VisibilityTarget, write_tile};
use crate::cpu::visibility::tile::TileLayout;

/// Maximum extent of a small triangle along an axis, in 1/256 px. Edge functions then fit in 32 bits and
/// their steps in 16.
pub(crate) const SMALL_EXTENT: i32 = 1 << 14;

/// Sixteen triangles no larger than [`SMALL_EXTENT`], after set-up.
pub(crate) struct SmallTriangles<S: Simd> {
    /// Valid lanes. The contents of the others are unspecified.
    pub(crate) present: S::M,
    /// Edge functions at the first pixel of the first tile, not negative inside, in units of 256/256² px².
    /// Pixel centres are whole pixels apart, so lower bits never matter and are shifted out.
    pub(crate) edges: [S::I; 3],
    /// Steps of the edge functions per pixel: to the right in the low 16 bits, down in the high 16 bits.
    pub(crate) steps: [S::I; 3],
    /// Depth at the first pixel of the first tile.
    pub(crate) depth: S::F,
    /// Change of depth per pixel to the right.
    pub(crate) depth_dx: S::F,
    /// Change of depth per pixel downwards.
    pub(crate) depth_dy: S::F,
    /// Minimum depth of the corners.
    pub(crate) depth_min: S::F,
    /// Maximum depth of the corners.
    pub(crate) depth_max: S::F,
    /// Index of the first tile.
    pub(crate) tile: S::I,
    /// Number of further columns and rows of tiles in the bounding box.
    pub(crate) more: [S::I; 2],
}

/// The pairs of a tile and a triangle of sixteen small triangles.
pub(crate) struct TileBins {
    /// Number of entries in `list`.
    n: usize,
    /// Number of vectors in use in the following arrays.
    n_vectors: usize,
    /// Index of each entry over all vectors and lanes. The last vector write may extend past the last entry.
    list: [i32; BIN_ENTRIES + N_LANES],
    /// Edge functions at the first pixel of the tile, by edge.
    edges: [[I32x16; MAX_TILES_PER_TRIANGLE]; 3],
    /// Depth at the first pixel of the tile.
    depths: [F32x16; MAX_TILES_PER_TRIANGLE],
    /// Index of the tile.
    tiles: [I32x16; MAX_TILES_PER_TRIANGLE],
    triangles: TriangleSetups,
}

/// Number of tiles per triangle that are binned at a time.
const MAX_TILES_PER_TRIANGLE: usize = 16;
const BIN_ENTRIES: usize = MAX_TILES_PER_TRIANGLE * N_LANES;

/// The tile-independent part of sixteen [`SmallTriangles`].
struct TriangleSetups {
    steps: [I32x16; 3],
    depth_dx: F32x16,
    depth_dy: F32x16,
    depth_min: F32x16,
    depth_max: F32x16,
    ids: I32x16,
}

/// One pair of a tile and a triangle per lane.
#[derive(Clone, Copy)]
struct BinEntry<S: Simd> {
    edges: [S::I; 3],
    depth: S::F,
    tile: S::I,
}

impl TileBins {
    /// Creates empty bins.
    pub(crate) const fn new() -> Self {
        Self {
            n: 0,
            n_vectors: 0,
            list: [0; BIN_ENTRIES + N_LANES],
            edges: [[I32x16::ZERO; MAX_TILES_PER_TRIANGLE]; 3],
            depths: [F32x16::ZERO; MAX_TILES_PER_TRIANGLE],
            tiles: [I32x16::ZERO; MAX_TILES_PER_TRIANGLE],
            triangles: TriangleSetups {
                steps: [I32x16::ZERO; 3],
                depth_dx: F32x16::ZERO,
                depth_dy: F32x16::ZERO,
                depth_min: F32x16::ZERO,
                depth_max: F32x16::ZERO,
                ids: I32x16::ZERO,
            },
        }
    }

    /// Starts binning other triangles.
    #[inline(always)]
    fn start<S: Simd>(&mut self, small: &SmallTriangles<S>, first_id: i32) {
        let triangles = &mut self.triangles;
        for (steps, line) in small.steps.iter().zip(&mut triangles.steps) {
            steps.store(line);
        }
        small.depth_dx.store(&mut triangles.depth_dx);
        small.depth_dy.store(&mut triangles.depth_dy);
        small.depth_min.store(&mut triangles.depth_min);
        small.depth_max.store(&mut triangles.depth_max);
        (S::I::load(&I32x16::INDICES) + S::I::splat(first_id)).store(&mut triangles.ids);
    }

    /// Appends the lanes selected by `keep`.
    #[inline(always)]
    fn push<S: Simd>(&mut self, entry: &BinEntry<S>, keep: S::M) {
        let vector = self.n_vectors % MAX_TILES_PER_TRIANGLE;
        for (edge, lines) in entry.edges.iter().zip(&mut self.edges) {
            edge.store(&mut lines[vector]);
        }
        entry.depth.store(&mut self.depths[vector]);
        entry.tile.store(&mut self.tiles[vector]);
        let places = S::I::load(&I32x16::INDICES) + S::I::splat((vector * N_LANES) as i32);
        let (to, _) =
            self.list[self.n..].split_first_chunk_mut().expect("room for a vector behind the last one");
        self.n += S::compress(places, keep, to);
        self.n_vectors = vector + 1;
    }
}

/// Views an array of vectors as an array of numbers.
#[inline(always)]
fn as_numbers(lines: &[I32x16; MAX_TILES_PER_TRIANGLE]) -> &[i32; BIN_ENTRIES] {
    bytemuck::cast_ref(lines)
}

impl Visibility {
    /// Bins and rasterises sixteen small triangles.
    #[inline(always)]
    pub(crate) fn rasterize_small<S: Simd, B: TileLayout>(
        &mut self,
        small: &SmallTriangles<S>,
        first_id: i32,
        bins: &mut TileBins,
    ) {
        let splat = S::I::splat;
        bins.start::<S>(small, first_id);
        let changes = each!(k in 3 => [small.steps[k].shl::<16>().shr_arithmetic::<16>(), small.steps[k].shr_arithmetic::<16>()]);
        let right = each!(k in 3 => mul_small::<S>(changes[k][0], B::WIDTH));
        let down = each!(k in 3 => mul_small::<S>(changes[k][1], B::HEIGHT));
        // Difference between the maximum of an edge function over a tile and its value at the first pixel.
        let max_change = each!(k in 3 => {
            let [x, y] = each!(axis in 2 => changes[k][axis].max(splat(0)));
            mul_small::<S>(x, B::WIDTH - 1) + mul_small::<S>(y, B::HEIGHT - 1)
        });
        let depth_right = small.depth_dx * S::F::splat(B::WIDTH as f32);
        let depth_down = small.depth_dy * S::F::splat(B::HEIGHT as f32);
        let [more_x, more_y] = small.more;
        let [last_x, last_y] =
            each!(axis in 2 => small.more[axis].select_or(small.present, splat(0)).reduce_max());
        let mut row: BinEntry<S> = BinEntry { edges: small.edges, depth: small.depth, tile: small.tile };
        for y in 0..last_y + 1 {
            let in_row = small.present.and_not(splat(y).gt(more_y));
            let mut entry = row;
            for x in 0..last_x + 1 {
                let [a, b, c] = each!(k in 3 => entry.edges[k] + max_change[k]);
                let overlaps = (a | b | c).gt(splat(-1)) & in_row.and_not(splat(x).gt(more_x));
                bins.push(&entry, overlaps);
                if bins.n_vectors == MAX_TILES_PER_TRIANGLE {
                    self.flush_bins::<S, B>(bins);
                }
                entry.edges = each!(k in 3 => entry.edges[k] + right[k]);
                entry.depth = entry.depth + depth_right;
                entry.tile = entry.tile + splat(1);
            }
            row.edges = each!(k in 3 => row.edges[k] + down[k]);
            row.depth = row.depth + depth_down;
            row.tile = row.tile + splat(self.tiles[0]);
        }
        self.flush_bins::<S, B>(bins);
    }

    /// Rasterises and empties the bins.
    #[inline(always)]
    fn flush_bins<S: Simd, B: TileLayout>(&mut self, bins: &mut TileBins) {
        let mut pixels = VisibilityTarget::of::<B>(self);
        let offsets = S::I::load(&B::XY);
        let TileBins { n, n_vectors, list, edges, depths, tiles, triangles } = bins;
        let edges = each!(k in 3 => as_numbers(&edges[k]));
        let (depths, tiles): (&[f32; BIN_ENTRIES], _) = (bytemuck::cast_ref(&*depths), as_numbers(tiles));
        for entry in &list[..*n] {
            let entry = *entry as usize % BIN_ENTRIES;
            let lane = entry % N_LANES;
            // First, because otherwise the values below have to be spilled across the bounds check.
            let target = pixels.at::<B>(tiles[entry] as usize);
            let [a, b, c] = each!(k in 3 =>
                S::I::splat(triangles.steps[k].0[lane]).dot_i16(offsets) + S::I::splat(edges[k][entry]));
            let plane = DepthPlane::<S>::new::<B>(
                [triangles.depth_dx.0[lane], triangles.depth_dy.0[lane]],
                [triangles.depth_min.0[lane], triangles.depth_max.0[lane]],
            );
            let covered = (a | b | c).gt(S::I::splat(-1));
            write_tile::<S>(target, covered, plane.at(depths[entry]), S::I::splat(triangles.ids.0[lane]));
        }
        (*n, *n_vectors) = (0, 0);
    }
}

/// Returns the product with the extent of a tile or with its last index.
#[inline(always)]
fn mul_small<S: Simd>(x: S::I, factor: i32) -> S::I {
    match factor {
        3 => x + x + x,
        4 => x.shl::<2>(),
        _ => x.mul(S::I::splat(factor)),
    }
}
