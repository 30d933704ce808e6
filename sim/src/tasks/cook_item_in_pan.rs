//! CookItemInPan: put a pan on the stove and an apple into the pan. See docs/benchmark.md, "Tasks".

use core::f64::consts::FRAC_PI_2;

use ipc_types::Morphology;
use nalgebra::{Point3, Vector3};

use super::common::kitchen::cooking::{
    PAN_INSIDE, PAN_Z, STOVE_BOXES, WALL_SLOPE, carry, pan, pan_middle, pan_rim, stove,
};
use super::common::kitchen::fruit;
use super::common::{ExternalCameras, QPOS_NOISE_RAD, SINGLE_TABLE_Z, region, single_arm};
use crate::expert::{Move, grasp};
use crate::predicate::{Predicate, Region};
use crate::robot::control::gripper_command;
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::robot::panda::TIP_BEYOND_TCP;
use scene::{Range, RegionSpec, Scene, SceneSpec, WidenedRanges};

pub(crate) const TASK: Task = Task {
    env_id: "CookItemInPan-v1",
    category: Category::LongHorizon,
    morphology: Morphology::Single,
    max_steps: 533,
    demo_steps: 473.9,
    instruction: "place the food item in the pan for cooking",
    lerobot_instruction: "Cook the item in the pan",
    paraphrases: include_str!("paraphrases/cook_item_in_pan.txt"),
    nominal,
    success,
    expert,
};

/// Initial joint positions in rad: the hand above the pan's rim, pointing down.
const QPOS: [f64; 7] = [-0.321, 0.314, 0.635, -2.240, -0.300, 2.473, -1.820];
const INF: f64 = f64::INFINITY;
/// Minimum gap between the bounding circles of stove and apple, in m. It is negative because the circles
/// overlap by this much at the nearest nominal positions.
const GAP_TO_STOVE: f64 = -0.0515;

/// Offset (x, y) in the world of the point that the benchmark takes for the middle of the pan from the pan's
/// origin, in m. It is at the root of the handle.
const ASSUMED_MIDDLE: [f64; 2] = [-0.07, 0.41];

fn nominal(profile: Profile) -> SceneSpec {
    let at = |name, x, y| region(name, Range::fixed(x), Range::fixed(y));
    let pan_region = at("pan", 0.0, 0.0);
    // Further towards +x, the pan would start inside the stove.
    let clear = |widened| WidenedRanges { x: Range::new(-0.075, 0.005), ..widened };
    let widened = pan_region.widened.filter(|_| profile.widens_all_points()).map(clear);
    let min_gap_m = profile.separates_starts().then_some(GAP_TO_STOVE);
    let apple_region = region("apple", Range::new(-0.2, -0.04), Range::new(-0.28, -0.12));
    let regions = vec![
        at("stove", 0.15, 0.15).not_widened(),
        // Prevents the apple from starting inside the stove's corner when the region is widened.
        RegionSpec { min_gap_m, ..apple_region },
        RegionSpec { widened, ..pan_region },
    ];
    let bodies = vec![pan(2).with_yaw(Range::fixed(FRAC_PI_2)), fruit::apple(1, SINGLE_TABLE_Z), stove(0)];
    let cameras =
        ExternalCameras { external1: [[0.35, -0.3, 0.4], [0.0; 3]], external2: [[0.35, 0.3, 0.4], [0.0; 3]] };
    let mut scene = single_arm(QPOS, QPOS_NOISE_RAD, &cameras, regions, bodies, TASK.instruction);
    // The released code has no reference here.
    scene.distractors.drop_m.1 = None;
    scene
}

/// Requires the pan on the stove and the apple in the pan, both at rest and released.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let [pan, apple, stove] = ["pan", "apple", "stove"].map(|name| scene.body_idx(name));
    let [on_stove, in_pan] = if profile.counts_near_misses() {
        let [x, y] = ASSUMED_MIDDLE;
        let (origin, axis) = ([x, y, 0.0], [0.0, 0.0, 1.0]);
        let region = Region::Cylinder { origin, axis, radius: 0.15, along: [-INF, INF] };
        [
            Predicate::inside_box(pan, [0.0, -0.35, -INF], [0.35, 0.0, INF]),
            Predicate::Offset { body: apple, from: pan, region },
        ]
    } else {
        let scale = |body: usize| scene.bodies[body].scale;
        let scaled =
            |point: [f64; 3], body| -> [f64; 3] { Vector3::from(point).component_mul(&scale(body)).into() };
        let [[x0, y0, _], [x1, y1, top]] = STOVE_BOXES[1].map(|corner| scaled(corner, stove));
        let above = Region::Box { min: [x0, y0, top - 0.005], max: [x1, y1, INF] };
        let origin = scaled(pan_middle(PAN_Z[1]), pan);
        let radius = PAN_INSIDE[1] * libm::sqrt(scale(pan).x * scale(pan).y);
        let inside = Region::Cylinder { origin, axis: [0.0, 0.0, 1.0], radius, along: [0.0, INF] };
        [
            Predicate::Inside { body: pan, point: origin, of: Some(stove), region: above },
            Predicate::Inside { body: apple, point: [0.0; 3], of: Some(pan), region: inside },
        ]
    };
    let at_rest = |body| Predicate::AtRest { body, max_linear: 0.1, max_angular: 1.0 };
    let released = |body| Predicate::Released { body };
    vec![on_stove, in_pan, at_rest(pan), at_rest(apple), released(pan), released(apple)]
}

/// Height of the grasp at the pan's wall in its frame, in m.
const RIM_GRASP_Z: f64 = 0.0215;
/// Opening of each finger while the hand descends to the wall, in m. The hand leans, so that a finger that is
/// further away from the wall would touch the table.
const HALF_OPENING: f64 = 0.015;
/// Point of the stove on which the middle of the pan is set down, in its frame, in m.
const ON_STOVE: [f64; 3] = [-0.008, -0.077, STOVE_BOXES[1][1][2]];
/// Maximum distance of the apple from the middle of the pan as a fraction of the free distance.
const OFF_CENTRE: f64 = 0.85;
/// Maximum half-width of the apple between the fingertips, in m; the open fingers leave 1 mm more on each
/// side. A larger apple is grasped above its middle.
const APPLE_HALF_WIDTH: f64 = 0.039;
/// Height above their resting positions at which pan and apple are released, in m.
const RELEASE_HEIGHT: f64 = 0.002;

/// Control steps for which the arm holds still at the end.
const SETTLING_STEPS: u32 = 120;

/// Plans to grasp the pan by its rim on the side of the robot, put it on the stove, and put the apple into
/// it.
fn expert(scene: &Scene) -> Vec<Move> {
    let [pan, apple, stove] = ["pan", "apple", "stove"].map(|name| scene.body(name));
    let on_stove = (stove.pose * Point3::from(Vector3::from(ON_STOVE).component_mul(&stove.scale))).coords;
    let to_stove = on_stove + Vector3::z() * RELEASE_HEIGHT - pan.point(pan_middle(PAN_Z[0])).coords;
    let closing = pan.pose.rotation * Vector3::x();
    // The pads are parallel to the wall, which leans outwards.
    let approach = closing * (WALL_SLOPE * pan.scale.x / pan.scale.z) - Vector3::z();
    let rim = pan.point(pan_rim(RIM_GRASP_Z)).coords;
    // Zero steps: the fingers move during the approach to the pan.
    let command = gripper_command(HALF_OPENING) as f32;
    let mut moves = vec![Move::Grip { arms: vec![0], command, steps: 0 }];
    moves.extend(carry(scene, &grasp::pose(&rim, &approach, &closing), &to_stove));

    let radius = fruit::APPLE_RADIUS * apple.scale.x;
    let middle = pan.point(pan_middle(PAN_Z[1])).coords;
    // Near the middle of the pan, on the side of the point at which the benchmark takes it to be.
    let [x, y] = ASSUMED_MIDDLE;
    let aside = pan.pose.translation.vector + Vector3::new(x, y, 0.0) - middle;
    let free = PAN_INSIDE[0] * pan.scale.x.min(pan.scale.y) - radius;
    let aside = Vector3::new(aside.x, aside.y, 0.0).cap_magnitude(OFF_CENTRE * free);
    let from = apple.resting_pose().translation.vector;
    let to_pan = middle + to_stove + aside + Vector3::z() * radius - from;
    let above_middle = libm::sqrt((radius.powi(2) - APPLE_HALF_WIDTH.powi(2)).max(0.0)) + TIP_BEYOND_TCP;
    let place = from + Vector3::z() * above_middle;
    moves.extend(carry(scene, &grasp::pose(&place, &-Vector3::z(), &closing), &to_pan));
    moves.extend([Move::open(&[0], 6), Move::Hold { steps: SETTLING_STEPS }]);
    moves
}
