//! Speed of a run: control steps per second, core-seconds by stage, and the speed bound derived from them.
//!
//! All figures except the `process_` ones cover one window: from the first work (building the first world) to
//! the last control step.

use std::time::Duration;

use serde::Serialize;

use crate::fleet::{EnvChoice, EnvTrial, Totals};
use crate::study::machine::Cores;

/// The definition of `env_steps_per_s`, as printed in the JSON report.
const DEFINITION: &str = "control steps of finished and unfinished episodes / wall seconds from the first work (building the \
    first world) to the last control step, over all envs, policy inference included";

/// Speed of one `run` command. Episodes that an earlier, resumed run finished do not count.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Fps {
    /// Number of control steps executed.
    pub(crate) env_steps: u64,
    /// Wall seconds from the first work to the last control step.
    pub(crate) wall_s: f64,
    /// `env_steps / wall_s`; `None` before the first control step.
    pub(crate) env_steps_per_s: Option<f64>,
    /// The definition of `env_steps_per_s` in words.
    pub(crate) definition: &'static str,
    /// Wall seconds of the whole process, start-up included.
    pub(crate) process_wall_s: f64,
    /// Control steps per second of the whole process, which is the paper's definition.
    pub(crate) process_env_steps_per_s: f64,
    /// Rendered images per second of `wall_s`.
    pub(crate) images_per_s: Option<f64>,
    /// Queries (one per env) per second of `wall_s`.
    pub(crate) queries_per_s: Option<f64>,
    /// The speed that the measured costs allow.
    pub(crate) bound: Option<Bound>,
    /// Speed of inference on the CPU; `None` without networks, or if the peak was not measured.
    pub(crate) inference: Option<InferenceSpeed>,
    /// Use of a GPU, or of a software driver.
    pub(crate) device: Option<DeviceUse>,
    /// Use of attached hosts.
    pub(crate) attached: Vec<AttachedUse>,
    /// The number of envs and how it was chosen; `None` if the user fixed it.
    #[serde(skip)]
    pub(crate) choice: Option<EnvChoice>,
    /// Core-seconds by stage.
    #[serde(skip)]
    pub(crate) ledger: Ledger,
}

/// The speed at which all cores would do nothing but step, render and infer, c / (s + (r + w) / k), or, if
/// that is less, at which the threads of the busiest process would do nothing else, t / p, or at which a
/// device or an attached host would never be idle, k / d.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Bound {
    /// c: number of cores.
    pub(crate) n_cores: u32,
    /// The threads of the busiest process, if a process has fewer threads than there are cores.
    pub(crate) busiest_process: Option<BusiestProcess>,
    /// s: core-seconds per control step of one env.
    pub(crate) step_s: f64,
    /// r: core-seconds of rendering per query of one env.
    pub(crate) render_s: f64,
    /// w: core-seconds of inference per query of one env.
    pub(crate) query_s: f64,
    /// d: wall seconds per query of one env of the device, for rendering or the policy, or of an attached
    /// host, whichever takes longest: they may overlap. `None` without any of them.
    pub(crate) device_s: Option<f64>,
    /// k: control steps per query; `None` without queries.
    pub(crate) steps_per_query: Option<f64>,
    /// The bound itself, in control steps per second.
    pub(crate) env_steps_per_s: f64,
    /// Fraction of the bound that the run reached.
    pub(crate) reached: f64,
}

/// The sim or the policy host that needs most of its threads' time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct BusiestProcess {
    /// t: number of its threads.
    pub(crate) n_threads: u32,
    /// p: core-seconds of stepping and rendering, or of inference, per control step of one env.
    pub(crate) step_s: f64,
}

/// Arithmetic of the policy hosts, compared with what the cores could do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct InferenceSpeed {
    /// GFLOP/s per core while it infers, by the operation count of the direct algorithms.
    pub(crate) gflop_per_core_s: f64,
    /// Peak of a core in f32, on registers only.
    pub(crate) peak_gflop_per_core_s: f64,
    /// Fraction of the peak. Above 1 is possible: 8-bit integers and Winograd convolutions need fewer or
    /// cheaper operations.
    pub(crate) fraction: f64,
}

/// Use of a device in the measured window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct DeviceUse {
    /// Wall seconds of rendering on it.
    pub(crate) render_s: f64,
    /// Wall seconds in which it had a batch of a policy; with several policies, those of the busiest.
    pub(crate) policy_s: f64,
    /// GFLOP/s of the networks in that time, by the operation count of the direct algorithms.
    pub(crate) gflop_per_s: Option<f64>,
}

/// Use of an attached host in the measured window.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct AttachedUse {
    /// Name of its policy.
    pub(crate) policy: String,
    /// Wall seconds in which it had an unanswered query.
    pub(crate) queried_s: f64,
}

/// Core-seconds of a run by stage. They add up to the number of cores times the measured wall time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Ledger {
    /// Building worlds and stepping physics.
    pub(crate) physics_s: f64,
    /// Rendering of observations.
    pub(crate) render_s: f64,
    /// Inference in the policy hosts; with a device, all their work while it has a batch.
    pub(crate) policy_s: f64,
    /// Everything else in sim and policy hosts: assembling batches, shared memory, polling.
    pub(crate) transport_s: f64,
    /// Idle cores, and processes other than sim and policy hosts; foreign hosts are such.
    pub(crate) unused_s: f64,
    /// Wall seconds in which the sim had nothing to do; no part of the sum.
    pub(crate) wait_s: f64,
}

impl Fps {
    /// Computes the figures from a fleet's totals, for a process that has run for `process` on `cores`.
    pub(crate) fn new(totals: &Totals, process: Duration, cores: Cores) -> Self {
        let (sim, hosts) = (totals.sim(), totals.hosts());
        let rate = |count: u64| (sim.wall_s > 0.0).then(|| count as f64 / sim.wall_s);
        let cpu_s = sim.cpu_s + hosts.cpu_s;
        let accounted = sim.physics_s + sim.render_s + hosts.busy_s;
        let ledger = Ledger {
            physics_s: sim.physics_s,
            render_s: sim.render_s,
            policy_s: hosts.busy_s,
            transport_s: (cpu_s - accounted).max(0.0),
            unused_s: (f64::from(cores.count) * sim.wall_s - cpu_s.max(accounted)).max(0.0),
            wait_s: sim.idle_s,
        };
        let inference = |peak_gflop_per_core_s| {
            let gflop_per_core_s = 1e-9 * hosts.flop as f64 / hosts.busy_s;
            InferenceSpeed {
                gflop_per_core_s,
                peak_gflop_per_core_s,
                fraction: gflop_per_core_s / peak_gflop_per_core_s,
            }
        };
        let device = DeviceUse::new(totals);
        let used = |(policy, queried_s)| AttachedUse { policy, queried_s };
        let attached: Vec<AttachedUse> = totals.foreign_hosts().into_iter().map(used).collect();
        let process_wall_s = process.as_secs_f64();
        Self {
            env_steps: sim.env_steps,
            wall_s: sim.wall_s,
            env_steps_per_s: rate(sim.env_steps),
            definition: DEFINITION,
            process_wall_s,
            process_env_steps_per_s: sim.env_steps as f64 / process_wall_s,
            images_per_s: rate(sim.images),
            queries_per_s: rate(sim.queries),
            bound: Bound::new(totals, &ledger, busiest_s(device, &attached), cores),
            inference: cores.peak_gflop.filter(|_| hosts.flop > 0 && hosts.device_s == 0.0).map(inference),
            device,
            attached,
            choice: totals.choice.clone(),
            ledger,
        }
    }

    /// Returns the time of the device or attached host that was busy for longest.
    pub(crate) fn busiest_s(&self) -> Option<f64> {
        busiest_s(self.device, &self.attached)
    }

    /// Returns the line printed under the results table; empty for a run without a control step.
    pub(crate) fn line(&self) -> String {
        let Some(env_steps_per_s) = self.env_steps_per_s else { return String::new() };
        let reached = self.bound.map_or_else(String::new, |bound| {
            format!("; {:.0} % of the bound by cores and devices", 100.0 * bound.reached)
        });
        format!(
            "{env_steps_per_s:.1} env-steps/s: {} control steps in {:.2} s{reached} (--verbose: where the time went)\n",
            self.env_steps, self.wall_s
        )
    }

    /// Returns the lines that tell where the time went; empty for a run without a control step.
    pub(crate) fn lines(&self) -> String {
        let Some(env_steps_per_s) = self.env_steps_per_s else { return String::new() };
        let Ledger { physics_s, render_s, policy_s, transport_s, unused_s, wait_s } = self.ledger;
        let mut text = format!(
            "env_steps_per_s  {env_steps_per_s:.1} ({} control steps in {:.2} s, from the first work to the last step)\n\
             whole process    {:.1} env-steps/s ({:.2} s, start-up included)\n\
             per second       {:.1} images, {:.1} queries\n\
             core-seconds     physics {physics_s:.2}, render {render_s:.2}, policy {policy_s:.2}, transport {transport_s:.2}, \
             unused {unused_s:.2}; sim idle for {wait_s:.2} s\n",
            self.env_steps,
            self.wall_s,
            self.process_env_steps_per_s,
            self.process_wall_s,
            self.images_per_s.unwrap_or(0.0),
            self.queries_per_s.unwrap_or(0.0),
        );
        if let Some(bound) = self.bound {
            text += &bound.line();
        }
        if let Some(speed) = self.inference {
            text += &format!(
                "inference        {:.1} GFLOP/s per core, {:.0} % of the {:.1} that a core reaches in f32 on registers only\n",
                speed.gflop_per_core_s,
                100.0 * speed.fraction,
                speed.peak_gflop_per_core_s,
            );
        }
        if let Some(device) = self.device {
            text += &device.line(self.wall_s);
        }
        if !self.attached.is_empty() {
            text += &attached_line(&self.attached, self.wall_s);
        }
        if let Some(choice) = &self.choice {
            text += &choice_line(choice);
        }
        text
    }
}

/// Returns the line on attached hosts in a run of `wall_s`.
fn attached_line(attached: &[AttachedUse], wall_s: f64) -> String {
    let host = |AttachedUse { policy, queried_s }: &AttachedUse| {
        format!("{policy} {queried_s:.2} s ({:.0} %)", 100.0 * queried_s / wall_s)
    };
    let hosts: Vec<_> = attached.iter().map(host).collect();
    format!("attached hosts   {} with queries\n", hosts.join(", "))
}

/// Returns the longest of the times of a device, for rendering and for policies, and of the attached hosts.
fn busiest_s(device: Option<DeviceUse>, attached: &[AttachedUse]) -> Option<f64> {
    let device = device.map(|device| device.render_s.max(device.policy_s));
    device.into_iter().chain(attached.iter().map(|host| host.queried_s)).reduce(f64::max)
}

/// Returns the line that tells the number of envs and why it was chosen.
fn choice_line(choice: &EnvChoice) -> String {
    let EnvChoice { envs, max_envs, trials } = choice;
    let trial = |trial: &EnvTrial| {
        let EnvTrial { envs, predicted, utilisation, foreign } = trial;
        let others = match (100.0 * foreign).round() {
            0.0 => String::new(),
            percent => format!(", {percent} % taken by other programs"),
        };
        format!("{envs} ({predicted:.0}, cores {:.0} % used{others})", 100.0 * utilisation)
    };
    let listed: Vec<_> = trials.iter().map(trial).collect();
    let why = match listed.as_slice() {
        [] => "the run was too short to try others".to_owned(),
        listed => {
            let is_open = trials.iter().all(|trial| trial.envs != *envs);
            let open = if is_open { format!("; {envs} not measured to the end") } else { String::new() };
            format!("expected env-steps/s: {}{open}", listed.join(", "))
        }
    };
    format!("envs             {envs}, chosen from at most {max_envs}; {why}\n")
}

impl DeviceUse {
    fn new(totals: &Totals) -> Option<Self> {
        let (sim, hosts) = (totals.sim(), totals.hosts());
        (sim.device_s > 0.0 || hosts.device_s > 0.0).then(|| Self {
            render_s: sim.device_s,
            policy_s: hosts.device_s,
            gflop_per_s: (hosts.device_s > 0.0 && hosts.flop > 0)
                .then(|| 1e-9 * hosts.flop as f64 / hosts.device_s),
        })
    }

    /// Returns the line of the report on a run of `wall_s`.
    fn line(self, wall_s: f64) -> String {
        let Self { render_s, policy_s, gflop_per_s } = self;
        let part = |what: &str, seconds: f64| {
            (seconds > 0.0).then(|| format!("{what} {seconds:.2} s ({:.0} %)", 100.0 * seconds / wall_s))
        };
        let speed = gflop_per_s.map(|speed| format!("at {speed:.1} GFLOP/s"));
        let parts = [part("rendering", render_s), part("policies", policy_s), speed];
        format!("device           {}\n", parts.into_iter().flatten().collect::<Vec<_>>().join(", "))
    }
}

impl Bound {
    fn new(totals: &Totals, ledger: &Ledger, device_s: Option<f64>, cores: Cores) -> Option<Self> {
        let sim = totals.sim();
        let per = |seconds: f64, count: u64| if count == 0 { 0.0 } else { seconds / count as f64 };
        let busy_s = ledger.physics_s + ledger.render_s + ledger.policy_s;
        // (r + w) / k per control step equals all core-seconds of rendering and inference over all control
        // steps.
        let on_cores = f64::from(cores.count) * sim.env_steps as f64 / busy_s;
        let busiest_process = (cores.n_threads < cores.count).then(|| BusiestProcess {
            n_threads: cores.n_threads,
            step_s: per((ledger.physics_s + ledger.render_s).max(totals.busiest_host_s()), sim.env_steps),
        });
        let on_threads = busiest_process.map(|busiest| f64::from(busiest.n_threads) / busiest.step_s);
        let on_device = device_s.map(|seconds| sim.env_steps as f64 / seconds);
        let bound = on_threads.into_iter().chain(on_device).fold(on_cores, f64::min);
        (busy_s > 0.0 && sim.wall_s > 0.0).then(|| Self {
            n_cores: cores.count,
            busiest_process,
            step_s: per(ledger.physics_s, sim.env_steps),
            render_s: per(ledger.render_s, sim.queries),
            query_s: per(ledger.policy_s, sim.queries),
            device_s: device_s.map(|seconds| per(seconds, sim.queries)),
            steps_per_query: (sim.queries > 0).then(|| sim.env_steps as f64 / sim.queries as f64),
            env_steps_per_s: bound,
            reached: sim.env_steps as f64 / sim.wall_s / bound,
        })
    }

    /// Returns the line of the report.
    fn line(self) -> String {
        let ms = |seconds: f64| format!("{:.3} ms", 1e3 * seconds);
        let mut terms = vec!["c / (s + (r + w) / k)"];
        let (mut threads, mut device) = (String::new(), String::new());
        if let Some(BusiestProcess { n_threads, step_s }) = self.busiest_process {
            terms.push("t / p");
            threads = format!("t = {n_threads} per process, p = {}, ", ms(step_s));
        }
        if let Some(seconds) = self.device_s {
            terms.push("k / d");
            device = format!("d = {}, ", ms(seconds));
        }
        let formula = match terms.as_slice() {
            [term] => (*term).to_owned(),
            terms => format!("min({})", terms.join(", ")),
        };
        let k = self.steps_per_query.map_or_else(|| "∞".to_owned(), |k| format!("{k:.1}"));
        format!(
            "bound            {:.1} env-steps/s = {formula} with c = {} cores, {threads}s = {}, r = {}, w = {}, {device}\
             k = {k}; {:.0} % reached\n",
            self.env_steps_per_s,
            self.n_cores,
            ms(self.step_s),
            ms(self.render_s),
            ms(self.query_s),
            100.0 * self.reached,
        )
    }
}
