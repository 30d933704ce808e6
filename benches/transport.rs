//! How long the link takes to carry an observation to a policy host and its answer back: two processes, the same bytes by a
//! Unix socket beside it.
//!
//! `cargo bench -p benches --bench transport -- [--csv FILE]`. A round trip is from just before the observation is sent until
//! its answer is received; the sim's writing of it is not part of it, the host's reading is where the case says `read`. The
//! policy computes nothing. Bounded to 20 s. The other process is this program again.

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
use ipc_types::{ActionHeader, Morphology, ObservationHeader, Page, SCHEMA_HASH};
use rustix::thread::{CpuSet, sched_setaffinity};

const MORPHOLOGY: Morphology = Morphology::Single;
const RUN: u64 = 1;
/// Time spent on a case, warm-up apart, and the fewest and most rounds that it may take.
const CASE_TIME: Duration = Duration::from_millis(350);
const ROUNDS: std::ops::Range<usize> = 5..3000;
const WARM_UP: usize = 5;
/// Longest wait for the other process.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long the hybrid wait spins before it sleeps.
const SPIN: Duration = Duration::from_micros(50);

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let result = match args[..] {
        ["host", prefix, root, n_envs, waiting, reading] => {
            play_host(&Domain { prefix: prefix.into(), root: root.into() }, n_envs, waiting, reading)
        }
        ["socket", n_envs] => play_socket(n_envs),
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

/// How a side waits for a message.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Waiting {
    Spin,
    Event,
    Hybrid,
}

impl Waiting {
    const ALL: [Self; 3] = [Self::Spin, Self::Event, Self::Hybrid];

    fn name(self) -> &'static str {
        match self {
            Self::Spin => "spin",
            Self::Event => "event",
            Self::Hybrid => "hybrid",
        }
    }

    /// Looks until there is a message; `look` is told whether it may sleep first.
    fn receive<T>(self, mut look: impl FnMut(bool) -> Result<Option<T>>) -> Result<T> {
        let start = Instant::now();
        let mut sleeps = false;
        while start.elapsed() < PATIENCE {
            if let Some(message) = look(sleeps)? {
                return Ok(message);
            }
            sleeps = match self {
                Self::Spin => false,
                Self::Event => true,
                Self::Hybrid => start.elapsed() >= SPIN,
            };
            std::hint::spin_loop();
        }
        bail!("the other process is silent")
    }
}

/// Longest sleep between two looks.
const SLEEP: Duration = Duration::from_millis(100);

/// What has been measured.
struct Table {
    csv: String,
    /// Whether the two processes have a core each.
    placement: &'static str,
}

impl Table {
    fn row(&mut self, case: &str, value: f64, unit: &str, note: &str) -> Result<()> {
        println!("{case:<44} {value:>12.2} {unit:<6} {note}");
        writeln!(self.csv, "transport,{case},{value:.3},{unit},\"{note}; {}\"", self.placement)?;
        Ok(())
    }

    /// Two rows; returns the median.
    fn percentiles(&mut self, case: &str, mut rounds: Vec<Duration>, bytes: usize) -> Result<f64> {
        rounds.sort_unstable();
        let at = |share: f64| rounds[((rounds.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e6;
        let note = format!("{bytes} bytes; {} rounds", rounds.len());
        self.row(&format!("{case} p50"), at(0.5), "us", &note)?;
        self.row(&format!("{case} p99"), at(0.99), "us", &note)?;
        Ok(at(0.5))
    }
}

fn measure(args: &[&str]) -> Result<()> {
    let csv_path = args.iter().position(|&arg| arg == "--csv").map(|at| args.get(at + 1));
    let csv_path = csv_path.map(|path| path.map(PathBuf::from).context("--csv wants a file")).transpose()?;
    let placement = if pin(0) { "one core each" } else { "not pinned" };
    let mut table = Table { csv: "bench,case,value,unit,note\n".into(), placement };
    for n_envs in [1, 16, 64] {
        let bytes = n_envs * block_pages(MORPHOLOGY, true) * size_of::<Page>();
        first_touch(&mut table, n_envs, bytes)?;
        let mut best_read = f64::INFINITY;
        for (waiting, reads) in Waiting::ALL.into_iter().flat_map(|w| [(w, false), (w, true)]) {
            let rounds = link_rounds(&mut table, n_envs, waiting, reads)?;
            let touch = if reads { "read" } else { "exchange" };
            let p50 =
                table.percentiles(&format!("link {touch} n={n_envs} {}", waiting.name()), rounds, bytes)?;
            if reads && waiting == Waiting::Hybrid {
                best_read = p50;
            }
        }
        let socket =
            table.percentiles(&format!("socket read n={n_envs}"), socket_rounds(n_envs, bytes)?, bytes)?;
        let note = "p50 of the socket over p50 of the link, hybrid, both read";
        table.row(&format!("socket over link n={n_envs}"), socket / best_read, "x", note)?;
    }
    if let Some(path) = csv_path {
        std::fs::write(&path, table.csv).with_context(|| format!("write {}", path.display()))?;
    }
    Ok(())
}

/// Round trips over the link; also how long the first and the later writings of an observation take.
fn link_rounds(table: &mut Table, n_envs: usize, waiting: Waiting, reads: bool) -> Result<Vec<Duration>> {
    let base = tempfile::Builder::new().prefix("hyp").tempdir_in("/tmp")?;
    let domain = Domain::new(base.path(), u64::from(std::process::id()));
    let node = LinkNode::new(&domain, "sim")?;
    let link = SimLink::create(&node, 1)?;
    let start = Instant::now();
    let mut lane = SimLane::create(&node, RUN, &spec(n_envs))?;
    let created = start.elapsed();
    let root = domain.root.to_str().context("the root is not UTF-8")?;
    let reading = if reads { "read" } else { "exchange" };
    let host = ["host", &domain.prefix, root, &n_envs.to_string(), waiting.name(), reading];
    let mut host = spawn(&host, Stdio::null())?;
    let start = Instant::now();
    while !lane.host_connected() {
        ensure!(start.elapsed() < PATIENCE, "no host attaches");
        std::thread::sleep(Duration::from_millis(1));
    }
    let mut writes = Vec::with_capacity(ROUNDS.end);
    let rounds = rounds(|sequence| {
        let mut loan = lane.loan(n_envs * block_pages(MORPHOLOGY, true))?;
        let start = Instant::now();
        bytemuck::cast_slice_mut::<Page, u8>(loan.pages_mut()).fill(sequence as u8);
        writes.push(start.elapsed());
        let start = Instant::now();
        loan.send(header(sequence, n_envs))?;
        let answer: ActionMessage = waiting.receive(|sleeps| {
            if sleeps {
                link.wait(SLEEP)?;
            }
            Ok(lane.receive()?)
        })?;
        ensure!(answer.header().sequence == sequence, "an answer to another question");
        Ok(start.elapsed())
    })?;
    // An observation of no sequence tells the host to end.
    lane.loan(1)?.send(header(0, n_envs))?;
    ensure!(host.wait()?.success(), "the host failed");
    if waiting == Waiting::Hybrid && reads {
        let note = "lane created, reserved and populated; then one thread fills an observation";
        table.row(&format!("link create n={n_envs}"), created.as_secs_f64() * 1e6, "us", note)?;
        table.row(&format!("link write n={n_envs} first"), writes[0].as_secs_f64() * 1e6, "us", note)?;
        let mut later = writes.split_off(1);
        later.sort_unstable();
        let median = later[later.len() / 2].as_secs_f64() * 1e6;
        table.row(&format!("link write n={n_envs} later"), median, "us", note)?;
    }
    drop((lane, link, node));
    domain.remove()?;
    Ok(rounds)
}

/// The other side of the link: answers at once, with or without having read every byte.
fn play_host(domain: &Domain, n_envs: &str, waiting: &str, reading: &str) -> Result<()> {
    pin(1);
    let n_envs: usize = n_envs.parse()?;
    let waiting = Waiting::ALL.into_iter().find(|w| w.name() == waiting).context("no such way of waiting")?;
    let node = LinkNode::new(domain, "host")?;
    let mut lane = HostLane::open(&node, &spec(n_envs), PATIENCE)?;
    loop {
        let message: ObservationMessage = waiting.receive(|sleeps| {
            if sleeps {
                lane.wait(SLEEP)?;
            }
            Ok(lane.receive()?)
        })?;
        let to = *message.header();
        if to.sequence == 0 {
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
        let answer = ActionHeader {
            schema_hash: SCHEMA_HASH,
            run: to.run,
            sequence: to.sequence,
            ..Default::default()
        };
        loan.send(ActionHeader { epoch: to.epoch, n_envs: to.n_envs, ..answer })?;
    }
}

/// Round trips of the same bytes over a Unix socket: written whole, read whole and looked at, answered with a page per env.
fn socket_rounds(n_envs: usize, bytes: usize) -> Result<Vec<Duration>> {
    let (mut ours, theirs) = UnixStream::pair()?;
    ours.set_read_timeout(Some(PATIENCE))?;
    let mut peer = spawn(&["socket", &n_envs.to_string()], OwnedFd::from(theirs).into())?;
    let mut observation = vec![0u8; bytes];
    let mut answer = vec![0u8; n_envs * size_of::<Page>()];
    let rounds = rounds(|sequence| {
        observation.fill(sequence as u8);
        let start = Instant::now();
        ours.write_all(&observation)?;
        ours.read_exact(&mut answer)?;
        Ok(start.elapsed())
    })?;
    drop(ours);
    ensure!(peer.wait()?.success(), "the socket's other side failed");
    Ok(rounds)
}

/// The other side of the socket, which is its standard input.
fn play_socket(n_envs: &str) -> Result<()> {
    pin(1);
    let n_envs: usize = n_envs.parse()?;
    let mut stream = UnixStream::from(rustix::io::dup(std::io::stdin())?);
    stream.set_read_timeout(Some(PATIENCE))?;
    let mut observation = vec![0u8; n_envs * block_pages(MORPHOLOGY, true) * size_of::<Page>()];
    let answer = vec![0u8; n_envs * size_of::<Page>()];
    while stream.read_exact(&mut observation).is_ok() {
        std::hint::black_box(sum(&observation));
        stream.write_all(&answer)?;
    }
    Ok(())
}

/// What the link's populating saves: the first and the second writing of memory that nothing has touched.
fn first_touch(table: &mut Table, n_envs: usize, bytes: usize) -> Result<()> {
    let mut memory = vec![0u8; bytes];
    for (value, name) in [(1, "first"), (2, "second")] {
        let start = Instant::now();
        std::hint::black_box(&mut memory).fill(value);
        let note = "one thread fills private memory that was only reserved";
        table.row(&format!("touch n={n_envs} {name}"), start.elapsed().as_secs_f64() * 1e6, "us", note)?;
    }
    Ok(())
}

/// Repeats a round, warm-up first, until its time or its number is used up.
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
    let block_pages = block_pages(MORPHOLOGY, true) as u32;
    LaneSpec { lane: 0, policy: "nothing".into(), max_envs: n_envs as u32, block_pages, in_flight: 1 }
}

fn header(sequence: u64, n_envs: usize) -> ObservationHeader {
    ObservationHeader {
        schema_hash: SCHEMA_HASH,
        run: RUN,
        sequence,
        epoch: 1,
        n_envs: n_envs as u32,
        block_pages: block_pages(MORPHOLOGY, true) as u32,
        morphology: MORPHOLOGY.code(),
        control_mode: MORPHOLOGY.default_control_mode().code(),
        images: 1,
        reserved: [0; 2],
    }
}

/// Reads every byte.
fn sum(bytes: &[u8]) -> u64 {
    bytemuck::cast_slice::<u8, u64>(bytes).iter().fold(0, |sum, &word| sum.wrapping_add(word))
}

fn spawn(args: &[&str], stdin: Stdio) -> Result<Child> {
    let program: &Path = &std::env::current_exe()?;
    Command::new(program).args(args).stdin(stdin).spawn().context("start the other process")
}

/// Puts this process on one core; `false` if the machine has no second one, or does not let us.
fn pin(core: usize) -> bool {
    let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut cores = CpuSet::new();
    cores.set(core);
    (n_cores > 1 || core == 1) && sched_setaffinity(None, &cores).is_ok()
}
