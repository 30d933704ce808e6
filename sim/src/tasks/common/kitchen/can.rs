//! The soda can of PickSodaFromCabinet. Lengths in m. Its axis is z and its origin the middle of its mesh; in
//! the benchmark the same axis is y.

use crate::tasks::common::objects::props::{LABEL_THICKNESS, RevolvedVisuals, glossy};
use crate::tasks::common::srgb;
use scene::{AppearanceSpec, Mass, PartSpec, Primitive, Texture, VisualSpec};

/// Half of the height as it collides.
pub(crate) const HALF_HEIGHT: f64 = 0.0641;
/// Radius of the body as it collides.
const RADIUS: f64 = 0.0385;
/// Mass properties of the benchmark's collision hulls.
pub(crate) const MASS: Mass =
    Mass::Measured { kg: 0.541, centre: [0.0, 0.0, -0.0008], inertia: [8.2e-4, 8.2e-4, 4.0e-4] };

/// Creates the collision shapes: a body that tapers to a foot below and to a neck above.
pub(crate) fn parts() -> Vec<PartSpec> {
    let appearance = AppearanceSpec::plain([1.0; 3]);
    let cylinder = |radius, [min_z, max_z]: [f64; 2]| {
        let shape = Primitive::Cylinder { radius, half_height: (max_z - min_z) / 2.0 };
        PartSpec::at(shape, [0.0, 0.0, f64::midpoint(min_z, max_z)], appearance)
    };
    let frustum = |circles| PartSpec::at(Primitive::frustum(circles), [0.0; 3], appearance);
    vec![
        // The foot is a cylinder because a hull with as many corners creeps on the shelf.
        cylinder(0.030, [-HALF_HEIGHT, -0.060]),
        frustum([[0.034, -0.060], [RADIUS, -0.053]]),
        cylinder(RADIUS, [-0.053, 0.04]),
        frustum([[RADIUS, 0.04], [0.0326, 0.055]]),
        cylinder(0.0326, [0.055, HALF_HEIGHT]),
    ]
}

/// Radius of the body as seen.
const VISIBLE_RADIUS: f64 = 0.0375;

/// Creates the visuals: red with a white band. Foot, shoulder, rim and the sunken lid are aluminium.
pub(crate) fn visuals() -> Vec<VisualSpec> {
    let aluminium =
        AppearanceSpec { specular: 0.8, ..AppearanceSpec::textured(Texture::BrushedMetal, srgb([204; 3])) };
    let r = VISIBLE_RADIUS;
    let radii =
        [0.0, 0.024, 0.025, 0.029, 0.033, r, r, 0.0343, 0.0316, 0.0311, 0.0316, 0.0316, 0.03, 0.029, 0.0];
    let heights = [
        -0.054, -0.061, -0.0632, -0.0632, -0.0595, -0.0535, 0.04, 0.0495, 0.0545, 0.0575, 0.0595, 0.0632,
        0.0632, 0.0592, 0.0592,
    ];
    RevolvedVisuals::on([0.0; 3])
        .with(radii, heights, aluminium)
        .with_drum(r + LABEL_THICKNESS, [-0.0525, 0.04], glossy(srgb([184, 10, 18])))
        .with_drum(r + 2.0 * LABEL_THICKNESS, [-0.013, 0.013], glossy(srgb([235; 3])))
        .visuals
}
