//! A run as meant: names have become enums, lists are complete, limits are checked. No string is compared after this.

use std::collections::BTreeSet;
use std::path::PathBuf;

use ipc_types::{ControlMode, Morphology};
use policy_host::QueryMode;
use sim::perturb::{Composition, CompositionError, Strength, StrengthError};
use sim::render::{RendererChoice, Samples};
use sim::{Perturbation, Profile, TaskId};
use thiserror::Error;

use crate::names::{UnknownName, pick};
use crate::policy::{NamedPolicy, PolicyError};
use crate::sweep::Sweep;

/// Where results go unless the user says otherwise.
const DEFAULT_DB: &str = "hypogeum.db";
const DEFAULT_EPISODES: u32 = 10;
const DEFAULT_ENVS: u32 = 16;
/// Rows of a chunk executed in chunk mode: the benchmark's ACT answers 30.
const DEFAULT_EXECUTE: u32 = 30;
/// Most rows a chunk can have.
const MAX_EXECUTE: u32 = ipc_types::layout::MAX_HORIZON as u32;
const MAX_EPISODES: u32 = 1_000_000;
const MAX_ENVS: u32 = 4096;
const MAX_THREADS: u32 = 1024;

const MODES: [QueryMode; 2] = [QueryMode::Chunk, QueryMode::Ensemble];

/// Everything a run is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plan {
    /// Policies, in the order given.
    pub(crate) policies: Vec<NamedPolicy>,
    /// Tasks with the perturbations to run them under, in the suite's order.
    pub(crate) conditions: Vec<Condition>,
    /// Episodes of each policy under each condition.
    pub(crate) episodes: u32,
    /// Suite seed.
    pub(crate) seed: u64,
    /// Episodes in progress at a time.
    pub(crate) n_envs: u32,
    /// Worker threads of each process.
    pub(crate) threads: u32,
    /// How policies are queried.
    pub(crate) mode: QueryMode,
    /// Rows of a chunk to execute.
    pub(crate) execute: u32,
    /// Reading of the benchmark.
    pub(crate) profile: Profile,
    /// How strong perturbations are.
    pub(crate) strength: Strength,
    /// How single-arm policies drive.
    pub(crate) control_mode: ControlMode,
    /// Who draws.
    pub(crate) renderer: RendererChoice,
    /// How it samples pixels.
    pub(crate) samples: Samples,
    /// Whether the results file keeps the actions, for replays.
    pub(crate) keep_actions: bool,
    /// Results file.
    pub(crate) db: PathBuf,
}

/// A task under a perturbation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Condition {
    pub(crate) task: TaskId,
    pub(crate) perturbation: Composition,
}

/// Why wishes make no plan.
#[derive(Debug, Error)]
pub(crate) enum PlanError {
    #[error(transparent)]
    Name(#[from] UnknownName),
    #[error(transparent)]
    Policy(#[from] PolicyError),
    #[error(
        "no policy to evaluate: say --policy NAME=SPEC, for example --policy idle (or `policies` in the sweep file)"
    )]
    NoPolicy,
    #[error("two policies are called `{name}`: give each a name of its own, --policy NAME=SPEC")]
    SameName { name: String },
    #[error(
        "perturbation {perturbation} does not apply to {task}: {reason}; leave one of them out, or say --perturbations all for those that apply"
    )]
    NotApplicable { task: &'static str, perturbation: &'static str, reason: String },
    #[error(transparent)]
    Incompatible(#[from] CompositionError),
    #[error("--{0}")]
    Strength(#[from] StrengthError),
    #[error("--{flag} is {found}, expected {least} to {most}")]
    Range { flag: &'static str, found: u32, least: u32, most: u32 },
    #[error(
        "--execute is {found}, but ensemble mode queries after every step: leave it out or use --mode chunk"
    )]
    EnsembleExecute { found: u32 },
}

impl Plan {
    /// Gives the wishes their meaning, on a machine with `n_cores` cores.
    ///
    /// # Errors
    /// The first wish that has none.
    pub(crate) fn new(wishes: &Sweep, n_cores: u32) -> Result<Self, PlanError> {
        let policies = policies(&wishes.policies)?;
        let profile = choice("profile", wishes.profile.as_deref(), &Profile::ALL, Profile::name)?;
        let mode = choice("mode", wishes.mode.as_deref(), &MODES, mode_name)?;
        Ok(Self {
            policies,
            conditions: conditions(&tasks(&wishes.tasks)?, &wishes.perturbations)?,
            episodes: in_range("episodes", wishes.episodes.unwrap_or(DEFAULT_EPISODES), MAX_EPISODES)?,
            seed: wishes.seed.unwrap_or(0),
            n_envs: in_range("envs", wishes.envs.unwrap_or(DEFAULT_ENVS), MAX_ENVS)?,
            threads: in_range("threads", wishes.threads.unwrap_or(n_cores), MAX_THREADS)?,
            mode,
            execute: execute(mode, wishes.execute)?,
            profile,
            strength: strength(wishes.strength.unwrap_or(1.0))?,
            control_mode: choice(
                "control mode",
                wishes.control_mode.as_deref(),
                &ControlMode::ALL,
                ControlMode::name,
            )?,
            renderer: choice(
                "renderer",
                wishes.renderer.as_deref(),
                &RendererChoice::ALL,
                RendererChoice::name,
            )?,
            samples: choice("samples", wishes.samples.as_deref(), &Samples::ALL, Samples::name)?,
            keep_actions: wishes.keep_actions,
            db: wishes.db.clone().unwrap_or_else(|| PathBuf::from(DEFAULT_DB)),
        })
    }

    /// Morphologies of the tasks, each once.
    pub(crate) fn morphologies(&self) -> Vec<Morphology> {
        let used = |morphology: &Morphology| {
            self.conditions.iter().any(|condition| condition.task.task().morphology == *morphology)
        };
        Morphology::ALL.into_iter().filter(used).collect()
    }

    /// How policies drive a robot: two arms always by absolute joints.
    pub(crate) fn control_mode_of(&self, morphology: Morphology) -> ControlMode {
        morphology.control_mode(self.control_mode)
    }

    /// Whether any policy looks at images.
    pub(crate) fn needs_images(&self) -> bool {
        self.policies.iter().any(|policy| policy.spec.needs_images())
    }

    /// Episodes of the whole plan.
    pub(crate) fn n_episodes(&self) -> u64 {
        self.policies.len() as u64 * self.conditions.len() as u64 * u64::from(self.episodes)
    }
}

/// Name of a query mode on the command line.
pub(crate) const fn mode_name(mode: QueryMode) -> &'static str {
    match mode {
        QueryMode::Chunk => "chunk",
        QueryMode::Ensemble => "ensemble",
    }
}

/// The perturbation that was typed, or those that were typed with a plus between them.
///
/// # Errors
/// If none is called so, or they cannot act together.
pub(crate) fn perturbation(typed: &str) -> Result<Composition, PlanError> {
    let one = |word| pick("perturbation", word, Perturbation::ALL, Perturbation::name);
    let parts = Composition::split(typed).map(one).collect::<Result<Vec<_>, _>>()?;
    Ok(Composition::new(&parts)?)
}

/// The strength that was typed.
///
/// # Errors
/// If it is not above 0 and up to 1.
pub(crate) fn strength(typed: f64) -> Result<Strength, PlanError> {
    Ok(Strength::try_from(typed)?)
}

/// The task that was typed.
///
/// # Errors
/// If none is called so.
pub(crate) fn task(typed: &str) -> Result<TaskId, UnknownName> {
    pick("task", typed, TaskId::ALL, TaskId::name)
}

/// The profile that was typed.
///
/// # Errors
/// If none is called so.
pub(crate) fn profile(typed: &str) -> Result<Profile, UnknownName> {
    pick("profile", typed, &Profile::ALL, Profile::name)
}

/// A task under a perturbation that changes it.
///
/// # Errors
/// If the perturbation does not apply to the task.
pub(crate) fn condition(task: TaskId, perturbation: Composition) -> Result<Condition, PlanError> {
    perturbation.applies_to(&(task.task().nominal)()).map_err(|(part, error)| PlanError::NotApplicable {
        task: task.name(),
        perturbation: part.name(),
        reason: error.reason,
    })?;
    Ok(Condition { task, perturbation })
}

fn policies(typed: &[String]) -> Result<Vec<NamedPolicy>, PlanError> {
    let policies: Vec<NamedPolicy> = typed.iter().map(|text| text.parse()).collect::<Result<_, _>>()?;
    if policies.is_empty() {
        return Err(PlanError::NoPolicy);
    }
    for (idx, policy) in policies.iter().enumerate() {
        if policies[..idx].iter().any(|earlier| earlier.name == policy.name) {
            return Err(PlanError::SameName { name: policy.name.clone() });
        }
    }
    Ok(policies)
}

/// Tasks in the suite's order, each once. The words for groups may stand among names.
///
/// # Errors
/// If none is called so.
pub(crate) fn tasks(typed: &[String]) -> Result<Vec<TaskId>, PlanError> {
    let groups = |word: &str| -> Option<Box<dyn Fn(TaskId) -> bool>> {
        let of = |morphology| Box::new(move |task: TaskId| task.task().morphology == morphology);
        match word {
            "all" => Some(Box::new(|_| true)),
            "single" => Some(of(Morphology::Single)),
            "bimanual" => Some(of(Morphology::Bimanual)),
            _ => None,
        }
    };
    if typed.is_empty() {
        return Ok(TaskId::ALL.to_vec());
    }
    let mut wanted = Vec::new();
    for word in typed {
        match groups(word) {
            Some(belongs) => wanted.extend(TaskId::ALL.iter().copied().filter(|&task| belongs(task))),
            None => wanted.push(task(word)?),
        }
    }
    Ok(TaskId::ALL.iter().copied().filter(|task| wanted.contains(task)).collect())
}

/// Conditions in the suite's order, each once. `all` may stand among names: those that apply.
fn conditions(tasks: &[TaskId], typed: &[String]) -> Result<Vec<Condition>, PlanError> {
    let names = typed.iter().filter(|word| *word != "all");
    let mut named = names.map(|word| perturbation(word)).collect::<Result<BTreeSet<_>, _>>()?;
    if typed.is_empty() {
        named.insert(Perturbation::None.into());
    }
    let mut wanted = named.clone();
    if typed.iter().any(|word| word == "all") {
        wanted.extend(Perturbation::ALL.iter().map(|&perturbation| Composition::from(perturbation)));
    }
    let mut conditions = Vec::new();
    for &task in tasks {
        for &perturbation in &wanted {
            match condition(task, perturbation) {
                Ok(condition) => conditions.push(condition),
                Err(error) if named.contains(&perturbation) => return Err(error),
                Err(_) => {}
            }
        }
    }
    Ok(conditions)
}

fn execute(mode: QueryMode, typed: Option<u32>) -> Result<u32, PlanError> {
    match (mode, typed) {
        (QueryMode::Chunk, typed) => in_range("execute", typed.unwrap_or(DEFAULT_EXECUTE), MAX_EXECUTE),
        (QueryMode::Ensemble, None | Some(1)) => Ok(1),
        (QueryMode::Ensemble, Some(found)) => Err(PlanError::EnsembleExecute { found }),
    }
}

/// The one of `all` that was typed, or the first.
fn choice<T: Copy>(
    kind: &'static str,
    typed: Option<&str>,
    all: &[T],
    name: impl Fn(T) -> &'static str,
) -> Result<T, UnknownName> {
    typed.map_or(Ok(all[0]), |typed| pick(kind, typed, all, name))
}

fn in_range(flag: &'static str, found: u32, most: u32) -> Result<u32, PlanError> {
    if (1..=most).contains(&found) {
        Ok(found)
    } else {
        Err(PlanError::Range { flag, found, least: 1, most })
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::cli::{Cli, Command};

    /// The plan of a command line, on a machine with two cores.
    fn plan(arguments: &str) -> Result<Plan, String> {
        let words = ["hypogeum", "run"].into_iter().chain(arguments.split_whitespace());
        let Command::Run(args) = Cli::try_parse_from(words).unwrap().command else { panic!("not a run") };
        Plan::new(&args.flags, 2).map_err(|error| error.to_string())
    }

    fn conditions_of(arguments: &str) -> Vec<String> {
        let plan = plan(arguments).unwrap();
        plan.conditions.iter().map(|c| format!("{}/{}", c.task.name(), c.perturbation.name())).collect()
    }

    #[test]
    fn a_policy_is_enough() {
        let plan = plan("--policy idle").unwrap();
        assert_eq!((plan.policies[0].name.as_str(), plan.policies.len()), ("idle", 1));
        assert_eq!(plan.conditions.len(), TaskId::ALL.len());
        assert!(plan.conditions.iter().all(|condition| condition.perturbation == Perturbation::None.into()));
        assert_eq!((plan.episodes, plan.seed, plan.n_envs, plan.threads), (10, 0, 16, 2));
        assert_eq!((plan.mode, plan.execute), (QueryMode::Chunk, 30));
        assert_eq!(plan.db, PathBuf::from("hypogeum.db"));
    }

    #[test]
    fn lists_are_sorted_and_without_repetition() {
        let typed =
            "--policy idle --tasks stackcube,RaiseCube,raisecube --perturbations MO-Color,none,mo-color";
        let expected = ["RaiseCube/None", "RaiseCube/MO-Color", "StackCube/None", "StackCube/MO-Color"];
        assert_eq!(conditions_of(typed), expected);
        let single = conditions_of("--policy idle --tasks stackcube,single,RaiseCube");
        assert_eq!((single.len(), single[0].as_str()), (16, "RaiseCube/None"));
    }

    #[test]
    fn all_perturbations_are_those_that_apply() {
        for condition in plan("--policy idle --perturbations all").unwrap().conditions {
            let nominal = (condition.task.task().nominal)();
            assert_eq!(condition.perturbation.applies_to(&nominal), Ok(()));
        }
        let pairs = TaskId::ALL.iter().flat_map(|task| Perturbation::ALL.iter().map(move |p| (task, p)));
        let applies = |(task, p): &(&TaskId, &Perturbation)| p.applies_to(&(task.task().nominal)()).is_ok();
        assert_eq!(conditions_of("--policy idle --perturbations all").len(), pairs.filter(applies).count());
    }

    #[test]
    fn a_named_perturbation_must_apply() {
        let pairs = TaskId::ALL.iter().flat_map(|&task| Perturbation::ALL.iter().map(move |&p| (task, p)));
        for (task, perturbation) in pairs {
            let typed =
                format!("--policy idle --tasks {} --perturbations {}", task.name(), perturbation.name());
            match (plan(&typed), perturbation.applies_to(&(task.task().nominal)())) {
                (Ok(plan), Ok(())) => {
                    assert_eq!(plan.conditions, [Condition { task, perturbation: perturbation.into() }]);
                }
                (Err(message), Err(error)) => assert!(message.contains(&error.reason), "{message}"),
                (plan, applies) => panic!("{typed}: {plan:?} although {applies:?}"),
            }
        }
    }

    #[test]
    fn perturbations_can_act_together() {
        let typed = "--policy idle --tasks RaiseCube --perturbations camera-pose+mo-color,Camera-Pose,MO-Color+Camera-Pose";
        assert_eq!(conditions_of(typed), ["RaiseCube/Camera-Pose", "RaiseCube/MO-Color+Camera-Pose"]);
        let beside_all =
            conditions_of("--policy idle --tasks OpenDrawer --perturbations all,Light-Color+Table-Color");
        assert!(beside_all.contains(&"OpenDrawer/Table-Color+Light-Color".to_owned()), "{beside_all:?}");
        assert!(beside_all.contains(&"OpenDrawer/All".to_owned()), "{beside_all:?}");
    }

    #[test]
    fn ensembling_queries_every_step() {
        assert_eq!(plan("--policy idle --mode ensemble").unwrap().execute, 1);
        assert_eq!(plan("--policy idle --execute 7").unwrap().execute, 7);
    }

    #[test]
    fn every_wrong_wish_is_one_clear_sentence() {
        let wrong = |arguments| plan(arguments).unwrap_err();
        insta::assert_snapshot!(wrong(""), @"no policy to evaluate: say --policy NAME=SPEC, for example --policy idle (or `policies` in the sweep file)");
        insta::assert_snapshot!(wrong("--policy idle --tasks RiseCube"), @"unknown task `RiseCube`; did you mean RaiseCube or StackCube?");
        insta::assert_snapshot!(wrong("--policy idle --perturbations MO-Colour"), @"unknown perturbation `MO-Colour`; did you mean MO-Color, RO-Color or Light-Color?");
        insta::assert_snapshot!(wrong("--policy idle --perturbations all,xyz"), @"unknown perturbation `xyz`; `hypogeum tasks --matrix` lists them");
        insta::assert_snapshot!(wrong("--policy idle --perturbations MO-Color+Camera-Pos"), @"unknown perturbation `Camera-Pos`; did you mean Camera-Pose?");
        insta::assert_snapshot!(wrong("--policy idle --perturbations MO-Color+"), @"unknown perturbation ``; `hypogeum tasks --matrix` lists them");
        insta::assert_snapshot!(wrong("--policy idle --perturbations MO-Color+None"), @"None cannot be combined with other perturbations");
        insta::assert_snapshot!(wrong("--policy idle --perturbations All+MO-Color"), @"All cannot be combined with other perturbations");
        insta::assert_snapshot!(wrong("--policy idle --perturbations Language-None+Language-Random"), @"Language-None and Language-Random cannot be combined: an episode has a single instruction");
        insta::assert_snapshot!(wrong("--policy idle --tasks OpenDrawer --perturbations Camera-Pose+MO-Size"), @"perturbation MO-Size does not apply to OpenDrawer: the task has no manipulation object; leave one of them out, or say --perturbations all for those that apply");
        insta::assert_snapshot!(wrong("--policy idle --strength 1.5"), @"--strength is 1.5, expected a number above 0 and at most 1 (the benchmark's strength)");
        insta::assert_snapshot!(wrong("--policy idle --strength 0"), @"--strength is 0, expected a number above 0 and at most 1 (the benchmark's strength)");
        insta::assert_snapshot!(wrong("--policy idel"), @"unknown policy `idel`; did you mean idle?");
        insta::assert_snapshot!(wrong("--policy a=act"), @"policy `act` needs PATH after a colon: act:PATH");
        insta::assert_snapshot!(wrong("--policy a/b=idle"), @"policy name `a/b` cannot be used: 1 to 64 letters, digits, `.`, `_` or `-`");
        insta::assert_snapshot!(wrong("--policy idle --policy idle=random"), @"two policies are called `idle`: give each a name of its own, --policy NAME=SPEC");
        insta::assert_snapshot!(wrong("--policy idle --mode chunks"), @"unknown mode `chunks`; did you mean chunk?");
        insta::assert_snapshot!(wrong("--policy idle --renderer gpi"), @"unknown renderer `gpi`; did you mean gpu?");
        insta::assert_snapshot!(wrong("--policy idle --control-mode pd_joint"), @"unknown control mode `pd_joint`; did you mean pd_joint_pos?");
        insta::assert_snapshot!(wrong("--policy idle --envs 0"), @"--envs is 0, expected 1 to 4096");
        insta::assert_snapshot!(wrong("--policy idle --execute 64"), @"--execute is 64, expected 1 to 63");
        insta::assert_snapshot!(wrong("--policy idle --mode ensemble --execute 30"), @"--execute is 30, but ensemble mode queries after every step: leave it out or use --mode chunk");
    }
}
