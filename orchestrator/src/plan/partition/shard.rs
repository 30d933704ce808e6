//! The name of a shard: its index and the number of shards, typed or from the environment of an engine.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

/// Largest number of shards of a sweep.
pub(crate) const MAX_SHARDS: u32 = 10_000;

/// A part of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct SweepShard {
    /// Its index, from 0.
    pub(crate) index: u32,
    /// Number of shards of the sweep.
    pub(crate) count: u32,
}

/// A shard as a user names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ShardRequest {
    /// `I/N`.
    Given(SweepShard),
    /// `auto` or `auto/N`: the index, and without N the number as well, are the engine's.
    Engine(Option<u32>),
}

/// Reasons why a name means no shard.
#[derive(Debug, Error, PartialEq, Eq)]
pub(crate) enum ShardError {
    #[error("expected I/N, for example 0/16, or auto or auto/N in a task of an array")]
    Form,
    #[error("there are {count} shards, numbered from 0 to {}; found {index}", count - 1)]
    Index { index: u64, count: u32 },
    #[error("the number of shards is {found}, expected 1 to {MAX_SHARDS}")]
    Count { found: u64 },
    #[error(
        "--shard auto found none of {}: start it as a task of an array, or name the shard as I/N",
        engine_names()
    )]
    NoEngine,
    #[error("--shard auto: {variable} is `{found}`, expected a whole number")]
    NoNumber { variable: &'static str, found: String },
    #[error("--shard auto: {index} says which shard this is, but {unknown}; use --shard auto/N")]
    NoCount { index: &'static str, unknown: String },
}

/// The variables by which an engine tells a task of an array which one it is.
struct Engine {
    index: &'static str,
    /// First index of an array whose first one the environment does not tell.
    base: u64,
    /// Variables of the first and last index and of the step between two.
    range: [Option<&'static str>; 3],
    /// Variable of the number of tasks.
    count: Option<&'static str>,
}

/// The engines: Slurm, HyperQueue, Kubernetes, PBS, Torque, Grid Engine and LSF.
const ENGINES: [Engine; 7] = [
    Engine {
        index: "SLURM_ARRAY_TASK_ID",
        base: 0,
        range: [Some("SLURM_ARRAY_TASK_MIN"), Some("SLURM_ARRAY_TASK_MAX"), Some("SLURM_ARRAY_TASK_STEP")],
        count: Some("SLURM_ARRAY_TASK_COUNT"),
    },
    Engine { index: "HQ_TASK_ID", base: 0, range: [None; 3], count: None },
    Engine { index: "JOB_COMPLETION_INDEX", base: 0, range: [None; 3], count: None },
    Engine { index: "PBS_ARRAY_INDEX", base: 0, range: [None; 3], count: None },
    Engine { index: "PBS_ARRAYID", base: 0, range: [None; 3], count: None },
    Engine {
        index: "SGE_TASK_ID",
        base: 1,
        range: [Some("SGE_TASK_FIRST"), Some("SGE_TASK_LAST"), Some("SGE_TASK_STEPSIZE")],
        count: None,
    },
    Engine {
        index: "LSB_JOBINDEX",
        base: 1,
        range: [None, Some("LSB_JOBINDEX_END"), Some("LSB_JOBINDEX_STEP")],
        count: None,
    },
];

/// Reads a variable of the environment.
type Variables<'a> = &'a dyn Fn(&str) -> Option<String>;

impl SweepShard {
    /// Makes the shard with this index.
    ///
    /// # Errors
    /// If there are too many shards, or none with this index.
    pub(crate) fn new(index: u64, count: u64) -> Result<Self, ShardError> {
        let valid = u32::try_from(count).ok().filter(|count| (1..=MAX_SHARDS).contains(count));
        let count = valid.ok_or(ShardError::Count { found: count })?;
        match u32::try_from(index) {
            Ok(index) if index < count => Ok(Self { index, count }),
            _ => Err(ShardError::Index { index, count }),
        }
    }
}

impl fmt::Display for SweepShard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl FromStr for ShardRequest {
    type Err = ShardError;

    fn from_str(typed: &str) -> Result<Self, ShardError> {
        let number = |text: &str| text.parse::<u64>().map_err(|_| ShardError::Form);
        match typed.split_once('/') {
            None if typed == "auto" => Ok(Self::Engine(None)),
            None => Err(ShardError::Form),
            Some(("auto", count)) => Ok(Self::Engine(Some(SweepShard::new(0, number(count)?)?.count))),
            Some((index, count)) => Ok(Self::Given(SweepShard::new(number(index)?, number(count)?)?)),
        }
    }
}

impl ShardRequest {
    /// Returns the shard that is meant. `variable` reads the environment.
    ///
    /// # Errors
    /// If the environment does not say which one it is.
    pub(crate) fn resolve(self, variable: Variables<'_>) -> Result<SweepShard, ShardError> {
        let count = match self {
            Self::Given(shard) => return Ok(shard),
            Self::Engine(count) => count,
        };
        // Outside arrays, Grid Engine says `undefined` and LSF 0.
        let is_task = |engine: &&Engine| {
            variable(engine.index)
                .is_some_and(|text| text != "undefined" && (engine.base, text.as_str()) != (1, "0"))
        };
        let engine = ENGINES.iter().find(is_task).ok_or(ShardError::NoEngine)?;
        let index = number(engine.index, variable)?.unwrap_or(engine.base);
        match count {
            Some(count) => SweepShard::new(index.saturating_sub(engine.base), u64::from(count)),
            None => engine.whole_array(index, variable),
        }
    }
}

impl Engine {
    /// Returns the shard of a task, whose array has one for each shard.
    fn whole_array(&self, index: u64, variable: Variables<'_>) -> Result<SweepShard, ShardError> {
        let read = |name: Option<&'static str>| name.map_or(Ok(None), |name| number(name, variable));
        let unknown = |unknown: String| ShardError::NoCount { index: self.index, unknown };
        let [first, last, step] = self.range;
        let [first, last, step] = [read(first)?, read(last)?, read(step)?];
        let last = last.ok_or_else(|| unknown("not of how many".to_owned()))?;
        let (first, step) = (first.unwrap_or(self.base), step.unwrap_or(1).max(1));
        let count = last.saturating_sub(first) / step + 1;
        // Some tasks of an array that are started again alone have another first index, or holes.
        if first > 1 {
            return Err(unknown(format!("the array begins at {first}")));
        }
        match read(self.count)? {
            Some(found) if found != count => Err(unknown(format!("the array has {found} of {count} tasks"))),
            _ => SweepShard::new(index.saturating_sub(first) / step, count),
        }
    }
}

/// Returns a number of the environment.
fn number(name: &'static str, variable: Variables<'_>) -> Result<Option<u64>, ShardError> {
    let Some(found) = variable(name) else { return Ok(None) };
    let number = found.parse().map_err(|_| ShardError::NoNumber { variable: name, found: found.clone() });
    number.map(Some)
}

fn engine_names() -> String {
    ENGINES.map(|engine| engine.index).join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn auto(typed: &str, variables: &str) -> Result<String, String> {
        let variable = |name: &str| {
            let pairs = variables.split(' ').filter_map(|pair| pair.split_once('='));
            pairs.clone().find(|(key, _)| *key == name).map(|(_, value)| value.to_owned())
        };
        let request = typed.parse::<ShardRequest>().map_err(|error| error.to_string())?;
        request.resolve(&variable).map(|shard| shard.to_string()).map_err(|error| error.to_string())
    }

    #[test]
    fn every_engine_tells_the_shard() {
        let slurm = "SLURM_ARRAY_TASK_ID=5 SLURM_ARRAY_TASK_MIN=1 SLURM_ARRAY_TASK_MAX=7 SLURM_ARRAY_TASK_STEP=2 \
             SLURM_ARRAY_TASK_COUNT=4";
        let sge = "SGE_TASK_ID=2 SGE_TASK_FIRST=1 SGE_TASK_LAST=8 SGE_TASK_STEPSIZE=1";
        let lsf = "LSB_JOBINDEX=3 LSB_JOBINDEX_END=4 LSB_JOBINDEX_STEP=1";
        for (typed, variables, shard) in [
            ("auto", slurm, "2/4"),
            ("auto/9", slurm, "5/9"),
            ("auto", sge, "1/8"),
            ("auto/16", sge, "1/16"),
            ("auto", lsf, "2/4"),
            ("auto/4", "HQ_TASK_ID=3", "3/4"),
            ("auto/4", "JOB_COMPLETION_INDEX=0", "0/4"),
            ("auto/4", "PBS_ARRAY_INDEX=2", "2/4"),
            ("auto/4", "PBS_ARRAYID=2", "2/4"),
            ("auto/4", "SGE_TASK_ID=undefined LSB_JOBINDEX=0 HQ_TASK_ID=1", "1/4"),
            ("3/16", slurm, "3/16"),
        ] {
            assert_eq!(auto(typed, variables), Ok(shard.to_owned()), "{typed} {variables}");
        }
    }

    #[test]
    fn unclear_shards_are_refused_in_one_sentence() {
        let wrong = |typed, variables| auto(typed, variables).unwrap_err();
        insta::assert_snapshot!(wrong("16/16", ""), @"there are 16 shards, numbered from 0 to 15; found 16");
        insta::assert_snapshot!(wrong("0/0", ""), @"the number of shards is 0, expected 1 to 10000");
        insta::assert_snapshot!(wrong("3", ""), @"expected I/N, for example 0/16, or auto or auto/N in a task of an array");
        insta::assert_snapshot!(wrong("auto", ""), @"--shard auto found none of SLURM_ARRAY_TASK_ID, HQ_TASK_ID, JOB_COMPLETION_INDEX, PBS_ARRAY_INDEX, PBS_ARRAYID, SGE_TASK_ID, LSB_JOBINDEX: start it as a task of an array, or name the shard as I/N");
        insta::assert_snapshot!(wrong("auto", "HQ_TASK_ID=x"), @"--shard auto: HQ_TASK_ID is `x`, expected a whole number");
        insta::assert_snapshot!(wrong("auto", "HQ_TASK_ID=1"), @"--shard auto: HQ_TASK_ID says which shard this is, but not of how many; use --shard auto/N");
        insta::assert_snapshot!(wrong("auto/4", "HQ_TASK_ID=4"), @"there are 4 shards, numbered from 0 to 3; found 4");
        let some = "SLURM_ARRAY_TASK_ID=7 SLURM_ARRAY_TASK_MIN=1 SLURM_ARRAY_TASK_MAX=7 SLURM_ARRAY_TASK_STEP=1 \
             SLURM_ARRAY_TASK_COUNT=2";
        insta::assert_snapshot!(wrong("auto", some), @"--shard auto: SLURM_ARRAY_TASK_ID says which shard this is, but the array has 2 of 7 tasks; use --shard auto/N");
        insta::assert_snapshot!(wrong("auto", &some.replace("MIN=1", "MIN=7")), @"--shard auto: SLURM_ARRAY_TASK_ID says which shard this is, but the array begins at 7; use --shard auto/N");
    }
}
