//! PlugCharger: push the two prongs of a charger into the slots of a receptacle. See docs/benchmark.md,
//! "Tasks".

use core::f64::consts::{FRAC_PI_3, FRAC_PI_4, FRAC_PI_8, PI};

use ipc_types::Morphology;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::common::objects::hole::Hole;
use super::common::{
    self, BLUE, ExternalCameras, QPOS_D, QPOS_NOISE_RAD, SINGLE_TABLE_Z, box_part, movable, region,
    single_arm, srgb,
};
use crate::expert::{Move, first_feasible, grasp};
use crate::predicate::Predicate;
use crate::task::profile::Profile;
use crate::task::{Category, Task};
use scene::{AppearanceSpec, BodySpec, Range, ScaledBy, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "PlugChargerColosseumV2-v1",
    category: Category::Insertion,
    morphology: Morphology::Single,
    max_steps: 234,
    demo_steps: 179.6,
    instruction: "plug the charger into the wall outlet",
    lerobot_instruction: "Plug in the charger",
    paraphrases: include_str!("paraphrases/plug_charger.txt"),
    nominal,
    success,
    expert,
};

/// Half-extents of the charger's base in m. It ends where the prongs begin, at the charger's origin.
const BASE: [f64; 3] = [0.02, 0.015, 0.012];
/// Half-extents of a prong, in m.
const PRONG: [f64; 3] = [0.008, 0.00075, 0.0032];
/// Distance of a prong's centre from the charger's, in m.
const PRONG_Y: f64 = 0.007;
/// Half-extents of the receptacle in m. Its front is at its origin.
const RECEPTACLE: [f64; 3] = [0.01, 0.05, 0.05];
/// Clearance between a prong and its slot on each side, in m.
const CLEARANCE: f64 = 0.0025;

fn charger() -> BodySpec {
    let metal = AppearanceSpec::metal(BLUE);
    let prong = |y: f64| box_part(PRONG, [PRONG[0], y, 0.0], metal);
    let base = box_part(BASE, [-BASE[0], 0.0, 0.0], AppearanceSpec::plain(BLUE));
    BodySpec {
        scaled_by: ScaledBy::Nothing("it would not fit the slots"),
        ..movable("charger", vec![base, prong(-PRONG_Y), prong(PRONG_Y)], 0, SINGLE_TABLE_Z)
    }
}

/// Creates a plate with two slots, built as one hole and a bar in its middle. The 1 mm recessed brass inlays
/// that fill the slots are visual only.
fn receptacle() -> BodySpec {
    let [_, slot_y, slot_z] = PRONG.map(|half| half + CLEARANCE);
    let (depth, plastic) = (RECEPTACLE[0], AppearanceSpec::plain([1.0; 3]));
    let walls = Hole::around([0.0; 2], [PRONG_Y + slot_y, slot_z]).walls(RECEPTACLE);
    let mut parts = walls.map(|(half, [_, y, z])| box_part(half, [-depth, y, z], plastic)).to_vec();
    parts.push(box_part([depth, PRONG_Y - slot_y, slot_z], [-depth, 0.0, 0.0], plastic));
    let brass = AppearanceSpec::metal(srgb([219, 181, 57]));
    let inlays =
        [-PRONG_Y, PRONG_Y].map(|y| box_part([depth - 5e-4, slot_y, slot_z], [-depth - 5e-4, y, 0.0], brass));
    let visuals = parts.iter().chain(&inlays).map(common::visual_of).collect();
    let lower_edge_z = 0.1 - RECEPTACLE[2];
    BodySpec {
        visuals,
        ..common::fixed("receptacle", parts, 1, lower_edge_z, "the charger would not fit it")
    }
}

fn nominal(_profile: Profile) -> SceneSpec {
    let regions = vec![
        region("charger", Range::new(-0.1, -0.026), Range::symmetric(0.2)),
        region("receptacle", Range::new(0.01, 0.1), Range::symmetric(0.1)).not_widened(),
    ];
    let facing_robot = Range::new(PI - FRAC_PI_8, PI + FRAC_PI_8);
    let bodies = vec![charger().with_yaw(Range::symmetric(FRAC_PI_3)), receptacle().with_yaw(facing_robot)];
    let target = [-0.1, 0.0, 0.1];
    let cameras =
        ExternalCameras { external1: [[-0.3, 0.1, 0.1], target], external2: [[-0.1, -0.5, 0.3], target] };
    single_arm(QPOS_D, QPOS_NOISE_RAD, &cameras, regions, bodies, TASK.instruction)
}

/// Returns the charger's pose when it is plugged in: against the receptacle and facing it.
fn plugged_in(scene: &Scene) -> Isometry3<f64> {
    scene.body("receptacle").pose * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI)
}

/// Requires the charger to be plugged in, within 5 mm and 0.2 rad.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let goal = plugged_in(scene);
    let [x, y, z, w] = goal.rotation.coords.into();
    let (body, position) = (scene.body_idx("charger"), goal.translation.vector.into());
    vec![Predicate::At { body, position, orientation: [w, x, y, z], tolerance: [0.005, 0.2] }]
}

/// Candidate lean angles of the hand, in rad. The later ones are for poses that are out of reach.
const LEANS: [f64; 3] = [PI / 12.0, FRAC_PI_8, FRAC_PI_4];

fn expert(scene: &Scene) -> Vec<Move> {
    let charger = scene.body("charger");
    let centre = (charger.pose * Point3::new(-BASE[0], 0.0, 0.0)).coords;
    let side = grasp::closest_closing(charger.pose.rotation * Vector3::y(), &grasp::start_closing(scene, 0));
    let before = plugged_in(scene) * Translation3::new(-0.05, 0.0, 0.0);
    let carry = |to| Move::Carry { from: charger.pose, to };
    let grasps = LEANS.iter().flat_map(|lean| {
        [side, -side].map(|closing| {
            let upright = grasp::pose(&centre, &-Vector3::z(), &closing);
            grasp::tilted_toward_base(scene, 0, &upright, *lean)
        })
    });
    let plans = grasps.map(|tcp| {
        vec![
            Move::Limit { per_joint: 0.5 },
            Move::straight(0, grasp::retreated(&tcp, 0.05)),
            Move::straight(0, tcp),
            Move::close(&[0], 6),
            carry(before),
            carry(before),
            Move::Hold { steps: 5 },
            carry(plugged_in(scene)),
        ]
    });
    first_feasible(scene, TASK.max_steps, plans)
}
