//! Looking a map up: which part of the sun's light reaches a block of pixels, and where it is looked up.

use super::{CELL, Highest, SIDE, TEXELS_PER_M};
use crate::render::affine::Affine;
use crate::render::cpu::each::each;
use crate::render::cpu::kind::Square;
use crate::render::cpu::rays::Gaze;
use crate::render::cpu::simd::{Floats, Lanes, Line, Mask, Number, Per, Simd, Whole, WholeLine};
use crate::render::rules::OFF_SURFACE_M;

/// A shadow map as a camera looks it up.
pub(in crate::render::cpu) struct Shadow<'a> {
    /// `[512, 512]` bits of f32 heights in m.
    pub(super) heights: &'a [u32],
    pub(super) highest: &'a Highest,
    /// From the view frame to texels and heights.
    pub(super) texel_from_view: Affine,
}

impl Shadow<'_> {
    /// What share of the sun's light reaches what is seen, given its unit normals; `None` for all. Only where it is `facing`
    /// the sun the answer means anything. `is_plane` if one flat triangle is seen through a [`super::kind::Square`] of pixels.
    #[inline(always)]
    pub(in crate::render::cpu) fn sunlight<S: Simd, N: Per<S>>(
        &self,
        gaze: &Gaze<S>,
        normal: &[N; 3],
        facing: S::M,
        is_plane: bool,
    ) -> Option<S::F> {
        let [x, y, height] = self.place(gaze, normal);
        let (zero, last) = (S::F::all(0.0), S::F::all((SIDE - 1) as f32));
        let outside = zero.gt(x) | x.gt(last) | zero.gt(y) | y.gt(last);
        let limit = S::F::all((SIDE - 2) as f32);
        let mut at = [x.max(zero).min(limit).truncated(), y.max(zero).min(limit).truncated()];
        let first = if is_plane {
            let mut lines = [WholeLine::ZERO; 2];
            at[0].store(&mut lines[0]);
            at[1].store(&mut lines[1]);
            let ranges = each!(k in 2 => Square::range_of_corners(&lines[k], (SIDE - 2) as i32));
            // All in the light?
            if !S::F::all(self.highest.within(ranges)).gt(height).any() {
                return None;
            }
            each!(k in 2 => ranges[k][0])
        } else {
            // Most of what is bent moves, and has something of its own behind it. Pixels that do not face the sun are looked up
            // where others are: they shall not make the window too small.
            let both = at[0] | at[1].shl::<16>();
            let least = both.or_where(facing, S::I::all(-1)).least_halves();
            let least = each!(k in 2 => i32::from(least[k]));
            at = each!(k in 2 => at[k].or_where(facing, S::I::all(least[k])));
            least
        };
        let [fx, fy] = each!(k in 2 => [x, y][k] - at[k].floats());
        let corner = each!(k in 2 => first[k].min((SIDE - 8) as i32));
        let within = each!(k in 2 => at[k] - S::I::all(corner[k]));
        let first = corner[1] as usize * SIDE + corner[0] as usize;
        let corners = match S::window(self.heights, first, SIDE, within) {
            Some(corners) => corners,
            None => {
                let mut place = WholeLine::ZERO;
                (at[1].shl::<9>() + at[0]).store(&mut place);
                let (a, b) = S::pairs(self.heights, &place);
                let (c, d) = S::pairs(&self.heights[SIDE..], &place);
                [a, b, c, d]
            }
        };
        let [a, b, c, d] = each!(k in 4 => {
            let shaded = corners[k].as_float_bits().gt(height);
            S::F::all(0.0).or_where(shaded, S::F::all(1.0))
        });
        let upper = (b - a).mul_add(fx, a);
        let lower = (d - c).mul_add(fx, c);
        Some(S::F::all(1.0).or_where(outside, (lower - upper).mul_add(fy, upper)))
    }
}

impl Shadow<'_> {
    /// Where on the map what is seen is looked up, in texels, and its height, given its unit normals.
    #[inline(always)]
    fn place<S: Simd, N: Per<S>>(&self, gaze: &Gaze<S>, normal: &[N; 3]) -> [S::F; 3] {
        let z = S::F::all(1.0) / gaze.depth;
        let [dx, dy] = gaze.d;
        each!(i in 3 => {
            let [a, b, c] = self.texel_from_view.linear[i];
            let along = dx.mul_add(S::F::all(a), dy.mul_add(S::F::all(b), S::F::all(c)));
            let aside = normal[0].mul_add(N::all(a), normal[1].mul_add(N::all(b), normal[2] * N::all(c)));
            let offset = aside.mul_add(N::all(OFF_SURFACE_M), N::all(self.texel_from_view.offset[i]));
            z.mul_add(along, offset.spread())
        })
    }
}

/// Where on a map a block of pixels is looked up, whatever its normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::render::cpu) struct Reach {
    /// First and last column, first and last row, in cells.
    ranges: [[u8; 2]; 2],
    /// Nothing that is lower shades it.
    lowest: f32,
}

impl Reach {
    /// Of what no shadow falls on.
    pub(in crate::render::cpu) const NONE: Self = Self { ranges: [[0; 2]; 2], lowest: f32::INFINITY };

    /// Widens it by what a block of pixels shows there where `seen`.
    #[inline(always)]
    pub(in crate::render::cpu) fn add<S: Simd>(&mut self, shadow: &Shadow<'_>, gaze: &Gaze<S>, seen: S::M) {
        // Normals are unit vectors, and something is left for rounding.
        const SLACK: f32 = OFF_SURFACE_M * TEXELS_PER_M + 0.1;
        const LAST: i32 = SIDE as i32 - 2;
        let mut lines = [Line::ZERO; 3];
        let place = shadow.place(gaze, &[0.0; 3]);
        for k in 0..3 {
            place[k].store(&mut lines[k]);
        }
        let [columns, rows, heights] = &lines;
        for lane in Lanes(seen.to_bits()) {
            let (at, height) = ([columns.0[lane], rows.0[lane]], heights.0[lane]);
            if at.iter().any(|x| !(-SLACK..SIDE as f32 + SLACK).contains(x)) {
                continue;
            }
            let is_first = self.lowest == f32::INFINITY;
            for (range, x) in self.ranges.iter_mut().zip(at) {
                let (first, last) = ((x - SLACK) as i32, (x + SLACK) as i32);
                // And its neighbour's.
                let (first, last) = (first.clamp(0, LAST), last.clamp(0, LAST) + 1);
                let (first, last) = ((first as usize / CELL) as u8, (last as usize / CELL) as u8);
                *range = if is_first { [first, last] } else { [range[0].min(first), range[1].max(last)] };
            }
            self.lowest = self.lowest.min(height - OFF_SURFACE_M - 0.001);
        }
    }

    /// Whether a shadow of something this high may fall on it.
    #[inline(always)]
    pub(in crate::render::cpu) fn is_touched(&self, highest: &Highest) -> bool {
        self.lowest < f32::INFINITY && highest.reaches_above(self.lowest, self.ranges)
    }
}
