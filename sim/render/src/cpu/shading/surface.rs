//! Attribute setup of the visible triangles: the shading attribute planes, which are linear over the image.
//!
//! With the corners at p, p + e and p + f in the view frame, the ray along d through a pixel's centre
//! intersects the triangle's plane at p + (a/n) e + (b/n) f, where a = d·(p×f), b = d·(e×p), n = d·(f×e)
//! (Möller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997). An attribute with the
//! values t at p and t + t_e, t + t_f at the other corners is therefore (t n + t_e a + t_f b) / n there: a
//! quotient of two functions that are linear over the image.

use crate::cpu::simd::each::each;
use crate::cpu::simd::isa::Kernel;
use crate::cpu::simd::{F32x16, FloatLike, I32x16, N_LANES, Simd, SimdF32, SimdI32, SimdMask};
use crate::cpu::visibility::instances::TransformX16;
use crate::cpu::visibility::projection::Vectors;
use crate::cpu::visibility::raster::Visibility;
use crate::math::affine::Affine3;
use crate::mesh::TriangleRecord;
use crate::prepared::camera::PinholeCamera;
use crate::prepared::{Instance, RenderScene};
use crate::texture;

/// Layout of a surface record: lane indices of the values of a visible triangle that every pixel needs.
pub(crate) struct SurfaceRecord;

impl SurfaceRecord {
    /// First lane of the normal, in the view frame and not normalised: per axis the value at pixel (0, 0)
    /// and its changes per pixel to the right and down.
    pub(crate) const NORMAL: usize = 0;
    /// First lane of the colour, linear RGB.
    pub(crate) const COLOR: usize = 9;
    /// Specular reflectance in white; 0 for a metal.
    pub(crate) const SPECULAR: usize = 12;
    /// Texture index as the bits of an `i32`, -1 for none.
    pub(crate) const TEXTURE: usize = 13;
    /// 1 if the normal is constant, otherwise 0.
    pub(crate) const FLAT: usize = 14;
    /// 1 for a metal, 0 for anything else.
    pub(crate) const METALLIC: usize = 15;
}

/// Layout of a texture-coordinate record: lane indices of the attribute planes n, u n and v n. Each plane
/// is the value at pixel (0, 0) and its changes per pixel to the right and down.
pub(crate) struct UvRecord;

impl UvRecord {
    /// First lane of n.
    pub(crate) const N: usize = 0;
    /// First lane of u n, with u in texture tiles.
    pub(crate) const U: usize = 3;
    /// First lane of v n.
    pub(crate) const V: usize = 6;
}

/// The visible triangles of one view.
pub(crate) struct VisibleSurfaces {
    /// [`SurfaceRecord`]s, indexed by [`record_index`]. That of the background is [`BACKGROUND_RECORD`].
    pub(crate) records: Vec<F32x16>,
    /// [`UvRecord`]s, indexed by [`record_index`]. Only those of textured triangles are valid.
    pub(crate) uv_records: Vec<F32x16>,
    /// Per visibility tile the id that all of its lanes show, or [`MIXED`], or [`UNCHANGED`].
    pub(crate) tile_ids: Vec<i32>,
    /// 1 for each visible triangle, indexed by [`record_index`].
    visible: Vec<u8>,
    /// `true` if `visible` may contain nonzero entries.
    is_marked: bool,
    /// Scratch list of the visible triangles of one mesh.
    indices: Vec<i32>,
}

/// Returns the index of a triangle's records, given its id or
/// [`NO_ID`](crate::cpu::visibility::raster::NO_ID).
#[inline(always)]
pub(crate) fn record_index(id: i32) -> usize {
    (id + N_LANES as i32) as usize
}

/// Marks a tile that shows more than one triangle, or a triangle and background.
pub(crate) const MIXED: i32 = -2;
/// Marks a tile that is unchanged from the static layer and is not shaded.
pub(crate) const UNCHANGED: i32 = -3;

/// [`SurfaceRecord`] of the background: a black surface.
pub(crate) const BACKGROUND_RECORD: F32x16 = {
    let mut record = F32x16::ZERO;
    record.0[SurfaceRecord::NORMAL + 6] = -1.0;
    record.0[SurfaceRecord::TEXTURE] = f32::from_bits(u32::MAX);
    record
};

impl VisibleSurfaces {
    /// Creates an empty buffer with capacity for a typical scene.
    pub(crate) fn new() -> Self {
        const N_IDS: usize = 1 << 16;
        Self {
            records: Vec::with_capacity(N_IDS),
            uv_records: Vec::with_capacity(N_IDS),
            tile_ids: Vec::new(),
            visible: Vec::with_capacity(N_IDS),
            is_marked: false,
            indices: Vec::with_capacity(N_IDS),
        }
    }

    /// Grows the buffers to all triangles of a scene and marks none of them as visible.
    fn start(&mut self, n_ids: usize, n_tiles: usize) {
        let n_records = self.records.len().max(n_ids + N_LANES);
        self.records.resize(n_records, BACKGROUND_RECORD);
        self.uv_records.resize(n_records, F32x16::ZERO);
        if self.is_marked {
            self.visible.fill(0);
        }
        self.visible.resize(n_records, 0);
        self.is_marked = true;
        self.tile_ids.resize(n_tiles, MIXED);
    }

    /// Marks the triangles that the visibility tiles show.
    #[inline(always)]
    fn mark_tiles<S: Simd>(&mut self, tiles: &[I32x16]) {
        let Self { tile_ids, visible, .. } = self;
        for (ids, tile_ids) in tiles.iter().zip(tile_ids) {
            *tile_ids = mark_tile::<S>(ids, visible);
        }
    }

    /// Like [`Self::mark_tiles`], for the visibility tiles within stale pixel tiles only.
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

/// Marks the triangles of a tile as visible. Returns its entry in [`VisibleSurfaces::tile_ids`].
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

/// Kernel that marks the visible triangles of a view and writes their records.
pub(crate) struct PrepareSurfaces<'a> {
    pub(crate) scene: &'a RenderScene,
    pub(crate) camera: &'a PinholeCamera,
    /// Per instance the transform from its mesh to the view frame.
    pub(crate) view_from_mesh: &'a [Affine3],
    pub(crate) visibility: &'a Visibility,
    /// Visibility samples along each edge of a pixel.
    pub(crate) scale: usize,
    /// Per pixel tile `true` if it must be shaded; `None` for all tiles.
    pub(crate) stale: Option<&'a [bool]>,
    pub(crate) surfaces: &'a mut VisibleSurfaces,
}

impl Kernel for PrepareSurfaces<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { scene, camera, view_from_mesh, visibility, scale, stale, surfaces } = self;
        surfaces.start(scene.n_ids(), visibility.ids.len());
        match stale {
            Some(stale) => {
                let [per_row, _] = visibility.pixel_tiles(scale);
                surfaces.mark_stale_tiles::<S>(&visibility.ids, stale, per_row, scale);
            }
            None => surfaces.mark_tiles::<S>(&visibility.ids),
        }
        let planes = PlaneBuilder::<S>::new(camera);
        for ((instance, transform), &first_id) in
            scene.instances.iter().zip(view_from_mesh).zip(&scene.first_id)
        {
            let mesh = &instance.mesh().packed;
            let range =
                record_index(first_id as i32)..record_index(first_id as i32) + mesh.corners.len() * N_LANES;
            let VisibleSurfaces { records, uv_records, visible, indices, .. } = &mut *surfaces;
            let batches = take_marked::<S>(&mut visible[range.clone()], indices);
            if batches.is_empty() {
                continue;
            }
            let setup = InstanceSetup::<S>::new(instance, transform, camera, scale);
            let (records, uv_records) = (&mut records[range.clone()], &mut uv_records[range]);
            for batch in batches {
                setup.write(&mesh.triangles, batch, &planes, records, uv_records);
            }
        }
        // The first entries belong to the background.
        surfaces.visible[..N_LANES].fill(0);
        surfaces.is_marked = false;
    }
}

/// Clears the marks of a mesh's triangles and returns the indices of the marked ones in batches of sixteen.
/// The last batch is padded with the first index.
#[inline(always)]
fn take_marked<'a, S: Simd>(marks: &mut [u8], indices: &'a mut Vec<i32>) -> &'a [[i32; N_LANES]] {
    indices.resize(indices.len().max(marks.len() + 2 * N_LANES), 0);
    let mut n = 0;
    for (batch, marks) in marks.as_chunks_mut().0.iter_mut().enumerate() {
        // Invisible triangles form long runs.
        if *marks == [0; N_LANES] {
            continue;
        }
        let marks = core::mem::replace(marks, [0; N_LANES]);
        let [low, high] = each!(k in 2 => {
            let eight = u64::from_le_bytes(each!(i in 8 => marks[8 * k + i]));
            // Gathers the lowest bit of each byte into the top byte.
            eight.wrapping_mul(0x0102_0408_1020_4080) >> 56
        });
        let triangles = S::I::load(&I32x16::INDICES) + S::I::splat((batch * N_LANES) as i32);
        let (to, _) = indices[n..].split_first_chunk_mut().expect("room for a vector past the end");
        n += S::compress(triangles, S::M::from_bits((high << 8 | low) as u16), to);
    }
    let first = indices[0];
    indices[n..n + N_LANES].fill(first);
    &indices.as_chunks().0[..n.div_ceil(N_LANES)]
}

/// Returns `true` if all lanes are equal.
#[inline(always)]
pub(crate) fn is_uniform<S: Simd>(ids: &I32x16) -> bool {
    S::I::load(ids).eq(S::I::splat(ids.0[0])).to_bits() == u16::MAX
}

/// Converts vectors v to the planes d·v over the image, where d = (x/z, y/z, 1) is the ray through a
/// pixel's centre.
struct PlaneBuilder<S: Simd> {
    inv_focal: S::F,
    /// Column of pixel (0, 0) relative to the centre of the image.
    left: S::F,
    /// Its row, minus its column.
    top_minus_left: S::F,
}

impl<S: Simd> PlaneBuilder<S> {
    #[inline(always)]
    fn new(camera: &PinholeCamera) -> Self {
        let [left, top] = camera.half_px().map(|half_px| 0.5 - half_px);
        Self {
            inv_focal: S::F::splat(1.0 / camera.focal_px),
            left: S::F::splat(left),
            top_minus_left: S::F::splat(top - left),
        }
    }

    /// Returns the value of d·v at pixel (0, 0) and its changes per pixel to the right and down.
    #[inline(always)]
    fn dot_ray(&self, [x, y, z]: Vectors<S>) -> Vectors<S> {
        let (right, down) = (x * self.inv_focal, y * self.inv_focal);
        [down.mul_add(self.top_minus_left, (right + down).mul_add(self.left, z)), right, down]
    }
}

/// Per-instance inputs of the attribute setup.
struct InstanceSetup<S: Simd> {
    /// Transform from mesh grid steps to the view frame, in which corners are snapped to the rasteriser's
    /// grid.
    view_from_steps: TransformX16<S>,
    view_from_normal: TransformX16<S>,
    /// Texture tiles per mesh grid step along each axis; `None` if the instance is untextured.
    tiles_per_step: Option<Vectors<S>>,
    color: [f32; 3],
    specular: f32,
    metallic: f32,
    texture: i32,
    snap: GridSnap,
}

impl<S: Simd> InstanceSetup<S> {
    #[inline(always)]
    fn new(instance: &Instance, view_from_mesh: &Affine3, camera: &PinholeCamera, scale: usize) -> Self {
        let (material, steps) = (&instance.material, instance.mesh().packed.grid_step);
        let normals = Affine3 { linear: view_from_mesh.cofactors(), offset: [0.0; 3] };
        Self {
            view_from_steps: TransformX16::new(&view_from_mesh.scale_columns(steps)),
            view_from_normal: TransformX16::new(&normals),
            tiles_per_step: match material.texture {
                Some(texture) => {
                    let per_tile = 1.0 / texture::image(texture).tile_m;
                    Some(each!(k in 3 => S::F::splat(instance.scale[k] * per_tile * steps[k])))
                }
                None => None,
            },
            color: material.color,
            specular: material.specular,
            metallic: material.metallic,
            texture: material.texture.map_or(-1, |texture| texture as i32),
            snap: GridSnap::new(camera, scale),
        }
    }

    /// Writes the records of sixteen triangles of the mesh, given their indices within it.
    #[inline(always)]
    fn write(
        &self,
        triangles: &[F32x16],
        which: &[i32; N_LANES],
        planes: &PlaneBuilder<S>,
        records: &mut [F32x16],
        uv_records: &mut [F32x16],
    ) {
        let fields = S::transpose(each!(i in 16 => S::F::load(&triangles[which[i] as usize])));
        // Corner positions in grid steps, by corner and axis.
        let corners = each!(k in 3 => each!(axis in 3 => {
            let half_idx = 3 * k + axis;
            let pair = fields[TriangleRecord::CORNERS + half_idx / 2].bitcast_i32();
            let is_low = half_idx.is_multiple_of(2);
            (if is_low { pair.shl::<16>().shr_arithmetic::<16>() } else { pair.shr_arithmetic::<16>() }).to_f32()
        }));
        let last = fields[TriangleRecord::CORNERS + 4].bitcast_i32().shr_arithmetic::<16>();
        let flat = (last & S::I::splat(TriangleRecord::FLAT_BIT)).gt(S::I::splat(0));
        let [p, q, r] = each!(k in 3 => self.snap.snap::<S>(self.view_from_steps.of(corners[k])));
        let (e, f) = (sub::<S>(&q, &p), sub::<S>(&r, &p));
        let edges = EdgePlanes::<S> {
            a: planes.dot_ray(cross::<S>(&p, &f)),
            b: planes.dot_ray(cross::<S>(&e, &p)),
            n: planes.dot_ray(cross::<S>(&f, &e)),
        };
        let normals = each!(k in 3 =>
            self.view_from_normal.of(each!(axis in 3 => fields[TriangleRecord::NORMALS + 3 * k + axis])));
        let mut rows = [S::F::splat(0.0); N_LANES];
        for axis in 0..3 {
            let [value, right, down] = edges.attribute_plane(each!(k in 3 => normals[k][axis]));
            // A constant normal is not divided by n, because only its direction matters.
            rows[SurfaceRecord::NORMAL + 3 * axis] = normals[0][axis].select_or(flat, value);
            rows[SurfaceRecord::NORMAL + 3 * axis + 1] = S::F::splat(0.0).select_or(flat, right);
            rows[SurfaceRecord::NORMAL + 3 * axis + 2] = S::F::splat(0.0).select_or(flat, down);
            rows[SurfaceRecord::COLOR + axis] = S::F::splat(self.color[axis]);
        }
        rows[SurfaceRecord::SPECULAR] = S::F::splat(self.specular);
        rows[SurfaceRecord::METALLIC] = S::F::splat(self.metallic);
        rows[SurfaceRecord::TEXTURE] = S::I::splat(self.texture).bitcast_f32();
        rows[SurfaceRecord::FLAT] = S::F::splat(1.0).select_or(flat, S::F::splat(0.0));
        store_columns::<S>(rows, which, records);
        if let Some(tiles_per_step) = &self.tiles_per_step {
            let facing = last & S::I::splat(TriangleRecord::AXIS_MASK);
            let uv = each!(k in 3 => project_uv::<S>(&corners[k], facing, tiles_per_step));
            let mut rows = [S::F::splat(0.0); N_LANES];
            rows[UvRecord::N..UvRecord::N + 3].copy_from_slice(&edges.n);
            rows[UvRecord::U..UvRecord::U + 3]
                .copy_from_slice(&edges.attribute_plane(each!(k in 3 => uv[k][0])));
            rows[UvRecord::V..UvRecord::V + 3]
                .copy_from_slice(&edges.attribute_plane(each!(k in 3 => uv[k][1])));
            store_columns::<S>(rows, which, uv_records);
        }
    }
}

/// The planes of a, b and n over the image, as defined in the module documentation.
struct EdgePlanes<S: Simd> {
    a: Vectors<S>,
    b: Vectors<S>,
    n: Vectors<S>,
}

impl<S: Simd> EdgePlanes<S> {
    /// Returns the plane of an attribute times n, given its values at the three corners.
    #[inline(always)]
    fn attribute_plane(&self, [t0, t1, t2]: [S::F; 3]) -> Vectors<S> {
        let (along_e, along_f) = (t1 - t0, t2 - t0);
        each!(k in 3 => along_f.mul_add(self.b[k], along_e.mul_add(self.a[k], t0 * self.n[k])))
    }
}

/// Transposes `rows` and stores column i as record `which[i]`.
#[inline(always)]
fn store_columns<S: Simd>(rows: [S::F; N_LANES], which: &[i32; N_LANES], records: &mut [F32x16]) {
    let columns = S::transpose(rows);
    for (column, triangle) in columns.iter().zip(which) {
        column.store(&mut records[*triangle as usize]);
    }
}

/// Returns the texture coordinates of a corner in texture tiles, given its position in grid steps: the
/// coordinates along the axes other than the [`crate::mesh::ProjectionAxis`] `facing`.
#[inline(always)]
fn project_uv<S: Simd>(corner: &Vectors<S>, facing: S::I, tiles_per_step: &Vectors<S>) -> [S::F; 2] {
    let [x, y, z] = each!(k in 3 => corner[k] * tiles_per_step[k]);
    let (faces_x, faces_y) = (facing.eq(S::I::splat(0)), facing.eq(S::I::splat(1)));
    [z.select_or(faces_x, x), z.select_or(faces_y, y)]
}

/// Snaps points to the rasteriser's grid of 1/256 px, so that every covered pixel lies inside the triangle.
struct GridSnap {
    scale: f32,
    centre: [f32; 2],
    near_m: f32,
}

impl GridSnap {
    fn new(camera: &PinholeCamera, scale: usize) -> Self {
        let per_px = (256 * scale) as f32;
        Self {
            scale: camera.focal_px * per_px,
            centre: camera.half_px().map(|half_px| half_px * per_px),
            near_m: camera.clip_m[0],
        }
    }

    /// Returns the snapped points. Points in front of the near plane are returned unchanged.
    #[inline(always)]
    fn snap<S: Simd>(&self, [x, y, z]: Vectors<S>) -> Vectors<S> {
        let scale = S::F::splat(self.scale);
        let depth = S::F::splat(1.0) / z;
        let per_scale = S::F::splat(1.0 / self.scale);
        // Coordinates beyond 2²³ are integers already, so rounding them has no effect.
        let before_near = S::F::splat(self.near_m).gt(z);
        let [x, y] = each!(k in 2 => {
            let (t, centre) = ([x, y][k], S::F::splat(self.centre[k]));
            let on_image = (t * depth).mul_add(scale, centre).round_to_i32().to_f32();
            t.select_or(before_near, (on_image - centre) * per_scale * z)
        });
        [x, y, z]
    }
}

#[inline(always)]
fn sub<S: Simd>(a: &Vectors<S>, b: &Vectors<S>) -> Vectors<S> {
    each!(k in 3 => a[k] - b[k])
}

#[inline(always)]
fn cross<S: Simd>(a: &Vectors<S>, b: &Vectors<S>) -> Vectors<S> {
    each!(k in 3 => {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        a[i].mul_add(b[j], S::F::splat(0.0) - a[j] * b[i])
    })
}
