//! Messages between processes, and recovery after one of them is killed.

use std::time::Duration;

use ipc_types::link::{HostLane, LinkError, SimLane};

use crate::scratch::{
    LAST_SEQUENCE, RUN, Scratch, TIMEOUT, assert_echo, await_ready, create_sim, echo, eventually, fill,
    observation_header, open_host, receive_action, receive_observation, send, small_lane,
};

#[test]
fn messages_round_trip_between_processes() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(2));
    let host = scratch.spawn("roles::echo_host");
    eventually("the host attaches", || lane.host_connected().then_some(()));
    assert!(lane.host_alive());
    // Two messages in flight, of varying sizes.
    send(&mut lane, 1, 1);
    for sequence in 2..200 {
        send(&mut lane, sequence, 1 + (sequence % 4) as u32);
        let previous = sequence - 1;
        let n_envs = if previous == 1 { 1 } else { 1 + (previous % 4) as u32 };
        assert_echo(&receive_action(&link, &mut lane), previous, n_envs);
    }
    assert_echo(&receive_action(&link, &mut lane), 199, 4);
    send(&mut lane, LAST_SEQUENCE, 1);
    assert_echo(&receive_action(&link, &mut lane), LAST_SEQUENCE, 1);
    host.finish();
    eventually("the host detaches", || (!lane.host_connected()).then_some(()));
    assert!(!lane.host_alive());
    drop((lane, link, node));
    scratch.finish();
}

#[test]
fn host_can_be_replaced_after_reaping() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(2));
    let mut host = scratch.spawn("roles::host_that_releases_nothing");
    eventually("the host attaches", || lane.host_connected().then_some(()));
    send(&mut lane, 1, 4);
    send(&mut lane, 2, 4);
    await_ready(&scratch.domain.root);
    host.kill();
    // The killed host counts as attached until it is reaped.
    assert!(lane.host_connected());
    assert!(!lane.host_alive());
    assert_eq!(scratch.domain.reap(), Some(1));
    assert!(!lane.host_connected());
    assert_eq!(scratch.domain.reap(), Some(0));
    assert!(matches!(send_one(&mut lane, 3), Err(LinkError::NoPeer)));

    let host = scratch.spawn("roles::echo_host");
    eventually("the next host attaches", || lane.host_connected().then_some(()));
    for sequence in 4..10 {
        send(&mut lane, sequence, 4);
        assert_echo(&receive_action(&link, &mut lane), sequence, 4);
    }
    send(&mut lane, LAST_SEQUENCE, 1);
    host.finish();
    drop((lane, link, node));
    scratch.finish();
}

#[test]
fn new_host_replaces_a_killed_one_without_reaping() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(1));
    let mut host = scratch.spawn("roles::host_that_releases_nothing");
    eventually("the host attaches", || lane.host_connected().then_some(()));
    send(&mut lane, 1, 1);
    await_ready(&scratch.domain.root);
    let predecessor = lane.host_id().unwrap();
    host.kill();
    let host = scratch.spawn("roles::echo_host");
    eventually("the next host attaches", || lane.host_id().filter(|&id| id != predecessor));
    // The host exits right after its first answer, which must not be lost.
    send(&mut lane, LAST_SEQUENCE, 2);
    assert_echo(&receive_action(&link, &mut lane), LAST_SEQUENCE, 2);
    host.finish();
    drop((lane, link, node));
    scratch.finish();
}

#[test]
fn host_stays_attached_across_sim_restart() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let mut sim = scratch.spawn("roles::sim_that_gets_killed");
    let mut lane = open_host(&node, &small_lane(1));
    let held = receive_observation(&mut lane);
    await_ready(&scratch.domain.root);
    assert!(lane.sim_connected() && lane.sim_alive());
    sim.kill();
    assert!(lane.sim_connected() && !lane.sim_alive());
    assert!(lane.receive().unwrap().is_none());
    // First the parent reaps the killed sim, then its successor does.
    for reap in [true, false] {
        if reap {
            assert_eq!(scratch.domain.reap(), Some(1));
            assert!(!lane.sim_connected());
        }
        // The killed sim's message is still readable.
        assert_eq!(held.header().sequence, 1);
        assert_eq!(held.pages().len(), 1);
        let mut successor = scratch.spawn("roles::sim_that_gets_killed");
        let message = receive_observation(&mut lane);
        assert_eq!(message.header(), held.header());
        await_ready(&scratch.domain.root);
        successor.kill();
        drop(message);
    }
    drop((held, lane, node));
    scratch.finish();
}

#[test]
fn send_times_out_when_host_never_receives() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(1));
    let host = open_host(&scratch.node(), &small_lane(1));
    send(&mut lane, 1, 1);
    assert!(matches!(send_one(&mut lane, 2), Err(LinkError::Backpressure { .. })));
    // The memory of the failed message is free again; the queued message is not lost.
    let loan = lane.loan(4).unwrap();
    // All memory is in use now, so a further loan fails at once.
    assert!(lane.loan(1).is_err());
    drop((loan, host));
    assert!(matches!(send_one(&mut lane, 3), Err(LinkError::NoPeer)));
    drop((lane, link, node));
    scratch.finish();
}

#[test]
fn wait_ends_when_the_peer_sends() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(1));
    let mut host = open_host(&node, &small_lane(1));
    let (answered, answers) = std::sync::mpsc::channel();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for _ in 0..3 {
                // Without a notification, these waits would outlast the test.
                let message = loop {
                    host.wait(4 * TIMEOUT).unwrap();
                    if let Some(message) = host.receive().unwrap() {
                        break message;
                    }
                };
                echo(&mut host, &message);
                answered.send(message.header().sequence).unwrap();
            }
        });
        for sequence in 1..4 {
            send(&mut lane, sequence, 1);
            assert_eq!(answers.recv_timeout(TIMEOUT), Ok(sequence), "the host was not woken");
            let answer = loop {
                link.wait(4 * TIMEOUT).unwrap();
                if let Some(message) = lane.receive().unwrap() {
                    break message;
                }
            };
            assert_echo(&answer, sequence, 1);
        }
    });
    drop((lane, link, host, node));
    scratch.finish();
}

#[test]
fn wait_with_zero_timeout_returns() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, lane) = create_sim(&node, &small_lane(1));
    let host = open_host(&node, &small_lane(1));
    for timeout in [Duration::ZERO, Duration::from_nanos(1), Duration::from_nanos(1500)] {
        link.wait(timeout).unwrap();
        host.wait(timeout).unwrap();
    }
    drop((lane, link, host, node));
    scratch.finish();
}

#[test]
fn lane_admits_one_sim_and_one_host() {
    let scratch = Scratch::new();
    let (node, other) = (scratch.node(), scratch.node());
    let spec = small_lane(1);
    let sim = create_sim(&node, &spec);
    let host = open_host(&node, &spec);
    let second = HostLane::open(&other, &spec, Duration::from_millis(50));
    assert!(matches!(second, Err(LinkError::Occupied { .. })), "{second:?}");
    let second = SimLane::create(&other, RUN, &spec);
    assert!(matches!(second, Err(LinkError::Occupied { .. })), "{second:?}");
    drop((sim, host, node, other));
    scratch.finish();
}

#[test]
fn open_reports_missing_sim() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let error = HostLane::open(&node, &small_lane(1), Duration::from_millis(20)).unwrap_err();
    assert!(
        matches!(&error, LinkError::Absent { service } if service == "hyp/lane/0/observation"),
        "{error}"
    );
    drop(node);
    scratch.finish();
}

fn send_one(lane: &mut SimLane, sequence: u64) -> Result<(), LinkError> {
    let mut loan = lane.loan(1)?;
    fill(loan.pages_mut(), sequence);
    loan.send(observation_header(sequence, 1))
}
