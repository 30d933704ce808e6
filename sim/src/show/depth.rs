//! Depth colour map. The mapping is logarithmic: equal ratios of depth are equal steps of colour, which keeps
//! the shape of both a held object and one at the far end of the table visible.

use std::fmt;

/// Colours from far to near: nine equidistant samples of viridis, whose lightness increases uniformly (van
/// der Walt and Smith, "A Better Default Colormap for Matplotlib", SciPy 2015).
const VIRIDIS: [[u8; 3]; 9] = [
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
/// Number of colours that the map is quantised to. Together with black and the grey of the margins they fit
/// into the palette of a GIF frame.
const N_COLORS: f32 = 241.0;

/// Depths in m at which the range is clamped: a held object is not nearer to the hand camera, and no camera
/// is farther from the table.
const LIMITS_M: [f32; 2] = [0.05, 4.0];

/// Range of depths that the colour map covers: all visible depths, clamped to 0.05 m and 4 m. Depths outside
/// of the range take the colour of its nearer end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthRange {
    /// Smallest depth in m, shown brightest.
    pub min_m: f32,
    /// Largest depth in m, shown darkest.
    pub max_m: f32,
}

impl DepthRange {
    /// The range of an empty set of depths.
    pub(crate) const EMPTY: Self = Self { min_m: f32::INFINITY, max_m: 0.0 };

    /// Extends the range by all finite depths, each clamped to [`LIMITS_M`].
    pub(crate) fn extend(&mut self, depths_m: &[f32]) {
        for &depth_m in depths_m.iter().filter(|depth_m| depth_m.is_finite()) {
            let depth_m = depth_m.clamp(LIMITS_M[0], LIMITS_M[1]);
            self.min_m = self.min_m.min(depth_m);
            self.max_m = self.max_m.max(depth_m);
        }
    }

    /// Returns the sRGB colour of a depth; infinite depths are black.
    pub(crate) fn color_of(&self, depth_m: f32) -> [u8; 3] {
        if depth_m.is_infinite() {
            return [0; 3];
        }
        let log_ratio = libm::logf(self.max_m / self.min_m).max(f32::EPSILON);
        let nearness = (libm::logf(self.max_m / depth_m) / log_ratio).clamp(0.0, 1.0);
        let position = (nearness * (N_COLORS - 1.0)).round() / (N_COLORS - 1.0) * (VIRIDIS.len() - 1) as f32;
        let step = (position as usize).min(VIRIDIS.len() - 2);
        let (from, to, weight) = (VIRIDIS[step], VIRIDIS[step + 1], position - step as f32);
        core::array::from_fn(|c| {
            (f32::from(from[c]) * (1.0 - weight) + f32::from(to[c]) * weight).round() as u8
        })
    }
}

impl fmt::Display for DepthRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3}..{:.3} m", self.min_m, self.max_m)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn nearer_depths_are_brighter_and_infinity_is_black() {
        let mut range = DepthRange::EMPTY;
        range.extend(&[0.5, f32::INFINITY, 8.0]);
        assert_eq!(range.to_string(), "0.500..4.000 m");
        assert_eq!(range.color_of(f32::INFINITY), [0; 3]);
        let shown = [0.01, 0.5, 2.0_f32.sqrt(), 4.0, 20.0].map(|depth_m| range.color_of(depth_m));
        assert_eq!(shown, [8, 8, 4, 0, 0].map(|step| VIRIDIS[step]));
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
