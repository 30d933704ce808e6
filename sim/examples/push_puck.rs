//! A task outside the suite, PushPuck: push a puck across a line.
//!
//! ```sh
//! cargo run --release --locked -p sim --example push_puck
//! ```
//!
//! As a task of the suite, it would be `sim/src/tasks/push_puck.rs`, end before [`main`], have `crate` in
//! place of `sim` and `pub(crate) const TASK`, and be listed in `task_list!`: `push_puck => PushPuck,`.

use ipc_types::{ControlMode, Morphology};
use nalgebra::Vector3;
use sim::expert::{Expert, Move, grasp};
use sim::perturb::{Composition, Strength};
use sim::physics::World;
use sim::predicate::{Predicate, first_unmet};
use sim::scene::{AppearanceSpec, PartSpec, Primitive, Range, Scene, SceneSpec};
use sim::task::{Category, Task};
use sim::tasks::common::{
    ExternalCameras, QPOS_D, QPOS_NOISE_RAD, SINGLE_TABLE_Z, movable, region, single_arm,
};
use sim::{Perturbation, Profile};

const TASK: Task = Task {
    env_id: "PushPuck-v1",
    category: Category::Reorientation,
    morphology: Morphology::Single,
    max_steps: 120,
    demo_steps: 80.0,
    instruction: "push the puck over the line",
    lerobot_instruction: "Push the puck",
    paraphrases: "shove the puck beyond the line\nget the puck past the line",
    nominal,
    success,
    expert,
};

/// World x of the line, in m.
const LINE_X: f64 = 0.15;
/// Radius of the puck, in m.
const RADIUS: f64 = 0.03;

fn nominal(_profile: Profile) -> SceneSpec {
    let shape = Primitive::Cylinder { radius: RADIUS, half_height: 0.02 };
    let orange = AppearanceSpec::plain([0.9, 0.4, 0.1]);
    let puck = movable("puck", vec![PartSpec::at(shape, [0.0; 3], orange)], 0, SINGLE_TABLE_Z);
    let target = [0.0, 0.0, 0.1];
    let cameras =
        ExternalCameras { external1: [[0.5, -0.3, 0.4], target], external2: [[0.5, 0.3, 0.4], target] };
    let start = region("puck", Range::new(0.0, 0.05), Range::symmetric(0.05));
    single_arm(QPOS_D, QPOS_NOISE_RAD, &cameras, vec![start], vec![puck], TASK.instruction)
}

/// Succeeds when the puck is on the table and beyond the line.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let min = [LINE_X, f64::NEG_INFINITY, 0.0];
    vec![Predicate::inside_box(scene.body_idx("puck"), min, [f64::INFINITY; 3])]
}

/// Lowers the closed fingers behind the puck and pushes it straight ahead.
fn expert(scene: &Scene) -> Vec<Move> {
    let puck = scene.body("puck").pose.translation.vector;
    let behind = Vector3::new(puck.x - RADIUS - 0.04, puck.y, 0.02);
    let tcp = grasp::pose(&behind, &-Vector3::z(), &grasp::start_closing(scene, 0));
    let beyond = grasp::translated(&tcp, &(Vector3::x() * (LINE_X + 0.07 - puck.x)));
    vec![
        Move::close(&[0], 4),
        Move::straight(0, grasp::retreated(&tcp, 0.1)),
        Move::straight(0, tcp),
        Move::straight(0, beyond),
    ]
}

/// Draws an episode in which the puck has another size, and runs the expert and an idle arm in it.
#[expect(clippy::print_stdout, reason = "it is a program that shows something")]
fn main() {
    let spec = Composition::from(Perturbation::MoSize).spec(&TASK, Profile::Strict, Strength::FULL);
    let scene = spec.draw(7);
    for (name, plan) in [("the expert", expert(&scene)), ("an idle arm", vec![Move::Hold { steps: 1 }])] {
        match first_success(&scene, &plan) {
            Some(step) => println!("{name} succeeds at control step {step} of {}", TASK.max_steps),
            None => println!("{name} fails"),
        }
    }
}

/// Executes a plan and returns the control step of its first success, if any.
fn first_success(scene: &Scene, plan: &[Move]) -> Option<u32> {
    let mut world = World::build(scene, ControlMode::JointPos);
    let mut expert = Expert::new(scene, plan).expect("the arm can follow the plan");
    let mut row = [0.0; 8];
    (1..=TASK.max_steps).find(|_| {
        expert.act(&world, &mut row);
        world.step(&row);
        first_unmet(&(TASK.success)(scene, Profile::Strict), &world).is_none()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expert_succeeds_and_idle_arm_fails() {
        for seed in 0..3 {
            let scene = nominal(Profile::Strict).draw(seed);
            assert!(first_success(&scene, &expert(&scene)).is_some(), "seed {seed}");
            assert!(first_success(&scene, &[Move::Hold { steps: 1 }]).is_none(), "seed {seed}");
        }
    }
}
