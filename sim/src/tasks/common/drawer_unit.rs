//! The chest of drawers of two tasks (spec/tasks.md §3, tasks 25 and 26): its carcass stands fast, its drawers slide, and
//! each is pulled by a bar.

use core::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::{BIMANUAL_TABLE_Z, ExternalCameras, box_part, fixed, region};
use crate::expert::grasp;
use crate::scene::{
    AppearanceSpec, Body, BodySpec, JointKind, JointSpec, Motion, PartSpec, PlacementSpec, Primitive, Range,
    RegionSpec, Role, ScaledBy, Scene, Texture, VisualShape, VisualSpec,
};

/// Name of the carcass. Its front faces its −x; its origin lies behind the middle drawer's bar.
pub(in crate::tasks) const CARCASS: &str = "carcass";
/// Names of the drawers from above.
pub(in crate::tasks) const DRAWERS: [&str; 4] =
    ["upper drawer", "middle drawer", "lower drawer", "bottom drawer"];
/// How far a drawer slides, in m.
pub(in crate::tasks) const TRAVEL: f64 = 0.22;

pub(in crate::tasks) const CAMERAS: ExternalCameras = ExternalCameras {
    external1: [[-0.3, 0.5, 1.83], [-0.1, 0.0, 1.03]],
    external2: [[-0.3, -0.5, 1.83], [-0.1, 0.0, 1.03]],
};

/// Heights over the carcass's origin, in m: of the carcass's foot and top, and of each drawer's bar, in the middle of its
/// front.
const FOOT: f64 = -0.431;
const TOP: f64 = 0.245;
const BARS: [f64; 4] = [0.15, 0.0, -0.15, -0.315];
/// Half the height of each drawer's front, in m.
const FRONT_HALF_HEIGHTS: [f64; 4] = [0.0725, 0.0725, 0.0725, 0.0875];
/// How far the bars' axes, the fronts' faces and the carcass's back are from the carcass's origin, in m.
const BAR: f64 = 0.15;
const FACE: f64 = 0.118;
const BACK: f64 = 0.142;
/// Half of the carcass's width, half the thickness of its walls, and how far its top juts out, in m.
const HALF_WIDTH: f64 = 0.155;
const WALL: f64 = 0.008;
const OVERHANG: f64 = 0.006;
/// Half the thickness of a drawer's front, and of its floor and other sides, in m.
const FRONT: f64 = 0.009;
const SIDE: f64 = 0.005;
/// Half the width of a drawer's front, and of the box behind it, in m.
const FRONT_HALF_WIDTH: f64 = 0.144;
const BOX_HALF_WIDTH: f64 = 0.135;
/// Half the depth of the box behind a drawer's front, in m.
const BOX_HALF_DEPTH: f64 = 0.11;
/// Half the height of a drawer's sides, and how far their lower edge is from the lower edge of its front, in m.
const SIDE_HALF_HEIGHT: f64 = 0.045;
const SIDE_ABOVE_EDGE: f64 = 0.01;
/// Radius and half length of a bar, radius of its posts, and how far these stand from its middle, in m.
const BAR_RADIUS: f64 = 0.006;
const BAR_HALF_LENGTH: f64 = 0.06;
const POST_RADIUS: f64 = 0.005;
const POST_AT: f64 = 0.045;
/// kg/m³ of the wood.
const WOOD_DENSITY: f64 = 600.0;
/// Friction of all surfaces.
const SURFACE_FRICTION: f64 = 1.0;
/// Drawers run heavily enough to stop within a few centimetres of where they are let go: N per m/s, and N.
const RUN_DAMPING: f64 = 20.0;
const RUN_FRICTION: f64 = 3.0;

const FRAME: AppearanceSpec = AppearanceSpec::textured(Texture::Walnut, [1.0, 0.92, 0.84]);
const PANEL: AppearanceSpec = AppearanceSpec::textured(Texture::Wood, [0.74, 0.50, 0.30]);
const INSIDE: AppearanceSpec = AppearanceSpec::plain([0.86, 0.78, 0.64]);
const DARK: AppearanceSpec = AppearanceSpec::plain([0.20, 0.13, 0.09]);
const STEEL: AppearanceSpec = AppearanceSpec { specular: 0.8, ..AppearanceSpec::plain([0.80, 0.80, 0.82]) };

/// Where the carcass's origin is placed.
pub(in crate::tasks) fn place() -> RegionSpec {
    region("drawer unit", Range::new(0.1, 0.3), Range::symmetric(0.1))
}

/// The carcass and its drawers: the first bodies of a scene, in its first region.
pub(in crate::tasks) fn bodies() -> Vec<BodySpec> {
    let carcass = BodySpec {
        role: Role::Fixture,
        friction: SURFACE_FRICTION,
        density: WOOD_DENSITY,
        ..fixed(CARCASS, carcass_parts(), 0, BIMANUAL_TABLE_Z, "no perturbation of the benchmark reaches it")
    }
    .with_yaw(Range::symmetric(PI / 16.0));
    let drawers = (0..DRAWERS.len()).map(|i| drawer(i, &carcass)).collect::<Vec<_>>();
    core::iter::once(carcass).chain(drawers).collect()
}

/// A plinth, two sides and a back that stand on it, and a top that juts out a little.
fn carcass_parts() -> Vec<PartSpec> {
    let (depth, middle) = ((BACK + FACE) / 2.0, (BACK - FACE) / 2.0);
    let (floor, ceiling) = (BARS[3] - FRONT_HALF_HEIGHTS[3], TOP - 2.0 * WALL);
    let (plinth, height, centre) = ((floor - FOOT) / 2.0, (ceiling - floor) / 2.0, (ceiling + floor) / 2.0);
    let side = |y| box_part([depth, WALL, height], [middle, y, centre], FRAME);
    let inner_half_width = HALF_WIDTH - 2.0 * WALL;
    vec![
        box_part([depth, HALF_WIDTH, plinth], [middle, 0.0, FOOT + plinth], FRAME),
        side(HALF_WIDTH - WALL),
        side(WALL - HALF_WIDTH),
        box_part([WALL, inner_half_width, height], [BACK - WALL, 0.0, centre], DARK),
        box_part([depth + OVERHANG, HALF_WIDTH + OVERHANG, WALL], [middle, 0.0, TOP - WALL], FRAME),
    ]
}

/// A drawer. Its frame is that of the carcass, raised to its bar and turned about, so that it slides along +x.
fn drawer(i: usize, carcass: &BodySpec) -> BodySpec {
    let parts = drawer_parts(FRONT_HALF_HEIGHTS[i]);
    let about = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
    BodySpec {
        name: DRAWERS[i],
        motion: Motion::Jointed(JointSpec {
            kind: JointKind::Slide,
            axis: [1.0, 0.0, 0.0],
            upper: TRAVEL,
            damping: RUN_DAMPING,
            friction: RUN_FRICTION,
        }),
        visuals: drawer_visuals(&parts),
        parts,
        scaled_by: ScaledBy::Nothing("it fits its carcass"),
        placement: PlacementSpec::RelativeTo {
            body: 0,
            pose: Isometry3::from_parts(Translation3::new(0.0, 0.0, BARS[i]), about),
        },
        ..carcass.clone()
    }
}

/// Front, bar and the open box behind the front.
fn drawer_parts(front_half_height: f64) -> Vec<PartSpec> {
    let bottom = SIDE_ABOVE_EDGE - front_half_height;
    let middle = FACE - 2.0 * FRONT - BOX_HALF_DEPTH;
    let z = bottom + SIDE_HALF_HEIGHT;
    let side = |y| box_part([BOX_HALF_DEPTH, SIDE, SIDE_HALF_HEIGHT], [middle, y, z], INSIDE);
    let back = middle - BOX_HALF_DEPTH + SIDE;
    vec![
        box_part([FRONT, FRONT_HALF_WIDTH, front_half_height], [FACE - FRONT, 0.0, 0.0], PANEL),
        PartSpec { pose: along_y([BAR, 0.0, 0.0]), ..PartSpec::at(BAR_SOLID, [0.0; 3], STEEL) },
        box_part([BOX_HALF_DEPTH, BOX_HALF_WIDTH, SIDE], [middle, 0.0, bottom + SIDE], INSIDE),
        side(BOX_HALF_WIDTH - SIDE),
        side(SIDE - BOX_HALF_WIDTH),
        box_part([SIDE, BOX_HALF_WIDTH, SIDE_HALF_HEIGHT], [back, 0.0, z], INSIDE),
    ]
}

const BAR_SOLID: Primitive = Primitive::Capsule { radius: BAR_RADIUS, half_height: BAR_HALF_LENGTH };

/// The solids, and the two posts that the bar stands on, which nothing touches.
fn drawer_visuals(parts: &[PartSpec]) -> Vec<VisualSpec> {
    let seen = parts.iter().map(|part| {
        let shape = match part.shape {
            Primitive::Box { half } => VisualShape::RoundedBox { half, edge_radius: 0.003 },
            other => VisualShape::Primitive(other),
        };
        VisualSpec { shape, pose: part.pose, appearance: part.appearance }
    });
    let half_height = (BAR - FACE) / 2.0;
    let along_x = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2);
    let post = |y| VisualSpec {
        shape: VisualShape::Primitive(Primitive::Cylinder { radius: POST_RADIUS, half_height }),
        pose: Isometry3::from_parts(Translation3::new(FACE + half_height, y, 0.0), along_x),
        appearance: STEEL,
    };
    seen.chain([-POST_AT, POST_AT].map(post)).collect()
}

fn along_y(position: [f64; 3]) -> Isometry3<f64> {
    Isometry3::from_parts(position.into(), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2))
}

/// Leans of the hand that are tried, in rad. Each hand comes from its own arm's side: straight ahead, the one is in the
/// other's way, and a bar far from the arm's base is out of reach.
const LEANS: [f64; 5] = [0.4, 0.6, 0.8, 0.2, 0.0];
/// How far before the bar a hand starts its way to it, in m.
const BEFORE: f64 = 0.3;

/// How an arm pulls a drawer: where its TCP goes.
pub(in crate::tasks) struct Pull {
    /// Before the bar, around it, and where it is pulled to.
    pub(in crate::tasks) before: Isometry3<f64>,
    pub(in crate::tasks) at: Isometry3<f64>,
    pub(in crate::tasks) open: Isometry3<f64>,
}

impl Pull {
    /// By `by_m`, gripping the middle of the bar from above and below; of the two ways round, the one nearer to `closing`.
    pub(in crate::tasks) fn new(
        scene: &Scene,
        arm: usize,
        drawer: &Body,
        by_m: f64,
        closing: &Vector3<f64>,
    ) -> Self {
        let out = drawer.pose.rotation * Vector3::x();
        let bar = drawer.pose * Point3::new(BAR, 0.0, 0.0);
        let closing = grasp::closest_closing(Vector3::z(), closing);
        let straight = grasp::pose(&bar.coords, &-out, &closing);
        let candidates = LEANS.map(|lean| grasp::tilted_toward_base(scene, arm, &straight, lean));
        let stations = |tcp: &Isometry3<f64>| {
            [grasp::retreated(tcp, BEFORE), *tcp, grasp::translated(tcp, &(out * by_m))]
        };
        let tcp = grasp::first_reachable(scene, arm, &candidates, stations);
        let [before, at, open] = stations(&tcp);
        Self { before, at, open }
    }
}
