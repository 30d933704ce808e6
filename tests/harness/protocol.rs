//! JSON between the processes of a run: configurations, commands and events.

use policy_host::serve::{HostConfig, HostEvent};
use run_config::error_chain;
use serde_json::{Value, json};
use sim::serve::protocol::{SimCommand, SimConfig, SimEvent};

use super::edits::Edits;
use super::refused_in_one_line;

/// A message, and the function that reads it.
type Message = (fn(&[u8]) -> bool, Value);

/// Reads a message, writes it, and reads it again.
///
/// # Panics
/// If an error is unclear, or what was read second differs.
pub fn run(data: &[u8]) -> bool {
    let mut edits = Edits::new(data);
    let messages = messages();
    let (read, message) = edits.pick(&messages);
    read(&edits.json(message.to_string().as_bytes()))
}

fn messages() -> Vec<Message> {
    let domain = json!({ "prefix": "hyp_0_1_", "root": "/tmp/1" });
    let spec = json!({ "lane": 0, "policy": "a", "max_envs": 8, "block_pages": 87, "in_flight": 2 });
    let run = json!(run_config::RunConfig::default());
    let lane = json!({ "spec": spec, "images": "224x224,wrist=128x128", "foreign": false, "answer_timeout_s": 120, "execute": 30 });
    let sim = json!({
        "domain": domain, "run_id": u64::MAX, "max_envs": 8, "envs": 4, "lanes": [lane], "run": run
    });
    let network = json!({ "Network": ["Act", { "folder": "a", "precision": "F32", "n_steps": 5 }] });
    let host = json!({
        "domain": domain, "run_id": 7, "lane": spec, "spec": network, "checkpoint": "00ab",
        "morphologies": ["single"], "execution": { "mode": "chunk", "execute": 30 }, "run": run
    });
    let assignment = json!({
        "id": 3, "driver": { "lane": 0 }, "task": "RaiseCube", "perturbation": ["MO-Color"], "seed": 9
    });
    let ledger = json!({ "physics_s": 0.1, "render_s": 0.2, "policy_s": 0.0, "wait_s": 1e-9 });
    let outcome = json!({
        "id": 3, "steps": 2, "success_once": true, "success_at_end": false, "first_success_step": 1,
        "failed_predicate": "above", "fingerprint": u64::MAX, "actions": [1, 2], "ledger": ledger, "error": null
    });
    let progress = json!({
        "env_steps": 5, "images": 6, "queries": 7, "wall_s": 0.5, "physics_s": 0.1, "render_s": 0.1,
        "device_s": 0.0, "idle_s": 0.0, "cpu_s": 1.0, "foreign_s": [0.5], "latencies": { "counts": [0, 1, 2] }
    });
    let span = json!({ "activity": "step", "thread": 1, "start_ns": 10, "duration_ns": 5, "n": 1 });
    let host_ledger =
        json!({ "queries": 1, "batches": 1, "busy_s": 0.5, "cpu_s": 0.5, "device_s": 0.0, "flop": 9 });
    let ready = json!({ "shm_bytes": 1, "renderer": "cpu", "identity": "cpu" });
    vec![
        (sim_config, sim),
        (round_trip::<HostConfig>, host),
        (sim_command, json!({ "run": assignment })),
        (sim_command, json!({ "envs": { "count": 3 } })),
        (sim_command, json!({ "host_down": { "lane": 0 } })),
        (round_trip::<SimEvent>, json!({ "ready": ready })),
        (round_trip::<SimEvent>, json!({ "finished": outcome })),
        (round_trip::<SimEvent>, json!({ "progress": progress })),
        (round_trip::<SimEvent>, json!({ "spans": [span] })),
        (round_trip::<SimEvent>, json!({ "lane_failed": { "lane": 0, "message": "gone" } })),
        (round_trip::<HostEvent>, json!({ "Ready": { "load_ms": 1.5 } })),
        (round_trip::<HostEvent>, json!({ "Ledger": host_ledger })),
        (round_trip::<HostEvent>, json!({ "Failed": { "message": "gone" } })),
    ]
}

fn sim_config(text: &[u8]) -> bool {
    let Some(SimConfig { run, .. }) = read(text) else { return false };
    let strength = run.results.strength.get();
    assert!(strength > 0.0 && strength <= 1.0);
    true
}

fn sim_command(text: &[u8]) -> bool {
    let Some(command) = read(text) else { return false };
    if let SimCommand::Run(assignment) = command {
        assert!(assignment.perturbation.iter().next().is_some(), "a composition is not empty");
    }
    true
}

fn round_trip<T: serde::Serialize + serde::de::DeserializeOwned>(text: &[u8]) -> bool {
    read::<T>(text).is_some()
}

/// Returns the message if the text is one.
fn read<T: serde::Serialize + serde::de::DeserializeOwned>(text: &[u8]) -> Option<T> {
    match serde_json::from_slice::<T>(text) {
        Ok(message) => {
            let written = serde_json::to_string(&message).unwrap();
            let again: T =
                serde_json::from_str(&written).unwrap_or_else(|error| panic!("{error}: {written}"));
            assert_eq!(serde_json::to_string(&again).unwrap(), written);
            Some(message)
        }
        Err(error) => {
            refused_in_one_line(&error_chain(&error));
            None
        }
    }
}
