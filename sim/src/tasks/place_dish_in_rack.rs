//! PlaceDishInRack: stand a plate in a drying rack. See docs/benchmark.md, "Tasks".

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use ipc_types::Morphology;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::common::{ExternalCameras, dish, region, single_arm};
use crate::expert::{Move, grasp};
use crate::predicate::{Predicate, Region};
use crate::profile::Profile;
use crate::robot::control;
use crate::scene::{BodySpec, Range, Scene, SceneSpec};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "PlaceDishInRack-v1",
    category: Category::PickAndPlace,
    morphology: Morphology::Single,
    max_steps: 327,
    demo_steps: 251.4,
    instruction: "place the dish into the drying rack",
    paraphrases: include_str!("paraphrases/place_dish_in_rack.txt"),
    nominal,
    success,
    expert,
};

/// y of the dividers relative to the rack's centre, in m. The plate goes between the inner two.
const DIVIDERS_Y: [f64; 4] = [-0.1053, -0.0466, 0.0150, 0.0748];

fn nominal() -> SceneSpec {
    let plate = BodySpec { damping: [5.0, 8.0], ..dish::plate() };
    let regions = vec![
        region("plate", Range::new(-0.4, -0.2), Range::new(-0.3, -0.1)),
        region("rack", Range::new(-0.15, -0.05), Range::new(0.05, 0.15)).not_widened(),
    ];
    let target = [0.0, 0.0, 0.05];
    let cameras =
        ExternalCameras { external1: [[0.2, -0.15, 0.5], target], external2: [[0.1, 0.5, 0.4], target] };
    let bodies = vec![plate.with_yaw(Range::new(0.0, TAU)), dish::rack(1, DIVIDERS_Y)];
    single_arm(dish::QPOS, 0.0, &cameras, regions, bodies, TASK.instruction)
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

/// Lean angle of the plate at release, in rad.
const LEAN: f64 = 0.05;
/// Height above the rack's floor at which the plate is released, in m.
const DROP: f64 = 0.004;
/// Half-opening of the fingers during the approach to the wall, in m: the outer finger must not touch the
/// table.
const HALF_OPENING: f64 = 0.015;
/// Distance from which the hand approaches the rim in a straight line, in m.
const APPROACH: f64 = 0.065;
/// Height by which the plate is lifted, in m.
const LIFT: f64 = 0.2;
/// Height above its final position from which the plate is lowered, clear of the dividers, in m.
const CLEARANCE: f64 = 0.12;
/// Distance by which the hand retreats, in m.
const RETREAT: f64 = 0.08;

fn expert(scene: &Scene) -> Vec<Move> {
    let (plate, rack) = (scene.body("plate"), scene.body("rack"));
    // Grasp the plate's right side, which ends up on top: the hand then reaches the rack from above, clear of
    // the dividers.
    let azimuth = dish::farthest_azimuth(plate, &-Vector3::y());
    let facing_left = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
    let final_pose = rack.pose * facing_left * dish::leaning_pose(-DIVIDERS_Y[1], LEAN);
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2 - azimuth);
    let into_rack = final_pose * turned * plate.pose.inverse();
    let up = |tcp: &Isometry3<f64>, by_m: f64| grasp::translated(tcp, &(Vector3::z() * by_m));
    let waypoints = |tcp: &Isometry3<f64>| {
        let release = up(&(into_rack * tcp), DROP);
        let over = up(&release, CLEARANCE);
        let raised = up(tcp, LIFT);
        let transported = Isometry3::from_parts(over.translation, raised.rotation);
        let [above, retreat] = [grasp::retreated(tcp, APPROACH), grasp::retreated(&release, RETREAT)];
        [above, *tcp, raised, transported, over, release, retreat]
    };
    let candidates = dish::rim_grasps(plate, azimuth, &grasp::start_closing(scene, 0));
    let tcp = grasp::first_reachable(scene, 0, &candidates, waypoints);
    let [above, at, raised, transported, over, release, retreat] =
        waypoints(&tcp).map(|tcp| Move::straight(0, tcp));
    let narrow =
        Move::Grip { arms: vec![0], command: control::gripper_command(HALF_OPENING) as f32, steps: 1 };
    let close = Move::close(&[0], 4);
    vec![narrow, above, at, close, raised, transported, over, release, Move::open(&[0], 6), retreat]
}
