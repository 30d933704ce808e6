//! What a run may be told, as typed: by flags, by a TOML file, or by both. One struct states the names for both.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::{Deserialize, Deserializer};
use thiserror::Error;

/// Wishes for a run; what is absent is defaulted by [`crate::plan`]. Paths are relative to the current folder.
#[derive(Clone, Debug, Default, PartialEq, Args, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Sweep {
    /// A policy and the name it has in the results; SPEC is idle, random, expert, act:PATH or attach:NAME
    #[arg(long = "policy", value_name = "NAME=SPEC")]
    pub(crate) policies: Vec<String>,
    /// Tasks, comma-separated: names, all, single or bimanual [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    #[serde(deserialize_with = "one_or_many")]
    pub(crate) tasks: Vec<String>,
    /// Perturbations, comma-separated: names, names joined by + that act together, all (that apply) or none [default: none]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    #[serde(deserialize_with = "one_or_many")]
    pub(crate) perturbations: Vec<String>,
    /// How strong perturbations are, above 0 and up to 1, the benchmark's [default: 1]
    #[arg(long, value_name = "X")]
    pub(crate) strength: Option<f64>,
    /// Episodes per policy, task and perturbation [default: 10]
    #[arg(long, value_name = "N")]
    pub(crate) episodes: Option<u32>,
    /// Seed of the suite, from which every episode's seed follows [default: 0]
    #[arg(long, value_name = "S")]
    pub(crate) seed: Option<u64>,
    /// Episodes in progress at a time [default: 16]
    #[arg(long, value_name = "N")]
    pub(crate) envs: Option<u32>,
    /// Worker threads of the sim and of each policy host [default: one per core]
    #[arg(long, value_name = "T")]
    pub(crate) threads: Option<u32>,
    /// chunk (execute rows open loop) or ensemble (a query every step) [default: chunk]
    #[arg(long)]
    pub(crate) mode: Option<String>,
    /// Rows of a chunk to execute before the next query, 1 to 63 [default: 30; 1 in ensemble mode]
    #[arg(long, value_name = "M")]
    pub(crate) execute: Option<u32>,
    /// Results file [default: hypogeum.db]
    #[arg(long, value_name = "FILE")]
    pub(crate) db: Option<PathBuf>,
    /// Keep every executed action in the results file, for `replay`
    #[arg(long)]
    pub(crate) keep_actions: bool,
    /// auto, cpu, gpu or software (the gpu's on a driver that runs on the CPU: for tests) [default: auto]
    #[arg(long)]
    pub(crate) renderer: Option<String>,
    /// Samples per pixel: 1, as the benchmark has it, or 4 for smooth edges [default: 1]
    #[arg(long)]
    pub(crate) samples: Option<String>,
    /// strict (evident intent) or paper (what the released code does) [default: strict]
    #[arg(long)]
    pub(crate) profile: Option<String>,
    /// How single-arm policies drive: pd_ee_delta_pose, pd_joint_pos or pd_ee_pose [default: pd_ee_delta_pose]
    #[arg(long)]
    pub(crate) control_mode: Option<String>,
}

/// Why a sweep file cannot be used.
#[derive(Debug, Error)]
pub(crate) enum SweepError {
    #[error("failed to read the sweep file {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("the sweep file {} is wrong: {source}", path.display())]
    Parse { path: PathBuf, source: Box<toml::de::Error> },
}

impl Sweep {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, is not TOML, or has a key that is not known or a value of another type; the message shows
    /// the line.
    pub(crate) fn read(path: &Path) -> Result<Self, SweepError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| SweepError::Read { path: path.into(), source })?;
        toml::from_str(&text)
            .map_err(|source| SweepError::Parse { path: path.into(), source: Box::new(source) })
    }

    /// These wishes, and where they say nothing those of `file`.
    pub(crate) fn over(self, file: Self) -> Self {
        let list = |flag: Vec<String>, file| if flag.is_empty() { file } else { flag };
        Self {
            policies: list(self.policies, file.policies),
            tasks: list(self.tasks, file.tasks),
            perturbations: list(self.perturbations, file.perturbations),
            strength: self.strength.or(file.strength),
            episodes: self.episodes.or(file.episodes),
            seed: self.seed.or(file.seed),
            envs: self.envs.or(file.envs),
            threads: self.threads.or(file.threads),
            mode: self.mode.or(file.mode),
            execute: self.execute.or(file.execute),
            db: self.db.or(file.db),
            keep_actions: self.keep_actions || file.keep_actions,
            renderer: self.renderer.or(file.renderer),
            samples: self.samples.or(file.samples),
            profile: self.profile.or(file.profile),
            control_mode: self.control_mode.or(file.control_mode),
        }
    }
}

/// `"all"` or `["RaiseCube", "StackCube"]`.
fn one_or_many<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<String>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged, expecting = "expected a name or a list of names")]
    enum OneOrMany {
        One(String),
        Many(Vec<String>),
    }
    Ok(match OneOrMany::deserialize(deserializer)? {
        OneOrMany::One(name) => name.split(',').map(|part| part.trim().to_owned()).collect(),
        OneOrMany::Many(names) => names,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Sweep, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sweep.toml");
        std::fs::write(&path, text).unwrap();
        let shown = |error: SweepError| error.to_string().replace(&path.display().to_string(), "sweep.toml");
        Sweep::read(&path).map_err(shown)
    }

    #[test]
    fn a_file_says_what_flags_say_and_flags_win() {
        let file = read(
            r#"
            policies = ["idle", "mine=act:weights"]
            tasks = ["RaiseCube", "StackCube"]
            perturbations = "all"
            episodes = 100
            control_mode = "pd_joint_pos"
            "#,
        )
        .unwrap();
        let flags = Sweep { episodes: Some(3), tasks: vec!["single".to_owned()], ..Sweep::default() };
        let both = flags.over(file);
        assert_eq!(both.policies, ["idle", "mine=act:weights"]);
        assert_eq!(both.tasks, ["single"]);
        assert_eq!(both.perturbations, ["all"]);
        assert_eq!((both.episodes, both.seed), (Some(3), None));
        assert_eq!(both.control_mode.as_deref(), Some("pd_joint_pos"));
    }

    #[test]
    fn errors_name_the_file_and_the_key() {
        insta::assert_snapshot!(read("epsiodes = 3\n").unwrap_err(), @r"
        the sweep file sweep.toml is wrong: TOML parse error at line 1, column 1
          |
        1 | epsiodes = 3
          | ^^^^^^^^
        unknown field `epsiodes`, expected one of `policies`, `tasks`, `perturbations`, `strength`, `episodes`, `seed`, `envs`, `threads`, `mode`, `execute`, `db`, `keep_actions`, `renderer`, `samples`, `profile`, `control_mode`
        ");
        insta::assert_snapshot!(read("episodes = \"many\"\n").unwrap_err(), @r#"
        the sweep file sweep.toml is wrong: TOML parse error at line 1, column 12
          |
        1 | episodes = "many"
          |            ^^^^^^
        invalid type: string "many", expected u32
        "#);
        insta::assert_snapshot!(read("tasks = 3\n").unwrap_err(), @r"
        the sweep file sweep.toml is wrong: TOML parse error at line 1, column 9
          |
        1 | tasks = 3
          |         ^
        expected a name or a list of names
        ");
        insta::assert_snapshot!(read("tasks = \n").unwrap_err(), @r"
        the sweep file sweep.toml is wrong: TOML parse error at line 1, column 9
          |
        1 | tasks = 
          |         ^
        string values must be quoted, expected literal string
        ");
        insta::assert_snapshot!(Sweep::read(Path::new("absent.toml")).unwrap_err(), @"failed to read the sweep file absent.toml: No such file or directory (os error 2)");
    }
}
