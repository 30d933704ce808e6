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
const TOMATO_PROFILE: [[f64; 2]; 30] = [
    [0.02120, -0.0004],
    [0.02530, 0.0020],
    [0.02750, 0.0035],
    [0.02950, 0.0050],
    [0.03090, 0.0065],
    [0.03200, 0.0080],
    [0.03290, 0.0095],
    [0.03370, 0.0110],
    [0.03440, 0.0125],
    [0.03500, 0.0140],
    [0.03560, 0.0155],
    [0.03610, 0.0170],
    [0.03650, 0.0185],
    [0.03690, 0.0200],
    [0.03720, 0.0215],
    [0.03750, 0.0230],
    [0.03777, 0.0245],
    [0.03800, 0.0260],
    [0.03819, 0.0275],
    [0.03830, 0.0290],
    [0.03831, 0.0305],
    [0.03820, 0.0320],
    [0.03796, 0.0335],
    [0.03760, 0.0350],
    [0.03660, 0.0380],
    [0.03490, 0.0420],
    [0.03210, 0.0470],
    [0.02810, 0.0520],
    [0.02160, 0.0560],
    [0.00800, 0.0610],
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
