//! PlaceDishInRack: stand a plate in a drying rack. See docs/benchmark.md, "Tasks".

use core::f64::consts::{FRAC_PI_2, TAU};

use ipc_types::Morphology;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::common::kitchen::dish;
use super::common::{ExternalCameras, region, single_arm};
use crate::expert::{Move, grasp};
use crate::predicate::{Predicate, Region};
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{BodySpec, Range, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "PlaceDishInRack-v1",
    category: Category::PickAndPlace,
    morphology: Morphology::Single,
    max_steps: 327,
    demo_steps: 251.4,
    instruction: "place the dish into the drying rack",
    lerobot_instruction: "Place the dish in the rack",
    paraphrases: include_str!("paraphrases/place_dish_in_rack.txt"),
    nominal,
    success,
    expert,
};

/// y of the dividers relative to the rack's centre, in m. The plate goes between the inner two.
const DIVIDERS_Y: [f64; 4] = [-0.1053, -0.0466, 0.0150, 0.0748];

fn nominal(_profile: Profile) -> SceneSpec {
    let plate = BodySpec { damping: [5.0, 8.0], ..dish::plate() };
    let regions = vec![
        region("plate", Range::new(-0.4, -0.2), Range::new(-0.3, -0.1)),
        region("rack", Range::new(-0.15, -0.05), Range::new(0.05, 0.15)).not_widened(),
    ];
    let target = [0.0, 0.0, 0.05];
    let cameras =
        ExternalCameras { external1: [[0.2, -0.15, 0.5], target], external2: [[0.1, 0.5, 0.4], target] };
    let plate = plate.with_yaw(Range::new(0.0, TAU)).with_origin_z(0.02445);
    let bodies = vec![plate, dish::rack(1, DIVIDERS_Y)];
    let scene = single_arm(dish::QPOS, 0.0, &cameras, regions, bodies, TASK.instruction);
    SceneSpec { physics_hz: 200, ..scene }
}

/// Requires the plate to stand on edge in the rack, at rest and released.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let (plate, rack) = (scene.body_idx("plate"), scene.body_idx("rack"));
    vec![
        Predicate::Inside {
            body: plate,
            point: [0.0; 3],
            of: Some(rack),
            region: Region::Box {
                min: [-0.0603, -0.0839, f64::NEG_INFINITY],
                max: [0.0603, 0.0839, f64::INFINITY],
            },
        },
        Predicate::Aligned {
            body: plate,
            axis: [0.0, 0.0, 1.0],
            with: [0.0, 0.0, 1.0],
            angle_rad: [libm::acos(0.35), FRAC_PI_2],
            either_way: true,
        },
        Predicate::AtRest { body: plate, max_linear: 0.02, max_angular: 0.4 },
        Predicate::Released { body: plate },
        Predicate::Above { body: plate, z_m: -0.01 },
    ]
}

/// Position of the grasp at the plate's far rim relative to its centre in m, with the hand pointing down.
const GRASP: [f64; 3] = [0.0825, 0.0, 0.0181];
/// Distance from which the hand approaches the rim in a straight line, in m.
const APPROACH: f64 = 0.065;
/// Height by which the plate is lifted, in m.
const LIFT: f64 = 0.2;
/// Position of the hand relative to the rack at which it turns the plate on edge, in m.
const OVER_RACK: [f64; 3] = [0.0825, -0.02, 0.185];
/// Displacement by which the plate is lowered into the rack, in m. In the benchmark it is
/// (0.04, −0.02, −0.08); from that height, one plate in ten does not come to rest in the slot here.
const LOWER: Vector3<f64> = Vector3::new(0.035, -0.02, -0.1);
/// Displacement by which the hand retreats, in m.
const RETREAT: Vector3<f64> = Vector3::new(0.0, -0.2, 0.0);

fn expert(scene: &Scene) -> Vec<Move> {
    let (plate, rack) = (scene.body("plate").pose, scene.body("rack").pose);
    let position = plate.translation.vector + Vector3::from(GRASP);
    let tcp = grasp::pose(&position, &-Vector3::z(), &Vector3::x());
    let over = rack.translation.vector + Vector3::from(OVER_RACK);
    let over = Isometry3::from_parts(over.into(), tcp.rotation);
    let on_edge = over * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2);
    let lowered = grasp::translated(&on_edge, &LOWER);
    let to = |tcp| Move::straight(0, tcp);
    vec![
        to(grasp::retreated(&tcp, APPROACH)),
        to(tcp),
        Move::close(&[0], 8),
        to(grasp::translated(&tcp, &(Vector3::z() * LIFT))),
        to(over),
        to(on_edge),
        to(lowered),
        Move::open(&[0], 6),
        to(grasp::translated(&lowered, &RETREAT)),
    ]
}
