//! Furniture that is opened: a carcass of panels that stands fast, and drawers and doors with bar handles in it
//! (spec/tasks.md §2, tasks 13 to 15). It faces −x.

use core::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::{SINGLE_TABLE_Z, box_part, fixed};
use crate::expert::{Move, grasp};
use crate::scene::{
    AppearanceSpec, BodySpec, JointKind, JointSpec, Motion, PartSpec, PlacementSpec, Primitive, Range, Role,
    Scene, Texture,
};

/// A piece of furniture. Its origin is on the ground, midway between its sides. Lengths in m.
struct Cabinet {
    /// x of the outer faces of drawers and doors.
    front_x: f64,
    /// Depth of the carcass, without what is before it.
    depth: f64,
    /// Half the width over all.
    half_width: f64,
    /// Height over all.
    height: f64,
    /// Look of the carcass.
    carcass_paint: AppearanceSpec,
    /// Look of drawers and doors.
    front_paint: AppearanceSpec,
}

/// Index of the carcass among a scene's bodies: it comes first, and what opens is placed with it.
const CARCASS: usize = 0;
/// Index of the region it is placed in.
const REGION: usize = 0;
/// Thickness of the carcass's panels and of fronts, in m.
const PANEL: f64 = 0.018;
/// Thickness of a drawer's floor and sides, in m.
const THIN: f64 = 0.008;
/// Height of the middle of a drawer's floor over its front's lower edge, in m.
const FLOOR: f64 = 0.018;
/// Gap around fronts, in m.
const GAP: f64 = 0.003;
/// Height of the plinth and how far it is set back, in m.
const PLINTH: [f64; 2] = [0.03, 0.03];
/// Distance from a front's outer face to the middle of its handle's bar, in m.
const STAND_OFF: f64 = 0.035;
/// Radius of a handle's bar and half the distance of its posts, in m.
const BAR: [f64; 2] = [0.007, 0.045];
const STEEL: AppearanceSpec = AppearanceSpec { specular: 0.9, ..AppearanceSpec::plain([0.72, 0.73, 0.75]) };
/// Look of what is behind a drawer's front.
const BOX_PAINT: AppearanceSpec = AppearanceSpec::plain([0.84, 0.72, 0.53]);
const OFF_WHITE: AppearanceSpec = AppearanceSpec::plain([0.93, 0.92, 0.89]);
const PLINTH_PAINT: AppearanceSpec = AppearanceSpec::plain([0.13, 0.12, 0.11]);
/// Coefficient of all surfaces.
const FRICTION: f64 = 1.0;
/// How drawers run, but for how far: steadily when pulled, and no farther when let go.
const SLIDE: JointSpec =
    JointSpec { kind: JointKind::Slide, axis: [1.0, 0.0, 0.0], upper: 0.0, damping: 50.0, friction: 1.0 };
/// How doors turn: about the upright on their frame's origin, to a right angle.
const HINGE: JointSpec = JointSpec {
    kind: JointKind::Hinge,
    axis: [0.0, 0.0, -1.0],
    upper: FRAC_PI_2,
    damping: 2.0,
    friction: 0.2,
};
/// Why no size perturbation scales it.
const WHY_NOT_SCALED: &str = "it is furniture, neither manipulated nor a receiver";

impl Cabinet {
    /// The carcass, on the single-arm table, with boards at these heights between its floor and its top.
    fn carcass(&self, boards_z: &[f64]) -> BodySpec {
        let Self { front_x, depth, half_width, height, carcass_paint: appearance, .. } = *self;
        let [plinth_height, set_back] = PLINTH;
        let (half_depth, half_height) = (depth / 2.0, (height - plinth_height - PANEL) / 2.0);
        let (middle_x, middle_z) = (front_x + PANEL + GAP + half_depth, plinth_height + half_height);
        let half_panel = PANEL / 2.0;
        let side = |y| box_part([half_depth, half_panel, half_height], [middle_x, y, middle_z], appearance);
        let board =
            |z| box_part([half_depth, half_width - PANEL, half_panel], [middle_x, 0.0, z], appearance);
        // The top covers the fronts.
        let top_half = [half_depth + (PANEL + GAP) / 2.0, half_width, half_panel];
        let mut parts = vec![
            side(half_width - half_panel),
            side(half_panel - half_width),
            box_part(top_half, [middle_x - (PANEL + GAP) / 2.0, 0.0, height - half_panel], appearance),
            box_part(
                [half_panel, half_width - PANEL, half_height],
                [middle_x + half_depth - half_panel, 0.0, middle_z],
                appearance,
            ),
            box_part(
                [half_depth - set_back, half_width - set_back, plinth_height / 2.0],
                [middle_x, 0.0, plinth_height / 2.0],
                PLINTH_PAINT,
            ),
            board(plinth_height + half_panel),
        ];
        parts.extend(boards_z.iter().map(|z| board(*z)));
        BodySpec {
            role: Role::Fixture,
            friction: FRICTION,
            ..fixed("cabinet", parts, REGION, SINGLE_TABLE_Z, WHY_NOT_SCALED)
        }
    }

    /// A drawer over the whole width: an open box behind a front of this half height, whose middle is `z` above the
    /// ground. Its frame is in the middle of the handle's bar, x out of the cabinet.
    fn drawer(&self, name: &'static str, z: f64, half_height: f64, travel: f64) -> BodySpec {
        let length = self.depth - 2.0 * PANEL;
        let (half_length, half_thin) = (length / 2.0, THIN / 2.0);
        // The box is narrower than the room between the panels, and lower than its front.
        let (half_width, half_wall) = (self.half_width - PANEL - GAP, 0.7 * half_height);
        let floor_z = FLOOR - half_height;
        let (back_x, middle_x) = (-STAND_OFF - PANEL, -STAND_OFF - PANEL - half_length);
        let wall_z = floor_z + half_wall;
        let wall = |y| box_part([half_length, half_thin, half_wall], [middle_x, y, wall_z], BOX_PAINT);
        let mut parts = vec![
            box_part(
                [PANEL / 2.0, self.half_width - GAP, half_height - GAP],
                [-STAND_OFF - PANEL / 2.0, 0.0, 0.0],
                self.front_paint,
            ),
            box_part([half_length, half_width, half_thin], [middle_x, 0.0, floor_z], BOX_PAINT),
            wall(half_width - half_thin),
            wall(half_thin - half_width),
            box_part(
                [half_thin, half_width, half_wall],
                [back_x - length + half_thin, 0.0, wall_z],
                BOX_PAINT,
            ),
        ];
        let level = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
        parts.extend(handle(&Vector3::zeros(), &level));
        let place = Vector3::new(self.front_x - STAND_OFF, 0.0, z);
        jointed(name, parts, place, JointSpec { upper: travel, ..SLIDE })
    }

    /// A door over the whole width between two heights, hung on its +y side, with an upright handle at these y and z. Its frame is on the hinge at the handle's height, x out of the cabinet and y along the closed door.
    fn door(&self, name: &'static str, [bottom, top]: [f64; 2], [handle_y, handle_z]: [f64; 2]) -> BodySpec {
        let half_width = self.half_width - GAP;
        let panel = box_part(
            [PANEL / 2.0, half_width, (top - bottom) / 2.0 - GAP],
            [PANEL / 2.0, half_width, (bottom + top) / 2.0 - handle_z],
            self.front_paint,
        );
        let mut parts = vec![panel];
        let bar = Vector3::new(PANEL + STAND_OFF, half_width - handle_y, 0.0);
        parts.extend(handle(&bar, &UnitQuaternion::identity()));
        jointed(name, parts, Vector3::new(self.front_x + PANEL, half_width, handle_z), HINGE)
    }
}

/// A body that opens, placed with the carcass, its x out of the cabinet.
fn jointed(name: &'static str, parts: Vec<PartSpec>, place: Vector3<f64>, joint: JointSpec) -> BodySpec {
    let out = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
    BodySpec {
        role: Role::Fixture,
        motion: Motion::Jointed(joint),
        placement: PlacementSpec::RelativeTo {
            body: CARCASS,
            pose: Isometry3::from_parts(place.into(), out),
        },
        friction: FRICTION,
        ..fixed(name, parts, REGION, SINGLE_TABLE_Z, WHY_NOT_SCALED)
    }
}

/// A bar with its middle at `middle`, on two posts from a front that faces x; `along` turns z along the bar.
fn handle(middle: &Vector3<f64>, along: &UnitQuaternion<f64>) -> [PartSpec; 3] {
    let [radius, half_length] = BAR;
    let placed = |shape, offset: Vector3<f64>| PartSpec {
        shape,
        pose: Isometry3::from_parts(Translation3::from(middle + along * offset), *along),
        appearance: STEEL,
    };
    let post = |side: f64| {
        // Thinner than the bar.
        let half = [STAND_OFF / 2.0, 0.7 * radius, 0.7 * radius];
        placed(Primitive::Box { half }, Vector3::new(-STAND_OFF / 2.0, 0.0, side * half_length))
    };
    let bar = Primitive::Capsule { radius, half_height: half_length + radius };
    [placed(bar, Vector3::zeros()), post(1.0), post(-1.0)]
}

/// Where a hand that comes straight at the closed drawer takes its handle, closing upwards and downwards.
pub(in crate::tasks) fn drawer_grip(scene: &Scene) -> Isometry3<f64> {
    let handle = scene.body("drawer").pose;
    let closing = grasp::closest_closing(Vector3::z(), &grasp::start_closing(scene, 0));
    grasp::pose(&handle.translation.vector, &-(handle.rotation * Vector3::x()), &closing)
}

/// Pulls the drawer open by its handle, which is taken at `tcp`, and lets go of it.
pub(in crate::tasks) fn pull_open(scene: &Scene, tcp: Isometry3<f64>, by_m: f64) -> Vec<Move> {
    let out = scene.body("drawer").pose.rotation * Vector3::x();
    // Not opened once more before the handle, as in the benchmark: the longest plans would outlast the episode.
    vec![
        Move::open(&[0], 6),
        Move::straight(0, grasp::retreated(&tcp, 0.05)),
        Move::straight(0, tcp),
        Move::close(&[0], 6),
        Move::straight(0, grasp::translated(&tcp, &(out * by_m))),
        Move::open(&[0], 6),
    ]
}

/// How far the drawer of [`drawer_over_door`] opens, in m.
pub(in crate::tasks) const DRAWER_TRAVEL: f64 = 0.3;
/// Where the handle of its closed door is in the cabinet's frame, in m.
pub(in crate::tasks) const DOOR_HANDLE: Point3<f64> = Point3::new(-0.207, -0.161, 0.365);

/// The cabinet of OpenDrawer and OpenCabinet, turned by an angle of this range, in rad: a drawer over a door.
pub(in crate::tasks) fn drawer_over_door(yaw: Range) -> Vec<BodySpec> {
    const DOOR_TOP_Z: f64 = 0.42;
    let cabinet = Cabinet {
        front_x: DOOR_HANDLE.x + STAND_OFF,
        depth: 0.4,
        half_width: 0.19,
        height: 0.6,
        carcass_paint: AppearanceSpec::textured(Texture::Walnut, [0.85, 0.72, 0.6]),
        front_paint: OFF_WHITE,
    };
    vec![
        cabinet.carcass(&[DOOR_TOP_Z]).with_yaw(yaw),
        cabinet.drawer("drawer", 0.5, 0.078, DRAWER_TRAVEL),
        cabinet.door("door", [PLINTH[0], DOOR_TOP_Z], [DOOR_HANDLE.y, DOOR_HANDLE.z]),
    ]
}

/// How far the drawers of [`chest_of_drawers`] open, in m.
pub(in crate::tasks) const CHEST_TRAVEL: f64 = 0.36;

/// The cabinet of PlaceCubeInDrawer, which faces y: the middle one of its three drawers is the one to open.
pub(in crate::tasks) fn chest_of_drawers() -> Vec<BodySpec> {
    /// How far before the origin the handles are, in m. The spec infers 0.346, but with that the nearest chests would
    /// stand in the fingers at the start.
    const HANDLES: f64 = 0.25;
    let chest = Cabinet {
        front_x: STAND_OFF - HANDLES,
        depth: 0.45,
        half_width: 0.2,
        height: 0.428,
        carcass_paint: AppearanceSpec::textured(Texture::Wood, [0.55, 0.38, 0.25]),
        front_paint: OFF_WHITE,
    };
    vec![
        chest.carcass(&[]).with_yaw(Range::fixed(-FRAC_PI_2)),
        chest.drawer("lower drawer", 0.115, 0.083, CHEST_TRAVEL),
        chest.drawer("drawer", 0.251, 0.052, CHEST_TRAVEL),
        chest.drawer("upper drawer", 0.355, 0.052, CHEST_TRAVEL),
    ]
}
