//! What a control step costs: each task's world, idle and under its expert, on one thread and on two.
//!
//! `cargo bench -p benches --bench physics -- [--csv FILE]`. A control step is five physics steps, its controller and the
//! success predicates; building worlds and planning are reported apart. Worlds are shared out evenly among the threads, and
//! the best of several rounds is reported, after warm-up; bounded to some minutes.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::time::{Duration, Instant};

use anyhow::Result;
use benches::Report;
use ipc_types::ControlMode;
use rayon::prelude::*;
use sim::expert::{Expert, Move};
use sim::physics::{SUBSTEPS, World};
use sim::predicate::{Predicate, first_unmet};
use sim::scene::Scene;
use sim::stream::episode_seed;
use sim::{Profile, TaskId};

/// Time given to one case; a round that has begun is finished.
const CASE_TIME: Duration = Duration::from_millis(500);
/// Episodes whose building and planning are looked at.
const N_SETUPS: u32 = 10;
/// Worlds per thread in a round.
const WORLDS_PER_THREAD: u32 = 2;
/// Control steps of a world before the clock starts: an idle world's bodies have come to rest by then.
const WARM_UP_STEPS: u32 = 10;

fn main() -> Result<()> {
    let mut report = Report::from_args("physics")?;
    for &task in TaskId::ALL {
        let name = task.name();
        let (build_us, plan_us) = setup_costs(task);
        let (steps, demo_steps) = (mean_plan_steps(task), task.task().demo_steps);
        println!(
            "{name}: a world is built in {build_us:.0} us, an expert plans {steps:.0} steps in {plan_us:.0} us"
        );
        let note = format!("of {N_SETUPS} episodes; the benchmark's demonstrations: {demo_steps}");
        report.add(&format!("{name}/plan"), steps, "steps", &note);
        report.add(&format!("{name}/build"), build_us, "us", "one world");
        report.add(&format!("{name}/plan"), plan_us, "us", "one expert");
        for driver in ["idle", "expert"] {
            let mut of_one_thread = f64::NAN;
            for n_threads in [1, 2] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build()?;
                let control = best_rate(&pool, task, driver == "expert");
                let physics = control * SUBSTEPS as f64;
                if n_threads == 1 {
                    of_one_thread = control;
                }
                let gain = control / of_one_thread;
                println!(
                    "  {driver:6} {n_threads} threads: {control:7.0} control steps/s, {physics:7.0} physics steps/s, x{gain:.2}"
                );
                let case = format!("{name}/{driver}/threads{n_threads}");
                report.add(&case, control, "control_steps_per_s", "all threads together");
                report.add(&case, physics, "physics_steps_per_s", "all threads together");
            }
        }
    }
    report.finish()
}

/// One env with everything a control step needs.
struct Env {
    world: World,
    expert: Expert,
    success: Vec<Predicate>,
    row: Vec<f32>,
    max_steps: u32,
}

impl Env {
    fn new(task: TaskId, episode_idx: u32, expert: bool) -> Self {
        let scene = draw(task, episode_idx);
        let moves = if expert { (task.task().expert)(&scene) } else { vec![Move::Hold { steps: 1 }] };
        let mode = ControlMode::JointPos;
        Self {
            world: World::build(&scene, mode),
            expert: Expert::new(&scene, &moves).expect("these episodes are within reach"),
            success: (task.task().success)(&scene, Profile::Strict),
            row: vec![0.0; mode.action_dim(task.task().morphology)],
            max_steps: task.task().max_steps,
        }
    }

    fn run(&mut self, n_steps: u32) {
        for _ in 0..n_steps {
            self.expert.act(&self.world, &mut self.row);
            self.world.step(&self.row);
            std::hint::black_box(first_unmet(&self.success, &self.world));
        }
    }
}

fn draw(task: TaskId, episode_idx: u32) -> Scene {
    (task.task().nominal)().draw(episode_seed(0, task.name(), episode_idx))
}

/// Control steps per second of all threads together, in the fastest round.
fn best_rate(pool: &rayon::ThreadPool, task: TaskId, expert: bool) -> f64 {
    let n_envs = pool.current_num_threads() as u32 * WORLDS_PER_THREAD;
    let mut best = 0.0_f64;
    let started = Instant::now();
    while started.elapsed() < CASE_TIME {
        let mut envs: Vec<Env> = (0..n_envs).map(|episode_idx| Env::new(task, episode_idx, expert)).collect();
        let n_steps = envs[0].max_steps - WARM_UP_STEPS;
        pool.install(|| envs.par_iter_mut().for_each(|env| env.run(WARM_UP_STEPS)));
        let round = Instant::now();
        pool.install(|| envs.par_iter_mut().for_each(|env| env.run(n_steps)));
        best = best.max(f64::from(n_envs * n_steps) / round.elapsed().as_secs_f64());
    }
    best
}

/// Mean length of the expert's plans within reach, in control steps.
fn mean_plan_steps(task: TaskId) -> f64 {
    let n_steps = |episode_idx| {
        let scene = draw(task, episode_idx);
        Expert::new(&scene, &(task.task().expert)(&scene)).ok().map(|plan| plan.n_steps() as f64)
    };
    let plans: Vec<f64> = (0..N_SETUPS).filter_map(n_steps).collect();
    plans.iter().sum::<f64>() / plans.len() as f64
}

/// Fastest building of a world and planning of an expert, in µs.
fn setup_costs(task: TaskId) -> (f64, f64) {
    let fastest = |work: &dyn Fn(&Scene)| {
        let time = |episode_idx| {
            let scene = draw(task, episode_idx);
            let started = Instant::now();
            work(&scene);
            started.elapsed().as_secs_f64() * 1e6
        };
        (0..N_SETUPS).map(time).fold(f64::INFINITY, f64::min)
    };
    let build = fastest(&|scene| {
        std::hint::black_box(World::build(scene, ControlMode::JointPos));
    });
    let plan = fastest(&|scene| {
        let moves = (task.task().expert)(scene);
        std::hint::black_box(Expert::new(scene, &moves).is_ok());
    });
    (build, plan)
}
