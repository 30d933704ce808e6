//! From visible triangles to bytes: every tile of pixels is looked at once.

use crate::render::cpu::shading::encode::encode;
use crate::render::cpu::shading::lighting::{Lighting, Reflectance, ViewLights, radiance_roots};
use crate::render::cpu::shading::rays::{RayTable, ViewRays};
use crate::render::cpu::shading::surface::{MIXED, SurfaceRecord, UvRecord, VisibleSurfaces, record_index};
use crate::render::cpu::shading::texture::{MipLevel, MipLevels, TextureSample, Uv};
use crate::render::cpu::shadow::Shadow;
use crate::render::cpu::simd::each::each;
use crate::render::cpu::simd::isa::Kernel;
use crate::render::cpu::simd::{
    Broadcast, F32x16, FloatLike, I32x16, N_LANES, SetBits, Simd, SimdF32, SimdI32, SimdMask,
};
use crate::render::cpu::visibility::raster::{NO_ID, Visibility};
use crate::render::cpu::visibility::tile::{Tile4x4, TileLayout};
use crate::render::texture::{MipChain, mip_chain};
use crate::scene::Texture;

/// What a picture's tiles are shaded with.
pub(in crate::render::cpu) struct Shader<'a> {
    pub(in crate::render::cpu) lights: &'a ViewLights,
    pub(in crate::render::cpu) rays: &'a RayTable,
    pub(in crate::render::cpu) surfaces: &'a VisibleSurfaces,
    /// The first sun's shadows, if it casts any.
    pub(in crate::render::cpu) shadow: Option<Shadow<'a>>,
}

/// Where pixels go.
pub(in crate::render::cpu) trait TileSink {
    /// Takes the pixels of a tile_row of tiles.
    fn write<S: Simd>(&mut self, tile_row: &TileRow);
}

/// Shades a picture.
pub(in crate::render::cpu) struct Shade<'a, K> {
    pub(in crate::render::cpu) shader: Shader<'a>,
    pub(in crate::render::cpu) visibility: &'a Visibility,
    pub(in crate::render::cpu) sink: K,
}

impl<K: TileSink> Kernel for Shade<'_, K> {
    #[inline(always)]
    fn run<S: Simd>(mut self) {
        let per_row = self.visibility.side as usize >> Tile4x4::WIDTH_BITS;
        let mut tile_row = TileRow::new();
        for row in 0..per_row {
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

/// Blocks that are shaded step by step side by side: a processor can then work on several of them at a time, as each
/// step's chain of dependent instructions is long.
pub(in crate::render::cpu) const TILE_ROW: usize = N_LANES;

/// A tile_row of tiles and what was found out about them.
pub(in crate::render::cpu) struct TileRow {
    /// Column of the first tile and row of all of them.
    pub(in crate::render::cpu) column: usize,
    pub(in crate::render::cpu) row: usize,
    /// How many there are.
    pub(in crate::render::cpu) n: usize,
    /// Bit i: tile i shows one triangle.
    uniform: u16,
    /// Bit i: tile i shows several triangles.
    mixed: u16,
    /// See [`VisibleSurfaces::tile_ids`].
    tile_ids: I32x16,
    samples: [TextureSample; TILE_ROW],
    gathered: [GatheredSurfaces; TILE_ROW],
    /// Tile4x4 roots of linear RGB: first of the texture's factors, then of the light that light_bounds the eye.
    roots: [[F32x16; 3]; TILE_ROW],
    /// MipLevels of the triangle that was looked up last, by triangle, in the middle of each tile.
    levels: (usize, MipLevels),
    /// The flat triangle that was shaded last.
    flat: FlatSurface,
}

/// A flat triangle, by triangle.
struct FlatSurface {
    triangle: usize,
    lighting: Lighting<f32>,
    /// Whether a highlight may be seen in the present tile_row.
    may_highlight: bool,
    /// Bit i: tile i shows it in full sunlight, as far as that is known, or in its own shade.
    sunlit: u16,
    /// Tile4x4 roots of its light where there is neither highlight nor shadow nor texture.
    roots: [f32; 3],
}

/// What sixteen pixels of several triangles are made of.
pub(in crate::render::cpu) struct GatheredSurfaces {
    /// In the view frame, of any length.
    normal: [F32x16; 3],
    color: [F32x16; 3],
    /// Tile4x4 roots of textures' factors.
    pub(in crate::render::cpu) tint: [F32x16; 3],
    specular: F32x16,
    /// Bit i: lane i shows a texture.
    pub(in crate::render::cpu) textured: u16,
}

impl GatheredSurfaces {
    /// Nothing.
    pub(in crate::render::cpu) const NONE: Self = Self {
        normal: [F32x16::ZERO; 3],
        color: [F32x16::ZERO; 3],
        tint: [F32x16::ZERO; 3],
        specular: F32x16::ZERO,
        textured: 0,
    };
}

/// No triangle's triangle.
const NONE: usize = usize::MAX;

impl TileRow {
    pub(in crate::render::cpu) fn new() -> Self {
        Self {
            column: 0,
            row: 0,
            n: 0,
            uniform: 0,
            mixed: 0,
            tile_ids: I32x16::ZERO,
            samples: [const { TextureSample::NONE }; TILE_ROW],
            gathered: [const { GatheredSurfaces::NONE }; TILE_ROW],
            roots: [[F32x16::ZERO; 3]; TILE_ROW],
            levels: (NONE, MipLevels::NONE),
            flat: FlatSurface {
                triangle: NONE,
                lighting: Lighting::DARK,
                may_highlight: false,
                sunlit: 0,
                roots: [0.0; 3],
            },
        }
    }

    /// Bit i: tile i shows anything.
    pub(in crate::render::cpu) fn shown_tiles(&self) -> u16 {
        self.uniform | self.mixed
    }

    /// A tile's pixels, red in the lowest byte.
    #[inline(always)]
    pub(in crate::render::cpu) fn packed<S: Simd>(&self, i: usize) -> S::I {
        if self.shown_tiles() >> i & 1 == 0 {
            return S::I::splat(0);
        }
        let [r, g, b] = each!(c in 3 => encode::<S>(S::F::load(&self.roots[i][c])));
        r | g.shl::<8>() | b.shl::<16>()
    }

    /// Tile4x4 roots of a tile's light, linear RGB.
    #[inline(always)]
    pub(in crate::render::cpu) fn roots<S: Simd>(&self, i: usize) -> [S::F; 3] {
        let is_shown = self.shown_tiles() >> i & 1 == 1;
        each!(c in 3 => if is_shown { S::F::load(&self.roots[i][c]) } else { S::F::splat(0.0) })
    }

    /// Puts other light in the triangle of a tile's.
    #[inline(always)]
    pub(in crate::render::cpu) fn replace<S: Simd>(&mut self, i: usize, roots: [S::F; 3]) {
        self.mixed |= 1 << i;
        store_all::<S>(roots, &mut self.roots[i]);
    }

    /// Sorts the tiles by what they show.
    #[inline(always)]
    fn sort<S: Simd>(&mut self, tile_ids: &[i32]) {
        let tile_ids = S::I::load_partial(tile_ids, NO_ID);
        tile_ids.store(&mut self.tile_ids);
        self.uniform = tile_ids.gt(S::I::splat(NO_ID)).to_bits();
        self.mixed = tile_ids.eq(S::I::splat(MIXED)).to_bits();
    }

    /// Goes to another triangle.
    pub(in crate::render::cpu) fn move_to(&mut self, column: usize, row: usize, n: usize) {
        (self.column, self.row, self.n) = (column, row, n);
        (self.levels.0, self.flat.triangle) = (NONE, NONE);
    }
}

impl Shader<'_> {
    /// Fills a tile_row with the light of tiles that show these triangles at these depths; see [`VisibleSurfaces::tile_ids`].
    #[inline(always)]
    pub(in crate::render::cpu) fn shade<S: Simd>(
        &self,
        tile_ids: &[i32],
        ids: &[I32x16],
        depths: &[F32x16],
        tile_row: &mut TileRow,
    ) {
        tile_row.sort::<S>(tile_ids);
        for tile in SetBits(tile_row.uniform) {
            let triangle = record_index(tile_ids[tile]);
            if self.texture(triangle) >= 0 {
                let ray = self.rays.tile::<S>(tile_row.column + tile, tile_row.row);
                let level = self.level::<S>(triangle, tile, tile_row);
                tile_row.samples[tile].locate::<S>(&self.uv::<S>(triangle, &ray), level);
            }
        }
        for tile in SetBits(tile_row.uniform) {
            let triangle = record_index(tile_ids[tile]);
            let tint = if self.texture(triangle) < 0 {
                [S::F::splat(1.0); 3]
            } else {
                tile_row.samples[tile].read::<S>(self.pattern(triangle))
            };
            let roots = self.shade_uniform::<S>(triangle, tint, depths, tile, tile_row);
            store_all::<S>(roots, &mut tile_row.roots[tile]);
        }
        for tile in SetBits(tile_row.mixed) {
            let ray = self.rays.tile::<S>(tile_row.column + tile, tile_row.row);
            self.gather::<S>(&ids[tile], &ray, &mut tile_row.gathered[tile]);
        }
        for tile in SetBits(tile_row.mixed) {
            if tile_row.gathered[tile].textured != 0 {
                let ray = self.rays.tile::<S>(tile_row.column + tile, tile_row.row);
                let here = I32x16([tile as i32; N_LANES]);
                let textured = tile_row.gathered[tile].textured;
                let tint = self.tint::<S>(&ids[tile], &here, &ray, textured, tile_row);
                store_all::<S>(tint, &mut tile_row.gathered[tile].tint);
            }
        }
        for tile in SetBits(tile_row.mixed) {
            let ray = self.rays.tile::<S>(tile_row.column + tile, tile_row.row).at(&depths[tile]);
            let roots = self.shade_mixed::<S>(&tile_row.gathered[tile], &ray);
            store_all::<S>(roots, &mut tile_row.roots[tile]);
        }
    }

    /// MipLevel at which to read a triangle's texture in a tile_row's tile.
    #[inline(always)]
    fn level<S: Simd>(&self, triangle: usize, tile: usize, tile_row: &mut TileRow) -> MipLevel {
        let (known, levels) = &mut tile_row.levels;
        if *known != triangle {
            *known = triangle;
            let middle = S::F::splat(1.5);
            let pixel = RayTable::pixels_of_tile_row::<S>([tile_row.column, tile_row.row], 0);
            levels.set::<S>(self.footprint::<S>(triangle, each!(k in 2 => pixel[k] + middle)));
        }
        levels.get(tile)
    }

    /// Texture of a visible triangle, -1 for none.
    #[inline(always)]
    fn texture(&self, triangle: usize) -> i32 {
        self.surfaces.records[triangle].0[SurfaceRecord::TEXTURE].to_bits().cast_signed()
    }

    /// The same of one that has a texture.
    #[inline(always)]
    fn pattern(&self, triangle: usize) -> &'static MipChain {
        mip_chain(Texture::ALL[self.texture(triangle) as usize])
    }

    /// Tile4x4 roots of the light of a tile that shows one triangle.
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
                tile_row.flat = self.flat::<S>(tile, depths, tile_row);
            }
            let FlatSurface { may_highlight, sunlit, roots, .. } = &tile_row.flat;
            if !may_highlight && sunlit >> tile & 1 == 1 {
                return each!(c in 3 => S::F::splat(roots[c]) * tint[c]);
            }
        }
        // The general case.
        let ray = &self.rays.tile::<S>(tile_row.column + tile, tile_row.row).at(&depths[tile]);
        let color = each!(c in 3 => S::F::splat(record[SurfaceRecord::COLOR + c]));
        let reflectance =
            &Reflectance { color, tint, specular: S::F::splat(record[SurfaceRecord::SPECULAR]) };
        if is_flat {
            let FlatSurface { lighting, may_highlight, sunlit, .. } = &tile_row.flat;
            let sunlight = if sunlit >> tile & 1 == 1 { None } else { self.sunlight(lighting, ray) };
            return radiance_roots(lighting, self.lights, *may_highlight, ray, sunlight, reflectance);
        }
        let lighting = Lighting::new(self.lights, over::<S, f32>(record, SurfaceRecord::NORMAL, ray));
        radiance_roots(&lighting, self.lights, true, ray, self.sunlight(&lighting, ray), reflectance)
    }

    /// The flat triangle of a tile_row's tile as the tile_row shows it.
    #[inline(always)]
    fn flat<S: Simd>(&self, tile: usize, depths: &[F32x16], tile_row: &TileRow) -> FlatSurface {
        let triangle = record_index(tile_row.tile_ids.0[tile]);
        let record = &self.surfaces.records[triangle].0;
        let lighting = Lighting::new(self.lights, normal_of(record));
        let may_highlight = record[SurfaceRecord::SPECULAR] > 0.0
            && lighting.may_highlight(&self.rays.corners(tile_row.column, tile_row.row, TILE_ROW));
        let sunlit = match &self.shadow {
            Some(shadow) if lighting.faces_first_sun::<S>().any() => {
                let tiles =
                    S::I::load(&tile_row.tile_ids).eq(S::I::splat(tile_row.tile_ids.0[tile])).to_bits();
                let at = [tile_row.column, tile_row.row];
                shadow.fully_lit_tiles::<S>(self.rays, at, depths, tiles, &lighting.normal)
            }
            _ => u16::MAX,
        };
        let roots = lighting.unshadowed_roots(each!(c in 3 => record[SurfaceRecord::COLOR + c]));
        FlatSurface { triangle, lighting, may_highlight, sunlit, roots }
    }

    /// Finds what pixels show, each its own triangle, but for the textures.
    #[inline(always)]
    pub(in crate::render::cpu) fn gather<S: Simd>(
        &self,
        ids: &I32x16,
        ray: &ViewRays<S>,
        gathered: &mut GatheredSurfaces,
    ) {
        let records =
            S::transpose(each!(i in 16 => S::F::load(&self.surfaces.records[record_index(ids.0[i])])));
        store_all::<S>(over::<S, S::F>(&records, SurfaceRecord::NORMAL, ray), &mut gathered.normal);
        store_all::<S>(each!(c in 3 => records[SurfaceRecord::COLOR + c]), &mut gathered.color);
        store_all::<S>([S::F::splat(1.0); 3], &mut gathered.tint);
        records[SurfaceRecord::SPECULAR].store(&mut gathered.specular);
        gathered.textured = records[SurfaceRecord::TEXTURE].bitcast_i32().gt(S::I::splat(-1)).to_bits();
    }

    /// Tints of pixels in the given tiles of a tile_row, found for the textured ones of each tile triangle by triangle: few
    /// tiles show many textured triangles.
    #[inline(always)]
    pub(in crate::render::cpu) fn tint<S: Simd>(
        &self,
        ids: &I32x16,
        tiles: &I32x16,
        ray: &ViewRays<S>,
        mut textured: u16,
        tile_row: &mut TileRow,
    ) -> [S::F; 3] {
        let (all_ids, all_blocks) = (S::I::load(ids), S::I::load(tiles));
        let mut tint = [S::F::splat(1.0); 3];
        while textured != 0 {
            let lane = textured.trailing_zeros() as usize;
            let (id, tile) = (ids.0[lane], tiles.0[lane]);
            let triangle = record_index(id);
            let level = self.level::<S>(triangle, tile as usize, tile_row);
            let sample = &mut tile_row.samples[tile as usize];
            sample.locate::<S>(&self.uv::<S>(triangle, ray), level);
            let factors = sample.read::<S>(self.pattern(triangle));
            let here = all_ids.eq(S::I::splat(id)) & all_blocks.eq(S::I::splat(tile));
            tint = each!(c in 3 => factors[c].select_or(here, tint[c]));
            textured &= !here.to_bits();
        }
        tint
    }

    /// Tile4x4 roots of the light of pixels that show several triangles.
    #[inline(always)]
    pub(in crate::render::cpu) fn shade_mixed<S: Simd>(
        &self,
        gathered: &GatheredSurfaces,
        ray: &ViewRays<S>,
    ) -> [S::F; 3] {
        let GatheredSurfaces { normal, color, tint, specular, .. } = gathered;
        let lighting = Lighting::new(self.lights, each!(k in 3 => S::F::load(&normal[k])));
        let reflectance = Reflectance {
            color: each!(c in 3 => S::F::load(&color[c])),
            tint: each!(c in 3 => S::F::load(&tint[c])),
            specular: S::F::load(specular),
        };
        radiance_roots(&lighting, self.lights, true, ray, self.sunlight(&lighting, ray), &reflectance)
    }

    /// What share of the first sun's light light_bounds what is seen: see [`Shadow::sunlight`]; `None` if it makes no difference, or
    /// for all.
    #[inline(always)]
    fn sunlight<S: Simd, N: Broadcast<S>>(&self, lighting: &Lighting<N>, ray: &ViewRays<S>) -> Option<S::F> {
        let shadow = self.shadow.as_ref()?;
        let facing = lighting.faces_first_sun::<S>();
        facing.any().then(|| shadow.sunlight(ray, &lighting.normal, facing))
    }

    /// Texture coordinates on a triangle, in tiles.
    #[inline(always)]
    fn uv<S: Simd>(&self, triangle: usize, ray: &ViewRays<S>) -> Uv<S> {
        let uv_record = &self.surfaces.uv_records[triangle].0;
        let per_n = S::F::splat(1.0) / linear::<S, f32>(uv_record, UvRecord::N, ray.pixel);
        each!(k in 2 => linear::<S, f32>(uv_record, [UvRecord::U, UvRecord::V][k], ray.pixel) * per_n)
    }

    /// Greater squared length, in tiles², that a step of one pixel right or down makes on a triangle.
    #[inline(always)]
    fn footprint<S: Simd>(&self, triangle: usize, pixel: [S::F; 2]) -> S::F {
        let uv_record = &self.surfaces.uv_records[triangle].0;
        let per_n = S::F::splat(1.0) / linear::<S, f32>(uv_record, UvRecord::N, pixel);
        let u = linear::<S, f32>(uv_record, UvRecord::U, pixel) * per_n;
        let v = linear::<S, f32>(uv_record, UvRecord::V, pixel) * per_n;
        // d(U/n) = (dU − (U/n) dn) / n.
        let [right, down] = each!(k in 2 => {
            let dn = S::F::splat(-uv_record[UvRecord::N + k + 1]);
            let du = u.mul_add(dn, S::F::splat(uv_record[UvRecord::U + k + 1])) * per_n;
            let dv = v.mul_add(dn, S::F::splat(uv_record[UvRecord::V + k + 1])) * per_n;
            du.mul_add(du, dv * dv)
        });
        right.max(down)
    }
}

#[inline(always)]
pub(in crate::render::cpu) fn store_all<S: Simd>(rgb: [S::F; 3], lines: &mut [F32x16; 3]) {
    for (channel, line) in rgb.iter().zip(lines) {
        channel.store(line);
    }
}

fn normal_of(record: &[f32; N_LANES]) -> [f32; 3] {
    [0, 3, 6].map(|k| record[SurfaceRecord::NORMAL + k])
}

/// Three functions that are linear over the image, from index `from` on.
#[inline(always)]
fn over<S: Simd, N: Broadcast<S>>(numbers: &[N; N_LANES], from: usize, ray: &ViewRays<S>) -> [S::F; 3] {
    each!(k in 3 => linear::<S, N>(numbers, from + 3 * k, ray.pixel))
}

#[inline(always)]
fn linear<S: Simd, N: Broadcast<S>>(numbers: &[N; N_LANES], k: usize, [x, y]: [S::F; 2]) -> S::F {
    x.mul_add(numbers[k + 1].broadcast(), y.mul_add(numbers[k + 2].broadcast(), numbers[k].broadcast()))
}
