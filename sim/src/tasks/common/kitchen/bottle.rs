//! The bottle of DualArmBottleHandover. Its axis is the y axis of its frame, and its base is 40 mm below the
//! origin. See docs/benchmark.md, "Objects".

use core::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::tasks::common::{BIMANUAL_TABLE_Z, box_part, movable, srgb};
use scene::{
    AppearanceSpec, BodySpec, Mass, PartSpec, Primitive, RenderParts, ScaleAxes, VisualShape, VisualSpec,
};

/// Largest radius of the bottle, in m.
pub(crate) const BOTTLE_RADIUS: f64 = 0.0352;
/// Circles (radius, y) of the bottle's body from its base to its shoulder, in m.
const BODY: [[f64; 2]; 6] =
    [[0.0265, -0.038], [0.0308, -0.03], [BOTTLE_RADIUS, 0.0], [0.0343, 0.13], [0.0304, 0.15], [0.0213, 0.17]];
/// Circles (radius, y) of the neck and its cap, in m.
const NECK: [[f64; 2]; 4] = [[0.0182, 0.17], [0.0182, 0.205], [0.0152, 0.21], [0.0145, 0.2124]];
/// Half-extents of the box on whose lower face, at `BASE_Y`, the bottle stands, in m. A polygonal hull would
/// creep on the table.
const FOOT: [f64; 3] = [0.0187, 0.005, 0.0187];
/// y of the bottle's base, in m.
const BASE_Y: f64 = -0.0401;
/// y of the lower edge of the screw cap, in m.
const CAP_Y: f64 = 0.187;
/// Angle by which the collision shapes are turned about the axis, so that a facet of their outline, which has
/// 24 sides, faces each pad of a hand that closes along x or z. Pads on an edge would let the bottle tilt.
const FACET_TURN: f64 = PI / 24.0;

/// Creates the bottle, standing upright.
pub(crate) fn bottle(region: usize) -> BodySpec {
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    let frame = Isometry3::from_parts(Translation3::identity(), upright.inverse());
    let facets = frame * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FACET_TURN);
    let part = |circles: &[[f64; 2]]| PartSpec {
        shape: Primitive::revolution(circles),
        pose: facets,
        appearance: AppearanceSpec::plain([1.0; 3]),
    };
    let foot = box_part(FOOT, [0.0, BASE_Y + FOOT[1], 0.0], AppearanceSpec::plain([1.0; 3]));
    let bottle = movable("bottle", vec![foot, part(&BODY), part(&NECK)], region, BIMANUAL_TABLE_Z);
    BodySpec {
        visuals: visuals().into_iter().map(|visual| VisualSpec { pose: frame, ..visual }).collect(),
        render_parts: RenderParts::Single,
        scale_axes: ScaleAxes::Independent,
        mass: Mass::Measured { kg: 0.774, centre: [0.0, 0.0691, 0.0], inertia: [3.3e-3, 4.2e-4, 3.3e-3] },
        ..bottle.with_orientation(upright)
    }
}

/// Creates the visuals about the z axis: a body with three grooves, a label and a screw cap.
fn visuals() -> [VisualSpec; 3] {
    /// Distance by which the label protrudes in m, so that it covers what is below it.
    const LABEL_THICKNESS: f64 = 0.0003;
    /// y of the grooves in m, and their depth and half of their height in m.
    const GROOVES: ([f64; 3], [f64; 2]) = ([0.01, 0.03, 0.118], [0.0015, 0.004]);
    let lathe = |profile: Vec<[f64; 2]>, appearance| {
        VisualSpec::at(VisualShape::Lathe { profile }, [0.0; 3], appearance)
    };
    let glossy = |color| AppearanceSpec { specular: 0.6, ..AppearanceSpec::plain(color) };
    let (grooves, [depth, half]) = GROOVES;
    let wall = |y: f64| 0.0344 + (BOTTLE_RADIUS - 0.0344) * (1.0 - y / 0.05).clamp(0.0, 1.0);
    let mut body =
        vec![[0.0, -0.0395], [0.022, -0.0395], [0.0265, -0.038], [0.0308, -0.03], [BOTTLE_RADIUS, 0.0]];
    body.extend(
        grooves.iter().flat_map(|&y| [[wall(y), y - half], [wall(y) - depth, y], [wall(y), y + half]]),
    );
    body.extend([[0.0343, 0.13], [0.033, 0.14], [0.0304, 0.15], [0.0265, 0.16], [0.0213, 0.17]]);
    body.extend([[0.0165, 0.18], [0.0165, CAP_Y], [0.0, CAP_Y]]);
    let [_, [cap, edge], [top, top_y], _] = NECK;
    let label = wall(0.05) + LABEL_THICKNESS;
    [
        lathe(body, glossy(srgb([158, 209, 230]))),
        lathe(
            vec![[0.0, 0.042], [label, 0.042], [label, 0.106], [0.0, 0.106]],
            AppearanceSpec::plain(srgb([31, 82, 168])),
        ),
        lathe(
            vec![[0.0, CAP_Y], [cap, CAP_Y], [cap, edge], [top, top_y], [0.0, top_y]],
            glossy(srgb([219, 224, 230])),
        ),
    ]
}
