//! The pen and the cap of DualArmPenCap, both along z, with the cap open at +z. The pen is thicker than the
//! cap's cavity and wedges in it after about 50 mm. See docs/benchmark.md, "Objects".

use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, PI};

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};

use crate::tasks::common::{BIMANUAL_TABLE_Z, box_part, movable, visual_of};
use scene::{
    AppearanceSpec, Body, BodySpec, Mass, PartSpec, Primitive, RenderParts, Role, ScaledBy, VisualShape,
    VisualSpec,
};

/// Neither of the two bodies changes its size.
const NOT_SCALED: ScaledBy = ScaledBy::Nothing("the body that it fits keeps its size");

/// The pen's tip and a point on its axis, in its frame in m.
pub(crate) const PEN_TIP: Point3<f64> = Point3::new(0.0053, -0.0017, -0.1684);
/// Circles (radius, z) of the pen from its tip to its other end, in m.
const PEN: [[f64; 2]; 8] = [
    [0.001, -0.1684],
    [0.007, -0.15],
    [0.0154, -0.12],
    [0.0169, -0.1],
    [0.019, -0.05],
    PEN_SUPPORTS[0],
    PEN_SUPPORTS[1],
    [0.0128, PEN_END],
];
/// z of the pen's end, in m.
const PEN_END: f64 = 0.2268;
/// Circles (radius, z) between which the pen rests and is grasped, in m. Its centre of mass is between them.
const PEN_SUPPORTS: [[f64; 2]; 2] = [[0.0186, 0.0], [0.0146, 0.2]];
/// Half-width and half-thickness of the four flats between these circles, in m. One faces the table, and two
/// face the pads of a hand that closes across the pen. On the facets of the hull alone the pen would roll.
const FLAT: [f64; 2] = [0.003, 0.003];

/// Centre of the cap's opening: a point on the axis of its cavity, in its frame in m.
pub(crate) const CAP_OPENING: Point3<f64> = Point3::new(0.0155, 0.0015, 0.124);
/// z of the cap's closed end and of the bottom of its cavity, in m.
const CAP_Z: [f64; 2] = [-0.0629, -0.0557];
/// Radius of the largest circle in the cavity, which has five sides, in m.
const CAVITY_RADIUS: f64 = 0.0157;
/// Axis (x, y) and radius of the cap's outside, in m.
const OUTSIDE: ([f64; 2], f64) = ([0.0161, 0.0024], 0.0277);
/// Minimum and maximum x, y and z of the cap's clip, in m.
const CLIP: [[f64; 2]; 3] = [[0.0424, 0.0575], [-0.0207, 0.0024], [-0.0537, 0.106]];
/// x and y of the middle between the outer faces of the clip and of the wall opposite to it, in m.
pub(crate) const CAP_MIDDLE: [f64; 2] = [0.023, 0.0024];
/// Angle by which the cap rolls from its start onto its clip, in rad.
const CAP_ROLL: f64 = 0.11;

const BLACK: AppearanceSpec = AppearanceSpec { specular: 0.6, ..AppearanceSpec::plain([0.01; 3]) };
const SILVER: AppearanceSpec = AppearanceSpec { specular: 0.6, ..AppearanceSpec::plain([0.5; 3]) };

/// Half of the angle between neighbouring facets of the pen's hull, which has 24: with it, facets instead of
/// edges lie under the flats.
const HALF_FACET: f64 = PI / 24.0;

/// Creates the pen.
pub(crate) fn pen(region: usize) -> BodySpec {
    let axis = Translation3::new(PEN_TIP.x, PEN_TIP.y, 0.0);
    let [[front, front_z], [rear, rear_z]] = PEN_SUPPORTS;
    let [width, thickness] = FLAT;
    let facets = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), HALF_FACET);
    let hull = PartSpec { shape: Primitive::revolution(&PEN), pose: axis * facets, appearance: SILVER };
    let flat = |quarter: u32| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::from(quarter) * FRAC_PI_2);
        let middle = Translation3::new(0.0, -(front + rear) / 2.0, (front_z + rear_z) / 2.0);
        let tilt = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -pen_taper());
        let half_length = libm::hypot(front - rear, rear_z - front_z) / 2.0;
        PartSpec {
            shape: Primitive::Box { half: [width, thickness, half_length] },
            pose: axis * turn * middle * tilt * Translation3::new(0.0, thickness, 0.0),
            appearance: SILVER,
        }
    };
    let parts = core::iter::once(hull).chain((0..4).map(flat)).collect();
    let lathe = |profile: &[[f64; 2]], appearance| {
        let [x, y] = [PEN_TIP.x, PEN_TIP.y];
        VisualSpec::at(VisualShape::Lathe { profile: profile.to_vec() }, [x, y, 0.0], appearance)
    };
    // The pen as it is seen is slimmer than its hull.
    let barrel = [[0.0, -0.05], [0.0145, -0.05], [0.013, 0.205], [0.0, 0.205]];
    let rear = [[0.0, 0.205], [0.0125, 0.205], [0.012, PEN_END], [0.0, PEN_END]];
    let section = [[0.0, -0.12], [0.011, -0.12], [0.0135, -0.1], [0.0145, -0.05], [0.0, -0.05]];
    let nib = [[0.0, PEN_TIP.z], [0.0025, -0.16], [0.004, -0.15], [0.0075, -0.12], [0.0, -0.12]];
    BodySpec {
        mass: Mass::Measured { kg: 0.33, centre: [0.0059, -0.0016, 0.0326], inertia: [3.3e-3, 3.3e-3, 5e-5] },
        visuals: vec![
            lathe(&barrel, SILVER),
            lathe(&rear, BLACK),
            lathe(&section, BLACK),
            lathe(&nib, SILVER),
        ],
        ..lying("pen", parts, region)
    }
}

/// Creates the cap: five walls around the cavity, its bottom, and a clip on one side.
pub(crate) fn cap(region: usize) -> BodySpec {
    let ([x, y], outer) = OUTSIDE;
    let [closed, bottom] = CAP_Z;
    let open = CAP_OPENING.z;
    let rod = |radius, [from, to]: [f64; 2], appearance| {
        let shape = Primitive::Cylinder { radius, half_height: (to - from) / 2.0 };
        PartSpec::at(shape, [CAP_OPENING.x, CAP_OPENING.y, (from + to) / 2.0], appearance)
    };
    let clip = |[[x0, x1], [y0, y1], [z0, z1]]: [[f64; 2]; 3]| {
        let half = [x1 - x0, y1 - y0, z1 - z0].map(|extent| extent / 2.0);
        box_part(half, [(x0 + x1) / 2.0, (y0 + y1) / 2.0, (z0 + z1) / 2.0], SILVER)
    };
    let wall = |shape| PartSpec::at(shape, [0.0; 3], BLACK);
    let mut parts: Vec<PartSpec> = cavity_walls().map(wall).collect();
    parts.extend([rod(CAVITY_RADIUS, CAP_Z, BLACK), clip(CLIP)]);
    // The walls as they are seen are thin and round.
    let (seen_outer, seen_inner) = (outer - 0.0015, 0.0215);
    let profile = [
        [0.0, closed + 0.002],
        [0.8 * seen_outer, closed + 0.002],
        [seen_outer, closed + 0.01],
        [seen_outer, open],
        [seen_inner, open],
        [seen_inner, bottom],
        [0.0, bottom],
    ];
    let [[clip_inside, clip_outside], across, [low, high]] = CLIP;
    BodySpec {
        role: Role::ReceiverObject,
        mass: Mass::Measured {
            kg: 0.2955,
            centre: [0.0221, 0.0011, 0.0295],
            inertia: [8.9e-4, 9.3e-4, 1.7e-4],
        },
        visuals: vec![
            VisualSpec::at(VisualShape::Lathe { profile: profile.to_vec() }, [x, y, 0.0], BLACK),
            visual_of(&clip([[clip_outside - 0.004, clip_outside], across, [low, high]])),
            visual_of(&clip([[clip_inside - 0.003, clip_outside], across, [high - 0.012, high]])),
        ],
        ..lying("cap", parts, region)
    }
}

/// Returns the five walls of the cap, each the hull of a side of the cavity and an arc of the outside.
fn cavity_walls() -> impl Iterator<Item = Primitive> {
    /// Angles of a wall and between neighbouring edges of the outside, in rad.
    const WALL: f64 = 2.0 * PI / 5.0;
    const EDGE: f64 = WALL / 3.0;
    /// Angle at which the first wall begins, in rad. The outside has an edge there, on which the cap stands
    /// at its start.
    const FIRST: f64 = -PI / 2.0;
    let point = |[x, y]: [f64; 2], radius: f64, angle: f64| {
        let (sin, cos) = libm::sincos(angle);
        [x + radius * cos, y + radius * sin]
    };
    let corner = CAVITY_RADIUS / libm::cos(WALL / 2.0);
    (0..5).map(move |wall| {
        let start = FIRST + WALL * f64::from(wall);
        let inside = [start, start + WALL].map(|angle| point([CAP_OPENING.x, CAP_OPENING.y], corner, angle));
        let outside = (0..4).map(|edge| point(OUTSIDE.0, OUTSIDE.1, start + EDGE * f64::from(edge)));
        let outline = inside.into_iter().chain(outside);
        Primitive::Hull {
            points: outline.flat_map(|[x, y]| [CAP_Z[0], CAP_OPENING.z].map(|z| [x, y, z])).collect(),
        }
    })
}

/// Returns the angle between the pen's axis and its flats, in rad.
fn pen_taper() -> f64 {
    let [[front, front_z], [rear, rear_z]] = PEN_SUPPORTS;
    libm::atan2(front - rear, rear_z - front_z)
}

/// Returns the world pose of the pen at rest. It lies on a flat, so that its rear is lower than its tip.
pub(crate) fn resting_pen(pen: &Body) -> Isometry3<f64> {
    let [front, _] = PEN_SUPPORTS[0];
    let lowest = pen.aabb(&Isometry3::identity()).min.y;
    let tilt = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), pen_taper());
    let landed = Translation3::new(0.0, lowest, 0.0);
    pen.resting_pose() * landed * tilt * Translation3::new(0.0, front - PEN_TIP.y, 0.0)
}

/// Returns the world pose of the cap at rest. It rolls about the edge below its axis, because its centre of
/// mass lies towards the clip.
pub(crate) fn resting_cap(cap: &Body) -> Isometry3<f64> {
    let ([x, y], radius) = OUTSIDE;
    let edge = Translation3::new(x, y - radius, 0.0);
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -CAP_ROLL);
    cap.resting_pose() * edge * rotation * edge.inverse()
}

/// Creates a body that lies with its z axis along world y and its y axis up.
fn lying(name: &'static str, parts: Vec<PartSpec>, region: usize) -> BodySpec {
    let along_y = Quaternion::new(0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2);
    let body = movable(name, parts, region, BIMANUAL_TABLE_Z);
    BodySpec {
        scaled_by: NOT_SCALED,
        render_parts: RenderParts::Single,
        ..body.with_orientation(UnitQuaternion::from_quaternion(along_y))
    }
}
