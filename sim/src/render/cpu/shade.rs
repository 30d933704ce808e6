//! From visible triangles to bytes: every block of pixels is looked at once.

use super::each::each;
use super::encode::encode;
use super::isa::Kernel;
use super::kind::{Block, Square};
use super::light::{Lamps, Lit, seen};
use super::raster::{NOTHING, Visibility};
use super::rays::{Gaze, Rays};
use super::sample::{Level, Levels, Site, Uv};
use super::shadow::Shadow;
use super::simd::{Floats, Line, Mask, N_LANES, Number, Per, Simd, Whole, WholeLine};
use super::surface::{Look, Surfaces, VOID, Wrap, is_uniform};
use crate::render::texture::pattern;
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
    /// Takes the pixels of the block at this column and row, red in the lowest byte. `nothing` are those at which nothing
    /// was seen; they are black.
    fn put<S: Simd>(&mut self, column: usize, row: usize, pixels: S::I, nothing: S::M);
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
                let blocks = row * per_row + first..row * per_row + per_row.min(first + STRIP);
                let ids = &self.visibility.ids[blocks.clone()];
                strip.go_to(first, row);
                self.shader.shade::<S>(ids, &self.visibility.depths[blocks], &mut strip);
                for (i, ids) in ids.iter().enumerate() {
                    let nothing = S::I::load(ids).eq(S::I::all(NOTHING));
                    self.sink.put::<S>(first + i, row, strip.packed::<S>(i), nothing);
                }
            }
        }
    }
}

/// Blocks that are shaded step by step side by side: see [`Site`].
pub(super) const STRIP: usize = N_LANES;

/// What was found out about a strip's blocks.
pub(super) struct Strip {
    /// Column of its first block and row of all of them.
    pub(super) column: usize,
    pub(super) row: usize,
    kinds: [Kind; STRIP],
    sites: [Site; STRIP],
    /// Linear RGB: first the texture's factors, then the light that reaches the eye.
    pub(super) rgb: [[Line; 3]; STRIP],
    /// Levels of the triangle that was looked up last, by id, in the middle of each block.
    levels: (i32, Levels),
    /// The flat triangle that was shaded last.
    flat: FlatSurface,
}

/// A flat triangle.
struct FlatSurface {
    id: i32,
    lit: Lit<f32>,
    /// Whether a highlight may be seen in the present strip.
    gleams: bool,
}

/// What a block shows.
#[derive(Clone, Copy)]
enum Kind {
    Nothing,
    /// One triangle without a texture, by id.
    Plain(i32),
    /// One triangle with a texture, by id.
    Textured(i32),
    Several,
}

impl Strip {
    pub(super) fn new() -> Self {
        Self {
            column: 0,
            row: 0,
            kinds: [Kind::Nothing; STRIP],
            sites: [const { Site::NOWHERE }; STRIP],
            rgb: [[Line::ZERO; 3]; STRIP],
            levels: (NOTHING, Levels::NONE),
            flat: FlatSurface { id: NOTHING, lit: Lit::DARK, gleams: false },
        }
    }

    /// A block's pixels, red in the lowest byte.
    #[inline(always)]
    pub(super) fn packed<S: Simd>(&self, i: usize) -> S::I {
        // Nothing but black, as in most blocks over a layer.
        if let Kind::Nothing = self.kinds[i] {
            return S::I::all(0);
        }
        let [r, g, b] = each!(c in 3 => encode::<S>(S::F::load(&self.rgb[i][c])));
        r | g.shl::<8>() | b.shl::<16>()
    }

    /// Puts other light in the place of a block's.
    pub(super) fn replace(&mut self, i: usize, rgb: [Line; 3]) {
        self.kinds[i] = Kind::Several;
        self.rgb[i] = rgb;
    }

    /// Goes to another place.
    pub(super) fn go_to(&mut self, column: usize, row: usize) {
        (self.column, self.row) = (column, row);
        (self.levels.0, self.flat.id) = (NOTHING, NOTHING);
    }
}

impl Shader<'_> {
    /// Fills a strip's `rgb` with the light of blocks that show these triangles at these depths.
    #[inline(always)]
    pub(super) fn shade<S: Simd>(&self, ids: &[WholeLine], depths: &[Line], strip: &mut Strip) {
        self.look_up::<S>(ids, strip);
        self.light::<S>(ids, depths, strip);
    }

    /// Finds the kinds of a strip's blocks and reads the textures of those that show one triangle.
    #[inline(always)]
    fn look_up<S: Simd>(&self, ids: &[WholeLine], strip: &mut Strip) {
        for (i, ids) in ids.iter().enumerate() {
            let kind = self.kind::<S>(ids);
            strip.kinds[i] = kind;
            if let Kind::Textured(id) = kind {
                let gaze = self.rays.gaze::<S>(strip.column + i, strip.row);
                let level = self.level::<S>(id, i, strip);
                strip.sites[i].locate::<S>(&self.uv::<S>(id, &gaze), level);
            }
        }
        for (i, kind) in strip.kinds.iter().enumerate().take(ids.len()) {
            if let Kind::Textured(id) = *kind {
                let factors = strip.sites[i].read::<S>(pattern(Texture::ALL[self.texture(id) as usize]));
                store_all::<S>(factors, &mut strip.rgb[i]);
            }
        }
    }

    /// Level at which to read a triangle's texture in a strip's block.
    #[inline(always)]
    fn level<S: Simd>(&self, id: i32, i: usize, strip: &mut Strip) -> Level {
        let (known, levels) = &mut strip.levels;
        if *known != id {
            *known = id;
            let columns = S::F::load(&BLOCK_STARTS) + S::F::all((strip.column << Square::WIDTH_BITS) as f32);
            let row = S::F::all((strip.row << Square::HEIGHT_BITS) as f32);
            let middle = S::F::all(1.5);
            levels.set::<S>(self.footprint::<S>(id, [columns + middle, row + middle]));
        }
        levels.get(i)
    }

    #[inline(always)]
    fn kind<S: Simd>(&self, ids: &WholeLine) -> Kind {
        match ids.0[0] {
            _ if !is_uniform::<S>(ids) => Kind::Several,
            NOTHING => Kind::Nothing,
            id if self.texture(id) < 0 => Kind::Plain(id),
            id => Kind::Textured(id),
        }
    }

    /// Texture of a visible triangle, -1 for none.
    #[inline(always)]
    fn texture(&self, id: i32) -> i32 {
        self.surfaces.looks[id as usize].0[Look::TEXTURE].to_bits().cast_signed()
    }

    /// Puts the light of a strip's blocks in the place of their textures' factors.
    #[inline(always)]
    fn light<S: Simd>(&self, ids: &[WholeLine], depths: &[Line], strip: &mut Strip) {
        for (i, ids) in ids.iter().enumerate() {
            let gaze = self.rays.gaze::<S>(strip.column + i, strip.row).at(&depths[i]);
            let rgb = &strip.rgb[i];
            let light = match strip.kinds[i] {
                Kind::Nothing => [S::F::all(0.0); 3],
                Kind::Plain(id) => self.one(id, [S::F::all(1.0); 3], &gaze, strip),
                Kind::Textured(id) => self.one(id, each!(c in 3 => S::F::load(&rgb[c])), &gaze, strip),
                Kind::Several => self.several::<S>(ids, &gaze, i, strip),
            };
            store_all::<S>(light, &mut strip.rgb[i]);
        }
    }

    /// Light of a block that shows one triangle.
    #[inline(always)]
    fn one<S: Simd>(&self, id: i32, tint: [S::F; 3], gaze: &Gaze<S>, strip: &mut Strip) -> [S::F; 3] {
        let look = &self.surfaces.looks[id as usize].0;
        let color = each!(c in 3 => S::F::all(look[Look::COLOR + c]) * tint[c]);
        let specular = S::F::all(look[Look::SPECULAR]);
        if look[Look::FLAT] == 1.0 {
            if strip.flat.id != id {
                let lit = Lit::new(self.lamps, normal_of(look));
                let gleams = lit.gleams(&self.rays.corners(strip.column, strip.row, STRIP));
                strip.flat = FlatSurface { id, lit, gleams };
            }
            let FlatSurface { lit, gleams, .. } = &strip.flat;
            let sunlight = self.sunlight(lit, gaze);
            return seen(lit, self.lamps, *gleams, gaze, sunlight, color, specular);
        }
        let lit = Lit::new(self.lamps, over::<S, f32>(look, Look::NORMAL, gaze));
        let sunlight = self.sunlight(&lit, gaze);
        seen(&lit, self.lamps, true, gaze, sunlight, color, specular)
    }

    /// Light of a block that shows several triangles.
    #[inline(always)]
    pub(super) fn several<S: Simd>(
        &self,
        ids: &WholeLine,
        gaze: &Gaze<S>,
        i: usize,
        strip: &mut Strip,
    ) -> [S::F; 3] {
        let looks = S::transposed(each!(i in 16 => match ids.0[i] {
            NOTHING => S::F::load(&VOID),
            id => S::F::load(&self.surfaces.looks[id as usize]),
        }));
        let lit = Lit::new(self.lamps, over::<S, S::F>(&looks, Look::NORMAL, gaze));
        let mut color = [looks[Look::COLOR], looks[Look::COLOR + 1], looks[Look::COLOR + 2]];
        let textured = looks[Look::TEXTURE].bits().gt(S::I::all(-1)).to_bits();
        if textured != 0 {
            self.tint::<S>(ids, textured, gaze, i, strip, &mut color);
        }
        let sunlight = self.sunlight(&lit, gaze);
        seen(&lit, self.lamps, true, gaze, sunlight, color, looks[Look::SPECULAR])
    }

    /// What share of the first sun's light reaches what is seen.
    #[inline(always)]
    fn sunlight<S: Simd, N: Per<S>>(&self, lit: &Lit<N>, gaze: &Gaze<S>) -> S::F {
        match &self.shadow {
            Some(shadow) => shadow.sunlight(gaze, &lit.normal),
            None => S::F::all(1.0),
        }
    }

    /// Multiplies the colours of textured pixels, triangle by triangle: few blocks show many textured ones.
    #[inline(always)]
    fn tint<S: Simd>(
        &self,
        ids: &WholeLine,
        mut textured: u16,
        gaze: &Gaze<S>,
        i: usize,
        strip: &mut Strip,
        color: &mut [S::F; 3],
    ) {
        let all_ids = S::I::load(ids);
        while textured != 0 {
            let id = ids.0[textured.trailing_zeros() as usize];
            let level = self.level::<S>(id, i, strip);
            let site = &mut strip.sites[i];
            site.locate::<S>(&self.uv::<S>(id, gaze), level);
            let factors = site.read::<S>(pattern(Texture::ALL[self.texture(id) as usize]));
            let here = all_ids.eq(S::I::all(id));
            for c in 0..3 {
                color[c] = (color[c] * factors[c]).or_where(here, color[c]);
            }
            textured &= !here.to_bits();
        }
    }

    /// Texture coordinates on a triangle, in tiles.
    #[inline(always)]
    fn uv<S: Simd>(&self, id: i32, gaze: &Gaze<S>) -> Uv<S> {
        let wrap = &self.surfaces.wraps[id as usize].0;
        let per_n = S::F::all(1.0) / linear::<S, f32>(wrap, Wrap::N, gaze.pixel);
        each!(k in 2 => linear::<S, f32>(wrap, [Wrap::U, Wrap::V][k], gaze.pixel) * per_n)
    }

    /// Greater squared length, in tiles², that a step of one pixel right or down makes on a triangle.
    #[inline(always)]
    fn footprint<S: Simd>(&self, id: i32, pixel: [S::F; 2]) -> S::F {
        let wrap = &self.surfaces.wraps[id as usize].0;
        let per_n = S::F::all(1.0) / linear::<S, f32>(wrap, Wrap::N, pixel);
        let u = linear::<S, f32>(wrap, Wrap::U, pixel) * per_n;
        let v = linear::<S, f32>(wrap, Wrap::V, pixel) * per_n;
        // d(U/n) = (dU − (U/n) dn) / n.
        let [right, down] = each!(k in 2 => {
            let dn = S::F::all(-wrap[Wrap::N + k + 1]);
            let du = u.mul_add(dn, S::F::all(wrap[Wrap::U + k + 1])) * per_n;
            let dv = v.mul_add(dn, S::F::all(wrap[Wrap::V + k + 1])) * per_n;
            du.mul_add(du, dv * dv)
        });
        right.max(down)
    }
}

/// Columns of the first pixels of a strip's blocks.
const BLOCK_STARTS: Line = {
    let mut line = Line::ZERO;
    let mut i = 0;
    while i < N_LANES {
        line.0[i] = (i << Square::WIDTH_BITS) as f32;
        i += 1;
    }
    line
};

#[inline(always)]
fn store_all<S: Simd>(rgb: [S::F; 3], lines: &mut [Line; 3]) {
    for (channel, line) in rgb.iter().zip(lines) {
        channel.store(line);
    }
}

fn normal_of(look: &[f32; N_LANES]) -> [f32; 3] {
    [0, 3, 6].map(|k| look[Look::NORMAL + k])
}

/// Three functions that are linear over the image, from index `from` on.
#[inline(always)]
fn over<S: Simd, N: Per<S>>(numbers: &[N; N_LANES], from: usize, gaze: &Gaze<S>) -> [S::F; 3] {
    each!(k in 3 => linear::<S, N>(numbers, from + 3 * k, gaze.pixel))
}

#[inline(always)]
fn linear<S: Simd, N: Per<S>>(numbers: &[N; N_LANES], k: usize, [x, y]: [S::F; 2]) -> S::F {
    x.mul_add(numbers[k + 1].spread(), y.mul_add(numbers[k + 2].spread(), numbers[k].spread()))
}
