//! Round-trip latency of the link between a sim and a policy host in two processes, compared with a Unix
//! socket that carries the same number of bytes.
//!
//! `cargo bench -p benches --bench transport -- [--csv FILE]`. A round trip starts just before the
//! observation is sent and ends when the response is received. It excludes writing the observation, and
//! includes reading it in the host where the case says `read`. The policy computes nothing. Takes at most 20
//! s. The other process runs this same executable.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::fmt::Write as _;
use std::io::{Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use ipc_types::layout::block_pages;
use ipc_types::link::{
    ActionMessage, Domain, HostLane, LaneSpec, LinkNode, ObservationMessage, SimLane, SimLink,
};
use ipc_types::{ActionHeader, ImageSizes, Morphology, ObservationHeader, Page, SCHEMA_HASH};
use rustix::thread::{CpuSet, sched_setaffinity};

const MORPHOLOGY: Morphology = Morphology::Single;
const RUN: u64 = 1;
/// Measuring time per case, excluding warm-up.
const CASE_TIME: Duration = Duration::from_millis(350);
/// Minimum and maximum number of rounds per case.
const ROUNDS: std::ops::Range<usize> = 5..3000;
const WARM_UP: usize = 5;
/// Maximum wait for the other process.
const TIMEOUT: Duration = Duration::from_secs(5);
/// Time for which the hybrid strategy spins before it blocks.
const SPIN: Duration = Duration::from_micros(50);

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let result = match args[..] {
        ["host", prefix, root, n_envs, strategy, reading] => {
            run_host(&Domain { prefix: prefix.into(), root: root.into() }, n_envs, strategy, reading)
        }
        ["socket", n_envs] => run_socket(n_envs),
        _ => measure(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("failed: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Strategy for waiting until a message arrives.
#[derive(Clone, Copy, Debug, PartialEq)]
enum WaitStrategy {
    Spin,
    Event,
    Hybrid,
}

impl WaitStrategy {
    const ALL: [Self; 3] = [Self::Spin, Self::Event, Self::Hybrid];

    fn name(self) -> &'static str {
        match self {
            Self::Spin => "spin",
            Self::Event => "event",
            Self::Hybrid => "hybrid",
        }
    }

    /// Polls until there is a message. `poll` may block before it checks for a message if its argument is
    /// `true`.
    fn receive<T>(self, mut poll: impl FnMut(bool) -> Result<Option<T>>) -> Result<T> {
        let start = Instant::now();
        let mut may_block = false;
        while start.elapsed() < TIMEOUT {
            if let Some(message) = poll(may_block)? {
                return Ok(message);
            }
            may_block = match self {
                Self::Spin => false,
                Self::Event => true,
                Self::Hybrid => start.elapsed() >= SPIN,
            };
            std::hint::spin_loop();
        }
        bail!("timed out waiting for the other process")
    }
}

/// Maximum blocking time per poll.
const MAX_BLOCK: Duration = Duration::from_millis(100);

/// Measurements, as CSV.
struct LatencyReport {
    csv: String,
    /// CPU placement of the two processes, for the notes.
    placement: &'static str,
}

impl LatencyReport {
    fn row(&mut self, case: &str, value: f64, unit: &str, note: &str) -> Result<()> {
        println!("{case:<44} {value:>12.2} {unit:<6} {note}");
        writeln!(self.csv, "transport,{case},{value:.3},{unit},\"{note}; {}\"", self.placement)?;
        Ok(())
    }

    /// Adds the 50th and 99th percentile of the rounds and returns the median in µs.
    fn percentiles(&mut self, case: &str, mut rounds: Vec<Duration>, bytes: usize) -> Result<f64> {
        rounds.sort_unstable();
        let percentile_us = |q: f64| rounds[((rounds.len() - 1) as f64 * q) as usize].as_secs_f64() * 1e6;
        let note = format!("{bytes} bytes; {} rounds", rounds.len());
        self.row(&format!("{case} p50"), percentile_us(0.5), "us", &note)?;
        self.row(&format!("{case} p99"), percentile_us(0.99), "us", &note)?;
        Ok(percentile_us(0.5))
    }
}

fn measure(args: &[&str]) -> Result<()> {
    let csv_path = args.iter().position(|&arg| arg == "--csv").map(|at| args.get(at + 1));
    let csv_path =
        csv_path.map(|path| path.map(PathBuf::from).context("--csv needs a file name")).transpose()?;
    let placement = if pin(0) { "one core each" } else { "not pinned" };
    let mut table = LatencyReport { csv: "bench,case,value,unit,note\n".into(), placement };
    for n_envs in [1, 16, 64] {
        let bytes = n_envs * block_pages(MORPHOLOGY, Some(ImageSizes::BENCHMARK)) * size_of::<Page>();
        first_touch(&mut table, n_envs, bytes)?;
        let mut hybrid_read = f64::INFINITY;
        for (strategy, reads) in WaitStrategy::ALL.into_iter().flat_map(|w| [(w, false), (w, true)]) {
            let rounds = link_rounds(&mut table, n_envs, strategy, reads)?;
            let access = if reads { "read" } else { "exchange" };
            let p50 =
                table.percentiles(&format!("link {access} n={n_envs} {}", strategy.name()), rounds, bytes)?;
            if reads && strategy == WaitStrategy::Hybrid {
                hybrid_read = p50;
            }
        }
        let socket =
            table.percentiles(&format!("socket read n={n_envs}"), socket_rounds(n_envs, bytes)?, bytes)?;
        let note = "p50 of the socket over p50 of the link, hybrid, both read";
        table.row(&format!("socket over link n={n_envs}"), socket / hybrid_read, "x", note)?;
    }
    if let Some(path) = csv_path {
        std::fs::write(&path, table.csv).with_context(|| format!("write {}", path.display()))?;
    }
    Ok(())
}

/// Measures round trips over the link, and the first and later writes of an observation.
fn link_rounds(
    table: &mut LatencyReport,
    n_envs: usize,
    strategy: WaitStrategy,
    reads: bool,
) -> Result<Vec<Duration>> {
    let base = tempfile::Builder::new().prefix("hyp").tempdir_in("/tmp")?;
    let domain = Domain::new(base.path(), u64::from(std::process::id()));
    let node = LinkNode::new(&domain, "sim")?;
    let link = SimLink::create(&node, 1)?;
    let start = Instant::now();
    let mut lane = SimLane::create(&node, RUN, &spec(n_envs))?;
    let created = start.elapsed();
    let root = domain.root.to_str().context("the domain's root path is not UTF-8")?;
    let reading = if reads { "read" } else { "exchange" };
    let host = ["host", &domain.prefix, root, &n_envs.to_string(), strategy.name(), reading];
    let mut host = spawn(&host, Stdio::null())?;
    let start = Instant::now();
    while !lane.host_connected() {
        ensure!(start.elapsed() < TIMEOUT, "the host did not attach in time");
        std::thread::sleep(Duration::from_millis(1));
    }
    let mut writes = Vec::with_capacity(ROUNDS.end);
    let rounds = rounds(|sequence| {
        let mut loan = lane.loan(n_envs * block_pages(MORPHOLOGY, Some(ImageSizes::BENCHMARK)))?;
        let start = Instant::now();
        bytemuck::cast_slice_mut::<Page, u8>(loan.pages_mut()).fill(sequence as u8);
        writes.push(start.elapsed());
        let start = Instant::now();
        loan.send(header(sequence, n_envs))?;
        let response: ActionMessage = strategy.receive(|may_block| {
            if may_block {
                link.wait(MAX_BLOCK)?;
            }
            Ok(lane.receive()?)
        })?;
        ensure!(response.header().sequence == sequence, "the response has the wrong sequence number");
        Ok(start.elapsed())
    })?;
    // Sequence number 0 asks the host to exit.
    lane.loan(1)?.send(header(0, n_envs))?;
    ensure!(host.wait()?.success(), "the host process failed");
    if strategy == WaitStrategy::Hybrid && reads {
        let note = "lane created, reserved and populated; then one thread fills an observation";
        table.row(&format!("link create n={n_envs}"), created.as_secs_f64() * 1e6, "us", note)?;
        table.row(&format!("link write n={n_envs} first"), writes[0].as_secs_f64() * 1e6, "us", note)?;
        let mut later_writes = writes.split_off(1);
        later_writes.sort_unstable();
        let median = later_writes[later_writes.len() / 2].as_secs_f64() * 1e6;
        table.row(&format!("link write n={n_envs} later"), median, "us", note)?;
    }
    drop((lane, link, node));
    domain.remove()?;
    Ok(rounds)
}

/// Runs the host side of the link: responds immediately, with or without reading every byte first.
fn run_host(domain: &Domain, n_envs: &str, strategy: &str, reading: &str) -> Result<()> {
    pin(1);
    let n_envs: usize = n_envs.parse()?;
    let strategy =
        WaitStrategy::ALL.into_iter().find(|w| w.name() == strategy).context("unknown wait strategy")?;
    let node = LinkNode::new(domain, "host")?;
    let mut lane = HostLane::open(&node, &spec(n_envs), TIMEOUT)?;
    loop {
        let message: ObservationMessage = strategy.receive(|may_block| {
            if may_block {
                lane.wait(MAX_BLOCK)?;
            }
            Ok(lane.receive()?)
        })?;
        let request = *message.header();
        if request.sequence == 0 {
            return Ok(());
        }
        if reading == "read" {
            std::hint::black_box(sum(bytemuck::cast_slice(message.pages())));
        }
        let mut loan = lane.loan(n_envs)?;
        for block in loan.blocks_mut() {
            (block.n_rows, block.action_dim) = (1, 7);
        }
        drop(message);
        let header = ActionHeader {
            schema_hash: SCHEMA_HASH,
            run: request.run,
            sequence: request.sequence,
            ..Default::default()
        };
        loan.send(ActionHeader { epoch: request.epoch, n_envs: request.n_envs, ..header })?;
    }
}

/// Measures round trips of the same number of bytes over a Unix socket. The peer reads every byte and
/// responds with one page per env.
fn socket_rounds(n_envs: usize, bytes: usize) -> Result<Vec<Duration>> {
    let (mut ours, theirs) = UnixStream::pair()?;
    ours.set_read_timeout(Some(TIMEOUT))?;
    let mut peer = spawn(&["socket", &n_envs.to_string()], OwnedFd::from(theirs).into())?;
    let mut observation = vec![0u8; bytes];
    let mut response = vec![0u8; n_envs * size_of::<Page>()];
    let rounds = rounds(|sequence| {
        observation.fill(sequence as u8);
        let start = Instant::now();
        ours.write_all(&observation)?;
        ours.read_exact(&mut response)?;
        Ok(start.elapsed())
    })?;
    drop(ours);
    ensure!(peer.wait()?.success(), "the socket peer failed");
    Ok(rounds)
}

/// Runs the peer side of the socket, which is this process's standard input.
fn run_socket(n_envs: &str) -> Result<()> {
    pin(1);
    let n_envs: usize = n_envs.parse()?;
    let mut stream = UnixStream::from(rustix::io::dup(std::io::stdin())?);
    stream.set_read_timeout(Some(TIMEOUT))?;
    let mut observation =
        vec![0u8; n_envs * block_pages(MORPHOLOGY, Some(ImageSizes::BENCHMARK)) * size_of::<Page>()];
    let response = vec![0u8; n_envs * size_of::<Page>()];
    while stream.read_exact(&mut observation).is_ok() {
        std::hint::black_box(sum(&observation));
        stream.write_all(&response)?;
    }
    Ok(())
}

/// Measures the first and second write to untouched memory. The difference is the page-fault cost that the
/// link avoids by populating its segment.
fn first_touch(table: &mut LatencyReport, n_envs: usize, bytes: usize) -> Result<()> {
    let mut memory = vec![0u8; bytes];
    for (value, name) in [(1, "first"), (2, "second")] {
        let start = Instant::now();
        std::hint::black_box(&mut memory).fill(value);
        let note = "one thread fills private memory that was only reserved";
        table.row(&format!("touch n={n_envs} {name}"), start.elapsed().as_secs_f64() * 1e6, "us", note)?;
    }
    Ok(())
}

/// Repeats a round after warm-up, until [`CASE_TIME`] or the maximum of [`ROUNDS`] is reached.
fn rounds(mut round: impl FnMut(u64) -> Result<Duration>) -> Result<Vec<Duration>> {
    let mut sequences = 1..;
    for sequence in sequences.by_ref().take(WARM_UP) {
        round(sequence)?;
    }
    let start = Instant::now();
    let mut times = Vec::with_capacity(ROUNDS.end);
    for sequence in sequences.take(ROUNDS.end) {
        times.push(round(sequence)?);
        if times.len() >= ROUNDS.start && start.elapsed() > CASE_TIME {
            break;
        }
    }
    Ok(times)
}

fn spec(n_envs: usize) -> LaneSpec {
    let block_pages = block_pages(MORPHOLOGY, Some(ImageSizes::BENCHMARK)) as u32;
    LaneSpec { lane: 0, policy: "nothing".into(), max_envs: n_envs as u32, block_pages, in_flight: 1 }
}

fn header(sequence: u64, n_envs: usize) -> ObservationHeader {
    ObservationHeader {
        schema_hash: SCHEMA_HASH,
        run: RUN,
        sequence,
        epoch: 1,
        n_envs: n_envs as u32,
        control_mode: MORPHOLOGY.default_control_mode().code(),
        ..Default::default()
    }
    .with_images(MORPHOLOGY, Some(ImageSizes::BENCHMARK))
}

/// Reads every byte and returns the wrapping sum of all words.
fn sum(bytes: &[u8]) -> u64 {
    bytemuck::cast_slice::<u8, u64>(bytes).iter().fold(0, |sum, &word| sum.wrapping_add(word))
}

fn spawn(args: &[&str], stdin: Stdio) -> Result<Child> {
    let program: &Path = &std::env::current_exe()?;
    Command::new(program).args(args).stdin(stdin).spawn().context("start the other process")
}

/// Pins this process to one core. Returns `false` if the machine has only one core or refuses.
fn pin(core: usize) -> bool {
    let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut cores = CpuSet::new();
    cores.set(core);
    (n_cores > 1 || core == 1) && sched_setaffinity(None, &cores).is_ok()
}
