//! Instances of a Panda: white housings with dark panels, and a hand with two rubber-tipped fingers.

use core::f32::consts::FRAC_1_SQRT_2;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::instance::{Anchor, Instance, MeshSource};
use super::material::Material;
use crate::math::affine::Vec3;
use crate::mesh::{FIRST_TRIMMED_LINK, MeshId};
use scene::Link;

/// White plastic, linear RGB.
const WHITE: Vec3 = [0.902, 0.922, 0.929];
/// Black plastic and rubber, linear RGB.
const BLACK: Vec3 = [0.05; 3];
/// Aluminium of the wrist camera of a single arm, linear RGB.
const GREY: Vec3 = [0.5; 3];

/// The links with a housing, the one farthest from the base first.
const LINKS: [Link; 8] =
    [Link::Link7, Link::Link6, Link::Link5, Link::Link4, Link::Link3, Link::Link2, Link::Link1, Link::Link0];

/// A box of the finger that opens towards +y, in mm in the finger frame.
struct FingerBox {
    centre_mm: Vec3,
    half_mm: Vec3,
    tilted: bool,
    rubber: bool,
}

const fn finger_box(centre_mm: Vec3, half_mm: Vec3, tilted: bool, rubber: bool) -> FingerBox {
    FingerBox { centre_mm, half_mm, tilted, rubber }
}

/// Foot, post, arm, and the tip with its pad.
const FINGER: [FingerBox; 5] = [
    finger_box([0.0, 14.4, 2.0], [10.5, 11.9, 2.0], false, false),
    finger_box([0.0, 18.3, 11.0], [10.5, 6.8, 8.0], false, false),
    finger_box([0.0, 16.0, 27.8], [9.6, 3.6, 12.0], true, false),
    finger_box([0.0, 11.7, 45.0], [8.8, 2.7, 9.0], false, false),
    finger_box([0.0, 4.5, 45.0], [8.8, 4.5, 9.0], false, true),
];

/// Appends the moving links of one of `n_arms` arms if `moves`, or else its static base.
pub(crate) fn push(arm: usize, n_arms: usize, moves: bool, instances: &mut Vec<Instance>) {
    let [white, black, grey] = [WHITE, BLACK, GREY].map(Material::plain);
    let mut push = |link: Link, mesh, pose, scale, material| {
        let (mesh, anchor) = (MeshSource::Library(mesh), Anchor::Link { arm, link: link as usize });
        if moves == (link != Link::Link0) {
            instances.push(Instance { mesh, anchor, pose, scale, material });
        }
    };
    for (finger, side) in [(Link::Finger1, 1.0), (Link::Finger2, -1.0)] {
        for FingerBox { centre_mm: [x, y, z], half_mm, tilted, rubber } in FINGER {
            // 30° about x: cosine and sine of 15°. The second finger mirrors the first in y.
            let (cos, sin) = if tilted { (0.965_925_8, 0.258_819_04 * side) } else { (1.0, 0.0) };
            let rotation = UnitQuaternion::new_unchecked(Quaternion::new(cos, sin, 0.0, 0.0));
            let translation = Translation3::from([x, y * side, z].map(|mm| mm * 1e-3));
            let pose = Isometry3::from_parts(translation, rotation);
            push(finger, MeshId::Box, pose, half_mm.map(|mm| mm * 1e-3), if rubber { black } else { white });
        }
    }
    push(Link::Hand, MeshId::Hand, Isometry3::identity(), [1.0; 3], white);
    let camera = Isometry3::translation(0.0465, 0.0, 0.0235);
    push(Link::Hand, MeshId::Box, camera, [0.0115, 0.0495, 0.01], if n_arms == 1 { grey } else { white });
    let along_y = |x, y, z| {
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0, 0.0));
        Isometry3::from_parts(Translation3::new(x, y, z), rotation)
    };
    // The plug of the hand's cable, the cable in two pieces, and the white dot on the cap of joint 7.
    push(Link::Hand, MeshId::Cylinder, along_y(0.0, -0.068, -0.02), [0.0057, 0.0057, 0.022], black);
    push(Link::Hand, MeshId::Cylinder, along_y(0.0, -0.096, -0.018), [0.002, 0.002, 0.0075], black);
    let down = Isometry3::translation(0.0, -0.1015, -0.001);
    push(Link::Hand, MeshId::Cylinder, down, [0.002, 0.002, 0.019], black);
    push(Link::Link6, MeshId::Cylinder, along_y(0.088, 0.082, 0.0), [0.0055, 0.0055, 0.0015], white);
    for link in LINKS {
        let idx = link as usize;
        push(link, MeshId::Link(idx), Isometry3::identity(), [1.0; 3], white);
        if idx >= FIRST_TRIMMED_LINK {
            push(link, MeshId::LinkTrim(idx), Isometry3::identity(), [1.0; 3], black);
        }
    }
}
