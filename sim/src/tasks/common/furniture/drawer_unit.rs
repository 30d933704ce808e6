//! The drawer unit of DualArmDrawerPlace and DualArmDrawerOpen: a fixed carcass with sliding drawers, each
//! with a bar handle. See docs/benchmark.md, "Scenes and objects".

use core::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::expert::grasp;
use crate::tasks::common::{BIMANUAL_TABLE_Z, ExternalCameras, box_part, fixed, region, srgb};
use scene::{
    AppearanceSpec, Body, BodySpec, JointKind, JointSpec, Motion, PartSpec, PlacementSpec, Primitive, Range,
    RegionSpec, Role, ScaledBy, Scene, Texture, VisualShape, VisualSpec,
};

/// Name of the carcass. Its front faces its own −x; its origin lies behind the middle drawer's bar.
pub(crate) const CARCASS: &str = "carcass";
/// Names of the drawers from top to bottom.
pub(crate) const DRAWERS: [&str; 4] = ["upper drawer", "middle drawer", "lower drawer", "bottom drawer"];
/// Travel of a drawer, in m.
pub(crate) const TRAVEL: f64 = 0.22;

/// External cameras of both tasks.
pub(crate) const CAMERAS: ExternalCameras = ExternalCameras {
    external1: [[-0.3, 0.5, 1.83], [-0.1, 0.0, 1.03]],
    external2: [[-0.3, -0.5, 1.83], [-0.1, 0.0, 1.03]],
};

/// Height of the carcass's foot relative to its origin, in m.
const FOOT_Z: f64 = -0.431;
/// Height of the carcass's top relative to its origin, in m.
const TOP_Z: f64 = 0.245;
/// Height of each drawer's bar, at the centre of its front, relative to the carcass's origin, in m.
const BARS_Z: [f64; 4] = [0.15, 0.0, -0.15, -0.315];
/// Half-height of each drawer's front, in m.
const FRONT_HALF_HEIGHTS: [f64; 4] = [0.0725, 0.0725, 0.0725, 0.0875];
/// Distance of the bars' axes in front of the carcass's origin, in m.
const BAR_X: f64 = 0.15;
/// Distance of the fronts' outer faces in front of the carcass's origin, in m.
const FACE_X: f64 = 0.118;
/// Distance of the carcass's back behind its origin, in m.
const BACK_X: f64 = 0.142;
/// Half-width of the carcass, in m.
const HALF_WIDTH: f64 = 0.155;
/// Half-thickness of the carcass's walls, in m.
const WALL: f64 = 0.008;
/// Overhang of the carcass's top, in m.
const OVERHANG: f64 = 0.006;
/// Half-thickness of a drawer's front, in m.
const FRONT: f64 = 0.009;
/// Half-thickness of a drawer's bottom, sides and back, in m.
const SIDE: f64 = 0.005;
/// Half-width of a drawer's front, in m.
const FRONT_HALF_WIDTH: f64 = 0.144;
/// Half-width of the box behind a drawer's front, in m.
const BOX_HALF_WIDTH: f64 = 0.135;
/// Half-depth of the box behind a drawer's front, in m.
const BOX_HALF_DEPTH: f64 = 0.11;
/// Half-height of a drawer's sides, in m.
const SIDE_HALF_HEIGHT: f64 = 0.045;
/// Height of the sides' lower edge above the lower edge of the front, in m.
const SIDE_ABOVE_EDGE: f64 = 0.01;
/// Radius of a bar, in m.
const BAR_RADIUS: f64 = 0.006;
/// Half-length of a bar, in m.
const BAR_HALF_LENGTH: f64 = 0.06;
/// Radius of a bar's posts, in m.
const POST_RADIUS: f64 = 0.005;
/// Distance of a post from the middle of its bar, in m.
const POST_OFFSET: f64 = 0.045;
/// Friction coefficient of all surfaces.
const SURFACE_FRICTION: f64 = 1.0;
/// Dry friction of the drawers, in N. Nothing else slows them, as in the benchmark.
const SLIDE_FRICTION: f64 = 0.05;

const FRAME: AppearanceSpec = AppearanceSpec::textured(Texture::Walnut, srgb([255, 235, 214]));
const PANEL: AppearanceSpec = AppearanceSpec::textured(Texture::Wood, srgb([189, 128, 76]));
const INSIDE: AppearanceSpec = AppearanceSpec::plain(srgb([219, 199, 163]));
const DARK: AppearanceSpec = AppearanceSpec::plain(srgb([51, 33, 23]));
const STEEL: AppearanceSpec =
    AppearanceSpec { specular: 0.8, ..AppearanceSpec::plain(srgb([204, 204, 209])) };

/// Returns the placement region of the carcass.
pub(crate) fn placement_region() -> RegionSpec {
    region("drawer unit", Range::new(0.1, 0.3), Range::symmetric(0.1))
}

/// Creates the carcass and its drawers, which must be the first bodies of the scene and use its first region.
pub(crate) fn bodies() -> Vec<BodySpec> {
    let carcass = BodySpec {
        role: Role::Fixture,
        friction: SURFACE_FRICTION,
        ..fixed(
            CARCASS,
            carcass_parts(),
            0,
            BIMANUAL_TABLE_Z,
            "no perturbation of the benchmark applies to it",
        )
    }
    .with_yaw(Range::symmetric(PI / 16.0));
    let drawers = (0..DRAWERS.len()).map(|i| drawer(i, &carcass)).collect::<Vec<_>>();
    core::iter::once(carcass).chain(drawers).collect()
}

/// Creates a plinth, two sides and a back on it, and a slightly protruding top.
fn carcass_parts() -> Vec<PartSpec> {
    let (depth, middle) = ((BACK_X + FACE_X) / 2.0, (BACK_X - FACE_X) / 2.0);
    let (floor, ceiling) = (BARS_Z[3] - FRONT_HALF_HEIGHTS[3], TOP_Z - 2.0 * WALL);
    let (plinth, height, centre) = ((floor - FOOT_Z) / 2.0, (ceiling - floor) / 2.0, (ceiling + floor) / 2.0);
    let side = |y| box_part([depth, WALL, height], [middle, y, centre], FRAME);
    let inner_half_width = HALF_WIDTH - 2.0 * WALL;
    vec![
        box_part([depth, HALF_WIDTH, plinth], [middle, 0.0, FOOT_Z + plinth], FRAME),
        side(HALF_WIDTH - WALL),
        side(WALL - HALF_WIDTH),
        box_part([WALL, inner_half_width, height], [BACK_X - WALL, 0.0, centre], DARK),
        box_part([depth + OVERHANG, HALF_WIDTH + OVERHANG, WALL], [middle, 0.0, TOP_Z - WALL], FRAME),
    ]
}

/// Creates a drawer. Its frame is the carcass's frame raised to the drawer's bar and rotated by 180° about z,
/// so that the drawer slides along its +x.
fn drawer(i: usize, carcass: &BodySpec) -> BodySpec {
    let parts = drawer_parts(FRONT_HALF_HEIGHTS[i]);
    let about = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
    BodySpec {
        name: DRAWERS[i],
        motion: Motion::Jointed(JointSpec {
            kind: JointKind::Slide,
            axis: [1.0, 0.0, 0.0],
            upper: TRAVEL,
            damping: 0.0,
            friction: SLIDE_FRICTION,
        }),
        visuals: drawer_visuals(&parts),
        parts,
        scaled_by: ScaledBy::Nothing("it fits its carcass"),
        placement: PlacementSpec::RelativeTo {
            body: 0,
            pose: Isometry3::from_parts(Translation3::new(0.0, 0.0, BARS_Z[i]), about),
        },
        ..carcass.clone()
    }
}

/// Creates the front, the bar and the open box behind the front.
fn drawer_parts(front_half_height: f64) -> Vec<PartSpec> {
    let bottom = SIDE_ABOVE_EDGE - front_half_height;
    let middle = FACE_X - 2.0 * FRONT - BOX_HALF_DEPTH;
    let z = bottom + SIDE_HALF_HEIGHT;
    let side = |y| box_part([BOX_HALF_DEPTH, SIDE, SIDE_HALF_HEIGHT], [middle, y, z], INSIDE);
    let back = middle - BOX_HALF_DEPTH + SIDE;
    vec![
        box_part([FRONT, FRONT_HALF_WIDTH, front_half_height], [FACE_X - FRONT, 0.0, 0.0], PANEL),
        PartSpec { pose: along_y([BAR_X, 0.0, 0.0]), ..PartSpec::at(BAR_SHAPE, [0.0; 3], STEEL) },
        box_part([BOX_HALF_DEPTH, BOX_HALF_WIDTH, SIDE], [middle, 0.0, bottom + SIDE], INSIDE),
        side(BOX_HALF_WIDTH - SIDE),
        side(SIDE - BOX_HALF_WIDTH),
        box_part([SIDE, BOX_HALF_WIDTH, SIDE_HALF_HEIGHT], [back, 0.0, z], INSIDE),
    ]
}

const BAR_SHAPE: Primitive = Primitive::Capsule { radius: BAR_RADIUS, half_height: BAR_HALF_LENGTH };

/// Creates the visuals of the parts and of the two posts of the bar, which do not collide.
fn drawer_visuals(parts: &[PartSpec]) -> Vec<VisualSpec> {
    let part_visuals = parts.iter().map(|part| {
        let shape = match part.shape.clone() {
            Primitive::Box { half } => VisualShape::RoundedBox { half, edge_radius: 0.003 },
            other => VisualShape::Primitive(other),
        };
        VisualSpec { shape, pose: part.pose, appearance: part.appearance }
    });
    let half_height = (BAR_X - FACE_X) / 2.0;
    let along_x = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2);
    let post = |y| VisualSpec {
        shape: VisualShape::Primitive(Primitive::Cylinder { radius: POST_RADIUS, half_height }),
        pose: Isometry3::from_parts(Translation3::new(FACE_X + half_height, y, 0.0), along_x),
        appearance: STEEL,
    };
    part_visuals.chain([-POST_OFFSET, POST_OFFSET].map(post)).collect()
}

fn along_y(position: [f64; 3]) -> Isometry3<f64> {
    Isometry3::from_parts(position.into(), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2))
}

/// Distance in front of the bar at which a hand starts its approach, in m.
const APPROACH: f64 = 0.3;

/// TCP poses with which an arm pulls a drawer open.
pub(crate) struct DrawerPull {
    /// Pre-grasp pose in front of the bar.
    pub(crate) pre_grasp: Isometry3<f64>,
    /// Grasp pose at the closed drawer.
    pub(crate) grasp: Isometry3<f64>,
    /// Grasp pose at the open drawer.
    pub(crate) open: Isometry3<f64>,
}

impl DrawerPull {
    /// Plans to pull a drawer by `by_m` m, grasping the middle of its bar from above and below. Of the two
    /// possible closing directions it takes the one nearer to `closing`, and of the angles in `leans_rad`, by
    /// which the hand leans to the side of its own arm, the first that is within reach.
    pub(crate) fn new(
        scene: &Scene,
        arm: usize,
        drawer: &Body,
        by_m: f64,
        closing: &Vector3<f64>,
        leans_rad: [f64; 5],
    ) -> Self {
        let out = drawer.pose.rotation * Vector3::x();
        let bar = drawer.pose * Point3::new(BAR_X, 0.0, 0.0);
        let closing = grasp::closest_closing(Vector3::z(), closing);
        let straight = grasp::pose(&bar.coords, &-out, &closing);
        let candidates = leans_rad.map(|lean| grasp::tilted_toward_base(scene, arm, &straight, lean));
        let waypoints = |tcp: &Isometry3<f64>| {
            [grasp::retreated(tcp, APPROACH), *tcp, grasp::translated(tcp, &(out * by_m))]
        };
        let tcp = grasp::first_reachable(scene, arm, &candidates, waypoints);
        let [pre_grasp, grasp, open] = waypoints(&tcp);
        Self { pre_grasp, grasp, open }
    }
}
