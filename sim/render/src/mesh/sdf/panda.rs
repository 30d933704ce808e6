//! Housings of the Panda arm, in link frames.
//!
//! They are blended tubes around the joint axes of the kinematic chain (d1 0.333, d3 0.316, a4 ±0.0825, d5
//! 0.384, a7 0.088, flange 0.107 m), with the sizes of the collision hulls (docs/benchmark.md, "Robot and
//! control") and sections measured on the benchmark's arm. Two neighbouring links each cover half of their
//! joint along its axis, as on the real arm, and meet without a gap.

use super::panda_trim;
use super::surface_nets;
use super::{CsgOp, SdfPrimitive, SignedDistanceField};
use crate::math::affine::Vec3;
use crate::mesh::Mesh;
use CsgOp::{Intersect, Subtract, Union};
use SdfPrimitive::{Frustum, RoundCone, RoundedBox, TaperedBox};

/// Side of a meshing cell of an arm link, in m: about 30 vertices around a tube.
const CELL_M: f32 = 0.0125;
/// Radius of the tubes around joints 1 to 5, in m.
const TUBE_RADIUS_M: f32 = 0.055;
/// Height of a link's dark panels above its housing, in m.
const TRIM_OFFSET_M: f32 = 0.0008;

/// A solid and the box that contains it.
struct Housing {
    ops: Vec<CsgOp>,
    min: Vec3,
    max: Vec3,
    cell_m: f32,
}

/// Returns the housing of link 0 to 7.
///
/// # Panics
/// If `link` is above 7.
pub(crate) fn link(link: usize) -> Mesh {
    let Housing { ops, min, max, cell_m } = housing(link);
    surface_nets::mesh(&SignedDistanceField(&ops), min, max, cell_m)
}

/// Returns the dark panels of a link that has some (3 to 7), which lie on its housing.
///
/// # Panics
/// If the link has none.
pub(crate) fn trim(link: usize) -> Mesh {
    let Housing { ops, min, max, cell_m } = housing(link);
    let region = panda_trim::region(link);
    surface_nets::sheet(&SignedDistanceField(&ops), (min, max, cell_m), TRIM_OFFSET_M, &region)
}

fn housing(link: usize) -> Housing {
    match link {
        0 => base(),
        1 => shoulder(0.205, |[x, y, z]| [x, y, z]),
        2 => shoulder(0.205, |[x, y, z]| [x, z, -y]),
        3 => elbow(0.125, |[x, y, z]| [x, y, z]),
        4 => elbow(0.127, |[x, y, z]| [x - 0.0825, -z, y]),
        5 => forearm(),
        6 => wrist(),
        7 => flange(),
        _ => panic!("a Panda has no link {link}"),
    }
}

fn cylinder(a: Vec3, b: Vec3, radius: f32, round: f32) -> SdfPrimitive {
    Frustum { a, b, radii: [radius; 2], round }
}

/// Half of a joint about an axis through `a`, which lies a little beyond the joint's middle, and a domed end
/// at `b`.
fn drum(a: Vec3, b: Vec3) -> [CsgOp; 2] {
    let at = |t: f32| core::array::from_fn(|i| a[i] + (b[i] - a[i]) * t);
    let dome = Frustum { a: at(0.45), b, radii: [TUBE_RADIUS_M + 0.0003, 0.042], round: 0.02 };
    [Union(cylinder(a, at(0.6), TUBE_RADIUS_M, 0.0), 0.0), Union(dome, 0.0)]
}

/// Returns the smallest box that contains two points.
fn bounds(a: Vec3, b: Vec3) -> (Vec3, Vec3) {
    (core::array::from_fn(|i| a[i].min(b[i])), core::array::from_fn(|i| a[i].max(b[i])))
}

fn base() -> Housing {
    let neck = Frustum { a: [0.0, 0.0, 0.0], b: [0.0, 0.0, 0.142], radii: [0.072, 0.0535], round: 0.006 };
    let back = RoundCone { a: [-0.082, 0.0, 0.045], b: [0.0, 0.0, 0.085], radii: [0.05, 0.052] };
    let body = RoundedBox { centre: [-0.055, 0.0, 0.035], half: [0.077, 0.074, 0.035], round: 0.014 };
    let plate = RoundedBox { centre: [-0.068, 0.0, 0.004], half: [0.084, 0.09, 0.006], round: 0.004 };
    Housing {
        ops: vec![Union(neck, 0.0), Union(back, 0.02), Union(body, 0.01), Union(plate, 0.004)],
        min: [-0.155, -0.1, 0.0],
        max: [0.075, 0.1, 0.142],
        cell_m: CELL_M,
    }
}

/// Returns the upper or lower part of the shoulder: a tube of the given length from joint 1 or 3 that bends
/// into half of joint 2. `map` leads to the link's frame from that of link 1, in which the tube points down
/// and the drum towards −y.
fn shoulder(length: f32, map: impl Fn(Vec3) -> Vec3) -> Housing {
    let [first, second] = drum(map([0.0, 0.004, 0.0]), map([0.0, -0.1294, 0.0]));
    let tube = cylinder(map([0.0, 0.0, -length]), map([0.0, 0.0, -0.02]), TUBE_RADIUS_M, 0.0);
    let recess = || Subtract(cylinder(map([0.0, 0.003, 0.0]), map([0.0, 0.2, 0.0]), 0.066, 0.0), 0.03);
    let fillet = Union(cylinder(map([0.0, 0.0, 0.0]), map([0.0, -0.1, 0.0]), TUBE_RADIUS_M, 0.01), 0.08);
    let slab = RoundedBox { centre: [0.0; 3], half: [TUBE_RADIUS_M, 1.0, 1.0], round: 0.0 };
    let (min, max) = bounds(map([-0.06, -0.13, -length]), map([0.06, 0.06, 0.06]));
    Housing {
        ops: vec![Union(tube, 0.0), recess(), fillet, first, second, recess(), Intersect(slab, 0.0)],
        min,
        max,
        cell_m: CELL_M,
    }
}

/// Returns the upper or lower part of the elbow: a tube of the given length from joint 3 or 5 and, beside it,
/// half of joint 4. `map` leads to the link's frame from that of link 3.
fn elbow(length: f32, map: impl Fn(Vec3) -> Vec3) -> Housing {
    let [first, second] = drum(map([0.0825, -0.004, 0.0]), map([0.0825, 0.111, 0.0]));
    let tube =
        Frustum { a: map([0.0, 0.0, -0.16]), b: map([0.0, 0.0, -0.003]), radii: [0.058, 0.048], round: 0.03 };
    let neck = RoundCone { a: map([0.0, 0.0, -0.065]), b: map([0.07, 0.035, -0.005]), radii: [0.048, 0.045] };
    let end = cylinder(map([0.0, 0.0, -0.3]), map([0.0, 0.0, -length]), 0.08, 0.0);
    let recess = cylinder(map([0.0825, -0.2, 0.0]), map([0.0825, -0.003, 0.0]), 0.0585, 0.0);
    let (min, max) = bounds(map([-0.06, -0.06, -length]), map([0.14, 0.115, 0.06]));
    Housing {
        ops: vec![
            Union(tube, 0.0),
            Subtract(end, 0.0),
            Union(neck, 0.02),
            first,
            second,
            Subtract(recess, 0.012),
        ],
        min,
        max,
        cell_m: CELL_M,
    }
}

/// Returns the forearm: from the elbow tube sideways and down to the drum of the wrist.
fn forearm() -> Housing {
    let tube = Frustum { a: [0.0, 0.0, -0.3], b: [0.0, 0.0, -0.19], radii: [0.056, 0.052], round: 0.025 };
    let end = cylinder([0.0, 0.0, -0.4], [0.0, 0.0, -0.266], 0.08, 0.0);
    let bend = RoundCone { a: [0.0, 0.003, -0.22], b: [0.0, 0.063, -0.168], radii: [0.052, 0.031] };
    // Two parallel cones give the bar between the joints its flat section.
    let bar =
        |x: f32| RoundCone { a: [x, 0.068, -0.16], b: [x * 1.2, 0.0955, -0.045], radii: [0.026, 0.019] };
    let drum = cylinder([0.0, 0.0158, 0.0], [0.0, 0.1, 0.0], 0.048, 0.0);
    let dome = Frustum { a: [0.0, 0.078, 0.0], b: [0.0, 0.13, 0.0], radii: [0.0515, 0.04], round: 0.02 };
    Housing {
        ops: vec![
            Union(tube, 0.0),
            Subtract(end, 0.0),
            Union(bend, 0.03),
            Union(bar(-0.01), 0.015),
            Union(bar(0.01), 0.015),
            Union(drum, 0.015),
            Union(dome, 0.01),
        ],
        min: [-0.06, -0.06, -0.27],
        max: [0.06, 0.135, 0.055],
        cell_m: CELL_M,
    }
}

/// Returns the drum on the wrist axis with the housing of joint 7 next to it.
fn wrist() -> Housing {
    let drum = cylinder([0.0, 0.0, -0.0152], [0.0, 0.0, 0.04], 0.048, 0.0);
    let cover = Frustum { a: [0.0, 0.0, 0.0], b: [0.0, 0.0, 0.056], radii: [0.049, 0.044], round: 0.018 };
    let lid = RoundedBox { centre: [0.027, 0.0, 0.02], half: [0.04, 0.037, 0.036], round: 0.022 };
    let joint =
        Frustum { a: [0.088, -0.06, 0.0], b: [0.088, 0.0815, 0.0], radii: [0.0445, 0.041], round: 0.012 };
    let neck = RoundCone { a: [0.012, 0.0, 0.018], b: [0.085, 0.012, 0.0], radii: [0.036, 0.04] };
    let end = cylinder([0.088, -0.2, 0.0], [0.088, -0.0515, 0.0], 0.08, 0.0);
    Housing {
        ops: vec![
            Union(drum, 0.0),
            Union(cover, 0.0),
            Union(lid, 0.01),
            Union(joint, 0.0),
            Union(neck, 0.015),
            Subtract(end, 0.0),
        ],
        min: [-0.055, -0.06, -0.05],
        max: [0.14, 0.085, 0.06],
        cell_m: 0.008,
    }
}

/// Returns the flange and, on the diagonal, the grip with the pilot buttons.
fn flange() -> Housing {
    let body = cylinder([0.0, 0.0, 0.05], [0.0, 0.0, 0.0985], 0.044, 0.003);
    let disc = cylinder([0.0, 0.0, 0.08], [0.0, 0.0, 0.108], 0.032, 0.0);
    let grip = cylinder([0.04, 0.04, 0.064], [0.04, 0.04, 0.097], 0.03, 0.008);
    let tip = cylinder([0.053, 0.053, 0.072], [0.053, 0.053, 0.097], 0.026, 0.008);
    Housing {
        ops: vec![Union(body, 0.0), Union(disc, 0.0), Union(grip, 0.01), Union(tip, 0.005)],
        min: [-0.05, -0.05, 0.05],
        max: [0.082, 0.082, 0.108],
        cell_m: 0.008,
    }
}

/// Returns the hand, which tapers towards the fingers.
pub(crate) fn hand() -> Mesh {
    let body = TaperedBox {
        centre: [0.0, 0.0, 0.029],
        half: [0.0235, 0.101, 0.037],
        upper_half_x: 0.0187,
        round: 0.012,
    };
    let flange = cylinder([0.0, 0.0, -0.002], [0.0, 0.0, 0.008], 0.0315, 0.003);
    let ops = [Union(body, 0.0), Union(flange, 0.0)];
    surface_nets::mesh(&SignedDistanceField(&ops), [-0.035, -0.105, -0.01], [0.035, 0.105, 0.066], 0.008)
}
