//! The resolved plan of a run: policies, conditions and options, complete and checked.

pub(crate) mod capacity;
pub(crate) mod jobs;
pub(crate) mod lanes;
pub(crate) mod partition;
pub(crate) mod sweep;

use std::collections::BTreeSet;
use std::path::PathBuf;

use ipc_types::{ControlMode, Morphology};
use policy_host::PolicyCheck;
use run_config::{Execution, ProtocolName, QueryMode, ResultOptions, RunConfig};
use sim::TaskId;
use sim::perturb::{Language, SentencesError};
use thiserror::Error;

use crate::plan::sweep::SweepArgs;
use crate::run::stopping::StoppingRule;
use crate::selection::condition::{Condition, ConditionError};
use crate::selection::policy::NamedPolicy;
use crate::selection::selectors::{PerturbationSelector, TaskSelector};
use crate::statistics::Levels;

/// A resolved run.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RunPlan {
    /// Policies, in the order given.
    pub(crate) policies: Vec<NamedPolicy>,
    /// The use of each policy's chunks, as far as the options say it: checkpoints may decide otherwise.
    pub(crate) executions: Vec<Execution>,
    /// Conditions, in the order of the suite.
    pub(crate) conditions: Vec<Condition>,
    /// Episodes of each policy under each condition.
    pub(crate) episodes: u32,
    /// Options that reach the children.
    pub(crate) config: RunConfig,
    /// Path of the results file.
    pub(crate) db: PathBuf,
    /// The comparison that ends cells early.
    pub(crate) stopping: Option<StoppingRule>,
}

/// Errors that can occur while resolving arguments into a plan.
#[derive(Debug, Error)]
pub(crate) enum PlanError {
    #[error(
        "no policy to evaluate: add --policy NAME=SPEC, for example --policy idle (or `policies` in the sweep file)"
    )]
    NoPolicy,
    #[error("two policies are named `{name}`: give each its own name, --policy NAME=SPEC")]
    SameName { name: String },
    #[error(transparent)]
    Condition(#[from] ConditionError),
    #[error(
        "--execute is {found}, but ensemble mode queries at every step: omit --execute or use --mode chunk"
    )]
    EnsembleExecute { found: u32 },
    #[error("--latency is {found} ms, but {reason}")]
    Latency { found: u32, reason: &'static str },
    #[error("--until-decided needs two policies of the run, separated by a comma; found `{found}`")]
    UntilDecided { found: String },
    #[error(
        "policy `{}` was trained for protocol {}, `{}` for {}: evaluate them in separate runs, or choose one with --protocol",
        policies[0], protocols[0], policies[1], protocols[1]
    )]
    Protocols { policies: [String; 2], protocols: [&'static str; 2] },
    #[error("failed to read the sentences")]
    Sentences(#[from] SentencesError),
}

impl RunPlan {
    /// Resolves arguments into a plan.
    ///
    /// # Errors
    /// If arguments contradict each other or a named perturbation does not apply to a task.
    pub(crate) fn new(args: &SweepArgs) -> Result<Self, PlanError> {
        let SweepArgs { policies, tasks, perturbations, episodes, db, config, .. } = args;
        check_policies(policies)?;
        let (options, query) = (&config.results, config.query);
        if let (Some(QueryMode::Ensemble), Some(found @ 2..)) = (query.mode, query.execute) {
            return Err(PlanError::EnsembleExecute { found });
        }
        check_latency(options.latency, query.without_checkpoint())?;
        check_start_pose(options)?;
        let conditions = conditions(&TaskSelector::select(tasks), perturbations)?;
        let mut config = config.clone();
        config.results.protocol = config.protocol.resolve(None);
        let plan = Self {
            policies: policies.clone(),
            executions: vec![query.without_checkpoint(); policies.len()],
            conditions,
            episodes: *episodes,
            config,
            db: db.clone(),
            stopping: stopping_rule(args)?,
        };
        plan.check_sentences()?;
        Ok(plan)
    }

    /// Returns the morphologies of the tasks, each once.
    pub(crate) fn morphologies(&self) -> Vec<Morphology> {
        let used = |morphology: &Morphology| {
            self.conditions.iter().any(|condition| condition.task.task().morphology == *morphology)
        };
        Morphology::ALL.into_iter().filter(used).collect()
    }

    /// Returns the instructions that episodes may have, each once with its robot; random ones are not among
    /// them.
    ///
    /// # Errors
    /// If the file of `--language` cannot be read.
    pub(crate) fn instructions(&self) -> Result<Vec<(Morphology, String)>, SentencesError> {
        let ResultOptions { profile, strength, .. } = self.config.results;
        let language = self.language()?;
        let mut instructions = BTreeSet::new();
        for Condition { task, perturbation } in &self.conditions {
            let task = task.task();
            let mut spec = perturbation.spec(task, profile, strength);
            language.apply(task, profile, &mut spec);
            let sentences = spec.instruction.sentences();
            instructions.extend(sentences.into_iter().map(|text| (task.morphology, text.to_owned())));
        }
        Ok(instructions.into_iter().collect())
    }

    /// Chooses the protocol: the user's, or else the one that the policies' checkpoints were trained for.
    ///
    /// # Errors
    /// If the user chose none and the checkpoints were trained for different ones, or a sentence is missing.
    pub(crate) fn choose_protocol<'a>(
        &mut self,
        checks: impl Iterator<Item = (&'a str, &'a PolicyCheck)>,
    ) -> Result<(), PlanError> {
        let mut trained = checks.filter_map(|(name, check)| {
            let is_network = !check.mappings.is_empty();
            let protocol = check.mappings.iter().find_map(|mapping| mapping.protocol);
            is_network.then_some((name, protocol.unwrap_or_default()))
        });
        let first = trained.next();
        let options = &self.config.protocol;
        if let (None, Some((name, protocol))) = (options.protocol, first)
            && let Some((other, other_protocol)) = trained.find(|(_, other)| *other != protocol)
        {
            return Err(PlanError::Protocols {
                policies: [name, other].map(str::to_owned),
                protocols: [protocol, other_protocol].map(ProtocolName::name),
            });
        }
        self.config.results.protocol = options.resolve(first.map(|(_, protocol)| protocol));
        self.check_sentences()
    }

    /// Checks that there are sentences for all tasks.
    fn check_sentences(&self) -> Result<(), PlanError> {
        let (language, profile) = (self.language()?, self.config.results.profile);
        let require = |condition: &Condition| language.require(condition.task.task(), profile);
        Ok(self.conditions.iter().try_for_each(require)?)
    }

    fn language(&self) -> Result<Language, SentencesError> {
        let ResultOptions { protocol, language, .. } = &self.config.results;
        Language::read(&protocol.instructions, language.as_ref())
    }

    /// Returns the control mode of policies with this morphology. Two arms always use absolute joint
    /// positions.
    pub(crate) fn control_mode_of(&self, morphology: Morphology) -> ControlMode {
        morphology.control_mode(self.config.results.control_mode)
    }

    /// Returns `true` if any policy reads images.
    pub(crate) fn needs_images(&self) -> bool {
        self.policies.iter().any(|policy| policy.spec.needs_images())
    }

    /// Returns the names of the policies whose cells may end early.
    pub(crate) fn stopped(&self) -> &[String] {
        self.stopping.as_ref().map_or(&[], |rule| &rule.policies)
    }

    /// Returns the number of episodes of the whole plan.
    pub(crate) fn n_episodes(&self) -> u64 {
        self.policies.len() as u64 * self.conditions.len() as u64 * u64::from(self.episodes)
    }
}

/// Checks that latency is defined for the use of a policy's chunks.
pub(crate) fn check_latency(latency: u32, execution: Execution) -> Result<(), PlanError> {
    let reason = "ensemble mode averages predictions for the present step: use --mode chunk";
    match (latency, execution.mode) {
        (0, _) | (_, QueryMode::Chunk) => Ok(()),
        (found, QueryMode::Ensemble) => Err(PlanError::Latency { found, reason }),
    }
}

/// Checks that the arms can hold their start pose until the first action takes effect.
fn check_start_pose(options: &ResultOptions) -> Result<(), PlanError> {
    let reason = "pd_ee_pose has no action that holds the start pose: use another --control-mode";
    match (options.latency, options.control_mode) {
        (found @ 1.., ControlMode::EePose) => Err(PlanError::Latency { found, reason }),
        _ => Ok(()),
    }
}

/// Returns the rule of `--until-decided`, whose two policies must be different ones of the run.
fn stopping_rule(args: &SweepArgs) -> Result<Option<StoppingRule>, PlanError> {
    let names = &args.until_decided;
    if names.is_empty() {
        return Ok(None);
    }
    let is_known = |name: &String| args.policies.iter().any(|policy| policy.name == *name);
    match names.as_slice() {
        [a, b] if a != b && is_known(a) && is_known(b) => {
            let levels = Levels { alpha: args.alpha, margin: args.margin };
            Ok(Some(StoppingRule { policies: [a.clone(), b.clone()], levels }))
        }
        _ => Err(PlanError::UntilDecided { found: names.join(",") }),
    }
}

/// Checks that there is a policy and that no two have the same name.
pub(crate) fn check_policies(policies: &[NamedPolicy]) -> Result<(), PlanError> {
    if policies.is_empty() {
        return Err(PlanError::NoPolicy);
    }
    for (idx, policy) in policies.iter().enumerate() {
        if policies[..idx].iter().any(|earlier| earlier.name == policy.name) {
            return Err(PlanError::SameName { name: policy.name.clone() });
        }
    }
    Ok(())
}

/// Returns the conditions in the order of the suite, each once. A named perturbation must apply to every
/// task.
fn conditions(tasks: &[TaskId], selectors: &[PerturbationSelector]) -> Result<Vec<Condition>, PlanError> {
    let named = PerturbationSelector::named(selectors);
    let mut conditions = Vec::new();
    for &task in tasks {
        let mut selected = named.clone();
        for &perturbation in &named {
            Condition::new(task, perturbation)?;
        }
        if selectors.contains(&PerturbationSelector::Applicable) {
            selected.extend(Condition::all_of(task).map(|condition| condition.perturbation));
        }
        conditions.extend(selected.into_iter().map(|perturbation| Condition { task, perturbation }));
    }
    Ok(conditions)
}

#[cfg(test)]
mod tests {
    use run_config::Amount;
    use sim::{Perturbation, Profile};

    use super::*;

    /// Resolves the arguments of `run`. An error is returned as its text, a clap error without the usage.
    fn plan(arguments: &str) -> Result<RunPlan, String> {
        let args = SweepArgs::parse(arguments).map_err(|error| {
            error.to_string().lines().take_while(|line| !line.is_empty()).collect::<Vec<_>>().join("\n")
        })?;
        RunPlan::new(&args).map_err(|error| error.to_string())
    }

    fn conditions_of(arguments: &str) -> Vec<String> {
        let plan = plan(arguments).unwrap();
        plan.conditions.iter().map(|c| format!("{}/{}", c.task.name(), c.perturbation.name())).collect()
    }

    #[test]
    fn policy_alone_is_a_complete_plan() {
        let plan = plan("--policy idle").unwrap();
        assert_eq!((plan.policies[0].name.as_str(), plan.policies.len()), ("idle", 1));
        assert_eq!(plan.conditions.len(), TaskId::ALL.len());
        assert!(plan.conditions.iter().all(|condition| condition.perturbation == Perturbation::None.into()));
        assert_eq!((plan.episodes, plan.config), (10, RunConfig::default()));
        let RunConfig { results, resources, .. } = RunConfig::default();
        assert_eq!((results.seed, resources.envs, resources.threads), (0, Amount::Auto, Amount::Auto));
        assert_eq!(resources.n_threads(), run_config::allotment::n_cores());
        assert_eq!(plan.executions, [Execution::chunk(30)]);
        assert_eq!(plan.db, PathBuf::from("hypogeum.db"));
    }

    #[test]
    fn lists_are_sorted_and_deduplicated() {
        let typed =
            "--policy idle --tasks stackcube,RaiseCube,raisecube --perturbations MO-Color,none,mo-color";
        let expected = ["RaiseCube/None", "RaiseCube/MO-Color", "StackCube/None", "StackCube/MO-Color"];
        assert_eq!(conditions_of(typed), expected);
        let single = conditions_of("--policy idle --tasks stackcube,single,RaiseCube");
        assert_eq!((single.len(), single[0].as_str()), (16, "RaiseCube/None"));
    }

    #[test]
    fn all_selects_perturbations_that_apply() {
        for condition in plan("--policy idle --perturbations all").unwrap().conditions {
            let nominal = (condition.task.task().nominal)(Profile::Strict);
            assert_eq!(condition.perturbation.applies_to(&nominal), Ok(()));
        }
        let pairs = TaskId::ALL.iter().flat_map(|task| Perturbation::ALL.iter().map(move |p| (task, p)));
        let applies = |(task, p): &(&TaskId, &Perturbation)| {
            p.applies_to(&(task.task().nominal)(Profile::Strict)).is_ok()
        };
        assert_eq!(conditions_of("--policy idle --perturbations all").len(), pairs.filter(applies).count());
    }

    #[test]
    fn named_perturbation_must_apply() {
        let pairs = TaskId::ALL.iter().flat_map(|&task| Perturbation::ALL.iter().map(move |&p| (task, p)));
        for (task, perturbation) in pairs {
            let typed =
                format!("--policy idle --tasks {} --perturbations {}", task.name(), perturbation.name());
            match (plan(&typed), perturbation.applies_to(&(task.task().nominal)(Profile::Strict))) {
                (Ok(plan), Ok(())) => {
                    assert_eq!(plan.conditions, [Condition { task, perturbation: perturbation.into() }]);
                }
                (Err(message), Err(error)) => assert!(message.contains(&error.reason), "{message}"),
                (plan, applies) => panic!("{typed}: {plan:?} although {applies:?}"),
            }
        }
    }

    #[test]
    fn perturbations_compose_with_plus() {
        let typed = "--policy idle --tasks RaiseCube --perturbations camera-pose+mo-color,Camera-Pose,MO-Color+Camera-Pose";
        assert_eq!(conditions_of(typed), ["RaiseCube/Camera-Pose", "RaiseCube/MO-Color+Camera-Pose"]);
        let beside_all =
            conditions_of("--policy idle --tasks OpenDrawer --perturbations all,Light-Color+Table-Color");
        assert!(beside_all.contains(&"OpenDrawer/Table-Color+Light-Color".to_owned()), "{beside_all:?}");
        assert!(beside_all.contains(&"OpenDrawer/All".to_owned()), "{beside_all:?}");
    }

    #[test]
    fn ensemble_mode_executes_one_row() {
        assert_eq!(plan("--policy idle --mode ensemble").unwrap().executions, [Execution::ENSEMBLE]);
        assert_eq!(plan("--policy idle --execute 7").unwrap().executions, [Execution::chunk(7)]);
    }

    #[test]
    fn invalid_arguments_give_one_clear_error() {
        let wrong = |arguments| plan(arguments).unwrap_err();
        insta::assert_snapshot!(wrong(""), @"no policy to evaluate: add --policy NAME=SPEC, for example --policy idle (or `policies` in the sweep file)");
        insta::assert_snapshot!(wrong("--policy idle --tasks RiseCube"), @"error: invalid value 'RiseCube' for '--tasks <LIST>': unknown task `RiseCube`; did you mean RaiseCube or StackCube?");
        insta::assert_snapshot!(wrong("--policy idle --perturbations MO-Colour"), @"error: invalid value 'MO-Colour' for '--perturbations <LIST>': unknown perturbation `MO-Colour`; did you mean MO-Color, RO-Color or Light-Color?");
        insta::assert_snapshot!(wrong("--policy idle --perturbations all,xyz"), @"error: invalid value 'xyz' for '--perturbations <LIST>': unknown perturbation `xyz`; `hypogeum tasks --matrix` lists all names");
        insta::assert_snapshot!(wrong("--policy idle --perturbations MO-Color+Camera-Pos"), @"error: invalid value 'MO-Color+Camera-Pos' for '--perturbations <LIST>': unknown perturbation `Camera-Pos`; did you mean Camera-Pose?");
        insta::assert_snapshot!(wrong("--policy idle --perturbations MO-Color+"), @"error: invalid value 'MO-Color+' for '--perturbations <LIST>': unknown perturbation ``; `hypogeum tasks --matrix` lists all names");
        insta::assert_snapshot!(wrong("--policy idle --perturbations MO-Color+None"), @"error: invalid value 'MO-Color+None' for '--perturbations <LIST>': None cannot be combined with other perturbations");
        insta::assert_snapshot!(wrong("--policy idle --perturbations All+MO-Color"), @"error: invalid value 'All+MO-Color' for '--perturbations <LIST>': All cannot be combined with other perturbations");
        insta::assert_snapshot!(wrong("--policy idle --perturbations Language-None+Language-Random"), @"error: invalid value 'Language-None+Language-Random' for '--perturbations <LIST>': Language-None and Language-Random cannot be combined: an episode has a single instruction");
        insta::assert_snapshot!(wrong("--policy idle --tasks OpenDrawer --perturbations Camera-Pose+MO-Size"), @"perturbation MO-Size does not apply to OpenDrawer: the task has no manipulation object; omit one of them, or use --perturbations all for those that apply");
        insta::assert_snapshot!(wrong("--policy idle --strength 1.5"), @"error: invalid value '1.5' for '--strength <X>': strength is 1.5, expected a number from 0.001 to 1 (the benchmark's strength)");
        insta::assert_snapshot!(wrong("--policy idle --strength 0"), @"error: invalid value '0' for '--strength <X>': strength is 0, expected a number from 0.001 to 1 (the benchmark's strength)");
        insta::assert_snapshot!(wrong("--policy idel"), @"error: invalid value 'idel' for '--policy <NAME=SPEC>': unknown policy `idel`; did you mean idle?");
        insta::assert_snapshot!(wrong("--policy a=act"), @"error: invalid value 'a=act' for '--policy <NAME=SPEC>': policy `act` needs PATH after a colon: act:PATH");
        insta::assert_snapshot!(wrong("--policy a/b=idle"), @"error: invalid value 'a/b=idle' for '--policy <NAME=SPEC>': policy name `a/b` is invalid, expected 1 to 64 letters, digits, `.`, `_` or `-`");
        insta::assert_snapshot!(wrong("--policy idle --policy idle=random"), @"two policies are named `idle`: give each its own name, --policy NAME=SPEC");
        insta::assert_snapshot!(wrong("--policy idle --mode chunks"), @r#"
    error: invalid value 'chunks' for '--mode <MODE>'
      [possible values: chunk, ensemble]
    "#);
        insta::assert_snapshot!(wrong("--policy idle --renderer gpi"), @r#"
    error: invalid value 'gpi' for '--renderer <RENDERER>'
      [possible values: auto, cpu, gpu, software]
    "#);
        insta::assert_snapshot!(wrong("--policy idle --control-mode pd_joint"), @r#"
    error: invalid value 'pd_joint' for '--control-mode <CONTROL_MODE>'
      [possible values: pd_ee_delta_pose, pd_joint_pos, pd_ee_pose]
    "#);
        insta::assert_snapshot!(wrong("--policy idle --envs 0"), @"error: invalid value '0' for '--envs <N>': expected auto or a number from 1 to 8192");
        insta::assert_snapshot!(wrong("--policy idle --execute 128"), @"error: invalid value '128' for '--execute <M>': 128 is not in 1..=127");
        insta::assert_snapshot!(wrong("--policy idle --mode ensemble --latency 80"), @"--latency is 80 ms, but ensemble mode averages predictions for the present step: use --mode chunk");
        insta::assert_snapshot!(wrong("--policy idle --control-mode pd_ee_pose --latency 80"), @"--latency is 80 ms, but pd_ee_pose has no action that holds the start pose: use another --control-mode");
        insta::assert_snapshot!(wrong("--policy idle --until-decided idle"), @"--until-decided needs two policies of the run, separated by a comma; found `idle`");
        insta::assert_snapshot!(wrong("--policy idle --policy random --until-decided idle,act"), @"--until-decided needs two policies of the run, separated by a comma; found `idle,act`");
        insta::assert_snapshot!(wrong("--policy idle --alpha 0.6"), @"error: invalid value '0.6' for '--alpha <P>': expected a number between 0 and 0.5, for example 0.05");
        insta::assert_snapshot!(wrong("--policy idle --mode ensemble --execute 30"), @"--execute is 30, but ensemble mode queries at every step: omit --execute or use --mode chunk");
    }
}
