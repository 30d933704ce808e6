//! Messages between processes, and what is left when one of them is killed.

use std::time::Duration;

use ipc_types::link::{HostLane, LinkError, SimLane};

use crate::scratch::{
    LAST, PATIENCE, RUN, Scratch, assert_echo, await_signal, create_sim, echo, eventually, fill,
    observation_header, open_host, receive_action, receive_observation, send, small_lane,
};

#[test]
fn observations_and_actions_cross_between_processes() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(2));
    let host = scratch.spawn("roles::plays_a_host");
    eventually("the host attaches", || lane.host_connected().then_some(()));
    assert!(lane.host_alive());
    // Two in flight, of changing sizes.
    send(&mut lane, 1, 1);
    for sequence in 2..200 {
        send(&mut lane, sequence, 1 + (sequence % 4) as u32);
        let before = sequence - 1;
        let n_envs = if before == 1 { 1 } else { 1 + (before % 4) as u32 };
        assert_echo(&receive_action(&link, &mut lane), before, n_envs);
    }
    assert_echo(&receive_action(&link, &mut lane), 199, 4);
    send(&mut lane, LAST, 1);
    assert_echo(&receive_action(&link, &mut lane), LAST, 1);
    host.finish();
    eventually("the host has left", || (!lane.host_connected()).then_some(()));
    assert!(!lane.host_alive());
    drop((lane, link, node));
    scratch.finish();
}

#[test]
fn a_killed_host_is_reaped_and_another_takes_its_place() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(2));
    let mut hoarder = scratch.spawn("roles::plays_a_host_that_keeps_everything");
    eventually("the host attaches", || lane.host_connected().then_some(()));
    send(&mut lane, 1, 4);
    send(&mut lane, 2, 4);
    await_signal(&scratch.domain.root);
    hoarder.kill();
    // Nothing tells so by itself.
    assert!(lane.host_connected());
    assert!(!lane.host_alive());
    assert_eq!(scratch.domain.reap(), 1);
    assert!(!lane.host_connected());
    assert_eq!(scratch.domain.reap(), 0);
    assert!(matches!(send_one(&mut lane, 3), Err(LinkError::NoPeer)));

    let host = scratch.spawn("roles::plays_a_host");
    eventually("the next host attaches", || lane.host_connected().then_some(()));
    for sequence in 4..10 {
        send(&mut lane, sequence, 4);
        assert_echo(&receive_action(&link, &mut lane), sequence, 4);
    }
    send(&mut lane, LAST, 1);
    host.finish();
    drop((lane, link, node));
    scratch.finish();
}

#[test]
fn a_host_takes_over_from_a_killed_one_that_nobody_reaped() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(1));
    let mut hoarder = scratch.spawn("roles::plays_a_host_that_keeps_everything");
    eventually("the host attaches", || lane.host_connected().then_some(()));
    send(&mut lane, 1, 1);
    await_signal(&scratch.domain.root);
    let predecessor = lane.host_id().unwrap();
    hoarder.kill();
    let host = scratch.spawn("roles::plays_a_host");
    eventually("the next host attaches", || lane.host_id().filter(|&id| id != predecessor));
    // The host leaves right after its first answer, which is not lost.
    send(&mut lane, LAST, 2);
    assert_echo(&receive_action(&link, &mut lane), LAST, 2);
    host.finish();
    drop((lane, link, node));
    scratch.finish();
}

#[test]
fn a_host_stays_attached_while_its_sim_is_killed_and_restarted() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let mut sim = scratch.spawn("roles::plays_a_sim_that_is_killed");
    let mut lane = open_host(&node, &small_lane(1));
    let kept = receive_observation(&mut lane);
    await_signal(&scratch.domain.root);
    assert!(lane.sim_connected() && lane.sim_alive());
    sim.kill();
    assert!(lane.sim_connected() && !lane.sim_alive());
    assert!(lane.receive().unwrap().is_none());
    // Reaped by the parent once, left to the successor once.
    for reap in [true, false] {
        if reap {
            assert_eq!(scratch.domain.reap(), 1);
            assert!(!lane.sim_connected());
        }
        // What the dead sim wrote can still be read.
        assert_eq!(kept.header().sequence, 1);
        assert_eq!(kept.pages().len(), 1);
        let mut successor = scratch.spawn("roles::plays_a_sim_that_is_killed");
        let message = receive_observation(&mut lane);
        assert_eq!(message.header(), kept.header());
        await_signal(&scratch.domain.root);
        successor.kill();
        drop(message);
    }
    drop((kept, lane, node));
    scratch.finish();
}

#[test]
fn a_host_that_never_receives_is_an_error_and_not_a_wait_without_end() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(1));
    let host = open_host(&scratch.node(), &small_lane(1));
    send(&mut lane, 1, 1);
    assert!(matches!(send_one(&mut lane, 2), Err(LinkError::Backpressure { .. })));
    // The failed message's memory is back, and the one in the queue is not lost.
    let loan = lane.loan(4).unwrap();
    // All memory is in use now; one more loan than there is memory is refused at once.
    assert!(lane.loan(1).is_err());
    drop((loan, host));
    assert!(matches!(send_one(&mut lane, 3), Err(LinkError::NoPeer)));
    drop((lane, link, node));
    scratch.finish();
}

#[test]
fn a_wait_ends_when_the_peer_sends() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(1));
    let mut host = open_host(&node, &small_lane(1));
    let (woken, heard) = std::sync::mpsc::channel();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for _ in 0..3 {
                // Waits that would outlast the test if nothing rang.
                let message = loop {
                    host.wait(4 * PATIENCE).unwrap();
                    if let Some(message) = host.receive().unwrap() {
                        break message;
                    }
                };
                echo(&mut host, &message);
                woken.send(message.header().sequence).unwrap();
            }
        });
        for sequence in 1..4 {
            send(&mut lane, sequence, 1);
            assert_eq!(heard.recv_timeout(PATIENCE), Ok(sequence), "the host slept on");
            let answer = loop {
                link.wait(4 * PATIENCE).unwrap();
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
fn a_wait_for_no_time_is_no_wait_without_end() {
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
fn a_lane_has_one_sim_and_one_host() {
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
fn a_host_without_a_sim_is_told_so() {
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
