//! A scratch domain and peer processes: this test binary re-executed with one of the [`crate::roles`].

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ipc_types::link::{
    ActionMessage, Domain, HostLane, LaneSpec, LinkNode, ObservationMessage, SimLane, SimLink,
};
use ipc_types::{
    ActionHeader, ActionView, EnvRecord, Morphology, ObservationHeader, ObservationView, Page, SCHEMA_HASH,
};

/// Upper bound on every wait in these tests.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(20);
/// Run number in the message headers.
pub(crate) const RUN: u64 = 0x5ca1_ab1e;
/// Sequence number after which an echo host exits.
pub(crate) const LAST_SEQUENCE: u64 = u64::MAX;

/// A temporary folder with a domain of its own, both removed on drop.
pub(crate) struct Scratch {
    pub(crate) base: tempfile::TempDir,
    pub(crate) domain: Domain,
}

impl Scratch {
    pub(crate) fn new() -> Self {
        // Socket paths are limited to 107 bytes, so the default temporary folder may be too deep.
        let base = tempfile::Builder::new().prefix("hyp").tempdir_in("/tmp").unwrap();
        // Derive the run number from the folder's random name.
        let name = base.path().file_name().unwrap().as_encoded_bytes();
        let run = name.iter().fold(0u64, |run, &byte| run.wrapping_mul(257).wrapping_add(u64::from(byte)));
        let domain = Domain::new(base.path(), run);
        Self { base, domain }
    }

    pub(crate) fn node(&self) -> LinkNode {
        LinkNode::new(&self.domain, "test").unwrap()
    }

    /// Lists the domain's files in shared memory.
    pub(crate) fn segments(&self) -> Vec<PathBuf> {
        let entries = std::fs::read_dir("/dev/shm").unwrap();
        let prefix = self.domain.prefix.as_bytes();
        let ours = entries.flatten().filter(|entry| entry.file_name().as_encoded_bytes().starts_with(prefix));
        ours.map(|entry| entry.path()).collect()
    }

    /// Removes the domain and asserts that nothing is left of it.
    pub(crate) fn finish(self) {
        self.domain.remove().unwrap();
        self.assert_removed();
    }

    pub(crate) fn assert_removed(&self) {
        assert_eq!(self.segments(), Vec::<PathBuf>::new());
        assert!(!self.domain.root.exists());
    }

    /// Re-executes this binary as `role`, the name of an ignored test.
    pub(crate) fn spawn(&self, role: &str) -> PeerProcess {
        let child = Command::new(std::env::current_exe().unwrap())
            .args([role, "--exact", "--ignored", "--nocapture"])
            .env("LINK_TEST_PREFIX", &self.domain.prefix)
            .env("LINK_TEST_ROOT", &self.domain.root)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        PeerProcess { child }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = self.domain.remove();
    }
}

/// Returns the domain passed to a spawned process, or `None` if the ignored tests are run by hand.
pub(crate) fn domain_from_env() -> Domain {
    let prefix = std::env::var("LINK_TEST_PREFIX").expect("another test starts this process");
    Domain { prefix, root: std::env::var_os("LINK_TEST_ROOT").unwrap().into() }
}

/// A spawned process, killed on drop.
pub(crate) struct PeerProcess {
    child: Child,
}

impl PeerProcess {
    /// Sends SIGKILL and waits for the process to exit.
    pub(crate) fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Waits for the process to exit and asserts that it succeeded.
    pub(crate) fn finish(mut self) {
        let status = eventually("the peer process exits", || self.child.try_wait().unwrap());
        assert!(status.success(), "the peer process failed: {status}");
    }
}

impl Drop for PeerProcess {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Polls `poll` until it returns a value. Panics with `description` after [`TIMEOUT`].
pub(crate) fn eventually<T>(description: &str, mut poll: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    while start.elapsed() < TIMEOUT {
        if let Some(value) = poll() {
            return value;
        }
        std::thread::sleep(Duration::from_micros(200));
    }
    panic!("{description}: not within {TIMEOUT:?}");
}

/// Returns a lane of 4 single-arm envs without images.
pub(crate) fn small_lane(in_flight: u32) -> LaneSpec {
    LaneSpec { lane: 0, policy: "echo".into(), max_envs: 4, block_pages: 1, in_flight }
}

pub(crate) fn create_sim(node: &LinkNode, spec: &LaneSpec) -> (SimLink, SimLane) {
    (SimLink::create(node, 1).unwrap(), SimLane::create(node, RUN, spec).unwrap())
}

pub(crate) fn open_host(node: &LinkNode, spec: &LaneSpec) -> HostLane {
    HostLane::open(node, spec, TIMEOUT).unwrap()
}

pub(crate) fn observation_header(sequence: u64, n_envs: u32) -> ObservationHeader {
    ObservationHeader {
        schema_hash: SCHEMA_HASH,
        run: RUN,
        sequence,
        epoch: 1,
        n_envs,
        block_pages: 1,
        morphology: Morphology::Single.code(),
        control_mode: Morphology::Single.default_control_mode().code(),
        images: 0,
        ..ObservationHeader::default()
    }
}

pub(crate) fn answer_header(to: &ObservationHeader) -> ActionHeader {
    ActionHeader {
        schema_hash: SCHEMA_HASH,
        run: to.run,
        sequence: to.sequence,
        epoch: to.epoch,
        n_envs: to.n_envs,
        ..ActionHeader::default()
    }
}

/// Sends a message of `n_envs` records, as written by [`fill`].
pub(crate) fn send(lane: &mut SimLane, sequence: u64, n_envs: u32) {
    let mut loan = lane.loan(n_envs as usize).unwrap();
    fill(loan.pages_mut(), sequence);
    loan.send(observation_header(sequence, n_envs)).unwrap();
}

/// Writes one record per page, whose first state entry is [`expected_state`].
pub(crate) fn fill(pages: &mut [Page], sequence: u64) {
    for (slot, page) in (0..).zip(pages) {
        let record: &mut EnvRecord = bytemuck::cast_mut(page);
        *record = bytemuck::Zeroable::zeroed();
        (record.slot, record.execute, record.state_dim) = (slot, 1, 25);
        record.state[0] = expected_state(sequence, slot);
    }
}

/// Returns the first state entry of slot `slot` in message `sequence`, which the answer repeats.
pub(crate) fn expected_state(sequence: u64, slot: u32) -> f32 {
    (sequence % 1000) as f32 + slot as f32 / 8.0
}

pub(crate) fn receive_observation(lane: &mut HostLane) -> ObservationMessage {
    eventually("an observation arrives", || {
        lane.wait(Duration::from_millis(10)).unwrap();
        lane.receive().unwrap()
    })
}

pub(crate) fn receive_action(link: &SimLink, lane: &mut SimLane) -> ActionMessage {
    eventually("an action arrives", || {
        link.wait(Duration::from_millis(10)).unwrap();
        lane.receive().unwrap()
    })
}

/// Answers each env with one action row whose first entry is the env's first state entry.
pub(crate) fn echo(lane: &mut HostLane, message: &ObservationMessage) {
    let view = ObservationView::new(*message.header(), message.pages()).unwrap();
    let mut loan = lane.loan(view.n_envs()).unwrap();
    for (env_idx, block) in loan.blocks_mut().iter_mut().enumerate() {
        let env = view.env(env_idx);
        *block = bytemuck::Zeroable::zeroed();
        (block.slot, block.n_rows, block.action_dim) = (env.record.slot, 1, 7);
        block.rows[0] = env.state[0];
    }
    loan.send(answer_header(message.header())).unwrap();
}

/// Asserts that `message` is the [`echo`] of observation message `sequence`.
pub(crate) fn assert_echo(message: &ActionMessage, sequence: u64, n_envs: u32) {
    assert_eq!((message.header().sequence, message.header().n_envs), (sequence, n_envs));
    let view = ActionView::new(*message.header(), message.pages()).unwrap();
    for (slot, block) in (0..).zip(view.blocks()) {
        assert_eq!((block.slot, block.rows[0]), (slot, expected_state(sequence, slot)));
    }
}

/// Tells the parent of a spawned process that the process is ready.
pub(crate) fn mark_ready(root: &Path) {
    std::fs::write(root.join("ready"), "").unwrap();
}

pub(crate) fn await_ready(root: &Path) {
    eventually("the peer process is ready", || std::fs::remove_file(root.join("ready")).ok());
}
