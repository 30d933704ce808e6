//! Four samples per pixel: every triangle that a pixel shows is shaded once, at the pixel's centre, and weighed by its
//! share of the samples.

use super::each::each;
use super::isa::Kernel;
use super::kind::{Block, Oversampled, Square};
use super::raster::{NOTHING, Visibility};
use super::shade::{Mixture, STRIP, Shader, Sink, Strip, store_all};
use super::simd::{F32x16, FloatLike, I32x16, N_LANES, SetBits, Simd, SimdF32, SimdI32, SimdMask};
use super::surface::SEVERAL;

/// Samples along each edge of a pixel.
const PER_EDGE: usize = Oversampled::SAMPLES_PER_EDGE;
/// Samples of a pixel.
const PER_PIXEL: usize = PER_EDGE * PER_EDGE;
/// Share of a pixel's light that a sample has.
const SHARE: f32 = 1.0 / PER_PIXEL as f32;

/// Shades a picture from samples in [`Oversampled`] blocks.
pub(super) struct ShadeSamples<'a, K> {
    pub(super) shader: Shader<'a>,
    pub(super) visibility: &'a Visibility,
    pub(super) sink: K,
}

/// What the samples of a strip's blocks show.
struct Shown {
    /// By sample and block; lane i is pixel i.
    ids: [[I32x16; STRIP]; PER_PIXEL],
    depths: [[F32x16; STRIP]; PER_PIXEL],
    /// The triangle that all samples of a block show, or [`SEVERAL`].
    alls: [i32; STRIP],
}

impl Shown {
    const NOTHING: Self = Self {
        ids: [[I32x16([NOTHING; N_LANES]); STRIP]; PER_PIXEL],
        depths: [[F32x16::ZERO; STRIP]; PER_PIXEL],
        alls: [NOTHING; STRIP],
    };
}

/// Triangles that pixels of a strip show beside those of their first samples, packed: a list of each property.
struct Fragments {
    n: usize,
    /// FloatLike of the block times 16, plus that of the pixel.
    places: [i32; MAX_FRAGMENTS],
    ids: [i32; MAX_FRAGMENTS],
    /// As the bits of floats.
    depths: [i32; MAX_FRAGMENTS],
    /// Share of the pixel's samples, likewise.
    weights: [i32; MAX_FRAGMENTS],
}

/// Every sample but a pixel's first may show a triangle of its own; the last vector may be written past the last of them.
const MAX_FRAGMENTS: usize = STRIP * N_LANES * (PER_PIXEL - 1) + N_LANES;

impl Fragments {
    const NONE: Self = Self {
        n: 0,
        places: [0; MAX_FRAGMENTS],
        ids: [0; MAX_FRAGMENTS],
        depths: [0; MAX_FRAGMENTS],
        weights: [0; MAX_FRAGMENTS],
    };

    #[inline(always)]
    fn push<S: Simd>(&mut self, keep: S::M, block: usize, id: S::I, depth: S::F, weight: S::F) {
        let n = self.n;
        let place = S::I::load(&I32x16::INDICES) + S::I::splat((block * N_LANES) as i32);
        for (numbers, list) in [
            (place, &mut self.places),
            (id, &mut self.ids),
            (depth.bitcast_i32(), &mut self.depths),
            (weight.bitcast_i32(), &mut self.weights),
        ] {
            let (to, _) = list[n..].split_first_chunk_mut().expect("room for a vector behind the last one");
            self.n = n + S::compress(numbers, keep, to);
        }
    }

    /// Sixteen of a list, from the `first` on; there is nothing behind the end.
    #[inline(always)]
    fn line(list: &[i32; MAX_FRAGMENTS], first: usize) -> I32x16 {
        I32x16(each!(i in 16 => list[first + i]))
    }
}

impl<K: Sink> Kernel for ShadeSamples<'_, K> {
    #[inline(always)]
    fn run<S: Simd>(mut self) {
        let per_row = (self.visibility.side as usize / PER_EDGE) >> Square::WIDTH_BITS;
        let mut strip = Strip::new();
        let (mut shown, mut fragments) = (Shown::NOTHING, Fragments::NONE);
        let mut light = [[F32x16::ZERO; 3]; STRIP];
        for row in 0..per_row {
            for first in (0..per_row).step_by(STRIP) {
                let n = STRIP.min(per_row - first);
                for i in 0..n {
                    self.gather::<S>(first + i, row, i, &mut shown);
                }
                strip.go_to(first, row, n);
                let (ids, depths) = (&shown.ids[0][..n], &shown.depths[0][..n]);
                self.shader.shade::<S>(&shown.alls[..n], ids, depths, &mut strip);
                let mixed = weigh::<S>(&shown, &strip, &mut light, &mut fragments);
                self.add::<S>(&fragments, &mut strip, &mut light);
                for i in SetBits(mixed) {
                    strip.replace::<S>(i, each!(c in 3 => S::F::load(&light[i][c]).sqrt()));
                }
                self.sink.take::<S>(&strip);
            }
        }
    }
}

impl<K: Sink> ShadeSamples<'_, K> {
    /// Puts the samples of a strip's block of pixels, which lie in four blocks of samples, in the order of the pixels.
    #[inline(always)]
    fn gather<S: Simd>(&self, column: usize, row: usize, i: usize, shown: &mut Shown) {
        let pitch = self.visibility.side as usize >> Square::WIDTH_BITS;
        let upper = row * PER_EDGE * pitch + column * PER_EDGE;
        let blocks = [upper, upper + 1, upper + pitch, upper + pitch + 1];
        let alls = each!(k in 4 => self.shader.surfaces.shown[blocks[k]]);
        shown.alls[i] = if alls == [alls[0]; 4] { alls[0] } else { SEVERAL };
        let ids = S::interleave_tiles(each!(k in 4 => S::I::load(&self.visibility.ids[blocks[k]])));
        let depths = S::interleave_tiles(
            each!(k in 4 => S::F::load(&self.visibility.depths[blocks[k]]).bitcast_i32()),
        );
        for sample in 0..PER_PIXEL {
            ids[sample].store(&mut shown.ids[sample][i]);
            depths[sample].bitcast_f32().store(&mut shown.depths[sample][i]);
        }
    }

    /// Adds the fragments' light to that of their pixels.
    #[inline(always)]
    fn add<S: Simd>(&self, fragments: &Fragments, strip: &mut Strip, light: &mut [[F32x16; 3]; STRIP]) {
        let mut mixture = Mixture::NONE;
        for first in (0..fragments.n).step_by(N_LANES) {
            let n = N_LANES.min(fragments.n - first);
            let mut ids = Fragments::line(&fragments.ids, first);
            ids.0[n..].fill(NOTHING);
            let places = Fragments::line(&fragments.places, first);
            let place = S::I::load(&places);
            let block = place.shr_logical::<4>();
            let column = (block.shl::<2>() | place & S::I::splat(3)) + S::I::splat((strip.column * 4) as i32);
            let row = (place.shr_logical::<2>() & S::I::splat(3)) + S::I::splat((strip.row * 4) as i32);
            let depth = S::I::load(&Fragments::line(&fragments.depths, first)).bitcast_f32();
            let weight = S::I::load(&Fragments::line(&fragments.weights, first)).bitcast_f32();
            let gaze = self.shader.rays.through::<S>([column.to_f32(), row.to_f32()], depth);
            self.shader.gather::<S>(&ids, &gaze, &mut mixture);
            if mixture.textured != 0 {
                let mut blocks = I32x16::ZERO;
                block.store(&mut blocks);
                let tint = self.shader.tint::<S>(&ids, &blocks, &gaze, mixture.textured, strip);
                store_all::<S>(tint, &mut mixture.tint);
            }
            let roots = self.shader.several::<S>(&mixture, &gaze);
            let mut rgb = [F32x16::ZERO; 3];
            store_all::<S>(each!(c in 3 => linear::<S>(roots[c]) * weight), &mut rgb);
            for lane in 0..n {
                let (block, pixel) = (places.0[lane] as usize / N_LANES, places.0[lane] as usize % N_LANES);
                for c in 0..3 {
                    light[block][c].0[pixel] += rgb[c].0[lane];
                }
            }
        }
    }
}

/// Gives the first samples' light its weight in the strip's blocks where other samples show something else, and lists what
/// they show. Bit i: block i is one of them.
#[inline(always)]
fn weigh<S: Simd>(
    shown: &Shown,
    strip: &Strip,
    light: &mut [[F32x16; 3]; STRIP],
    fragments: &mut Fragments,
) -> u16 {
    fragments.n = 0;
    let mut mixed = 0;
    for (i, light) in light[..strip.n].iter_mut().enumerate() {
        if shown.alls[i] != SEVERAL {
            continue;
        }
        let ids = each!(s in 4 => S::I::load(&shown.ids[s][i]));
        let same = ids[1].eq(ids[0]) & ids[2].eq(ids[0]) & ids[3].eq(ids[0]);
        if same.to_bits() == u16::MAX {
            continue;
        }
        mixed |= 1 << i;
        let roots = strip.roots::<S>(i);
        let weight = share::<S>(&ids, 0);
        store_all::<S>(each!(c in 3 => linear::<S>(roots[c]) * weight), light);
        for sample in 1..PER_PIXEL {
            let mut keep = ids[sample].gt(S::I::splat(NOTHING));
            for before in &ids[..sample] {
                keep = keep.and_not(ids[sample].eq(*before));
            }
            if keep.any() {
                let depth = S::F::load(&shown.depths[sample][i]);
                fragments.push::<S>(keep, i, ids[sample], depth, share::<S>(&ids, sample));
            }
        }
    }
    mixed
}

/// What share of a pixel's samples show what this one shows, if none before it does.
#[inline(always)]
fn share<S: Simd>(ids: &[S::I; PER_PIXEL], sample: usize) -> S::F {
    let mut share = S::F::splat(SHARE);
    for after in &ids[sample + 1..] {
        share = share + S::F::splat(SHARE).select_or(after.eq(ids[sample]), S::F::splat(0.0));
    }
    share
}

/// Linear light, held in [0, 1], from its square root.
#[inline(always)]
fn linear<S: Simd>(root: S::F) -> S::F {
    let held = root.min(S::F::splat(1.0));
    held * held
}
