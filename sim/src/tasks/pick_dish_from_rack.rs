//! PickDishFromRack: take a plate out of a drying rack. See docs/benchmark.md, "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, Vector3};

use super::common::kitchen::dish;
use super::common::{ExternalCameras, region, single_arm};
use crate::expert::{Move, grasp};
use crate::predicate::Predicate;
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{BodySpec, PlacementSpec, Range, RegionSpec, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "PickDishFromRack-v1",
    category: Category::Pick,
    morphology: Morphology::Single,
    max_steps: 156,
    demo_steps: 119.8,
    instruction: "pick up a dish from the drying rack",
    lerobot_instruction: "Pick up the dish from the rack",
    paraphrases: include_str!("paraphrases/pick_dish_from_rack.txt"),
    nominal,
    success,
    expert,
};

/// y of the dividers relative to the rack's centre, in m. The plate stands between the inner two.
const DIVIDERS_Y: [f64; 4] = [-0.12, -0.04, 0.04, 0.12];
/// Height of the plate's centre above the rack's at the start, in m. The benchmark starts it 15 mm higher and
/// above the success threshold; this is where it is after the first control step.
const START_Z: f64 = 0.0403;
/// Index of the rack among the bodies.
const RACK: usize = 1;

fn nominal(_profile: Profile) -> SceneSpec {
    let plate = BodySpec {
        placement: PlacementSpec::RelativeTo { body: RACK, pose: dish::upright_pose(0.0, START_Z) },
        ..dish::plate()
    };
    let beside = RegionSpec {
        random_mirror: true,
        ..region("rack", Range::fixed(-0.1), Range::new(0.15, 0.25)).not_widened()
    };
    let target = [0.0, 0.0, 0.05];
    let cameras =
        ExternalCameras { external1: [[0.3, -0.25, 0.35], target], external2: [[-0.2, -0.15, 0.5], target] };
    let bodies = vec![plate, dish::rack(0, DIVIDERS_Y)];
    single_arm(dish::QPOS, 0.0, &cameras, vec![beside], bodies, TASK.instruction)
}

/// Requires the plate's origin to be 42.5 mm above the rack's: 2 mm above its start and 6 mm above its rest.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let (plate, rack) = (scene.body_idx("plate"), scene.body("rack").pose.translation.vector);
    let risen = if profile.counts_sinking() {
        Predicate::Moved { body: plate, from: rack.into(), along: [0.0, 0.0, 1.0], by_m: 0.0425 }
    } else {
        Predicate::Above { body: plate, z_m: rack.z + 0.0425 }
    };
    vec![risen, Predicate::Above { body: plate, z_m: -0.01 }]
}

/// Position of the grasp relative to the rack's centre, in m: on the upper part of the plate, which has come
/// to rest leaning against the divider at its back, halfway between its floor and its foot.
const GRASP: [f64; 3] = [0.0, 0.025, 0.095];
/// Height by which the plate is lifted, in m.
const LIFT: f64 = 0.2;

fn expert(scene: &Scene) -> Vec<Move> {
    let rack = scene.body("rack");
    let start = grasp::start_tcp(scene, 0);
    let position = (rack.pose * Point3::from(GRASP)).coords;
    let waypoints = |tcp: &Isometry3<f64>| {
        let mut above = *tcp;
        above.translation.z = start.translation.z;
        [above, *tcp]
    };
    // A quarter turn from the initial orientation.
    let candidates = [-Vector3::y(), Vector3::y()].map(|y| grasp::pose(&position, &-Vector3::z(), &y));
    let tcp = grasp::first_reachable(scene, 0, &candidates, waypoints);
    let [above, at] = waypoints(&tcp);
    vec![
        Move::straight(0, above),
        Move::line(0, at),
        Move::close(&[0], 4),
        Move::Shift { by: Vector3::z() * LIFT },
    ]
}
