//! A policy host in this process, connected to the sim end of a link.

use std::io::{self, BufRead, BufReader, PipeWriter};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ipc_types::link::{Domain, LaneSpec, LinkNode, SimLane, SimLink};
use ipc_types::{ActionHeader, ActionView, Morphology, ObservationHeader};
use policy_host::serve::{HostConfig, HostEvent, ServeError, serve_with};
use policy_host::{PolicySpec, QueryMode};
use run_config::{Amount, Execution, RunConfig};

use crate::batch::ObservationBatch;
use crate::{act_spec, data, rows};

/// Timeout of every wait.
const TIMEOUT: Duration = Duration::from_secs(60);
const RUN: u64 = 77;

struct HostFixture {
    domain: Domain,
    wake: SimLink,
    lane: SimLane,
    host: JoinHandle<Result<(), ServeError>>,
    stdin: PipeWriter,
    events: BufReader<io::PipeReader>,
    _base: tempfile::TempDir,
}

impl HostFixture {
    fn new(spec: PolicySpec, id: u64) -> Self {
        Self::with(spec, id, |_| ())
    }

    fn with(spec: PolicySpec, id: u64, change: impl FnOnce(&mut RunConfig)) -> Self {
        let base = tempfile::tempdir_in("/tmp").unwrap();
        let domain = Domain::new(base.path(), 0x9057_0000_0000 + u64::from(std::process::id()) * 64 + id);
        let lane = LaneSpec { lane: 0, policy: "p".into(), max_envs: 2, block_pages: 87, in_flight: 2 };
        let node = LinkNode::new(&domain, "sim").unwrap();
        let wake = SimLink::create(&node, 1).unwrap();
        let sim = SimLane::create(&node, RUN, &lane).unwrap();
        let (input, stdin) = io::pipe().unwrap();
        let (events, output) = io::pipe().unwrap();
        let mut run = RunConfig::default();
        run.resources.threads = Amount::Fixed(1);
        change(&mut run);
        let config = HostConfig {
            domain: domain.clone(),
            run_id: RUN,
            lane,
            spec,
            checkpoint: None,
            morphologies: Morphology::ALL.to_vec(),
            execution: Execution::chunk(30),
            run,
        };
        // Real hosts receive their configuration as JSON.
        let config = serde_json::from_str(&serde_json::to_string(&config).unwrap()).unwrap();
        let host = std::thread::spawn(move || serve_with(config, input, output));
        Self { domain, wake, lane: sim, host, stdin, events: BufReader::new(events), _base: base }
    }

    fn event(&mut self) -> HostEvent {
        let mut line = String::new();
        self.events.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap()
    }

    /// Returns the error of the next `Failed` event.
    fn failure(&mut self) -> String {
        loop {
            match self.event() {
                HostEvent::Failed { message } => return message,
                HostEvent::Ledger { .. } | HostEvent::Note { .. } | HostEvent::Spans(_) => {}
                HostEvent::Ready { .. } => panic!("ready twice"),
            }
        }
    }

    fn send(&mut self, batch: &ObservationBatch, header: ObservationHeader) {
        let mut loan = self.lane.loan(batch.pages.len()).unwrap();
        loan.pages_mut().copy_from_slice(&batch.pages);
        loan.send(header).unwrap();
    }

    fn receive(&mut self) -> ipc_types::link::ActionMessage {
        let started = Instant::now();
        loop {
            if let Some(message) = self.lane.receive().unwrap() {
                return message;
            }
            assert!(started.elapsed() < TIMEOUT, "no answer");
            self.wake.wait(Duration::from_millis(20)).unwrap();
        }
    }

    /// Closes the host's standard input and returns its remaining events.
    fn end(self) -> Vec<HostEvent> {
        drop(self.stdin);
        self.host.join().unwrap().unwrap();
        let lines = self.events.lines().map(|line| serde_json::from_str(&line.unwrap()).unwrap());
        let events = lines.collect();
        drop((self.lane, self.wake));
        self.domain.remove().unwrap();
        events
    }
}

#[test]
fn host_survives_bad_messages_and_exits_with_input() {
    let mut fixture = HostFixture::new(act_spec(data("act-tiny")), 0);
    assert!(matches!(fixture.event(), HostEvent::Ready { load_ms } if load_ms > 0.0));
    let batch = ObservationBatch::of(Morphology::Single, &[0, 1]);
    let header = ObservationHeader { run: RUN, sequence: 5, epoch: 3, ..batch.header };

    fixture.send(&batch, header);
    let answer = fixture.receive();
    assert_eq!((answer.header().run, answer.header().sequence, answer.header().epoch), (RUN, 5, 3));
    assert_eq!(answer.header().status, 0);
    let mut policy =
        policy_host::load(&act_spec(data("act-tiny")), 1, QueryMode::Chunk, &Morphology::ALL).unwrap();
    let view = ActionView::new(*answer.header(), answer.pages()).unwrap();
    for (block, expected) in view.blocks().iter().zip(batch.answer(&mut *policy)) {
        assert_eq!((block.slot, rows(block)), (expected.slot, rows(&expected)));
    }
    drop(answer);

    for (bad, says) in [
        (ObservationHeader { schema_hash: 1, ..header }, "schema"),
        (ObservationHeader { n_envs: 9, ..header }, "pages"),
        (ObservationHeader { run: 1, ..header }, "run"),
        (ObservationHeader { control_mode: 1, ..header }, "pd_joint_pos"),
    ] {
        fixture.send(&batch, bad);
        let answer = fixture.receive();
        assert_eq!((answer.header().status, answer.header().sequence), (1, 5));
        drop(answer);
        let failure = fixture.failure();
        assert!(failure.contains(says), "{says}: {failure}");
    }

    fixture.send(&batch, ObservationHeader { sequence: 6, ..header });
    assert_eq!(fixture.receive().header().status, 0);
    let events = fixture.end();
    let last = events.last().unwrap();
    assert!(matches!(last, HostEvent::Ledger { batches: 6, busy_s, .. } if *busy_s > 0.0), "{last:?}");
}

#[test]
fn overwritten_observations_are_refused() {
    let mut fixture =
        HostFixture::with(act_spec(data("act-tiny")), 2, |run| run.resources.check_frames = true);
    assert!(matches!(fixture.event(), HostEvent::Ready { .. }));
    let mut batch = ObservationBatch::of(Morphology::Single, &[0, 1]);
    let header = ObservationHeader { run: RUN, sequence: 5, epoch: 3, ..batch.header };
    let checked = header.with_checksum(&batch.pages);

    fixture.send(&batch, checked);
    let answer = fixture.receive();
    assert_eq!(answer.header().status, 0);
    answer.header().check_checksum(answer.pages()).unwrap();
    drop(answer);

    // A pixel, then the length of an instruction, which makes the record itself invalid.
    for (page, byte) in [(80, 17), (0, 18)] {
        batch.pages[page].0[byte] ^= 0x55;
        fixture.send(&batch, checked);
        assert_eq!(fixture.receive().header().status, ActionHeader::DAMAGED);
        let failure = fixture.failure();
        assert!(
            failure.contains("overwritten in shared memory") && failure.contains("checksum"),
            "{failure}"
        );
        batch.pages[page].0[byte] ^= 0x55;
    }

    fixture.send(&batch, header);
    assert_eq!(fixture.receive().header().status, ActionHeader::DAMAGED, "it has no checksum");
    fixture.send(&batch, checked);
    assert_eq!(fixture.receive().header().status, 0);
    drop(fixture.end());
}

#[test]
fn idle_host_exits_when_input_closes() {
    let mut fixture = HostFixture::new(PolicySpec::Idle, 1);
    assert!(matches!(fixture.event(), HostEvent::Ready { .. }));
    assert_eq!(
        fixture.end(),
        [HostEvent::Ledger { queries: 0, batches: 0, busy_s: 0.0, cpu_s: 0.0, device_s: 0.0, flop: 0 }]
    );
}

#[cfg(feature = "gpu")]
#[test]
#[ignore = "needs a Vulkan driver"]
fn device_holds_two_observations() {
    use run_config::DeviceChoice;
    let started = Instant::now();
    let mut fixture = HostFixture::with(act_spec(data("act-tiny")), 3, |run| {
        run.inference.policy_device = DeviceChoice::Software;
        run.resources.check_frames = true;
    });
    assert!(matches!(fixture.event(), HostEvent::Ready { .. }));
    let batch = ObservationBatch::of(Morphology::Single, &[0, 1]);
    let header = ObservationHeader { run: RUN, epoch: 3, ..batch.header };
    let numbered = |sequence| ObservationHeader { sequence, ..header }.with_checksum(&batch.pages);
    for round in 0..2 {
        // The second is invalid, or its checksum is: the device computes the others all the same.
        let bad = [
            ObservationHeader { run: 1, sequence: 1, ..header }.with_checksum(&batch.pages),
            ObservationHeader { sequence: 1, ..header },
        ];
        fixture.send(&batch, numbered(0));
        fixture.send(&batch, bad[round % 2]);
        let first = fixture.receive();
        assert_eq!((first.header().sequence, first.header().status), (0, 0));
        let rows_of_first: Vec<f32> =
            rows(&ActionView::new(*first.header(), first.pages()).unwrap().blocks()[1]).to_vec();
        drop(first);
        fixture.send(&batch, numbered(2));
        let expected = [1, ActionHeader::DAMAGED][round % 2];
        let second = fixture.receive();
        assert_eq!((second.header().sequence, second.header().status), (1, expected));
        drop(second);
        let third = fixture.receive();
        assert_eq!((third.header().sequence, third.header().status), (2, 0));
        assert_eq!(
            rows(&ActionView::new(*third.header(), third.pages()).unwrap().blocks()[1]),
            rows_of_first
        );
    }
    let events = fixture.end();
    let last = events.last().unwrap();
    let HostEvent::Ledger { batches: 6, busy_s, device_s, .. } = *last else { panic!("{last:?}") };
    let elapsed_s = started.elapsed().as_secs_f64();
    assert!(busy_s > 0.0 && device_s > 0.0 && device_s < elapsed_s, "{last:?} in {elapsed_s} s");
}
