//! The contract of the link, seen from both of its ends: images are read where they were drawn, and a peer that speaks
//! another schema is told so.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use ipc_types::frame::EnvBlockMut;
use ipc_types::layout::{EXTERNAL_BYTES, HAND_BYTES, SCHEMA_HASH, block_pages};
use ipc_types::link::{Domain, HostLane, LaneSpec, LinkNode, ObservationMessage, SimLane, SimLink};
use ipc_types::{ActionBlock, ActionHeader, ControlMode, Morphology, ObservationHeader, ObservationView};
use sim::TaskId;
use sim::physics::World;
use sim::render::{CpuRenderer, RenderScene, Renderer, View};
use sim::scene::Snapshot;
use support::{errors, finish, hypogeum, rows};

const RUN: u64 = 11;

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

/// Draws every camera of a task's first scene into `out`, image by image.
fn draw(task: TaskId, out: &mut dyn Iterator<Item = &mut [u8]>) {
    let scene = (task.task().nominal)().draw(5);
    let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    World::build(&scene, ControlMode::JointPos).write_snapshot(&mut snapshot);
    let view = RenderScene::new(&scene);
    let mut renderer = CpuRenderer::new(1);
    for (camera_idx, out) in out.enumerate() {
        renderer.render(&mut [View { scene: &view, snapshot: &snapshot, camera_idx, out }]).unwrap();
    }
}

/// The line of /proc/self/maps whose range holds all of `bytes`.
fn mapping_of(bytes: &[u8]) -> String {
    let span = bytes.as_ptr_range();
    let (start, end) = (span.start as usize, span.end as usize);
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let holds = |line: &&str| {
        let (lo, hi) = line.split_whitespace().next().unwrap().split_once('-').unwrap();
        let parse = |hex| usize::from_str_radix(hex, 16).unwrap();
        (parse(lo)..=parse(hi)).contains(&start) && end <= parse(hi)
    };
    maps.lines().find(holds).expect("the view lies in mapped memory").to_owned()
}

#[test]
fn a_policy_reads_images_where_the_renderer_wrote_them() {
    let dir = tempfile::tempdir().unwrap();
    let domain = Domain::new(dir.path(), RUN);
    {
        let (morphology, task) = (Morphology::Bimanual, TaskId::DualArmLiftTray);
        let pages = block_pages(morphology, true);
        let spec =
            LaneSpec { lane: 0, policy: "p".into(), max_envs: 2, block_pages: pages as u32, in_flight: 2 };
        let node = LinkNode::new(&domain, "sim").unwrap();
        let _link = SimLink::create(&node, 1).unwrap();
        let mut sim = SimLane::create(&node, RUN, &spec).unwrap();
        let host_node = LinkNode::new(&domain, "host").unwrap();
        let mut host = HostLane::open(&host_node, &spec, Duration::from_secs(5)).unwrap();

        let mut loan = sim.loan(2 * pages).unwrap();
        for block in loan.pages_mut().chunks_exact_mut(pages) {
            let block = EnvBlockMut::new(morphology, block);
            *block.record = ipc_types::EnvRecord { execute: 1, ..Zeroable::zeroed() };
            let images = block.external.chunks_exact_mut(EXTERNAL_BYTES);
            draw(task, &mut images.chain(block.hand.chunks_exact_mut(HAND_BYTES)));
        }
        loan.send(ObservationHeader {
            schema_hash: SCHEMA_HASH,
            run: RUN,
            sequence: 1,
            n_envs: 2,
            block_pages: pages as u32,
            morphology: morphology.code(),
            control_mode: ControlMode::JointPos.code(),
            images: 1,
            ..Default::default()
        })
        .unwrap();

        let message = receive(&mut host);
        let view = ObservationView::new(*message.header(), message.pages()).unwrap();
        let mut expected = vec![0; 2 * EXTERNAL_BYTES + 2 * HAND_BYTES];
        let (external, hand) = expected.split_at_mut(2 * EXTERNAL_BYTES);
        draw(task, &mut external.chunks_exact_mut(EXTERNAL_BYTES).chain(hand.chunks_exact_mut(HAND_BYTES)));
        for env_idx in 0..2 {
            let env = view.env(env_idx);
            assert!(
                env.external == &expected[..2 * EXTERNAL_BYTES]
                    && env.hand == &expected[2 * EXTERNAL_BYTES..]
            );
            for image in [env.external, env.hand] {
                let mapping = mapping_of(image);
                assert!(mapping.contains("/dev/shm/") && mapping.contains(&domain.prefix), "{mapping}");
                assert!(mapping.contains("r--s"), "a policy cannot alter what it sees: {mapping}");
            }
        }
    }
    domain.remove().unwrap();
}

/// What a foreign host reads of the invitation that a run writes for it.
#[derive(serde::Deserialize)]
struct Invitation {
    domain: Domain,
    run: u64,
    lane: LaneSpec,
}

/// Starts a run of one attached policy and opens its lane, as a host that somebody else wrote would.
fn attach(dir: &Path) -> (Child, Invitation, LinkNode, HostLane) {
    let args =
        ["run", "--policy", "guest=attach:guest", "--tasks", "RaiseCube", "--episodes", "2", "--db", "r.db"];
    let child = hypogeum(dir, &args).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(30);
    let invitation: Invitation = loop {
        let runs = std::fs::read_dir(dir.join("hypogeum")).into_iter().flatten();
        let notes = runs.map(|run| run.unwrap().path().join("attach/guest.json"));
        if let Some(text) = notes.filter_map(|note| std::fs::read_to_string(note).ok()).next() {
            break serde_json::from_str(&text).unwrap();
        }
        assert!(Instant::now() < deadline, "the run invited nobody within 30 s");
        std::thread::sleep(Duration::from_millis(10));
    };
    let node = LinkNode::new(&invitation.domain, "guest").unwrap();
    let lane = HostLane::open(&node, &invitation.lane, Duration::from_secs(30)).unwrap();
    (child, invitation, node, lane)
}

/// Answers one observation with rows of zeros, once `spoil` has had its way with header and blocks.
fn answer(
    lane: &mut HostLane,
    message: &ObservationMessage,
    run: u64,
    spoil: impl FnOnce(&mut ActionHeader, &mut [ActionBlock]),
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
    spoil(&mut header, loan.blocks_mut());
    loan.send(header).unwrap();
}

/// Answers with `spoil` until the run ends.
fn play(
    child: &mut Child,
    lane: &mut HostLane,
    run: u64,
    spoil: impl Fn(&mut ActionHeader, &mut [ActionBlock]),
) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while child.try_wait().unwrap().is_none() {
        if Instant::now() > deadline {
            child.kill().unwrap();
            panic!("the run did not end");
        }
        match lane.receive().unwrap() {
            Some(message) => answer(lane, &message, run, &spoil),
            None => lane.wait(Duration::from_millis(20)).unwrap(),
        }
    }
}

#[test]
fn a_foreign_host_can_play_every_episode() {
    let dir = tempfile::tempdir().unwrap();
    let (mut child, invitation, _node, mut lane) = attach(dir.path());
    play(&mut child, &mut lane, invitation.run, |_, _| ());
    let _ = finish(child).expect_code(0);
    assert_eq!(rows(&dir.path().join("r.db")).len(), 2);
}

#[test]
fn a_foreign_host_of_another_schema_is_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let (child, invitation, _node, mut lane) = attach(dir.path());
    let message = receive(&mut lane);
    answer(&mut lane, &message, invitation.run, |header, _| header.schema_hash ^= 1);
    let finished = finish(child).expect_code(2);
    for word in ["guest", "schema", &format!("{SCHEMA_HASH:#018x}")] {
        assert!(finished.stderr.contains(word), "`{word}` is missing in: {}", finished.stderr);
    }
}

#[test]
fn what_a_foreign_host_cannot_answer_is_an_errored_episode_and_the_run_ends() {
    type Spoil = fn(&mut ActionHeader, &mut [ActionBlock]);
    let cases: [(Spoil, &str); 2] = [
        (|header, _| header.status = 1, "could not answer"),
        (
            |_, blocks| blocks.iter_mut().for_each(|block| block.rows[9] = f32::NAN),
            "row 1, entry 2 is not finite",
        ),
    ];
    for (spoil, says) in cases {
        let dir = tempfile::tempdir().unwrap();
        let (mut child, invitation, _node, mut lane) = attach(dir.path());
        play(&mut child, &mut lane, invitation.run, spoil);
        let _ = finish(child).expect_code(1);
        let errors = errors(&dir.path().join("r.db"));
        assert_eq!(errors.len(), 2, "{says}");
        assert!(errors.iter().all(|error| error.contains(says)), "{errors:?}");
    }
}

#[test]
fn a_foreign_host_that_answers_what_was_not_asked_ends_the_run_with_its_name() {
    type Spoil = fn(&mut ActionHeader, &mut [ActionBlock]);
    let cases: [(Spoil, &str); 4] = [
        (|_, blocks| blocks[0].action_dim = 6, "6"),
        (|_, blocks| blocks[0].n_rows = 0, "n_rows"),
        (|_, blocks| blocks[0].query += 1, "query"),
        (|header, _| header.sequence += 7, "not in flight"),
    ];
    for (spoil, says) in cases {
        let dir = tempfile::tempdir().unwrap();
        let (mut child, invitation, _node, mut lane) = attach(dir.path());
        play(&mut child, &mut lane, invitation.run, spoil);
        let finished = finish(child).expect_code(2);
        for word in ["guest", says] {
            assert!(finished.stderr.contains(word), "`{word}` is missing in: {}", finished.stderr);
        }
        assert_eq!(rows(&dir.path().join("r.db")).len(), 0, "{says}");
    }
}

#[test]
fn a_second_answer_to_one_question_ends_the_run() {
    let dir = tempfile::tempdir().unwrap();
    let (child, invitation, _node, mut lane) = attach(dir.path());
    let message = receive(&mut lane);
    answer(&mut lane, &message, invitation.run, |_, _| ());
    answer(&mut lane, &message, invitation.run, |_, _| ());
    let finished = finish(child).expect_code(2);
    assert!(
        finished.stderr.contains("guest") && finished.stderr.contains("not in flight"),
        "{}",
        finished.stderr
    );
}

#[test]
fn a_foreign_host_that_leaves_in_the_middle_of_a_batch_is_replaced_by_the_next() {
    let dir = tempfile::tempdir().unwrap();
    let (mut child, invitation, node, mut lane) = attach(dir.path());
    let message = receive(&mut lane);
    drop((message, lane, node));
    let node = LinkNode::new(&invitation.domain, "another guest").unwrap();
    let mut lane = HostLane::open(&node, &invitation.lane, Duration::from_secs(30)).unwrap();
    play(&mut child, &mut lane, invitation.run, |_, _| ());
    let _ = finish(child).expect_code(0);
    assert_eq!(rows(&dir.path().join("r.db")).len(), 2);
}
