//! CookItemInPan: put a pan on the stove and an apple into the pan. See docs/benchmark.md, "Tasks".

use core::f64::consts::FRAC_PI_2;

use ipc_types::Morphology;
use nalgebra::{Point3, Vector3};

use super::common::cooking::{BURNERS, PAN, PAN_CENTRE, STOVE, carry, pan, stove};
use super::common::{ExternalCameras, QPOS_NOISE_RAD, SINGLE_TABLE_Z, fruit, region, single_arm};
use crate::expert::Move;
use crate::predicate::{Predicate, Region};
use crate::profile::{Profile, ProfileRules};
use crate::robot::control::gripper_command;
use crate::robot::panda::FINGER_OPEN;
use crate::scene::{Range, RegionSpec, Scene, SceneSpec, WidenedRanges};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "CookItemInPan-v1",
    category: Category::LongHorizon,
    morphology: Morphology::Single,
    max_steps: 533,
    demo_steps: 473.9,
    instruction: "place the food item in the pan for cooking",
    paraphrases: include_str!("paraphrases/cook_item_in_pan.txt"),
    nominal,
    success,
    expert,
};

/// Initial joint positions in rad: the hand beside the pan's handle, pointing down.
const QPOS: [f64; 7] = [-0.321, 0.314, 0.635, -2.240, -0.300, 2.473, -1.820];
const INF: f64 = f64::INFINITY;
/// Minimum gap between the bounding circles of stove and apple, in m. It is negative because the circles
/// overlap by this much at the nearest nominal positions.
const GAP_TO_STOVE: f64 = -0.047;

fn nominal() -> SceneSpec {
    let at = |name, x, y| region(name, Range::fixed(x), Range::fixed(y));
    let pan_region = at("pan", 0.0, 0.0);
    // The widened region has the usual size but is shifted to one side: otherwise the pan could start inside
    // the stove's corner.
    let widened = pan_region.widened.map(|widened| WidenedRanges { y: Range::new(0.01, 0.16), ..widened });
    let apple_region = region("apple", Range::new(-0.2, -0.04), Range::new(-0.28, -0.12));
    let regions = vec![
        at("stove", 0.15, 0.15).not_widened(),
        // Prevents the apple from starting inside the stove's corner when the region is widened.
        RegionSpec { min_gap_m: Some(GAP_TO_STOVE), ..apple_region },
        RegionSpec { widened, ..pan_region },
    ];
    let bodies = vec![pan(2).with_yaw(Range::fixed(FRAC_PI_2)), fruit::apple(1, SINGLE_TABLE_Z), stove(0)];
    let cameras =
        ExternalCameras { external1: [[0.35, -0.3, 0.4], [0.0; 3]], external2: [[0.35, 0.3, 0.4], [0.0; 3]] };
    single_arm(QPOS, QPOS_NOISE_RAD, &cameras, regions, bodies, TASK.instruction)
}

/// Requires the pan on the stove and the apple in the pan, both at rest and released.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let [pan, apple, stove] = ["pan", "apple", "stove"].map(|name| scene.body_idx(name));
    let scaled = |point: [f64; 3], body: usize| point.map(|x| x * scene.bodies[body].scale.x);
    let inside = |body, point, of, region| Predicate::Inside { body, point, of: Some(of), region };
    let over_pan = |origin, radius, along| {
        let axis = [0.0, 0.0, 1.0];
        inside(apple, [0.0; 3], pan, Region::Cylinder { origin, axis, radius, along })
    };
    let [on_stove, in_pan] = if profile.counts_near_misses() {
        // The benchmark states the apple's position along the axes of the pan's initial frame.
        [
            Predicate::inside_box(pan, [0.0, -0.35, -INF], [0.35, 0.0, INF]),
            over_pan([0.41, 0.07, 0.0], 0.15, [-INF, INF]),
        ]
    } else {
        let [[x0, y0, _], [x1, y1, top]] = STOVE.map(|corner| scaled(corner, stove));
        let above = Region::Box { min: [x0, y0, top - 0.005], max: [x1, y1, INF] };
        let centre = scaled(PAN_CENTRE, pan);
        let radius = PAN.radii[1] * scene.bodies[pan].scale.x;
        [inside(pan, centre, stove, above), over_pan(centre, radius, [0.0, INF])]
    };
    let at_rest = |body| Predicate::AtRest { body, max_linear: 0.1, max_angular: 1.0 };
    let released = |body| Predicate::Released { body };
    vec![on_stove, in_pan, at_rest(pan), at_rest(apple), released(pan), released(apple)]
}

/// Grasp position at the pan's handle in the pan's frame, in m at scale 1.
const HANDLE_GRASP: [f64; 3] = [0.25, 0.108, 0.022];
/// Height of the apple's grasp above its centre as a fraction of its radius. At this height the apple fits
/// between the fingers at any scale.
const APPLE_GRASP: f64 = 0.55;
/// Height above their resting positions at which pan and apple are released, in m.
const RELEASE_HEIGHT: f64 = 0.002;
/// Distance that open fingers extend to either side, including a margin, in m.
const FINGER_REACH: f64 = 0.066;
/// Minimum opening of each finger, in m. Beside the stove there is not always room for a full opening.
const MIN_HALF_OPENING: f64 = 0.018;

fn expert(scene: &Scene) -> Vec<Move> {
    let [pan, apple, stove] = ["pan", "apple", "stove"].map(|name| scene.body(name));
    let pan_point = |point: [f64; 3]| (pan.pose * (Point3::from(point) * pan.scale.x)).coords;
    let [x, y] = BURNERS[0];
    let burner =
        (stove.pose * (Point3::new(x, y, STOVE[1][2]) * stove.scale.x)).coords + Vector3::z() * RELEASE_HEIGHT;
    let rest_offset = Vector3::z() * (PAN.thickness * pan.scale.x + fruit::RADIUS * apple.scale.x);
    let up = Vector3::z() * (fruit::RADIUS * APPLE_GRASP * apple.scale.x);
    let apple_at = apple.pose.translation.vector;
    let handle = pan_point(HANDLE_GRASP);
    let room = stove.pose.translation.x + STOVE[0][0] * stove.scale.x - handle.x;
    let half_open = (FINGER_OPEN + room - FINGER_REACH).clamp(MIN_HALF_OPENING, FINGER_OPEN);
    let command = gripper_command(half_open) as f32;
    // Zero steps: the fingers move during the approach to the handle.
    let mut moves = vec![Move::Grip { arms: vec![0], command, steps: 0 }];
    moves.extend(carry(scene, handle, burner - pan_point(PAN_CENTRE)));
    moves.extend(carry(scene, apple_at + up, burner + rest_offset - apple_at));
    moves
}
