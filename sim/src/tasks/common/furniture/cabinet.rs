//! Cabinets whose drawers and doors have bar handles: a fixed carcass of panels that faces −x, with jointed
//! drawers and doors. See docs/benchmark.md, "Scenes and objects".

use core::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::expert::grasp;
use crate::tasks::common::{SINGLE_TABLE_Z, box_part, fixed, srgb};
use scene::{
    AppearanceSpec, BodySpec, JointKind, JointSpec, Motion, PartSpec, PlacementSpec, Primitive, Range, Role,
    Scene, Texture,
};

/// Dimensions and appearance of a cabinet. Its origin is on the ground, midway between its sides. Lengths in
/// m.
struct Cabinet {
    /// x of the outer faces of drawers and doors in the cabinet's frame.
    front_x: f64,
    /// Depth of the carcass behind the drawer and door fronts.
    depth: f64,
    /// Half of the overall width.
    half_width: f64,
    /// Overall height, plinth included.
    height: f64,
    /// Appearance of the carcass panels.
    carcass_paint: AppearanceSpec,
    /// Appearance of the drawer and door fronts.
    front_paint: AppearanceSpec,
}

/// Index of the carcass among the scene's bodies. Drawers and doors are placed relative to it.
const CARCASS: usize = 0;
/// Index of the carcass's placement region.
const REGION: usize = 0;
/// Thickness of carcass panels and of drawer and door fronts, in m.
const PANEL: f64 = 0.018;
/// Thickness of a drawer's bottom and sides, in m.
const THIN: f64 = 0.008;
/// Height of the centre of a drawer's bottom above the lower edge of its front, in m.
const DRAWER_BOTTOM_Z: f64 = 0.018;
/// Gap around each front, in m.
const GAP: f64 = 0.003;
/// Height of the plinth and its setback from the carcass, in m.
const PLINTH: [f64; 2] = [0.03, 0.03];
/// Distance between a front's outer face and the axis of its handle's bar, in m.
const HANDLE_STANDOFF: f64 = 0.035;
/// Radius of a handle's bar and half of the distance between its posts, in m.
const BAR: [f64; 2] = [0.007, 0.045];
const STEEL: AppearanceSpec =
    AppearanceSpec { specular: 0.9, ..AppearanceSpec::plain(srgb([184, 186, 191])) };
/// Appearance of a drawer's box, behind the front.
const BOX_PAINT: AppearanceSpec = AppearanceSpec::plain(srgb([214, 184, 135]));
const OFF_WHITE: AppearanceSpec = AppearanceSpec::plain(srgb([237, 235, 227]));
const PLINTH_PAINT: AppearanceSpec = AppearanceSpec::plain(srgb([33, 31, 28]));
/// Friction coefficient of all surfaces.
const FRICTION: f64 = 1.0;
/// Joint of a drawer; `upper` is set per drawer. Nothing but friction slows it, as in the benchmark.
const SLIDE: JointSpec =
    JointSpec { kind: JointKind::Slide, axis: [1.0, 0.0, 0.0], upper: 0.0, damping: 0.0, friction: 0.05 };
/// Joint of a door, about the vertical through its origin, up to 90°.
const HINGE: JointSpec = JointSpec {
    kind: JointKind::Hinge,
    axis: [0.0, 0.0, -1.0],
    upper: FRAC_PI_2,
    damping: 0.0,
    friction: 0.05,
};
/// Reason for which no size perturbation scales the cabinet.
const REASON_NOT_SCALED: &str = "it is furniture, neither manipulated nor a receiver";

impl Cabinet {
    /// Creates the carcass on the single-arm table, with shelves at the given heights between bottom and top
    /// panel.
    fn carcass(&self, shelves_z: &[f64]) -> BodySpec {
        let Self { front_x, depth, half_width, height, carcass_paint: appearance, .. } = *self;
        let [plinth_height, setback] = PLINTH;
        let (half_depth, half_height) = (depth / 2.0, (height - plinth_height - PANEL) / 2.0);
        let (middle_x, middle_z) = (front_x + PANEL + GAP + half_depth, plinth_height + half_height);
        let half_panel = PANEL / 2.0;
        let side = |y| box_part([half_depth, half_panel, half_height], [middle_x, y, middle_z], appearance);
        let shelf =
            |z| box_part([half_depth, half_width - PANEL, half_panel], [middle_x, 0.0, z], appearance);
        // The top panel also covers the fronts.
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
                [half_depth - setback, half_width - setback, plinth_height / 2.0],
                [middle_x, 0.0, plinth_height / 2.0],
                PLINTH_PAINT,
            ),
            shelf(plinth_height + half_panel),
        ];
        parts.extend(shelves_z.iter().map(|z| shelf(*z)));
        BodySpec {
            role: Role::Fixture,
            friction: FRICTION,
            ..fixed("cabinet", parts, REGION, SINGLE_TABLE_Z, REASON_NOT_SCALED)
        }
    }

    /// Creates a drawer over the full width: an open box behind a front of the given half-height, centred `z`
    /// above the ground. The body's origin is the centre of the handle's bar; its x axis points out of the
    /// cabinet.
    fn drawer(&self, name: &'static str, z: f64, half_height: f64, travel: f64) -> BodySpec {
        let length = self.depth - 2.0 * PANEL;
        let (half_length, half_thin) = (length / 2.0, THIN / 2.0);
        // The box is narrower than the space between the side panels and lower than its front.
        let (half_width, half_wall) = (self.half_width - PANEL - GAP, 0.7 * half_height);
        let floor_z = DRAWER_BOTTOM_Z - half_height;
        let (back_x, middle_x) = (-HANDLE_STANDOFF - PANEL, -HANDLE_STANDOFF - PANEL - half_length);
        let wall_z = floor_z + half_wall;
        let wall = |y| box_part([half_length, half_thin, half_wall], [middle_x, y, wall_z], BOX_PAINT);
        let mut parts = vec![
            box_part(
                [PANEL / 2.0, self.half_width - GAP, half_height - GAP],
                [-HANDLE_STANDOFF - PANEL / 2.0, 0.0, 0.0],
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
        let place = Vector3::new(self.front_x - HANDLE_STANDOFF, 0.0, z);
        jointed(name, parts, place, JointSpec { upper: travel, ..SLIDE })
    }

    /// Creates a door over the full width between two heights, hinged on its +y side, with a vertical handle
    /// at `handle_y` and `handle_z`. The body's origin is on the hinge at the height of the handle; its x
    /// axis points out of the cabinet and its y axis along the closed door.
    fn door(&self, name: &'static str, [bottom, top]: [f64; 2], [handle_y, handle_z]: [f64; 2]) -> BodySpec {
        let half_width = self.half_width - GAP;
        let panel = box_part(
            [PANEL / 2.0, half_width, (top - bottom) / 2.0 - GAP],
            [PANEL / 2.0, half_width, (bottom + top) / 2.0 - handle_z],
            self.front_paint,
        );
        let mut parts = vec![panel];
        let bar = Vector3::new(PANEL + HANDLE_STANDOFF, half_width - handle_y, 0.0);
        parts.extend(handle(&bar, &UnitQuaternion::identity()));
        jointed(name, parts, Vector3::new(self.front_x + PANEL, half_width, handle_z), HINGE)
    }
}

/// Creates a jointed body placed relative to the carcass, with its x axis pointing out of the cabinet.
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
        ..fixed(name, parts, REGION, SINGLE_TABLE_Z, REASON_NOT_SCALED)
    }
}

/// Creates a bar centred at `middle` on two posts, on a front that faces x; `along` rotates z to the bar's
/// direction.
fn handle(middle: &Vector3<f64>, along: &UnitQuaternion<f64>) -> [PartSpec; 3] {
    let [radius, half_length] = BAR;
    let placed = |shape, offset: Vector3<f64>| PartSpec {
        shape,
        pose: Isometry3::from_parts(Translation3::from(middle + along * offset), *along),
        appearance: STEEL,
    };
    let post = |side: f64| {
        // The posts are thinner than the bar.
        let half = [HANDLE_STANDOFF / 2.0, 0.7 * radius, 0.7 * radius];
        placed(Primitive::Box { half }, Vector3::new(-HANDLE_STANDOFF / 2.0, 0.0, side * half_length))
    };
    let bar = Primitive::Capsule { radius, half_height: half_length + radius };
    [placed(bar, Vector3::zeros()), post(1.0), post(-1.0)]
}

/// Returns the TCP pose at which a hand that approaches the closed drawer head-on grasps its handle, with the
/// fingers above and below the bar.
pub(crate) fn drawer_grasp(scene: &Scene) -> Isometry3<f64> {
    let handle = scene.body("drawer").pose;
    let closing = grasp::closest_closing(Vector3::z(), &grasp::start_closing(scene, 0));
    grasp::pose(&handle.translation.vector, &-(handle.rotation * Vector3::x()), &closing)
}

/// Height of the original cabinet's origin above its foot, in m. The model is not public; this is half the
/// height of ours.
pub(crate) const ORIGIN_Z: f64 = 0.3;
/// Travel of the drawer of [`drawer_over_door`], in m.
pub(crate) const DRAWER_TRAVEL: f64 = 0.3;
/// Position of the closed door's handle in the cabinet's frame, in m.
pub(crate) const DOOR_HANDLE: Point3<f64> = Point3::new(-0.207, -0.161, 0.365);

/// Creates the bodies of the cabinet in OpenDrawer and OpenCabinet, a drawer above a door; `yaw` is in rad.
pub(crate) fn drawer_over_door(yaw: Range) -> Vec<BodySpec> {
    const DOOR_TOP_Z: f64 = 0.42;
    let cabinet = Cabinet {
        front_x: DOOR_HANDLE.x + HANDLE_STANDOFF,
        depth: 0.4,
        half_width: 0.19,
        height: 0.6,
        carcass_paint: AppearanceSpec::textured(Texture::Walnut, srgb([217, 184, 153])),
        front_paint: OFF_WHITE,
    };
    vec![
        cabinet.carcass(&[DOOR_TOP_Z]).with_yaw(yaw),
        cabinet.drawer("drawer", 0.5, 0.078, DRAWER_TRAVEL),
        cabinet.door("door", [PLINTH[0], DOOR_TOP_Z], [DOOR_HANDLE.y, DOOR_HANDLE.z]),
    ]
}
