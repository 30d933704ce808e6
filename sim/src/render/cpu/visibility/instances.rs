//! From clusters of triangles to triangles on the image: passes over what cannot be seen, sixteen clusters at a time,
//! and prepares the others' triangles, sixteen at a time.

use core::marker::PhantomData;

use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::isa::Kernel;
use crate::render::cpu::simd::{
    F32x16, FloatLike, I16x16, I32x16, SetBits, Simd, SimdF32, SimdI32, SimdMask,
};
use crate::render::cpu::visibility::projection::{Projected, Projection, Vectors};
use crate::render::cpu::visibility::raster::{ScreenVertex, Visibility};
use crate::render::cpu::visibility::small_triangles::{SMALL_EXTENT, SmallTriangles, TileBins};
use crate::render::cpu::visibility::tile::TileLayout;
use crate::render::math::affine::Affine3;
use crate::render::mesh::{ClusterCorners, PackedMesh, Vec3x16};
use crate::render::scene::Instance;

/// Draws instances, in order.
pub(in crate::render::cpu) struct RasterizeInstances<'a, B, L> {
    pub(in crate::render::cpu) instances: &'a [Instance],
    /// From each one's mesh to the view frame.
    pub(in crate::render::cpu) maps: &'a [Affine3],
    /// Id of each one's first triangle.
    pub(in crate::render::cpu) first_ids: &'a [u32],
    pub(in crate::render::cpu) projection: L,
    pub(in crate::render::cpu) visibility: &'a mut Visibility,
    pub(in crate::render::cpu) tiles: PhantomData<B>,
}

impl<B: TileLayout, L: Projection> Kernel for RasterizeInstances<'_, B, L> {
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

/// Draws a mesh. Its triangles have the ids from `first_id` up.
#[inline(always)]
fn draw<S: Simd, B: TileLayout, L: Projection>(
    mesh: &PackedMesh,
    view_from_mesh: &Affine3,
    projection: &L,
    first_id: i32,
    bins: &mut TileBins,
    visibility: &mut Visibility,
) {
    let stretch = S::F::splat(view_from_mesh.max_scale());
    let map = TransformX16::<S>::new(view_from_mesh);
    let view_from_steps = TransformX16::<S>::new(&view_from_mesh.scale_columns(mesh.grid_step));
    for (sixteen, bounds) in mesh.bounds.iter().enumerate() {
        let centre = map.points(&bounds.centre);
        let culled = projection.cull_clusters::<S>(bounds, &centre, S::F::load(&bounds.radius) * stretch);
        for lane in SetBits(bounds.present & !culled) {
            let batch_idx = sixteen * 16 + lane;
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

/// An affine map, its numbers spread over vectors.
pub(in crate::render::cpu) struct TransformX16<S: Simd> {
    linear: [Vectors<S>; 3],
    offset: Vectors<S>,
}

impl<S: Simd> TransformX16<S> {
    #[inline(always)]
    pub(in crate::render::cpu) fn new(map: &Affine3) -> Self {
        Self {
            linear: each!(i in 3 => each!(k in 3 => S::F::splat(map.linear[i][k]))),
            offset: each!(i in 3 => S::F::splat(map.offset[i])),
        }
    }

    /// Images of sixteen points: the same as [`Affine3::transform_point`] gives.
    #[inline(always)]
    pub(in crate::render::cpu) fn points(&self, points: &Vec3x16) -> Vectors<S> {
        self.of(each!(k in 3 => S::F::load(&points[k])))
    }

    /// The same of points whose coordinates are short integers.
    #[inline(always)]
    pub(in crate::render::cpu) fn short_points(&self, points: &[I16x16; 3]) -> Vectors<S> {
        self.of(each!(k in 3 => S::F::load_i16(&points[k])))
    }

    /// Images of sixteen points.
    #[inline(always)]
    pub(in crate::render::cpu) fn of(&self, [x, y, z]: Vectors<S>) -> Vectors<S> {
        each!(i in 3 => {
            let [a, b, c] = self.linear[i];
            x.mul_add(a, y.mul_add(b, z.mul_add(c, self.offset[i])))
        })
    }
}

/// Draws sixteen triangles but for those that must be clipped, which it gives.
#[inline(always)]
fn draw_batch<S: Simd, B: TileLayout, L: Projection>(
    corners: &ClusterCorners,
    view_from_steps: &TransformX16<S>,
    projection: &L,
    first_id: i32,
    bins: &mut TileBins,
    visibility: &mut Visibility,
) -> u16 {
    // Outsides are counter-clockwise to the eye, which is clockwise in numbers, as y runs down: exchanging two corners
    // makes all three edge functions positive inside.
    let [p, r, q] = each!(k in 3 => view_from_steps.short_points(&corners[k]));
    let [at_p, at_q, at_r] =
        [projection.needs_clip::<S>(&p), projection.needs_clip::<S>(&q), projection.needs_clip::<S>(&r)];
    let behind_near = at_p.behind_near & at_q.behind_near & at_r.behind_near;
    let needs_clip = at_p.needs_clip | at_q.needs_clip | at_r.needs_clip;
    let corners = [projection.project::<S>(&p), projection.project::<S>(&q), projection.project::<S>(&r)];
    let extent = PixelBounds::<S>::of(&corners, visibility.side);
    if let Some(small) = prepare::<S, B>(&corners, &extent, needs_clip, visibility.side) {
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

/// Where sixteen triangles lie.
struct PixelBounds<S: Simd> {
    /// Column and row of the first pixel whose centre lies within.
    from: [S::I; 2],
    /// Column and row of the last one.
    to: [S::I; 2],
    /// No pixel's centre lies within.
    empty: S::M,
    /// Too large for [`SmallTriangles`], and not empty.
    large: S::M,
}

impl<S: Simd> PixelBounds<S> {
    #[inline(always)]
    fn of([p, q, r]: &[Projected<S>; 3], side: i32) -> Self {
        let (least_x, greatest_x) = (p.x.min(q.x).min(r.x), p.x.max(q.x).max(r.x));
        let (least_y, greatest_y) = (p.y.min(q.y).min(r.y), p.y.max(q.y).max(r.y));
        let reach = (greatest_x - least_x).max(greatest_y - least_y);
        let (from_x, to_x) = pixels_between::<S>(least_x, greatest_x, side);
        let (from_y, to_y) = pixels_between::<S>(least_y, greatest_y, side);
        let empty = from_x.gt(to_x) | from_y.gt(to_y);
        let large = reach.gt(S::I::splat(SMALL_EXTENT - 1)).and_not(empty);
        Self { from: [from_x, from_y], to: [to_x, to_y], empty, large }
    }
}

/// Sets up sixteen triangles, of which those are present that are small, seen from the front, over some pixel's centre, and not
/// `needs_clip`.
#[inline(always)]
fn prepare<S: Simd, B: TileLayout>(
    corners: &[Projected<S>; 3],
    extent: &PixelBounds<S>,
    needs_clip: S::M,
    side: i32,
) -> Option<SmallTriangles<S>> {
    let [p, q, r] = corners;
    let PixelBounds { from: [from_x, from_y], to: [to_x, to_y], empty, large } = *extent;
    let whole = S::I::splat;
    let (qx, qy, rx, ry) = (q.x - p.x, q.y - p.y, r.x - p.x, r.y - p.y);
    let area = halves::<S>(qx, whole(0) - rx).dot_i16(halves::<S>(ry, qy));
    let present = area.gt(whole(0)).and_not(empty | large | needs_clip);
    if !present.any() {
        return None;
    }
    let (tile_x, tile_y) =
        (from_x.shr_arithmetic_by(B::WIDTH_BITS), from_y.shr_arithmetic_by(B::HEIGHT_BITS));
    // The centre of the first tile's first pixel.
    let centre_x = (from_x & whole(-B::WIDTH)).shl::<8>() + whole(128);
    let centre_y = (from_y & whole(-B::HEIGHT)).shl::<8>() + whole(128);
    let inwards = (from_x & whole(B::WIDTH - 1)) | (from_y & whole(B::HEIGHT - 1)).shl::<16>();
    // Signs of the edge functions at the first pixel that may be covered and at its neighbours right, below and across.
    let mut outside = [whole(0); 4];
    let (mut edges, mut all_steps) = ([whole(0); 3], [whole(0); 3]);
    for (k, (a, b)) in [(p, q), (q, r), (r, p)].into_iter().enumerate() {
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        // A centre on the edge belongs to the triangle if the edge is at its top or left.
        let top_left = whole(0).gt(dy) | (dy.eq(whole(0)) & dx.gt(whole(0)));
        let bias = whole(0).select_or(top_left, whole(1));
        let steps = halves::<S>(whole(0) - dy, dx);
        let edge = (steps.dot_i16(halves::<S>(centre_x - a.x, centre_y - a.y)) - bias).shr_arithmetic::<8>();
        (edges[k], all_steps[k]) = (edge, steps);
        let first = edge + steps.dot_i16(inwards);
        let at = [first, first - dy, first + dx, first + dx - dy];
        outside = each!(i in 4 => outside[i] | at[i]);
    }
    // Of the triangles that reach over no more than 2 × 2 pixels many cover none.
    let tiny = whole(2).gt(to_x - from_x) & whole(2).gt(to_y - from_y);
    let none = S::I::splat(0).gt(outside[0] & outside[1] & outside[2] & outside[3]);
    let present = present.and_not(tiny & none);
    if !present.any() {
        return None;
    }
    let (q_rise, r_rise) = (q.depth - p.depth, r.depth - p.depth);
    // Per pixel, hence the 256.
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
        depth_least: p.depth.min(q.depth).min(r.depth),
        depth_greatest: p.depth.max(q.depth).max(r.depth),
        tile: tile_y.dot_i16(whole(side >> B::WIDTH_BITS)) + tile_x,
        more: [
            to_x.shr_arithmetic_by(B::WIDTH_BITS) - tile_x,
            to_y.shr_arithmetic_by(B::HEIGHT_BITS) - tile_y,
        ],
    })
}

/// Numbers of 16 bits in the lower and the upper halves of lanes.
#[inline(always)]
fn halves<S: Simd>(lower: S::I, upper: S::I) -> S::I {
    (lower & S::I::splat(0xFFFF)) | upper.shl::<16>()
}

/// First and last pixel whose centre lies between two places in 1/256 px; pixel i has its centre at 256 i + 128.
#[inline(always)]
fn pixels_between<S: Simd>(least: S::I, greatest: S::I, side: i32) -> (S::I, S::I) {
    let first = (least + S::I::splat(127)).shr_arithmetic::<8>().max(S::I::splat(0));
    let last = (greatest - S::I::splat(128)).shr_arithmetic::<8>().min(S::I::splat(side - 1));
    (first, last)
}
