//! The triangles that are visible, made ready for shading: everything that runs linearly over the image.
//!
//! With the corners at p, p + e and p + f in the view frame, the ray along d through a pixel's centre meets the
//! triangle's plane at p + (a/n) e + (b/n) f, where a = d·(p×f), b = d·(e×p), n = d·(f×e) (Möller and Trumbore,
//! "Fast, minimum storage ray/triangle intersection", 1997). So an attribute with the values t at p and t + t_e, t + t_f
//! at the others is (t n + t_e a + t_f b) / n there: a quotient of two functions that are linear over the image.

use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::isa::Kernel;
use crate::render::cpu::simd::{F32x16, FloatLike, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask};
use crate::render::cpu::visibility::instances::TransformX16;
use crate::render::cpu::visibility::projection::Vectors;
use crate::render::cpu::visibility::raster::{MAX_TILES, Visibility};
use crate::render::cpu::visibility::tile::{Tile4x4, TileLayout};
use crate::render::math::affine::Affine3;
use crate::render::mesh::TriangleRecord;
use crate::render::scene::camera::PinholeCamera;
use crate::render::scene::{Instance, RenderScene};
use crate::render::texture::mip_chain;

/// Numbers of one visible triangle that every pixel needs, by index into a line.
pub(in crate::render::cpu) struct SurfaceRecord;

impl SurfaceRecord {
    /// Where the normal begins, in the view frame and of any length: per axis the value at pixel (0, 0) and its changes
    /// to the right and downwards.
    pub(in crate::render::cpu) const NORMAL: usize = 0;
    /// Where the colour begins, linear RGB.
    pub(in crate::render::cpu) const COLOR: usize = 9;
    /// Strength of the highlight.
    pub(in crate::render::cpu) const SPECULAR: usize = 12;
    /// Texture as the bits of an integer, -1 for none.
    pub(in crate::render::cpu) const TEXTURE: usize = 13;
    /// 1 if the normal is the same everywhere.
    pub(in crate::render::cpu) const FLAT: usize = 14;
}

/// Numbers that textured pixels need: n, u n and v n over the image.
pub(in crate::render::cpu) struct UvRecord;

impl UvRecord {
    /// Where n begins.
    pub(in crate::render::cpu) const N: usize = 0;
    /// Where u n begins, u in tiles.
    pub(in crate::render::cpu) const U: usize = 3;
    /// Where v n begins.
    pub(in crate::render::cpu) const V: usize = 6;
}

/// The visible triangles of one view.
pub(in crate::render::cpu) struct VisibleSurfaces {
    /// Laid out as [`SurfaceRecord`], by [`place`]; that of nothing is [`BACKGROUND_RECORD`].
    pub(in crate::render::cpu) records: Vec<F32x16>,
    /// Laid out as [`UvRecord`], by [`place`]; only those with a texture are filled in.
    pub(in crate::render::cpu) uv_records: Vec<F32x16>,
    /// What each tile shows everywhere, by id, or [`MIXED`], or [`UNCHANGED`].
    pub(in crate::render::cpu) tile_ids: Vec<i32>,
    /// 1 where a triangle is visible, by [`place`].
    visible: Vec<u8>,
    /// Whether there may be any such.
    is_marked: bool,
    /// Room for the numbers of one mesh's triangles.
    list: Vec<i32>,
}

/// Where a triangle's lines are, given its id or [`crate::render::cpu::visibility::raster::NO_ID`].
#[inline(always)]
pub(in crate::render::cpu) fn record_index(id: i32) -> usize {
    (id + N_LANES as i32) as usize
}

/// More than one triangle, or one and nothing.
pub(in crate::render::cpu) const MIXED: i32 = -2;
/// What has been shaded before.
pub(in crate::render::cpu) const UNCHANGED: i32 = -3;

/// SurfaceRecord of what is not there: black.
pub(in crate::render::cpu) const BACKGROUND_RECORD: F32x16 = {
    let mut line = F32x16::ZERO;
    line.0[SurfaceRecord::NORMAL + 6] = -1.0;
    line.0[SurfaceRecord::TEXTURE] = f32::from_bits(u32::MAX);
    line
};

impl VisibleSurfaces {
    /// Room for what a scene usually shows.
    pub(in crate::render::cpu) fn new() -> Self {
        const N_IDS: usize = 1 << 16;
        Self {
            records: Vec::with_capacity(N_IDS),
            uv_records: Vec::with_capacity(N_IDS),
            tile_ids: Vec::with_capacity(MAX_TILES),
            visible: Vec::with_capacity(N_IDS),
            is_marked: false,
            list: Vec::with_capacity(N_IDS),
        }
    }

    /// Makes room for all of a scene's triangles, none of them visible yet.
    fn start(&mut self, n_ids: usize, n_tiles: usize) {
        let n_lines = self.records.len().max(n_ids + N_LANES);
        self.records.resize(n_lines, BACKGROUND_RECORD);
        self.uv_records.resize(n_lines, F32x16::ZERO);
        if self.is_marked {
            self.visible.fill(0);
        }
        self.visible.resize(n_lines, 0);
        self.is_marked = true;
        self.tile_ids.resize(n_tiles, MIXED);
    }

    #[inline(always)]
    fn mark_tile<S: Simd>(&mut self, tiles: &[I32x16]) {
        let Self { tile_ids, visible, .. } = self;
        for (ids, tile_ids) in tiles.iter().zip(tile_ids) {
            *tile_ids = mark_tile::<S>(ids, visible);
        }
    }

    /// The same for those tiles that lie in the tiles of pixels that are stale.
    #[inline(always)]
    fn mark_stale_tiles<S: Simd>(&mut self, tiles: &[I32x16], stale: &[bool], per_row: usize, scale: usize) {
        let Self { tile_ids, visible, .. } = self;
        if scale == 1 {
            for ((ids, tile_ids), stale) in tiles.iter().zip(tile_ids).zip(stale) {
                *tile_ids = if *stale { mark_tile::<S>(ids, visible) } else { UNCHANGED };
            }
            return;
        }
        let rows = tiles.chunks_exact(per_row * scale).zip(tile_ids.chunks_exact_mut(per_row * scale));
        for (row, (ids, tile_ids)) in rows.enumerate() {
            let stale = &stale[row / scale * per_row..][..per_row];
            let columns = ids.chunks_exact(scale).zip(tile_ids.chunks_exact_mut(scale));
            for ((ids, tile_ids), stale) in columns.zip(stale) {
                for (ids, tile_ids) in ids.iter().zip(tile_ids) {
                    *tile_ids = if *stale { mark_tile::<S>(ids, visible) } else { UNCHANGED };
                }
            }
        }
    }
}

/// Marks a tile's triangles as visible, and says what it shows: see [`VisibleSurfaces::tile_ids`].
#[inline(always)]
fn mark_tile<S: Simd>(ids: &I32x16, visible: &mut [u8]) -> i32 {
    visible[record_index(ids.0[0])] = 1;
    if is_uniform::<S>(ids) {
        return ids.0[0];
    }
    for id in &ids.0[1..] {
        visible[record_index(*id)] = 1;
    }
    MIXED
}

/// Prepares the triangles that a picture shows.
pub(in crate::render::cpu) struct PrepareSurfaces<'a> {
    pub(in crate::render::cpu) scene: &'a RenderScene,
    pub(in crate::render::cpu) camera: &'a PinholeCamera,
    /// From each instance's mesh to the view frame.
    pub(in crate::render::cpu) maps: &'a [Affine3],
    pub(in crate::render::cpu) visibility: &'a Visibility,
    /// VisibilityTarget of the rasteriser's grid per pixel of the image.
    pub(in crate::render::cpu) scale: usize,
    /// Which tiles of pixels are to be shaded; all if there is none.
    pub(in crate::render::cpu) stale: Option<&'a [bool]>,
    pub(in crate::render::cpu) surfaces: &'a mut VisibleSurfaces,
}

impl Kernel for PrepareSurfaces<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { scene, camera, maps, visibility, scale, stale, surfaces } = self;
        surfaces.start(scene.n_ids(), visibility.ids.len());
        match stale {
            Some(stale) => {
                let per_row = camera.side >> Tile4x4::WIDTH_BITS;
                surfaces.mark_stale_tiles::<S>(&visibility.ids, stale, per_row, scale);
            }
            None => surfaces.mark_tile::<S>(&visibility.ids),
        }
        let plane = Plane::<S>::new(camera);
        for ((instance, map), &first_id) in scene.instances.iter().zip(maps).zip(&scene.first_id) {
            let mesh = &instance.mesh().packed;
            let lines =
                record_index(first_id as i32)..record_index(first_id as i32) + mesh.corners.len() * N_LANES;
            let VisibleSurfaces { records, uv_records, visible, list, .. } = &mut *surfaces;
            let list = marked::<S>(&mut visible[lines.clone()], list);
            if list.is_empty() {
                continue;
            }
            let setup = InstanceSetup::<S>::new(instance, map, camera, scale);
            let (records, uv_records) = (&mut records[lines.clone()], &mut uv_records[lines]);
            for sixteen in list {
                setup.write(&mesh.triangles, sixteen, &plane, records, uv_records);
            }
        }
        // The rest is nothing's.
        surfaces.visible[..N_LANES].fill(0);
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
        // Most lie in long runs of which nothing is visible.
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
pub(in crate::render::cpu) fn is_uniform<S: Simd>(ids: &I32x16) -> bool {
    S::I::load(ids).eq(S::I::splat(ids.0[0])).to_bits() == u16::MAX
}

/// From vectors v to d·v as a function of the pixel, where d = (x/z, y/z, 1) is the ray through its centre, all in the
/// centred frame.
struct Plane<S: Simd> {
    inv_focal: S::F,
    principal: S::F,
}

impl<S: Simd> Plane<S> {
    #[inline(always)]
    fn new(camera: &PinholeCamera) -> Self {
        Self {
            inv_focal: S::F::splat(1.0 / camera.focal_px),
            principal: S::F::splat(0.5 - camera.side as f32 / 2.0),
        }
    }

    /// Value at pixel (0, 0), step to the right, step down.
    #[inline(always)]
    fn of(&self, [x, y, z]: Vectors<S>) -> Vectors<S> {
        let (right, down) = (x * self.inv_focal, y * self.inv_focal);
        [(right + down).mul_add(self.principal, z), right, down]
    }
}

/// What an instance's batches have in common.
struct InstanceSetup<S: Simd> {
    /// To the centred frame, where corners are put on the rasteriser's grid; the triple products that weights are made of are
    /// the same there.
    centred_from_steps: TransformX16<S>,
    view_from_normal: TransformX16<S>,
    /// Texture tiles per step of the mesh along its axes, if it is textured.
    tiles: Option<Vectors<S>>,
    color: [f32; 3],
    specular: f32,
    texture: i32,
    snap: GridSnap,
}

impl<S: Simd> InstanceSetup<S> {
    #[inline(always)]
    fn new(instance: &Instance, view_from_mesh: &Affine3, camera: &PinholeCamera, scale: usize) -> Self {
        let (material, steps) = (&instance.material, instance.mesh().packed.grid_step);
        let from_mesh =
            camera.centring_shear().map_or(*view_from_mesh, |centring| centring.compose(view_from_mesh));
        let normals = Affine3 { linear: view_from_mesh.cofactors(), offset: [0.0; 3] };
        Self {
            centred_from_steps: TransformX16::new(&from_mesh.scale_columns(steps)),
            view_from_normal: TransformX16::new(&normals),
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
            snap: GridSnap::new(camera, scale),
        }
    }

    /// Writes the lines of sixteen of the mesh's triangles.
    #[inline(always)]
    fn write(
        &self,
        triangles: &[F32x16],
        which: &[i32; N_LANES],
        plane: &Plane<S>,
        records: &mut [F32x16],
        uv_records: &mut [F32x16],
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
        let weights = EdgePlanes::<S> {
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
            rows[SurfaceRecord::NORMAL + 3 * axis] = normals[0][axis].select_or(flat, value);
            rows[SurfaceRecord::NORMAL + 3 * axis + 1] = S::F::splat(0.0).select_or(flat, right);
            rows[SurfaceRecord::NORMAL + 3 * axis + 2] = S::F::splat(0.0).select_or(flat, down);
            rows[SurfaceRecord::COLOR + axis] = S::F::splat(self.color[axis]);
        }
        rows[SurfaceRecord::SPECULAR] = S::F::splat(self.specular);
        rows[SurfaceRecord::TEXTURE] = S::I::splat(self.texture).bitcast_f32();
        rows[SurfaceRecord::FLAT] = S::F::splat(1.0).select_or(flat, S::F::splat(0.0));
        store_columns::<S>(rows, which, records);
        if let Some(tiles) = &self.tiles {
            let facing = last & S::I::splat(TriangleRecord::AXIS_MASK);
            let uv = each!(k in 3 => unwrap::<S>(&corners[k], facing, tiles));
            let mut rows = [S::F::splat(0.0); N_LANES];
            rows[UvRecord::N..UvRecord::N + 3].copy_from_slice(&weights.n);
            rows[UvRecord::U..UvRecord::U + 3].copy_from_slice(&weights.plane(each!(k in 3 => uv[k][0])));
            rows[UvRecord::V..UvRecord::V + 3].copy_from_slice(&weights.plane(each!(k in 3 => uv[k][1])));
            store_columns::<S>(rows, which, uv_records);
        }
    }
}

/// a, b and n of the module's head.
struct EdgePlanes<S: Simd> {
    a: Vectors<S>,
    b: Vectors<S>,
    n: Vectors<S>,
}

impl<S: Simd> EdgePlanes<S> {
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
struct GridSnap {
    scale: f32,
    middle: f32,
    near_m: f32,
}

impl GridSnap {
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
        let behind_near = S::F::splat(self.near_m).gt(z);
        let [x, y] = each!(k in 2 => {
            let t = [x, y][k];
            let on_image = (t * depth).mul_add(scale, middle).round_to_i32().to_f32();
            t.select_or(behind_near, (on_image - middle) * per_scale * z)
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
