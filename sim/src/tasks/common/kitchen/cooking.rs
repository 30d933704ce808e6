//! The stove and the frying pan. See docs/benchmark.md, "Scenes and objects".

use core::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, PI, TAU};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::expert::{Move, TcpGoal, grasp};
use crate::tasks::common::{SINGLE_TABLE_Z, box_part, movable, srgb};
use scene::{
    AppearanceSpec, BodySpec, Mass, Motion, PartSpec, Primitive, RenderParts, Role, ScaleAxes, ScaledBy,
    Scene, VisualShape, VisualSpec,
};

/// World z of the stove's origin, in m.
const STOVE_Z: f64 = 0.0011;
/// Opposite corners of the two boxes that the stove consists of when it collides, the upper one last, in its
/// own frame, in m. They have no burners and stand out a few millimetres beyond the visible stove.
pub(crate) const STOVE_BOXES: [[[f64; 3]; 2]; 2] =
    [[[-0.140, -0.265, 0.0], [0.1705, 0.178, 0.031]], [[-0.142, -0.2685, 0.031], [0.189, 0.1815, 0.051]]];
/// Opposite corners of the visible stove's bounding box, in m.
const STOVE: [[f64; 3]; 2] = [[-0.139, -0.265, 0.0], [0.186, 0.178, 0.0469]];
/// Centres (x, y) of the burners, which are visual only, in m.
const BURNERS: [[f64; 2]; 2] = [[-0.03, 0.0565], [-0.03, -0.1435]];
/// Radius of a burner and its height above the stove's body, in m.
const BURNER: [f64; 2] = [0.085, 0.006];
/// x of the knobs, which are visual only, in m.
const KNOB_X: f64 = 0.13;

/// Axis (x, y) of the pan's round body in its own frame, in m. The origin lies outside the pan.
const PAN_AXIS: [f64; 2] = [0.293, 0.108];
/// Heights of the pan's base, of the upper face of its floor and of its rim, in m.
pub(crate) const PAN_Z: [f64; 3] = [0.0018, 0.0036, 0.0325];
/// Radius of the pan's floor, in m.
const FLOOR_RADIUS: f64 = 0.0985;
/// Inner and outer radius of the pan's wall at its foot, on the floor, and at the rim, in m.
const WALL: [[f64; 2]; 2] = [[0.0960, 0.0998], [0.1040, 0.1076]];
/// Number of boxes that form the pan's wall.
const N_WALLS: u32 = 16;
/// Outside of the visible pan from its base to its rim as (radius, z), in m.
const PAN_OUTSIDE: [[f64; 2]; 9] = [
    [0.0955, 0.0018],
    [0.0985, 0.0024],
    [0.0998, 0.0050],
    [0.1017, 0.0100],
    [0.1035, 0.0150],
    [0.1048, 0.0200],
    [0.1061, 0.0250],
    [0.1071, 0.0300],
    [0.1076, 0.0325],
];
/// Thickness of the visible pan's wall, in m.
const PAN_THICKNESS: f64 = 0.0022;
/// Cross-sections of the pan's handle: x, bounds of y and bounds of z, in m. The handle slants down outwards.
const HANDLE: [(f64, [f64; 2], [f64; 2]); 4] = [
    (0.4050, [0.0905, 0.1015], [0.0150, 0.0244]),
    (0.4500, [0.0895, 0.1035], [0.0130, 0.0240]),
    (0.5150, [0.0848, 0.1073], [0.0086, 0.0188]),
    (0.5311, [0.0890, 0.1030], [0.0069, 0.0170]),
];
/// Side view (x, z) of the visible handle, in m.
const HANDLE_OUTLINE: [[f64; 2]; 9] = [
    [0.3975, 0.0158],
    [0.5200, 0.0077],
    [0.5285, 0.0085],
    [0.5311, 0.0120],
    [0.5290, 0.0160],
    [0.5230, 0.0181],
    [0.4500, 0.0240],
    [0.4250, 0.0244],
    [0.3975, 0.0244],
];
/// Middle (y) and half of the width of the visible handle, in m.
const HANDLE_Y: [f64; 2] = [0.097, 0.008];

/// Creates a fixed stove: a plain block whose two burners are only visible.
pub(crate) fn stove(region: usize) -> BodySpec {
    let steel = AppearanceSpec { specular: 0.4, ..AppearanceSpec::plain(srgb([196, 198, 200])) };
    let iron = AppearanceSpec::plain(srgb([38, 38, 40]));
    let [min, max] = STOVE;
    let [radius, burner_height] = BURNER;
    let [hx, hy, half_height] = core::array::from_fn(|k| (max[k] - min[k]) / 2.0);
    let [x, y, _] = core::array::from_fn(|k| f64::midpoint(min[k], max[k]));
    let half_z = half_height - burner_height / 2.0;
    let burner_z = max[2] - burner_height / 2.0;
    let body = VisualShape::RoundedBox { half: [hx, hy, half_z], edge_radius: 0.01 };
    let mut visuals = vec![VisualSpec::at(body, [x, y, half_z], steel)];
    for [x, y] in BURNERS {
        let ring = |major_radius, minor_radius, appearance| {
            VisualSpec::at(VisualShape::Torus { major_radius, minor_radius }, [x, y, burner_z], appearance)
        };
        let coils =
            [0.025, 0.04, 0.055, 0.07].map(|major_radius| ring(major_radius, burner_height / 2.0, iron));
        let knob =
            VisualShape::Primitive(Primitive::Cylinder { radius: 0.016, half_height: burner_height / 2.0 });
        let knob = VisualSpec::at(knob, [KNOB_X, y, burner_z], iron);
        visuals.extend(coils.into_iter().chain([ring(radius, burner_height / 2.0, steel), knob]));
    }
    let solid = |[min, max]: [[f64; 3]; 2]| {
        let half = core::array::from_fn(|k| (max[k] - min[k]) / 2.0);
        box_part(half, core::array::from_fn(|k| f64::midpoint(min[k], max[k])), steel)
    };
    BodySpec {
        role: Role::ReceiverObject,
        motion: Motion::Fixed,
        scaled_by: ScaledBy::RoSize,
        scale_axes: ScaleAxes::Independent,
        visuals,
        ..movable("stove", STOVE_BOXES.map(solid).to_vec(), region, SINGLE_TABLE_Z).with_origin_z(STOVE_Z)
    }
}

/// Creates a frying pan whose handle points towards +x. Its frame is that of the benchmark's mesh.
pub(crate) fn pan(region: usize) -> BodySpec {
    let iron = AppearanceSpec { specular: 0.4, ..AppearanceSpec::plain(srgb([62, 64, 68])) };
    let grip = AppearanceSpec::plain(srgb([24, 24, 26]));
    let [x, y] = PAN_AXIS;
    let hull =
        |points: Vec<[f64; 3]>| PartSpec::at(Primitive::Hull { points: points.into() }, [0.0; 3], grip);
    let walls = (0..N_WALLS).map(|i| pan_wall(i, iron));
    let parts = walls
        .chain(pan_bottom(iron))
        .chain([hull(handle_root()), hull(HANDLE.into_iter().flat_map(cross_section).collect())]);
    let side_view = VisualShape::Extrusion {
        outline: HANDLE_OUTLINE.to_vec(),
        holes: Vec::new(),
        half_height: HANDLE_Y[1],
    };
    let upright = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    let handle = VisualSpec {
        pose: Translation3::new(0.0, HANDLE_Y[0], 0.0) * upright,
        ..VisualSpec::at(side_view, [0.0; 3], grip)
    };
    let bowl = VisualShape::Lathe { profile: pan_profile() };
    BodySpec {
        visuals: vec![VisualSpec::at(bowl, [x, y, 0.0], iron), handle],
        render_parts: RenderParts::Single,
        scale_axes: ScaleAxes::Independent,
        mass: Mass::Measured {
            kg: 0.0534,
            centre: [0.3149, 0.1016, 0.0123],
            inertia: [1.7e-4, 3.7e-4, 5.3e-4],
        },
        ..movable("pan", parts.collect(), region, SINGLE_TABLE_Z)
    }
}

/// Returns the point on the axis of the pan's round body at height `z` in its frame, in m.
pub(crate) fn pan_middle(z: f64) -> [f64; 3] {
    [PAN_AXIS[0], PAN_AXIS[1], z]
}

/// Inner radius of the pan at its floor and at its rim, in m.
pub(crate) const PAN_INSIDE: [f64; 2] = [WALL[0][0], WALL[1][0]];
/// Outward slope of the pan's wall: change of the radius per height.
pub(crate) const WALL_SLOPE: f64 =
    (WALL[1][0] + WALL[1][1] - WALL[0][0] - WALL[0][1]) / (2.0 * (PAN_Z[2] - PAN_Z[1]));

/// Returns the point in the middle of the pan's wall, opposite the handle, at height `z` in its frame, in m.
pub(crate) fn pan_rim(z: f64) -> [f64; 3] {
    let foot = f64::midpoint(WALL[0][0], WALL[0][1]);
    [PAN_AXIS[0] - foot - WALL_SLOPE * (z - PAN_Z[1]), PAN_AXIS[1], z]
}

/// Creates the boxes of the pan's round floor.
///
/// Boxes remain boxes when the pan is stretched. A cylinder would become a hull, which rapier supports on
/// only four neighbouring corners of a face, so that the pan would tilt.
fn pan_bottom(appearance: AppearanceSpec) -> [PartSpec; 3] {
    let [base, floor, _] = PAN_Z;
    let (sin, cos) = libm::sincos(PI / 8.0);
    let [x, y] = PAN_AXIS;
    [[cos, sin], [sin, cos], [FRAC_1_SQRT_2; 2]].map(|[along_x, along_y]| {
        let half = [FLOOR_RADIUS * along_x, FLOOR_RADIUS * along_y, (floor - base) / 2.0];
        box_part(half, [x, y, f64::midpoint(base, floor)], appearance)
    })
}

/// Creates a box of the pan's wall, which leans outwards.
fn pan_wall(i: u32, appearance: AppearanceSpec) -> PartSpec {
    let [low, high] = WALL.map(|[inner, outer]| f64::midpoint(inner, outer));
    let [_, floor, rim] = PAN_Z;
    let lean = libm::atan2(high - low, rim - floor);
    let (sin, cos) = libm::sincos(lean);
    let half_thickness = (WALL[0][1] - WALL[0][0] + WALL[1][1] - WALL[1][0]) / 4.0 * cos;
    let middle = f64::midpoint(low, high);
    let half_angle = PI / f64::from(N_WALLS);
    let half = [
        half_thickness,
        (middle + half_thickness) * libm::tan(half_angle),
        ((rim - floor) / 2.0 - half_thickness * sin) / cos,
    ];
    let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    let around = about(Vector3::z_axis(), f64::from(2 * i) * half_angle);
    let centre = around * Vector3::new(middle, 0.0, f64::midpoint(floor, rim));
    let [x, y] = PAN_AXIS;
    let pose = Translation3::new(x, y, 0.0)
        * Isometry3::from_parts(centre.into(), around * about(Vector3::y_axis(), lean));
    PartSpec { shape: Primitive::Box { half }, pose, appearance }
}

/// Returns the corners of the web between the pan's wall and its handle, in m.
fn handle_root() -> Vec<[f64; 3]> {
    /// Azimuths of the part of the wall from which the handle starts, in rad.
    const AZIMUTHS: [f64; 3] = [-TAU / 9.0, -TAU / 18.0, 0.0];
    let wall = |azimuth: f64| {
        [0, 1].map(|end| {
            let radius = f64::midpoint(WALL[end][0], WALL[end][1]);
            let (sin, cos) = libm::sincos(azimuth);
            [PAN_AXIS[0] + radius * cos, PAN_AXIS[1] + radius * sin, PAN_Z[1 + end]]
        })
    };
    AZIMUTHS.into_iter().flat_map(wall).chain(cross_section(HANDLE[0])).collect()
}

/// Returns the corners of a cross-section of the handle.
fn cross_section((x, [y0, y1], [z0, z1]): (f64, [f64; 2], [f64; 2])) -> [[f64; 3]; 4] {
    [[x, y0, z0], [x, y1, z0], [x, y0, z1], [x, y1, z1]]
}

/// Returns the profile of the visible pan about its axis, up the outside and down the inside, in m.
fn pan_profile() -> Vec<[f64; 2]> {
    let [base, floor, _] = PAN_Z;
    let inside = PAN_OUTSIDE.iter().rev().filter(|[_, z]| *z > floor);
    let inside = inside.map(|[radius, z]| [radius - PAN_THICKNESS, *z]);
    let corner = [WALL[0][0] - PAN_THICKNESS, floor];
    [[0.0, base]].into_iter().chain(PAN_OUTSIDE).chain(inside).chain([corner, [0.0, floor]]).collect()
}

/// Candidate lean angles of the hand about its closing axis, in rad.
const LEANS: [f64; 3] = [0.0, 0.3, 0.6];

/// Plans to grasp an object with the TCP at `tcp`, carry it by `offset` (m) and release it.
pub(crate) fn carry(scene: &Scene, tcp: &Isometry3<f64>, offset: &Vector3<f64>) -> Vec<Move> {
    /// Distance over which the hand approaches an object and retreats from it, in m.
    const APPROACH: f64 = 0.08;
    /// Height at which objects are carried, in m.
    const CARRY_Z: f64 = 0.25;
    let at_height =
        |tcp: &Isometry3<f64>, z: f64| grasp::translated(tcp, &(Vector3::z() * (z - tcp.translation.z)));
    let waypoints = |tcp: &Isometry3<f64>| {
        let raised = at_height(tcp, CARRY_Z);
        let there = grasp::translated(tcp, offset);
        [
            grasp::retreated(tcp, APPROACH),
            *tcp,
            raised,
            at_height(&there, CARRY_Z),
            there,
            grasp::retreated(&there, APPROACH),
        ]
    };
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
    let leaning = |tcp| LEANS.map(|lean| grasp::tilted_toward_base(scene, 0, &tcp, lean));
    let candidates: Vec<_> = [*tcp, tcp * half_turn].into_iter().flat_map(leaning).collect();
    let tcp = grasp::first_reachable(scene, 0, &candidates, waypoints);
    let [before, at, raised, over, there, after] =
        waypoints(&tcp).map(|tcp| Move::Joint(vec![TcpGoal { arm: 0, tcp }]));
    vec![before, at, Move::close(&[0], 6), raised, over, there, Move::open(&[0], 6), after]
}
