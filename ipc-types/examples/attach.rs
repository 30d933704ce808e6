//! A policy host of one's own: it answers every query of a run with 30 rows of zeros.
//!
//! ```sh
//! hypogeum run --policy mine=attach:mine --tasks RaiseCube --episodes 2 --db mine.db    # prints a PATH
//! cargo run --release --locked -p ipc-types --example attach -- PATH                   # meanwhile
//! ```

use std::error::Error;
use std::path::PathBuf;
use std::time::Duration;

use bytemuck::Zeroable;
use ipc_types::link::{Domain, HostLane, LaneSpec, LinkNode, ObservationMessage};
use ipc_types::{ActionBlock, ActionHeader, ObservationView, SCHEMA_HASH};

/// The file at PATH, as far as a host needs it.
#[derive(serde::Deserialize)]
struct Endpoint {
    domain: Domain,
    lane: LaneSpec,
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = PathBuf::from(std::env::args_os().nth(1).ok_or("expected the path of a lane")?);
    let endpoint: Endpoint = serde_json::from_slice(&std::fs::read(&path)?)?;
    let node = LinkNode::new(&endpoint.domain, "example")?;
    let mut lane = HostLane::open(&node, &endpoint.lane, Duration::from_secs(60))?;
    // The run removes the file when it ends.
    while path.exists() {
        match lane.receive()? {
            Some(observation) => answer(&mut lane, &observation)?,
            None => lane.wait(Duration::from_millis(100))?,
        }
    }
    Ok(())
}

/// Answers all envs of an observation, in their order.
fn answer(lane: &mut HostLane, observation: &ObservationMessage) -> Result<(), Box<dyn Error>> {
    let header = *observation.header();
    let view = ObservationView::new(header, observation.pages())?;
    let mut loan = lane.loan(view.n_envs())?;
    for (env_idx, block) in loan.blocks_mut().iter_mut().enumerate() {
        // A policy reads `env.state`, `env.instruction` and `env.image(camera_idx)`, all in shared memory.
        let env = view.env(env_idx);
        *block = ActionBlock {
            slot: env.record.slot,
            query: env.record.query,
            n_rows: 30,
            action_dim: view.control_mode().action_dim(view.morphology()) as u32,
            ..ActionBlock::zeroed()
        };
    }
    let answer = ActionHeader {
        schema_hash: SCHEMA_HASH,
        run: header.run,
        sequence: header.sequence,
        epoch: header.epoch,
        n_envs: header.n_envs,
        ..ActionHeader::zeroed()
    };
    // A run with --check-frames expects a checksum.
    let answer = if header.has_checksum == 1 { loan.with_checksum(answer) } else { answer };
    Ok(loan.send(answer)?)
}
