//! Finished points on disk, so that an interrupted measurement resumes.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;
use thiserror::Error;

use crate::study::speed::plan::PlannedPoint;
use crate::study::speed::point::SpeedPoint;

/// Name of the file in the output folder: the settings, then one measurement of a point per line.
const FILE: &str = "points.jsonl";

/// Everything that points of one folder have in common.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SpeedSettings {
    /// Version of this program.
    pub(crate) version: String,
    pub(crate) tasks: Vec<String>,
    /// Seconds of evaluation per point.
    pub(crate) seconds: u32,
    /// Specs and checkpoint hashes of the policies, by name.
    pub(crate) policies: Value,
    /// Options that all points share.
    pub(crate) options: Value,
    /// The machine.
    pub(crate) machine: Value,
}

/// The measurements that are finished, one per point and round.
#[derive(Debug)]
pub(crate) struct PointStore {
    file: File,
    pub(crate) measured: Vec<SpeedPoint>,
}

/// Errors that can occur while opening a folder of points.
#[derive(Debug, Error)]
pub(crate) enum PointStoreError {
    #[error("failed to access {}", path.display())]
    Access { path: PathBuf, source: io::Error },
    #[error(
        "{}, line {line}: expected {expected}; remove the file or choose another folder with -o",
        path.display()
    )]
    Line { path: PathBuf, line: usize, expected: &'static str, source: serde_json::Error },
    #[error(
        "{} was measured with {name} {found}, expected {expected}; choose another folder with -o",
        path.display()
    )]
    Settings { path: PathBuf, name: String, found: Value, expected: Value },
}

impl PointStore {
    /// Opens a folder, or creates it.
    ///
    /// # Errors
    /// If it cannot be read or written, or holds points of other settings.
    pub(crate) fn open(folder: &Path, settings: &SpeedSettings) -> Result<Self, PointStoreError> {
        let path = folder.join(FILE);
        let access = |source| PointStoreError::Access { path: path.clone(), source };
        std::fs::create_dir_all(folder).map_err(access)?;
        let mut file = OpenOptions::new().create(true).read(true).append(true).open(&path).map_err(access)?;
        let lines: Vec<String> = BufReader::new(&file).lines().collect::<Result<_, _>>().map_err(access)?;
        if lines.is_empty() {
            append(&mut file, settings).map_err(access)?;
        }
        let line_error = |line, expected| {
            let path = path.clone();
            move |source| PointStoreError::Line { path, line, expected, source }
        };
        let mut measured = Vec::new();
        for (idx, line) in lines.iter().enumerate() {
            if idx == 0 {
                let found = serde_json::from_str(line).map_err(line_error(1, "settings as JSON"))?;
                check(&found, settings, &path)?;
            } else {
                match serde_json::from_str(line).map_err(line_error(idx + 1, "a point as JSON")) {
                    Ok(point) => measured.push(point),
                    // The last line is incomplete if the program was killed while it wrote.
                    Err(_) if idx + 1 == lines.len() => truncate_last(&file, &lines).map_err(access)?,
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(Self { file, measured })
    }

    /// Stores the measurement of a point.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn add(&mut self, point: SpeedPoint) -> io::Result<()> {
        append(&mut self.file, &point)?;
        self.measured.push(point);
        Ok(())
    }

    /// Returns how often a point was measured.
    pub(crate) fn n_rounds(&self, point: &PlannedPoint) -> usize {
        self.measured.iter().filter(|one| (&one.series, one.envs) == (&point.series, point.envs)).count()
    }

    /// Returns the median measurement of every point, series by series and with ascending envs.
    pub(crate) fn points(&self) -> Vec<SpeedPoint> {
        let mut all: Vec<_> = self.measured.iter().collect();
        let position = |point: &SpeedPoint| self.measured.iter().position(|one| one.series == point.series);
        all.sort_by(|a, b| {
            let places = (position(a), a.envs).cmp(&(position(b), b.envs));
            places.then(a.env_steps_per_s.total_cmp(&b.env_steps_per_s))
        });
        let rounds = all.chunk_by(|a, b| (&a.series, a.envs) == (&b.series, b.envs));
        let median = |rounds: &[&SpeedPoint]| SpeedPoint {
            rounds_env_steps_per_s: rounds.iter().map(|round| round.env_steps_per_s).collect(),
            ..rounds[rounds.len() / 2].clone()
        };
        rounds.map(median).collect()
    }
}

fn append(file: &mut File, value: &impl Serialize) -> io::Result<()> {
    let line = serde_json::to_string(value)?;
    writeln!(file, "{line}")
}

/// Cuts the file after its last but one line.
fn truncate_last(file: &File, lines: &[String]) -> io::Result<()> {
    let kept = &lines[..lines.len() - 1];
    file.set_len(kept.iter().map(|line| line.len() as u64 + 1).sum())
}

fn check(found: &SpeedSettings, expected: &SpeedSettings, path: &Path) -> Result<(), PointStoreError> {
    let (found, expected) = (serde_json::json!(found), serde_json::json!(expected));
    let Value::Object(expected) = expected else { unreachable!("settings are an object") };
    for (name, expected) in expected {
        if found[&name] != expected {
            let found = found[&name].clone();
            return Err(PointStoreError::Settings { path: path.into(), name, found, expected });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use run_config::{Amount, QueryMode};
    use serde_json::json;
    use sim::serve::protocol::Counters;

    use super::*;
    use crate::fleet::Totals;
    use crate::study::speed::point::Series;

    fn settings(seconds: u32) -> SpeedSettings {
        SpeedSettings {
            version: "1".to_owned(),
            tasks: vec!["RaiseCube".to_owned()],
            seconds,
            policies: json!({}),
            options: json!({}),
            machine: json!({}),
        }
    }

    fn point(envs: Amount, env_steps: u64) -> SpeedPoint {
        let mut totals = Totals::new(0, None);
        totals.on_sim_counters(Counters { env_steps, wall_s: 1.0, physics_s: 1.0, ..Counters::default() });
        let series = Series { policy: "idle".to_owned(), mode: QueryMode::Chunk };
        let cores = crate::study::machine::Cores { count: 2, n_threads: 2, peak_gflop: None };
        SpeedPoint::new(series, envs, &totals, Duration::from_secs(2), cores, 0).unwrap()
    }

    #[test]
    fn only_torn_lines_are_lost() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = PointStore::open(folder.path(), &settings(10)).unwrap();
        let [one, two] = [1, 2].map(|envs| point(Amount::Fixed(envs), 10));
        store.add(one.clone()).unwrap();
        store.file.write_all(b"{\"policy\": \"id").unwrap();
        let mut store = PointStore::open(folder.path(), &settings(10)).unwrap();
        assert_eq!(store.measured, std::slice::from_ref(&one));
        store.add(two.clone()).unwrap();
        let store = PointStore::open(folder.path(), &settings(10)).unwrap();
        assert_eq!(store.measured, [one, two]);
    }

    #[test]
    fn median_round_stands_for_a_point() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = PointStore::open(folder.path(), &settings(10)).unwrap();
        for (envs, env_steps) in
            [(Amount::Auto, 7), (Amount::Fixed(8), 5), (Amount::Fixed(8), 2), (Amount::Fixed(8), 3)]
        {
            store.add(point(envs, env_steps)).unwrap();
        }
        let points = store.points();
        let rates = |point: &SpeedPoint| (point.envs, point.env_steps, point.rounds_env_steps_per_s.clone());
        let expected = [(Amount::Fixed(8), 3, vec![2.0, 3.0, 5.0]), (Amount::Auto, 7, vec![7.0])];
        assert_eq!(points.iter().map(rates).collect::<Vec<_>>(), expected);
    }

    #[test]
    fn other_settings_and_damaged_lines_are_named() {
        let folder = tempfile::tempdir().unwrap();
        PointStore::open(folder.path(), &settings(10)).unwrap();
        let message = |settings| {
            let error = PointStore::open(folder.path(), &settings).unwrap_err();
            error.to_string().replace(&folder.path().display().to_string(), "fps")
        };
        insta::assert_snapshot!(message(settings(5)), @"fps/points.jsonl was measured with seconds 10, expected 5; choose another folder with -o");
        let path = folder.path().join(FILE);
        std::fs::write(&path, "[]\n").unwrap();
        insta::assert_snapshot!(message(settings(10)), @"fps/points.jsonl, line 1: expected settings as JSON; remove the file or choose another folder with -o");
    }
}
