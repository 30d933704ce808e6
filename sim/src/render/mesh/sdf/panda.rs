//! Housings of the Panda arm, in link frames.
//!
//! They are blended tubes around the joint axes of the kinematic chain (d1 0.333, d3 0.316, a4 ±0.0825, d5
//! 0.384, a7 0.088, flange 0.107 m), with the sizes of the collision hulls (docs/benchmark.md, "Robot and
//! control"). Two neighbouring links each cover half of their joint along its axis, as on the real arm.

use super::surface_nets;
use super::{CsgOp, SdfPrimitive, SignedDistanceField};
use crate::render::math::affine::Vec3;
use crate::render::mesh::Mesh;
use CsgOp::{Subtract, Union};

/// Side of a meshing cell of an arm link, in m: about 30 vertices around a tube.
const CELL_M: f32 = 0.0125;
/// Radius of the tubes around joints 1 to 5, in m.
const TUBE_RADIUS_M: f32 = 0.055;
/// Radius of the recess that a link leaves for the next link's half of their joint, in m.
const RECESS_RADIUS_M: f32 = 0.0585;

/// Returns the housing of link 0 to 7.
///
/// # Panics
/// If `link` is above 7.
pub(in crate::render::mesh) fn link(link: usize) -> Mesh {
    match link {
        0 => base(),
        1 => shoulder_lower(),
        2 => shoulder_upper(),
        3 => elbow_upper(),
        4 => elbow_lower(),
        5 => forearm(),
        6 => wrist(),
        7 => flange(),
        _ => panic!("a Panda has no link {link}"),
    }
}

fn tube(a: Vec3, b: Vec3) -> SdfPrimitive {
    SdfPrimitive::Frustum { a, b, radii: [TUBE_RADIUS_M; 2], round: 0.012 }
}

fn recess(a: Vec3, b: Vec3) -> CsgOp {
    Subtract(SdfPrimitive::Frustum { a, b, radii: [RECESS_RADIUS_M; 2], round: 0.0 }, 0.016)
}

fn base() -> Mesh {
    let ops = [
        Union(
            SdfPrimitive::Frustum {
                a: [0.0, 0.0, 0.0],
                b: [0.0, 0.0, 0.139],
                radii: [0.088, 0.058],
                round: 0.01,
            },
            0.0,
        ),
        Union(
            SdfPrimitive::RoundedBox {
                centre: [-0.07, 0.0, 0.022],
                half: [0.066, 0.094, 0.022],
                round: 0.012,
            },
            0.03,
        ),
        Union(
            SdfPrimitive::Frustum {
                a: [-0.132, 0.0, 0.055],
                b: [0.0, 0.0, 0.085],
                radii: [0.042, 0.05],
                round: 0.014,
            },
            0.03,
        ),
    ];
    surface_nets::mesh(&SignedDistanceField(&ops), [-0.14, -0.1, 0.0], [0.09, 0.1, 0.14], CELL_M)
}

fn shoulder_lower() -> Mesh {
    let ops = [
        Union(tube([0.0, 0.0, -0.186], [0.0, 0.0, -0.01]), 0.0),
        recess([0.0, 0.006, 0.0], [0.0, 0.2, 0.0]),
        Union(tube([0.0, -0.129, 0.0], [0.0, -0.006, 0.0]), 0.03),
        recess([0.0, 0.006, 0.0], [0.0, 0.2, 0.0]),
    ];
    surface_nets::mesh(&SignedDistanceField(&ops), [-0.06, -0.13, -0.19], [0.06, 0.06, 0.06], CELL_M)
}

fn shoulder_upper() -> Mesh {
    let ops = [
        Union(tube([0.0, -0.188, 0.0], [0.0, -0.01, 0.0]), 0.0),
        recess([0.0, 0.0, -0.2], [0.0, 0.0, -0.006]),
        Union(tube([0.0, 0.0, 0.006], [0.0, 0.0, 0.129]), 0.03),
        recess([0.0, 0.0, -0.2], [0.0, 0.0, -0.006]),
    ];
    surface_nets::mesh(&SignedDistanceField(&ops), [-0.06, -0.19, -0.06], [0.06, 0.06, 0.13], CELL_M)
}

fn elbow_upper() -> Mesh {
    let ops = [
        Union(tube([0.0, 0.0, -0.115], [0.0, 0.0, -0.045]), 0.0),
        Union(
            SdfPrimitive::RoundCone { a: [0.0, 0.0, -0.07], b: [0.07, 0.035, -0.005], radii: [0.053, 0.05] },
            0.02,
        ),
        Union(tube([0.0825, 0.006, 0.0], [0.0825, 0.111, 0.0]), 0.03),
        recess([0.0825, -0.2, 0.0], [0.0825, -0.006, 0.0]),
    ];
    surface_nets::mesh(&SignedDistanceField(&ops), [-0.06, -0.06, -0.12], [0.14, 0.115, 0.06], CELL_M)
}

fn elbow_lower() -> Mesh {
    let ops = [
        Union(tube([-0.0825, 0.05, 0.0], [-0.0825, 0.118, 0.0]), 0.0),
        Union(
            SdfPrimitive::RoundCone {
                a: [-0.0825, 0.07, 0.0],
                b: [-0.0125, 0.005, 0.035],
                radii: [0.053, 0.05],
            },
            0.02,
        ),
        Union(tube([0.0, 0.0, 0.006], [0.0, 0.0, 0.111]), 0.03),
        recess([0.0, 0.0, -0.2], [0.0, 0.0, -0.006]),
    ];
    surface_nets::mesh(&SignedDistanceField(&ops), [-0.14, -0.06, -0.06], [0.06, 0.124, 0.115], CELL_M)
}

/// Returns the forearm: from the elbow tube sideways and down to the fork that holds the wrist.
fn forearm() -> Mesh {
    let ops = [
        Union(tube([0.0, 0.0, -0.259], [0.0, 0.0, -0.185]), 0.0),
        Union(
            SdfPrimitive::RoundCone { a: [0.0, 0.0, -0.21], b: [0.0, 0.07, -0.09], radii: [0.053, 0.047] },
            0.03,
        ),
        Union(
            SdfPrimitive::RoundCone { a: [0.0, 0.07, -0.09], b: [0.0, 0.083, 0.0], radii: [0.047, 0.045] },
            0.02,
        ),
        Union(
            SdfPrimitive::Frustum {
                a: [0.0, 0.056, 0.0],
                b: [0.0, 0.13, 0.0],
                radii: [0.052; 2],
                round: 0.012,
            },
            0.01,
        ),
        Subtract(
            SdfPrimitive::Frustum {
                a: [0.0, -0.2, 0.0],
                b: [0.0, 0.0545, 0.0],
                radii: [0.057; 2],
                round: 0.0,
            },
            0.008,
        ),
    ];
    surface_nets::mesh(&SignedDistanceField(&ops), [-0.06, -0.06, -0.265], [0.06, 0.135, 0.055], CELL_M)
}

/// Returns the drum on the wrist axis with the housing of joint 7 next to it.
fn wrist() -> Mesh {
    let ops = [
        Union(
            SdfPrimitive::Frustum {
                a: [0.0, 0.0, -0.051],
                b: [0.0, 0.0, 0.051],
                radii: [0.05; 2],
                round: 0.012,
            },
            0.0,
        ),
        Union(
            SdfPrimitive::Frustum {
                a: [0.088, -0.047, 0.0],
                b: [0.088, 0.072, 0.0],
                radii: [0.046, 0.044],
                round: 0.016,
            },
            0.0,
        ),
        Union(
            SdfPrimitive::RoundCone { a: [0.01, 0.0, 0.0], b: [0.085, 0.014, 0.0], radii: [0.043, 0.042] },
            0.015,
        ),
    ];
    surface_nets::mesh(&SignedDistanceField(&ops), [-0.055, -0.06, -0.055], [0.14, 0.08, 0.055], CELL_M)
}

/// Returns the flange disc and, on the diagonal, the grip with the pilot buttons.
fn flange() -> Mesh {
    let ops = [
        Union(
            SdfPrimitive::Frustum {
                a: [0.0, 0.0, 0.056],
                b: [0.0, 0.0, 0.104],
                radii: [0.046, 0.042],
                round: 0.008,
            },
            0.0,
        ),
        Union(
            SdfPrimitive::Frustum {
                a: [0.045, 0.045, 0.062],
                b: [0.045, 0.045, 0.1],
                radii: [0.028; 2],
                round: 0.01,
            },
            0.02,
        ),
    ];
    surface_nets::mesh(&SignedDistanceField(&ops), [-0.05, -0.05, 0.052], [0.08, 0.08, 0.107], 0.01)
}

pub(in crate::render::mesh) fn hand() -> Mesh {
    let ops = [
        Union(
            SdfPrimitive::RoundedBox {
                centre: [0.0, 0.0, 0.037],
                half: [0.0305, 0.102, 0.028],
                round: 0.012,
            },
            0.0,
        ),
        Union(
            SdfPrimitive::Frustum {
                a: [0.0, 0.0, 0.0],
                b: [0.0, 0.0, 0.03],
                radii: [0.04, 0.03],
                round: 0.004,
            },
            0.02,
        ),
    ];
    surface_nets::mesh(&SignedDistanceField(&ops), [-0.045, -0.105, 0.0], [0.045, 0.105, 0.066], 0.01)
}

/// Returns a stereo camera on a bracket. The centre of projection lies just in front, at (0.0465, −0.02,
/// 0.036) m.
pub(in crate::render::mesh) fn wrist_camera() -> Mesh {
    let ops = [
        Union(
            SdfPrimitive::RoundedBox {
                centre: [0.05, 0.0, 0.02],
                half: [0.0125, 0.046, 0.0125],
                round: 0.01,
            },
            0.0,
        ),
        Union(
            SdfPrimitive::RoundedBox { centre: [0.035, 0.0, 0.018], half: [0.01, 0.02, 0.008], round: 0.003 },
            0.004,
        ),
    ];
    surface_nets::mesh(&SignedDistanceField(&ops), [0.025, -0.05, 0.0], [0.065, 0.05, 0.035], 0.007)
}
