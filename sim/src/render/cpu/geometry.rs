//! From clusters of triangles to triangles on the image: passes over what cannot be seen, sixteen clusters at a time,
//! and prepares the others' triangles, sixteen at a time.

use core::marker::PhantomData;

use super::each::each;
use super::isa::Kernel;
use super::kind::Block;
use super::lens::{Lens, Projected, Vectors};
use super::raster::{Corner, Visibility};
use super::simd::{F32x16, FloatLike, I16x16, I32x16, SetBits, Simd, SimdF32, SimdI32, SimdMask};
use super::small::{SMALL_REACH, Shares, Small};
use crate::render::math::affine::Affine3;
use crate::render::mesh::{ClusterCorners, PackedMesh, Vec3x16};
use crate::render::scene::Instance;

/// Draws instances, in order.
pub(super) struct Draw<'a, B, L> {
    pub(super) instances: &'a [Instance],
    /// From each one's mesh to the view frame.
    pub(super) maps: &'a [Affine3],
    /// Id of each one's first triangle.
    pub(super) first_ids: &'a [u32],
    pub(super) lens: L,
    pub(super) visibility: &'a mut Visibility,
    pub(super) blocks: PhantomData<B>,
}

impl<B: Block, L: Lens> Kernel for Draw<'_, B, L> {
    #[inline(always)]
    fn run<S: Simd>(mut self) {
        let mut shares = Shares::new();
        for ((instance, map), first_id) in self.instances.iter().zip(self.maps).zip(self.first_ids) {
            let mesh = instance.mesh();
            if self.lens.draws(instance) && self.lens.turn_to(map, mesh.centre, mesh.radius) {
                let first_id = *first_id as i32;
                draw::<S, B, L>(&mesh.packed, map, &self.lens, first_id, &mut shares, self.visibility);
            }
        }
    }
}

/// Draws a mesh. Its triangles have the ids from `first_id` up.
#[inline(always)]
fn draw<S: Simd, B: Block, L: Lens>(
    mesh: &PackedMesh,
    view_from_mesh: &Affine3,
    lens: &L,
    first_id: i32,
    shares: &mut Shares,
    visibility: &mut Visibility,
) {
    let stretch = S::F::splat(view_from_mesh.max_scale());
    let map = Map::<S>::new(view_from_mesh);
    let view_from_steps = Map::<S>::new(&view_from_mesh.scale_columns(mesh.grid_step));
    for (sixteen, bounds) in mesh.bounds.iter().enumerate() {
        let centre = map.points(&bounds.centre);
        let missed = lens.misses::<S>(bounds, &centre, S::F::load(&bounds.radius) * stretch);
        for lane in SetBits(bounds.present & !missed) {
            let batch_idx = sixteen * 16 + lane;
            let corners = &mesh.corners[batch_idx];
            let first_id = first_id + (batch_idx * 16) as i32;
            let clipped =
                draw_batch::<S, B, L>(corners, &view_from_steps, lens, first_id, shares, visibility);
            for lane in SetBits(clipped) {
                let triangle = each!(k in 3 => view_from_mesh.transform_point(
                    each!(axis in 3 => f32::from(corners[k][axis].0[lane]) * mesh.grid_step[axis])
                ));
                lens.clip::<S, B>(triangle, first_id + lane as i32, visibility);
            }
        }
    }
}

/// An affine map, its numbers spread over vectors.
pub(super) struct Map<S: Simd> {
    linear: [Vectors<S>; 3],
    offset: Vectors<S>,
}

impl<S: Simd> Map<S> {
    #[inline(always)]
    pub(super) fn new(map: &Affine3) -> Self {
        Self {
            linear: each!(i in 3 => each!(k in 3 => S::F::splat(map.linear[i][k]))),
            offset: each!(i in 3 => S::F::splat(map.offset[i])),
        }
    }

    /// Images of sixteen points: the same as [`Affine3::transform_point`] gives.
    #[inline(always)]
    pub(super) fn points(&self, points: &Vec3x16) -> Vectors<S> {
        self.of(each!(k in 3 => S::F::load(&points[k])))
    }

    /// The same of points whose coordinates are short integers.
    #[inline(always)]
    pub(super) fn short_points(&self, points: &[I16x16; 3]) -> Vectors<S> {
        self.of(each!(k in 3 => S::F::load_i16(&points[k])))
    }

    /// Images of sixteen points.
    #[inline(always)]
    pub(super) fn of(&self, [x, y, z]: Vectors<S>) -> Vectors<S> {
        each!(i in 3 => {
            let [a, b, c] = self.linear[i];
            x.mul_add(a, y.mul_add(b, z.mul_add(c, self.offset[i])))
        })
    }
}

/// Draws sixteen triangles but for those that must be clipped, which it gives.
#[inline(always)]
fn draw_batch<S: Simd, B: Block, L: Lens>(
    corners: &ClusterCorners,
    view_from_steps: &Map<S>,
    lens: &L,
    first_id: i32,
    shares: &mut Shares,
    visibility: &mut Visibility,
) -> u16 {
    // Outsides are counter-clockwise to the eye, which is clockwise in numbers, as y runs down: exchanging two corners
    // makes all three edge functions positive inside.
    let [p, r, q] = each!(k in 3 => view_from_steps.short_points(&corners[k]));
    let [at_p, at_q, at_r] = [lens.unfit::<S>(&p), lens.unfit::<S>(&q), lens.unfit::<S>(&r)];
    let hidden = at_p.hidden & at_q.hidden & at_r.hidden;
    let unfit = at_p.unfit | at_q.unfit | at_r.unfit;
    let corners = [lens.project::<S>(&p), lens.project::<S>(&q), lens.project::<S>(&r)];
    let extent = Extent::<S>::of(&corners, visibility.side);
    if let Some(small) = prepare::<S, B>(&corners, &extent, unfit, visibility.side) {
        visibility.draw_small::<S, B>(&small, first_id, shares);
    }
    let large = extent.large.and_not(unfit).to_bits();
    if large != 0 {
        draw_large::<S, B>(&corners, large, first_id, visibility);
    }
    unfit.and_not(hidden).to_bits()
}

#[inline(always)]
fn draw_large<S: Simd, B: Block>(
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
        let corners = each!(k in 3 => Corner { x: x[k].0[lane], y: y[k].0[lane], depth: depth[k].0[lane] });
        visibility.draw_large::<S, B>(&corners, first_id + lane as i32);
    }
}

/// Where sixteen triangles lie.
struct Extent<S: Simd> {
    /// Column and row of the first pixel whose centre lies within.
    from: [S::I; 2],
    /// Column and row of the last one.
    to: [S::I; 2],
    /// No pixel's centre lies within.
    empty: S::M,
    /// Too large for [`Small`], and not empty.
    large: S::M,
}

impl<S: Simd> Extent<S> {
    #[inline(always)]
    fn of([p, q, r]: &[Projected<S>; 3], side: i32) -> Self {
        let (least_x, greatest_x) = (p.x.min(q.x).min(r.x), p.x.max(q.x).max(r.x));
        let (least_y, greatest_y) = (p.y.min(q.y).min(r.y), p.y.max(q.y).max(r.y));
        let reach = (greatest_x - least_x).max(greatest_y - least_y);
        let (from_x, to_x) = pixels_between::<S>(least_x, greatest_x, side);
        let (from_y, to_y) = pixels_between::<S>(least_y, greatest_y, side);
        let empty = from_x.gt(to_x) | from_y.gt(to_y);
        let large = reach.gt(S::I::splat(SMALL_REACH - 1)).and_not(empty);
        Self { from: [from_x, from_y], to: [to_x, to_y], empty, large }
    }
}

/// Sets up sixteen triangles, of which those are present that are small, seen from the front, over some pixel's centre, and not
/// `unfit`.
#[inline(always)]
fn prepare<S: Simd, B: Block>(
    corners: &[Projected<S>; 3],
    extent: &Extent<S>,
    unfit: S::M,
    side: i32,
) -> Option<Small<S>> {
    let [p, q, r] = corners;
    let Extent { from: [from_x, from_y], to: [to_x, to_y], empty, large } = *extent;
    let whole = S::I::splat;
    let (qx, qy, rx, ry) = (q.x - p.x, q.y - p.y, r.x - p.x, r.y - p.y);
    let area = halves::<S>(qx, whole(0) - rx).dot_i16(halves::<S>(ry, qy));
    let present = area.gt(whole(0)).and_not(empty | large | unfit);
    if !present.any() {
        return None;
    }
    let (block_x, block_y) =
        (from_x.shr_arithmetic_by(B::WIDTH_BITS), from_y.shr_arithmetic_by(B::HEIGHT_BITS));
    // The centre of the first block's first pixel.
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
    Some(Small {
        present,
        edges,
        steps: all_steps,
        depth: dy.mul_add(down, dx.mul_add(across, p.depth)),
        depth_dx: dx,
        depth_dy: dy,
        depth_least: p.depth.min(q.depth).min(r.depth),
        depth_greatest: p.depth.max(q.depth).max(r.depth),
        block: block_y.dot_i16(whole(side >> B::WIDTH_BITS)) + block_x,
        more: [
            to_x.shr_arithmetic_by(B::WIDTH_BITS) - block_x,
            to_y.shr_arithmetic_by(B::HEIGHT_BITS) - block_y,
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
