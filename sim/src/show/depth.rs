//! Depths as colours. Equal ratios of depth are equal steps along the ramp, so that what a hand holds and what stands at
//! the table's end both keep their shapes.

use std::fmt;

/// Colours from far to near: viridis, whose lightness grows evenly (van der Walt and Smith, "A Better Default Colormap
/// for Matplotlib", SciPy 2015), at nine even steps.
const RAMP: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];
/// Colours that are used of the ramp: so many that a frame of a GIF holds them all, with black and the margins' grey.
const N_COLORS: f32 = 241.0;

/// Depths, in m, that are told apart: a held thing is no nearer to the hand camera, a table no farther from any.
const LIMITS_M: [f32; 2] = [0.05, 4.0];

/// Depths that the ramp stands for: those in sight, within 0.05 and 4 m. What is nearer or farther takes an end's colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthRange {
    /// Drawn brightest, in m.
    pub least_m: f32,
    /// Drawn darkest, in m.
    pub greatest_m: f32,
}

impl DepthRange {
    /// Of nothing.
    pub(super) const EMPTY: Self = Self { least_m: f32::INFINITY, greatest_m: 0.0 };

    /// Takes in those of these depths that are finite, each as the nearest one within the limits.
    pub(super) fn widen(&mut self, depths_m: &[f32]) {
        for &depth_m in depths_m.iter().filter(|depth_m| depth_m.is_finite()) {
            let depth_m = depth_m.clamp(LIMITS_M[0], LIMITS_M[1]);
            self.least_m = self.least_m.min(depth_m);
            self.greatest_m = self.greatest_m.max(depth_m);
        }
    }

    /// sRGB of a depth; black for an infinite one.
    pub(super) fn color_of(&self, depth_m: f32) -> [u8; 3] {
        if depth_m.is_infinite() {
            return [0; 3];
        }
        let all = libm::logf(self.greatest_m / self.least_m).max(f32::EPSILON);
        let nearness = (libm::logf(self.greatest_m / depth_m) / all).clamp(0.0, 1.0);
        let even = (nearness * (N_COLORS - 1.0)).round() / (N_COLORS - 1.0) * (RAMP.len() - 1) as f32;
        let step = (even as usize).min(RAMP.len() - 2);
        let (from, to, share) = (RAMP[step], RAMP[step + 1], even - step as f32);
        core::array::from_fn(|c| {
            (f32::from(from[c]) * (1.0 - share) + f32::from(to[c]) * share).round() as u8
        })
    }
}

impl fmt::Display for DepthRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3}..{:.3} m", self.least_m, self.greatest_m)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn nearer_is_brighter_and_nothing_is_black() {
        let mut range = DepthRange::EMPTY;
        range.widen(&[0.5, f32::INFINITY, 8.0]);
        assert_eq!(range.to_string(), "0.500..4.000 m");
        assert_eq!(range.color_of(f32::INFINITY), [0; 3]);
        let shown = [0.01, 0.5, 2.0_f32.sqrt(), 4.0, 20.0].map(|depth_m| range.color_of(depth_m));
        assert_eq!(shown, [8, 8, 4, 0, 0].map(|step| RAMP[step]));
        let lightness = |depth_m| {
            let [r, g, b] = range.color_of(depth_m).map(f32::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        let depths: Vec<f32> = (0..=750).map(|i| 0.5 + 0.01 * i as f32).collect();
        assert!(depths.windows(2).all(|pair| lightness(pair[0]) >= lightness(pair[1])));
        let colors: BTreeSet<[u8; 3]> = depths.iter().map(|depth_m| range.color_of(*depth_m)).collect();
        assert!((100..=N_COLORS as usize).contains(&colors.len()), "{} colours", colors.len());
    }
}
