//! The contract of the shared-memory link at both ends: policies read images in place, and a host that breaks
//! the protocol ends the run with a clear error.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::cell::Cell;
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use ipc_types::frame::EnvBlockMut;
use ipc_types::layout::{SCHEMA_HASH, block_pages};
use ipc_types::link::{Domain, HostLane, LaneSpec, LinkNode, ObservationMessage, SimLane, SimLink};
use ipc_types::{
    ActionBlock, ActionHeader, ControlMode, ImageSize, ImageSizes, Morphology, ObservationHeader,
    ObservationView,
};
use sim::physics::World;
use sim::render::{CpuRenderer, RenderScene, Renderer, View};
use sim::scene::Snapshot;
use sim::{Profile, TaskId};
use support::{errors, finish, hypogeum, rows};

const RUN: u64 = 11;
/// Sizes that no benchmark has.
const SIZES: ImageSizes =
    ImageSizes { external: ImageSize { width: 99, height: 65 }, hand: ImageSize { width: 80, height: 64 } };

fn receive(lane: &mut HostLane) -> ObservationMessage {
    let deadline = Instant::now() + Duration::from_secs(10);
    loop {
        if let Some(message) = lane.receive().unwrap() {
            return message;
        }
        assert!(Instant::now() < deadline, "no observation within 10 s");
        lane.wait(Duration::from_millis(20)).unwrap();
    }
}

/// Renders every camera of a task's scene into the slices of `out`.
fn render(task: TaskId, out: &mut dyn Iterator<Item = &mut [u8]>) {
    let scene = (task.task().nominal)(Profile::Strict).draw(5);
    let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    World::build(&scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
    let view = RenderScene::new(&scene, SIZES);
    let mut renderer = CpuRenderer::new(1);
    for (camera_idx, out) in out.enumerate() {
        renderer.render(&mut [View { scene: &view, snapshot: &snapshot, camera_idx, out }]).unwrap();
    }
}

/// Returns the line of /proc/self/maps whose address range contains `bytes`.
fn mapping_of(bytes: &[u8]) -> String {
    let span = bytes.as_ptr_range();
    let (start, end) = (span.start as usize, span.end as usize);
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let holds = |line: &&str| {
        let (lo, hi) = line.split_whitespace().next().unwrap().split_once('-').unwrap();
        let parse = |hex| usize::from_str_radix(hex, 16).unwrap();
        (parse(lo)..=parse(hi)).contains(&start) && end <= parse(hi)
    };
    maps.lines().find(holds).expect("the view should lie in mapped memory").to_owned()
}

#[test]
fn policy_reads_images_in_place() {
    let dir = tempfile::tempdir().unwrap();
    let domain = Domain::new(dir.path(), RUN);
    {
        let (morphology, task) = (Morphology::Bimanual, TaskId::DualArmLiftTray);
        let pages = block_pages(morphology, Some(SIZES));
        let spec =
            LaneSpec { lane: 0, policy: "p".into(), max_envs: 2, block_pages: pages as u32, in_flight: 2 };
        let node = LinkNode::new(&domain, "sim").unwrap();
        let _link = SimLink::create(&node, 1).unwrap();
        let mut sim = SimLane::create(&node, RUN, &spec).unwrap();
        let host_node = LinkNode::new(&domain, "host").unwrap();
        let mut host = HostLane::open(&host_node, &spec, Duration::from_secs(5)).unwrap();

        let mut loan = sim.loan(2 * pages).unwrap();
        for block in loan.pages_mut().chunks_exact_mut(pages) {
            let block = EnvBlockMut::new(morphology, Some(SIZES), block);
            *block.record = ipc_types::EnvRecord { execute: 1, ..Zeroable::zeroed() };
            render(task, &mut block.images());
        }
        let header = ObservationHeader {
            schema_hash: SCHEMA_HASH,
            run: RUN,
            sequence: 1,
            n_envs: 2,
            control_mode: ControlMode::JointPos.code(),
            ..Default::default()
        };
        loan.send(header.with_images(morphology, Some(SIZES))).unwrap();

        let message = receive(&mut host);
        let view = ObservationView::new(*message.header(), message.pages()).unwrap();
        let mut expected: Vec<Vec<u8>> =
            view.env(0).images().map(|(_, size)| vec![0; size.n_bytes()]).collect();
        render(task, &mut expected.iter_mut().map(Vec::as_mut_slice));
        for env_idx in 0..2 {
            let env = view.env(env_idx);
            assert!(env.images().map(|(image, _)| image).eq(expected.iter().map(Vec::as_slice)));
            for image in [env.external, env.hand] {
                let mapping = mapping_of(image);
                assert!(mapping.contains("/dev/shm/") && mapping.contains(&domain.prefix), "{mapping}");
                assert!(mapping.contains("r--s"), "the mapping should be read-only: {mapping}");
            }
        }
    }
    domain.remove().unwrap();
}

/// The fields that a foreign host needs from the descriptor file a run writes for it.
#[derive(serde::Deserialize)]
struct LaneDescriptor {
    domain: Domain,
    run: u64,
    lane: LaneSpec,
}

/// Starts a run with one attached policy and opens its lane the way a third-party host would.
fn attach(dir: &Path) -> (Child, LaneDescriptor, LinkNode, HostLane) {
    attach_with(dir, &[])
}

/// Like [`attach`], with more arguments.
fn attach_with(dir: &Path, more: &[&str]) -> (Child, LaneDescriptor, LinkNode, HostLane) {
    let mut args = vec!["run", "--policy", "guest=attach:guest", "--tasks", "RaiseCube", "--episodes", "2"];
    args.extend(["--check-frames", "--db", "r.db"]);
    args.extend(more);
    let child = hypogeum(dir, &args).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(30);
    let descriptor: LaneDescriptor = loop {
        let runs = std::fs::read_dir(dir.join("hypogeum")).into_iter().flatten();
        let files = runs.map(|run| run.unwrap().path().join("attach/guest.json"));
        if let Some(text) = files.filter_map(|file| std::fs::read_to_string(file).ok()).next() {
            break serde_json::from_str(&text).unwrap();
        }
        assert!(Instant::now() < deadline, "the run wrote no descriptor within 30 s");
        std::thread::sleep(Duration::from_millis(10));
    };
    let node = LinkNode::new(&descriptor.domain, "guest").unwrap();
    let lane = HostLane::open(&node, &descriptor.lane, Duration::from_secs(30)).unwrap();
    (child, descriptor, node, lane)
}

/// Answers one observation with zero actions after `corrupt` has modified the header and the blocks.
fn answer(
    lane: &mut HostLane,
    message: &ObservationMessage,
    run: u64,
    corrupt: impl FnOnce(&mut ActionHeader, &mut [ActionBlock]),
) {
    let view = ObservationView::new(*message.header(), message.pages()).unwrap();
    let mut loan = lane.loan(view.n_envs()).unwrap();
    for (env_idx, block) in loan.blocks_mut().iter_mut().enumerate() {
        let record = view.env(env_idx).record;
        *block = ActionBlock {
            slot: record.slot,
            query: record.query,
            n_rows: 30,
            action_dim: 7,
            ..Zeroable::zeroed()
        };
    }
    let ObservationHeader { sequence, epoch, n_envs, .. } = *message.header();
    let mut header =
        ActionHeader { schema_hash: SCHEMA_HASH, run, sequence, epoch, n_envs, ..Default::default() };
    corrupt(&mut header, loan.blocks_mut());
    loan.send(header).unwrap();
}

/// Answers every observation, each modified by `corrupt`, until the run ends.
fn serve_until_exit(
    child: &mut Child,
    lane: &mut HostLane,
    run: u64,
    corrupt: impl Fn(&mut ActionHeader, &mut [ActionBlock]),
) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while child.try_wait().unwrap().is_none() {
        if Instant::now() > deadline {
            child.kill().unwrap();
            let mut text = String::new();
            std::io::Read::read_to_string(&mut child.stderr.take().unwrap(), &mut text).unwrap();
            panic!("the run did not end within 60 s: {text}");
        }
        match lane.receive().unwrap() {
            Some(message) => answer(lane, &message, run, &corrupt),
            None => lane.wait(Duration::from_millis(20)).unwrap(),
        }
    }
}

#[test]
fn foreign_host_serves_every_episode() {
    let dir = tempfile::tempdir().unwrap();
    let (mut child, descriptor, _node, mut lane) = attach(dir.path());
    serve_until_exit(&mut child, &mut lane, descriptor.run, |_, _| ());
    let _ = finish(child).expect_code(0);
    assert_eq!(rows(&dir.path().join("r.db")).len(), 2);
}

#[test]
fn time_of_attached_host_bounds_the_speed() {
    const SLEEP: Duration = Duration::from_millis(40);
    let dir = tempfile::tempdir().unwrap();
    // With one env, the sim has nothing to do while the host has the query.
    let (mut child, descriptor, _node, mut lane) = attach_with(dir.path(), &["--envs", "1", "--json"]);
    let slept = Cell::new(Duration::ZERO);
    serve_until_exit(&mut child, &mut lane, descriptor.run, |_, _| {
        std::thread::sleep(SLEEP);
        slept.set(slept.get() + SLEEP);
    });
    let report = finish(child).expect_code(0).stdout;
    let fps = &serde_json::from_str::<serde_json::Value>(&report).unwrap()["fps"];
    assert_eq!(fps["attached"][0]["policy"], "guest");
    let queried_s = fps["attached"][0]["queried_s"].as_f64().unwrap();
    assert!(queried_s >= slept.get().as_secs_f64() && slept.get() >= 4 * SLEEP, "{slept:?}: {fps}");
    let steps = fps["env_steps"].as_f64().unwrap();
    assert!(fps["bound"]["env_steps_per_s"].as_f64().unwrap() <= 1.000_001 * steps / queried_s, "{fps}");
}

#[test]
fn foreign_host_with_other_schema_is_rejected() {
    let dir = tempfile::tempdir().unwrap();
    let (child, descriptor, _node, mut lane) = attach(dir.path());
    let message = receive(&mut lane);
    answer(&mut lane, &message, descriptor.run, |header, _| header.schema_hash ^= 1);
    let finished = finish(child).expect_code(2);
    for word in ["guest", "schema", &format!("{SCHEMA_HASH:#018x}")] {
        assert!(finished.stderr.contains(word), "`{word}` is missing in: {}", finished.stderr);
    }
}

#[test]
fn failed_answer_marks_the_episode_as_errored() {
    type Corrupt = fn(&mut ActionHeader, &mut [ActionBlock]);
    let cases: [(Corrupt, &str); 2] = [
        (|header, _| header.status = 1, "could not answer"),
        (
            |_, blocks| blocks.iter_mut().for_each(|block| block.rows[9] = f32::NAN),
            "row 1, entry 2 is not finite",
        ),
    ];
    for (corrupt, message) in cases {
        let dir = tempfile::tempdir().unwrap();
        let (mut child, descriptor, _node, mut lane) = attach(dir.path());
        serve_until_exit(&mut child, &mut lane, descriptor.run, corrupt);
        let _ = finish(child).expect_code(1);
        let errors = errors(&dir.path().join("r.db"));
        assert_eq!(errors.len(), 2, "{message}");
        assert!(errors.iter().all(|error| error.contains(message)), "{errors:?}");
    }
}

#[test]
fn malformed_answer_ends_the_run() {
    type Corrupt = fn(&mut ActionHeader, &mut [ActionBlock]);
    let cases: [(Corrupt, &str); 4] = [
        (|_, blocks| blocks[0].action_dim = 6, "6"),
        (|_, blocks| blocks[0].n_rows = 0, "n_rows"),
        (|_, blocks| blocks[0].query += 1, "query"),
        (|header, _| header.sequence += 7, "not in flight"),
    ];
    for (corrupt, message) in cases {
        let dir = tempfile::tempdir().unwrap();
        let (mut child, descriptor, _node, mut lane) = attach(dir.path());
        serve_until_exit(&mut child, &mut lane, descriptor.run, corrupt);
        let finished = finish(child).expect_code(2);
        for word in ["guest", message] {
            assert!(finished.stderr.contains(word), "`{word}` is missing in: {}", finished.stderr);
        }
        assert_eq!(rows(&dir.path().join("r.db")).len(), 0, "{message}");
    }
}

#[test]
fn duplicate_answer_ends_the_run() {
    let dir = tempfile::tempdir().unwrap();
    let (mut child, descriptor, _node, mut lane) = attach(dir.path());
    // Every second answer repeats the sequence number of the answer before it.
    let answered = Cell::new(None);
    serve_until_exit(&mut child, &mut lane, descriptor.run, |header, _| match answered.take() {
        Some(sequence) => header.sequence = sequence,
        None => answered.set(Some(header.sequence)),
    });
    let finished = finish(child).expect_code(2);
    assert!(
        finished.stderr.contains("guest") && finished.stderr.contains("not in flight"),
        "{}",
        finished.stderr
    );
}

#[test]
fn foreign_host_can_be_replaced_mid_batch() {
    let dir = tempfile::tempdir().unwrap();
    let (mut child, descriptor, node, mut lane) = attach(dir.path());
    let message = receive(&mut lane);
    drop((message, lane, node));
    let node = LinkNode::new(&descriptor.domain, "another guest").unwrap();
    let mut lane = HostLane::open(&node, &descriptor.lane, Duration::from_secs(30)).unwrap();
    serve_until_exit(&mut child, &mut lane, descriptor.run, |_, _| ());
    let _ = finish(child).expect_code(0);
    assert_eq!(rows(&dir.path().join("r.db")).len(), 2);
}
