//! DualArmPenCap: one hand holds a cap and the other inserts the pen's tip into it. See docs/benchmark.md,
//! "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, Vector3};

use super::common::objects::pen_and_cap::{self, CAP_MIDDLE, CAP_OPENING, PEN_TIP};
use super::common::{ExternalCameras, QPOS_B, bimanual, region};
use crate::expert::{Move, both_arms, first_feasible, grasp};
use crate::predicate::{Predicate, Region};
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmPenCap-v1",
    category: Category::Insertion,
    morphology: Morphology::Bimanual,
    max_steps: 232,
    demo_steps: 186.1,
    instruction: "hold the pen with one hand and remove the cap with the other hand",
    lerobot_instruction: "Cap the pen with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_pen_cap.txt"),
    nominal,
    success,
    expert,
};

fn nominal(_profile: Profile) -> SceneSpec {
    let regions = vec![
        region("cap", Range::new(-0.4, -0.1), Range::new(-0.4, -0.1)),
        region("pen", Range::new(-0.1, 0.2), Range::new(-0.1, 0.2)),
    ];
    let cameras = ExternalCameras {
        external1: [[0.75, 0.0, 1.33], [-0.2, 0.0, 1.03]],
        external2: [[-0.5, 0.0, 1.33], [-0.2, 0.0, 1.03]],
    };
    let bodies = vec![pen_and_cap::cap(0), pen_and_cap::pen(1)];
    bimanual([QPOS_B; 2], 0.0, &cameras, regions, bodies, TASK.instruction)
}

/// Requires a point just behind the pen's tip to be more than 30 mm inside the cap and close to a line
/// through it.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let [body, cap] = ["pen", "cap"].map(|name| scene.body_idx(name));
    let region = Region::Cylinder {
        origin: [0.02, 0.0, 0.12],
        axis: [0.0, 0.0, -1.0],
        radius: 0.02,
        along: [0.03, f64::INFINITY],
    };
    vec![Predicate::Inside { body, point: [0.0, 0.0, -0.16], of: Some(cap), region }]
}

/// Grasp position on the cap in its frame in m: on the clip, near the opening.
const CAP_GRASP: Point3<f64> = Point3::new(CAP_MIDDLE[0], CAP_MIDDLE[1] - 0.003, 0.08);
/// Candidate grasp positions along the pen in m: near its centre of mass, and farther from its tip.
const PEN_GRASPS: [f64; 3] = [0.05, 0.09, 0.13];
/// Candidate lean angles of the hand, in rad.
const LEANS: [f64; 6] = [0.0, 0.2, 0.4, 0.6, 0.8, -0.3];
/// World position at which the pen's tip is held, in m.
const MEETING: Vector3<f64> = Vector3::new(-0.171, -0.044, 1.0);
/// Distance between the cap's opening and the pen's tip before insertion, in m.
const STANDOFF: f64 = 0.24;
/// Insertion depth of the tip in m, a little more than the pen fits.
const INSERTION_DEPTH: f64 = 0.06;
/// Control steps for which the arms hold still before insertion.
const SETTLING_STEPS: u32 = 10;

fn expert(scene: &Scene) -> Vec<Move> {
    let cap = pen_and_cap::resting_cap(scene.body("cap"));
    let pen = pen_and_cap::resting_pen(scene.body("pen"));
    // Waypoints that bring the point `from` of a body to `to`: first along y and z, then along x to the other
    // body.
    let waypoints = |tcp: &Isometry3<f64>, from: Point3<f64>, to: Vector3<f64>| {
        let offset = to - from.coords;
        let up = grasp::translated(tcp, &Vector3::new(0.0, offset.y, offset.z));
        [grasp::retreated(tcp, 0.1), *tcp, up, grasp::translated(tcp, &offset)]
    };
    let (opening, tip) = (cap * CAP_OPENING, pen * PEN_TIP);
    let candidates = |arm: usize, positions: &[Point3<f64>]| -> Vec<Isometry3<f64>> {
        let closing = grasp::start_closing(scene, arm);
        let down = |position: &Point3<f64>| {
            grasp::pose(&position.coords, &-Vector3::z(), &grasp::closest_closing(Vector3::x(), &closing))
        };
        let leaning =
            |tcp: Isometry3<f64>| LEANS.map(|lean| grasp::tilted_toward_base(scene, arm, &tcp, lean));
        positions.iter().map(down).flat_map(leaning).collect()
    };
    let cap_stations = |tcp: &Isometry3<f64>| waypoints(tcp, opening, MEETING - Vector3::y() * STANDOFF);
    let pen_stations = |tcp: &Isometry3<f64>| waypoints(tcp, tip, MEETING);
    let cap_grasps = candidates(0, &[cap * CAP_GRASP]);
    let pen_grasps = candidates(1, &PEN_GRASPS.map(|z| pen * Point3::new(PEN_TIP.x, PEN_TIP.y, z)));
    let first = [
        grasp::first_reachable(scene, 0, &cap_grasps, cap_stations),
        grasp::first_reachable(scene, 1, &pen_grasps, pen_stations),
    ];
    // Waypoints that are reachable one by one need not be reachable along the path, and vice versa.
    let others = pen_grasps.iter().flat_map(|pen| cap_grasps.iter().map(|cap| [*cap, *pen]));
    let grasps = core::iter::once(first).chain(others);
    let plans = grasps.map(|[cap, pen]| cap_pen([cap_stations(&cap), pen_stations(&pen)]));
    first_feasible(scene, TASK.max_steps, plans)
}

/// Plans to grasp cap and pen, bring both to the meeting point and put the cap on.
fn cap_pen(hands: [[Isometry3<f64>; 4]; 2]) -> Vec<Move> {
    let both_at = |waypoint: usize| both_arms(hands.map(|waypoints| waypoints[waypoint]));
    let over_tip = grasp::translated(&hands[0][3], &(Vector3::y() * (STANDOFF + INSERTION_DEPTH)));
    vec![
        Move::Joint(both_at(0)),
        Move::Straight(both_at(1)),
        Move::close(&[0], 10),
        Move::close(&[1], 10),
        Move::Straight(both_at(2)),
        Move::Straight(both_at(3)),
        Move::Hold { steps: SETTLING_STEPS },
        Move::straight(0, over_tip),
    ]
}
