//! Which triangle each pixel sees: exact coverage in integers, the nearest by depth.
//!
//! Depth stands for what the greater is, the nearer: 1/z in pictures, height along the light in shadow maps.

use core::marker::PhantomData;

use ipc_types::EXTERNAL_SIDE;

use super::each::each;
use super::isa::Kernel;
use super::kind::Block;
use super::simd::{Floats, Line, Mask, N_LANES, Number, Simd, Whole, WholeLine};

/// Blocks of the largest picture.
pub(super) const MAX_BLOCKS: usize = EXTERNAL_SIDE * EXTERNAL_SIDE / N_LANES;
/// No triangle.
pub(super) const NOTHING: i32 = -1;

/// A corner of a triangle on the image.
#[derive(Clone, Copy)]
pub(super) struct Corner {
    /// 1/256 pixel from the left edge, between about ±2¹⁸.
    pub(super) x: i32,
    /// 1/256 pixel from the upper edge.
    pub(super) y: i32,
    /// Depth.
    pub(super) depth: f32,
}

/// The nearest triangle of every pixel, block by block, rows of blocks from the top.
pub(super) struct Visibility {
    /// Pixels along each edge.
    pub(super) side: i32,
    /// Depth of the nearest.
    pub(super) depths: Vec<Line>,
    /// What was drawn there, or [`NOTHING`]; empty for a block kind without ids.
    pub(super) ids: Vec<WholeLine>,
    /// 1 where anything was drawn in a block, seen or not; none for a block kind with ids.
    pub(super) drawn: Vec<u8>,
}

impl Visibility {
    /// No picture yet, and room for one.
    pub(super) fn new() -> Self {
        Self {
            side: 0,
            depths: Vec::with_capacity(MAX_BLOCKS),
            ids: Vec::with_capacity(MAX_BLOCKS),
            drawn: Vec::with_capacity(MAX_BLOCKS),
        }
    }

    /// Draws sixteen small triangles.
    #[inline(always)]
    pub(super) fn draw_small<S: Simd, B: Block>(
        &mut self,
        small: &Small<S>,
        first_id: i32,
        shares: &mut Shares,
    ) {
        let whole = S::I::all;
        shares.start::<S>(small, first_id);
        let changes = each!(k in 3 => [small.steps[k].shl::<16>().sar::<16>(), small.steps[k].sar::<16>()]);
        let right = each!(k in 3 => times::<S>(changes[k][0], B::WIDTH));
        let down = each!(k in 3 => times::<S>(changes[k][1], B::HEIGHT));
        // From a block's first pixel to where an edge function is greatest.
        let most = each!(k in 3 => {
            let [x, y] = each!(axis in 2 => changes[k][axis].max(whole(0)));
            times::<S>(x, B::WIDTH - 1) + times::<S>(y, B::HEIGHT - 1)
        });
        let depth_right = small.depth_dx * S::F::all(B::WIDTH as f32);
        let depth_down = small.depth_dy * S::F::all(B::HEIGHT as f32);
        let [more_x, more_y] = small.more;
        let last = |more: S::I| more.or_where(small.present, whole(0)).greatest();
        let (last_x, last_y) = (last(more_x), last(more_y));
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
                S::I::all(triangles.steps[k].0[lane]).dot_halves(offsets) + S::I::all(edges[k][share]));
            let plane = DepthPlane::<S>::new::<B>(
                [triangles.depth_dx.0[lane], triangles.depth_dy.0[lane]],
                [triangles.depth_least.0[lane], triangles.depth_greatest.0[lane]],
            );
            let covered = (a | b | c).gt(S::I::all(-1));
            put::<S>(here, covered, plane.at(depths[share]), S::I::all(triangles.ids.0[lane]));
        }
        (*n, *n_lines) = (0, 0);
    }

    /// Draws a triangle of any size; nothing if it is seen from behind.
    #[inline(always)]
    pub(super) fn draw_large<S: Simd, B: Block>(&mut self, corners: &[Corner; 3], id: i32) {
        let Some(large) = Large::new::<B>(corners, self.side) else {
            return;
        };
        let plane = DepthPlane::<S>::new::<B>(
            [large.depth_dx, large.depth_dy],
            [large.depth_least, large.depth_greatest],
        );
        let (columns, rows) = (S::I::load(&B::X), S::I::load(&B::Y));
        let steps = each!(k in 3 => {
            let edge = &large.edges[k];
            S::I::all(edge.dx).times(columns) + S::I::all(edge.dy).times(rows)
        });
        let pitch = self.side >> B::WIDTH_BITS;
        let mut pixels = Pixels::of::<B>(self);
        let id = S::I::all(id);
        let least = large.edges.map(|edge| edge.least_change::<B>());
        for y in large.from_y..large.to_y + 1 {
            let (from_x, to_x) = large.span::<B>(y);
            let (first_px, py) = (from_x << B::WIDTH_BITS, y << B::HEIGHT_BITS);
            let mut at = large.edges.map(|edge| edge.at(first_px, py));
            let mut first_depth = large.depth_at(first_px, py);
            for x in from_x..to_x + 1 {
                let (first, depth) = (at, plane.at(first_depth));
                at = each!(k in 3 => at[k].wrapping_add(large.edges[k].dx << B::WIDTH_BITS));
                first_depth += plane.right;
                let inside = (first[0] + least[0]) | (first[1] + least[1]) | (first[2] + least[2]);
                let covered = if inside >= 0 {
                    S::M::from_bits(u16::MAX)
                } else {
                    let [a, b, c] = each!(k in 3 => S::I::all(first[k]) + steps[k]);
                    (a | b | c).gt(S::I::all(-1))
                };
                put::<S>(pixels.at::<B>((y * pitch + x) as usize), covered, depth, id);
            }
        }
    }
}

/// Begins a square picture.
pub(super) struct Begin<'a, B> {
    pub(super) visibility: &'a mut Visibility,
    pub(super) side: usize,
    pub(super) behind: Behind<'a>,
    pub(super) blocks: PhantomData<B>,
}

/// What there is before anything is drawn.
pub(super) enum Behind<'a> {
    /// Nothing, and nothing at or below this depth will be seen.
    Nothing(f32),
    /// Something at these depths.
    Depths(&'a [Line]),
}

impl<B: Block> Kernel for Begin<'_, B> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { visibility: Visibility { side, depths, ids, drawn }, .. } = self;
        assert!(
            self.side.is_multiple_of(B::WIDTH as usize) && self.side.is_multiple_of(B::HEIGHT as usize),
            "side {}",
            self.side
        );
        let n_blocks = (self.side * self.side) >> (B::WIDTH_BITS + B::HEIGHT_BITS);
        *side = self.side as i32;
        match self.behind {
            Behind::Nothing(least) => fill(depths, n_blocks, Line([least; N_LANES])),
            Behind::Depths(behind) => {
                depths.clear();
                depths.extend_from_slice(behind);
            }
        }
        fill(drawn, if B::WITH_IDS { 0 } else { n_blocks }, 0);
        fill(ids, if B::WITH_IDS { n_blocks } else { 0 }, WholeLine([NOTHING; N_LANES]));
    }
}

/// So many lines, all of them like this one.
#[inline(always)]
fn fill<T: Copy>(lines: &mut Vec<T>, n: usize, line: T) {
    lines.truncate(n);
    for old in lines.iter_mut() {
        *old = line;
    }
    lines.resize(n, line);
}

/// What is drawn into.
struct Pixels<'a> {
    depths: &'a mut [Line],
    ids: &'a mut [WholeLine],
    drawn: &'a mut [u8],
}

/// One block of it: depths, and ids if it has any.
type Here<'a> = (&'a mut Line, Option<&'a mut WholeLine>);

impl<'a> Pixels<'a> {
    fn of<B: Block>(visibility: &'a mut Visibility) -> Self {
        let Visibility { depths, ids, drawn, .. } = visibility;
        // One length, so that one look tells whether a block is there.
        let n = depths.len();
        let (ids, drawn): (&mut [_], &mut [_]) =
            if B::WITH_IDS { (&mut ids[..n], &mut []) } else { (&mut [], &mut drawn[..n]) };
        Self { depths, ids, drawn }
    }

    #[inline(always)]
    fn at<B: Block>(&mut self, block: usize) -> Here<'_> {
        if !B::WITH_IDS {
            self.drawn[block] = 1;
        }
        let ids = if B::WITH_IDS { Some(&mut self.ids[block]) } else { None };
        (&mut self.depths[block], ids)
    }
}

/// Draws one block's share of a triangle.
#[inline(always)]
fn put<S: Simd>((depths, ids): Here<'_>, covered: S::M, depth: S::F, id: S::I) {
    let depth = depth.or_where(covered, S::F::all(f32::NEG_INFINITY));
    let before = S::F::load(depths);
    let seen = depth.gt(before);
    // Not the blend by `seen` that it is: compilers would write some lanes only, and what follows such a store closely waits
    // until it has reached the cache.
    depth.max(before).store(depths);
    if let Some(ids) = ids {
        id.or_where(seen, S::I::load(ids)).store(ids);
    }
}

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

/// What blocks have of sixteen small triangles: listed first and drawn then, so that a processor need not guess at every
/// triangle how many blocks there are.
pub(super) struct Shares {
    /// How many there are.
    n: usize,
    /// How many lines of the following are in use.
    n_lines: usize,
    /// Where to find each one's numbers, counted over all lines; the last vector may be written past the last of them.
    list: [i32; SHARES + N_LANES],
    /// Edge functions at the block's first pixel, by edge and triangle.
    edges: [[WholeLine; MAX_SHARES]; 3],
    /// Depth there.
    depths: [Line; MAX_SHARES],
    /// The block.
    blocks: [WholeLine; MAX_SHARES],
    triangles: Triangles,
}

/// Blocks per triangle that are listed at a time.
const MAX_SHARES: usize = 16;
const SHARES: usize = MAX_SHARES * N_LANES;

/// What is the same in all blocks of sixteen small triangles: see [`Small`].
struct Triangles {
    steps: [WholeLine; 3],
    depth_dx: Line,
    depth_dy: Line,
    depth_least: Line,
    depth_greatest: Line,
    ids: WholeLine,
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
            edges: [[WholeLine::ZERO; MAX_SHARES]; 3],
            depths: [Line::ZERO; MAX_SHARES],
            blocks: [WholeLine::ZERO; MAX_SHARES],
            triangles: Triangles {
                steps: [WholeLine::ZERO; 3],
                depth_dx: Line::ZERO,
                depth_dy: Line::ZERO,
                depth_least: Line::ZERO,
                depth_greatest: Line::ZERO,
                ids: WholeLine::ZERO,
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
        (S::I::load(&WholeLine::NUMBERS) + S::I::all(first_id)).store(&mut triangles.ids);
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
        let places = S::I::load(&WholeLine::NUMBERS) + S::I::all((line * N_LANES) as i32);
        let (to, _) =
            self.list[self.n..].split_first_chunk_mut().expect("room for a vector behind the last one");
        self.n += S::compress(places, keep, to);
        self.n_lines = line + 1;
    }
}

/// Lines' numbers in a row.
#[inline(always)]
fn flat(lines: &[WholeLine; MAX_SHARES]) -> &[i32; SHARES] {
    bytemuck::cast_ref(lines)
}

/// Depth over a block, held within the triangle's own range where it is steep.
struct DepthPlane<S: Simd> {
    offsets: S::F,
    least: S::F,
    greatest: S::F,
    /// Change from a block to the next one.
    right: f32,
}

impl<S: Simd> DepthPlane<S> {
    #[inline(always)]
    fn new<B: Block>([dx, dy]: [f32; 2], [least, greatest]: [f32; 2]) -> Self {
        let across = S::F::all(dx) * S::F::load(&B::X_FLOATS);
        Self {
            offsets: S::F::all(dy).mul_add(S::F::load(&B::Y_FLOATS), across),
            least: S::F::all(least),
            greatest: S::F::all(greatest),
            right: dx * B::WIDTH as f32,
        }
    }

    /// Over a block whose first pixel has this depth.
    #[inline(always)]
    fn at(&self, first: f32) -> S::F {
        (S::F::all(first) + self.offsets).max(self.least).min(self.greatest)
    }
}

/// Product with a block's extent or the last place in it.
#[inline(always)]
fn times<S: Simd>(x: S::I, factor: i32) -> S::I {
    match factor {
        3 => x + x + x,
        4 => x.shl::<2>(),
        _ => x.times(S::I::all(factor)),
    }
}

/// A triangle of any size, ready to be drawn.
struct Large {
    edges: [Edge; 3],
    first: Corner,
    depth_dx: f32,
    depth_dy: f32,
    depth_least: f32,
    depth_greatest: f32,
    /// First and last column and row of blocks.
    from_x: i32,
    to_x: i32,
    from_y: i32,
    to_y: i32,
}

/// An edge function at pixel centres, in the units of [`Small::edges`].
#[derive(Clone, Copy)]
struct Edge {
    /// At the centre of pixel (0, 0).
    origin: i32,
    dx: i32,
    dy: i32,
}

impl Large {
    /// `None` if the corners run the other way round or no pixel centre is near.
    #[inline(always)]
    fn new<B: Block>([p, q, r]: &[Corner; 3], side: i32) -> Option<Self> {
        let (qx, qy) = (i64::from(q.x - p.x), i64::from(q.y - p.y));
        let (rx, ry) = (i64::from(r.x - p.x), i64::from(r.y - p.y));
        let area = qx * ry - rx * qy;
        if area <= 0 {
            return None;
        }
        // Pixel i has its centre at 256 i + 128.
        let first = |a: i32, b: i32, c: i32| ((a.min(b).min(c) + 127) >> 8).max(0);
        let last = |a: i32, b: i32, c: i32| ((a.max(b).max(c) - 128) >> 8).min(side - 1);
        let (from_x, to_x) = (first(p.x, q.x, r.x), last(p.x, q.x, r.x));
        let (from_y, to_y) = (first(p.y, q.y, r.y), last(p.y, q.y, r.y));
        if from_x > to_x || from_y > to_y {
            return None;
        }
        let (q_rise, r_rise) = (q.depth - p.depth, r.depth - p.depth);
        // Per pixel, hence the 256.
        let scale = 256.0 / area as f32;
        Some(Self {
            edges: [Edge::new(p, q), Edge::new(q, r), Edge::new(r, p)],
            first: *p,
            depth_dx: (q_rise * ry as f32 - r_rise * qy as f32) * scale,
            depth_dy: (r_rise * qx as f32 - q_rise * rx as f32) * scale,
            depth_least: p.depth.min(q.depth).min(r.depth),
            depth_greatest: p.depth.max(q.depth).max(r.depth),
            from_x: from_x >> B::WIDTH_BITS,
            to_x: to_x >> B::WIDTH_BITS,
            from_y: from_y >> B::HEIGHT_BITS,
            to_y: to_y >> B::HEIGHT_BITS,
        })
    }

    /// First and last block of a row that the triangle may reach into: near enough, the edge functions decide.
    #[inline(always)]
    fn span<B: Block>(&self, block_row: i32) -> (i32, i32) {
        let (mut from, mut to) = (self.from_x << B::WIDTH_BITS, self.to_x << B::WIDTH_BITS | (B::WIDTH - 1));
        for edge in &self.edges {
            // The row of pixels on which the inner side reaches farthest.
            let y = (block_row << B::HEIGHT_BITS) + if edge.dy > 0 { B::HEIGHT - 1 } else { 0 };
            let crossing = -edge.at(0, y) as f32 / edge.dx as f32;
            if edge.dx > 0 {
                from = from.max(crossing as i32 - 1);
            } else if edge.dx < 0 {
                to = to.min(crossing as i32 + 1);
            }
        }
        (from >> B::WIDTH_BITS, to >> B::WIDTH_BITS)
    }

    /// Depth at a pixel's centre.
    #[inline(always)]
    fn depth_at(&self, x: i32, y: i32) -> f32 {
        let from_first = |px: i32, corner: i32| px as f32 + (128 - corner) as f32 / 256.0;
        let across = self.depth_dx.mul_add(from_first(x, self.first.x), self.first.depth);
        self.depth_dy.mul_add(from_first(y, self.first.y), across)
    }
}

impl Edge {
    #[inline(always)]
    fn new(p: &Corner, q: &Corner) -> Self {
        let (dx, dy) = (q.x - p.x, q.y - p.y);
        // A centre on the edge belongs to the triangle if the edge is at its top or left.
        let bias = i64::from(!(dy < 0 || (dy == 0 && dx > 0)));
        let origin = i64::from(dx) * i64::from(128 - p.y) - i64::from(dy) * i64::from(128 - p.x) - bias;
        Self { origin: (origin >> 8) as i32, dx: -dy, dy: dx }
    }

    /// Least difference between a pixel of a block and the block's first one.
    #[inline(always)]
    fn least_change<B: Block>(&self) -> i32 {
        (self.dx * (B::WIDTH - 1)).min(0) + (self.dy * (B::HEIGHT - 1)).min(0)
    }

    #[inline(always)]
    fn at(&self, x: i32, y: i32) -> i32 {
        self.origin + self.dx * x + self.dy * y
    }
}
