//! CookItemInPan: put a pan on the stove and an apple into it (spec/tasks.md §2, task 16).

use core::f64::consts::FRAC_PI_2;

use ipc_types::Morphology;
use nalgebra::{Point3, Vector3};

use super::common::cooking::{BURNERS, PAN, PAN_MIDDLE, STOVE, bring, pan, stove};
use super::common::{ExternalCameras, QPOS_NOISE_RAD, SINGLE_TABLE_Z, fruit, region, single_arm};
use crate::expert::Move;
use crate::predicate::{Predicate, Region};
use crate::profile::Profile;
use crate::profile::ProfileRules;
use crate::robot::control::gripper_entry;
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

/// The hand beside the pan's handle, pointing down.
const QPOS: [f64; 7] = [-0.321, 0.314, 0.635, -2.240, -0.300, 2.473, -1.820];
const FAR: f64 = f64::INFINITY;
/// Least gap between the circles around stove and apple, in m: they overlap so far at the nearest nominal places.
const GAP_TO_STOVE: f64 = -0.047;

fn nominal() -> SceneSpec {
    let at = |name, x, y| region(name, Range::fixed(x), Range::fixed(y));
    let pan_place = at("pan", 0.0, 0.0);
    // As wide as elsewhere, but to one side: on the other the pan would start in the stove's corner.
    let widened = pan_place.widened.map(|widened| WidenedRanges { y: Range::new(0.01, 0.16), ..widened });
    let apple_place = region("apple", Range::new(-0.2, -0.04), Range::new(-0.28, -0.12));
    let regions = vec![
        at("stove", 0.15, 0.15).not_widened(),
        // Else the widened region would let the apple start in the stove's corner.
        RegionSpec { min_gap_m: Some(GAP_TO_STOVE), ..apple_place },
        RegionSpec { widened, ..pan_place },
    ];
    let bodies = vec![pan(2).with_yaw(Range::fixed(FRAC_PI_2)), fruit::apple(1, SINGLE_TABLE_Z), stove(0)];
    let cameras = ExternalCameras { external1: [[0.35, -0.3, 0.4], [0.0; 3]], external2: [[0.35, 0.3, 0.4], [0.0; 3]] };
    single_arm(QPOS, QPOS_NOISE_RAD, &cameras, regions, bodies, TASK.instruction)
}

/// The pan on the stove, the apple in the pan, both at rest and let go.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let [pan, apple, stove] = ["pan", "apple", "stove"].map(|name| scene.body_idx(name));
    let scaled = |point: [f64; 3], body: usize| point.map(|x| x * scene.bodies[body].scale);
    let inside = |body, point, of, region| Predicate::Inside { body, point, of: Some(of), region };
    let over_pan = |origin, radius, along| {
        let axis = [0.0, 0.0, 1.0];
        inside(apple, [0.0; 3], pan, Region::Cylinder { origin, axis, radius, along })
    };
    let [on_stove, in_pan] = if profile.counts_near_misses() {
        // The apple's place is stated along the axes of the pan as it starts.
        [
            Predicate::inside_box(pan, [0.0, -0.35, -FAR], [0.35, 0.0, FAR]),
            over_pan([0.41, 0.07, 0.0], 0.15, [-FAR, FAR]),
        ]
    } else {
        let [[x0, y0, _], [x1, y1, top]] = STOVE.map(|corner| scaled(corner, stove));
        let above = Region::Box { min: [x0, y0, top - 0.005], max: [x1, y1, FAR] };
        let middle = scaled(PAN_MIDDLE, pan);
        let radius = PAN.radii[1] * scene.bodies[pan].scale;
        [inside(pan, middle, stove, above), over_pan(middle, radius, [0.0, FAR])]
    };
    let still = |body| Predicate::AtRest { body, max_linear: 0.1, max_angular: 1.0 };
    let released = |body| Predicate::Released { body };
    vec![on_stove, in_pan, still(pan), still(apple), released(pan), released(apple)]
}

/// Where the pan's handle is gripped, in the pan's frame, in m at scale 1.
const GRIP: [f64; 3] = [0.25, 0.108, 0.022];
/// How far above its middle the apple is gripped, as a share of its radius: narrow enough for the hand at any size.
const APPLE_GRIP: f64 = 0.55;
/// How far above where they come to rest pan and apple are let go, in m.
const GAP: f64 = 0.002;
/// How far open fingers reach to either side, with some room to spare, and how far either opens at least, in m: beside the
/// stove there is not always room to open them all the way.
const FINGERS: f64 = 0.066;
const HALF_OPEN: f64 = 0.018;

fn expert(scene: &Scene) -> Vec<Move> {
    let [pan, apple, stove] = ["pan", "apple", "stove"].map(|name| scene.body(name));
    let pan_point = |point: [f64; 3]| (pan.pose * (Point3::from(point) * pan.scale)).coords;
    let [x, y] = BURNERS[0];
    let burner = (stove.pose * (Point3::new(x, y, STOVE[1][2]) * stove.scale)).coords + Vector3::z() * GAP;
    let lying = Vector3::z() * (PAN.thickness * pan.scale + fruit::RADIUS * apple.scale);
    let up = Vector3::z() * (fruit::RADIUS * APPLE_GRIP * apple.scale);
    let apple_at = apple.pose.translation.vector;
    let grip = pan_point(GRIP);
    let room = stove.pose.translation.x + STOVE[0][0] * stove.scale - grip.x;
    let half_open = (FINGER_OPEN + room - FINGERS).clamp(HALF_OPEN, FINGER_OPEN);
    let command = gripper_entry(half_open) as f32;
    // No steps of its own: the fingers have the way to the handle for it.
    let mut moves = vec![Move::Grip { arms: vec![0], command, steps: 0 }];
    moves.extend(bring(scene, grip, burner - pan_point(PAN_MIDDLE)));
    moves.extend(bring(scene, apple_at + up, burner + lying - apple_at));
    moves
}
