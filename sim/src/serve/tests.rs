//! The loop's own parts, driven by hand against a host in the same process.

use bytemuck::Zeroable;
use ipc_types::link::{Domain, HostLane, LaneSpec};
use ipc_types::{ActionBlock, ActionHeader, ControlMode, ObservationView};

use super::protocol::{Assignment, Driver, Lane};
use super::*;
use crate::counting::allocations;
use crate::physics::World;
use crate::render::RendererChoice;
use crate::{Perturbation, TaskId};

const RUN: u64 = 7;
const N_ENVS: u32 = 3;
/// Rows of each answer, one pass of the slots.
const N_ROWS: u32 = 5;
/// Rounds before counting begins, and while it goes on: memory has grown to its size by then.
const WARM_UP: u64 = 4;
const ROUNDS: u64 = 10;

/// Answers the batch that waits, every env with rows that move the arm a little.
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
    loan.send(ActionHeader { schema_hash, run, sequence, epoch, n_envs, status: 0, reserved: [0; 7] })
        .unwrap();
}

fn assignment(id: u64) -> Assignment {
    let (task, perturbation) = (TaskId::RaiseCube, Perturbation::None.into());
    let seed = crate::stream::episode_seed(0, task.name(), id as u32);
    Assignment { id, driver: Driver::Lane(0), task, perturbation, seed }
}

/// Receiving, stepping, drawing and sending, images and all. What a physics step allocates is rapier's: a world stepped on
/// its own, through the same actions, allocates as often.
#[test]
fn a_round_of_the_loop_allocates_nothing_of_its_own() {
    let base = tempfile::Builder::new().prefix("hyp").tempdir_in("/tmp").unwrap();
    let domain = Domain::new(base.path(), u64::from(std::process::id()));
    let (mode, morphology) = (ControlMode::EeDeltaPose, TaskId::RaiseCube.task().morphology);
    let spec = LaneSpec {
        lane: 0,
        policy: "test".to_owned(),
        max_envs: N_ENVS,
        block_pages: ipc_types::layout::block_pages(morphology, true) as u32,
        in_flight: 2,
    };
    let mut run = RunConfig::default();
    (run.resources.envs, run.resources.threads) = (N_ENVS, 1);
    (run.results.control_mode, run.results.execute) = (mode, N_ROWS);
    run.rendering.renderer = RendererChoice::Cpu;
    let lanes = vec![Lane { spec: spec.clone(), images: true, foreign: false }];
    let config = SimConfig { domain: domain.clone(), run_id: RUN, lanes, run };
    let (_commands, receiver) = sync_channel(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let mut server = Server::new(&config, receiver).unwrap();
        let node = LinkNode::new(&domain, "test-host").unwrap();
        let mut host = HostLane::open(&node, &spec, Duration::from_secs(5)).unwrap();
        server.obey(&SimCommand::HostUp { lane: 0 });
        let mut twins: Vec<World> = (0..u64::from(N_ENVS))
            .map(|id| {
                server.obey(&SimCommand::Run(assignment(id)));
                let nominal = (TaskId::RaiseCube.task().nominal)();
                World::build(&nominal.draw(assignment(id).seed), mode)
            })
            .collect();
        server.slots.refill();
        assert_eq!(server.slots.pass(), 0, "the first pass builds");
        server.serve_lane(0).unwrap();
        let row = [0.1; 7];
        for round in 0..WARM_UP + ROUNDS {
            answer(&mut host, row.len());
            server.link.wait(Duration::from_secs(5)).unwrap();
            let ([received, _], ()) = allocations(|| server.serve_lane(0).unwrap());
            let ([stepped, _], n_steps) = allocations(|| server.slots.pass());
            assert_eq!(n_steps, u64::from(N_ENVS * N_ROWS));
            let ([of_rapier, _], ()) = allocations(|| {
                for twin in &mut twins {
                    (0..N_ROWS).for_each(|_| twin.step(&row));
                }
            });
            let ([sent, _], ()) = allocations(|| server.serve_lane(0).unwrap());
            assert!(server.lanes[0].awaits_answer(), "a batch with images is out");
            if round >= WARM_UP {
                // The one allocation is iceoryx2's, for the loan.
                assert_eq!((received, stepped, sent), (0, of_rapier, 1), "round {round}");
            }
        }
        assert_eq!(server.counters.images, (WARM_UP + ROUNDS + 1) * 3 * u64::from(N_ENVS));
    });
    domain.remove().unwrap();
}

#[test]
fn a_host_that_does_not_answer_is_given_up_with_its_name() {
    let base = tempfile::Builder::new().prefix("hyp").tempdir_in("/tmp").unwrap();
    let domain = Domain::new(base.path(), u64::from(std::process::id()) << 8);
    let spec = LaneSpec { lane: 0, policy: "slow".into(), max_envs: 1, block_pages: 1, in_flight: 1 };
    {
        let node = LinkNode::new(&domain, "sim").unwrap();
        let link = SimLink::create(&node, 1).unwrap();
        let config = Lane { spec: spec.clone(), images: false, foreign: false };
        let mut lane = LaneState::create(&node, RUN, config).unwrap();
        let _host = HostLane::open(&node, &spec, Duration::from_secs(5)).unwrap();
        lane.host_up();
        let asked = Instant::now();
        lane.dispatch(&[0], TaskId::RaiseCube.task().morphology, ControlMode::EeDeltaPose, asked);
        assert!(!lane.look_after(asked + Duration::from_secs(119)).unwrap());
        let given_up = lane.look_after(asked + Duration::from_secs(121)).unwrap_err().to_string();
        assert_eq!(given_up, "policy `slow` has not answered for 120 s");
        drop(link);
    }
    domain.remove().unwrap();
}
