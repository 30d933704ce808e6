//! After warm-up, our code sends and receives without allocating. iceoryx2 0.10 makes one small allocation
//! per loan (the loan's shared state) and no others.

use std::time::Duration;

use crate::counting::allocations;
use crate::scratch::{
    Scratch, assert_echo, create_sim, echo, fill, observation_header, open_host, small_lane,
};

#[test]
fn round_trip_allocates_once_per_loan() {
    let scratch = Scratch::new();
    let node = scratch.node();
    let (link, mut lane) = create_sim(&node, &small_lane(2));
    let mut host = open_host(&node, &small_lane(2));
    let mut round_trip = |sequence: u64| {
        let ([in_loan, _], mut loan) = allocations(|| lane.loan(4).unwrap());
        let ([in_send, _], ()) = allocations(|| {
            fill(loan.pages_mut(), sequence);
            loan.send(observation_header(sequence, 4)).unwrap();
            host.wait(Duration::from_secs(1)).unwrap();
        });
        // The echo makes the second loan.
        let ([in_host, _], ()) = allocations(|| {
            let message = host.receive().unwrap().unwrap();
            echo(&mut host, &message);
        });
        let ([in_sim, _], ()) = allocations(|| {
            link.wait(Duration::from_secs(1)).unwrap();
            assert_echo(&lane.receive().unwrap().unwrap(), sequence, 4);
            // No further message, and a wait that times out.
            assert!(lane.receive().unwrap().is_none() && host.receive().unwrap().is_none());
            host.wait(Duration::from_micros(10)).unwrap();
        });
        [in_loan, in_send, in_host, in_sim]
    };
    for sequence in 1..=10 {
        round_trip(sequence);
    }
    for sequence in 11..=100 {
        assert_eq!(round_trip(sequence), [1, 0, 1, 0]);
    }
    drop((link, lane, host, node));
    scratch.finish();
}
