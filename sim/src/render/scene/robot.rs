//! Instances of a Panda: white link housings, dark joint rings, grey caps and a dark hand with two fingers.

use core::f32::consts::FRAC_1_SQRT_2;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::material::Material;
use super::{Anchor, Instance, MeshSource};
use crate::render::math::affine::Vec3;
use crate::render::mesh::MeshId;
use crate::scene::{CameraMount, Link, Scene};

/// A disc attached to a link.
struct Disc {
    link: Link,
    centre: Vec3,
    /// Axis of revolution, in the link frame.
    axis: Axis,
    radius: f32,
    half_height: f32,
    color: DiscColor,
}

enum Axis {
    Y,
    Z,
}

enum DiscColor {
    Dark,
    Grey,
}

const fn disc(link: Link, centre: Vec3, axis: Axis, radius: f32, half_height: f32, color: DiscColor) -> Disc {
    Disc { link, centre, axis, radius, half_height, color }
}

/// Rings in the joint gaps, caps at the ends of the joint axes, and the flange.
const DISCS: [Disc; 15] = [
    disc(Link::Link0, [0.0, 0.0, 0.141], Axis::Z, 0.0555, 0.008, DiscColor::Dark),
    disc(Link::Link1, [0.0, 0.0, 0.0], Axis::Y, 0.0535, 0.012, DiscColor::Dark),
    disc(Link::Link1, [0.0, -0.1285, 0.0], Axis::Y, 0.043, 0.004, DiscColor::Grey),
    disc(Link::Link2, [0.0, 0.0, 0.1285], Axis::Z, 0.043, 0.004, DiscColor::Grey),
    disc(Link::Link2, [0.0, -0.194, 0.0], Axis::Y, 0.0535, 0.012, DiscColor::Dark),
    disc(Link::Link3, [0.0825, 0.0, 0.0], Axis::Y, 0.0535, 0.012, DiscColor::Dark),
    disc(Link::Link3, [0.0825, 0.1105, 0.0], Axis::Y, 0.043, 0.004, DiscColor::Grey),
    disc(Link::Link4, [0.0, 0.0, 0.1105], Axis::Z, 0.043, 0.004, DiscColor::Grey),
    disc(Link::Link4, [-0.0825, 0.1215, 0.0], Axis::Y, 0.0535, 0.012, DiscColor::Dark),
    disc(Link::Link5, [0.0, 0.053, 0.0], Axis::Y, 0.0475, 0.008, DiscColor::Dark),
    disc(Link::Link5, [0.0, 0.1295, 0.0], Axis::Y, 0.04, 0.004, DiscColor::Grey),
    disc(Link::Link6, [0.0, 0.0, 0.0505], Axis::Z, 0.038, 0.004, DiscColor::Grey),
    disc(Link::Link6, [0.088, 0.0715, 0.0], Axis::Y, 0.03, 0.004, DiscColor::Grey),
    disc(Link::Link6, [0.088, -0.0515, 0.0], Axis::Y, 0.0425, 0.008, DiscColor::Dark),
    disc(Link::Link7, [0.0, 0.0, 0.1055], Axis::Z, 0.0325, 0.006, DiscColor::Dark),
];

/// A collision box of the finger that opens towards +y (docs/benchmark.md, "Robot and control"), in mm in the
/// finger frame.
struct FingerBox {
    centre_mm: Vec3,
    half_mm: Vec3,
    tilted: bool,
    rubber: bool,
}

const fn finger_box(centre_mm: Vec3, half_mm: Vec3, tilted: bool, rubber: bool) -> FingerBox {
    FingerBox { centre_mm, half_mm, tilted, rubber }
}

const FINGER: [FingerBox; 5] = [
    finger_box([0.0, 18.5, 11.0], [11.0, 7.5, 10.0], false, false),
    finger_box([0.0, 6.8, 2.2], [11.0, 4.4, 1.9], false, false),
    finger_box([0.0, 15.9, 28.35], [8.75, 3.5, 11.75], true, false),
    finger_box([0.0, 8.6, 45.25], [8.75, 6.58, 9.25], false, false),
    finger_box([0.0, 1.01, 45.25], [8.75, 1.01, 9.25], false, true),
];

/// Returns `true` if a camera is mounted on the hand of `arm`.
pub(in crate::render) fn has_camera(scene: &Scene, arm: usize) -> bool {
    scene.cameras.iter().any(|camera| matches!(camera.mount, CameraMount::Hand { arm: a, .. } if a == arm))
}

/// Appends the moving links of one arm if `moves`, or else its static base.
pub(in crate::render) fn push(arm: usize, moves: bool, has_camera: bool, instances: &mut Vec<Instance>) {
    let white = Material::plain([0.93, 0.93, 0.92], 0.35);
    let grey = Material::plain([0.66, 0.67, 0.69], 0.3);
    let dark = Material::plain([0.13, 0.13, 0.14], 0.3);
    let hand = Material::plain([0.30, 0.31, 0.33], 0.4);
    let metal = Material::plain([0.80, 0.81, 0.83], 0.5);
    let mut push = |link: Link, mesh, pose, scale, material| {
        let (mesh, anchor) = (MeshSource::Library(mesh), Anchor::Link { arm, link: link as usize });
        if moves == (link != Link::Link0) {
            instances.push(Instance { mesh, anchor, pose, scale, material });
        }
    };
    if has_camera {
        push(Link::Hand, MeshId::WristCamera, Isometry3::identity(), [1.0; 3], grey);
    }
    for (finger, side) in [(Link::Finger1, 1.0), (Link::Finger2, -1.0)] {
        for FingerBox { centre_mm: [x, y, z], half_mm, tilted, rubber } in FINGER {
            // 30° about x: cosine and sine of 15°. The second finger mirrors the first in y.
            let (cos, sin) = if tilted { (0.965_925_8, 0.258_819_04 * side) } else { (1.0, 0.0) };
            let rotation = UnitQuaternion::new_unchecked(Quaternion::new(cos, sin, 0.0, 0.0));
            let translation = Translation3::from([x, y * side, z].map(|mm| mm * 1e-3));
            let pose = Isometry3::from_parts(translation, rotation);
            push(finger, MeshId::Box, pose, half_mm.map(|mm| mm * 1e-3), if rubber { dark } else { metal });
        }
    }
    push(Link::Hand, MeshId::Hand, Isometry3::identity(), [1.0; 3], hand);
    let links = [
        Link::Link7,
        Link::Link6,
        Link::Link5,
        Link::Link4,
        Link::Link3,
        Link::Link2,
        Link::Link1,
        Link::Link0,
    ];
    for link in links {
        push(link, MeshId::Link(link as usize), Isometry3::identity(), [1.0; 3], white);
    }
    for Disc { link, centre, axis, radius, half_height, color } in DISCS {
        let rotation = match axis {
            Axis::Z => UnitQuaternion::identity(),
            // A quarter turn about x maps z to −y, which is the same for a symmetric disc.
            Axis::Y => UnitQuaternion::new_unchecked(Quaternion::new(FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0, 0.0)),
        };
        let pose = Isometry3::from_parts(Translation3::from(centre), rotation);
        let material = match color {
            DiscColor::Dark => dark,
            DiscColor::Grey => grey,
        };
        push(link, MeshId::Cylinder, pose, [radius, radius, half_height], material);
    }
}
