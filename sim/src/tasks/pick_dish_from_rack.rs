//! PickDishFromRack: take a plate out of a drying rack. See docs/benchmark.md, "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::{ExternalCameras, dish, region, single_arm};
use crate::expert::{Move, grasp};
use crate::predicate::Predicate;
use crate::profile::{Profile, ProfileRules};
use crate::scene::{BodySpec, PlacementSpec, Range, RegionSpec, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "PickDishFromRack-v1",
    category: Category::Pick,
    morphology: Morphology::Single,
    max_steps: 156,
    demo_steps: 119.8,
    instruction: "pick up a dish from the drying rack",
    paraphrases: include_str!("paraphrases/pick_dish_from_rack.txt"),
    nominal,
    success,
    expert,
};

/// y of the dividers relative to the rack's centre, in m. The plate leans against the third.
const DIVIDERS_Y: [f64; 4] = [-0.12, -0.04, 0.04, 0.12];
/// Lean angle of the plate in rad, at which its rim rests in the corner between the rack's floor and the
/// second divider.
const LEAN: f64 = 0.2546;
/// Index of the rack among the bodies.
const RACK: usize = 1;

fn nominal() -> SceneSpec {
    let plate = BodySpec {
        placement: PlacementSpec::RelativeTo { body: RACK, pose: dish::leaning_pose(DIVIDERS_Y[2], LEAN) },
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

/// Requires the plate's origin to be 42.5 mm above the rack's, which is 13 mm above its initial height.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let (plate, rack) = (scene.body_idx("plate"), scene.body("rack").pose.translation.vector);
    let risen = if profile.counts_sinking() {
        Predicate::Moved { body: plate, from: rack.into(), along: [0.0, 0.0, 1.0], by_m: 0.0425 }
    } else {
        Predicate::Above { body: plate, z_m: rack.z + 0.0425 }
    };
    vec![risen, Predicate::Above { body: plate, z_m: -0.01 }]
}

/// Distance from which the hand approaches the rim in a straight line, in m.
const APPROACH: f64 = 0.07;
/// Height by which the plate is lifted, in m.
const LIFT: f64 = 0.2;

fn expert(scene: &Scene) -> Vec<Move> {
    let plate = scene.body("plate");
    let start = grasp::start_tcp(scene, 0);
    // A quarter turn from the initial orientation. The hand rotates at its initial height before it descends
    // and leans.
    let closing = -Vector3::y();
    let waypoints = |tcp: &Isometry3<f64>| {
        let above = grasp::retreated(tcp, APPROACH);
        let beside = Vector3::new(above.translation.x, above.translation.y, start.translation.z);
        [
            grasp::pose(&beside, &-Vector3::z(), &closing),
            above,
            *tcp,
            grasp::translated(tcp, &(Vector3::z() * LIFT)),
        ]
    };
    let candidates = dish::rim_grasps(plate, dish::farthest_azimuth(plate, &Vector3::z()), &closing);
    let tcp = grasp::first_reachable(scene, 0, &candidates, waypoints);
    let [beside, above, at, raised] = waypoints(&tcp).map(|tcp| Move::straight(0, tcp));
    vec![beside, above, at, Move::close(&[0], 4), raised]
}
