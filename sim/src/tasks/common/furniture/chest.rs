//! The chest of drawers of PlaceCubeInDrawer: a fixed carcass and three sliding drawers, each with a solid
//! handle. See docs/benchmark.md, "Scenes and objects".

use core::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::tasks::common::{SINGLE_TABLE_Z, box_part, fixed, srgb};
use scene::{
    AppearanceSpec, BodySpec, JointKind, JointSpec, Mass, Motion, PartSpec, PlacementSpec, Primitive, Range,
    Role, Texture,
};

/// Bounds of a part along one axis, in m.
type Span = [f64; 2];

/// Travel of each drawer, in m.
pub(crate) const TRAVEL: f64 = 0.362;

/// Index of the carcass among the scene's bodies. The drawers are placed relative to it.
const CARCASS: usize = 0;
/// Index of the carcass's placement region.
const REGION: usize = 0;
/// Mass of the carcass, in kg.
const CARCASS_KG: f64 = 16.59;
/// Friction coefficient of all surfaces.
const FRICTION: f64 = 1.0;
/// Joint of a drawer.
const SLIDE: JointSpec =
    JointSpec { kind: JointKind::Slide, axis: [1.0, 0.0, 0.0], upper: TRAVEL, damping: 50.0, friction: 0.05 };
/// Reason for which no size perturbation scales the chest.
const REASON_NOT_SCALED: &str = "it is furniture, neither manipulated nor a receiver";

const FRAME: AppearanceSpec = AppearanceSpec::textured(Texture::Walnut, srgb([166, 128, 102]));
const FRONT: AppearanceSpec = AppearanceSpec::textured(Texture::Wood, srgb([140, 97, 64]));
const INSIDE: AppearanceSpec = AppearanceSpec::plain(srgb([214, 184, 135]));
const METAL: AppearanceSpec =
    AppearanceSpec { specular: 0.8, ..AppearanceSpec::plain(srgb([166, 161, 150])) };

/// Depth of the posts and rails, which are flush with the backs of the drawers' fronts, in m.
const FRAME_X: Span = [-0.2638, -0.2445];
/// Width between the side panels, in m.
const BETWEEN_SIDES_Y: Span = [-0.2217, 0.2097];
/// Thickness of a drawer's walls and floor, in m.
const WALL: f64 = 0.0129;
/// Bounds of the space inside a drawer in depth, in m.
const INSIDE_X: Span = [-0.251, 0.161];
/// Bounds of the space inside a drawer in width, in m.
const INSIDE_Y: Span = [-0.1686, 0.1566];

/// Mass and heights of a drawer. Heights are above the table, in m.
struct Drawer {
    name: &'static str,
    /// Mass in kg.
    kg: f64,
    front_z: Span,
    /// Top of the floor and of the walls.
    inside_z: Span,
    handle_z: Span,
}

/// The drawers from bottom to top.
const DRAWERS: [Drawer; 3] = [
    Drawer {
        name: "drawer",
        kg: 5.91,
        front_z: [0.1256, 0.3816],
        inside_z: [0.1836, 0.3397],
        handle_z: [0.2476, 0.2596],
    },
    Drawer {
        name: "middle drawer",
        kg: 3.22,
        front_z: [0.391, 0.555],
        inside_z: [0.4605, 0.520],
        handle_z: [0.467, 0.479],
    },
    Drawer {
        name: "upper drawer",
        kg: 3.29,
        front_z: [0.565, 0.737],
        inside_z: [0.628, 0.6875],
        handle_z: [0.645, 0.657],
    },
];

/// Creates the chest, which faces y. The lowest drawer is to be opened.
pub(crate) fn chest_of_drawers() -> Vec<BodySpec> {
    core::iter::once(carcass()).chain(DRAWERS.iter().map(Drawer::body)).collect()
}

/// Creates the carcass. Its front faces its own −x; its origin is on the table. It has no top board.
fn carcass() -> BodySpec {
    let side = |y: Span, x0: f64, z: Span| board([x0, 0.2771], y, z, FRAME);
    let post = |y: Span| board(FRAME_X, y, [0.116, 0.747], FRAME);
    let rail = |z: Span| board(FRAME_X, [-0.1992, 0.1872], z, FRAME);
    // Both side panels are set back at the foot, like the board between them.
    let foot_x = -0.183;
    let mut parts = vec![
        board([-0.2445, 0.2513], BETWEEN_SIDES_Y, [0.135, 0.148], INSIDE),
        board([0.2513, 0.2578], BETWEEN_SIDES_Y, [0.0, 0.715], INSIDE),
        board([foot_x, foot_x + 0.01], BETWEEN_SIDES_Y, [0.0, 0.135], FRAME),
        // A bar in place of a top board.
        board([0.2319, 0.2513], BETWEEN_SIDES_Y, [0.708, 0.747], FRAME),
        post([-0.2378, -0.1992]),
        post([0.1872, 0.2258]),
    ];
    parts.extend([[0.116, 0.155], [0.361, 0.412], [0.541, 0.580], [0.708, 0.747]].map(rail));
    for y in [[-0.2314, BETWEEN_SIDES_Y[0]], [BETWEEN_SIDES_Y[1], 0.2194]] {
        parts.extend([side(y, FRAME_X[1], [0.116, 0.747]), side(y, foot_x, [0.0, 0.116])]);
    }
    BodySpec {
        role: Role::Fixture,
        friction: FRICTION,
        mass: spread(CARCASS_KG, &parts),
        ..fixed("cabinet", parts, REGION, SINGLE_TABLE_Z, REASON_NOT_SCALED)
    }
    .with_yaw(Range::fixed(-FRAC_PI_2))
}

impl Drawer {
    /// Creates the drawer. Its origin is the middle of its handle; its x axis points out of the chest.
    fn body(&self) -> BodySpec {
        let ([x0, x1], [y0, y1], [floor, top]) = (INSIDE_X, INSIDE_Y, self.inside_z);
        let [outer_x, outer_y] = [INSIDE_X, INSIDE_Y].map(|[lo, hi]| [lo - WALL, hi + WALL]);
        let walls_z = [floor - WALL, top];
        let wall = |x, y| board(x, y, walls_z, INSIDE);
        let (handle_x, handle_y) = ([-0.3091, -0.2832], [-0.0666, 0.0546]);
        let mut parts = vec![
            board([-0.2832, outer_x[0]], [-0.2282, 0.2161], self.front_z, FRONT),
            board(handle_x, handle_y, self.handle_z, METAL),
            board(INSIDE_X, INSIDE_Y, [floor - WALL, floor], INSIDE),
            wall([outer_x[0], x0], outer_y),
            wall([x1, outer_x[1]], outer_y),
            wall(INSIDE_X, [outer_y[0], y0]),
            wall(INSIDE_X, [y1, outer_y[1]]),
        ];
        let origin = Vector3::from([handle_x, handle_y, self.handle_z].map(|[lo, hi]| (lo + hi) / 2.0));
        let out = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
        let pose = Isometry3::from_parts(origin.into(), out);
        for part in &mut parts {
            part.pose = pose.inverse() * part.pose;
        }
        BodySpec {
            role: Role::Fixture,
            motion: Motion::Jointed(SLIDE),
            placement: PlacementSpec::RelativeTo { body: CARCASS, pose },
            friction: FRICTION,
            mass: spread(self.kg, &parts),
            ..fixed(self.name, parts, REGION, SINGLE_TABLE_Z, REASON_NOT_SCALED)
        }
    }
}

/// Creates a box from its bounds in the carcass's frame.
fn board(x: Span, y: Span, z: Span, appearance: AppearanceSpec) -> PartSpec {
    let half = [x, y, z].map(|[lo, hi]| (hi - lo) / 2.0);
    box_part(half, [x, y, z].map(|[lo, hi]| (lo + hi) / 2.0), appearance)
}

/// Spreads a mass in kg evenly over boxes that do not overlap.
fn spread(kg: f64, parts: &[PartSpec]) -> Mass {
    let volume = |part: &PartSpec| match part.shape {
        Primitive::Box { half } => 8.0 * half.iter().product::<f64>(),
        _ => 0.0,
    };
    Mass::Density(kg / parts.iter().map(volume).sum::<f64>())
}
