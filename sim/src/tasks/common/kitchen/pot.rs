//! The cooking pot of DualArmLiftPot and DualArmPourPot, which both arms grasp by its two handles. See
//! docs/benchmark.md, "Scenes and objects".

use core::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::expert::grasp;
use crate::tasks::common::{BIMANUAL_TABLE_Z, box_part, movable, rgb};
use scene::{
    AppearanceSpec, BodySpec, Mass, PartSpec, Primitive, RenderParts, ScaleAxes, Scene, VisualShape,
    VisualSpec,
};

/// Initial joint positions of both arms in rad: the hands are level, on either side of the pot and facing it.
pub(crate) const QPOS: [[f64; 7]; 2] =
    [[0.599, 0.4, -0.561, -2.511, 1.695, 1.395, -0.479], [2.358, 0.442, 0.697, -2.513, -1.775, 1.347, 2.031]];

/// World z of the pot's origin at the start in m, 22 mm above its rest.
const START_Z: f64 = 0.85;
/// Height of the base and of the rim above the origin, in m.
const BASE_Z: f64 = -0.0033;
const RIM_Z: f64 = 0.1783;
/// Height of the floor above the origin, in m.
pub(crate) const FLOOR_Z: f64 = 0.012;
/// Radius of the base, on which the pot stands, in m.
const BASE_RADIUS: f64 = 0.144;
/// Distances of the wall's inner and outer faces from the axis in m. Circles of radius 0.138 and 0.1535 have
/// the same mean distance as the faces.
const WALL: [f64; 2] = [0.137, 0.1524];
/// Number of boxes that form the wall.
const N_WALLS: u32 = 16;

/// Distance of the middle of a handle's bar from the axis, in m.
const BAR_Y: f64 = 0.1769;
/// Height of the middle of the bars above the origin, in m.
const BAR_Z: f64 = 0.14205;
/// Half-extents of a bar, in m.
const BAR_HALF: [f64; 3] = [0.037, 0.0065, 0.00725];
/// Range of distance along a bar at which its stems lie, in m.
const STEM_X: [f64; 2] = [0.022, 0.039];
/// Radius of the rods from which the visual handles are made, in m.
const ROD_RADIUS: f64 = 0.005;

/// Appearance of the pot where it is painted.
pub(crate) const PAINTED: AppearanceSpec =
    AppearanceSpec { specular: 0.5, ..AppearanceSpec::plain(rgb([129, 133, 137])) };
/// Appearance of the pot elsewhere: that of a mesh without a material, which the benchmark's renderer takes
/// for a white metal.
pub(crate) const UNPAINTED: AppearanceSpec = AppearanceSpec::metal([1.0; 3]);

/// Creates the pot on the bimanual table, a straight cylinder with two handles on its y axis. Its frame has z
/// up along the pot's axis, whereas the benchmark's has y up: y and z here are its x and y. Mass, centre and
/// moments of inertia are those of the benchmark's collision shapes, whose walls are 16 mm thick, unlike the
/// visible ones.
pub(crate) fn pot(region: usize, appearance: AppearanceSpec) -> BodySpec {
    let floor = Primitive::Cylinder { radius: BASE_RADIUS, half_height: (FLOOR_Z - BASE_Z) / 2.0 };
    let floor = PartSpec::at(floor, [0.0, 0.0, f64::midpoint(BASE_Z, FLOOR_Z)], appearance);
    let sides = [-1.0, 1.0];
    let handles = sides.into_iter().flat_map(|side| handle(side, appearance));
    let mut visuals =
        vec![VisualSpec::at(VisualShape::Lathe { profile: PROFILE.to_vec() }, [0.0; 3], appearance)];
    visuals.extend(sides.into_iter().flat_map(|side| visible_handle(side, appearance)));
    let parts = (0..N_WALLS).map(|i| wall(i, appearance)).chain([floor]).chain(handles).collect();
    let body = BodySpec {
        visuals,
        render_parts: RenderParts::Single,
        scale_axes: ScaleAxes::Independent,
        mass: Mass::Measured { kg: 3.449, centre: [0.0, 0.0013, 0.0654], inertia: [0.0439, 0.0409, 0.0622] },
        ..movable("pot", parts, region, BIMANUAL_TABLE_Z)
    };
    body.with_origin_z(START_Z)
}

/// Visible profile of the pot, (radius, height) in m: a sheet of 2 mm with two ridges around the outside, and
/// a thicker floor.
const PROFILE: [[f64; 2]; 21] = [
    [0.0, -0.002],
    [0.1425, -0.002],
    [0.1478, 0.001],
    [0.1502, 0.007],
    [0.1513, 0.1225],
    [0.1527, 0.1245],
    [0.1527, 0.1265],
    [0.1514, 0.1285],
    [0.1518, 0.1570],
    [0.1532, 0.1590],
    [0.1532, 0.1610],
    [0.1520, 0.1630],
    [0.1526, 0.1755],
    [0.1520, 0.1768],
    [0.1508, 0.1772],
    [0.1496, 0.1768],
    [0.1490, 0.1755],
    [0.1484, 0.0150],
    [0.1465, 0.0110],
    [0.1425, 0.0090],
    [0.0, 0.0085],
];

/// Creates the `i`-th box of the wall. The wall ends above the base, whose edge is rounded.
fn wall(i: u32, appearance: AppearanceSpec) -> PartSpec {
    let [inner, outer] = WALL;
    let step = TAU / f64::from(N_WALLS);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::from(i) * step);
    let lowest = BASE_Z + 0.003;
    let half = [(outer - inner) / 2.0, outer * libm::tan(step / 2.0), (RIM_Z - lowest) / 2.0];
    let centre = turn * Vector3::new(f64::midpoint(inner, outer), 0.0, f64::midpoint(lowest, RIM_Z));
    PartSpec { shape: Primitive::Box { half }, pose: Isometry3::from_parts(centre.into(), turn), appearance }
}

/// Creates a handle: a bar along x with two stems.
fn handle(side: f64, appearance: AppearanceSpec) -> [PartSpec; 3] {
    let [_, half_y, half_z] = BAR_HALF;
    let [near, far] = STEM_X;
    // The stems end inside the wall.
    let [from, to] = [WALL[1] - 0.008, BAR_Y + half_y];
    let stem = |sign: f64| {
        let centre = [sign * f64::midpoint(near, far), side * f64::midpoint(from, to), BAR_Z];
        box_part([(far - near) / 2.0, (to - from) / 2.0, half_z], centre, appearance)
    };
    [box_part(BAR_HALF, [0.0, side * BAR_Y, BAR_Z], appearance), stem(-1.0), stem(1.0)]
}

/// Creates the visible handle: a rod along x and two rods to the wall.
fn visible_handle(side: f64, appearance: AppearanceSpec) -> [VisualSpec; 3] {
    let rod = |half_height, position: [f64; 3], axis| {
        let turned = UnitQuaternion::from_axis_angle(&axis, FRAC_PI_2);
        let pose = Isometry3::from_parts(Translation3::from(position), turned);
        let shape = VisualShape::Primitive(Primitive::Capsule { radius: ROD_RADIUS, half_height });
        VisualSpec { shape, pose, appearance }
    };
    let (half_length, wall) = (f64::midpoint(STEM_X[0], STEM_X[1]), WALL[1] - 0.004);
    let stem = |x| {
        let centre = [x, side * f64::midpoint(wall, BAR_Y), BAR_Z];
        rod((BAR_Y - wall) / 2.0, centre, Vector3::x_axis())
    };
    [rod(half_length, [0.0, side * BAR_Y, BAR_Z], Vector3::y_axis()), stem(-half_length), stem(half_length)]
}

/// Distance of the pre-grasp poses from the handles, in m.
const APPROACH: f64 = 0.1;

/// Returns the grasp poses of both arms at the handles: level, with the fingers closing from above and below
/// in the direction nearest to their start.
pub(crate) fn grasps(scene: &Scene) -> [Isometry3<f64>; 2] {
    let pot = scene.body("pot");
    [0, 1].map(|arm| {
        let side = [-1.0, 1.0][arm];
        let bar = pot.point([0.0, side * BAR_Y, BAR_Z]);
        let inwards = pot.pose.rotation * Vector3::y() * -side;
        let closing = grasp::closest_closing(Vector3::z(), &grasp::start_closing(scene, arm));
        grasp::pose(&bar.coords, &inwards, &closing)
    })
}

/// Returns the pre-grasp pose of a grasp pose.
pub(crate) fn pre_grasp(grasp: &Isometry3<f64>) -> Isometry3<f64> {
    grasp::retreated(grasp, APPROACH)
}
