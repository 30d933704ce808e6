//! Cost of a control step: the world of each task, idle, driven at random and by its expert, on one thread
//! and on two.
//!
//! `cargo bench -p benches --bench physics -- [--csv FILE]`. A control step consists of five or ten
//! physics steps, the controller and the success predicates. World construction and planning are reported
//! separately. Worlds are distributed evenly over the threads; the fastest of several rounds after warm-up
//! is reported. Takes a few minutes.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::time::{Duration, Instant};

use anyhow::Result;
use benches::Report;
use ipc_types::ControlMode;
use rayon::prelude::*;
use sim::expert::{Expert, Move};
use sim::physics::{CONTROL_HZ, World};
use sim::predicate::{Predicate, first_unmet};
use sim::scene::Scene;
use sim::scene::stream::{Stream, episode_seed};
use sim::{Profile, TaskId};

/// Time per case; a round that has started is finished.
const CASE_TIME: Duration = Duration::from_millis(500);
/// Episodes whose construction and planning are timed.
const N_SETUPS: u32 = 10;
/// Worlds per thread in a round.
const WORLDS_PER_THREAD: u32 = 2;
/// Control steps before the clock starts, in which the bodies of an idle world come to rest.
const WARM_UP_STEPS: u32 = 10;

fn main() -> Result<()> {
    let mut report = Report::from_args("physics")?;
    for &task in TaskId::ALL {
        let name = task.name();
        let (build_us, plan_us) = setup_costs(task);
        let (steps, demo_steps) = (mean_plan_steps(task), task.task().demo_steps);
        println!("{name}: world construction {build_us:.0} us; planning {steps:.0} steps {plan_us:.0} us");
        let note = format!("of {N_SETUPS} episodes; the benchmark's demonstrations: {demo_steps}");
        report.add(&format!("{name}/plan"), steps, "steps", &note);
        report.add(&format!("{name}/build"), build_us, "us", "one world");
        report.add(&format!("{name}/plan"), plan_us, "us", "one expert");
        for driver in [BenchDriver::Idle, BenchDriver::Random, BenchDriver::Expert] {
            let driver_name = format!("{driver:?}").to_lowercase();
            let mut single_thread_rate = f64::NAN;
            for n_threads in [1, 2] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build()?;
                let control = best_rate(&pool, task, driver);
                let physics =
                    control * f64::from((task.task().nominal)(Profile::Strict).physics_hz) / CONTROL_HZ;
                if n_threads == 1 {
                    single_thread_rate = control;
                }
                let speedup = control / single_thread_rate;
                println!(
                    "  {driver_name:6} {n_threads} threads: {control:7.0} control steps/s, {physics:7.0} physics steps/s, x{speedup:.2}"
                );
                let case = format!("{name}/{driver_name}/threads{n_threads}");
                report.add(&case, control, "control_steps_per_s", "all threads together");
                report.add(&case, physics, "physics_steps_per_s", "all threads together");
            }
        }
    }
    report.finish()
}

/// Source of the arms' motion.
#[derive(Clone, Copy, Debug, PartialEq)]
enum BenchDriver {
    Idle,
    /// Tool motions drawn uniformly at every control step.
    Random,
    Expert,
}

/// An env with everything that a control step needs.
struct PhysicsEnv {
    world: World,
    expert: Expert,
    random: Option<Stream>,
    success: Vec<Predicate>,
    row: Vec<f32>,
    max_steps: u32,
}

impl PhysicsEnv {
    fn new(task: TaskId, episode_idx: u32, driver: BenchDriver) -> Self {
        let scene = draw(task, episode_idx);
        let moves = match driver {
            BenchDriver::Expert => (task.task().expert)(&scene),
            BenchDriver::Idle | BenchDriver::Random => vec![Move::Hold { steps: 1 }],
        };
        let is_random = driver == BenchDriver::Random;
        let mode = if is_random { ControlMode::EeDeltaPose } else { ControlMode::JointPos };
        Self {
            random: is_random.then(|| Stream::new(u64::from(episode_idx), "actions")),
            world: World::build(&scene, mode),
            expert: Expert::new(&scene, &moves).expect("the benchmark's episodes have a plan"),
            success: (task.task().success)(&scene, Profile::Strict),
            row: vec![0.0; mode.action_dim(task.task().morphology)],
            max_steps: task.task().max_steps,
        }
    }

    fn run(&mut self, n_steps: u32) {
        for _ in 0..n_steps {
            match &mut self.random {
                Some(stream) => self.row.fill_with(|| 2.0 * stream.unit() as f32 - 1.0),
                None => self.expert.act(&self.world, &mut self.row),
            }
            self.world.step(&self.row);
            std::hint::black_box(first_unmet(&self.success, &self.world));
        }
    }
}

fn draw(task: TaskId, episode_idx: u32) -> Scene {
    (task.task().nominal)(Profile::Strict).draw(episode_seed(0, task.name(), episode_idx))
}

/// Returns the control steps per second of all threads together, in the fastest round.
fn best_rate(pool: &rayon::ThreadPool, task: TaskId, driver: BenchDriver) -> f64 {
    let n_envs = pool.current_num_threads() as u32 * WORLDS_PER_THREAD;
    let mut best = 0.0_f64;
    let started = Instant::now();
    while started.elapsed() < CASE_TIME {
        let mut envs: Vec<PhysicsEnv> =
            (0..n_envs).map(|episode_idx| PhysicsEnv::new(task, episode_idx, driver)).collect();
        let n_steps = envs[0].max_steps - WARM_UP_STEPS;
        pool.install(|| envs.par_iter_mut().for_each(|env| env.run(WARM_UP_STEPS)));
        let round = Instant::now();
        pool.install(|| envs.par_iter_mut().for_each(|env| env.run(n_steps)));
        best = best.max(f64::from(n_envs * n_steps) / round.elapsed().as_secs_f64());
    }
    best
}

/// Returns the mean length of the expert's plans in control steps, over the episodes that have a plan.
fn mean_plan_steps(task: TaskId) -> f64 {
    let n_steps = |episode_idx| {
        let scene = draw(task, episode_idx);
        Expert::new(&scene, &(task.task().expert)(&scene)).ok().map(|plan| plan.n_steps() as f64)
    };
    let plans: Vec<f64> = (0..N_SETUPS).filter_map(n_steps).collect();
    plans.iter().sum::<f64>() / plans.len() as f64
}

/// Returns the fastest world construction and the fastest expert planning, in µs.
fn setup_costs(task: TaskId) -> (f64, f64) {
    let fastest_us = |work: &dyn Fn(&Scene)| {
        let time_us = |episode_idx| {
            let scene = draw(task, episode_idx);
            let started = Instant::now();
            work(&scene);
            started.elapsed().as_secs_f64() * 1e6
        };
        (0..N_SETUPS).map(time_us).fold(f64::INFINITY, f64::min)
    };
    let build_us = fastest_us(&|scene| {
        std::hint::black_box(World::build(scene, ControlMode::JointPos));
    });
    let plan_us = fastest_us(&|scene| {
        let moves = (task.task().expert)(scene);
        std::hint::black_box(Expert::new(scene, &moves).is_ok());
    });
    (build_us, plan_us)
}
