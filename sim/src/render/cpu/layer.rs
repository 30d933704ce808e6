//! What a camera that stands still sees of what never moves: drawn once, then only what changes is drawn over it.

use super::each::each;
use super::isa::Kernel;
use super::kind::{Block, Square};
use super::raster::{NOTHING, Visibility};
use super::rays::{Gaze, Rays};
use super::shadow::{Highest, Reach, Shadow};
use super::simd::{Floats, Line, Mask, Simd, Whole, WholeLine};
use super::surface::SEVERAL;
use crate::render::Samples;
use crate::render::affine::Affine;

/// The part of a picture that stays. It makes no difference to the bytes: what stays comes first in every picture.
#[derive(Default)]
pub(in crate::render) struct Layer {
    /// The maps of what stays, from its meshes to the view frame, for which the rest was drawn.
    pub(super) maps: Vec<Affine>,
    /// How pixels are sampled.
    pub(super) samples: Samples,
    /// 1/z, block by block.
    pub(super) depths: Vec<Line>,
    /// What is seen, block by block.
    pub(super) ids: Vec<WholeLine>,
    /// What is seen everywhere in a block, or [`SEVERAL`]: read in place of `ids`, of which there are many.
    pub(super) shown: Vec<i32>,
    /// The picture of it: `[side, side, 3]`.
    pub(super) pixels: Vec<u8>,
    /// Per block of pixels where shadows fall on it; empty if none do.
    pub(super) reaches: Vec<Reach>,
}

impl Layer {
    /// Whether it was drawn for these maps, with pixels sampled like this.
    pub(super) fn shows(&self, maps: &[Affine], samples: Samples) -> bool {
        self.maps == maps && self.samples == samples
    }

    /// Puts what is seen in a block where nothing else is.
    #[inline(always)]
    fn fill<S: Simd>(&self, ids: &mut WholeLine, block: usize) {
        let over = S::I::load(ids);
        let drawn = over.gt(S::I::all(NOTHING));
        if drawn.to_bits() != u16::MAX {
            let behind = match self.shown[block] {
                SEVERAL => S::I::load(&self.ids[block]),
                shown => S::I::all(shown),
            };
            over.or_where(drawn, behind).store(ids);
        }
    }
}

/// Finds where shadows fall on a layer.
pub(super) struct Measure<'a> {
    pub(super) visibility: &'a Visibility,
    pub(super) samples_per_edge: usize,
    pub(super) rays: &'a Rays,
    pub(super) shadow: &'a Shadow<'a>,
    pub(super) reaches: &'a mut Vec<Reach>,
}

impl Kernel for Measure<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self {
            visibility: Visibility { side, depths, ids, .. },
            samples_per_edge,
            rays,
            shadow,
            reaches,
        } = self;
        let pitch = *side as usize >> Square::WIDTH_BITS;
        let per_row = pitch / samples_per_edge;
        reaches.clear();
        for block in 0..per_row * per_row {
            let (column, row) = (block % per_row, block / per_row);
            let mut reach = Reach::NONE;
            let nothing = S::I::all(NOTHING);
            if samples_per_edge == 1 {
                let gaze = rays.gaze::<S>(column, row).at(&depths[block]);
                reach.add::<S>(shadow, &gaze, S::I::load(&ids[block]).gt(nothing));
            } else {
                let upper = row * 2 * pitch + column * 2;
                let four = [upper, upper + 1, upper + pitch, upper + pitch + 1];
                let ids = S::unfolded(each!(k in 4 => S::I::load(&ids[four[k]])));
                let depths = S::unfolded(each!(k in 4 => S::F::load(&depths[four[k]]).bits()));
                for k in 0..4 {
                    let gaze = Gaze { depth: depths[k].as_float_bits(), ..rays.gaze::<S>(column, row) };
                    reach.add::<S>(shadow, &gaze, ids[k].gt(nothing));
                }
            }
            reaches.push(reach);
        }
    }
}

/// Finds which blocks of pixels are no longer as in a layer, and puts what the layer shows behind what moves there.
pub(super) struct Renew<'a> {
    /// Of what moves, drawn over the layer's depths.
    pub(super) visibility: &'a mut Visibility,
    pub(super) samples_per_edge: usize,
    pub(super) layer: &'a Layer,
    /// The heights of what moves, if it casts shadows.
    pub(super) moving: Option<&'a Highest>,
    /// Per block of pixels.
    pub(super) stale: &'a mut Vec<bool>,
}

impl Kernel for Renew<'_> {
    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { visibility: Visibility { side, ids, .. }, samples_per_edge, layer, moving, stale } = self;
        let pitch = *side as usize >> Square::WIDTH_BITS;
        let per_row = pitch / samples_per_edge;
        let nothing = S::I::all(NOTHING);
        stale.clear();
        stale.resize(per_row * per_row, false);
        if let Some(highest) = moving {
            for (stale, reach) in stale.iter_mut().zip(&layer.reaches) {
                *stale = reach.is_touched(highest);
            }
        }
        if samples_per_edge == 1 {
            for (block, (ids, stale)) in ids.iter_mut().zip(stale).enumerate() {
                *stale |= S::I::load(ids).gt(nothing).any();
                if *stale {
                    layer.fill::<S>(ids, block);
                }
            }
            return;
        }
        for (block, stale) in stale.iter_mut().enumerate() {
            let upper = block / per_row * 2 * pitch + block % per_row * 2;
            let four = [upper, upper + 1, upper + pitch, upper + pitch + 1];
            let [a, b, c, d] = each!(k in 4 => S::I::load(&ids[four[k]]));
            *stale |= a.max(b).max(c.max(d)).gt(nothing).any();
            if *stale {
                for block in four {
                    layer.fill::<S>(&mut ids[block], block);
                }
            }
        }
    }
}
