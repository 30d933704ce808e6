//! The options of a run. Each is declared exactly once, here.
//!
//! A field of this module is at the same time a command-line flag, a key of the sweep file, part of the
//! configuration that `hypogeum sim` and `hypogeum policy-host` receive, and (in [`ResultOptions`]) part of
//! the manifest of a results file. To add an option, add a field, and read it where it takes effect. The doc
//! comment of the field is its help text.

mod choices;
mod protocol;
mod query;
mod strength;

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Command, FromArgMatches, value_parser};
use serde::{Deserialize, Serialize};

use ipc_types::ControlMode;

pub use self::choices::{DeviceChoice, Profile, QueryMode, RendererChoice, Samples};
pub use self::protocol::{EpisodeEnd, Instructions, Protocol, ProtocolName, ProtocolOptions};
pub use self::query::{Execution, QueryOptions};
pub use self::strength::{Strength, StrengthError};
use crate::allotment::n_cores;
use crate::amount::Amount;
use crate::language_file::LanguageFile;

/// Largest number of episodes in progress at a time.
pub const MAX_ENVS: u32 = 8192;
/// Largest number of worker threads of a process.
pub const MAX_THREADS: u32 = 1024;

/// All options of a run that reach its processes, grouped by what they may influence.
#[derive(Args, Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunConfig {
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would show it as help text")]
    pub results: ResultOptions,
    #[command(flatten)]
    #[serde(default)]
    #[expect(missing_docs, reason = "clap would show it as help text")]
    pub query: QueryOptions,
    #[command(flatten)]
    #[serde(default)]
    #[expect(missing_docs, reason = "clap would show it as help text")]
    pub protocol: ProtocolOptions,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would show it as help text")]
    pub rendering: ImageOptions,
    #[command(flatten)]
    #[serde(default)]
    #[expect(missing_docs, reason = "clap would show it as help text")]
    pub inference: InferenceOptions,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would show it as help text")]
    pub resources: ResourceOptions,
}

/// Options that change the outcome of an episode. The manifest of a results file stores them, and a run that
/// continues the file must have the same.
#[derive(Args, Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResultOptions {
    /// Suite seed, from which the seeds of all episodes are derived
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub seed: u64,
    /// Reading of the benchmark where its paper and its released code disagree
    #[arg(long, value_enum, ignore_case = true, default_value_t = Profile::Strict)]
    pub profile: Profile,
    /// Strength of the perturbations, from 0.001 to 1, which is the benchmark's
    #[arg(long, value_name = "X", default_value_t = Strength::FULL)]
    pub strength: Strength,
    /// Milliseconds of simulated time between a query and the effect of its answer. Meanwhile the
    /// previous chunk goes on, or the arms hold their last target
    #[arg(long, value_name = "MS", value_parser = value_parser!(u32).range(..=10_000), default_value_t = 0)]
    #[serde(default)]
    pub latency: u32,
    /// Control mode of single-arm policies; bimanual policies always use pd_joint_pos
    #[arg(long, ignore_case = true, value_parser = control_modes(), default_value = ControlMode::EeDeltaPose.name())]
    pub control_mode: ControlMode,
    /// Paraphrases for Language-Paraphrase: a YAML mapping from env ids to lists of sentences, like the
    /// benchmark's own. By default, sentences of ours
    #[arg(long, value_name = "FILE")]
    pub language: Option<LanguageFile>,
    /// Protocol that results from [`RunConfig::protocol`] and the policies
    #[arg(skip)]
    #[serde(flatten)]
    pub protocol: Protocol,
}

/// Options that change the images of an episode. A results file stores the identity of the renderer that
/// results from them instead of the options themselves, and only if a policy of the run reads images.
#[derive(Args, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageOptions {
    /// Renderer of the images
    #[arg(long, value_enum, ignore_case = true, default_value_t = RendererChoice::Auto)]
    pub renderer: RendererChoice,
    /// Samples per pixel
    #[arg(long, value_enum, default_value_t = Samples::One)]
    pub samples: Samples,
}

/// Options that change single bits of actions. A results file stores the device that results from them, as a
/// part of the identity of each policy that uses it.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InferenceOptions {
    /// Device on which policies compute
    #[arg(long, value_enum, ignore_case = true, default_value_t = DeviceChoice::Auto)]
    pub policy_device: DeviceChoice,
}

/// Options that never change a result, only the resources a run needs and the detail it records.
#[derive(Args, Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResourceOptions {
    /// Episodes in progress at a time: a number, or auto to choose it from costs measured during the run
    #[arg(long, value_name = "N", value_parser = Amount::parser(MAX_ENVS), default_value = "auto")]
    pub envs: Amount,
    /// Worker threads of the sim and of each policy host: a number, or auto for one per core
    #[arg(long, value_name = "T", value_parser = Amount::parser(MAX_THREADS), default_value = "auto")]
    pub threads: Amount,
    /// GPU to use for rendering and for policies: its number, as `hypogeum doctor` lists them [default: 0]
    #[arg(long, value_name = "N")]
    #[serde(default)]
    pub gpu: Option<u32>,
    /// Record every executed action in the results file, for `replay` and movies: 28 bytes per control step
    /// of one arm, 64 of two
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_value_t = true,
        default_missing_value = "true", action = clap::ArgAction::Set)]
    pub keep_actions: bool,
    /// Verify a checksum of every message in shared memory, and repeat the episodes of a damaged one
    #[arg(long)]
    #[serde(default)]
    pub check_frames: bool,
    /// Python interpreter that asks the servers of policies (openpi:URL, vla-eval:URL, lerobot-async:URL)
    #[arg(long, value_name = "PYTHON", default_value = "python3")]
    #[serde(default = "default_python")]
    pub python: PathBuf,
    /// Record what all threads do and when, in a file that ui.perfetto.dev opens
    #[arg(long, value_name = "FILE.json")]
    #[serde(default)]
    pub trace: Option<PathBuf>,
}

fn default_python() -> PathBuf {
    "python3".into()
}

impl ResultOptions {
    /// Returns the latency in control steps of 50 ms, rounded up.
    #[must_use]
    pub const fn latency_steps(&self) -> u32 {
        self.latency.div_ceil(CONTROL_STEP_MS)
    }
}

impl ResourceOptions {
    /// Returns the number of worker threads of a process. Asking the system takes tens of microseconds.
    #[must_use]
    pub fn n_threads(&self) -> u32 {
        self.threads.unwrap_or_else(n_cores)
    }
}

/// Duration of a control step (20 Hz), in ms.
const CONTROL_STEP_MS: u32 = 50;

impl Default for RunConfig {
    /// Returns the configuration of a command line without options.
    fn default() -> Self {
        let command = Self::augment_args(Command::new("defaults").no_binary_name(true));
        let matches = command.try_get_matches_from([""; 0]).expect("every run option has a default");
        Self::from_arg_matches(&matches).expect("every run option has a default")
    }
}

/// Returns the parser of control modes, which lists them in the help text.
fn control_modes() -> impl TypedValueParser<Value = ControlMode> {
    let describe = |mode| match mode {
        ControlMode::EeDeltaPose => "Relative poses of the TCP",
        ControlMode::JointPos => "Absolute joint positions",
        ControlMode::EePose => "Absolute poses of the TCP",
    };
    let names = ControlMode::ALL.map(|mode| PossibleValue::new(mode.name()).help(describe(mode)));
    let of_name =
        |name: String| ControlMode::ALL.into_iter().find(|mode| mode.name().eq_ignore_ascii_case(&name));
    PossibleValuesParser::new(names).map(move |name| of_name(name).expect("the parser knows all names"))
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;

    use super::*;

    #[test]
    fn defaults_survive_json() {
        let config = RunConfig::default();
        let text = serde_json::to_string(&config).unwrap();
        assert_eq!(serde_json::from_str::<RunConfig>(&text).unwrap(), config);
    }

    #[test]
    fn ensemble_mode_defaults_to_one_row() {
        let execution = |words: &[&str]| {
            let command = RunConfig::augment_args(Command::new("run").no_binary_name(true));
            let matches = command.try_get_matches_from(words).unwrap();
            RunConfig::from_arg_matches(&matches).unwrap().query.without_checkpoint()
        };
        assert_eq!(execution(&[]), Execution::chunk(30));
        assert_eq!(execution(&["--mode", "ensemble"]), Execution::ENSEMBLE);
        assert_eq!(execution(&["--execute", "7"]), Execution::chunk(7));
    }

    #[test]
    fn json_and_command_line_names_agree() {
        fn check<T: ValueEnum + Serialize>() {
            for value in T::value_variants() {
                let name = value.to_possible_value().unwrap().get_name().to_owned();
                assert_eq!(serde_json::to_value(value).unwrap(), name);
            }
        }
        check::<Profile>();
        check::<QueryMode>();
        check::<RendererChoice>();
        check::<DeviceChoice>();
        check::<Samples>();
    }
}
