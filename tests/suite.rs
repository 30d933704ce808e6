//! Properties of every task of the suite under every perturbation that applies to it.

use ipc_types::{ControlMode, Morphology};
use nalgebra::{Isometry3, Translation3, Vector3};
use rayon::prelude::*;
use sim::expert::Expert;
use sim::perturb::{Composition, Strength};
use sim::physics::World;
use sim::predicate::first_unmet;
use sim::scene::stream::{self, Stream};
use sim::scene::{Body, Motion, Range, Scene};
use sim::{Perturbation, Profile, TaskId};

/// Maximum joint speed after random actions, in rad/s. Near a singularity a pose command may request a full
/// turn; the drive (3000 N·m/rad, 100 N·m·s/rad) then accelerates until damping balances it at this speed.
const fn max_joint_speed(mode: ControlMode) -> f32 {
    match mode {
        ControlMode::EeDeltaPose | ControlMode::EePose => 3000.0 * core::f32::consts::TAU / 100.0,
        ControlMode::JointPos => 30.0,
    }
}

/// Control steps per second.
const STEPS_PER_SECOND: u32 = 20;

fn cells_of(perturbations: &[Perturbation]) -> Vec<(TaskId, Perturbation)> {
    let applies =
        |task: TaskId, p: Perturbation| p.applies_to(&(task.task().nominal)(Profile::Strict)).is_ok();
    let pairs = TaskId::ALL.iter().flat_map(|task| perturbations.iter().map(|p| (*task, *p)));
    pairs.filter(|(task, p)| applies(*task, *p)).collect()
}

/// Cells whose physics differ. All other perturbations change only images or instructions and never a
/// trajectory (`sim/tests/perturb`).
fn cells() -> Vec<(TaskId, Perturbation)> {
    let differ = |p: &Perturbation| *p == Perturbation::None || p.changes_bodies();
    cells_of(&Perturbation::ALL.iter().copied().filter(differ).collect::<Vec<_>>())
}

fn draw(task: TaskId, perturbation: Perturbation, episode_idx: u32) -> Scene {
    draw_under(Profile::Strict, task, perturbation, episode_idx)
}

fn draw_under(profile: Profile, task: TaskId, perturbation: Perturbation, episode_idx: u32) -> Scene {
    let spec = Composition::from(perturbation).spec(task.task(), profile, Strength::FULL);
    spec.draw(stream::episode_seed(0, task.name(), episode_idx))
}

/// A world built from a scene, together with the task's success criterion and the current action row.
struct Rollout<'a> {
    task: TaskId,
    scene: &'a Scene,
    world: World,
    row: Vec<f32>,
}

impl<'a> Rollout<'a> {
    fn new(task: TaskId, scene: &'a Scene, mode: ControlMode) -> Self {
        let row = vec![0.0; mode.action_dim(task.task().morphology)];
        Self { task, scene, world: World::build(scene, mode), row }
    }

    fn succeeds(&self) -> bool {
        first_unmet(&(self.task.task().success)(self.scene, Profile::Strict), &self.world).is_none()
    }

    /// Advances one control step with the current action row.
    fn step(&mut self) {
        self.world.step(&self.row);
        assert!(self.world.is_finite(), "{}: the state is not finite", self.task.name());
    }

    /// Advances one control step with every arm holding its position and grippers open.
    fn hold(&mut self) {
        for (arm, row) in self.row.chunks_exact_mut(8).enumerate() {
            row[..7].copy_from_slice(&self.world.qpos(arm)[..7]);
            row[7] = 1.0;
        }
        self.step();
    }

    fn poses(&self) -> Vec<Isometry3<f32>> {
        (0..self.scene.bodies.len()).map(|body| self.world.body_pose(body)).collect()
    }

    /// Returns the largest displacement of any body since `before`, in m, and the body's name.
    fn max_displacement(&self, before: &[Isometry3<f32>]) -> (f32, &'static str) {
        let poses = self.poses();
        let moved = |(body, (pose, before)): (&Body, (&Isometry3<f32>, &Isometry3<f32>))| {
            ((pose.translation.vector - before.translation.vector).norm(), body.name)
        };
        let moved = self.scene.bodies.iter().zip(poses.iter().zip(before)).map(moved);
        moved.max_by(|a, b| a.0.total_cmp(&b.0)).expect("a scene has bodies")
    }
}

#[test]
fn idle_episode_settles_and_never_succeeds() {
    cells().into_par_iter().for_each(|(task, perturbation)| {
        let cell = format!("{} {}", task.name(), perturbation.name());
        let n_episodes =
            if matches!(perturbation, Perturbation::None | Perturbation::MoSize) { 2 } else { 1 };
        for episode_idx in 0..n_episodes {
            let scene = draw(task, perturbation, episode_idx);
            let mut rollout = Rollout::new(task, &scene, ControlMode::JointPos);
            assert!(!rollout.succeeds(), "{cell} {episode_idx}: success at reset");
            let mut rested = rollout.poses();
            for step in 1..=task.task().max_steps {
                rollout.hold();
                assert!(!rollout.succeeds(), "{cell} {episode_idx}: idle succeeds at {step}");
                if step == STEPS_PER_SECOND {
                    let (settled, body) = rollout.max_displacement(&rested);
                    // The plate in the rack tips until it leans on a divider, the pen's cap onto its clip;
                    // the stove pushes a larger pan aside.
                    let falls = scene.bodies.iter().any(|body| body.drop_m > 0.0)
                        || matches!(task, TaskId::PickDishFromRack | TaskId::DualArmPenCap)
                        || body == "pan" && perturbation != Perturbation::None;
                    let limit = if falls { 0.1 } else { 5e-4 };
                    assert!(settled < limit, "{cell} {episode_idx}: {body} settles by {settled} m");
                    rested = rollout.poses();
                } else if step > STEPS_PER_SECOND && step <= 2 * STEPS_PER_SECOND {
                    let (moved, body) = rollout.max_displacement(&rested);
                    let overlap = rollout.world.max_penetration();
                    // The tomato rolls to and fro in its pot, further if its proportions differ.
                    let limit = match (body, perturbation) {
                        ("tomato", Perturbation::None) => 6e-3,
                        ("tomato", _) => 0.1,
                        _ => 1e-3,
                    };
                    assert!(moved < limit, "{cell} {episode_idx}: {body} moved {moved} m by step {step}");
                    assert!(overlap < 1e-3, "{cell} {episode_idx}: overlaps by {overlap} m");
                }
            }
        }
    });
}

#[test]
fn success_is_false_when_everything_falls_off() {
    cells().into_par_iter().for_each(|(task, perturbation)| {
        let mut scene = draw(task, perturbation, 0);
        let success = (task.task().success)(&scene, Profile::Strict);
        let falls = |motion: Motion| motion == Motion::Dynamic;
        for body in scene.bodies.iter_mut().filter(|body| falls(body.motion)) {
            body.pose = Translation3::from(Vector3::new(3.0, 0.0, 0.0)) * body.pose;
        }
        let mut rollout = Rollout::new(task, &scene, ControlMode::JointPos);
        for _ in 0..task.task().max_steps {
            rollout.hold();
            assert!(first_unmet(&success, &rollout.world).is_some(), "{task:?} {perturbation:?}");
        }
        for (body, drawn) in scene.bodies.iter().enumerate().filter(|(_, body)| falls(body.motion)) {
            let z = rollout.world.body_pose(body).translation.z;
            assert!((-0.95..-0.5).contains(&z), "{task:?}: {} lies at z {z}", drawn.name);
        }
    });
}

#[test]
fn random_actions_keep_the_state_finite() {
    // 21 seeds, divided among the control modes.
    let cases = TaskId::ALL.iter().flat_map(|&task| ControlMode::ALL.map(|mode| (task, mode)));
    let cases: Vec<_> = cases.flat_map(|(task, mode)| (0..7).map(move |idx| (task, mode, idx))).collect();
    cases.into_par_iter().for_each(|(task, mode, episode_idx)| {
        let cell = format!("{} {} {episode_idx}", task.name(), mode.name());
        let scene = draw(task, Perturbation::All, episode_idx);
        let mut rollout = Rollout::new(task, &scene, mode);
        let mut actions = Stream::new(u64::from(episode_idx), "random actions");
        for _ in 0..task.task().max_steps {
            for number in &mut rollout.row {
                *number = actions.uniform(Range::symmetric(1.0)) as f32;
            }
            rollout.step();
        }
        for arm in 0..rollout.world.n_arms() {
            let speed = rollout.world.qvel(arm).iter().fold(0.0_f32, |a, v| a.max(v.abs()));
            assert!(speed < max_joint_speed(mode), "{cell}: {speed} rad/s");
        }
    });
}

/// Runs the expert and returns the number of steps of its plan if it succeeds.
fn run_expert(task: TaskId, perturbation: Perturbation, episode_idx: u32) -> Option<usize> {
    let scene = draw(task, perturbation, episode_idx);
    let mut expert = Expert::new(&scene, &(task.task().expert)(&scene)).ok()?;
    let mut rollout = Rollout::new(task, &scene, ControlMode::JointPos);
    let mut act = |_: u32| {
        expert.act(&rollout.world, &mut rollout.row);
        rollout.step();
        rollout.succeeds()
    };
    let succeeds = (1..=task.task().max_steps).any(&mut act);
    succeeds.then(|| expert.n_steps())
}

/// Maximum relative difference between the mean number of steps of nominal plans and of the original's
/// demonstrations. In DualArmPenCap the original's hands turn by half a turn before they grasp; ours do not
/// (docs/differences.md).
fn max_duration_error(task: TaskId) -> f64 {
    if task.name() == "DualArmPenCap" { 0.18 } else { 0.05 }
}

#[test]
fn nominal_plans_last_as_long_as_demonstrations() {
    let n_episodes = 60_u32;
    TaskId::ALL.into_par_iter().for_each(|&task| {
        let n_steps = |episode_idx: u32| {
            let scene = draw(task, Perturbation::None, episode_idx);
            Some(Expert::new(&scene, &(task.task().expert)(&scene)).ok()?.n_steps())
        };
        let plans: Vec<usize> = (0..n_episodes).into_par_iter().filter_map(n_steps).collect();
        let length = plans.iter().sum::<usize>() as f64 / plans.len() as f64 / task.task().demo_steps;
        let limit = max_duration_error(task);
        assert!((length - 1.0).abs() < limit, "{}: {length} of the demonstrations' length", task.name());
    });
}

#[test]
fn expert_succeeds_in_about_the_demonstrations_time() {
    let n_episodes = 8_u32;
    let cells = cells_of(&[Perturbation::None, Perturbation::MoSize, Perturbation::RoSize]);
    cells.into_par_iter().for_each(|(task, perturbation)| {
        let cell = format!("{} {}", task.name(), perturbation.name());
        let episodes = (0..n_episodes).into_par_iter();
        let plans: Vec<usize> = episodes.filter_map(|idx| run_expert(task, perturbation, idx)).collect();
        assert!(plans.len() + 1 >= n_episodes as usize, "{cell}: {} of {n_episodes}", plans.len());
        let mean = plans.iter().sum::<usize>() as f64 / plans.len() as f64;
        let length = mean / task.task().demo_steps;
        assert!((0.65..1.35).contains(&length), "{cell}: {length} of the demonstrations' length");
    });
}

#[test]
fn expert_mostly_succeeds_under_spatial_perturbations() {
    let n_episodes = 2;
    for perturbation in [Perturbation::PoseRandomization, Perturbation::DistractorObjects, Perturbation::All]
    {
        let cells = cells_of(&[perturbation]);
        let episodes = cells.iter().flat_map(|&(task, _)| (0..n_episodes).map(move |idx| (task, idx)));
        let episodes: Vec<(TaskId, u32)> = episodes.collect();
        let succeeds = |&(task, idx): &(TaskId, u32)| run_expert(task, perturbation, idx).is_some();
        let successes = episodes.par_iter().filter(|episode| succeeds(episode)).count();
        let share = successes as f64 / episodes.len() as f64;
        assert!(share >= 0.9, "{}: {successes} of {}", perturbation.name(), episodes.len());
    }
}

#[test]
fn every_cell_builds_a_valid_world() {
    let cells = cells_of(Perturbation::ALL);
    let both = cells.iter().flat_map(|cell| [Profile::Strict, Profile::Paper].map(|profile| (profile, cell)));
    for (profile, &(task, perturbation)) in both {
        let scene = draw_under(profile, task, perturbation, 1);
        let morphology = task.task().morphology;
        assert_eq!(scene.robots.len(), morphology.n_arms());
        let n_cameras = morphology.n_external_cameras() + morphology.n_hand_cameras();
        assert_eq!(scene.cameras.len(), n_cameras, "{task:?}");
        assert!(scene.instruction.len() <= ipc_types::layout::INSTRUCTION_BYTES);
        let again = draw_under(profile, task, perturbation, 1);
        assert_eq!(scene, again, "the scene should be a function of its seed");
        let world = World::build(&scene, ControlMode::JointPos);
        assert!(world.is_finite(), "{task:?} {perturbation:?} {profile:?}");
    }
}

#[test]
fn suite_is_complete() {
    let of = |morphology| TaskId::ALL.iter().filter(|id| id.task().morphology == morphology).count();
    let [single, bimanual] = Morphology::ALL.map(of);
    assert_eq!((single, bimanual), (16, 12));
    let mut env_ids: Vec<_> = TaskId::ALL.iter().map(|id| id.task().env_id).collect();
    env_ids.sort_unstable();
    env_ids.dedup();
    assert_eq!(env_ids.len(), TaskId::ALL.len(), "env ids should be unique");
    let steps = |morphology| {
        let of = TaskId::ALL.iter().filter(|id| id.task().morphology == morphology);
        of.map(|id| id.task().max_steps).sum::<u32>()
    };
    assert_eq!(Morphology::ALL.map(steps), [4327, 2153], "sums of horizons (docs/benchmark.md, \"Tasks\")");
}
