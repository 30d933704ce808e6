//! A tomato and an apple: a solid of revolution and a sphere for collision, with detailed visuals. See
//! docs/benchmark.md, "Scenes and objects".

use core::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::tasks::common::{movable, srgb};
use scene::distractors::apple_profile;
use scene::{
    AppearanceSpec, BodySpec, Mass, PartSpec, Primitive, RenderParts, ScaleAxes, VisualShape, VisualSpec,
};

/// Radius of the apple, in m: half the mean of its width and height.
pub(crate) const APPLE_RADIUS: f64 = 0.037;
/// Radius and half of the height of the apple's base, in m.
const APPLE_BASE: [f64; 2] = [0.012, 0.002];

/// Radii of the tomato at heights along its axis, each given as (radius, height), in m. The rings are close
/// enough together for it to roll onto its flat pole, as the benchmark's does.
const TOMATO_PROFILE: [[f64; 2]; 19] = [
    [0.0212, -0.0004],
    [0.0253, 0.002],
    [0.0295, 0.005],
    [0.0320, 0.008],
    [0.0337, 0.011],
    [0.0350, 0.014],
    [0.0361, 0.017],
    [0.0369, 0.02],
    [0.0375, 0.023],
    [0.0380, 0.026],
    [0.0383, 0.029],
    [0.0382, 0.032],
    [0.0376, 0.035],
    [0.0366, 0.038],
    [0.0349, 0.042],
    [0.0321, 0.047],
    [0.0281, 0.052],
    [0.0216, 0.056],
    [0.0080, 0.061],
];

/// Creates a red tomato with a green calyx. Its axis is the y axis of its frame, which is horizontal at the
/// start; the origin is the flat pole, opposite the calyx.
pub(crate) fn tomato(region: usize, surface_z_m: f64) -> BodySpec {
    /// Outline of the calyx, in m.
    const CALYX: [[f64; 2]; 10] = [
        [0.02, 0.0],
        [0.0049, 0.0035],
        [0.0062, 0.019],
        [-0.0019, 0.0057],
        [-0.0162, 0.0118],
        [-0.006, 0.0],
        [-0.0162, -0.0118],
        [-0.0019, -0.0057],
        [0.0062, -0.019],
        [0.0049, -0.0035],
    ];
    let (skin, green) = (skin_appearance([200, 34, 24]), AppearanceSpec::plain(srgb([62, 112, 36])));
    let z_to_y = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -FRAC_PI_2);
    let at = |y: f64| Isometry3::from_parts(Translation3::new(0.0, y, 0.0), z_to_y);
    let visual = |shape, y, appearance| VisualSpec { shape, pose: at(y), appearance };
    let [_, inner @ .., _] = TOMATO_PROFILE;
    let profile = [[0.0, 0.003], [0.012, 0.0002], [0.0205, 0.0006]].into_iter();
    let profile = profile.chain(inner).chain([[0.013, 0.0595], [0.0, 0.0585]]).collect();
    let calyx = VisualShape::Extrusion { outline: CALYX.to_vec(), holes: Vec::new(), half_height: 0.0015 };
    let body = Primitive::revolution(&TOMATO_PROFILE);
    BodySpec {
        visuals: vec![
            visual(VisualShape::Lathe { profile }, 0.0, skin),
            visual(calyx, 0.0595, green),
            visual(stem(), 0.061, green),
        ],
        scale_axes: ScaleAxes::Independent,
        mass: Mass::Measured { kg: 0.202, centre: [0.0005, 0.0283, 0.0], inertia: [1.1e-4, 1.2e-4, 1.1e-4] },
        ..movable(
            "tomato",
            vec![PartSpec { shape: body, pose: at(0.0), appearance: skin }],
            region,
            surface_z_m,
        )
    }
}

/// Creates a red apple with its stem. Its origin is its centre. It collides as a sphere with a flat base, on
/// which it stands.
pub(crate) fn apple(region: usize, surface_z_m: f64) -> BodySpec {
    let skin = skin_appearance([190, 28, 32]);
    let profile = apple_profile().iter().map(|point| point.map(|x| x * APPLE_RADIUS)).collect();
    let [radius, half_height] = APPLE_BASE;
    let parts = vec![
        PartSpec::at(Primitive::Ball { radius: APPLE_RADIUS }, [0.0; 3], skin),
        PartSpec::at(
            Primitive::Cylinder { radius, half_height },
            [0.0, 0.0, half_height - APPLE_RADIUS],
            skin,
        ),
    ];
    BodySpec {
        visuals: vec![
            VisualSpec::at(VisualShape::Lathe { profile }, [0.0; 3], skin),
            VisualSpec::at(stem(), [0.0, 0.0, 0.9 * APPLE_RADIUS], AppearanceSpec::plain(srgb([84, 58, 34]))),
        ],
        render_parts: RenderParts::Single,
        ..movable("apple", parts, region, surface_z_m).with_origin_z(surface_z_m + APPLE_RADIUS)
    }
}

fn skin_appearance(color: [u8; 3]) -> AppearanceSpec {
    AppearanceSpec { specular: 0.4, ..AppearanceSpec::plain(srgb(color)) }
}

fn stem() -> VisualShape {
    VisualShape::Primitive(Primitive::Capsule { radius: 0.0025, half_height: 0.007 })
}
