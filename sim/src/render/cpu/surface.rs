//! The triangles that are seen, made ready for shading: everything that runs linearly over the image.
//!
//! With the corners at p, p + e and p + f in the view frame, the ray along d through a pixel's centre meets the
//! triangle's plane at p + (a/n) e + (b/n) f, where a = d·(p×f), b = d·(e×p), n = d·(f×e) (Möller and Trumbore,
//! "Fast, minimum storage ray/triangle intersection", 1997). So an attribute with the values t at p and t + t_e, t + t_f
//! at the others is (t n + t_e a + t_f b) / n there: a quotient of two functions that are linear over the image.

use super::each::each;
use super::geometry::Map;
use super::isa::Kernel;
use super::kind::{Block, Square};
use super::lens::Vectors;
use super::raster::{MAX_BLOCKS, Visibility};
use super::simd::{F32x16, FloatLike, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask};
use crate::render::math::affine::Affine3;
use crate::render::mesh::TriangleRecord;
use crate::render::scene::camera::PinholeCamera;
use crate::render::scene::{Instance, RenderScene};
use crate::render::texture::mip_chain;

/// Numbers of one visible triangle that every pixel needs, by index into a line.
pub(super) struct Look;

impl Look {
    /// Where the normal begins, in the view frame and of any length: per axis the value at pixel (0, 0) and its changes
    /// to the right and downwards.
    pub(super) const NORMAL: usize = 0;
    /// Where the colour begins, linear RGB.
    pub(super) const COLOR: usize = 9;
    /// Strength of the highlight.
    pub(super) const SPECULAR: usize = 12;
    /// Texture as the bits of an integer, -1 for none.
    pub(super) const TEXTURE: usize = 13;
    /// 1 if the normal is the same everywhere.
    pub(super) const FLAT: usize = 14;
}

/// Numbers that textured pixels need: n, u n and v n over the image.
pub(super) struct Wrap;

impl Wrap {
    /// Where n begins.
    pub(super) const N: usize = 0;
    /// Where u n begins, u in tiles.
    pub(super) const U: usize = 3;
    /// Where v n begins.
    pub(super) const V: usize = 6;
}

/// The visible triangles of one view.
pub(super) struct Surfaces {
    /// Laid out as [`Look`], by [`place`]; that of nothing is [`VOID`].
    pub(super) looks: Vec<F32x16>,
    /// Laid out as [`Wrap`], by [`place`]; only those with a texture are filled in.
    pub(super) wraps: Vec<F32x16>,
    /// What each block shows everywhere, by id, or [`SEVERAL`], or [`KEPT`].
    pub(super) shown: Vec<i32>,
    /// 1 where a triangle is seen, by [`place`].
    seen: Vec<u8>,
    /// Whether there may be any such.
    is_marked: bool,
    /// Room for the numbers of one mesh's triangles.
    list: Vec<i32>,
}

/// Where a triangle's lines are, given its id or [`super::raster::NOTHING`].
#[inline(always)]
pub(super) fn place(id: i32) -> usize {
    (id + N_LANES as i32) as usize
}

/// More than one triangle, or one and nothing.
pub(super) const SEVERAL: i32 = -2;
/// What has been shaded before.
pub(super) const KEPT: i32 = -3;

/// Look of what is not there: black.
pub(super) const VOID: F32x16 = {
    let mut line = F32x16::ZERO;
    line.0[Look::NORMAL + 6] = -1.0;
    line.0[Look::TEXTURE] = f32::from_bits(u32::MAX);
    line
};

impl Surfaces {
    /// Room for what a scene usually shows.
    pub(super) fn new() -> Self {
        const N_IDS: usize = 1 << 16;
        Self {
            looks: Vec::with_capacity(N_IDS),
            wraps: Vec::with_capacity(N_IDS),
            shown: Vec::with_capacity(MAX_BLOCKS),
            seen: Vec::with_capacity(N_IDS),
            is_marked: false,
            list: Vec::with_capacity(N_IDS),
        }
    }

    /// Makes room for all of a scene's triangles, none of them seen yet.
    fn start(&mut self, n_ids: usize, n_blocks: usize) {
        let n_lines = self.looks.len().max(n_ids + N_LANES);
        self.looks.resize(n_lines, VOID);
        self.wraps.resize(n_lines, F32x16::ZERO);
        if self.is_marked {
            self.seen.fill(0);
        }
        self.seen.resize(n_lines, 0);
        self.is_marked = true;
        self.shown.resize(n_blocks, SEVERAL);
    }

    #[inline(always)]
    fn look_at<S: Simd>(&mut self, blocks: &[I32x16]) {
        let Self { shown, seen, .. } = self;
        for (ids, shown) in blocks.iter().zip(shown) {
            *shown = look_at::<S>(ids, seen);
        }
    }

    /// The same for those blocks that lie in the blocks of pixels that are stale.
    #[inline(always)]
    fn look_at_stale<S: Simd>(&mut self, blocks: &[I32x16], stale: &[bool], per_row: usize, scale: usize) {
        let Self { shown, seen, .. } = self;
        if scale == 1 {
            for ((ids, shown), stale) in blocks.iter().zip(shown).zip(stale) {
                *shown = if *stale { look_at::<S>(ids, seen) } else { KEPT };
            }
            return;
        }
        let rows = blocks.chunks_exact(per_row * scale).zip(shown.chunks_exact_mut(per_row * scale));
        for (row, (ids, shown)) in rows.enumerate() {
            let stale = &stale[row / scale * per_row..][..per_row];
            let columns = ids.chunks_exact(scale).zip(shown.chunks_exact_mut(scale));
            for ((ids, shown), stale) in columns.zip(stale) {
                for (ids, shown) in ids.iter().zip(shown) {
                    *shown = if *stale { look_at::<S>(ids, seen) } else { KEPT };
                }
            }
        }
    }
}

/// Marks a block's triangles as seen, and says what it shows: see [`Surfaces::shown`].
#[inline(always)]
fn look_at<S: Simd>(ids: &I32x16, seen: &mut [u8]) -> i32 {
    seen[place(ids.0[0])] = 1;
    if is_uniform::<S>(ids) {
        return ids.0[0];
    }
    for id in &ids.0[1..] {
        seen[place(*id)] = 1;
    }
    SEVERAL
}

/// Prepares the triangles that a picture shows.
pub(super) struct Collect<'a> {
    pub(super) scene: &'a RenderScene,
    pub(super) camera: &'a PinholeCamera,
    /// From each instance's mesh to the view frame.
    pub(super) maps: &'a [Affine3],
    pub(super) visibility: &'a Visibility,
    /// Pixels of the rasteriser's grid per pixel of the image.
    pub(super) scale: usize,
    /// Which blocks of pixels are to be shaded; all if there is none.
    pub(super) stale: Option<&'a [bool]>,
    pub(super) surfaces: &'a mut Surfaces,
}

impl Kernel for Collect<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { scene, camera, maps, visibility, scale, stale, surfaces } = self;
        surfaces.start(scene.n_ids(), visibility.ids.len());
        match stale {
            Some(stale) => {
                let per_row = camera.side >> Square::WIDTH_BITS;
                surfaces.look_at_stale::<S>(&visibility.ids, stale, per_row, scale);
            }
            None => surfaces.look_at::<S>(&visibility.ids),
        }
        let plane = Plane::<S>::new(camera);
        for ((instance, map), &first_id) in scene.instances.iter().zip(maps).zip(&scene.first_id) {
            let mesh = &instance.mesh().packed;
            let lines = place(first_id as i32)..place(first_id as i32) + mesh.corners.len() * N_LANES;
            let Surfaces { looks, wraps, seen, list, .. } = &mut *surfaces;
            let list = marked::<S>(&mut seen[lines.clone()], list);
            if list.is_empty() {
                continue;
            }
            let kit = Kit::<S>::new(instance, map, camera, scale);
            let (looks, wraps) = (&mut looks[lines.clone()], &mut wraps[lines]);
            for sixteen in list {
                kit.write(&mesh.triangles, sixteen, &plane, looks, wraps);
            }
        }
        // The rest is nothing's.
        surfaces.seen[..N_LANES].fill(0);
        surfaces.is_marked = false;
    }
}

/// Takes the marks of a mesh's triangles away, and gives the numbers of those that had one; the last sixteen may be filled up
/// with the first of all.
#[inline(always)]
fn marked<'a, S: Simd>(marks: &mut [u8], list: &'a mut Vec<i32>) -> &'a [[i32; N_LANES]] {
    list.resize(list.len().max(marks.len() + 2 * N_LANES), 0);
    let mut n = 0;
    for (batch, marks) in marks.as_chunks_mut().0.iter_mut().enumerate() {
        // Most lie in long runs of which nothing is seen.
        if *marks == [0; N_LANES] {
            continue;
        }
        let marks = core::mem::replace(marks, [0; N_LANES]);
        let [low, high] = each!(k in 2 => {
            let eight = u64::from_le_bytes(each!(i in 8 => marks[8 * k + i]));
            // Moves the lowest bits of the eight bytes side by side.
            eight.wrapping_mul(0x0102_0408_1020_4080) >> 56
        });
        let numbers = S::I::load(&I32x16::INDICES) + S::I::splat((batch * N_LANES) as i32);
        let (to, _) = list[n..].split_first_chunk_mut().expect("room for a vector behind the last one");
        n += S::compress(numbers, S::M::from_bits((high << 8 | low) as u16), to);
    }
    let first = list[0];
    list[n..n + N_LANES].fill(first);
    &list.as_chunks().0[..n.div_ceil(N_LANES)]
}

/// Whether all lanes are the same.
#[inline(always)]
pub(super) fn is_uniform<S: Simd>(ids: &I32x16) -> bool {
    S::I::load(ids).eq(S::I::splat(ids.0[0])).to_bits() == u16::MAX
}

/// From vectors v to d·v as a function of the pixel, where d = (x/z, y/z, 1) is the ray through its centre, all in the
/// centred frame.
struct Plane<S: Simd> {
    per_focal: S::F,
    principal: S::F,
}

impl<S: Simd> Plane<S> {
    #[inline(always)]
    fn new(camera: &PinholeCamera) -> Self {
        Self {
            per_focal: S::F::splat(1.0 / camera.focal_px),
            principal: S::F::splat(0.5 - camera.side as f32 / 2.0),
        }
    }

    /// Value at pixel (0, 0), step to the right, step down.
    #[inline(always)]
    fn of(&self, [x, y, z]: Vectors<S>) -> Vectors<S> {
        let (right, down) = (x * self.per_focal, y * self.per_focal);
        [(right + down).mul_add(self.principal, z), right, down]
    }
}

/// What an instance's batches have in common.
struct Kit<S: Simd> {
    /// To the centred frame, where corners are put on the rasteriser's grid; the triple products that weights are made of are
    /// the same there.
    centred_from_steps: Map<S>,
    view_from_normal: Map<S>,
    /// Texture tiles per step of the mesh along its axes, if it is textured.
    tiles: Option<Vectors<S>>,
    color: [f32; 3],
    specular: f32,
    texture: i32,
    snap: Snap,
}

impl<S: Simd> Kit<S> {
    #[inline(always)]
    fn new(instance: &Instance, view_from_mesh: &Affine3, camera: &PinholeCamera, scale: usize) -> Self {
        let (material, steps) = (&instance.material, instance.mesh().packed.grid_step);
        let from_mesh =
            camera.centring_shear().map_or(*view_from_mesh, |centring| centring.compose(view_from_mesh));
        let normals = Affine3 { linear: view_from_mesh.cofactors(), offset: [0.0; 3] };
        Self {
            centred_from_steps: Map::new(&from_mesh.scale_columns(steps)),
            view_from_normal: Map::new(&normals),
            tiles: match material.texture {
                Some(texture) => {
                    let per_tile = 1.0 / mip_chain(texture).tile_m;
                    Some(each!(k in 3 => S::F::splat(instance.scale[k] * per_tile * steps[k])))
                }
                None => None,
            },
            color: material.color,
            specular: material.specular,
            texture: material.texture.map_or(-1, |texture| texture as i32),
            snap: Snap::new(camera, scale),
        }
    }

    /// Writes the lines of sixteen of the mesh's triangles.
    #[inline(always)]
    fn write(
        &self,
        triangles: &[F32x16],
        which: &[i32; N_LANES],
        plane: &Plane<S>,
        looks: &mut [F32x16],
        wraps: &mut [F32x16],
    ) {
        let numbers = S::transpose(each!(i in 16 => S::F::load(&triangles[which[i] as usize])));
        // In steps, by corner and axis.
        let corners = each!(k in 3 => each!(axis in 3 => {
            let half = 3 * k + axis;
            let two = numbers[TriangleRecord::CORNERS + half / 2].bitcast_i32();
            (if half.is_multiple_of(2) { two.shl::<16>().shr_arithmetic::<16>() } else { two.shr_arithmetic::<16>() }).to_f32()
        }));
        let last = numbers[TriangleRecord::CORNERS + 4].bitcast_i32().shr_arithmetic::<16>();
        let flat = (last & S::I::splat(TriangleRecord::FLAT_BIT)).gt(S::I::splat(0));
        let [p, q, r] = each!(k in 3 => self.snap.on_grid::<S>(self.centred_from_steps.of(corners[k])));
        let (e, f) = (minus::<S>(&q, &p), minus::<S>(&r, &p));
        let weights = Weights::<S> {
            a: plane.of(cross::<S>(&p, &f)),
            b: plane.of(cross::<S>(&e, &p)),
            n: plane.of(cross::<S>(&f, &e)),
        };
        let normals = each!(k in 3 =>
            self.view_from_normal.of(each!(axis in 3 => numbers[TriangleRecord::NORMALS + 3 * k + axis])));
        let mut rows = [S::F::splat(0.0); N_LANES];
        for axis in 0..3 {
            let [value, right, down] = weights.plane(each!(k in 3 => normals[k][axis]));
            // A constant normal needs no division: its direction is all that counts.
            rows[Look::NORMAL + 3 * axis] = normals[0][axis].select_or(flat, value);
            rows[Look::NORMAL + 3 * axis + 1] = S::F::splat(0.0).select_or(flat, right);
            rows[Look::NORMAL + 3 * axis + 2] = S::F::splat(0.0).select_or(flat, down);
            rows[Look::COLOR + axis] = S::F::splat(self.color[axis]);
        }
        rows[Look::SPECULAR] = S::F::splat(self.specular);
        rows[Look::TEXTURE] = S::I::splat(self.texture).bitcast_f32();
        rows[Look::FLAT] = S::F::splat(1.0).select_or(flat, S::F::splat(0.0));
        store_columns::<S>(rows, which, looks);
        if let Some(tiles) = &self.tiles {
            let facing = last & S::I::splat(TriangleRecord::AXIS_MASK);
            let uv = each!(k in 3 => unwrap::<S>(&corners[k], facing, tiles));
            let mut rows = [S::F::splat(0.0); N_LANES];
            rows[Wrap::N..Wrap::N + 3].copy_from_slice(&weights.n);
            rows[Wrap::U..Wrap::U + 3].copy_from_slice(&weights.plane(each!(k in 3 => uv[k][0])));
            rows[Wrap::V..Wrap::V + 3].copy_from_slice(&weights.plane(each!(k in 3 => uv[k][1])));
            store_columns::<S>(rows, which, wraps);
        }
    }
}

/// a, b and n of the module's head.
struct Weights<S: Simd> {
    a: Vectors<S>,
    b: Vectors<S>,
    n: Vectors<S>,
}

impl<S: Simd> Weights<S> {
    /// An attribute times n over the image, from its values at the corners.
    #[inline(always)]
    fn plane(&self, [t0, t1, t2]: [S::F; 3]) -> Vectors<S> {
        let (along_e, along_f) = (t1 - t0, t2 - t0);
        each!(k in 3 => along_f.mul_add(self.b[k], along_e.mul_add(self.a[k], t0 * self.n[k])))
    }
}

#[inline(always)]
fn store_columns<S: Simd>(rows: [S::F; N_LANES], which: &[i32; N_LANES], lines: &mut [F32x16]) {
    let columns = S::transpose(rows);
    for (column, place) in columns.iter().zip(which) {
        column.store(&mut lines[*place as usize]);
    }
}

/// Texture coordinates of a corner in tiles, given its place in steps: see [`crate::render::mesh::ProjectionAxis`].
#[inline(always)]
fn unwrap<S: Simd>(corner: &Vectors<S>, facing: S::I, tiles: &Vectors<S>) -> [S::F; 2] {
    let [x, y, z] = each!(k in 3 => corner[k] * tiles[k]);
    let (faces_x, faces_y) = (facing.eq(S::I::splat(0)), facing.eq(S::I::splat(1)));
    [z.select_or(faces_x, x), z.select_or(faces_y, y)]
}

/// Moves points to where the rasteriser puts them, 1/256 px apart, so that no pixel of a triangle lies outside of it.
struct Snap {
    scale: f32,
    middle: f32,
    near_m: f32,
}

impl Snap {
    fn new(camera: &PinholeCamera, scale: usize) -> Self {
        let per_px = (256 * scale) as f32;
        Self {
            scale: camera.focal_px * per_px,
            middle: camera.side as f32 / 2.0 * per_px,
            near_m: camera.clip_m[0],
        }
    }

    /// Points behind the near plane stay where they are.
    #[inline(always)]
    fn on_grid<S: Simd>(&self, [x, y, z]: Vectors<S>) -> Vectors<S> {
        let (scale, middle) = (S::F::splat(self.scale), S::F::splat(self.middle));
        let depth = S::F::splat(1.0) / z;
        let per_scale = S::F::splat(1.0 / self.scale);
        // Beyond 2²³ there is no grid to speak of, and the numbers' own rounding is as fine as it gets.
        let hidden = S::F::splat(self.near_m).gt(z);
        let [x, y] = each!(k in 2 => {
            let t = [x, y][k];
            let on_image = (t * depth).mul_add(scale, middle).round_to_i32().to_f32();
            t.select_or(hidden, (on_image - middle) * per_scale * z)
        });
        [x, y, z]
    }
}

#[inline(always)]
fn minus<S: Simd>(a: &Vectors<S>, b: &Vectors<S>) -> Vectors<S> {
    each!(k in 3 => a[k] - b[k])
}

#[inline(always)]
fn cross<S: Simd>(a: &Vectors<S>, b: &Vectors<S>) -> Vectors<S> {
    each!(k in 3 => {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        a[i].mul_add(b[j], S::F::splat(0.0) - a[j] * b[i])
    })
}
