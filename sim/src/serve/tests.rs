//! Tests that drive the parts of the sim's loop by hand, against a host in the same process.

use std::hash::RandomState;
use std::path::Path;
use std::sync::mpsc::sync_channel;

use bytemuck::Zeroable;
use ipc_types::layout::block_pages;
use ipc_types::link::{Domain, HostLane, LaneSpec};
use ipc_types::{
    ActionBlock, ActionHeader, ControlMode, ImageSizes, Morphology, ObservationHeader, ObservationView, Page,
};
use run_config::Amount;

use super::envs::LaneTally;
use super::protocol::{Assignment, Driver, Lane};
use super::*;
use crate::counting::allocations;
use crate::perturb::Language;
use crate::physics::World;
use crate::{Perturbation, Profile, TaskId};
use render::RendererChoice;

const RUN: u64 = 7;
const N_ENVS: u32 = 3;
/// Rows of each answer; the envs execute them in one call.
const N_ROWS: u32 = 5;
const MODE: ControlMode = ControlMode::EeDeltaPose;
const MORPHOLOGY: Morphology = Morphology::Single;
/// Rounds before counting starts, by which all buffers have reached their final size, and counted rounds.
const WARM_UP: u64 = 4;
const ROUNDS: u64 = 10;

/// Answers the pending batch with rows that move every arm a little.
fn answer(host: &mut HostLane, action_dim: usize) {
    host.wait(Duration::from_secs(5)).unwrap();
    let message = host.receive().unwrap().expect("the batch was just sent");
    let header = *message.header();
    let view = ObservationView::new(header, message.pages()).unwrap();
    let mut loan = host.loan(view.n_envs()).unwrap();
    for (env_idx, block) in loan.blocks_mut().iter_mut().enumerate() {
        let record = view.env(env_idx).record;
        *block = ActionBlock {
            slot: record.slot,
            query: record.query,
            n_rows: N_ROWS,
            action_dim: action_dim as u32,
            ..ActionBlock::zeroed()
        };
        block.rows[..N_ROWS as usize * action_dim].fill(0.1);
    }
    let (n_envs, schema_hash) = (header.n_envs, ipc_types::SCHEMA_HASH);
    let (run, sequence, epoch) = (header.run, header.sequence, header.epoch);
    loan.send(ActionHeader { schema_hash, run, sequence, epoch, n_envs, ..Default::default() }).unwrap();
}

fn assignment(id: u64) -> Assignment {
    let (task, perturbation) = (TaskId::RaiseCube, Perturbation::None.into());
    let seed = scene::stream::episode_seed(0, task.name(), id as u32);
    Assignment { id, driver: Driver::Lane(0), task, perturbation, seed }
}

/// Calls `test` with a sim of one lane with images and its connected host.
fn with_server(test: impl FnOnce(&mut Server, HostLane) + Send) {
    let base = tempfile::Builder::new().prefix("hyp").tempdir_in("/tmp").unwrap();
    let domain = Domain::new(base.path(), std::hash::BuildHasher::hash_one(&RandomState::new(), 0));
    let spec = LaneSpec {
        lane: 0,
        policy: "test".to_owned(),
        max_envs: N_ENVS,
        block_pages: block_pages(MORPHOLOGY, Some(ImageSizes::BENCHMARK)) as u32,
        in_flight: 2,
    };
    let config = config(&domain, vec![spec.clone()]);
    let (_commands, receiver) = sync_channel(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let mut server = Server::new(&config, receiver).unwrap();
        let node = LinkNode::new(&domain, "test-host").unwrap();
        let host = HostLane::open(&node, &spec, Duration::from_secs(5)).unwrap();
        server.handle_command(&SimCommand::HostUp { lane: 0 });
        test(&mut server, host);
    });
    domain.remove().unwrap();
}

fn config(domain: &Domain, specs: Vec<LaneSpec>) -> SimConfig {
    let mut run = RunConfig::default();
    // As many threads as envs, so that one batch holds them all.
    run.resources.threads = Amount::Fixed(N_ENVS);
    run.results.control_mode = MODE;
    run.rendering.renderer = RendererChoice::Cpu;
    let answer_timeout_s = Lane::ANSWER_TIMEOUT_S;
    let lane = |spec| Lane {
        spec,
        images: Some(ImageSizes::BENCHMARK),
        foreign: false,
        answer_timeout_s,
        execute: N_ROWS,
    };
    let lanes = specs.into_iter().map(lane).collect();
    SimConfig { domain: domain.clone(), run_id: RUN, max_envs: N_ENVS, envs: N_ENVS, lanes, run }
}

/// Covers receiving, stepping, rendering and sending. Allocations of a physics step are rapier's: a separate
/// world that executes the same actions makes as many.
#[test]
fn loop_round_allocates_nothing_of_its_own() {
    with_server(|server, mut host| {
        let mut twins: Vec<World> = (0..u64::from(N_ENVS))
            .map(|id| {
                server.handle_command(&SimCommand::Run(assignment(id)));
                let nominal = (TaskId::RaiseCube.task().nominal)(Profile::Strict);
                World::build(&nominal.draw(assignment(id).seed), MODE)
            })
            .collect();
        server.envs.refill(|_| true);
        assert_eq!(server.envs.advance(), 0, "the first call only builds the worlds");
        server.serve_lane(0).unwrap();
        let row = [0.1; 7];
        for round in 0..WARM_UP + ROUNDS {
            answer(&mut host, row.len());
            server.link.wait(Duration::from_secs(5)).unwrap();
            let ([received, _], ()) = allocations(|| server.serve_lane(0).unwrap());
            let ([stepped, _], n_steps) = allocations(|| server.envs.advance());
            assert_eq!(n_steps, u64::from(N_ENVS * N_ROWS));
            let ([by_rapier, _], ()) = allocations(|| {
                for twin in &mut twins {
                    (0..N_ROWS).for_each(|_| twin.step(&row));
                }
            });
            let ([sent, _], ()) = allocations(|| server.serve_lane(0).unwrap());
            assert!(server.lanes[0].awaits_answer(), "a batch with images is in flight");
            if round >= WARM_UP {
                // The one allocation is iceoryx2's, for the loan.
                assert_eq!((received, stepped, sent), (0, by_rapier, 1), "round {round}");
            }
        }
        assert_eq!(server.counters.images, (WARM_UP + ROUNDS + 1) * 3 * u64::from(N_ENVS));
    });
}

/// A host that cannot answer says so and leaves. If the loss is noticed before the answer is read, or before
/// the episodes are reported, they must not start again.
#[test]
fn answers_sent_before_leaving_count() {
    for is_read_first in [false, true] {
        with_server(|server, mut host| {
            for id in 0..u64::from(N_ENVS) {
                server.handle_command(&SimCommand::Run(assignment(id)));
            }
            server.envs.refill(|_| true);
            server.envs.advance();
            server.serve_lane(0).unwrap();
            host.wait(Duration::from_secs(5)).unwrap();
            let query = *host.receive().unwrap().expect("the batch was just sent").header();
            let header = ActionHeader {
                schema_hash: ipc_types::SCHEMA_HASH,
                run: query.run,
                sequence: query.sequence,
                epoch: query.epoch,
                n_envs: query.n_envs,
                status: 1,
                ..ActionHeader::default()
            };
            host.loan(query.n_envs as usize).unwrap().send(header).unwrap();
            drop(host);
            if is_read_first {
                assert!(server.receive(0, Instant::now()).unwrap());
            }
            server.handle_command(&SimCommand::HostDown { lane: 0 });
            let mut errors = Vec::new();
            server.envs.take_finished(|outcome| errors.extend(outcome.error));
            assert_eq!(errors, ["the policy host could not answer; see its log"; N_ENVS as usize]);
            assert!(server.envs.held().is_empty());
        });
    }
}

/// Envs of two lanes and the expert, with ten queued episodes of each.
fn crowded_envs(limit: u32) -> Envs {
    let spec = |lane| LaneSpec { lane, policy: "p".into(), max_envs: 1, block_pages: 1, in_flight: 1 };
    let mut config = config(&Domain::new(Path::new("/tmp"), 0), vec![spec(0), spec(1)]);
    (config.max_envs, config.envs) = (6, limit);
    let mut envs = Envs::new(&config, Language::default());
    for (n, driver) in [Driver::Lane(0), Driver::Lane(1), Driver::Expert].into_iter().enumerate() {
        for id in 0..10 {
            envs.push(Assignment { driver, ..assignment(n as u64 * 10 + id) });
        }
    }
    envs
}

#[test]
fn drivers_share_envs_equally() {
    let n_used = |envs: &Envs| [0, 1].map(|lane| envs.tally(lane).n_used);
    let mut envs = crowded_envs(6);
    envs.refill(|_| true);
    assert_eq!(n_used(&envs), [2, 2]);
    envs.give_up(0);
    envs.refill(|_| true);
    assert_eq!(n_used(&envs), [0, 3], "the expert has the other three");
    assert_eq!(envs.held(), (10..30).collect::<Vec<_>>());
}

#[test]
fn lane_without_host_starves_nobody() {
    let mut envs = crowded_envs(6);
    envs.refill(|lane| lane == 1);
    assert_eq!((envs.tally(0).n_used, envs.tally(1).n_used), (0, 3));

    let mut envs = crowded_envs(1);
    envs.give_up(1);
    envs.refill(|_| true);
    assert_eq!(envs.tally(0).n_used, 1, "it was connected when the env was empty");
    envs.refill(|_| false);
    assert_eq!(envs.tally(0).n_used, 0, "the expert has the env now");
    assert_eq!(envs.held().len(), 20);
    envs.restart(0);
    envs.push(assignment(0));
    assert_eq!(envs.held().len(), 20, "episode 0 is there already");
}

#[test]
fn batches_wait_for_acting_envs_only() {
    let size = |n_used, n_ready, n_acting| batch_size(LaneTally { n_used, n_ready, n_acting }, 32, 2);
    assert_eq!(size(16, 0, 16), None);
    assert_eq!(size(16, 1, 15), None, "more get ready soon");
    assert_eq!(size(16, 1, 0), Some(1), "the others wait for the host");
    assert_eq!(size(16, 8, 8), Some(8));
    assert_eq!(size(16, 9, 7), Some(8), "the ninth would occupy both threads alone");
    assert_eq!((size(16, 7, 0), size(16, 16, 0)), (Some(7), Some(8)));
    assert_eq!(size(10, 4, 6), Some(4), "the even part of half of the envs");
    assert_eq!(size(10, 10, 0), Some(6));
    assert_eq!(size(1, 1, 0), Some(1));
    assert_eq!(size(3, 1, 2), None);
    assert_eq!(size(200, 31, 169), None);
    assert_eq!(size(200, 33, 167), Some(32));
    assert_eq!(size(200, 200, 0), Some(32));
}

#[test]
fn unanswered_query_times_out_naming_the_policy() {
    let base = tempfile::Builder::new().prefix("hyp").tempdir_in("/tmp").unwrap();
    let domain = Domain::new(base.path(), u64::from(std::process::id()) << 8);
    let spec = LaneSpec { lane: 0, policy: "slow".into(), max_envs: 1, block_pages: 1, in_flight: 1 };
    {
        let node = LinkNode::new(&domain, "sim").unwrap();
        let link = SimLink::create(&node, 1).unwrap();
        let config =
            Lane { spec: spec.clone(), images: None, foreign: false, answer_timeout_s: 120, execute: N_ROWS };
        let mut lane = LaneState::create(&node, RUN, false, config).unwrap();
        let _host = HostLane::open(&node, &spec, Duration::from_secs(5)).unwrap();
        lane.host_up();
        let sent = Instant::now();
        lane.dispatch(&[0], MORPHOLOGY, MODE, &[], sent);
        assert!(!lane.check_host(sent + Duration::from_secs(119)).unwrap());
        let error = lane.check_host(sent + Duration::from_secs(121)).unwrap_err().to_string();
        assert_eq!(error, "policy `slow` has not answered for 120 s");
        drop(link);
    }
    domain.remove().unwrap();
}

/// A host can change its message after it has sent it. What has been checked is what is used.
#[test]
fn answer_that_changes_later_is_used_as_checked() {
    const SENT: f32 = 0.5;
    let base = tempfile::Builder::new().prefix("hyp").tempdir_in("/tmp").unwrap();
    let domain = Domain::new(base.path(), u64::from(std::process::id()) << 16);
    let spec = LaneSpec { lane: 0, policy: "odd".into(), max_envs: 2, block_pages: 1, in_flight: 1 };
    let change = || {
        let entries = std::fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().path());
        let mut n_changed = 0;
        for path in entries.filter(|path| {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            name.starts_with(&domain.prefix) && name.ends_with(".data")
        }) {
            let bytes = std::fs::read(&path).unwrap();
            let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
            for at in (0..bytes.len() - 3).filter(|&at| bytes[at..at + 4] == SENT.to_le_bytes()) {
                std::os::unix::fs::FileExt::write_all_at(&file, &f32::NAN.to_le_bytes(), at as u64).unwrap();
                n_changed += 1;
            }
        }
        n_changed
    };
    {
        let node = LinkNode::new(&domain, "sim").unwrap();
        let link = SimLink::create(&node, 1).unwrap();
        let config =
            Lane { spec: spec.clone(), images: None, foreign: false, answer_timeout_s: 120, execute: N_ROWS };
        let mut lane = LaneState::create(&node, RUN, false, config).unwrap();
        let mut host = HostLane::open(&node, &spec, Duration::from_secs(5)).unwrap();
        lane.host_up();
        let now = Instant::now();
        let morphology = TaskId::RaiseCube.task().morphology;
        let query = lane.dispatch(&[0, 1], morphology, ControlMode::EeDeltaPose, &[], now);
        let mut loan = host.loan(2).unwrap();
        for block in loan.blocks_mut() {
            *block = ActionBlock { n_rows: 1, action_dim: 7, ..ActionBlock::zeroed() };
            block.rows[..7].fill(SENT);
        }
        loan.send(ActionHeader {
            schema_hash: ipc_types::SCHEMA_HASH,
            run: RUN,
            sequence: query.sequence,
            epoch: query.epoch,
            n_envs: 2,
            ..ActionHeader::default()
        })
        .unwrap();
        link.wait(Duration::from_secs(5)).unwrap();
        let mut n_changed = 0;
        let received = lane.receive(&mut protocol::Latencies::default(), now, |_, view, env_idx| {
            if env_idx == 0 {
                n_changed = change();
            }
            assert_eq!(view.blocks()[env_idx].rows[..7], [SENT; 7]);
            Ok(())
        });
        assert!(received.unwrap());
        assert!(n_changed >= 14, "{n_changed} changes: the host's memory has the values of two envs");
        drop(host);
    }
    domain.remove().unwrap();
}

/// A host of the run has to send checksums, a foreign one may.
#[test]
fn overwritten_answer_fails_its_lane() {
    type Corrupt = fn(&mut ActionHeader, &mut [Page]);
    let cases: [(bool, Corrupt, Option<&str>); 6] = [
        (false, |header, pages| *header = header.with_checksum(pages), None),
        (true, |header, pages| *header = header.with_checksum(pages), None),
        (true, |_, _| (), None),
        (false, |_, _| (), Some("`has_checksum` is 0")),
        (true, overwrite, Some("the message is damaged")),
        (false, refuse, Some("found an observation that was overwritten")),
    ];
    for (foreign, corrupt, expected) in cases {
        let answered = answer_of_changed_message(foreign, corrupt);
        let found = answered.as_ref().err().map(|error| error_chain(error));
        match expected {
            None => assert_eq!(found, None),
            Some(words) => assert!(found.as_ref().is_some_and(|text| text.contains(words)), "{found:?}"),
        }
    }
}

fn overwrite(header: &mut ActionHeader, pages: &mut [Page]) {
    *header = header.with_checksum(pages);
    pages[1].0[64] ^= 1;
}

fn refuse(header: &mut ActionHeader, pages: &mut [Page]) {
    *header = ActionHeader { status: ActionHeader::DAMAGED, ..*header }.with_checksum(pages);
}

/// Sends a batch with a checksum, answers it after `corrupt` has changed the answer, and receives that.
fn answer_of_changed_message(
    foreign: bool,
    corrupt: fn(&mut ActionHeader, &mut [Page]),
) -> Result<bool, LaneError> {
    let base = tempfile::tempdir_in("/tmp").unwrap();
    let domain = Domain::new(base.path(), std::hash::BuildHasher::hash_one(&RandomState::new(), 0));
    let spec = LaneSpec { lane: 0, policy: "test".to_owned(), max_envs: 2, block_pages: 1, in_flight: 1 };
    let answered = {
        let node = LinkNode::new(&domain, "sim").unwrap();
        let link = SimLink::create(&node, 1).unwrap();
        let config =
            Lane { spec: spec.clone(), images: None, foreign, answer_timeout_s: 120, execute: N_ROWS };
        let mut lane = LaneState::create(&node, RUN, true, config).unwrap();
        let mut host = HostLane::open(&node, &spec, Duration::from_secs(5)).unwrap();
        lane.host_up();
        let (now, pages) = (Instant::now(), [Page::zeroed(); 2]);
        let query = lane.dispatch(&[0, 1], MORPHOLOGY, MODE, &pages, now);
        query.check_checksum(&pages).unwrap();
        let mut loan = host.loan(2).unwrap();
        loan.blocks_mut().fill(ActionBlock { n_rows: 1, action_dim: 7, ..ActionBlock::zeroed() });
        let ObservationHeader { schema_hash, run, sequence, epoch, n_envs, .. } = query;
        let mut header =
            ActionHeader { schema_hash, run, sequence, epoch, n_envs, ..ActionHeader::default() };
        corrupt(&mut header, bytemuck::cast_slice_mut(loan.blocks_mut()));
        loan.send(header).unwrap();
        link.wait(Duration::from_secs(5)).unwrap();
        let answered = lane.receive(&mut protocol::Latencies::default(), now, |_, _, _| Ok(()));
        drop(host);
        answered
    };
    domain.remove().unwrap();
    answered
}
