//! PlaceDishInRack: stand a plate in a drying rack. See docs/benchmark.md, "Tasks".

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

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

/// Height of the plate's centre above the rack's at release, in m: a few millimetres above its rest.
const RELEASE_Z: f64 = 0.043;
/// Angle by which the hand leans along the rim when it grasps the plate, in rad. Once the plate is upright,
/// the hand points obliquely down and stays above the dividers. The more it leans, the more the plate slips
/// while it is turned.
const LEAN: f64 = 0.3;
/// Height of the grasped point of the rim above the level of the plate's centre at release, as an angle about
/// the plate's axis in rad.
const GRASP_ELEVATION: f64 = FRAC_PI_4;
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
    // Grasp the plate's far side with the hand leaning away from the rack. The plate ends up open to the
    // left, and the hand reaches in from there.
    let azimuth = dish::farthest_azimuth(plate, &Vector3::x());
    let facing_left = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
    let slot_y = (DIVIDERS_Y[1] + DIVIDERS_Y[2]) / 2.0;
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI - GRASP_ELEVATION - azimuth);
    let final_pose = rack.pose * facing_left * dish::upright_pose(-slot_y, RELEASE_Z) * turned;
    let into_rack = final_pose * plate.resting_pose().inverse();
    let up = |tcp: &Isometry3<f64>, by_m: f64| grasp::translated(tcp, &(Vector3::z() * by_m));
    let waypoints = |tcp: &Isometry3<f64>| {
        let release = into_rack * tcp;
        let over = up(&release, CLEARANCE);
        let raised = up(tcp, LIFT);
        let transported = Isometry3::from_parts(over.translation, raised.rotation);
        let [above, retreat] = [grasp::retreated(tcp, APPROACH), grasp::retreated(&release, RETREAT)];
        [above, *tcp, raised, transported, over, release, retreat]
    };
    let candidates = dish::rim_grasps(plate, azimuth, -LEAN, &grasp::start_closing(scene, 0));
    let tcp = grasp::first_reachable(scene, 0, &candidates, waypoints);
    let [above, at, raised, transported, over, release, retreat] =
        waypoints(&tcp).map(|tcp| Move::straight(0, tcp));
    let narrow =
        Move::Grip { arms: vec![0], command: control::gripper_command(HALF_OPENING) as f32, steps: 1 };
    let close = Move::close(&[0], 4);
    vec![narrow, above, at, close, raised, transported, over, release, Move::open(&[0], 6), retreat]
}
