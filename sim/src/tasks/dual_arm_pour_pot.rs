//! DualArmPourPot: two arms lift a pot and pour the tomato inside it into a tray. See docs/benchmark.md,
//! "Tasks".

use core::f64::consts::PI;

use ipc_types::Morphology;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

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
    // The contact point with the pot's floor, so that the tomato neither floats nor penetrates at any scale
    // of either.
    let on_floor = Isometry3::translation(0.0, 0.0, pot::VESSEL.thickness);
    let tomato = BodySpec {
        placement: PlacementSpec::RelativeTo { body: 0, pose: on_floor },
        ..fruit::tomato(0, BIMANUAL_TABLE_Z)
    };
    let tray = BodySpec { role: Role::ReceiverObject, ..tray::tray(1) };
    let regions = vec![row(0.1, widened_by_half(Range::fixed(0.1))), row(-0.2, Range::fixed(-0.2))];
    bimanual(pot::QPOS, 0.0, &LIFT_CAMERAS, regions, vec![pot::pot(0), tomato, tray], TASK.instruction)
}

/// Requires the tomato's centre to be above the tray and within 75 mm of the table.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let [tomato, tray] = ["tomato", "tray"].map(|name| scene.body_idx(name));
    let scale = |body: usize| if profile.scales_thresholds() { scene.bodies[body].scale.x } else { 1.0 };
    let [x, y] = [0.12, 0.2].map(|half| half * scale(tray));
    let point = [0.0, 0.0, fruit::RADIUS * scene.bodies[tomato].scale.x];
    let within =
        |of, min, max| Predicate::Inside { body: tomato, point, of, region: Region::Box { min, max } };
    vec![within(Some(tray), [-x, -y, -INF], [x, y, INF]), within(None, [-INF, -INF, 0.83], [INF, INF, 0.9])]
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
