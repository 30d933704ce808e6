//! After warm-up a message crosses the link without an allocation of ours. iceoryx2 0.10 makes one for each loan (the loan's
//! shared state, a small block) and none besides.

use std::time::Duration;

use crate::counting::allocations;
use crate::scratch::{
    Scratch, assert_echo, create_sim, echo, fill, observation_header, open_host, small_lane,
};

#[test]
fn messages_cross_without_an_allocation_but_one_for_each_loan() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(2));
    let mut host = open_host(&node, &small_lane(2));
    let mut round = |sequence: u64| {
        let ([for_loan, _], mut loan) = allocations(|| lane.loan(4).unwrap());
        let ([besides, _], ()) = allocations(|| {
            fill(loan.pages_mut(), sequence);
            loan.send(observation_header(sequence, 4)).unwrap();
            host.wait(Duration::from_secs(1)).unwrap();
        });
        // The echo makes the other loan.
        let ([in_host, _], ()) = allocations(|| {
            let message = host.receive().unwrap().unwrap();
            echo(&mut host, &message);
        });
        let ([in_sim, _], ()) = allocations(|| {
            link.wait(Duration::from_secs(1)).unwrap();
            assert_echo(&lane.receive().unwrap().unwrap(), sequence, 4);
            // Nothing more to come, and a wait in vain.
            assert!(lane.receive().unwrap().is_none() && host.receive().unwrap().is_none());
            host.wait(Duration::from_micros(10)).unwrap();
        });
        [for_loan, besides, in_host, in_sim]
    };
    for sequence in 1..=10 {
        round(sequence);
    }
    for sequence in 11..=100 {
        assert_eq!(round(sequence), [1, 0, 1, 0]);
    }
    drop((link, lane, host, node));
    scratch.finish();
}
