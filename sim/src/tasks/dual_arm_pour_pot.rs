//! DualArmPourPot: two arms lift a pot and pour the tomato inside it into a tray. See docs/benchmark.md,
//! "Tasks".

use core::f64::consts::PI;

use ipc_types::Morphology;
use nalgebra::{UnitQuaternion, Vector3};

use super::common::{BIMANUAL_TABLE_Z, LIFT_CAMERAS, bimanual, fruit, pot, region, tray, widened_by_half};
use crate::expert::{Move, both_arms, grasp};
use crate::predicate::{Predicate, Region};
use crate::profile::{Profile, ProfileRules};
use crate::scene::{BodySpec, PlacementSpec, Range, RegionSpec, Role, Scene, SceneSpec, WidenedRanges};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "DualArmPourPot-v1",
    category: Category::Reorientation,
    morphology: Morphology::Bimanual,
    max_steps: 214,
    demo_steps: 200.7,
    instruction: "lift the pot with both hands and pour its contents into the target container",
    paraphrases: include_str!("paraphrases/dual_arm_pour_pot.txt"),
    nominal,
    success,
    expert,
};

const INF: f64 = f64::INFINITY;
/// World z of the origins of the tray and the tomato at the start, in m.
const TRAY_Z: f64 = 0.85;
const TOMATO_Z: f64 = 0.9;

fn nominal() -> SceneSpec {
    // Regions with the same name draw the same offset: pot and tray stay side by side even when the pot's
    // region is widened.
    let shared_offset = [Range::fixed(0.0), Range::symmetric(0.1)];
    let row = |x: f64, widened_x: Range| RegionSpec {
        shared_offset,
        widened: Some(WidenedRanges {
            x: widened_x,
            y: Range::fixed(0.0),
            shared_offset: shared_offset.map(|range| range.widened(1.5)),
        }),
        ..region("row", Range::fixed(x), Range::fixed(0.0))
    };
    let tomato = BodySpec {
        // Colour and texture perturbations leave the tomato alone, although MO-Size scales it.
        role: Role::Fixture,
        placement: PlacementSpec::Over { body: 0, origin_z_m: TOMATO_Z, surface_z_m: pot::FLOOR_Z },
        ..fruit::tomato(0, BIMANUAL_TABLE_Z)
    };
    let tray = BodySpec { role: Role::ReceiverObject, ..tray::tray(1).with_origin_z(TRAY_Z) };
    let regions = vec![row(0.1, widened_by_half(Range::fixed(0.1))), row(-0.2, Range::fixed(-0.2))];
    bimanual(pot::QPOS, 0.0, &LIFT_CAMERAS, regions, vec![pot::pot(0), tomato, tray], TASK.instruction)
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
const SETTLING_STEPS: u32 = 15;
/// Control steps in which the tomato rolls out of the tilted pot.
const ROLLING_STEPS: u32 = 30;

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
    moves.extend(pot::grasp_both(&grasps));
    moves.extend([
        Move::Waypoints([carried(0.0), carried(back)].map(both_arms).into()),
        Move::Hold { steps: SETTLING_STEPS },
        tilted(POUR_TILT),
        Move::Hold { steps: ROLLING_STEPS },
        tilted(FINAL_TILT),
    ]);
    moves
}
