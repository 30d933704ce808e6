//! Deferred shading of pixel tiles: visits each tile of the visibility buffer once and computes its light.

use crate::cpu::shading::encode::encode;
use crate::cpu::shading::gathered::GatheredSurfaces;
use crate::cpu::shading::lighting::{Lighting, Reflectance, ViewLights, radiance_roots};
use crate::cpu::shading::rays::{RayTable, ViewRays};
use crate::cpu::shading::surface::{MIXED, SurfaceRecord, UvRecord, VisibleSurfaces, record_index};
use crate::cpu::shading::texture::{TextureSample, Uv};
use crate::cpu::shadow::Shadow;
use crate::cpu::simd::each::each;
use crate::cpu::simd::isa::Kernel;
use crate::cpu::simd::{
    Broadcast, F32x16, FloatLike, I32x16, N_LANES, SetBits, Simd, SimdF32, SimdI32, SimdMask,
};
use crate::cpu::visibility::raster::{NO_ID, Visibility};
use crate::texture::{self, TextureImage};
use scene::Texture;

/// The inputs of the shading of one image.
pub(crate) struct Shader<'a> {
    pub(crate) lights: &'a ViewLights,
    pub(crate) rays: &'a RayTable,
    pub(crate) surfaces: &'a VisibleSurfaces,
    /// The first sun's shadows, if it casts any.
    pub(crate) shadow: Option<Shadow<'a>>,
}

/// A destination for shaded tiles.
pub(crate) trait TileSink {
    /// Writes the pixels of a tile row.
    fn write<S: Simd>(&mut self, tile_row: &TileRow);
}

/// Kernel that shades an image with one sample per pixel.
pub(crate) struct Shade<'a, K> {
    pub(crate) shader: Shader<'a>,
    pub(crate) visibility: &'a Visibility,
    pub(crate) sink: K,
}

impl<K: TileSink> Kernel for Shade<'_, K> {
    #[inline(always)]
    fn run<S: Simd>(mut self) {
        let [per_row, n_rows] = self.visibility.pixel_tiles(1);
        let mut tile_row = TileRow::new();
        for row in 0..n_rows {
            for first in (0..per_row).step_by(TILE_ROW) {
                let n = TILE_ROW.min(per_row - first);
                let tiles = row * per_row + first..row * per_row + first + n;
                let (ids, depths) =
                    (&self.visibility.ids[tiles.clone()], &self.visibility.depths[tiles.clone()]);
                tile_row.move_to(first, row, n);
                self.shader.shade::<S>(&self.shader.surfaces.tile_ids[tiles], ids, depths, &mut tile_row);
                self.sink.write::<S>(&tile_row);
            }
        }
    }
}

/// Maximum number of tiles in a tile row. Each shading step runs over all of them before the next step
/// begins, so that a CPU can overlap the long dependency chains of several tiles.
pub(crate) const TILE_ROW: usize = N_LANES;

/// A row of up to [`TILE_ROW`] adjacent tiles, with the intermediate results of their shading.
pub(crate) struct TileRow {
    /// Column of the first tile.
    pub(crate) column: usize,
    /// Row of all tiles.
    pub(crate) row: usize,
    /// Number of tiles.
    pub(crate) n: usize,
    /// Bit i is set if tile i is uniform: all of its pixels show one triangle.
    uniform: u16,
    /// Bit i is set if tile i shows several triangles.
    mixed: u16,
    /// Entries of [`VisibleSurfaces::tile_ids`], one lane per tile.
    tile_ids: I32x16,
    samples: [TextureSample; TILE_ROW],
    gathered: [GatheredSurfaces; TILE_ROW],
    /// The square roots of the radiance per tile, linear RGB.
    roots: [[F32x16; 3]; TILE_ROW],
    /// The last flat triangle that was shaded.
    flat: FlatSurface,
}

/// Shading terms of a flat triangle that are constant over a tile row.
struct FlatSurface {
    /// Record index of the triangle.
    triangle: usize,
    lighting: Lighting<f32>,
    /// `true` if the triangle has highlights.
    glossy: bool,
    /// Bit i is set if no shadow lookup is needed in tile i: it is known to be fully lit, or faces away
    /// from the sun.
    sunlit: u16,
    /// The square roots of its radiance without highlights, shadows and texture.
    roots: [f32; 3],
}

/// Record index that belongs to no triangle.
const NO_TRIANGLE: usize = usize::MAX;

impl TileRow {
    /// Creates a tile row without tiles.
    pub(crate) fn new() -> Self {
        Self {
            column: 0,
            row: 0,
            n: 0,
            uniform: 0,
            mixed: 0,
            tile_ids: I32x16::ZERO,
            samples: [const { TextureSample::NONE }; TILE_ROW],
            gathered: [const { GatheredSurfaces::EMPTY }; TILE_ROW],
            roots: [[F32x16::ZERO; 3]; TILE_ROW],
            flat: FlatSurface {
                triangle: NO_TRIANGLE,
                lighting: Lighting::DARK,
                glossy: false,
                sunlit: 0,
                roots: [0.0; 3],
            },
        }
    }

    /// Returns a mask of the tiles that show any surface: bit i stands for tile i.
    pub(crate) fn shown_tiles(&self) -> u16 {
        self.uniform | self.mixed
    }

    /// Returns the sRGB pixels of a tile, with red in the lowest byte.
    #[inline(always)]
    pub(crate) fn packed<S: Simd>(&self, i: usize) -> S::I {
        if self.shown_tiles() >> i & 1 == 0 {
            return S::I::splat(0);
        }
        let [r, g, b] = each!(c in 3 => encode::<S>(S::F::load(&self.roots[i][c])));
        r | g.shl::<8>() | b.shl::<16>()
    }

    /// Returns the square roots of a tile's radiance, linear RGB.
    #[inline(always)]
    pub(crate) fn roots<S: Simd>(&self, i: usize) -> [S::F; 3] {
        let is_shown = self.shown_tiles() >> i & 1 == 1;
        each!(c in 3 => if is_shown { S::F::load(&self.roots[i][c]) } else { S::F::splat(0.0) })
    }

    /// Replaces the radiance of a tile, given its square roots.
    #[inline(always)]
    pub(crate) fn set_roots<S: Simd>(&mut self, i: usize, roots: [S::F; 3]) {
        self.mixed |= 1 << i;
        store_rgb::<S>(roots, &mut self.roots[i]);
    }

    /// Classifies the tiles as uniform, mixed or empty.
    #[inline(always)]
    fn classify<S: Simd>(&mut self, tile_ids: &[i32]) {
        let tile_ids = S::I::load_partial(tile_ids, NO_ID);
        tile_ids.store(&mut self.tile_ids);
        self.uniform = tile_ids.gt(S::I::splat(NO_ID)).to_bits();
        self.mixed = tile_ids.eq(S::I::splat(MIXED)).to_bits();
    }

    /// Moves to `n` other tiles and invalidates all cached results.
    pub(crate) fn move_to(&mut self, column: usize, row: usize, n: usize) {
        (self.column, self.row, self.n) = (column, row, n);
        self.flat.triangle = NO_TRIANGLE;
    }
}

impl Shader<'_> {
    /// Shades the tiles of a tile row. `tile_ids` are their entries of [`VisibleSurfaces::tile_ids`]; `ids`
    /// and `depths` are their visibility tiles.
    #[inline(always)]
    pub(crate) fn shade<S: Simd>(
        &self,
        tile_ids: &[i32],
        ids: &[I32x16],
        depths: &[F32x16],
        tile_row: &mut TileRow,
    ) {
        tile_row.classify::<S>(tile_ids);
        for tile in SetBits(tile_row.uniform) {
            let triangle = record_index(tile_ids[tile]);
            if self.texture(triangle) >= 0 {
                let ray = self.rays.tile::<S>(tile_row.column + tile, tile_row.row);
                tile_row.samples[tile].locate::<S>(&self.uv::<S>(triangle, &ray));
            }
        }
        for tile in SetBits(tile_row.uniform) {
            let triangle = record_index(tile_ids[tile]);
            let tint = if self.texture(triangle) < 0 {
                [S::F::splat(1.0); 3]
            } else {
                tile_row.samples[tile].read::<S>(self.texture_image(triangle))
            };
            let roots = self.shade_uniform::<S>(triangle, tint, depths, tile, tile_row);
            store_rgb::<S>(roots, &mut tile_row.roots[tile]);
        }
        for tile in SetBits(tile_row.mixed) {
            let ray = self.rays.tile::<S>(tile_row.column + tile, tile_row.row);
            self.gather::<S>(&ids[tile], &ray, &mut tile_row.gathered[tile]);
        }
        for tile in SetBits(tile_row.mixed) {
            if tile_row.gathered[tile].textured != 0 {
                let ray = self.rays.tile::<S>(tile_row.column + tile, tile_row.row);
                let tint = self.gather_tint::<S>(&ids[tile], &ray, tile_row.gathered[tile].textured);
                store_rgb::<S>(tint, &mut tile_row.gathered[tile].tint);
            }
        }
        for tile in SetBits(tile_row.mixed) {
            let ray = self.rays.tile::<S>(tile_row.column + tile, tile_row.row).at(&depths[tile]);
            let roots = self.shade_mixed::<S>(&tile_row.gathered[tile], &ray);
            store_rgb::<S>(roots, &mut tile_row.roots[tile]);
        }
    }

    /// Returns the texture index of a visible triangle, -1 for none.
    #[inline(always)]
    fn texture(&self, triangle: usize) -> i32 {
        self.surfaces.records[triangle].0[SurfaceRecord::TEXTURE].to_bits().cast_signed()
    }

    /// Returns the texture of a triangle that has one.
    #[inline(always)]
    fn texture_image(&self, triangle: usize) -> &'static TextureImage {
        texture::image(Texture::ALL[self.texture(triangle) as usize])
    }

    /// Returns the square roots of the radiance of a uniform tile.
    #[inline(always)]
    fn shade_uniform<S: Simd>(
        &self,
        triangle: usize,
        tint: [S::F; 3],
        depths: &[F32x16],
        tile: usize,
        tile_row: &mut TileRow,
    ) -> [S::F; 3] {
        let record = &self.surfaces.records[triangle].0;
        let is_flat = record[SurfaceRecord::FLAT] == 1.0;
        if is_flat {
            if tile_row.flat.triangle != triangle {
                tile_row.flat = self.flat_surface::<S>(tile, depths, tile_row);
            }
            let FlatSurface { glossy, sunlit, roots, .. } = &tile_row.flat;
            if !glossy && sunlit >> tile & 1 == 1 {
                return each!(c in 3 => S::F::splat(roots[c]) * tint[c]);
            }
        }
        // The general case: highlights, shadows or a normal that varies.
        let ray = &self.rays.tile::<S>(tile_row.column + tile, tile_row.row).at(&depths[tile]);
        let color = each!(c in 3 => S::F::splat(record[SurfaceRecord::COLOR + c]));
        let [specular, metallic] = [SurfaceRecord::SPECULAR, SurfaceRecord::METALLIC].map(|k| record[k]);
        let (specular, metallic) = (S::F::splat(specular), S::F::splat(metallic));
        let reflectance = &Reflectance { color, tint, specular, metallic };
        if is_flat {
            let FlatSurface { lighting, sunlit, .. } = &tile_row.flat;
            let sunlight = if sunlit >> tile & 1 == 1 { None } else { self.sunlight(lighting, ray) };
            return radiance_roots(lighting, self.lights, ray, sunlight, reflectance);
        }
        let lighting = Lighting::new(self.lights, eval_planes::<S, f32>(record, SurfaceRecord::NORMAL, ray));
        radiance_roots(&lighting, self.lights, ray, self.sunlight(&lighting, ray), reflectance)
    }

    /// Computes the shading terms of the flat triangle that a tile shows, for the whole tile row.
    #[inline(always)]
    fn flat_surface<S: Simd>(&self, tile: usize, depths: &[F32x16], tile_row: &TileRow) -> FlatSurface {
        let triangle = record_index(tile_row.tile_ids.0[tile]);
        let record = &self.surfaces.records[triangle].0;
        let lighting = Lighting::new(self.lights, normal_of(record));
        let glossy = record[SurfaceRecord::SPECULAR] + record[SurfaceRecord::METALLIC] > 0.0;
        let sunlit = match &self.shadow {
            Some(shadow) if lighting.faces_first_sun::<S>().any() => {
                let tiles =
                    S::I::load(&tile_row.tile_ids).eq(S::I::splat(tile_row.tile_ids.0[tile])).to_bits();
                let at = [tile_row.column, tile_row.row];
                shadow.fully_lit_tiles::<S>(self.rays, at, depths, tiles, &lighting.normal)
            }
            _ => u16::MAX,
        };
        let roots = lighting.unshadowed_roots(
            self.lights,
            each!(c in 3 => record[SurfaceRecord::COLOR + c]),
            record[SurfaceRecord::METALLIC],
        );
        FlatSurface { triangle, lighting, glossy, sunlit, roots }
    }

    /// Gathers the surface attributes of sixteen pixels with a triangle each, except for their textures.
    #[inline(always)]
    pub(crate) fn gather<S: Simd>(&self, ids: &I32x16, ray: &ViewRays<S>, gathered: &mut GatheredSurfaces) {
        let records =
            S::transpose(each!(i in 16 => S::F::load(&self.surfaces.records[record_index(ids.0[i])])));
        store_rgb::<S>(eval_planes::<S, S::F>(&records, SurfaceRecord::NORMAL, ray), &mut gathered.normal);
        store_rgb::<S>(each!(c in 3 => records[SurfaceRecord::COLOR + c]), &mut gathered.color);
        store_rgb::<S>([S::F::splat(1.0); 3], &mut gathered.tint);
        records[SurfaceRecord::SPECULAR].store(&mut gathered.specular);
        records[SurfaceRecord::METALLIC].store(&mut gathered.metallic);
        gathered.textured = records[SurfaceRecord::TEXTURE].bitcast_i32().gt(S::I::splat(-1)).to_bits();
    }

    /// Returns the square roots of the texture factors of sixteen pixels. Loops over the textured triangles,
    /// of which there are usually few.
    #[inline(always)]
    pub(crate) fn gather_tint<S: Simd>(
        &self,
        ids: &I32x16,
        ray: &ViewRays<S>,
        mut textured: u16,
    ) -> [S::F; 3] {
        let all_ids = S::I::load(ids);
        let mut sample = TextureSample::NONE;
        let mut tint = [S::F::splat(1.0); 3];
        while textured != 0 {
            let id = ids.0[textured.trailing_zeros() as usize];
            let triangle = record_index(id);
            sample.locate::<S>(&self.uv::<S>(triangle, ray));
            let factors = sample.read::<S>(self.texture_image(triangle));
            let same = all_ids.eq(S::I::splat(id));
            tint = each!(c in 3 => factors[c].select_or(same, tint[c]));
            textured &= !same.to_bits();
        }
        tint
    }

    /// Returns the square roots of the radiance of pixels that show several triangles.
    #[inline(always)]
    pub(crate) fn shade_mixed<S: Simd>(&self, gathered: &GatheredSurfaces, ray: &ViewRays<S>) -> [S::F; 3] {
        let GatheredSurfaces { normal, color, tint, specular, metallic, .. } = gathered;
        let lighting = Lighting::new(self.lights, each!(k in 3 => S::F::load(&normal[k])));
        let reflectance = Reflectance {
            color: each!(c in 3 => S::F::load(&color[c])),
            tint: each!(c in 3 => S::F::load(&tint[c])),
            specular: S::F::load(specular),
            metallic: S::F::load(metallic),
        };
        radiance_roots(&lighting, self.lights, ray, self.sunlight(&lighting, ray), &reflectance)
    }

    /// Returns the fraction of the first sun's light that arrives at the visible surfaces, see
    /// [`Shadow::sunlight`]. `None` if all of it arrives or if no surface faces the sun.
    #[inline(always)]
    fn sunlight<S: Simd, N: Broadcast<S>>(&self, lighting: &Lighting<N>, ray: &ViewRays<S>) -> Option<S::F> {
        let shadow = self.shadow.as_ref()?;
        let facing = lighting.faces_first_sun::<S>();
        facing.any().then(|| shadow.sunlight(ray, &lighting.normal, facing))
    }

    /// Returns the texture coordinates on a triangle, in texture tiles.
    #[inline(always)]
    fn uv<S: Simd>(&self, triangle: usize, ray: &ViewRays<S>) -> Uv<S> {
        let uv_record = &self.surfaces.uv_records[triangle].0;
        let per_n = S::F::splat(1.0) / eval_plane::<S, f32>(uv_record, UvRecord::N, ray.pixel);
        each!(k in 2 => eval_plane::<S, f32>(uv_record, [UvRecord::U, UvRecord::V][k], ray.pixel) * per_n)
    }
}

/// Stores the three channels of an RGB value.
#[inline(always)]
pub(crate) fn store_rgb<S: Simd>(rgb: [S::F; 3], out: &mut [F32x16; 3]) {
    for (channel, out) in rgb.iter().zip(out) {
        channel.store(out);
    }
}

fn normal_of(record: &[f32; N_LANES]) -> [f32; 3] {
    [0, 3, 6].map(|k| record[SurfaceRecord::NORMAL + k])
}

/// Evaluates three attribute planes that start at lane `from` of a record.
#[inline(always)]
fn eval_planes<S: Simd, N: Broadcast<S>>(record: &[N; N_LANES], from: usize, ray: &ViewRays<S>) -> [S::F; 3] {
    each!(k in 3 => eval_plane::<S, N>(record, from + 3 * k, ray.pixel))
}

/// Evaluates the attribute plane that starts at lane `k` of a record at the given pixels.
#[inline(always)]
fn eval_plane<S: Simd, N: Broadcast<S>>(record: &[N; N_LANES], k: usize, [x, y]: [S::F; 2]) -> S::F {
    x.mul_add(record[k + 1].broadcast(), y.mul_add(record[k + 2].broadcast(), record[k].broadcast()))
}
