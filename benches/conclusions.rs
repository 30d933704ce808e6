//! Error rates of the statistics by simulation, and the speed of `compare` and `report` on a million rows.
//!
//! `cargo bench -p benches --bench conclusions [-- --quick]`

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use orchestrator::statistics::{
    BootstrapCell, ConfidenceSequence, Decision, Levels, PairedSequence, Pairs, cluster_bootstrap, holm,
    mcnemar_mid_p, newcombe_interval, quantile, sequential_decision, tango_interval, wilson_interval,
};
use rayon::prelude::*;
use rusqlite::{Connection, params};
use sim::stream::Stream;

const LEVELS: Levels = Levels { alpha: 0.05, margin: 0.05 };
const HYPOGEUM: &str = env!("CARGO_BIN_EXE_hypogeum-under-bench");

/// Probabilities that only A and that only B succeeds, and that both do.
#[derive(Clone, Copy)]
struct Rates {
    only_a: f64,
    only_b: f64,
    both: f64,
}

impl Rates {
    fn difference(self) -> f64 {
        self.only_a - self.only_b
    }

    fn draw(self, random: &mut Stream) -> (bool, bool) {
        let u = random.unit();
        if u < self.only_a {
            (true, false)
        } else if u < self.only_a + self.only_b {
            (false, true)
        } else {
            let both = u < self.only_a + self.only_b + self.both;
            (both, both)
        }
    }
}

fn main() -> anyhow::Result<()> {
    let is_quick = std::env::args().any(|word| word == "--quick");
    let n_streams = if is_quick { 1000 } else { 10_000 };
    false_positives(n_streams);
    family_wise_errors(n_streams / 5);
    coverage(n_streams);
    bootstrap_coverage(if is_quick { 100 } else { 1000 });
    episodes_saved(n_streams / 5);
    million_rows(if is_quick { 100 } else { 1000 })
}

fn streams(n: usize, name: &str) -> impl IndexedParallelIterator<Item = Stream> {
    (0..n).into_par_iter().map(move |idx| Stream::new(idx as u64, name))
}

fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole as f64
}

/// Looks at every stream after every pair, up to 500, under equal rates.
fn false_positives(n: usize) {
    println!(
        "false decisions for A or B under equal rates, looking after every one of 500 pairs, {n} streams"
    );
    for (discordant, both) in [(0.1, 0.4), (0.3, 0.4), (0.5, 0.25), (0.02, 0.9)] {
        let rates = Rates { only_a: discordant / 2.0, only_b: discordant / 2.0, both };
        let is_wrong = |mut random: Stream| {
            let mut sequence = PairedSequence::new(LEVELS.alpha);
            let mut fixed = false;
            for _ in 0..500 {
                let (a, b) = rates.draw(&mut random);
                sequence.push(a, b);
                fixed |= mcnemar_mid_p(sequence.pairs()) <= LEVELS.alpha;
            }
            (sequence.p_value() <= LEVELS.alpha, fixed)
        };
        let found: Vec<(bool, bool)> = streams(n, "null").map(is_wrong).collect();
        let sequential = found.iter().filter(|(wrong, _)| *wrong).count();
        let fixed = found.iter().filter(|(_, wrong)| *wrong).count();
        println!(
            "  discordance {discordant:4}: e-values {:5.2} %; a fixed-sample test looked at as often {:5.2} %",
            percent(sequential, n),
            percent(fixed, n)
        );
    }
}

/// Counts runs with any false decision among 20 cells without a difference and 5 with one.
fn family_wise_errors(n: usize) {
    let null = Rates { only_a: 0.15, only_b: 0.15, both: 0.4 };
    let better = Rates { only_a: 0.35, only_b: 0.05, both: 0.4 };
    let run = |mut random: Stream| {
        let mut cells: Vec<PairedSequence> = (0..25).map(|_| PairedSequence::new(LEVELS.alpha)).collect();
        let mut is_wrong = false;
        for _ in 0..200 {
            for (idx, cell) in cells.iter_mut().enumerate() {
                let (a, b) = if idx < 20 { null } else { better }.draw(&mut random);
                cell.push(a, b);
            }
            let adjusted = holm(&cells.iter().map(PairedSequence::p_value).collect::<Vec<_>>());
            is_wrong |= adjusted[..20].iter().any(|p| *p <= LEVELS.alpha);
        }
        is_wrong
    };
    let wrong = streams(n, "family").filter_map(|random| run(random).then_some(())).count();
    println!(
        "any false decision among 20 equal cells of 25, 200 pairs each, {n} runs: {:.2} %",
        percent(wrong, n)
    );
}

fn coverage(n: usize) {
    let z = quantile(1.0 - LEVELS.alpha / 2.0);
    println!("coverage of 95 % intervals, {n} samples each");
    for (rates, size) in [
        (Rates { only_a: 0.15, only_b: 0.15, both: 0.4 }, 50),
        (Rates { only_a: 0.3, only_b: 0.1, both: 0.3 }, 50),
        (Rates { only_a: 0.15, only_b: 0.05, both: 0.7 }, 200),
        (Rates { only_a: 0.04, only_b: 0.02, both: 0.9 }, 200),
    ] {
        let covered = |mut random: Stream| {
            let mut pairs = Pairs::default();
            let mut sequence = PairedSequence::new(LEVELS.alpha);
            let mut rate = ConfidenceSequence::new(LEVELS.alpha);
            let (difference, success) = (rates.difference(), rates.only_a + rates.both);
            let holds = |interval: [f64; 2], value: f64| interval[0] <= value && value <= interval[1];
            for _ in 0..size {
                let (a, b) = rates.draw(&mut random);
                pairs.add(a, b);
                sequence.push(a, b);
                rate.push(f64::from(u8::from(a)));
            }
            let of =
                |interval: Option<[f64; 2]>, value| interval.is_some_and(|interval| holds(interval, value));
            // Sequences are intersected over time, so the last interval covers only if all did.
            [
                of(wilson_interval(pairs.successes()[0], size, z), success),
                of(tango_interval(&pairs, z), difference),
                of(newcombe_interval(&pairs, z), difference),
                holds(sequence.interval(), difference),
                holds(rate.interval(), success),
            ]
        };
        let found: Vec<[bool; 5]> = streams(n, "coverage").map(covered).collect();
        let share = |idx: usize| percent(found.iter().filter(|covers| covers[idx]).count(), n);
        println!(
            "  n {size:3}, A only {:.2}, B only {:.2}: Wilson {:.1}, Tango {:.1}, Newcombe {:.1}, at all times: \
             difference {:.1}, rate {:.1} %",
            rates.only_a,
            rates.only_b,
            share(0),
            share(1),
            share(2),
            share(3),
            share(4)
        );
    }
}

/// Six tasks with three perturbations each, whose episodes share a difficulty.
fn bootstrap_coverage(n: usize) {
    let covered = |mut random: Stream| {
        let mut cells = Vec::new();
        for task_idx in 0..6 {
            let shared: Vec<f64> = (0..50).map(|_| random.unit()).collect();
            for _ in 0..3 {
                let mut difference = |shared: &f64| {
                    // Whether a pair is discordant depends half on the shared start.
                    let u = if random.unit() < 0.5 { *shared } else { random.unit() };
                    Some(if u < 0.2 {
                        1
                    } else if u < 0.3 {
                        -1
                    } else {
                        0
                    })
                };
                cells.push(BootstrapCell {
                    task_idx,
                    differences: shared.iter().map(&mut difference).collect(),
                });
            }
        }
        let group: Vec<usize> = (0..cells.len()).collect();
        let estimate = cluster_bootstrap(&cells, &[group], LEVELS.alpha)[0].expect("the group has cells");
        estimate.interval[0] <= 0.1 && 0.1 <= estimate.interval[1]
    };
    let n_covered = (0..n).filter(|idx| covered(Stream::new(*idx as u64, "bootstrap"))).count();
    println!(
        "coverage of the cluster bootstrap, 6 tasks × 3 perturbations × 50 episodes, {n} samples: {:.1} %",
        percent(n_covered, n)
    );
}

/// Compares the mean number of pairs until a decision with a test at a fixed number of pairs.
fn episodes_saved(n: usize) {
    println!("pairs until a decision for the better policy, discordance 0.3, {n} runs");
    for difference in [0.2, 0.1, 0.05] {
        let rates = Rates { only_a: 0.15 + difference / 2.0, only_b: 0.15 - difference / 2.0, both: 0.4 };
        // Normal approximation of McNemar's test at 80 % power.
        let z = quantile(1.0 - LEVELS.alpha / 2.0) + quantile(0.8);
        let fixed = ((z / difference).powi(2) * (0.3 - difference * difference)).ceil() as usize;
        let budget = 3 * fixed;
        let run = |mut random: Stream| {
            let mut sequence = PairedSequence::new(LEVELS.alpha);
            for idx in 1..=budget {
                let (a, b) = rates.draw(&mut random);
                sequence.push(a, b);
                let decision = sequential_decision(&sequence, sequence.p_value(), LEVELS);
                if let Some(decision) = decision {
                    return (idx, decision == Decision::ABetter);
                }
            }
            (budget, false)
        };
        let found: Vec<(usize, bool)> = streams(n, "saved").map(run).collect();
        let mean = found.iter().map(|(n_pairs, _)| n_pairs).sum::<usize>() as f64 / n as f64;
        let right = found.iter().filter(|(_, right)| *right).count();
        println!(
            "  difference {difference:4}: mean {mean:.0} of at most {budget} ({:.0} % saved), {:.1} % right; fixed sample at 80 % \
             power: {fixed}",
            100.0 * (1.0 - mean / budget as f64),
            percent(right, n)
        );
    }
}

/// Makes a results file of five policies over the whole protocol and runs `compare` and `report` on it.
fn million_rows(n_thousands: usize) -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("results.db");
    let n_rows = write_rows(&path, 1000 * n_thousands)?;
    println!("{n_rows} rows, {} MB", std::fs::metadata(&path)?.len() / 1_000_000);
    let file = path.to_string_lossy().into_owned();
    let out = folder.path().join("report").to_string_lossy().into_owned();
    for arguments in [
        vec!["compare", &file, "--a", "p0", "--b", "p1"],
        vec!["compare", &file, "--policy", "p0"],
        vec!["report", &file, "-o", &out],
    ] {
        let (wall, peak_mb) = measure(&arguments)?;
        println!("  {}: {:.2} s, {peak_mb} MB", arguments[0], wall.as_secs_f64());
    }
    Ok(())
}

/// Writes random rows under the manifest of a real run and returns their number.
fn write_rows(path: &Path, n_rows: usize) -> anyhow::Result<usize> {
    let status = Command::new(HYPOGEUM)
        .args([
            "run",
            "--policy",
            "p0=random",
            "--tasks",
            "all",
            "--perturbations",
            "all",
            "--episodes",
            "1",
            "--quiet",
            "--db",
        ])
        .arg(path)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()?;
    anyhow::ensure!(status.success(), "the run failed");
    let mut connection = Connection::open(path)?;
    let cells: Vec<(String, String)> = connection
        .prepare("SELECT task, perturbation FROM episodes")?
        .query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?
        .collect::<Result<_, _>>()?;
    let per_cell = n_rows.div_ceil(5 * cells.len());
    let transaction = connection.transaction()?;
    transaction.execute("DELETE FROM episodes", [])?;
    let mut random = Stream::new(0, "rows");
    for policy in 0..5 {
        let name = format!("p{policy}");
        transaction.execute(
            "INSERT OR REPLACE INTO manifest SELECT 'policy/' || ?1, value FROM manifest WHERE key = 'policy/p0'",
            [&name],
        )?;
        let mut insert = transaction.prepare(
            "INSERT INTO episodes VALUES (?1, ?2, ?3, ?4, ?5, 150, ?6, ?6, ?7, ?8, ?9, NULL, 0.1, 0.1, 0.1, 0.1, NULL)",
        )?;
        for (task, perturbation) in &cells {
            for episode in 0..per_cell {
                let success = random.unit() < 0.4 + 0.1 * f64::from(policy);
                let first = success.then_some(70);
                let failed = (!success).then_some("above");
                let fingerprint = format!("{:016x}", (random.unit() * 1e15) as u64);
                let key =
                    params![name, task, perturbation, episode as u32, 7, success, first, failed, fingerprint];
                insert.execute(key)?;
            }
        }
    }
    transaction.commit()?;
    connection.execute_batch("PRAGMA wal_checkpoint(TRUNCATE)")?;
    Ok(5 * per_cell * cells.len())
}

/// Returns the wall time of a command and its largest resident memory in MB.
fn measure(arguments: &[&str]) -> anyhow::Result<(Duration, u64)> {
    let start = Instant::now();
    let mut child =
        Command::new(HYPOGEUM).args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
    let status_file = format!("/proc/{}/status", child.id());
    let mut peak_kb = 0;
    loop {
        let text = std::fs::read_to_string(&status_file).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        peak_kb =
            line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0).max(peak_kb);
        if let Some(status) = child.try_wait()? {
            anyhow::ensure!(status.success(), "{arguments:?} failed");
            return Ok((start.elapsed(), peak_kb / 1000));
        }
        anyhow::ensure!(start.elapsed() < Duration::from_secs(300), "{arguments:?} takes too long");
        std::thread::sleep(Duration::from_millis(5));
    }
}
