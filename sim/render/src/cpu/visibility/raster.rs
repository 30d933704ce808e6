//! Visibility buffer and rasterisation of single triangles: exact coverage in integer arithmetic, nearest
//! triangle by depth.
//!
//! Greater depth means nearer: depth is 1/z in images and the height along the light in shadow maps.

use core::marker::PhantomData;

use crate::cpu::simd::each::each;
use crate::cpu::simd::isa::Kernel;
use crate::cpu::simd::{F32x16, FloatLike, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask};
use crate::cpu::visibility::tile::TileLayout;

/// Id of the background.
pub(crate) const NO_ID: i32 = -1;

/// A projected triangle corner.
#[derive(Clone, Copy)]
pub(crate) struct ScreenVertex {
    /// Distance from the left edge in 1/256 px, within about ±2²⁰ for the largest image.
    pub(crate) x: i32,
    /// Distance from the top edge in 1/256 px.
    pub(crate) y: i32,
    /// Depth; greater is nearer.
    pub(crate) depth: f32,
}

/// Visibility buffer: the nearest triangle of every pixel, tile by tile in row-major order.
pub(crate) struct Visibility {
    /// Number of tiles in a row and in a column.
    pub(crate) tiles: [i32; 2],
    /// Depth of the nearest triangle.
    pub(crate) depths: Vec<F32x16>,
    /// Id of the nearest triangle, or [`NO_ID`]. Empty for tile layouts without ids.
    pub(crate) ids: Vec<I32x16>,
    /// 1 for each tile that any triangle touched, visible or not. Empty for tile layouts with ids.
    pub(crate) drawn: Vec<u8>,
}

impl Visibility {
    /// Creates an empty buffer. It grows to the largest image.
    pub(crate) const fn new() -> Self {
        Self { tiles: [0; 2], depths: Vec::new(), ids: Vec::new(), drawn: Vec::new() }
    }

    /// Returns the numbers of pixel tiles in a row and in a column, for `scale` samples along each edge of a
    /// pixel.
    #[inline(always)]
    pub(crate) fn pixel_tiles(&self, scale: usize) -> [usize; 2] {
        self.tiles.map(|n| n as usize / scale)
    }

    /// Returns the tiles with the samples of a pixel tile, two along each edge of a pixel.
    #[inline(always)]
    pub(crate) fn sample_tiles(&self, column: usize, row: usize) -> [usize; 4] {
        let pitch = self.tiles[0] as usize;
        let upper = row * 2 * pitch + column * 2;
        [upper, upper + 1, upper + pitch, upper + pitch + 1]
    }

    /// Rasterises a triangle of any size. Culls back faces.
    #[inline(always)]
    pub(crate) fn rasterize_large<S: Simd, B: TileLayout>(&mut self, corners: &[ScreenVertex; 3], id: i32) {
        let Some(large) = LargeTriangle::new::<B>(corners, self.tiles) else {
            return;
        };
        let plane =
            DepthPlane::<S>::new::<B>([large.depth_dx, large.depth_dy], [large.depth_min, large.depth_max]);
        let (columns, rows) = (S::I::load(&B::X), S::I::load(&B::Y));
        let steps = each!(k in 3 => {
            let edge = &large.edges[k];
            S::I::splat(edge.dx).mul(columns) + S::I::splat(edge.dy).mul(rows)
        });
        let [pitch, _] = self.tiles;
        let mut pixels = VisibilityTarget::of::<B>(self);
        let id = S::I::splat(id);
        let min_change = large.edges.map(|edge| edge.min_change::<B>());
        for y in large.from_y..large.to_y + 1 {
            let (from_x, to_x) = large.span::<B>(y);
            let (first_px, py) = (from_x << B::WIDTH_BITS, y << B::HEIGHT_BITS);
            let mut at = large.edges.map(|edge| edge.at(first_px, py));
            let mut first_depth = large.depth_at(first_px, py);
            for x in from_x..to_x + 1 {
                let (first, depth) = (each!(k in 3 => at[k].min(FAR_INSIDE) as i32), plane.at(first_depth));
                at = each!(k in 3 => at[k] + i64::from(large.edges[k].dx << B::WIDTH_BITS));
                first_depth += plane.right;
                let inside =
                    (first[0] + min_change[0]) | (first[1] + min_change[1]) | (first[2] + min_change[2]);
                let covered = if inside >= 0 {
                    S::M::from_bits(u16::MAX)
                } else {
                    let [a, b, c] = each!(k in 3 => S::I::splat(first[k]) + steps[k]);
                    (a | b | c).gt(S::I::splat(-1))
                };
                write_tile::<S>(pixels.at::<B>((y * pitch + x) as usize), covered, depth, id);
            }
        }
    }
}

/// Kernel that clears the buffer for an image.
pub(crate) struct ClearVisibility<'a, B> {
    pub(crate) visibility: &'a mut Visibility,
    /// Number of tiles in a row and in a column.
    pub(crate) n_tiles: [usize; 2],
    pub(crate) behind: ClearTo<'a>,
    pub(crate) tiles: PhantomData<B>,
}

/// Initial contents of the depth buffer.
pub(crate) enum ClearTo<'a> {
    /// Background everywhere. Nothing at or below this depth is visible.
    Background(f32),
    /// Surfaces at these depths, rendered before.
    Depths(&'a [F32x16]),
}

impl<B: TileLayout> Kernel for ClearVisibility<'_, B> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { visibility: Visibility { tiles, depths, ids, drawn }, .. } = self;
        *tiles = self.n_tiles.map(|n| n as i32);
        let n_tiles = self.n_tiles[0] * self.n_tiles[1];
        match self.behind {
            ClearTo::Background(depth) => fill(depths, n_tiles, F32x16([depth; N_LANES])),
            ClearTo::Depths(behind) => {
                depths.clear();
                depths.extend_from_slice(behind);
            }
        }
        fill(drawn, if B::WITH_IDS { 0 } else { n_tiles }, 0);
        fill(ids, if B::WITH_IDS { n_tiles } else { 0 }, I32x16([NO_ID; N_LANES]));
    }
}

/// Sets the length to `n` and every element to `value`. [`Vec::resize`] would leave existing elements as they
/// are, and is not compiled for the caller's instruction set.
#[inline(always)]
fn fill<T: Copy>(values: &mut Vec<T>, n: usize, value: T) {
    values.truncate(n);
    for old in values.iter_mut() {
        *old = value;
    }
    values.resize(n, value);
}

/// Mutable view of the visibility buffer for rasterisation.
pub(crate) struct VisibilityTarget<'a> {
    depths: &'a mut [F32x16],
    ids: &'a mut [I32x16],
    drawn: &'a mut [u8],
}

/// One tile of the buffer: its depths, and its ids if the layout has them.
pub(crate) type TileTarget<'a> = (&'a mut F32x16, Option<&'a mut I32x16>);

impl<'a> VisibilityTarget<'a> {
    pub(crate) fn of<B: TileLayout>(visibility: &'a mut Visibility) -> Self {
        let Visibility { depths, ids, drawn, .. } = visibility;
        // Equal lengths, so that a single bounds check covers both slices.
        let n = depths.len();
        let (ids, drawn): (&mut [_], &mut [_]) =
            if B::WITH_IDS { (&mut ids[..n], &mut []) } else { (&mut [], &mut drawn[..n]) };
        Self { depths, ids, drawn }
    }

    #[inline(always)]
    pub(crate) fn at<B: TileLayout>(&mut self, tile: usize) -> TileTarget<'_> {
        if !B::WITH_IDS {
            self.drawn[tile] = 1;
        }
        let ids = if B::WITH_IDS { Some(&mut self.ids[tile]) } else { None };
        (&mut self.depths[tile], ids)
    }
}

/// Depth-tests one tile of a triangle and writes the covered pixels that pass.
#[inline(always)]
pub(crate) fn write_tile<S: Simd>((depths, ids): TileTarget<'_>, covered: S::M, depth: S::F, id: S::I) {
    let depth = depth.select_or(covered, S::F::splat(f32::NEG_INFINITY));
    let before = S::F::load(depths);
    let visible = depth.gt(before);
    // A maximum instead of a blend by `visible`: compilers turn the blend into a masked store, and loads that
    // follow a masked store closely stall until it has reached the cache.
    depth.max(before).store(depths);
    if let Some(ids) = ids {
        id.select_or(visible, S::I::load(ids)).store(ids);
    }
}

/// Depth over a tile, clamped to the range of the triangle's corners.
pub(crate) struct DepthPlane<S: Simd> {
    offsets: S::F,
    min: S::F,
    max: S::F,
    /// Change from one tile to the next on the right.
    right: f32,
}

impl<S: Simd> DepthPlane<S> {
    #[inline(always)]
    pub(crate) fn new<B: TileLayout>([dx, dy]: [f32; 2], [min, max]: [f32; 2]) -> Self {
        let across = S::F::splat(dx) * S::F::load(&B::X_FLOATS);
        Self {
            offsets: S::F::splat(dy).mul_add(S::F::load(&B::Y_FLOATS), across),
            min: S::F::splat(min),
            max: S::F::splat(max),
            right: dx * B::WIDTH as f32,
        }
    }

    /// Returns the depths of a tile whose first pixel has depth `first`.
    #[inline(always)]
    pub(crate) fn at(&self, first: f32) -> S::F {
        (S::F::splat(first) + self.offsets).max(self.min).min(self.max)
    }
}

/// A triangle of any size after set-up.
struct LargeTriangle {
    edges: [Edge; 3],
    first: ScreenVertex,
    depth_dx: f32,
    depth_dy: f32,
    depth_min: f32,
    depth_max: f32,
    /// Columns and rows of the first and last tile of the bounding box.
    from_x: i32,
    to_x: i32,
    from_y: i32,
    to_y: i32,
}

/// Value of an edge function that is not negative anywhere near. Greater ones, which occur in images of more
/// than 2²³ px, are lowered to it so that they fit in 32 bits. None is far below zero, because
/// [`LargeTriangle::span`] leaves such tiles out.
const FAR_INSIDE: i64 = 1 << 30;

/// An edge function at pixel centres, in the units of [`super::small_triangles::SmallTriangles::edges`].
#[derive(Clone, Copy)]
struct Edge {
    /// Value at the centre of pixel (0, 0).
    origin: i64,
    dx: i32,
    dy: i32,
}

impl LargeTriangle {
    /// Sets up a triangle. Returns `None` for back faces and for triangles whose bounding box has no pixel
    /// centre.
    #[inline(always)]
    fn new<B: TileLayout>([p, q, r]: &[ScreenVertex; 3], tiles: [i32; 2]) -> Option<Self> {
        let (qx, qy) = (i64::from(q.x - p.x), i64::from(q.y - p.y));
        let (rx, ry) = (i64::from(r.x - p.x), i64::from(r.y - p.y));
        let area = qx * ry - rx * qy;
        if area <= 0 {
            return None;
        }
        // Pixel i has its centre at 256 i + 128.
        let first = |a: i32, b: i32, c: i32| ((a.min(b).min(c) + 127) >> 8).max(0);
        let last = |a: i32, b: i32, c: i32, n: i32| ((a.max(b).max(c) - 128) >> 8).min(n - 1);
        let (from_x, to_x) = (first(p.x, q.x, r.x), last(p.x, q.x, r.x, tiles[0] << B::WIDTH_BITS));
        let (from_y, to_y) = (first(p.y, q.y, r.y), last(p.y, q.y, r.y, tiles[1] << B::HEIGHT_BITS));
        if from_x > to_x || from_y > to_y {
            return None;
        }
        let (q_rise, r_rise) = (q.depth - p.depth, r.depth - p.depth);
        // Per pixel rather than per 1/256 px.
        let scale = 256.0 / area as f32;
        Some(Self {
            edges: [Edge::new(p, q), Edge::new(q, r), Edge::new(r, p)],
            first: *p,
            depth_dx: (q_rise * ry as f32 - r_rise * qy as f32) * scale,
            depth_dy: (r_rise * qx as f32 - q_rise * rx as f32) * scale,
            depth_min: p.depth.min(q.depth).min(r.depth),
            depth_max: p.depth.max(q.depth).max(r.depth),
            from_x: from_x >> B::WIDTH_BITS,
            to_x: to_x >> B::WIDTH_BITS,
            from_y: from_y >> B::HEIGHT_BITS,
            to_y: to_y >> B::HEIGHT_BITS,
        })
    }

    /// Returns a conservative range of tiles that the triangle may cover in a row of tiles.
    #[inline(always)]
    fn span<B: TileLayout>(&self, tile_y: i32) -> (i32, i32) {
        let (mut from, mut to) = (self.from_x << B::WIDTH_BITS, self.to_x << B::WIDTH_BITS | (B::WIDTH - 1));
        for edge in &self.edges {
            // The pixel row on which the inside extends furthest.
            let y = (tile_y << B::HEIGHT_BITS) + if edge.dy > 0 { B::HEIGHT - 1 } else { 0 };
            let crossing = -edge.at(0, y) as f32 / edge.dx as f32;
            if edge.dx > 0 {
                from = from.max((crossing - 1.0) as i32);
            } else if edge.dx < 0 {
                to = to.min((crossing + 1.0) as i32);
            }
        }
        (from >> B::WIDTH_BITS, to >> B::WIDTH_BITS)
    }

    /// Returns the depth at the centre of a pixel.
    #[inline(always)]
    fn depth_at(&self, x: i32, y: i32) -> f32 {
        let from_first = |px: i32, corner: i32| px as f32 + (128 - corner) as f32 / 256.0;
        let across = self.depth_dx.mul_add(from_first(x, self.first.x), self.first.depth);
        self.depth_dy.mul_add(from_first(y, self.first.y), across)
    }
}

impl Edge {
    #[inline(always)]
    fn new(p: &ScreenVertex, q: &ScreenVertex) -> Self {
        let (dx, dy) = (q.x - p.x, q.y - p.y);
        // Top-left rule: a centre on an edge is inside if the edge is a top or left edge.
        let bias = i64::from(!(dy < 0 || (dy == 0 && dx > 0)));
        let origin = i64::from(dx) * i64::from(128 - p.y) - i64::from(dy) * i64::from(128 - p.x) - bias;
        Self { origin: origin >> 8, dx: -dy, dy: dx }
    }

    /// Returns the minimum difference between the value at a pixel of a tile and at its first pixel.
    #[inline(always)]
    fn min_change<B: TileLayout>(&self) -> i32 {
        (self.dx * (B::WIDTH - 1)).min(0) + (self.dy * (B::HEIGHT - 1)).min(0)
    }

    #[inline(always)]
    fn at(&self, x: i32, y: i32) -> i64 {
        self.origin + i64::from(self.dx) * i64::from(x) + i64::from(self.dy) * i64::from(y)
    }
}
