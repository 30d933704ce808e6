//! DualArmPourPot: two arms lift a pot and pour the tomato inside it into a tray. See docs/benchmark.md,
//! "Tasks".

use core::f64::consts::PI;

use ipc_types::Morphology;
use nalgebra::{UnitQuaternion, Vector3};

use super::common::kitchen::fruit;
use super::common::kitchen::pot;
use super::common::kitchen::tray;
use super::common::{BIMANUAL_TABLE_Z, LIFT_CAMERAS, bimanual, region};
use crate::expert::{Move, both_arms, grasp};
use crate::predicate::{Predicate, Region};
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{BodySpec, PlacementSpec, Range, Role, Scene, SceneSpec};

pub(crate) const TASK: Task = Task {
    env_id: "DualArmPourPot-v1",
    category: Category::Reorientation,
    morphology: Morphology::Bimanual,
    max_steps: 214,
    demo_steps: 200.7,
    instruction: "lift the pot with both hands and pour its contents into the target container",
    lerobot_instruction: "Pour from the pot with dual arms",
    paraphrases: include_str!("paraphrases/dual_arm_pour_pot.txt"),
    nominal,
    success,
    expert,
};

const INF: f64 = f64::INFINITY;
/// World z of the origins of the tray and the tomato at the start, in m.
const TRAY_Z: f64 = 0.85;
const TOMATO_Z: f64 = 0.9;

fn nominal(profile: Profile) -> SceneSpec {
    let tomato = BodySpec {
        // Colour and texture perturbations leave the tomato alone, although MO-Size scales it.
        role: Role::Fixture,
        placement: PlacementSpec::Over { body: 0, origin_z_m: TOMATO_Z, surface_z_m: pot::FLOOR_Z },
        ..fruit::tomato(0, BIMANUAL_TABLE_Z)
    };
    let tray = BodySpec {
        role: Role::ReceiverObject,
        // In the released code, a large pot or one close to the tray starts inside the tray.
        placement: PlacementSpec::Beside {
            body: 0,
            x_m: -0.2,
            min_gap_m: profile.separates_starts().then_some(0.002),
            surface_z_m: BIMANUAL_TABLE_Z,
            origin_z_m: TRAY_Z,
        },
        ..tray::tray(0)
    };
    let regions = vec![region("pot", Range::fixed(0.1), Range::symmetric(0.1))];
    bimanual(
        pot::QPOS,
        0.0,
        &LIFT_CAMERAS,
        regions,
        vec![pot::pot(0, pot::PAINTED), tomato, tray],
        TASK.instruction,
    )
}

/// Requires the tomato's origin to be near the tray's along the world's axes and 5 to 75 mm above the table.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let [tomato, tray] = ["tomato", "tray"].map(|name| scene.body_idx(name));
    let scale = if profile.scales_thresholds() { scene.bodies[tray].scale } else { Vector3::repeat(1.0) };
    let [x, y] = [0.12 * scale.x, 0.2 * scale.y];
    vec![
        Predicate::Offset {
            body: tomato,
            from: tray,
            region: Region::Box { min: [-x, -y, -INF], max: [x, y, INF] },
        },
        Predicate::inside_box(tomato, [-INF, -INF, 0.83], [INF, INF, 0.9]),
    ]
}

/// Height by which the pot is lifted, in m.
const LIFT: f64 = 0.15;
/// Distance beyond the tray to which the pot is then moved back towards the robots, in m.
const OVERSHOOT: f64 = 0.04;
/// Tilt angle at which the tomato rolls out gently, in rad.
const POUR_TILT: f64 = 1.5;
/// Final tilt angle, with the pot upside down, in rad.
const FINAL_TILT: f64 = 2.0 * PI / 2.05;
/// Control steps in which the tomato settles in the lifted pot.
const SETTLING_STEPS: u32 = 19;
/// Control steps in which the tomato rolls out of the tilted pot.
const ROLLING_STEPS: u32 = 34;

fn expert(scene: &Scene) -> Vec<Move> {
    let grasps = pot::grasps(scene);
    let [pot_x, tray_x] = ["pot", "tray"].map(|name| scene.body(name).pose.translation.x);
    let back = pot_x - tray_x + OVERSHOOT;
    let carried = |back_m: f64| grasps.map(|tcp| grasp::translated(&tcp, &Vector3::new(-back_m, 0.0, LIFT)));
    let tilted = |angle: f64| {
        let turn = |arm: usize| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), [angle, -angle][arm]);
        Move::Straight(both_arms([0, 1].map(|arm| carried(back)[arm] * turn(arm))))
    };
    let mut moves = vec![Move::Joint(both_arms(grasps.each_ref().map(pot::pre_grasp)))];
    moves.extend([
        Move::Straight(both_arms(grasps)),
        Move::close(&[0], 10),
        Move::close(&[1], 10),
        Move::Waypoints([carried(0.0), carried(back)].map(both_arms).into()),
        Move::Hold { steps: SETTLING_STEPS },
        tilted(POUR_TILT),
        Move::Hold { steps: ROLLING_STEPS },
        tilted(FINAL_TILT),
    ]);
    moves
}
