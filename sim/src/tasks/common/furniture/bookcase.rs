//! The bookcase of PlaceBookInShelf, open towards −x. Lengths in m.
//!
//! Its frame has the benchmark's origin, with axes parallel to those of the world. On a solid base stand two
//! side walls and a back wall. A block of leaning books takes the +y half of the compartment between them;
//! the slot for the book is the other half. Above the compartment is a board with a heap of books on it, and
//! no top.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::tasks::common::srgb;
use scene::{AppearanceSpec, PartSpec, Primitive, Texture, VisualShape, VisualSpec};

/// Height of the compartment's floor.
pub(crate) const FLOOR_Z: f64 = 0.0846;

/// Minimum and maximum along x, y and z of base, plinth, −y wall, +y wall, back and board.
const CASE: [[[f64; 2]; 3]; 6] = [
    [[-0.202, 0.159], [-0.209, 0.200], [0.0, 0.0593]],
    [[-0.160, 0.116], [-0.166, 0.157], [0.0593, FLOOR_Z]],
    [[-0.153, 0.064], [-0.159, -0.118], [FLOOR_Z, 0.485]],
    [[-0.152, 0.064], [0.108, 0.153], [FLOOR_Z, 0.485]],
    [[0.064, 0.117], [-0.159, 0.150], [FLOOR_Z, 0.486]],
    [[-0.149, 0.064], [-0.118, 0.108], [0.2592, 0.296]],
];
/// The heap of books on the board, as it collides.
const HEAP: [[f64; 2]; 3] = [[-0.125, 0.030], [-0.067, 0.070], [0.296, 0.325]];
/// Minimum and maximum x of the leaning block.
const BLOCK_X: [f64; 2] = [-0.160, 0.008];
/// Minimum and maximum y and the height of the leaning block's lower face and of its upper face.
const BLOCK: [([f64; 2], f64); 2] = [([0.007, 0.082], FLOOR_Z), ([0.030, 0.107], 0.2485)];

/// Creates the collision shapes.
pub(crate) fn parts() -> Vec<PartSpec> {
    let wood = wood();
    let solid = |bounds| {
        let (half, centre) = half_and_centre(bounds);
        PartSpec::at(Primitive::Box { half }, centre, wood)
    };
    let face = |([min_y, max_y], z): ([f64; 2], f64)| {
        BLOCK_X.into_iter().flat_map(move |x| [[x, min_y, z], [x, max_y, z]])
    };
    let block = Primitive::Hull { points: BLOCK.into_iter().flat_map(face).collect() };
    let mut parts: Vec<PartSpec> = CASE.into_iter().chain([HEAP]).map(solid).collect();
    parts.push(PartSpec::at(block, [0.0; 3], wood));
    parts
}

/// Creates the visuals.
pub(crate) fn visuals() -> Vec<VisualSpec> {
    /// Edge radius of the case.
    const EDGE: f64 = 0.003;
    let wood = wood();
    let panel = |bounds| {
        let (half, centre) = half_and_centre(bounds);
        VisualSpec::at(VisualShape::RoundedBox { half, edge_radius: EDGE }, centre, wood)
    };
    CASE.map(panel).into_iter().chain(leaning_books()).chain(lying_books()).collect()
}

fn wood() -> AppearanceSpec {
    AppearanceSpec::textured(Texture::Wood, srgb([128, 87, 51]))
}

/// Thickness, depth, height and colour of the leaning books, from −y to +y.
const LEANING: [(f64, f64, f64, [u8; 3]); 5] = [
    (0.015, 0.168, 0.160, [150, 44, 38]),
    (0.018, 0.160, 0.150, [214, 178, 92]),
    (0.011, 0.165, 0.156, [56, 98, 74]),
    (0.017, 0.168, 0.160, [92, 58, 98]),
    (0.013, 0.158, 0.152, [206, 110, 50]),
];
/// Angle by which the books lean towards +y, in rad.
const LEAN: f64 = 0.1393;

/// Creates the visuals of the leaning block, side by side with their edges on the floor.
fn leaning_books() -> impl Iterator<Item = VisualSpec> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -LEAN);
    let cos = libm::cos(LEAN);
    let ([mut y, _], floor_z) = BLOCK[0];
    LEANING.into_iter().map(move |(thickness, depth, height, color)| {
        // The lower edge on the +y side touches the floor.
        y += thickness / cos;
        let half = [depth / 2.0, thickness / 2.0, height / 2.0];
        let edge = Vector3::new(BLOCK_X[0] + half[0], y, floor_z);
        let centre = edge + rotation * Vector3::new(0.0, -half[1], half[2]);
        book(half, Isometry3::from_parts(centre.into(), rotation), color)
    })
}

/// Creates the visuals of the two books that lie on the board, askew.
fn lying_books() -> [VisualSpec; 2] {
    let at = |x: f64, z: f64, yaw: f64| {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
        Isometry3::from_parts(Vector3::new(x, 0.0015, z).into(), rotation)
    };
    let [_, _, [bottom_z, top_z]] = HEAP;
    let lower_z = bottom_z + 0.016;
    [
        book([0.076, 0.064, 0.008], at(-0.048, f64::midpoint(bottom_z, lower_z), 0.04), [52, 84, 128]),
        book([0.068, 0.052, 0.0065], at(-0.052, f64::midpoint(lower_z, top_z), -0.16), [176, 164, 140]),
    ]
}

fn book(half: [f64; 3], pose: Isometry3<f64>, color: [u8; 3]) -> VisualSpec {
    /// Edge radius of a book.
    const EDGE: f64 = 0.0015;
    let shape = VisualShape::RoundedBox { half, edge_radius: EDGE };
    VisualSpec { shape, pose, appearance: AppearanceSpec::plain(srgb(color)) }
}

fn half_and_centre(bounds: [[f64; 2]; 3]) -> ([f64; 3], [f64; 3]) {
    (bounds.map(|[min, max]| (max - min) / 2.0), bounds.map(|[min, max]| f64::midpoint(min, max)))
}
