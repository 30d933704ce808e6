//! CookItemInPan: put a pan on the stove and an apple into it (spec/tasks.md §2, task 16).

use core::f64::consts::FRAC_PI_2;

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, Vector3};

use super::common::cooking::{BURNERS, PAN, PAN_MIDDLE, STOVE, pan, stove};
use super::common::{Eyes, NOISE_RAD, SINGLE_TABLE_Z, fruit, region, single_arm};
use crate::expert::{Move, grasp};
use crate::predicate::{Predicate, Region};
use crate::profile::Profile;
use crate::scene::{Range, Scene, SceneSpec};
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

fn nominal() -> SceneSpec {
    let at = |name, x, y| region(name, Range::fixed(x), Range::fixed(y));
    let regions = vec![
        at("pan", 0.0, 0.0),
        region("apple", Range::new(-0.2, -0.04), Range::new(-0.28, -0.12)),
        at("stove", 0.15, 0.15).kept(),
    ];
    let bodies = vec![pan(0).turned(Range::fixed(FRAC_PI_2)), fruit::apple(1, SINGLE_TABLE_Z), stove(2)];
    let eyes = Eyes { external1: [[0.35, -0.3, 0.4], [0.0; 3]], external2: [[0.35, 0.3, 0.4], [0.0; 3]] };
    single_arm(QPOS, NOISE_RAD, &eyes, regions, bodies, TASK.instruction)
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
        let above = Region::Box { least: [x0, y0, top - 0.005], greatest: [x1, y1, FAR] };
        let middle = scaled(PAN_MIDDLE, pan);
        let radius = PAN.radii[1] * scene.bodies[pan].scale;
        [inside(pan, middle, stove, above), over_pan(middle, radius, [0.0, FAR])]
    };
    let still = |body| Predicate::Still { body, max_linear: 0.1, max_angular: 1.0 };
    let released = |body| Predicate::Released { body };
    vec![on_stove, in_pan, still(pan), still(apple), released(pan), released(apple)]
}

/// Where the pan's handle is gripped, in the pan's frame, in m at scale 1.
const GRIP: [f64; 3] = [0.25, 0.108, 0.022];
/// How far above its middle the apple is gripped, as a share of its radius: narrow enough for the hand at any size.
const APPLE_GRIP: f64 = 0.55;
/// How far above where they come to rest pan and apple are let go, in m.
const GAP: f64 = 0.002;
/// Leans of the hand that are tried, in rad.
const LEANS: [f64; 3] = [0.0, 0.3, 0.6];

fn expert(scene: &Scene) -> Vec<Move> {
    let [pan, apple, stove] = ["pan", "apple", "stove"].map(|name| scene.body(name));
    let pan_point = |point: [f64; 3]| (pan.pose * (Point3::from(point) * pan.scale)).coords;
    let [x, y] = BURNERS[0];
    let burner = (stove.pose * (Point3::new(x, y, STOVE[1][2]) * stove.scale)).coords + Vector3::z() * GAP;
    let lying = Vector3::z() * (PAN.thickness * pan.scale + fruit::RADIUS * apple.scale);
    let up = Vector3::z() * (fruit::RADIUS * APPLE_GRIP * apple.scale);
    let apple_at = apple.pose.translation.vector;
    let mut moves = bring(scene, pan_point(GRIP), burner - pan_point(PAN_MIDDLE));
    moves.extend(bring(scene, apple_at + up, burner + lying - apple_at));
    moves
}

/// Takes what is at `place` from above, between fingers that close along x, and lets it go `way` from there; in m.
fn bring(scene: &Scene, place: Vector3<f64>, way: Vector3<f64>) -> Vec<Move> {
    let at_height =
        |tcp: &Isometry3<f64>, z: f64| grasp::shifted(tcp, &(Vector3::z() * (z - tcp.translation.z)));
    let stations = |tcp: &Isometry3<f64>| {
        let there = grasp::shifted(tcp, &way);
        [at_height(tcp, 0.15), *tcp, at_height(tcp, 0.25), at_height(&there, 0.25), there]
    };
    let upright = [1.0, -1.0].map(|way| grasp::pose(&place, &-Vector3::z(), &(Vector3::x() * way)));
    let leant = |tcp| LEANS.map(|lean| grasp::leant_back(scene, 0, tcp, lean));
    let candidates: Vec<_> = upright.iter().flat_map(leant).collect();
    let tcp = grasp::first_within_reach(scene, 0, &candidates, stations);
    let [above, at, raised, over, there] = stations(&tcp).map(|tcp| Move::straight(0, tcp));
    vec![above, at, Move::close(&[0], 6), raised, over.clone(), there, Move::open(&[0], 6), over]
}
