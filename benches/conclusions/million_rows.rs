//! Time and memory of `compare` and `report` on a million rows.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rusqlite::{Connection, params};
use sim::scene::stream::Stream;

const HYPOGEUM: &str = env!("CARGO_BIN_EXE_hypogeum-under-bench");

/// Makes a results file of five policies over the whole protocol and runs `compare` and `report` on it.
pub(crate) fn million_rows(n_thousands: usize) -> anyhow::Result<()> {
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
            "INSERT INTO episodes VALUES (?1, ?2, ?3, ?4, ?5, 150, ?6, ?6, ?7, ?8, ?9, NULL, 0.1, 0.1, 0.1, 0.1, 0, NULL)",
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
    drop(connection);
    orchestrator::fuzzing::seal_results(path);
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
