//! Household objects with rotational symmetry: their common visuals, and a bottle. Lengths in m.

use core::f64::consts::{FRAC_PI_4, SQRT_2};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::scene::{AppearanceSpec, PartSpec, Primitive, VisualShape, VisualSpec};

/// Specular strength of shiny surfaces.
const GLOSS: f64 = 0.6;

pub(super) const fn glossy(color: [f64; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: GLOSS, ..AppearanceSpec::plain(color) }
}

/// Builder of the visuals of an object with rotational symmetry about a vertical axis.
pub(super) struct RevolvedVisuals {
    /// Position in the body's frame from which heights are measured.
    foot: [f64; 3],
    pub(super) visuals: Vec<VisualSpec>,
}

impl RevolvedVisuals {
    pub(super) fn on(foot: [f64; 3]) -> Self {
        Self { foot, visuals: Vec::new() }
    }

    /// Adds a surface of revolution with this profile, the outside to its right.
    pub(super) fn with<const N: usize>(
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
    pub(super) fn with_drum(self, radius: f64, [min, max]: [f64; 2], appearance: AppearanceSpec) -> Self {
        self.with([0.0, radius, radius, 0.0], [min, min, max, max], appearance)
    }
}

/// Distance by which a label protrudes in m, so that it covers what is below it.
pub(super) const LABEL_THICKNESS: f64 = 0.0003;

/// Radius and upper z of a bottle's body, shoulder, and neck with its cap.
const BOTTLE: [[f64; 2]; 3] = [[0.03, 0.175], [0.022, 0.213], [0.0155, 0.25]];
/// Sum of the volumes of the boxes of a bottle's prism relative to their union. The density of a bottle must
/// be divided by it.
pub(in crate::tasks) const PRISM_OVERLAP: f64 = 2.0;

/// Creates the collision shapes of a bottle standing at the given position. Its body is an octagonal prism
/// made of four boxes: finger pads touch a cylinder along two lines only, and it rotates between them when it
/// is carried fast.
pub(in crate::tasks) fn bottle_parts([x, y, z]: [f64; 3]) -> Vec<PartSpec> {
    let [[radius, body_z], [shoulder_radius, shoulder_z], [neck_radius, neck_z]] = BOTTLE;
    let appearance = AppearanceSpec::plain([1.0; 3]);
    // tan 22.5° = √2 − 1.
    let half = [radius, radius * (SQRT_2 - 1.0), body_z / 2.0];
    let side = |eighths: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), eighths * FRAC_PI_4);
        let pose = Isometry3::from_parts(Translation3::new(x, y, z + body_z / 2.0), turn);
        PartSpec { shape: Primitive::Box { half }, pose, appearance }
    };
    let cylinder = |radius, [min_z, max_z]: [f64; 2]| {
        let solid = Primitive::Cylinder { radius, half_height: (max_z - min_z) / 2.0 };
        PartSpec::at(solid, [x, y, z + (max_z + min_z) / 2.0], appearance)
    };
    let upper =
        [cylinder(shoulder_radius, [body_z, shoulder_z]), cylinder(neck_radius, [shoulder_z, neck_z])];
    [0.0, 1.0, 2.0, 3.0].map(side).into_iter().chain(upper).collect()
}

/// Creates the visuals of a bottle standing on `foot`: a grooved body, a label and a screw cap.
pub(in crate::tasks) fn bottle(foot: [f64; 3]) -> Vec<VisualSpec> {
    let radii = [
        0.0, 0.026, 0.029, 0.03, 0.03, 0.0285, 0.03, 0.03, 0.0285, 0.03, 0.03, 0.0285, 0.025, 0.018, 0.0135,
        0.0135, 0.0,
    ];
    let heights = [
        0.0, 0.0, 0.002, 0.006, 0.026, 0.03, 0.034, 0.064, 0.068, 0.072, 0.175, 0.189, 0.203, 0.217, 0.225,
        0.232, 0.232,
    ];
    let [[body_radius, _], _, [cap_radius, top]] = BOTTLE;
    let cap_radii = [0.0, cap_radius, cap_radius, cap_radius - 0.001, 0.0];
    RevolvedVisuals::on(foot)
        .with(radii, heights, glossy([0.62, 0.82, 0.90]))
        .with_drum(body_radius + LABEL_THICKNESS, [0.09, 0.16], AppearanceSpec::plain([0.12, 0.32, 0.66]))
        .with(cap_radii, [0.232, 0.232, top - 0.001, top, top], glossy([0.86, 0.88, 0.90]))
        .visuals
}
