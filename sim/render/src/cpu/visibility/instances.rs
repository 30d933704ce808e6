//! Culling and triangle set-up: culls clusters of triangles, sixteen clusters at a time, and projects the
//! triangles of the remaining ones, sixteen triangles at a time.

use core::marker::PhantomData;

use crate::cpu::simd::each::each;
use crate::cpu::simd::isa::Kernel;
use crate::cpu::simd::{F32x16, FloatLike, I16x16, I32x16, SetBits, Simd, SimdF32, SimdI32, SimdMask};
use crate::cpu::visibility::projection::{Projected, ScreenProjection, Vectors};
use crate::cpu::visibility::raster::{ScreenVertex, Visibility};
use crate::cpu::visibility::small_triangles::{SMALL_EXTENT, SmallTriangles, TileBins};
use crate::cpu::visibility::tile::TileLayout;
use crate::math::affine::Affine3;
use crate::mesh::{ClusterCorners, PackedMesh, Vec3x16};
use crate::prepared::Instance;

/// Rasterises instances in order.
pub(crate) struct RasterizeInstances<'a, B, L> {
    pub(crate) instances: &'a [Instance],
    /// Transform of each instance from its mesh to the view frame.
    pub(crate) maps: &'a [Affine3],
    /// Id of the first triangle of each instance.
    pub(crate) first_ids: &'a [u32],
    pub(crate) projection: L,
    pub(crate) visibility: &'a mut Visibility,
    pub(crate) tiles: PhantomData<B>,
}

impl<B: TileLayout, L: ScreenProjection> Kernel for RasterizeInstances<'_, B, L> {
    #[inline(always)]
    fn run<S: Simd>(mut self) {
        let mut bins = TileBins::new();
        for ((instance, map), first_id) in self.instances.iter().zip(self.maps).zip(self.first_ids) {
            let mesh = instance.mesh();
            if self.projection.includes(instance) && self.projection.begin_mesh(map, mesh.centre, mesh.radius)
            {
                let first_id = *first_id as i32;
                draw::<S, B, L>(&mesh.packed, map, &self.projection, first_id, &mut bins, self.visibility);
            }
        }
    }
}

/// Rasterises a mesh. Its triangles get ids from `first_id` on.
#[inline(always)]
fn draw<S: Simd, B: TileLayout, L: ScreenProjection>(
    mesh: &PackedMesh,
    view_from_mesh: &Affine3,
    projection: &L,
    first_id: i32,
    bins: &mut TileBins,
    visibility: &mut Visibility,
) {
    let max_scale = S::F::splat(view_from_mesh.max_scale());
    let map = TransformX16::<S>::new(view_from_mesh);
    let view_from_steps = TransformX16::<S>::new(&view_from_mesh.scale_columns(mesh.grid_step));
    for (group, bounds) in mesh.bounds.iter().enumerate() {
        let centre = map.points(&bounds.centre);
        let culled = projection.cull_clusters::<S>(bounds, &centre, S::F::load(&bounds.radius) * max_scale);
        for lane in SetBits(bounds.present & !culled) {
            let batch_idx = group * 16 + lane;
            let corners = &mesh.corners[batch_idx];
            let first_id = first_id + (batch_idx * 16) as i32;
            let clipped =
                draw_batch::<S, B, L>(corners, &view_from_steps, projection, first_id, bins, visibility);
            for lane in SetBits(clipped) {
                let triangle = each!(k in 3 => view_from_mesh.transform_point(
                    each!(axis in 3 => f32::from(corners[k][axis].0[lane]) * mesh.grid_step[axis])
                ));
                projection.clip::<S, B>(triangle, first_id + lane as i32, visibility);
            }
        }
    }
}

/// An affine transform with every coefficient broadcast to a vector.
pub(crate) struct TransformX16<S: Simd> {
    linear: [Vectors<S>; 3],
    offset: Vectors<S>,
}

impl<S: Simd> TransformX16<S> {
    #[inline(always)]
    pub(crate) fn new(map: &Affine3) -> Self {
        Self {
            linear: each!(i in 3 => each!(k in 3 => S::F::splat(map.linear[i][k]))),
            offset: each!(i in 3 => S::F::splat(map.offset[i])),
        }
    }

    /// Transforms sixteen points, with the same results as [`Affine3::transform_point`].
    #[inline(always)]
    pub(crate) fn points(&self, points: &Vec3x16) -> Vectors<S> {
        self.of(each!(k in 3 => S::F::load(&points[k])))
    }

    /// Transforms sixteen points with 16-bit integer coordinates.
    #[inline(always)]
    pub(crate) fn short_points(&self, points: &[I16x16; 3]) -> Vectors<S> {
        self.of(each!(k in 3 => S::F::load_i16(&points[k])))
    }

    /// Transforms sixteen points.
    #[inline(always)]
    pub(crate) fn of(&self, [x, y, z]: Vectors<S>) -> Vectors<S> {
        each!(i in 3 => {
            let [a, b, c] = self.linear[i];
            x.mul_add(a, y.mul_add(b, z.mul_add(c, self.offset[i])))
        })
    }
}

/// Rasterises sixteen triangles, except for those that need clipping. Returns the lanes of those.
#[inline(always)]
fn draw_batch<S: Simd, B: TileLayout, L: ScreenProjection>(
    corners: &ClusterCorners,
    view_from_steps: &TransformX16<S>,
    projection: &L,
    first_id: i32,
    bins: &mut TileBins,
    visibility: &mut Visibility,
) -> u16 {
    // Front faces are counter-clockwise as seen from the eye, but clockwise in image coordinates, whose y
    // axis points down. Swapping two corners makes all three edge functions positive inside.
    let [p, r, q] = each!(k in 3 => view_from_steps.short_points(&corners[k]));
    let [at_p, at_q, at_r] =
        [projection.needs_clip::<S>(&p), projection.needs_clip::<S>(&q), projection.needs_clip::<S>(&r)];
    let behind_near = at_p.behind_near & at_q.behind_near & at_r.behind_near;
    let needs_clip = at_p.needs_clip | at_q.needs_clip | at_r.needs_clip;
    let corners = [projection.project::<S>(&p), projection.project::<S>(&q), projection.project::<S>(&r)];
    let extent = PixelBounds::<S>::of::<B>(&corners, visibility.tiles);
    if let Some(small) = prepare::<S, B>(&corners, &extent, needs_clip, visibility.tiles[0]) {
        visibility.rasterize_small::<S, B>(&small, first_id, bins);
    }
    let large = extent.large.and_not(needs_clip).to_bits();
    if large != 0 {
        rasterize_large::<S, B>(&corners, large, first_id, visibility);
    }
    needs_clip.and_not(behind_near).to_bits()
}

#[inline(always)]
fn rasterize_large<S: Simd, B: TileLayout>(
    corners: &[Projected<S>; 3],
    lanes: u16,
    first_id: i32,
    visibility: &mut Visibility,
) {
    let mut x = [I32x16::ZERO; 3];
    let mut y = [I32x16::ZERO; 3];
    let mut depth = [F32x16::ZERO; 3];
    for (k, corner) in corners.iter().enumerate() {
        corner.x.store(&mut x[k]);
        corner.y.store(&mut y[k]);
        corner.depth.store(&mut depth[k]);
    }
    for lane in SetBits(lanes) {
        let corners =
            each!(k in 3 => ScreenVertex { x: x[k].0[lane], y: y[k].0[lane], depth: depth[k].0[lane] });
        visibility.rasterize_large::<S, B>(&corners, first_id + lane as i32);
    }
}

/// Bounding boxes of sixteen triangles, in pixels.
struct PixelBounds<S: Simd> {
    /// Column and row of the first pixel whose centre is inside.
    from: [S::I; 2],
    /// Column and row of the last such pixel.
    to: [S::I; 2],
    /// Set if no pixel centre is inside.
    empty: S::M,
    /// Set if the triangle is not empty and too large for [`SmallTriangles`].
    large: S::M,
}

impl<S: Simd> PixelBounds<S> {
    #[inline(always)]
    fn of<B: TileLayout>([p, q, r]: &[Projected<S>; 3], tiles: [i32; 2]) -> Self {
        let (min_x, max_x) = (p.x.min(q.x).min(r.x), p.x.max(q.x).max(r.x));
        let (min_y, max_y) = (p.y.min(q.y).min(r.y), p.y.max(q.y).max(r.y));
        let size = (max_x - min_x).max(max_y - min_y);
        let (from_x, to_x) = pixels_between::<S>(min_x, max_x, tiles[0] << B::WIDTH_BITS);
        let (from_y, to_y) = pixels_between::<S>(min_y, max_y, tiles[1] << B::HEIGHT_BITS);
        let empty = from_x.gt(to_x) | from_y.gt(to_y);
        let large = size.gt(S::I::splat(SMALL_EXTENT - 1)).and_not(empty);
        Self { from: [from_x, from_y], to: [to_x, to_y], empty, large }
    }
}

/// Sets up sixteen triangles. Those that are small, front-facing, not empty and not in `needs_clip` are
/// marked present.
#[inline(always)]
fn prepare<S: Simd, B: TileLayout>(
    corners: &[Projected<S>; 3],
    extent: &PixelBounds<S>,
    needs_clip: S::M,
    tiles_per_row: i32,
) -> Option<SmallTriangles<S>> {
    let [p, q, r] = corners;
    let PixelBounds { from: [from_x, from_y], to: [to_x, to_y], empty, large } = *extent;
    let splat = S::I::splat;
    let (qx, qy, rx, ry) = (q.x - p.x, q.y - p.y, r.x - p.x, r.y - p.y);
    let area = pack_i16::<S>(qx, splat(0) - rx).dot_i16(pack_i16::<S>(ry, qy));
    let present = area.gt(splat(0)).and_not(empty | large | needs_clip);
    if !present.any() {
        return None;
    }
    let (tile_x, tile_y) =
        (from_x.shr_arithmetic_by(B::WIDTH_BITS), from_y.shr_arithmetic_by(B::HEIGHT_BITS));
    // Centre of the first pixel of the first tile.
    let centre_x = (from_x & splat(-B::WIDTH)).shl::<8>() + splat(128);
    let centre_y = (from_y & splat(-B::HEIGHT)).shl::<8>() + splat(128);
    let first_in_tile = (from_x & splat(B::WIDTH - 1)) | (from_y & splat(B::HEIGHT - 1)).shl::<16>();
    // Signs of the edge functions at the first candidate pixel and at its right, lower and diagonal
    // neighbours.
    let mut outside = [splat(0); 4];
    let (mut edges, mut all_steps) = ([splat(0); 3], [splat(0); 3]);
    for (k, (a, b)) in [(p, q), (q, r), (r, p)].into_iter().enumerate() {
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        // Top-left rule: a centre on an edge is inside if the edge is a top or left edge.
        let top_left = splat(0).gt(dy) | (dy.eq(splat(0)) & dx.gt(splat(0)));
        let bias = splat(0).select_or(top_left, splat(1));
        let steps = pack_i16::<S>(splat(0) - dy, dx);
        let edge =
            (steps.dot_i16(pack_i16::<S>(centre_x - a.x, centre_y - a.y)) - bias).shr_arithmetic::<8>();
        (edges[k], all_steps[k]) = (edge, steps);
        let first = edge + steps.dot_i16(first_in_tile);
        let at = [first, first - dy, first + dx, first + dx - dy];
        outside = each!(i in 4 => outside[i] | at[i]);
    }
    // Many triangles that span at most 2 × 2 pixels cover none.
    let tiny = splat(2).gt(to_x - from_x) & splat(2).gt(to_y - from_y);
    let none = S::I::splat(0).gt(outside[0] & outside[1] & outside[2] & outside[3]);
    let present = present.and_not(tiny & none);
    if !present.any() {
        return None;
    }
    let (q_rise, r_rise) = (q.depth - p.depth, r.depth - p.depth);
    // Per pixel rather than per 1/256 px.
    let scale = S::F::splat(256.0) / area.to_f32();
    let dx = (q_rise * ry.to_f32() - r_rise * qy.to_f32()) * scale;
    let dy = (r_rise * qx.to_f32() - q_rise * rx.to_f32()) * scale;
    let px = S::F::splat(1.0 / 256.0);
    let (across, down) = ((centre_x - p.x).to_f32() * px, (centre_y - p.y).to_f32() * px);
    Some(SmallTriangles {
        present,
        edges,
        steps: all_steps,
        depth: dy.mul_add(down, dx.mul_add(across, p.depth)),
        depth_dx: dx,
        depth_dy: dy,
        depth_min: p.depth.min(q.depth).min(r.depth),
        depth_max: p.depth.max(q.depth).max(r.depth),
        tile: tile_y.dot_i16(splat(tiles_per_row)) + tile_x,
        more: [
            to_x.shr_arithmetic_by(B::WIDTH_BITS) - tile_x,
            to_y.shr_arithmetic_by(B::HEIGHT_BITS) - tile_y,
        ],
    })
}

/// Packs 16-bit numbers into the low and high halves of the lanes.
#[inline(always)]
fn pack_i16<S: Simd>(lower: S::I, upper: S::I) -> S::I {
    (lower & S::I::splat(0xFFFF)) | upper.shl::<16>()
}

/// Returns the first and last of `n` pixels whose centres lie between two coordinates in 1/256 px. Pixel i
/// has its centre at 256 i + 128.
#[inline(always)]
fn pixels_between<S: Simd>(min: S::I, max: S::I, n: i32) -> (S::I, S::I) {
    let first = (min + S::I::splat(127)).shr_arithmetic::<8>().max(S::I::splat(0));
    let last = (max - S::I::splat(128)).shr_arithmetic::<8>().min(S::I::splat(n - 1));
    (first, last)
}
