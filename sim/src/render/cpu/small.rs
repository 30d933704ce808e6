//! Triangles of a few pixels, sixteen at a time: what each of them has of each block is listed first and drawn then, so that a
//! processor need not guess at every triangle how many blocks there are.

use super::each::each;
use super::kind::Block;
use super::raster::{DepthPlane, Pixels, Visibility, put};
use super::simd::{F32x16, FloatLike, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask};

/// Greatest extent of a small triangle along an axis in 1/256 px: edge functions then fit 32 bits, their steps 16.
pub(super) const SMALL_REACH: i32 = 1 << 14;

/// Sixteen triangles no larger than [`SMALL_REACH`], ready to be drawn.
pub(super) struct Small<S: Simd> {
    /// Which of them are there; the others' numbers mean nothing.
    pub(super) present: S::M,
    /// Edge functions at the first block's first pixel: not negative on the inner side. In units of 256/256² pixel²:
    /// pixel centres are whole pixels apart, so the part below such a unit never decides and is shifted out.
    pub(super) edges: [S::I; 3],
    /// Their changes per pixel to the right in the lower 16 bits, downwards in the upper ones.
    pub(super) steps: [S::I; 3],
    /// Depth at the first block's first pixel.
    pub(super) depth: S::F,
    /// Change of depth per pixel to the right.
    pub(super) depth_dx: S::F,
    /// Change of depth per pixel downwards.
    pub(super) depth_dy: S::F,
    /// Least depth of a corner.
    pub(super) depth_least: S::F,
    /// Greatest depth of a corner.
    pub(super) depth_greatest: S::F,
    /// The first block.
    pub(super) block: S::I,
    /// How many columns and rows of blocks it reaches on.
    pub(super) more: [S::I; 2],
}

/// What blocks have of sixteen small triangles.
pub(super) struct Shares {
    /// How many there are.
    n: usize,
    /// How many lines of the following are in use.
    n_lines: usize,
    /// Where to find each one's numbers, counted over all lines; the last vector may be written past the last of them.
    list: [i32; SHARES + N_LANES],
    /// Edge functions at the block's first pixel, by edge and triangle.
    edges: [[I32x16; MAX_SHARES]; 3],
    /// Depth there.
    depths: [F32x16; MAX_SHARES],
    /// The block.
    blocks: [I32x16; MAX_SHARES],
    triangles: Triangles,
}

/// Blocks per triangle that are listed at a time.
const MAX_SHARES: usize = 16;
const SHARES: usize = MAX_SHARES * N_LANES;

/// What is the same in all blocks of sixteen small triangles: see [`Small`].
struct Triangles {
    steps: [I32x16; 3],
    depth_dx: F32x16,
    depth_dy: F32x16,
    depth_least: F32x16,
    depth_greatest: F32x16,
    ids: I32x16,
}

/// A block's share of a small triangle, per lane.
#[derive(Clone, Copy)]
struct Share<S: Simd> {
    edges: [S::I; 3],
    depth: S::F,
    block: S::I,
}

impl Shares {
    /// None.
    pub(super) const fn new() -> Self {
        Self {
            n: 0,
            n_lines: 0,
            list: [0; SHARES + N_LANES],
            edges: [[I32x16::ZERO; MAX_SHARES]; 3],
            depths: [F32x16::ZERO; MAX_SHARES],
            blocks: [I32x16::ZERO; MAX_SHARES],
            triangles: Triangles {
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
    fn start<S: Simd>(&mut self, small: &Small<S>, first_id: i32) {
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
    fn push<S: Simd>(&mut self, share: &Share<S>, keep: S::M) {
        let line = self.n_lines % MAX_SHARES;
        for (edge, lines) in share.edges.iter().zip(&mut self.edges) {
            edge.store(&mut lines[line]);
        }
        share.depth.store(&mut self.depths[line]);
        share.block.store(&mut self.blocks[line]);
        let places = S::I::load(&I32x16::INDICES) + S::I::splat((line * N_LANES) as i32);
        let (to, _) =
            self.list[self.n..].split_first_chunk_mut().expect("room for a vector behind the last one");
        self.n += S::compress(places, keep, to);
        self.n_lines = line + 1;
    }
}

/// Lines' numbers in a row.
#[inline(always)]
fn flat(lines: &[I32x16; MAX_SHARES]) -> &[i32; SHARES] {
    bytemuck::cast_ref(lines)
}

impl Visibility {
    /// Draws sixteen small triangles.
    #[inline(always)]
    pub(super) fn draw_small<S: Simd, B: Block>(
        &mut self,
        small: &Small<S>,
        first_id: i32,
        shares: &mut Shares,
    ) {
        let whole = S::I::splat;
        shares.start::<S>(small, first_id);
        let changes = each!(k in 3 => [small.steps[k].shl::<16>().shr_arithmetic::<16>(), small.steps[k].shr_arithmetic::<16>()]);
        let right = each!(k in 3 => times::<S>(changes[k][0], B::WIDTH));
        let down = each!(k in 3 => times::<S>(changes[k][1], B::HEIGHT));
        // From a block's first pixel to where an edge function is greatest.
        let most = each!(k in 3 => {
            let [x, y] = each!(axis in 2 => changes[k][axis].max(whole(0)));
            times::<S>(x, B::WIDTH - 1) + times::<S>(y, B::HEIGHT - 1)
        });
        let depth_right = small.depth_dx * S::F::splat(B::WIDTH as f32);
        let depth_down = small.depth_dy * S::F::splat(B::HEIGHT as f32);
        let [more_x, more_y] = small.more;
        let [last_x, last_y] =
            each!(axis in 2 => small.more[axis].select_or(small.present, whole(0)).reduce_max());
        let mut row: Share<S> = Share { edges: small.edges, depth: small.depth, block: small.block };
        for y in 0..last_y + 1 {
            let in_row = small.present.and_not(whole(y).gt(more_y));
            let mut share = row;
            for x in 0..last_x + 1 {
                let [a, b, c] = each!(k in 3 => share.edges[k] + most[k]);
                let reached = (a | b | c).gt(whole(-1)) & in_row.and_not(whole(x).gt(more_x));
                shares.push(&share, reached);
                if shares.n_lines == MAX_SHARES {
                    self.draw_shares::<S, B>(shares);
                }
                share.edges = each!(k in 3 => share.edges[k] + right[k]);
                share.depth = share.depth + depth_right;
                share.block = share.block + whole(1);
            }
            row.edges = each!(k in 3 => row.edges[k] + down[k]);
            row.depth = row.depth + depth_down;
            row.block = row.block + whole(self.side >> B::WIDTH_BITS);
        }
        self.draw_shares::<S, B>(shares);
    }

    /// Draws what blocks have of small triangles.
    #[inline(always)]
    fn draw_shares<S: Simd, B: Block>(&mut self, shares: &mut Shares) {
        let mut pixels = Pixels::of::<B>(self);
        let offsets = S::I::load(&B::XY);
        let Shares { n, n_lines, list, edges, depths, blocks, triangles } = shares;
        let edges = each!(k in 3 => flat(&edges[k]));
        let (depths, blocks): (&[f32; SHARES], _) = (bytemuck::cast_ref(&*depths), flat(blocks));
        for share in &list[..*n] {
            let share = *share as usize % SHARES;
            let lane = share % N_LANES;
            // First of all, lest the numbers below be kept in other registers while it is seen whether there is such a block.
            let here = pixels.at::<B>(blocks[share] as usize);
            let [a, b, c] = each!(k in 3 =>
                S::I::splat(triangles.steps[k].0[lane]).dot_i16(offsets) + S::I::splat(edges[k][share]));
            let plane = DepthPlane::<S>::new::<B>(
                [triangles.depth_dx.0[lane], triangles.depth_dy.0[lane]],
                [triangles.depth_least.0[lane], triangles.depth_greatest.0[lane]],
            );
            let covered = (a | b | c).gt(S::I::splat(-1));
            put::<S>(here, covered, plane.at(depths[share]), S::I::splat(triangles.ids.0[lane]));
        }
        (*n, *n_lines) = (0, 0);
    }
}

/// Product with a block's extent or the last place in it.
#[inline(always)]
fn times<S: Simd>(x: S::I, factor: i32) -> S::I {
    match factor {
        3 => x + x + x,
        4 => x.shl::<2>(),
        _ => x.mul(S::I::splat(factor)),
    }
}
