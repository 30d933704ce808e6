//! DualArmPenCap: one hand holds a cap, the other puts the pen's tip into it (spec/tasks.md §3, task 24).

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, Vector3};

use super::common::insertion::{self, CAP_X, CAP_Z, PEN_Z};
use super::common::{ExternalCameras, QPOS_B, bimanual, region};
use crate::expert::{Move, both_arms, first_feasible, grasp};
use crate::predicate::{Predicate, Region};
use crate::profile::Profile;
use crate::scene::{Range, RegionSpec, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "DualArmPenCap-v1",
    category: Category::Insertion,
    morphology: Morphology::Bimanual,
    max_steps: 232,
    demo_steps: 186.1,
    instruction: "hold the pen with one hand and remove the cap with the other hand",
    paraphrases: include_str!("paraphrases/dual_arm_pen_cap.txt"),
    nominal,
    success,
    expert,
};

/// Least gap between the circles around cap and pen, in m: those may overlap so far before such slender bodies can.
const GAP: f64 = -0.07;

fn nominal() -> SceneSpec {
    let regions = vec![
        region("cap", Range::new(-0.4, -0.1), Range::new(-0.4, -0.1)),
        RegionSpec { min_gap_m: Some(GAP), ..region("pen", Range::new(-0.1, 0.2), Range::new(-0.1, 0.2)) },
    ];
    let cameras = ExternalCameras {
        external1: [[0.75, 0.0, 1.33], [-0.2, 0.0, 1.03]],
        external2: [[-0.5, 0.0, 1.33], [-0.2, 0.0, 1.03]],
    };
    let bodies = vec![insertion::cap(0), insertion::pen(1)];
    bimanual([QPOS_B; 2], 0.0, &cameras, regions, bodies, TASK.instruction)
}

/// The pen's tip well within the cap's cavity.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let [body, cap] = ["pen", "cap"].map(|name| scene.body_idx(name));
    let [_, bottom, open] = CAP_Z;
    let region = Region::Cylinder {
        origin: [CAP_X, 0.0, open],
        axis: [0.0, 0.0, -1.0],
        radius: 0.02,
        along: [0.03, open - bottom],
    };
    vec![Predicate::Inside { body, point: [0.0, 0.0, -0.16], of: Some(cap), region }]
}

/// Where the cap is gripped, in its frame, in m: between clip and opening.
const CAP_GRIP: Point3<f64> = Point3::new(CAP_X, 0.0, 0.085);
/// Where the pen may be gripped along itself, in m: near its centre of mass, or farther from its tip.
const PEN_GRIPS: [f64; 3] = [0.05, 0.09, 0.13];
/// Leans of the hand that are tried, in rad.
const LEANS: [f64; 6] = [0.0, 0.2, 0.4, 0.6, 0.8, -0.3];
/// Where the pen's tip is held, in m.
const MEETING: Vector3<f64> = Vector3::new(-0.19, -0.12, 1.0);
/// How far the opening is from the tip before the cap is put on, and how far the tip is inside it then, in m.
const BEFORE: f64 = 0.15;
const DEPTH: f64 = 0.1;
/// Control steps in which the arms come to rest before that.
const STEADY_STEPS: u32 = 10;

fn expert(scene: &Scene) -> Vec<Move> {
    let [cap, pen] = ["cap", "pen"].map(|name| scene.body(name).pose);
    // Where a point of a body goes: first up and along y, then over to the other body.
    let stations = |tcp: &Isometry3<f64>, from: Point3<f64>, to: Vector3<f64>| {
        let way = to - from.coords;
        let up = grasp::translated(tcp, &Vector3::new(0.0, way.y, way.z));
        [grasp::retreated(tcp, 0.1), *tcp, up, grasp::translated(tcp, &way)]
    };
    let (opening, tip) = (cap * Point3::new(CAP_X, 0.0, CAP_Z[2]), pen * Point3::new(0.0, 0.0, PEN_Z[0]));
    let candidates = |arm: usize, places: &[Point3<f64>]| -> Vec<Isometry3<f64>> {
        let closing = grasp::start_closing(scene, arm);
        let down = |place: &Point3<f64>| {
            grasp::pose(&place.coords, &-Vector3::z(), &grasp::closest_closing(Vector3::x(), &closing))
        };
        let leant = |tcp: Isometry3<f64>| LEANS.map(|lean| grasp::tilted_toward_base(scene, arm, &tcp, lean));
        places.iter().map(down).flat_map(leant).collect()
    };
    let cap_stations = |tcp: &Isometry3<f64>| stations(tcp, opening, MEETING - Vector3::y() * BEFORE);
    let pen_stations = |tcp: &Isometry3<f64>| stations(tcp, tip, MEETING);
    let cap_grips = candidates(0, &[cap * CAP_GRIP]);
    let pen_grips = candidates(1, &PEN_GRIPS.map(|z| pen * Point3::new(0.0, 0.0, z)));
    let first = [
        grasp::first_reachable(scene, 0, &cap_grips, cap_stations),
        grasp::first_reachable(scene, 1, &pen_grips, pen_stations),
    ];
    // What is within reach station by station need not be along the way, and the other way round.
    let others = pen_grips.iter().flat_map(|pen| cap_grips.iter().map(|cap| [*cap, *pen]));
    let grips = core::iter::once(first).chain(others);
    let plans = grips.map(|[cap, pen]| capped([cap_stations(&cap), pen_stations(&pen)]));
    first_feasible(scene, TASK.max_steps, plans)
}

/// Takes cap and pen, brings both to where they meet and puts the cap on.
fn capped(hands: [[Isometry3<f64>; 4]; 2]) -> Vec<Move> {
    let both_at = |station: usize| both_arms(hands.map(|stations| stations[station]));
    let over_tip = grasp::translated(&hands[0][3], &(Vector3::y() * (BEFORE + DEPTH)));
    vec![
        Move::Joint(both_at(0)),
        Move::Straight(both_at(1)),
        Move::close(&[0], 10),
        Move::close(&[1], 10),
        Move::Straight(both_at(2)),
        Move::Straight(both_at(3)),
        Move::Hold { steps: STEADY_STEPS },
        Move::straight(0, over_tip),
    ]
}
