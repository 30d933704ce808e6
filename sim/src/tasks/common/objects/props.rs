//! Visuals of household objects with rotational symmetry. Lengths in m.

use scene::{AppearanceSpec, VisualShape, VisualSpec};

/// Specular strength of shiny surfaces.
const GLOSS: f64 = 0.6;

pub(crate) const fn glossy(color: [f64; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: GLOSS, ..AppearanceSpec::plain(color) }
}

/// Builder of the visuals of an object with rotational symmetry about a vertical axis.
pub(crate) struct RevolvedVisuals {
    /// Position in the body's frame from which heights are measured.
    foot: [f64; 3],
    pub(crate) visuals: Vec<VisualSpec>,
}

impl RevolvedVisuals {
    pub(crate) fn on(foot: [f64; 3]) -> Self {
        Self { foot, visuals: Vec::new() }
    }

    /// Adds a surface of revolution with this profile, the outside to its right.
    pub(crate) fn with<const N: usize>(
        mut self,
        radii: [f64; N],
        heights: [f64; N],
        appearance: AppearanceSpec,
    ) -> Self {
        let profile = (0..N).map(|i| [radii[i], heights[i]]).collect();
        self.visuals.push(VisualSpec::at(VisualShape::Lathe { profile }, self.foot, appearance));
        self
    }

    /// Adds a cylinder between two heights.
    pub(crate) fn with_drum(self, radius: f64, [min, max]: [f64; 2], appearance: AppearanceSpec) -> Self {
        self.with([0.0, radius, radius, 0.0], [min, min, max, max], appearance)
    }
}

/// Distance by which a label protrudes in m, so that it covers what is below it.
pub(crate) const LABEL_THICKNESS: f64 = 0.0003;
