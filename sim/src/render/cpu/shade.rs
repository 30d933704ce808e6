//! From visible triangles to bytes: every block of pixels is looked at once.

use super::each::each;
use super::encode::encode;
use super::isa::Kernel;
use super::kind::{Block, Square};
use super::light::{Lamps, Lit, Paint, seen};
use super::raster::{NOTHING, Visibility};
use super::rays::{Gaze, Rays};
use super::sample::{Level, Levels, Site, Uv};
use super::shadow::Shadow;
use super::simd::{Broadcast, F32x16, FloatLike, I32x16, N_LANES, SetBits, Simd, SimdF32, SimdI32, SimdMask};
use super::surface::{Look, SEVERAL, Surfaces, Wrap, place};
use crate::render::texture::{MipChain, mip_chain};
use crate::scene::Texture;

/// What a picture's blocks are shaded with.
pub(super) struct Shader<'a> {
    pub(super) lamps: &'a Lamps,
    pub(super) rays: &'a Rays,
    pub(super) surfaces: &'a Surfaces,
    /// The first sun's shadows, if it casts any.
    pub(super) shadow: Option<Shadow<'a>>,
}

/// Where pixels go.
pub(super) trait Sink {
    /// Takes the pixels of a strip of blocks.
    fn take<S: Simd>(&mut self, strip: &Strip);
}

/// Shades a picture.
pub(super) struct Shade<'a, K> {
    pub(super) shader: Shader<'a>,
    pub(super) visibility: &'a Visibility,
    pub(super) sink: K,
}

impl<K: Sink> Kernel for Shade<'_, K> {
    #[inline(always)]
    fn run<S: Simd>(mut self) {
        let per_row = self.visibility.side as usize >> Square::WIDTH_BITS;
        let mut strip = Strip::new();
        for row in 0..per_row {
            for first in (0..per_row).step_by(STRIP) {
                let n = STRIP.min(per_row - first);
                let blocks = row * per_row + first..row * per_row + first + n;
                let (ids, depths) =
                    (&self.visibility.ids[blocks.clone()], &self.visibility.depths[blocks.clone()]);
                strip.go_to(first, row, n);
                self.shader.shade::<S>(&self.shader.surfaces.shown[blocks], ids, depths, &mut strip);
                self.sink.take::<S>(&strip);
            }
        }
    }
}

/// Blocks that are shaded step by step side by side: a processor can then work on several of them at a time, as each
/// step's chain of dependent instructions is long.
pub(super) const STRIP: usize = N_LANES;

/// A strip of blocks and what was found out about them.
pub(super) struct Strip {
    /// Column of the first block and row of all of them.
    pub(super) column: usize,
    pub(super) row: usize,
    /// How many there are.
    pub(super) n: usize,
    /// Bit i: block i shows one triangle.
    single: u16,
    /// Bit i: block i shows several triangles.
    several: u16,
    /// See [`Surfaces::shown`].
    shown: I32x16,
    sites: [Site; STRIP],
    mixtures: [Mixture; STRIP],
    /// Square roots of linear RGB: first of the texture's factors, then of the light that reaches the eye.
    roots: [[F32x16; 3]; STRIP],
    /// Levels of the triangle that was looked up last, by place, in the middle of each block.
    levels: (usize, Levels),
    /// The flat triangle that was shaded last.
    flat: FlatSurface,
}

/// A flat triangle, by place.
struct FlatSurface {
    place: usize,
    lit: Lit<f32>,
    /// Whether a highlight may be seen in the present strip.
    gleams: bool,
    /// Bit i: block i shows it in full sunlight, as far as that is known, or in its own shade.
    sunlit: u16,
    /// Square roots of its light where there is neither highlight nor shadow nor texture.
    roots: [f32; 3],
}

/// What sixteen pixels of several triangles are made of.
pub(super) struct Mixture {
    /// In the view frame, of any length.
    normal: [F32x16; 3],
    color: [F32x16; 3],
    /// Square roots of textures' factors.
    pub(super) tint: [F32x16; 3],
    specular: F32x16,
    /// Bit i: lane i shows a texture.
    pub(super) textured: u16,
}

impl Mixture {
    /// Nothing.
    pub(super) const NONE: Self = Self {
        normal: [F32x16::ZERO; 3],
        color: [F32x16::ZERO; 3],
        tint: [F32x16::ZERO; 3],
        specular: F32x16::ZERO,
        textured: 0,
    };
}

/// No triangle's place.
const NOWHERE: usize = usize::MAX;

impl Strip {
    pub(super) fn new() -> Self {
        Self {
            column: 0,
            row: 0,
            n: 0,
            single: 0,
            several: 0,
            shown: I32x16::ZERO,
            sites: [const { Site::NOWHERE }; STRIP],
            mixtures: [const { Mixture::NONE }; STRIP],
            roots: [[F32x16::ZERO; 3]; STRIP],
            levels: (NOWHERE, Levels::NONE),
            flat: FlatSurface { place: NOWHERE, lit: Lit::DARK, gleams: false, sunlit: 0, roots: [0.0; 3] },
        }
    }

    /// Bit i: block i shows anything.
    pub(super) fn lit(&self) -> u16 {
        self.single | self.several
    }

    /// A block's pixels, red in the lowest byte.
    #[inline(always)]
    pub(super) fn packed<S: Simd>(&self, i: usize) -> S::I {
        if self.lit() >> i & 1 == 0 {
            return S::I::splat(0);
        }
        let [r, g, b] = each!(c in 3 => encode::<S>(S::F::load(&self.roots[i][c])));
        r | g.shl::<8>() | b.shl::<16>()
    }

    /// Square roots of a block's light, linear RGB.
    #[inline(always)]
    pub(super) fn roots<S: Simd>(&self, i: usize) -> [S::F; 3] {
        let is_lit = self.lit() >> i & 1 == 1;
        each!(c in 3 => if is_lit { S::F::load(&self.roots[i][c]) } else { S::F::splat(0.0) })
    }

    /// Puts other light in the place of a block's.
    #[inline(always)]
    pub(super) fn replace<S: Simd>(&mut self, i: usize, roots: [S::F; 3]) {
        self.several |= 1 << i;
        store_all::<S>(roots, &mut self.roots[i]);
    }

    /// Sorts the blocks by what they show.
    #[inline(always)]
    fn sort<S: Simd>(&mut self, shown: &[i32]) {
        let shown = S::I::load_partial(shown, NOTHING);
        shown.store(&mut self.shown);
        self.single = shown.gt(S::I::splat(NOTHING)).to_bits();
        self.several = shown.eq(S::I::splat(SEVERAL)).to_bits();
    }

    /// Goes to another place.
    pub(super) fn go_to(&mut self, column: usize, row: usize, n: usize) {
        (self.column, self.row, self.n) = (column, row, n);
        (self.levels.0, self.flat.place) = (NOWHERE, NOWHERE);
    }
}

impl Shader<'_> {
    /// Fills a strip with the light of blocks that show these triangles at these depths; see [`Surfaces::shown`].
    #[inline(always)]
    pub(super) fn shade<S: Simd>(&self, shown: &[i32], ids: &[I32x16], depths: &[F32x16], strip: &mut Strip) {
        strip.sort::<S>(shown);
        for block in SetBits(strip.single) {
            let place = place(shown[block]);
            if self.texture(place) >= 0 {
                let gaze = self.rays.gaze::<S>(strip.column + block, strip.row);
                let level = self.level::<S>(place, block, strip);
                strip.sites[block].locate::<S>(&self.uv::<S>(place, &gaze), level);
            }
        }
        for block in SetBits(strip.single) {
            let place = place(shown[block]);
            let tint = if self.texture(place) < 0 {
                [S::F::splat(1.0); 3]
            } else {
                strip.sites[block].read::<S>(self.pattern(place))
            };
            let roots = self.single::<S>(place, tint, depths, block, strip);
            store_all::<S>(roots, &mut strip.roots[block]);
        }
        for block in SetBits(strip.several) {
            let gaze = self.rays.gaze::<S>(strip.column + block, strip.row);
            self.gather::<S>(&ids[block], &gaze, &mut strip.mixtures[block]);
        }
        for block in SetBits(strip.several) {
            if strip.mixtures[block].textured != 0 {
                let gaze = self.rays.gaze::<S>(strip.column + block, strip.row);
                let here = I32x16([block as i32; N_LANES]);
                let textured = strip.mixtures[block].textured;
                let tint = self.tint::<S>(&ids[block], &here, &gaze, textured, strip);
                store_all::<S>(tint, &mut strip.mixtures[block].tint);
            }
        }
        for block in SetBits(strip.several) {
            let gaze = self.rays.gaze::<S>(strip.column + block, strip.row).at(&depths[block]);
            let roots = self.several::<S>(&strip.mixtures[block], &gaze);
            store_all::<S>(roots, &mut strip.roots[block]);
        }
    }

    /// Level at which to read a triangle's texture in a strip's block.
    #[inline(always)]
    fn level<S: Simd>(&self, place: usize, block: usize, strip: &mut Strip) -> Level {
        let (known, levels) = &mut strip.levels;
        if *known != place {
            *known = place;
            let middle = S::F::splat(1.5);
            let pixel = Rays::pixels_of_strip::<S>([strip.column, strip.row], 0);
            levels.set::<S>(self.footprint::<S>(place, each!(k in 2 => pixel[k] + middle)));
        }
        levels.get(block)
    }

    /// Texture of a visible triangle, -1 for none.
    #[inline(always)]
    fn texture(&self, place: usize) -> i32 {
        self.surfaces.looks[place].0[Look::TEXTURE].to_bits().cast_signed()
    }

    /// The same of one that has a texture.
    #[inline(always)]
    fn pattern(&self, place: usize) -> &'static MipChain {
        mip_chain(Texture::ALL[self.texture(place) as usize])
    }

    /// Square roots of the light of a block that shows one triangle.
    #[inline(always)]
    fn single<S: Simd>(
        &self,
        place: usize,
        tint: [S::F; 3],
        depths: &[F32x16],
        block: usize,
        strip: &mut Strip,
    ) -> [S::F; 3] {
        let look = &self.surfaces.looks[place].0;
        let is_flat = look[Look::FLAT] == 1.0;
        if is_flat {
            if strip.flat.place != place {
                strip.flat = self.flat::<S>(block, depths, strip);
            }
            let FlatSurface { gleams, sunlit, roots, .. } = &strip.flat;
            if !gleams && sunlit >> block & 1 == 1 {
                return each!(c in 3 => S::F::splat(roots[c]) * tint[c]);
            }
        }
        // The general case.
        let gaze = &self.rays.gaze::<S>(strip.column + block, strip.row).at(&depths[block]);
        let color = each!(c in 3 => S::F::splat(look[Look::COLOR + c]));
        let paint = &Paint { color, tint, specular: S::F::splat(look[Look::SPECULAR]) };
        if is_flat {
            let FlatSurface { lit, gleams, sunlit, .. } = &strip.flat;
            let sunlight = if sunlit >> block & 1 == 1 { None } else { self.sunlight(lit, gaze) };
            return seen(lit, self.lamps, *gleams, gaze, sunlight, paint);
        }
        let lit = Lit::new(self.lamps, over::<S, f32>(look, Look::NORMAL, gaze));
        seen(&lit, self.lamps, true, gaze, self.sunlight(&lit, gaze), paint)
    }

    /// The flat triangle of a strip's block as the strip shows it.
    #[inline(always)]
    fn flat<S: Simd>(&self, block: usize, depths: &[F32x16], strip: &Strip) -> FlatSurface {
        let place = place(strip.shown.0[block]);
        let look = &self.surfaces.looks[place].0;
        let lit = Lit::new(self.lamps, normal_of(look));
        let gleams =
            look[Look::SPECULAR] > 0.0 && lit.gleams(&self.rays.corners(strip.column, strip.row, STRIP));
        let sunlit = match &self.shadow {
            Some(shadow) if lit.faces_first_sun::<S>().any() => {
                let blocks = S::I::load(&strip.shown).eq(S::I::splat(strip.shown.0[block])).to_bits();
                let at = [strip.column, strip.row];
                shadow.in_sunlight::<S>(self.rays, at, depths, blocks, &lit.normal)
            }
            _ => u16::MAX,
        };
        let roots = lit.plain_roots(each!(c in 3 => look[Look::COLOR + c]));
        FlatSurface { place, lit, gleams, sunlit, roots }
    }

    /// Finds what pixels show, each its own triangle, but for the textures.
    #[inline(always)]
    pub(super) fn gather<S: Simd>(&self, ids: &I32x16, gaze: &Gaze<S>, mixture: &mut Mixture) {
        let looks = S::transpose(each!(i in 16 => S::F::load(&self.surfaces.looks[place(ids.0[i])])));
        store_all::<S>(over::<S, S::F>(&looks, Look::NORMAL, gaze), &mut mixture.normal);
        store_all::<S>(each!(c in 3 => looks[Look::COLOR + c]), &mut mixture.color);
        store_all::<S>([S::F::splat(1.0); 3], &mut mixture.tint);
        looks[Look::SPECULAR].store(&mut mixture.specular);
        mixture.textured = looks[Look::TEXTURE].bitcast_i32().gt(S::I::splat(-1)).to_bits();
    }

    /// Tints of pixels in the given blocks of a strip, found for the textured ones of each block triangle by triangle: few
    /// blocks show many textured triangles.
    #[inline(always)]
    pub(super) fn tint<S: Simd>(
        &self,
        ids: &I32x16,
        blocks: &I32x16,
        gaze: &Gaze<S>,
        mut textured: u16,
        strip: &mut Strip,
    ) -> [S::F; 3] {
        let (all_ids, all_blocks) = (S::I::load(ids), S::I::load(blocks));
        let mut tint = [S::F::splat(1.0); 3];
        while textured != 0 {
            let lane = textured.trailing_zeros() as usize;
            let (id, block) = (ids.0[lane], blocks.0[lane]);
            let place = place(id);
            let level = self.level::<S>(place, block as usize, strip);
            let site = &mut strip.sites[block as usize];
            site.locate::<S>(&self.uv::<S>(place, gaze), level);
            let factors = site.read::<S>(self.pattern(place));
            let here = all_ids.eq(S::I::splat(id)) & all_blocks.eq(S::I::splat(block));
            tint = each!(c in 3 => factors[c].select_or(here, tint[c]));
            textured &= !here.to_bits();
        }
        tint
    }

    /// Square roots of the light of pixels that show several triangles.
    #[inline(always)]
    pub(super) fn several<S: Simd>(&self, mixture: &Mixture, gaze: &Gaze<S>) -> [S::F; 3] {
        let Mixture { normal, color, tint, specular, .. } = mixture;
        let lit = Lit::new(self.lamps, each!(k in 3 => S::F::load(&normal[k])));
        let paint = Paint {
            color: each!(c in 3 => S::F::load(&color[c])),
            tint: each!(c in 3 => S::F::load(&tint[c])),
            specular: S::F::load(specular),
        };
        seen(&lit, self.lamps, true, gaze, self.sunlight(&lit, gaze), &paint)
    }

    /// What share of the first sun's light reaches what is seen: see [`Shadow::sunlight`]; `None` if it makes no difference, or
    /// for all.
    #[inline(always)]
    fn sunlight<S: Simd, N: Broadcast<S>>(&self, lit: &Lit<N>, gaze: &Gaze<S>) -> Option<S::F> {
        let shadow = self.shadow.as_ref()?;
        let facing = lit.faces_first_sun::<S>();
        facing.any().then(|| shadow.sunlight(gaze, &lit.normal, facing))
    }

    /// Texture coordinates on a triangle, in tiles.
    #[inline(always)]
    fn uv<S: Simd>(&self, place: usize, gaze: &Gaze<S>) -> Uv<S> {
        let wrap = &self.surfaces.wraps[place].0;
        let per_n = S::F::splat(1.0) / linear::<S, f32>(wrap, Wrap::N, gaze.pixel);
        each!(k in 2 => linear::<S, f32>(wrap, [Wrap::U, Wrap::V][k], gaze.pixel) * per_n)
    }

    /// Greater squared length, in tiles², that a step of one pixel right or down makes on a triangle.
    #[inline(always)]
    fn footprint<S: Simd>(&self, place: usize, pixel: [S::F; 2]) -> S::F {
        let wrap = &self.surfaces.wraps[place].0;
        let per_n = S::F::splat(1.0) / linear::<S, f32>(wrap, Wrap::N, pixel);
        let u = linear::<S, f32>(wrap, Wrap::U, pixel) * per_n;
        let v = linear::<S, f32>(wrap, Wrap::V, pixel) * per_n;
        // d(U/n) = (dU − (U/n) dn) / n.
        let [right, down] = each!(k in 2 => {
            let dn = S::F::splat(-wrap[Wrap::N + k + 1]);
            let du = u.mul_add(dn, S::F::splat(wrap[Wrap::U + k + 1])) * per_n;
            let dv = v.mul_add(dn, S::F::splat(wrap[Wrap::V + k + 1])) * per_n;
            du.mul_add(du, dv * dv)
        });
        right.max(down)
    }
}

#[inline(always)]
pub(super) fn store_all<S: Simd>(rgb: [S::F; 3], lines: &mut [F32x16; 3]) {
    for (channel, line) in rgb.iter().zip(lines) {
        channel.store(line);
    }
}

fn normal_of(look: &[f32; N_LANES]) -> [f32; 3] {
    [0, 3, 6].map(|k| look[Look::NORMAL + k])
}

/// Three functions that are linear over the image, from index `from` on.
#[inline(always)]
fn over<S: Simd, N: Broadcast<S>>(numbers: &[N; N_LANES], from: usize, gaze: &Gaze<S>) -> [S::F; 3] {
    each!(k in 3 => linear::<S, N>(numbers, from + 3 * k, gaze.pixel))
}

#[inline(always)]
fn linear<S: Simd, N: Broadcast<S>>(numbers: &[N; N_LANES], k: usize, [x, y]: [S::F; 2]) -> S::F {
    x.mul_add(numbers[k + 1].broadcast(), y.mul_add(numbers[k + 2].broadcast(), numbers[k].broadcast()))
}
