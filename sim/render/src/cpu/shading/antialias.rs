//! Multisample anti-aliasing (MSAA) with four samples per pixel: every triangle visible in a pixel is
//! shaded once, at the pixel's centre, and weighted by its fraction of the samples.

use crate::cpu::shading::gathered::GatheredSurfaces;
use crate::cpu::shading::surface::MIXED;
use crate::cpu::shading::tiles::{Shader, TILE_ROW, TileRow, TileSink, store_rgb};
use crate::cpu::simd::each::each;
use crate::cpu::simd::isa::Kernel;
use crate::cpu::simd::{F32x16, FloatLike, I32x16, N_LANES, SetBits, Simd, SimdF32, SimdI32, SimdMask};
use crate::cpu::visibility::raster::{NO_ID, Visibility};
use crate::cpu::visibility::tile::{MultisampleTile, TileLayout};

/// Samples along each edge of a pixel.
const PER_EDGE: usize = MultisampleTile::SAMPLES_PER_EDGE;
/// Samples per pixel.
const PER_PIXEL: usize = PER_EDGE * PER_EDGE;
/// Weight of one sample.
const SAMPLE_WEIGHT: f32 = 1.0 / PER_PIXEL as f32;

/// Kernel that shades an image from a visibility buffer of [`MultisampleTile`]s.
pub(crate) struct ShadeSamples<'a, K> {
    pub(crate) shader: Shader<'a>,
    pub(crate) visibility: &'a Visibility,
    pub(crate) sink: K,
}

/// The visibility samples of a tile row, reordered by pixel.
struct TileSamples {
    /// Triangle ids by sample and tile; lane i is pixel i.
    ids: [[I32x16; TILE_ROW]; PER_PIXEL],
    /// 1/z in the same order.
    depths: [[F32x16; TILE_ROW]; PER_PIXEL],
    /// Per pixel tile the id that all of its samples show, or [`MIXED`].
    uniform_ids: [i32; TILE_ROW],
}

impl TileSamples {
    const EMPTY: Self = Self {
        ids: [[I32x16([NO_ID; N_LANES]); TILE_ROW]; PER_PIXEL],
        depths: [[F32x16::ZERO; TILE_ROW]; PER_PIXEL],
        uniform_ids: [NO_ID; TILE_ROW],
    };
}

/// Fragments of a tile row that differ from the first sample of their pixel, densely packed (structure of
/// arrays).
struct Fragments {
    n: usize,
    /// Index of the tile times 16, plus the index of the pixel within it.
    pixels: [i32; MAX_FRAGMENTS],
    ids: [i32; MAX_FRAGMENTS],
    /// 1/z as the bits of an `f32`.
    depths: [i32; MAX_FRAGMENTS],
    /// Fraction of the pixel's samples, as the bits of an `f32`.
    weights: [i32; MAX_FRAGMENTS],
}

/// Capacity of [`Fragments`]: each sample but the first may show another triangle, and the last vector
/// store may extend past the last fragment.
const MAX_FRAGMENTS: usize = TILE_ROW * N_LANES * (PER_PIXEL - 1) + N_LANES;

impl Fragments {
    const EMPTY: Self = Self {
        n: 0,
        pixels: [0; MAX_FRAGMENTS],
        ids: [0; MAX_FRAGMENTS],
        depths: [0; MAX_FRAGMENTS],
        weights: [0; MAX_FRAGMENTS],
    };

    /// Appends the lanes in `keep` of a tile.
    #[inline(always)]
    fn push<S: Simd>(&mut self, keep: S::M, tile: usize, id: S::I, depth: S::F, weight: S::F) {
        let n = self.n;
        let pixel_idx = S::I::load(&I32x16::INDICES) + S::I::splat((tile * N_LANES) as i32);
        for (values, list) in [
            (pixel_idx, &mut self.pixels),
            (id, &mut self.ids),
            (depth.bitcast_i32(), &mut self.depths),
            (weight.bitcast_i32(), &mut self.weights),
        ] {
            let (to, _) = list[n..].split_first_chunk_mut().expect("room for a vector past the end");
            self.n = n + S::compress(values, keep, to);
        }
    }

    /// Returns sixteen values of a list from index `first` on. Those past the end are unspecified.
    #[inline(always)]
    fn load(list: &[i32; MAX_FRAGMENTS], first: usize) -> I32x16 {
        I32x16(each!(i in 16 => list[first + i]))
    }
}

impl<K: TileSink> Kernel for ShadeSamples<'_, K> {
    #[inline(always)]
    fn run<S: Simd>(mut self) {
        let [per_row, n_rows] = self.visibility.pixel_tiles(PER_EDGE);
        let mut tile_row = TileRow::new();
        let (mut samples, mut fragments) = (TileSamples::EMPTY, Fragments::EMPTY);
        let mut light = [[F32x16::ZERO; 3]; TILE_ROW];
        for row in 0..n_rows {
            for first in (0..per_row).step_by(TILE_ROW) {
                let n = TILE_ROW.min(per_row - first);
                for i in 0..n {
                    self.gather::<S>(first + i, row, i, &mut samples);
                }
                tile_row.move_to(first, row, n);
                let (ids, depths) = (&samples.ids[0][..n], &samples.depths[0][..n]);
                self.shader.shade::<S>(&samples.uniform_ids[..n], ids, depths, &mut tile_row);
                let mixed = weight_first_samples::<S>(&samples, &tile_row, &mut light, &mut fragments);
                self.accumulate::<S>(&fragments, &tile_row, &mut light);
                for i in SetBits(mixed) {
                    tile_row.set_roots::<S>(i, each!(c in 3 => S::F::load(&light[i][c]).sqrt()));
                }
                self.sink.write::<S>(&tile_row);
            }
        }
    }
}

impl<K: TileSink> ShadeSamples<'_, K> {
    /// Loads pixel tile `i` of a tile row, whose samples lie in four visibility tiles, and reorders them by
    /// pixel.
    #[inline(always)]
    fn gather<S: Simd>(&self, column: usize, row: usize, i: usize, samples: &mut TileSamples) {
        let tiles = self.visibility.sample_tiles(column, row);
        let uniform_ids = each!(k in 4 => self.shader.surfaces.tile_ids[tiles[k]]);
        samples.uniform_ids[i] = if uniform_ids == [uniform_ids[0]; 4] { uniform_ids[0] } else { MIXED };
        let ids = S::interleave_tiles(each!(k in 4 => S::I::load(&self.visibility.ids[tiles[k]])));
        let depths =
            S::interleave_tiles(each!(k in 4 => S::F::load(&self.visibility.depths[tiles[k]]).bitcast_i32()));
        for sample in 0..PER_PIXEL {
            ids[sample].store(&mut samples.ids[sample][i]);
            depths[sample].bitcast_f32().store(&mut samples.depths[sample][i]);
        }
    }

    /// Shades the fragments and adds their weighted light to their pixels.
    #[inline(always)]
    fn accumulate<S: Simd>(
        &self,
        fragments: &Fragments,
        tile_row: &TileRow,
        light: &mut [[F32x16; 3]; TILE_ROW],
    ) {
        let mut gathered = GatheredSurfaces::EMPTY;
        for first in (0..fragments.n).step_by(N_LANES) {
            let n = N_LANES.min(fragments.n - first);
            let mut ids = Fragments::load(&fragments.ids, first);
            ids.0[n..].fill(NO_ID);
            let pixels = Fragments::load(&fragments.pixels, first);
            let pixel_idx = S::I::load(&pixels);
            let tile = pixel_idx.shr_logical::<4>();
            let column =
                (tile.shl::<2>() | pixel_idx & S::I::splat(3)) + S::I::splat((tile_row.column * 4) as i32);
            let row =
                (pixel_idx.shr_logical::<2>() & S::I::splat(3)) + S::I::splat((tile_row.row * 4) as i32);
            let depth = S::I::load(&Fragments::load(&fragments.depths, first)).bitcast_f32();
            let weight = S::I::load(&Fragments::load(&fragments.weights, first)).bitcast_f32();
            let ray = self.shader.rays.for_pixels::<S>([column.to_f32(), row.to_f32()], depth);
            self.shader.gather::<S>(&ids, &ray, &mut gathered);
            if gathered.textured != 0 {
                let tint = self.shader.gather_tint::<S>(&ids, &ray, gathered.textured);
                store_rgb::<S>(tint, &mut gathered.tint);
            }
            let roots = self.shader.shade_mixed::<S>(&gathered, &ray);
            let mut rgb = [F32x16::ZERO; 3];
            store_rgb::<S>(each!(c in 3 => linear::<S>(roots[c]) * weight), &mut rgb);
            for lane in 0..n {
                let (tile, pixel) = (pixels.0[lane] as usize / N_LANES, pixels.0[lane] as usize % N_LANES);
                for c in 0..3 {
                    light[tile][c].0[pixel] += rgb[c].0[lane];
                }
            }
        }
    }
}

/// Writes the weighted light of the first samples of all tiles in which samples differ, and collects the
/// fragments of the other samples. Returns a mask of these tiles: bit i stands for tile i.
#[inline(always)]
fn weight_first_samples<S: Simd>(
    samples: &TileSamples,
    tile_row: &TileRow,
    light: &mut [[F32x16; 3]; TILE_ROW],
    fragments: &mut Fragments,
) -> u16 {
    fragments.n = 0;
    let mut mixed = 0;
    for (i, light) in light[..tile_row.n].iter_mut().enumerate() {
        if samples.uniform_ids[i] != MIXED {
            continue;
        }
        let ids = each!(s in 4 => S::I::load(&samples.ids[s][i]));
        let same = ids[1].eq(ids[0]) & ids[2].eq(ids[0]) & ids[3].eq(ids[0]);
        if same.to_bits() == u16::MAX {
            continue;
        }
        mixed |= 1 << i;
        let roots = tile_row.roots::<S>(i);
        let weight = sample_weight::<S>(&ids, 0);
        store_rgb::<S>(each!(c in 3 => linear::<S>(roots[c]) * weight), light);
        for sample in 1..PER_PIXEL {
            let mut keep = ids[sample].gt(S::I::splat(NO_ID));
            for previous in &ids[..sample] {
                keep = keep.and_not(ids[sample].eq(*previous));
            }
            if keep.any() {
                let depth = S::F::load(&samples.depths[sample][i]);
                fragments.push::<S>(keep, i, ids[sample], depth, sample_weight::<S>(&ids, sample));
            }
        }
    }
    mixed
}

/// Returns the fraction of a pixel's samples that show the same triangle as `sample`, given that no earlier
/// sample shows it.
#[inline(always)]
fn sample_weight<S: Simd>(ids: &[S::I; PER_PIXEL], sample: usize) -> S::F {
    let mut weight = S::F::splat(SAMPLE_WEIGHT);
    for later in &ids[sample + 1..] {
        weight = weight + S::F::splat(SAMPLE_WEIGHT).select_or(later.eq(ids[sample]), S::F::splat(0.0));
    }
    weight
}

/// Returns linear light, clamped to [0, 1], given its square root.
#[inline(always)]
fn linear<S: Simd>(root: S::F) -> S::F {
    let clamped = root.min(S::F::splat(1.0));
    clamped * clamped
}
