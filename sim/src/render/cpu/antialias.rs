//! Four samples per pixel: every triangle that a pixel shows is shaded once, at the pixel's centre, and weighed by its
//! share of the samples.

use super::each::each;
use super::isa::Kernel;
use super::kind::{Block, Oversampled, Square};
use super::raster::{NOTHING, Visibility};
use super::rays::Gaze;
use super::shade::{Mixture, STRIP, Shader, Sink, Strip};
use super::simd::{Floats, Line, N_LANES, Simd, WholeLine};
use super::surface::SEVERAL;

/// Samples along each edge of a pixel.
const PER_EDGE: usize = Oversampled::SAMPLES_PER_EDGE;
/// Samples of a pixel.
const PER_PIXEL: usize = PER_EDGE * PER_EDGE;

/// Shades a picture from samples in [`Oversampled`] blocks.
pub(super) struct ShadeSamples<'a, K> {
    pub(super) shader: Shader<'a>,
    pub(super) visibility: &'a Visibility,
    pub(super) sink: K,
}

/// What the samples of 4 × 4 pixels show: lane i is pixel i, one line per sample.
#[derive(Clone, Copy)]
struct Shown {
    ids: [WholeLine; PER_PIXEL],
    depths: [Line; PER_PIXEL],
    /// The triangle that all samples show, or [`SEVERAL`].
    all: i32,
}

impl Shown {
    const NOTHING: Self = Self {
        ids: [WholeLine([NOTHING; N_LANES]); PER_PIXEL],
        depths: [Line::ZERO; PER_PIXEL],
        all: NOTHING,
    };
}

/// A triangle that a pixel shows beside the one of its first sample.
#[derive(Clone, Copy)]
struct Fragment {
    pixel: usize,
    id: i32,
    depth: f32,
    /// Share of the pixel's samples.
    weight: f32,
}

/// Every sample but a pixel's first may show a triangle of its own.
const MAX_FRAGMENTS: usize = N_LANES * (PER_PIXEL - 1);

impl<K: Sink> Kernel for ShadeSamples<'_, K> {
    #[inline(always)]
    fn run<S: Simd>(mut self) {
        let per_row = (self.visibility.side as usize / PER_EDGE) >> Square::WIDTH_BITS;
        let mut strip = Strip::new();
        let mut shown = [Shown::NOTHING; STRIP];
        let (mut ids, mut depths) = ([WholeLine::ZERO; STRIP], [Line::ZERO; STRIP]);
        let mut alls = [NOTHING; STRIP];
        for row in 0..per_row {
            for first in (0..per_row).step_by(STRIP) {
                let n = STRIP.min(per_row - first);
                for i in 0..n {
                    self.gather::<S>(first + i, row, &mut shown[i]);
                    (ids[i], depths[i], alls[i]) = (shown[i].ids[0], shown[i].depths[0], shown[i].all);
                }
                strip.go_to(first, row, n);
                self.shader.shade::<S>(&alls[..n], &ids[..n], &depths[..n], &mut strip);
                for (i, shown) in shown[..n].iter().enumerate() {
                    if shown.all == SEVERAL {
                        self.mix::<S>(shown, i, &mut strip);
                    }
                }
                self.sink.take::<S>(&strip, &ids[..n]);
            }
        }
    }
}

impl<K: Sink> ShadeSamples<'_, K> {
    /// Puts the samples of a block of pixels, which lie in four blocks of samples, in the order of the pixels.
    #[inline(always)]
    fn gather<S: Simd>(&self, column: usize, row: usize, shown: &mut Shown) {
        let pitch = self.visibility.side as usize >> Square::WIDTH_BITS;
        let upper = row * PER_EDGE * pitch + column * PER_EDGE;
        let blocks = [upper, upper + 1, upper + pitch, upper + pitch + 1];
        let alls = each!(k in 4 => self.shader.surfaces.shown[blocks[k]]);
        shown.all = if alls == [alls[0]; 4] { alls[0] } else { SEVERAL };
        for pixel in 0..N_LANES {
            let (x, y) = (pixel % 4, pixel / 4);
            let block = blocks[y / 2 * 2 + x / 2];
            for sample in 0..PER_PIXEL {
                let lane = sample * 4 + y % 2 * 2 + x % 2;
                shown.ids[sample].0[pixel] = self.visibility.ids[block].0[lane];
                shown.depths[sample].0[pixel] = self.visibility.depths[block].0[lane];
            }
        }
    }

    /// Adds what the other samples of a strip's block show to the light of its first ones.
    #[inline(always)]
    fn mix<S: Simd>(&self, shown: &Shown, i: usize, strip: &mut Strip) {
        let mut fragments = [Fragment { pixel: 0, id: NOTHING, depth: 1.0, weight: 0.0 }; MAX_FRAGMENTS];
        let mut n_fragments = 0;
        let mut light = strip.roots(i);
        for pixel in 0..N_LANES {
            let ids = each!(s in 4 => shown.ids[s].0[pixel]);
            let share = |id: i32| ids.iter().filter(|other| **other == id).count() as f32 / PER_PIXEL as f32;
            for channel in &mut light {
                channel.0[pixel] = channel.0[pixel].min(1.0) * channel.0[pixel].min(1.0) * share(ids[0]);
            }
            for sample in 1..PER_PIXEL {
                let id = ids[sample];
                if id != NOTHING && !ids[..sample].contains(&id) {
                    let depth = shown.depths[sample].0[pixel];
                    fragments[n_fragments] = Fragment { pixel, id, depth, weight: share(id) };
                    n_fragments += 1;
                }
            }
        }
        let gaze = self.shader.rays.gaze::<S>(strip.column + i, strip.row);
        for fragments in fragments[..n_fragments].chunks(N_LANES) {
            let (ids, gaze) = scattered(&gaze, fragments);
            let mut mixture = Mixture::NONE;
            self.shader.gather::<S>(&ids, &gaze, &mut mixture);
            self.shader.tint::<S>(&ids, &gaze, i, strip, &mut mixture);
            let rgb = self.shader.several::<S>(&mixture, &gaze);
            for c in 0..3 {
                let mut channel = Line::ZERO;
                rgb[c].store(&mut channel);
                for (lane, fragment) in fragments.iter().enumerate() {
                    light[c].0[fragment.pixel] +=
                        channel.0[lane].min(1.0) * channel.0[lane].min(1.0) * fragment.weight;
                }
            }
        }
        for channel in &mut light {
            channel.0 = channel.0.map(f32::sqrt);
        }
        strip.replace(i, light);
    }
}

/// Triangles of up to sixteen fragments and the rays through their pixels.
#[inline(always)]
fn scattered<S: Simd>(gaze: &Gaze<S>, fragments: &[Fragment]) -> (WholeLine, Gaze<S>) {
    let mut lines = [Line::ZERO; 5];
    let rows = [gaze.pixel[0], gaze.pixel[1], gaze.d[0], gaze.d[1], gaze.per_length];
    for k in 0..5 {
        rows[k].store(&mut lines[k]);
    }
    let mut picked = lines;
    let (mut ids, mut depths) = (WholeLine([NOTHING; N_LANES]), Line([1.0; N_LANES]));
    for (lane, fragment) in fragments.iter().enumerate() {
        ids.0[lane] = fragment.id;
        depths.0[lane] = fragment.depth;
        for k in 0..5 {
            picked[k].0[lane] = lines[k].0[fragment.pixel];
        }
    }
    let [x, y, dx, dy, per_length] = picked;
    let gaze = Gaze {
        pixel: [S::F::load(&x), S::F::load(&y)],
        d: [S::F::load(&dx), S::F::load(&dy)],
        per_length: S::F::load(&per_length),
        depth: S::F::load(&depths),
    };
    (ids, gaze)
}
