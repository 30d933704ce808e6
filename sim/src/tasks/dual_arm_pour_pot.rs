//! DualArmPourPot: two arms lift a pot and pour the tomato in it into a tray (spec/tasks.md §3, task 22).

use core::f64::consts::PI;

use ipc_types::Morphology;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::common::{BIMANUAL_TABLE_Z, LIFT_CAMERAS, bimanual, widened_by_half, fruit, pot, region, tray};
use crate::expert::{Move, both_arms, grasp};
use crate::predicate::{Predicate, Region};
use crate::profile::Profile;
use crate::profile::ProfileRules;
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

const FAR: f64 = f64::INFINITY;

fn nominal() -> SceneSpec {
    // Regions of one name draw the same offset: pot and tray stand side by side, also where the benchmark widens the pot's.
    let along = [Range::fixed(0.0), Range::symmetric(0.1)];
    let place = |x: f64, widened_x: Range| RegionSpec {
        shared_offset: along,
        widened: Some(WidenedRanges {
            x: widened_x,
            y: Range::fixed(0.0),
            shared_offset: along.map(|range| range.widened(1.5)),
        }),
        ..region("row", Range::fixed(x), Range::fixed(0.0))
    };
    // Where it touches the floor: at any size of either, it neither hovers nor sinks in.
    let on_floor = Isometry3::translation(0.0, 0.0, pot::VESSEL.thickness);
    let tomato = BodySpec {
        placement: PlacementSpec::RelativeTo { body: 0, pose: on_floor },
        ..fruit::tomato(0, BIMANUAL_TABLE_Z)
    };
    let tray = BodySpec { role: Role::ReceiverObject, ..tray::tray(1) };
    let regions = vec![place(0.1, widened_by_half(Range::fixed(0.1))), place(-0.2, Range::fixed(-0.2))];
    bimanual(pot::QPOS, 0.0, &LIFT_CAMERAS, regions, vec![pot::pot(0), tomato, tray], TASK.instruction)
}

/// The tomato's middle over the tray and within 75 mm of the table.
fn success(scene: &Scene, profile: Profile) -> Vec<Predicate> {
    let [tomato, tray] = ["tomato", "tray"].map(|name| scene.body_idx(name));
    let scale = |body: usize| if profile.scales_thresholds() { scene.bodies[body].scale } else { 1.0 };
    let [x, y] = [0.12, 0.2].map(|half| half * scale(tray));
    let point = [0.0, 0.0, fruit::RADIUS * scene.bodies[tomato].scale];
    let within = |of, least, greatest| Predicate::Inside {
        body: tomato,
        point,
        of,
        region: Region::Box { min: least, max: greatest },
    };
    vec![within(Some(tray), [-x, -y, -FAR], [x, y, FAR]), within(None, [-FAR, -FAR, 0.83], [FAR, FAR, 0.9])]
}

/// How far the pot is raised, and how far beyond the tray it is then brought back towards the robots, in m.
const UP: f64 = 0.15;
const BEYOND: f64 = 0.04;
/// How far the pot is tipped until the tomato rolls out gently, and then turned over, in rad.
const TIPPED: f64 = 1.5;
const TURNED: f64 = 2.0 * PI / 2.05;
/// Control steps in which the tomato comes to rest in the carried pot, and in which it rolls out of the tipped one.
const SETTLING_STEPS: u32 = 15;
const ROLLING_STEPS: u32 = 30;

fn expert(scene: &Scene) -> Vec<Move> {
    let grips = pot::grips(scene);
    let [pot_x, tray_x] = ["pot", "tray"].map(|name| scene.body(name).pose.translation.x);
    let back = pot_x - tray_x + BEYOND;
    let carried = |back_m: f64| grips.map(|tcp| grasp::translated(&tcp, &Vector3::new(-back_m, 0.0, UP)));
    let turned = |angle: f64| {
        let turn = |arm: usize| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), [angle, -angle][arm]);
        Move::Straight(both_arms([0, 1].map(|arm| carried(back)[arm] * turn(arm))))
    };
    let mut moves = vec![Move::Joint(both_arms(grips.each_ref().map(pot::away)))];
    moves.extend(pot::seize(&grips));
    moves.extend([
        Move::Waypoints([carried(0.0), carried(back)].map(both_arms).into()),
        Move::Hold { steps: SETTLING_STEPS },
        turned(TIPPED),
        Move::Hold { steps: ROLLING_STEPS },
        turned(TURNED),
    ]);
    moves
}
