//! The shards of a sweep as their states in its folder show them.

use std::fmt::Write;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde_json::{Value, json};
use thiserror::Error;

use crate::commands::distribution::status::shard_status::{ShardHealth, ShardStatus, StateError};
use crate::commands::distribution::status::totals::SweepTotals;
use crate::console::exit::ExitStatus;
use crate::console::progress::format_seconds;
use crate::console::table::{Align, TextTable};
use crate::plan::partition::SweepShard;
use crate::store::shards::{ShardState, ShardsFolder};

/// Age from which the state of a running shard shows that its task is gone. Tasks write it every ten seconds.
pub(crate) const MAX_AGE: Duration = Duration::from_secs(40);
/// Largest number of shards that the table shows although nothing is wrong with them.
const MAX_ROWS: usize = 32;
/// All shards of a sweep, in their order; none if no task has begun.
#[derive(Clone, Debug)]
pub(crate) struct Overview {
    pub(crate) shards: Vec<ShardStatus>,
    /// `true` if the ages of states follow from this machine's clock, which may differ from the folder's.
    own_clock: bool,
}

/// Errors that can occur while reading the states of a sweep.
#[derive(Debug, Error)]
pub(crate) enum OverviewError {
    #[error("failed to read the folder {}", path.display())]
    Folder { path: PathBuf, source: io::Error },
    #[error(
        "{} has no shards of a sweep: name the folder beside its results file, results.shards for results.db",
        path.display()
    )]
    NoSweep { path: PathBuf },
    #[error(
        "{} has states of {} and of {} shards: remove those that do not belong to the sweep",
        path.display(), counts[0], counts[1]
    )]
    Counts { path: PathBuf, counts: [u32; 2] },
    #[error(transparent)]
    State(#[from] StateError),
}

impl Overview {
    /// Reads the states in `folder`. Running shards whose states are older than `max_age` are silent.
    ///
    /// # Errors
    /// If the folder or a state cannot be read, or states belong to different sweeps.
    pub(crate) fn read(folder: &ShardsFolder, max_age: Option<Duration>) -> Result<Self, OverviewError> {
        let path = folder.path();
        let found = states(folder).map_err(|source| OverviewError::Folder { path: path.into(), source })?;
        let Some(&first) = found.first() else {
            return match folder.sweep().try_exists() {
                Ok(true) => Ok(Self { shards: Vec::new(), own_clock: false }),
                _ => Err(OverviewError::NoSweep { path: path.into() }),
            };
        };
        if let Some(other) = found.iter().find(|shard| shard.count != first.count) {
            return Err(OverviewError::Counts { path: path.into(), counts: [first.count, other.count] });
        }
        let clock = folder_time(path);
        let now = *clock.as_ref().unwrap_or_else(|own| own);
        let all = (0..first.count).map(|index| SweepShard { index, count: first.count });
        let mut shards: Vec<_> =
            all.map(|shard| ShardStatus { shard, health: ShardHealth::Waiting, state: None }).collect();
        for shard in found {
            let oldest = max_age.and_then(|age| now.checked_sub(age));
            shards[shard.index as usize] = ShardStatus::read(folder, shard, oldest)?;
        }
        Ok(Self { shards, own_clock: clock.is_err() })
    }

    /// Returns the number of shards in this condition.
    pub(crate) fn count(&self, health: ShardHealth) -> usize {
        self.shards.iter().filter(|shard| shard.health == health).count()
    }

    /// Returns the exit code of commands that show this.
    pub(crate) fn exit_status(&self) -> ExitStatus {
        if self.count(ShardHealth::Failed) > 0 { ExitStatus::EpisodeErrors } else { ExitStatus::Success }
    }

    /// Returns `true` if no task will change anything any more: all shards have finished, or some have failed
    /// and none is running or waiting.
    pub(crate) fn is_final(&self) -> bool {
        let (finished, failed) = (self.count(ShardHealth::Finished), self.count(ShardHealth::Failed));
        let pending = self.count(ShardHealth::Running) + self.count(ShardHealth::Waiting);
        !self.shards.is_empty() && (finished == self.shards.len() || (failed > 0 && pending == 0))
    }

    /// Returns the totals in one line.
    pub(crate) fn line(&self) -> String {
        if self.shards.is_empty() {
            return "no shard has begun".to_owned();
        }
        let counts = ShardHealth::ALL.map(|health| (self.count(health), health.name()));
        let counts: Vec<_> =
            counts.iter().filter(|(n, _)| *n > 0).map(|(n, name)| format!("{n} {name}")).collect();
        format!("{} shards: {}; {}", self.shards.len(), counts.join(", "), SweepTotals::of(&self.shards))
    }

    /// Returns the totals, and a table of the shards: all of them, or if there are many those that want
    /// attention.
    pub(crate) fn text(&self) -> String {
        let mut text = self.line() + "\n";
        if self.own_clock && self.count(ShardHealth::Running) + self.count(ShardHealth::Silent) > 0 {
            text += "the folder is not writable: silent shards are told by this machine's clock\n";
        }
        let is_shown = |shard: &&ShardStatus| {
            self.shards.len() <= MAX_ROWS
                || matches!(
                    shard.health,
                    ShardHealth::Interrupted | ShardHealth::Failed | ShardHealth::Silent
                )
        };
        let shown: Vec<_> = self.shards.iter().filter(is_shown).collect();
        if !shown.is_empty() {
            let _ = write!(text, "\n{}", table(&shown[..shown.len().min(MAX_ROWS)]));
        }
        if shown.len() > MAX_ROWS {
            let _ = writeln!(text, "and {} more", shown.len() - MAX_ROWS);
        }
        text
    }

    /// Returns the totals and all shards as data.
    pub(crate) fn json(&self) -> Value {
        let counts = ShardHealth::ALL.map(|health| (health.name().to_owned(), json!(self.count(health))));
        let shard = |status: &ShardStatus| {
            let mut entry = json!(status.state);
            if status.state.is_none() {
                entry = json!({ "shard": status.shard.index, "shards": status.shard.count });
            }
            entry["phase"] = json!(status.health);
            entry
        };
        json!({
            "shards": self.shards.len(),
            "phases": counts.into_iter().collect::<serde_json::Map<_, _>>(),
            "totals": SweepTotals::of(&self.shards),
            "states": self.shards.iter().map(shard).collect::<Vec<_>>(),
        })
    }
}

/// Returns the shards that have a state, in their order.
fn states(folder: &ShardsFolder) -> io::Result<Vec<SweepShard>> {
    let mut shards = Vec::new();
    for entry in std::fs::read_dir(folder.path())? {
        let name = entry?.file_name();
        let numbers = name.to_str().and_then(|name| name.strip_prefix("shard-")?.strip_suffix(".json"));
        let Some((index, count)) = numbers.and_then(|numbers| numbers.split_once("-of-")) else { continue };
        let (Ok(index), Ok(count)) = (index.parse(), count.parse()) else { continue };
        // A file of another name is no state.
        shards.extend(
            SweepShard::new(index, count)
                .ok()
                .filter(|shard| folder.state(*shard).file_name() == Some(&name)),
        );
    }
    shards.sort_by_key(|shard| (shard.count, shard.index));
    Ok(shards)
}

/// Returns the time by the clock of the folder, which gives the files in it their times, or by this machine's
/// clock if nothing can be written to it.
fn folder_time(folder: &Path) -> Result<SystemTime, SystemTime> {
    let file = tempfile::Builder::new().prefix(".status-").tempfile_in(folder);
    let time = file.and_then(|file| file.as_file().metadata()?.modified());
    time.map_err(|_| SystemTime::now())
}

fn table(shards: &[&ShardStatus]) -> TextTable {
    let columns = [
        ("shard", Align::Right),
        ("phase", Align::Left),
        ("host", Align::Left),
        ("episodes", Align::Right),
        ("episodes/s", Align::Right),
        ("time left", Align::Right),
        ("", Align::Left),
    ];
    let mut table = TextTable::new(&columns);
    for status in shards {
        let ShardStatus { shard, health, state } = status;
        let of_state = |text: &dyn Fn(&ShardState) -> String| state.as_ref().map_or_else(String::new, text);
        table.row(vec![
            shard.index.to_string(),
            health.name().to_owned(),
            of_state(&|state| state.host.clone()),
            of_state(&|state| format!("{}/{}", state.done, state.planned)),
            status.episodes_per_s().map_or_else(String::new, |rate| format!("{rate:.2}")),
            status.left_s().map_or_else(String::new, format_seconds),
            of_state(&|state| state.message.clone().unwrap_or_default()),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use super::*;
    use crate::store::shards::ShardPhase;

    fn state(index: u32, phase: ShardPhase, done: u64) -> ShardState {
        ShardState {
            shard: index,
            shards: 6,
            phase,
            host: format!("n{index}"),
            pid: 1,
            token: "0".to_owned(),
            beat: 1,
            planned: 100,
            done,
            done_before: 0,
            errors: u64::from(phase == ShardPhase::Finished),
            wall_s: 20.0,
            message: (phase == ShardPhase::Failed).then(|| "the disk is full".to_owned()),
        }
    }

    /// Writes states of these phases with the numbers of finished episodes.
    fn write(folder: &ShardsFolder, states: &[(ShardPhase, u64)]) {
        for (index, (phase, done)) in (0..).zip(states) {
            let shard = SweepShard { index, count: 6 };
            state(index, *phase, *done).write(&folder.state(shard)).unwrap();
        }
    }

    #[test]
    fn overview_shows_every_kind_of_shard() {
        use ShardPhase::{Failed, Finished, Interrupted, Running};
        let temporary = tempfile::tempdir().unwrap();
        let folder = ShardsFolder::at(temporary.path());
        write(&folder, &[(Finished, 100), (Running, 40), (Interrupted, 10), (Failed, 0), (Running, 50)]);
        let silent =
            File::options().append(true).open(folder.state(SweepShard { index: 4, count: 6 })).unwrap();
        silent.set_modified(SystemTime::now() - 2 * MAX_AGE).unwrap();
        let overview = Overview::read(&folder, Some(MAX_AGE)).unwrap();
        insta::assert_snapshot!(overview.text(), @r#"
    6 shards: 1 finished, 1 running, 1 interrupted, 1 failed, 1 silent, 1 waiting; 200 of about 600 episodes, 1 not run, 2.00 episodes/s, at least 30 s left

    shard  phase        host  episodes  episodes/s  time left
        0  finished     n0     100/100
        1  running      n1      40/100        2.00       30 s
        2  interrupted  n2      10/100
        3  failed       n3       0/100                         the disk is full
        4  silent       n4      50/100
        5  waiting
    "#);
        insta::assert_snapshot!(overview.json()["totals"], @r#"{"done":200,"episodes_per_s":2.0,"errors":1,"left_is_bound":true,"left_s":30.0,"planned":600,"planned_is_estimated":true}"#);
        assert_eq!(overview.json()["states"][4]["phase"], "silent");
        assert_eq!(overview.json()["states"][5], json!({ "shard": 5, "shards": 6, "phase": "waiting" }));
        assert_eq!((overview.exit_status(), overview.is_final()), (ExitStatus::EpisodeErrors, false));
    }

    #[test]
    fn sweep_is_final_when_nothing_runs() {
        use ShardPhase::{Failed, Finished, Interrupted};
        let temporary = tempfile::tempdir().unwrap();
        let folder = ShardsFolder::at(temporary.path());
        let end = |states: &[(ShardPhase, u64)]| {
            write(&folder, states);
            let overview = Overview::read(&folder, Some(MAX_AGE)).unwrap();
            (overview.is_final(), overview.exit_status())
        };
        assert_eq!(end(&[(Finished, 100); 5]), (false, ExitStatus::Success));
        assert_eq!(end(&[(Finished, 100); 6]), (true, ExitStatus::Success));
        assert_eq!(end(&[(Interrupted, 10); 2]), (false, ExitStatus::Success));
        assert_eq!(end(&[(Interrupted, 10), (Failed, 0)]), (true, ExitStatus::EpisodeErrors));
    }

    #[test]
    fn unusable_folders_are_named_in_one_sentence() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = ShardsFolder::at(temporary.path());
        let wrong = |folder: &ShardsFolder| {
            let error = anyhow::Error::from(Overview::read(folder, Some(MAX_AGE)).unwrap_err());
            format!("{error:#}").replace(&temporary.path().display().to_string(), "out.shards")
        };
        insta::assert_snapshot!(wrong(&ShardsFolder::at(&temporary.path().join("absent"))), @"failed to read the folder out.shards/absent: No such file or directory (os error 2)");
        insta::assert_snapshot!(wrong(&folder), @"out.shards has no shards of a sweep: name the folder beside its results file, results.shards for results.db");
        std::fs::write(folder.sweep(), "{}").unwrap();
        assert_eq!(Overview::read(&folder, Some(MAX_AGE)).unwrap().text(), "no shard has begun\n");
        let shard = SweepShard { index: 1, count: 6 };
        std::fs::write(folder.state(shard), "{").unwrap();
        insta::assert_snapshot!(wrong(&folder), @"failed to read the state out.shards/shard-1-of-6.json: EOF while parsing an object at line 1 column 1");
        state(2, ShardPhase::Running, 1).write(&folder.state(shard)).unwrap();
        insta::assert_snapshot!(wrong(&folder), @"the state out.shards/shard-1-of-6.json belongs to shard 2/6");
        state(1, ShardPhase::Running, 1).write(&folder.state(SweepShard { index: 1, count: 7 })).unwrap();
        insta::assert_snapshot!(wrong(&folder), @"out.shards has states of 6 and of 7 shards: remove those that do not belong to the sweep");
    }
}
