//! Housings of a Panda in its links' frames: tubes around the joint axes of the kinematic chain (d1 0.333, d3 0.316,
//! a4 ±0.0825, d5 0.384, a7 0.088, flange 0.107 m), melted into one another, their sizes those of the collision hulls in
//! spec/env.md §3. A joint between two links is shared half and half along its axis, as on the real arm.

use super::surface_nets;
use super::{Field, Solid, Step};
use crate::render::math::affine::Vec3;
use crate::render::mesh::Mesh;
use Step::{Add, Cut};

/// Side of a meshing cell of an arm link, in m: some 30 vertices around a tube.
const CELL_M: f32 = 0.0125;
/// Radius of the tubes around joints 1 to 5.
const TUBE: f32 = 0.055;
/// Room that a link leaves around the half of a joint that the next link fills.
const CLEAR: f32 = 0.0585;

/// Housing of link 0 to 7.
///
/// # Panics
/// If there is no such link.
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

fn tube(a: Vec3, b: Vec3) -> Solid {
    Solid::Rod { a, b, radii: [TUBE; 2], round: 0.012 }
}

fn room(a: Vec3, b: Vec3) -> Step {
    Cut(Solid::Rod { a, b, radii: [CLEAR; 2], round: 0.0 }, 0.016)
}

fn base() -> Mesh {
    let steps = [
        Add(Solid::Rod { a: [0.0, 0.0, 0.0], b: [0.0, 0.0, 0.139], radii: [0.088, 0.058], round: 0.01 }, 0.0),
        Add(Solid::Block { centre: [-0.07, 0.0, 0.022], half: [0.066, 0.094, 0.022], round: 0.012 }, 0.03),
        Add(
            Solid::Rod { a: [-0.132, 0.0, 0.055], b: [0.0, 0.0, 0.085], radii: [0.042, 0.05], round: 0.014 },
            0.03,
        ),
    ];
    surface_nets::mesh(&Field(&steps), [-0.14, -0.1, 0.0], [0.09, 0.1, 0.14], CELL_M)
}

fn shoulder_lower() -> Mesh {
    let steps = [
        Add(tube([0.0, 0.0, -0.186], [0.0, 0.0, -0.01]), 0.0),
        room([0.0, 0.006, 0.0], [0.0, 0.2, 0.0]),
        Add(tube([0.0, -0.129, 0.0], [0.0, -0.006, 0.0]), 0.03),
        room([0.0, 0.006, 0.0], [0.0, 0.2, 0.0]),
    ];
    surface_nets::mesh(&Field(&steps), [-0.06, -0.13, -0.19], [0.06, 0.06, 0.06], CELL_M)
}

fn shoulder_upper() -> Mesh {
    let steps = [
        Add(tube([0.0, -0.188, 0.0], [0.0, -0.01, 0.0]), 0.0),
        room([0.0, 0.0, -0.2], [0.0, 0.0, -0.006]),
        Add(tube([0.0, 0.0, 0.006], [0.0, 0.0, 0.129]), 0.03),
        room([0.0, 0.0, -0.2], [0.0, 0.0, -0.006]),
    ];
    surface_nets::mesh(&Field(&steps), [-0.06, -0.19, -0.06], [0.06, 0.06, 0.13], CELL_M)
}

fn elbow_upper() -> Mesh {
    let steps = [
        Add(tube([0.0, 0.0, -0.115], [0.0, 0.0, -0.045]), 0.0),
        Add(Solid::Sausage { a: [0.0, 0.0, -0.07], b: [0.07, 0.035, -0.005], radii: [0.053, 0.05] }, 0.02),
        Add(tube([0.0825, 0.006, 0.0], [0.0825, 0.111, 0.0]), 0.03),
        room([0.0825, -0.2, 0.0], [0.0825, -0.006, 0.0]),
    ];
    surface_nets::mesh(&Field(&steps), [-0.06, -0.06, -0.12], [0.14, 0.115, 0.06], CELL_M)
}

fn elbow_lower() -> Mesh {
    let steps = [
        Add(tube([-0.0825, 0.05, 0.0], [-0.0825, 0.118, 0.0]), 0.0),
        Add(
            Solid::Sausage { a: [-0.0825, 0.07, 0.0], b: [-0.0125, 0.005, 0.035], radii: [0.053, 0.05] },
            0.02,
        ),
        Add(tube([0.0, 0.0, 0.006], [0.0, 0.0, 0.111]), 0.03),
        room([0.0, 0.0, -0.2], [0.0, 0.0, -0.006]),
    ];
    surface_nets::mesh(&Field(&steps), [-0.14, -0.06, -0.06], [0.06, 0.124, 0.115], CELL_M)
}

/// From the elbow's tube aside and down to the fork that holds the wrist.
fn forearm() -> Mesh {
    let steps = [
        Add(tube([0.0, 0.0, -0.259], [0.0, 0.0, -0.185]), 0.0),
        Add(Solid::Sausage { a: [0.0, 0.0, -0.21], b: [0.0, 0.07, -0.09], radii: [0.053, 0.047] }, 0.03),
        Add(Solid::Sausage { a: [0.0, 0.07, -0.09], b: [0.0, 0.083, 0.0], radii: [0.047, 0.045] }, 0.02),
        Add(Solid::Rod { a: [0.0, 0.056, 0.0], b: [0.0, 0.13, 0.0], radii: [0.052; 2], round: 0.012 }, 0.01),
        Cut(Solid::Rod { a: [0.0, -0.2, 0.0], b: [0.0, 0.0545, 0.0], radii: [0.057; 2], round: 0.0 }, 0.008),
    ];
    surface_nets::mesh(&Field(&steps), [-0.06, -0.06, -0.265], [0.06, 0.135, 0.055], CELL_M)
}

/// The drum on the wrist's axis and the housing of joint 7 beside it.
fn wrist() -> Mesh {
    let steps = [
        Add(Solid::Rod { a: [0.0, 0.0, -0.051], b: [0.0, 0.0, 0.051], radii: [0.05; 2], round: 0.012 }, 0.0),
        Add(
            Solid::Rod {
                a: [0.088, -0.047, 0.0],
                b: [0.088, 0.072, 0.0],
                radii: [0.046, 0.044],
                round: 0.016,
            },
            0.0,
        ),
        Add(Solid::Sausage { a: [0.01, 0.0, 0.0], b: [0.085, 0.014, 0.0], radii: [0.043, 0.042] }, 0.015),
    ];
    surface_nets::mesh(&Field(&steps), [-0.055, -0.06, -0.055], [0.14, 0.08, 0.055], CELL_M)
}

/// The last disc and, on the diagonal, the grip with the pilot's buttons.
fn flange() -> Mesh {
    let steps = [
        Add(
            Solid::Rod { a: [0.0, 0.0, 0.056], b: [0.0, 0.0, 0.104], radii: [0.046, 0.042], round: 0.008 },
            0.0,
        ),
        Add(
            Solid::Rod { a: [0.045, 0.045, 0.062], b: [0.045, 0.045, 0.1], radii: [0.028; 2], round: 0.01 },
            0.02,
        ),
    ];
    surface_nets::mesh(&Field(&steps), [-0.05, -0.05, 0.052], [0.08, 0.08, 0.107], 0.01)
}

pub(in crate::render::mesh) fn hand() -> Mesh {
    let steps = [
        Add(Solid::Block { centre: [0.0, 0.0, 0.037], half: [0.0305, 0.102, 0.028], round: 0.012 }, 0.0),
        Add(Solid::Rod { a: [0.0, 0.0, 0.0], b: [0.0, 0.0, 0.03], radii: [0.04, 0.03], round: 0.004 }, 0.02),
    ];
    surface_nets::mesh(&Field(&steps), [-0.045, -0.105, 0.0], [0.045, 0.105, 0.066], 0.01)
}

/// A stereo camera's bar on a bracket; the camera's eye is just in front of it, at (0.0465, −0.02, 0.036).
pub(in crate::render::mesh) fn wrist_camera() -> Mesh {
    let steps = [
        Add(Solid::Block { centre: [0.05, 0.0, 0.02], half: [0.0125, 0.046, 0.0125], round: 0.01 }, 0.0),
        Add(Solid::Block { centre: [0.035, 0.0, 0.018], half: [0.01, 0.02, 0.008], round: 0.003 }, 0.004),
    ];
    surface_nets::mesh(&Field(&steps), [0.025, -0.05, 0.0], [0.065, 0.05, 0.035], 0.007)
}
